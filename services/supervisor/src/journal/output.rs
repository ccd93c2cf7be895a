//! Where the journal goes, and in which form.

use std::fmt;
use std::io::IsTerminal;
use std::str::FromStr;

use records::EventFile;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_appender::non_blocking::{ErrorCounter, NonBlocking, NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::{Layer, Registry};

/// Number of lines that may wait for a slow disk or terminal.
const LINES_WAITING: usize = 4096;

/// The form of a line on standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// For people; under systemd with a priority for its journal in place of the time.
    Plain,
    /// One JSON object a line.
    Json,
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "plain" => Ok(Self::Plain),
            "json" => Ok(Self::Json),
            _ => Err(format!("--log {text} is neither plain nor json")),
        }
    }
}

/// What of the journal goes to standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogTo {
    /// In which form; none: nothing does.
    pub format: Option<Format>,
    /// From this level on.
    level: LevelFilter,
}

impl Default for LogTo {
    fn default() -> Self {
        Self { format: None, level: LevelFilter::INFO }
    }
}

impl LogTo {
    /// Sets the level by its name.
    ///
    /// # Errors
    /// Where there is no such level.
    pub fn set_level(&mut self, name: &str) -> Result<(), String> {
        self.level = name.parse().map_err(|error| format!("--log-level {name}: {error}"))?;
        Ok(())
    }
}

/// The threads that write the journal. Dropped, it waits until they have written it, for some seconds at most.
pub struct Output {
    /// Held for their end.
    threads: Vec<WorkerGuard>,
    dropped: Vec<ErrorCounter>,
}

impl Output {
    /// Begins the journal of this process: every event into `events`, and what `log` says to standard error.
    pub fn begin(log: LogTo, events: Option<EventFile>) -> Self {
        let mut output = Self { threads: Vec::new(), dropped: Vec::new() };
        let json = || tracing_subscriber::fmt::layer().json().flatten_event(true).with_target(false);
        let mut layers: Vec<Box<dyn Layer<Registry> + Send + Sync>> = Vec::new();
        if let Some(events) = events {
            let writer = output.thread("record", events);
            layers.push(json().with_writer(writer).with_filter(LevelFilter::DEBUG).boxed());
        }
        if let Some(format) = log.format {
            let writer = output.thread("log", std::io::stderr());
            layers.push(match format {
                Format::Json => json().with_writer(writer).with_filter(log.level).boxed(),
                Format::Plain => {
                    let plain = tracing_subscriber::fmt::layer()
                        .event_format(Plain { for_systemd: is_systemds_journal() })
                        .with_ansi(std::io::stderr().is_terminal());
                    plain.with_writer(writer).with_filter(log.level).boxed()
                }
            });
        }
        // A process has one journal: a second one would be a mistake in this program, and nothing would be lost by it.
        let _ = tracing::subscriber::set_global_default(Registry::default().with(layers));
        output
    }

    fn thread(&mut self, name: &str, writer: impl std::io::Write + Send + 'static) -> NonBlocking {
        let (writer, guard) = NonBlockingBuilder::default()
            .lossy(true)
            .buffered_lines_limit(LINES_WAITING)
            .thread_name(name)
            .finish(writer);
        self.threads.push(guard);
        self.dropped.push(writer.error_counter());
        writer
    }

    /// Tells how many lines were not written because a disk or a terminal did not keep up.
    pub fn tell_dropped(&self, run_s: f64) {
        let lines: usize = self.dropped.iter().map(ErrorCounter::dropped_lines).sum();
        if lines > 0 {
            tracing::warn!(event = "note", run_s, lines, "{lines} lines of the journal were not written in time");
        }
    }
}

/// Whether standard error is systemd's journal (`JOURNAL_STREAM` is its device and inode).
fn is_systemds_journal() -> bool {
    let stderr = rustix::fs::fstat(std::io::stderr()).ok();
    let stream = stderr.map(|stat| format!("{}:{}", stat.st_dev, stat.st_ino));
    stream.is_some() && std::env::var("JOURNAL_STREAM").ok() == stream
}

/// A line for people: time, run time, level, message.
struct Plain {
    for_systemd: bool,
}

impl<S: Subscriber + for<'a> LookupSpan<'a>, N: for<'a> FormatFields<'a> + 'static> FormatEvent<S, N> for Plain {
    fn format_event(&self, _: &FmtContext<'_, S, N>, mut writer: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut told = Told::default();
        event.record(&mut told);
        let level = *event.metadata().level();
        let Told { run_s, message } = told;
        if message == records::ALIVE {
            return Ok(());
        }
        if self.for_systemd {
            return writeln!(writer, "<{}>{run_s:.2} s  {message}", priority(level));
        }
        let now = records::now_utc();
        let (colour, end) = if writer.has_ansi_escapes() { (colour(level), "\x1b[0m") } else { ("", "") };
        writeln!(writer, "{now} {run_s:9.2} s {colour}{level:>5}{end}  {message}")
    }
}

/// The priority of syslog.
fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => 3,
        Level::WARN => 4,
        Level::INFO => 6,
        _ => 7,
    }
}

fn colour(level: Level) -> &'static str {
    match level {
        Level::ERROR => "\x1b[31m",
        Level::WARN => "\x1b[33m",
        _ => "",
    }
}

#[derive(Default)]
struct Told {
    run_s: f64,
    message: String,
}

impl Visit for Told {
    fn record_f64(&mut self, field: &Field, value: f64) {
        if field.name() == "run_s" {
            self.run_s = value;
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.message = format!("{value:?}");
        }
    }
}
