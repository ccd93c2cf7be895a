//! `bench transport`: how long a frame is on the way from one process to another that sleeps until it comes.
//!
//! Two programs take turns in one run: ours (the transport's frames and wait loop, as the services use them) and plain
//! iceoryx2 with the same quality of service. A frame is written in place before the clock starts; its stamp is taken
//! right before it is sent, and the receiver's right after it has it in hand.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver as Lines, RecvTimeoutError, channel};
use std::time::Duration;

use indicatif::ProgressBar;
use messages::DepthFrame;
use serde_json::{Value, json};
use transport::{
    ClockKind, Domain, FramePublisher, Io, RunDir, RunInfo, Service, TransportError, monotonic_ns, run_tool,
};

use super::Percentiles;
use super::plain::PlainPublisher;
use super::receiver::END_NS;
use crate::exit::Failure;
use crate::out::{self, table};
use crate::workers::progress;

/// Sizes in elements of 2 bytes: a small message, a scan, two depth frames.
const SIZES: [usize; 4] = [32, 4096, 640 * 480, 1280 * 720];
/// The rate that counts, and a faster one for more samples, with the share of the time that each has.
const RATES: [(f64, f64); 2] = [(30.0, 2.0 / 3.0), (250.0, 1.0 / 3.0)];
/// Messages of each kind at the start of a row that do not count.
const WARM_UP: u64 = 10;
/// A receiver is ready, and tells its figures, within this time.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);
/// The receivers take the last message within this time.
const LINGER_NS: u64 = 300_000_000;

/// One row: messages of one size at one rate, from both programs in turn.
#[derive(Debug, Clone)]
struct Row {
    elements: usize,
    rate_hz: f64,
    /// Messages of each program, the first ones that do not count among them.
    messages: u64,
    /// Seqs that count: the first, and the one behind the last.
    ours: (u64, u64),
    plain: (u64, u64),
}

/// `guidedog bench transport`
///
/// # Errors
/// Where shared memory or the receiving processes fail.
pub fn bench(seconds: u32, as_json: bool) -> Result<(), Failure> {
    let dir = RunDir::create(&format!("bench-{}", std::process::id())).map_err(Failure::of_run)?;
    let outcome = run(&dir, rows(seconds));
    dir.remove();
    let (rows, ours, plain) = outcome?;
    let rows: Vec<Value> = rows.iter().map(|row| row_json(row, &ours, &plain)).collect();
    let cpus = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    out::tell(as_json, &json!({ "seconds": seconds, "cpus": cpus, "rows": rows }), || lines(&rows))
}

fn rows(seconds: u32) -> Vec<Row> {
    let row = |elements: usize, (rate_hz, share): (f64, f64)| {
        let messages = (f64::from(seconds) * share / SIZES.len() as f64 * rate_hz) as u64 + WARM_UP;
        Row { elements, rate_hz, messages, ours: (0, 0), plain: (0, 0) }
    };
    RATES.into_iter().flat_map(|rate| SIZES.into_iter().map(move |elements| row(elements, rate))).collect()
}

type Taken = Vec<(u64, u64)>;

fn run(dir: &RunDir, rows: Vec<Row>) -> Result<(Vec<Row>, Taken, Taken), Failure> {
    dir.write_info(&RunInfo {
        name: "bench".to_owned(),
        prefix: dir.prefix(),
        supervisor_pid: std::process::id(),
        started_monotonic_ns: monotonic_ns(),
        clock: ClockKind::Real,
        faults: false,
    })
    .map_err(Failure::of_run)?;
    let domain = Domain::open(RunDir::open(dir.path()), "bench.publisher").map_err(Failure::of_run)?;
    let holder = domain.create_all().map_err(Failure::of_run)?;
    let largest = SIZES.into_iter().max().unwrap_or(0);
    let plain = PlainPublisher::open(dir.path(), largest)?;
    let mut receivers = [Receiver::start("ours", dir.path())?, Receiver::start("plain", dir.path())?];
    let sender = run_tool(domain, |io| {
        Ok(Sender {
            ours: io.frame_publisher(largest)?,
            plain,
            bar: progress(rows.len() as u64, "rows"),
            rows,
            row: 0,
            slot: 0,
            next_ns: io.now_ns() + LINGER_NS,
            ended: false,
            done: false,
            failure: None,
        })
    })
    .map_err(Failure::of_run)?;
    if let Some(failure) = sender.failure {
        return Err(failure);
    }
    let [ours, plain] = receivers.each_mut().map(Receiver::taken);
    drop(holder);
    Ok((sender.rows, ours?, plain?))
}

/// Sends both programs' messages in turn, in the transport's own wait loop.
struct Sender {
    ours: FramePublisher<DepthFrame>,
    plain: PlainPublisher,
    rows: Vec<Row>,
    row: usize,
    /// Messages of this row so far, of both programs.
    slot: u64,
    next_ns: u64,
    /// The last message is sent.
    ended: bool,
    /// And the receivers have had time to take it.
    done: bool,
    failure: Option<Failure>,
    bar: ProgressBar,
}

impl Sender {
    fn send_ours(&mut self, io: &Io, elements: usize, stamp_ns: Option<u64>) -> Result<u64, TransportError> {
        let mut loan = self.ours.loan(elements)?;
        (loan.meta_mut().width, loan.meta_mut().height) = (elements as u32, 1);
        let value = self.slot as u16;
        loan.data_mut().fill(value);
        let stamp_ns = stamp_ns.unwrap_or_else(|| io.now_ns());
        self.ours.publish(stamp_ns, loan).map(|header| header.seq)
    }

    fn send_plain(&mut self, elements: usize, stamp_ns: Option<u64>) -> Result<u64, TransportError> {
        self.plain.send(elements, self.slot as u16, stamp_ns).map_err(|failure| {
            let error = TransportError::service(&failure.message);
            self.failure = Some(failure);
            error
        })
    }

    fn send_next(&mut self, io: &Io) -> Result<(), TransportError> {
        let Some(row) = self.rows.get(self.row).cloned() else {
            self.send_ours(io, 1, Some(END_NS))?;
            self.send_plain(1, Some(END_NS))?;
            self.ended = true;
            self.next_ns += LINGER_NS;
            return Ok(());
        };
        let is_ours = self.slot.is_multiple_of(2);
        let seq = if is_ours { self.send_ours(io, row.elements, None)? } else { self.send_plain(row.elements, None)? };
        let seqs = if is_ours { &mut self.rows[self.row].ours } else { &mut self.rows[self.row].plain };
        if self.slot / 2 == WARM_UP {
            seqs.0 = seq;
        }
        seqs.1 = seq + 1;
        self.slot += 1;
        if self.slot == 2 * row.messages {
            (self.row, self.slot) = (self.row + 1, 0);
            self.bar.inc(1);
        }
        self.next_ns += (0.5e9 / row.rate_hz) as u64;
        Ok(())
    }
}

impl Service for Sender {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        if now >= self.next_ns {
            if self.ended {
                self.done = true;
                return Ok(());
            }
            self.send_next(io)?;
            // A sender that fell behind does not rush.
            self.next_ns = self.next_ns.max(now);
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn is_done(&self) -> bool {
        self.done
    }
}

/// A receiving process; it is killed where it is let go early.
struct Receiver {
    /// Which of the two.
    program: &'static str,
    child: Child,
    stdout: Lines<String>,
}

impl Receiver {
    fn start(program: &'static str, dir: &Path) -> Result<Self, Failure> {
        let own = std::env::current_exe().map_err(Failure::of_run)?;
        let mut child = Command::new(own)
            .arg("bench-receiver")
            .arg(program)
            .arg(dir)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(Failure::of_run)?;
        let stdout = child.stdout.take().ok_or_else(|| Failure::run("a receiver has no stdout"))?;
        let (sender, lines) = channel();
        // The thread ends with the receiver, or when nobody takes its lines.
        std::thread::spawn(move || {
            BufReader::new(stdout).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        let receiver = Self { program, child, stdout: lines };
        if receiver.line("that it is ready")? != "ready" {
            return Err(Failure::run(format!("the {program} receiver could not start")));
        }
        Ok(receiver)
    }

    /// What it says next, where `what` is awaited.
    fn line(&self, what: &str) -> Result<String, Failure> {
        let program = self.program;
        self.stdout.recv_timeout(ANSWER_WITHIN).map_err(|error| {
            Failure::run(match error {
                RecvTimeoutError::Timeout => {
                    let limit_s = ANSWER_WITHIN.as_secs();
                    format!("the {program} receiver did not say {what} within {limit_s} s")
                }
                RecvTimeoutError::Disconnected => format!("the {program} receiver ended before it said {what}"),
            })
        })
    }

    /// What it took: (seq, nanoseconds on the way).
    fn taken(&mut self) -> Result<Taken, Failure> {
        let line = self.line("what it took")?;
        self.child.wait().map_err(Failure::of_run)?;
        let program = self.program;
        serde_json::from_str(&line)
            .map_err(|error| Failure::run(format!("the {program} receiver's figures cannot be read: {error}")))
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        // It has ended already where all went well.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn within(taken: &Taken, (first, end): (u64, u64)) -> Option<Percentiles> {
    Percentiles::of(taken.iter().filter(|(seq, _)| (first..end).contains(seq)).map(|(_, ns)| *ns).collect())
}

fn row_json(row: &Row, ours: &Taken, plain: &Taken) -> Value {
    let (ours, plain) = (within(ours, row.ours), within(plain, row.plain));
    let us = |of: &Option<Percentiles>| {
        of.as_ref().map(|of| json!({ "p50": of.p50_us, "p99": of.p99_us, "max": of.max_us }))
    };
    let n = |of: &Option<Percentiles>| of.as_ref().map_or(0, |of| of.n as u64);
    let sent = row.messages - WARM_UP;
    let ratio = ours.as_ref().zip(plain.as_ref()).map(|(o, p)| (o.p50_us / p.p50_us * 100.0).round() / 100.0);
    json!({
        "bytes": row.elements * size_of::<u16>(), "rate_hz": row.rate_hz, "n": n(&ours),
        "ours_us": us(&ours), "plain_us": us(&plain), "ratio": ratio,
        "lost": { "ours": sent.saturating_sub(n(&ours)), "plain": sent.saturating_sub(n(&plain)) },
    })
}

fn lines(rows: &[Value]) -> Vec<String> {
    let cells = |row: &Value| {
        let us = |path: &str| row.pointer(path).and_then(Value::as_f64).map_or("-".to_owned(), |us| format!("{us:.1}"));
        vec![
            row["bytes"].to_string(),
            format!("{} Hz", row["rate_hz"]),
            row["n"].to_string(),
            format!("{} / {} / {}", us("/ours_us/p50"), us("/ours_us/p99"), us("/ours_us/max")),
            format!("{} / {} / {}", us("/plain_us/p50"), us("/plain_us/p99"), us("/plain_us/max")),
            row["ratio"].to_string(),
            format!("{} / {}", row["lost"]["ours"], row["lost"]["plain"]),
        ]
    };
    let head = "one-way latency, p50 / p99 / max, microseconds:".to_owned();
    let rows: Vec<Vec<String>> = rows.iter().map(cells).collect();
    [vec![head], table(&["bytes", "rate", "n", "ours", "plain iceoryx2", "ratio", "lost"], &rows)].concat()
}

#[cfg(test)]
mod tests {
    use super::{Row, row_json, rows};

    #[test]
    fn every_size_is_measured_at_every_rate() {
        let rows = rows(60);
        assert_eq!(rows.len(), 8);
        assert_eq!(rows[3].elements, 1280 * 720);
        assert_eq!(rows[3].messages, 310);
    }

    #[test]
    fn a_row_counts_its_own_seqs_only() {
        let row = Row { elements: 32, rate_hz: 30.0, messages: 13, ours: (11, 14), plain: (11, 14) };
        let taken: Vec<(u64, u64)> = (1..20).map(|seq| (seq, seq * 1000)).collect();
        let json = row_json(&row, &taken, &taken);
        assert_eq!((json["n"].as_u64(), json["ours_us"]["p50"].as_f64()), (Some(3), Some(12.0)));
        assert_eq!((json["ratio"].as_f64(), json["lost"]["ours"].as_u64()), (Some(1.0), Some(0)));
    }
}
