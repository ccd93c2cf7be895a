//! `bench link`: how evenly the robot's link sends, with and without priority, on a quiet and on a busy machine.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use links::{Link, UNITREE_PERIOD_NS, UnitreeLink};
use messages::Twist2;
use serde_json::{Value, json};
use settings::UnitreeSettings;
use transport::{hurry_this_thread, monotonic_ns};
use unitree::DEAD_MAN_NS;

use super::Percentiles;
use crate::exit::Failure;
use crate::out::{self, number, table, text};
use crate::workers::progress;

/// As locomotion wishes.
const WISH_EVERY: Duration = Duration::from_millis(20);
/// A robot that hears nothing for so long has lost its link.
const SILENT: Duration = Duration::from_secs(1);
/// No command of any profile is longer.
const COMMAND_MAX: usize = 256;
/// The first commands come while threads begin.
const SETTLE: usize = 50;

/// `guidedog bench link`.
///
/// # Errors
/// Where no socket can be had, nothing comes, or the report cannot be written.
pub fn bench(seconds: u32, as_json: bool) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let cases = [("quiet", true), ("quiet", false), ("busy", true), ("busy", false)];
    for (machine, hurry) in progress(cases.len() as u64, "rows").wrap_iter(cases.into_iter()) {
        let idlers = Busy::all_cpus(machine == "busy");
        rows.push(measure(machine, hurry, Duration::from_secs(seconds.into()))?);
        drop(idlers);
    }
    let report = json!({ "period_us": UNITREE_PERIOD_NS / 1000, "rows": rows });
    out::tell(as_json, &report, || told(&rows))
}

fn told(rows: &[Value]) -> Vec<String> {
    let period_us = UNITREE_PERIOD_NS / 1000;
    let head = format!("commands of the link to Unitree's robots: how far apart from {period_us} us, us");
    let lines = rows.iter().map(|row| {
        let figure = |at| format!("{:.0}", number(row, at));
        let priority = if row["real_time"] == true { "real-time" } else { "none" };
        let machine = text(row, "/machine").to_owned();
        vec![machine, priority.to_owned(), figure("/p50_us"), figure("/p99_us"), figure("/max_us"), figure("/n")]
    });
    [vec![head], table(&["machine", "priority", "p50", "p99", "max", "n"], &lines.collect::<Vec<_>>())].concat()
}

fn measure(machine: &str, hurry: bool, lasts: Duration) -> Result<Value, Failure> {
    let robot = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::of_run)?;
    robot.set_read_timeout(Some(SILENT)).map_err(Failure::of_run)?;
    let SocketAddr::V4(at) = robot.local_addr().map_err(Failure::of_run)? else {
        return Err(Failure::run("the robot has no address of IPv4"));
    };
    let any = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);
    let settings = UnitreeSettings { robot: Some(at), local: Some(any), ..UnitreeSettings::default() };
    let mut link = UnitreeLink::open_at(&settings, hurry).map_err(Failure::of_run)?;
    let until = Instant::now() + lasts;
    let ear = std::thread::spawn(move || {
        // Who takes the time must not be what is late.
        hurry_this_thread();
        let (mut came_ns, mut bytes) = (Vec::new(), [0; COMMAND_MAX]);
        while Instant::now() < until && robot.recv(&mut bytes).is_ok() {
            came_ns.push(monotonic_ns());
        }
        came_ns
    });
    let ahead = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
    while Instant::now() < until {
        link.write(ahead, DEAD_MAN_NS).map_err(Failure::of_run)?;
        std::thread::sleep(WISH_EVERY);
    }
    let hurried = link.hurries();
    let came_ns = ear.join().map_err(|_| Failure::run("the robot's end failed"))?;
    drop(link);
    let off_ns = came_ns.windows(2).skip(SETTLE).map(|pair| (pair[1] - pair[0]).abs_diff(UNITREE_PERIOD_NS)).collect();
    let Percentiles { n, p50_us, p99_us, max_us } =
        Percentiles::of(off_ns).ok_or_else(|| Failure::run("no command came"))?;
    Ok(json!({
        "machine": machine, "real_time": hurried, "n": n, "p50_us": p50_us, "p99_us": p99_us, "max_us": max_us,
    }))
}

/// Threads that keep every processor busy until they are dropped.
struct Busy(Arc<AtomicBool>);

impl Busy {
    fn all_cpus(wanted: bool) -> Self {
        let over = Arc::new(AtomicBool::new(!wanted));
        let cpus = std::thread::available_parallelism().map_or(1, usize::from);
        for _ in 0..if wanted { 2 * cpus } else { 0 } {
            let over = Arc::clone(&over);
            std::thread::spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        Self(over)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
