//! `bench idle`: what the whole stack costs while the robot stands, by service.

use std::io::Write;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use control::{Client, ServicePhase, ServiceStatus, Status};
use messages::ServiceId;
use serde_json::{Value, json};

use crate::args::{WalkArgs, WorldArgs};
use crate::exit::Failure;
use crate::find::{free_name, socket};
use crate::launch::{Launch, Running};
use crate::out::{self, elements, number, table, text};
use crate::prepare;
use crate::workers::progress;

/// All services are ready within this time.
const READY_WITHIN: Duration = Duration::from_secs(30);
/// What happens at the start only is over after this.
const SETTLE: Duration = Duration::from_secs(3);
/// Those whose cost is supervision's.
const SUPERVISION: [&str; 2] = ["supervisor", "brake"];

/// What one process has used so far.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Usage {
    cpu_s: f64,
    /// How often it has waited for something.
    wake_ups: u64,
    rss_kib: u64,
    shmem_kib: u64,
}

/// `guidedog bench idle`
///
/// # Errors
/// Where the stack cannot be started or fails.
pub fn bench(seconds: u32, as_json: bool) -> Result<(), Failure> {
    let mut route = tempfile::NamedTempFile::new().map_err(Failure::of_run)?;
    writeln!(route, "# No cues, no goal: the robot stands.").map_err(Failure::of_run)?;
    let scenario = Some(prepare::DEFAULT_SCENARIO.to_owned());
    let world = WorldArgs { scenario, cues: Some(route.path().to_owned()), ..WorldArgs::default() };
    let mut prepared = prepare::walk(&WalkArgs { world, ..WalkArgs::default() })?;
    // Ended by us, long before.
    prepared.settings.walk.time_limit = settings::Millis::try_from("1h".to_owned()).ok();
    prepared.settings.run_record.keep_runs = 0;
    let launch = Launch { settings: &prepared.settings, name: free_name("idle"), speed: None };
    let mut running = launch.spawn()?;
    let measured = measure(&mut running, Duration::from_secs(u64::from(seconds)));
    let report = running.finish(measured)?;
    out::tell(as_json, &report, || lines(&report))
}

fn measure(running: &mut Running, span: Duration) -> Result<Value, Failure> {
    let mut client = connect(running)?;
    let processes = processes(&client_status(&mut client)?);
    running.sleep(SETTLE)?;
    let started = Instant::now();
    let before: Vec<Option<Usage>> = processes.iter().map(|(_, pid)| usage(*pid)).collect();
    let sleeper = Sleeper::start(span);
    let seconds = span.as_secs();
    for _ in progress(seconds, "seconds").wrap_iter(0..seconds) {
        running.sleep(Duration::from_secs(1))?;
    }
    let after: Vec<Option<Usage>> = processes.iter().map(|(_, pid)| usage(*pid)).collect();
    let seconds = started.elapsed().as_secs_f64();
    let percent = |cpu_s: f64| (cpu_s / seconds * 10_000.0).round() / 100.0;
    let round = |figure: f64| (figure * 100.0).round() / 100.0;
    let mut rows = Vec::new();
    let (mut total, mut supervision) = (0.0, 0.0);
    for (((name, pid), before), after) in processes.iter().zip(before).zip(after) {
        let (Some(before), Some(after)) = (before, after) else {
            return Err(Failure::run(format!("{name} (process {pid}) ended while it was measured")));
        };
        let cpu = percent(after.cpu_s - before.cpu_s);
        total += cpu;
        supervision += if SUPERVISION.contains(&name.as_str()) { cpu } else { 0.0 };
        rows.push(json!({
            "name": name, "pid": pid, "cpu_percent": cpu,
            "wake_ups_per_s": round(after.wake_ups.saturating_sub(before.wake_ups) as f64 / seconds),
            "rss_kib": after.rss_kib, "rss_shmem_kib": after.shmem_kib,
        }));
    }
    let mode = client_status(&mut client)?.mode;
    Ok(json!({
        "seconds": seconds, "services": rows, "cpu_percent": round(total),
        "supervision_cpu_percent": round(supervision), "supervision": SUPERVISION, "mode": mode,
        "sleeper_cpu_percent": sleeper.cpu_s().map(percent), "sleeper_wake_ups_per_s": Sleeper::PER_S,
    }))
}

/// Waits until every service is ready.
fn connect(running: &mut Running) -> Result<Client, Failure> {
    let until = Instant::now() + READY_WITHIN;
    let mut last = "the supervisor does not answer".to_owned();
    while Instant::now() < until {
        running.sleep(Duration::from_millis(100))?;
        let Ok(mut client) = Client::connect(&socket(running.name())) else { continue };
        let Ok(status) = client.read() else { continue };
        let services: Vec<&ServiceStatus> = wanted(&status).collect();
        let late = services.iter().filter(|service| service.state != ServicePhase::Ready);
        let late: Vec<&str> = late.map(|service| service.name.as_str()).collect();
        if late.is_empty() && !services.is_empty() {
            return Ok(client);
        }
        last = format!("not ready: {}", late.join(", "));
    }
    Err(Failure::run(format!("the stack did not come up within {} s; {last}", READY_WITHIN.as_secs())))
}

fn client_status(client: &mut Client) -> Result<Status, Failure> {
    client.read().map_err(|error| Failure::run(format!("the supervisor: {error}")))
}

/// The services of a run but for those that nobody has asked for: a recorder.
fn wanted(status: &Status) -> impl Iterator<Item = &ServiceStatus> {
    status.services.iter().filter(|service| service.state != ServicePhase::Off)
}

fn processes(status: &Status) -> Vec<(String, u32)> {
    let supervisor = (ServiceId::Supervisor.name().to_owned(), status.supervisor_pid);
    let services = wanted(status).map(|service| (service.name.clone(), service.pid));
    std::iter::once(supervisor).chain(services).collect()
}

fn usage(pid: u32) -> Option<Usage> {
    let read = |file: &str| std::fs::read_to_string(format!("/proc/{pid}/{file}")).ok();
    let usage = parse_usage(&read("stat")?, &read("status")?, rustix::param::clock_ticks_per_second())?;
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten();
    let waits = |thread: std::fs::DirEntry| waits_of(&std::fs::read_to_string(thread.path().join("status")).ok()?);
    Some(Usage { wake_ups: threads.filter_map(waits).sum(), ..usage })
}

/// How often a thread has waited, by its `status`.
fn waits_of(status: &str) -> Option<u64> {
    status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?.trim().parse().ok()
}

/// A thread that does nothing but wake up as often as the supervisor must: what that alone costs on this machine.
struct Sleeper(JoinHandle<f64>);

impl Sleeper {
    const PER_S: u32 = 50;

    fn start(span: Duration) -> Self {
        Self(std::thread::spawn(move || {
            let until = Instant::now() + span;
            while Instant::now() < until {
                std::thread::sleep(Duration::from_secs(1) / Self::PER_S);
            }
            let used = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
            used.tv_sec as f64 + used.tv_nsec as f64 * 1e-9
        }))
    }

    /// What it used; nothing where it panicked.
    fn cpu_s(self) -> Option<f64> {
        self.0.join().ok()
    }
}

/// Fields 14 and 15 of `stat` are user and system time; its second, in brackets, may hold anything.
fn parse_usage(stat: &str, status: &str, ticks_per_second: u64) -> Option<Usage> {
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?;
    let kib = |key: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
        line.split_whitespace().next()?.parse().ok()
    };
    let cpu_s = ticks as f64 / ticks_per_second as f64;
    Some(Usage { cpu_s, wake_ups: 0, rss_kib: kib("VmRSS")?, shmem_kib: kib("RssShmem")? })
}

fn lines(report: &Value) -> Vec<String> {
    let row = |service: &Value| {
        let mib = |path: &str| format!("{:.1} MiB", number(service, path) / 1024.0);
        vec![
            text(service, "/name").to_owned(),
            format!("{:.2} %", number(service, "/cpu_percent")),
            format!("{:.0}", number(service, "/wake_ups_per_s")),
            mib("/rss_kib"),
            mib("/rss_shmem_kib"),
        ]
    };
    let rows: Vec<Vec<String>> = elements(report, "/services").iter().map(row).collect();
    let head = format!("standing still for {:.0} s; CPU as share of one core:", number(report, "/seconds"));
    let all = format!(
        "in all {:.2} %, supervision ({}) {:.2} %",
        number(report, "/cpu_percent"),
        SUPERVISION.join(" + "),
        number(report, "/supervision_cpu_percent")
    );
    let alone = format!(
        "a thread that only wakes up {} times a second: {:.2} %",
        Sleeper::PER_S,
        number(report, "/sleeper_cpu_percent")
    );
    [vec![head], table(&["service", "CPU", "wake-ups a second", "resident", "of it shared"], &rows), vec![all, alone]]
        .concat()
}

#[cfg(test)]
mod tests {
    use super::{Usage, parse_usage};

    #[test]
    fn usage_is_read_past_a_name_with_brackets() {
        let stat = "7 (a) b) S 1 7 7 0 -1 4194560 100 0 0 0 150 50 0 0 20 0 1 0 100 1000 200";
        let status = "Name:\ta) b\nVmRSS:\t    2048 kB\nRssShmem:\t 512 kB\n";
        assert_eq!(
            parse_usage(stat, status, 100),
            Some(Usage { cpu_s: 2.0, wake_ups: 0, rss_kib: 2048, shmem_kib: 512 })
        );
        assert_eq!(parse_usage("7", status, 100), None);
    }
}
