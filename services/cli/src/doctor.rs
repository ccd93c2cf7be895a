//! `doctor`: what a run needs of this machine, and how to mend what is missing.

mod devices;
mod rates;

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use messages::{ServiceId, TopicId, topic::DEAD_SLOTS};
use rustix::process::Resource;
use serde_json::{Value, json};
use settings::{Profile, Settings, VoiceSource};
use transport::{PoolSize, RunDir, live_runs, monotonic_ns, pool_sizes, runs_root};

use crate::args::DoctorArgs;
use crate::cues;
use crate::exit::{EXIT_OK, EXIT_RUN_FAILED, Failure};
use crate::launch::beside;
use crate::out::{self, table};
use crate::prepare;

/// Descriptors: the supervisor holds lines, logs and sockets of every service, iceoryx2 a few for each port.
const FILES_NEEDED: u64 = 1024;
/// MADV_POPULATE_WRITE (prefaulting) came with 5.14; pidfd (5.3) and epoll_pwait2 (5.11) came before.
const KERNEL_NEEDED: (u32, u32) = (5, 14);
/// In real time the stack wants this many CPUs.
const CPUS_WANTED: usize = 2;
const CLOCK_SOURCE: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
const CLOCK_READS: usize = 10_000;
/// A look at a good clock takes some ten nanoseconds.
const CLOCK_READ_NS: u64 = 5_000;
const MIB: f64 = 1024.0 * 1024.0;

/// One thing that was looked at.
struct Check {
    name: &'static str,
    ok: bool,
    found: String,
    fix: String,
}

/// Shared memory of one topic: pools of all its writers.
struct Pool {
    size: PoolSize,
    /// Writers at once; dead ones not yet cleaned up not counted.
    live: usize,
    /// With those.
    most: usize,
}

/// `guidedog doctor`: the exit code.
///
/// # Errors
/// Where the configuration is wrong.
pub fn doctor(args: &DoctorArgs, as_json: bool) -> Result<u8, Failure> {
    let settings = prepare::load(Profile::Walk, args.config.as_deref())?;
    let pools = pools((settings.depth.width * settings.depth.height) as usize);
    let mut checks = checks(&settings, &pools);
    if settings.cue.voice.source != VoiceSource::Absent {
        checks.push(devices::hearing(&cues::model_files(args.config.as_deref())?));
    }
    if let Some(span) = args.rates {
        checks.extend(rates::checks(args.config.as_deref(), span).unwrap_or_else(|failure| {
            // What was found so far is told all the same.
            let fix = "mend what is told above, then ask again".to_owned();
            vec![Check { name: "rates", ok: false, found: failure.message, fix }]
        }));
    }
    let ok = checks.iter().all(|check| check.ok);
    let (width, height) = (settings.depth.width, settings.depth.height);
    out::tell(as_json, &report(ok, &checks, &pools), || lines(&checks, &pools, width, height))?;
    Ok(if ok { EXIT_OK } else { EXIT_RUN_FAILED })
}

/// What is looked at without running anything.
fn checks(settings: &Settings, pools: &[Pool]) -> Vec<Check> {
    let mut checks = vec![
        shared_memory(pools),
        open_files(),
        run_root(),
        services(),
        leftovers(),
        kernel(),
        cpus(),
        priority(),
        clock(),
    ];
    checks.extend(devices::checks(settings));
    checks
}

/// What `doctor` reports for the settings in that file.
///
/// # Errors
/// Where they cannot be read.
pub fn report_for(settings: &Path) -> Result<Value, Failure> {
    let settings = settings::load_resolved(settings).map_err(Failure::of_input)?;
    let pools = pools((settings.depth.width * settings.depth.height) as usize);
    let checks = checks(&settings, &pools);
    Ok(report(checks.iter().all(|check| check.ok), &checks, &pools))
}

/// Each service has a health topic of its own; every other topic is one.
fn pools(depth_pixels: usize) -> Vec<Pool> {
    let pool = |size: PoolSize| {
        let topics = if size.topic == TopicId::Health { ServiceId::ALL.len() } else { 1 };
        let most = size.topic.spec().map_or(0, messages::topic::TopicSpec::max_publishers);
        // A health topic has room for a second policy, which the others never use.
        let live = if size.topic == TopicId::Health { 1 } else { most.saturating_sub(DEAD_SLOTS) };
        Pool { size, live: live * topics, most: most * topics }
    };
    pool_sizes(depth_pixels).into_iter().map(pool).collect()
}

fn total(pools: &[Pool], writers: impl Fn(&Pool) -> usize) -> u64 {
    pools.iter().map(|pool| (pool.size.bytes() * writers(pool)) as u64).sum()
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / MIB)
}

/// Shared memory for all services of one run. Restarts need more until the dead processes are cleaned up.
fn shared_memory(pools: &[Pool]) -> Check {
    let [needed, most] = [total(pools, |pool| pool.live), total(pools, |pool| pool.most)];
    let name = "shared memory";
    let (size, free) = match transport::shared_memory_bytes() {
        Ok(bytes) => bytes,
        Err(error) => {
            let fix = format!("mount -t tmpfs -o size=512M tmpfs {0}, or mount -o remount,rw {0}", transport::SHM);
            return Check { name, ok: false, found: error.to_string(), fix };
        }
    };
    let fix = "mount -o remount,size=512M /dev/shm (docker: --shm-size 512m)".to_owned();
    let [free_mib, size_mib, needed_mib, most_mib] = [free, size, needed, most].map(mib);
    let found =
        format!("{free_mib} free of {size_mib}; a run needs {needed_mib}, up to {most_mib} while services restart");
    Check { name, ok: free >= needed, found, fix }
}

/// What a run needs before it is started; `depth_pixels` of its camera.
///
/// # Errors
/// Names what is missing, and how to mend it.
pub fn preflight(depth_pixels: usize) -> Result<(), Failure> {
    for check in [shared_memory(&pools(depth_pixels)), open_files()] {
        if !check.ok {
            return Err(Failure::run(format!("{}: {}; {}", check.name, check.found, check.fix)));
        }
    }
    Ok(())
}

fn open_files() -> Check {
    let limit = rustix::process::getrlimit(Resource::Nofile).current;
    Check {
        name: "open files",
        ok: limit.is_none_or(|limit| limit >= FILES_NEEDED),
        found: limit.map_or("no limit".to_owned(), |limit| format!("limit {limit}")),
        fix: format!("ulimit -n {FILES_NEEDED} (systemd: LimitNOFILE={FILES_NEEDED})"),
    }
}

/// Makes a run directory as a run does, and removes it.
fn run_root() -> Check {
    let root = runs_root();
    let (ok, found) = match RunDir::create(&format!("doctor-{}", std::process::id())) {
        Ok(dir) => {
            dir.remove();
            (true, format!("{} can be written to", root.display()))
        }
        Err(error) => (false, error.to_string()),
    };
    let fix = "set GUIDEDOG_RUNS to a folder that this user may write".to_owned();
    Check { name: "run directory", ok, found, fix }
}

fn services() -> Check {
    let needed = ServiceId::ALL.into_iter().filter(|service| *service != ServiceId::Recorder);
    let missing: Vec<String> = needed
        .clone()
        .map(|service| format!("guidedog-{service}"))
        .filter(|name| {
            let metadata = beside(name).ok().and_then(|path| path.metadata().ok());
            !metadata.is_some_and(|metadata| metadata.is_file() && metadata.permissions().mode() & 0o111 != 0)
        })
        .collect();
    let found = if missing.is_empty() {
        format!("all {} are beside guidedog", needed.count())
    } else {
        format!("missing beside guidedog: {}", missing.join(", "))
    };
    let fix = "build all of them (cargo build), or install them into one folder".to_owned();
    Check { name: "services", ok: missing.is_empty(), found, fix }
}

/// Dead runs are swept as every start does; what nobody here owns is told, and nothing is wrong with that.
fn leftovers() -> Check {
    let live = live_runs();
    let dead = |live: &[String]| {
        let entries = std::fs::read_dir(runs_root()).into_iter().flatten().flatten();
        entries.filter(|e| e.path().is_dir() && !live.contains(&e.file_name().to_string_lossy().into_owned())).count()
    };
    let before = dead(&live);
    transport::sweep();
    let after = dead(&live_runs());
    let prefixes: Vec<String> = live.iter().map(|name| RunDir::open(&runs_root().join(name)).prefix()).collect();
    let files = std::fs::read_dir(transport::SHM).into_iter().flatten().flatten();
    let strange = files
        .map(|file| file.file_name().to_string_lossy().into_owned())
        .filter(|name| is_ours(name) && !prefixes.iter().any(|prefix| name.starts_with(prefix)))
        .count();
    let mut found = format!("{} live runs, {} dead ones swept", live.len(), before.saturating_sub(after));
    if strange > 0 {
        found += &format!(", {strange} files in /dev/shm of runs under another root");
    }
    let fix = format!("remove the folders of dead runs in {}", runs_root().display());
    Check { name: "leftovers", ok: after == 0, found, fix }
}

/// Whether a file in shared memory has a prefix such as runs have.
fn is_ours(name: &str) -> bool {
    let digits = name.strip_prefix("gd").and_then(|rest| rest.split_once('_')).map(|(digits, _)| digits);
    digits.is_some_and(|digits| digits.len() == 16 && digits.chars().all(|c| c.is_ascii_hexdigit()))
}

fn kernel() -> Check {
    let uname = rustix::system::uname();
    let release = uname.release().to_string_lossy().into_owned();
    let pidfd = rustix::process::pidfd_open(rustix::process::getpid(), rustix::process::PidfdFlags::empty()).is_ok();
    let found = format!("Linux {release}, pidfd {}", if pidfd { "works" } else { "does not work" });
    let fix = format!("Linux {}.{} or newer; a sandbox must let pidfd_open through", KERNEL_NEEDED.0, KERNEL_NEEDED.1);
    Check { name: "kernel", ok: pidfd && version(&release).is_some_and(|found| found >= KERNEL_NEEDED), found, fix }
}

fn version(release: &str) -> Option<(u32, u32)> {
    let mut parts = release.split(|c: char| !c.is_ascii_digit()).map(str::parse::<u32>);
    Some((parts.next()?.ok()?, parts.next()?.ok()?))
}

fn cpus() -> Check {
    let cpus = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    Check {
        name: "CPUs",
        ok: cpus >= CPUS_WANTED,
        found: format!("{cpus} for this process"),
        fix: format!("real time wants {CPUS_WANTED}; `--speed 1` runs on fewer without missing anything"),
    }
}

/// Nothing depends on it but how soon the robot stops where the machine is busy.
fn priority() -> Check {
    let found = if transport::may_hurry() {
        "real-time: locomotion and brake run before the rest"
    } else {
        "not real-time: where the machine is busy, locomotion and brake wait their turn (systemd: LimitRTPRIO=30)"
    };
    Check { name: "priority", ok: true, found: found.to_owned(), fix: String::new() }
}

/// Every stamp and every age is of the monotonic clock; a slow source makes each of them cost a system call and more.
fn clock() -> Check {
    let stamps: Vec<u64> = (0..CLOCK_READS).map(|_| monotonic_ns()).collect();
    let goes_on = stamps.windows(2).all(|pair| pair[0] <= pair[1]);
    let read_ns = (stamps[CLOCK_READS - 1] - stamps[0]) / (CLOCK_READS as u64 - 1);
    let source = std::fs::read_to_string(CLOCK_SOURCE).unwrap_or_else(|_| "unknown".to_owned());
    Check {
        name: "clock",
        ok: goes_on && read_ns < CLOCK_READ_NS,
        found: format!("monotonic, source {}, {read_ns} ns a look", source.trim()),
        fix: format!("another clock source, under {CLOCK_READ_NS} ns a look (kernel parameter clocksource=tsc)"),
    }
}

fn report(ok: bool, checks: &[Check], pools: &[Pool]) -> Value {
    let checks: Vec<Value> = checks
        .iter()
        .map(|check| {
            let fix = (!check.ok).then_some(&check.fix);
            json!({ "name": check.name, "ok": check.ok, "found": check.found, "fix": fix })
        })
        .collect();
    let rows: Vec<Value> = pools
        .iter()
        .map(|pool| {
            json!({
                "topic": pool.size.topic.name(), "messages": pool.size.messages,
                "message_bytes": pool.size.message_bytes, "publishers": pool.live,
                "bytes": pool.size.bytes() * pool.live,
            })
        })
        .collect();
    let (live, most) = (total(pools, |pool| pool.live), total(pools, |pool| pool.most));
    json!({ "ok": ok, "checks": checks, "pools": rows, "pool_bytes": live, "pool_bytes_max": most })
}

fn lines(checks: &[Check], pools: &[Pool], width: u32, height: u32) -> Vec<String> {
    let mut lines = Vec::new();
    for check in checks {
        lines.push(format!("{}  {:<14} {}", if check.ok { "ok     " } else { "MISSING" }, check.name, check.found));
        if !check.ok {
            lines.push(format!("         mend it: {}", check.fix));
        }
    }
    lines.push(format!("\nshared memory of a run with depth {width}x{height}:"));
    let row = |pool: &Pool| {
        let bytes = (pool.size.bytes() * pool.live) as u64;
        vec![
            pool.size.topic.name().to_owned(),
            format!("{} x {} B", pool.size.messages, pool.size.message_bytes),
            pool.live.to_string(),
            mib(bytes),
        ]
    };
    let rows: Vec<Vec<String>> = pools.iter().map(row).collect();
    lines.extend(table(&["topic", "messages", "publishers", "total"], &rows));
    let (live, most) = (total(pools, |pool| pool.live), total(pools, |pool| pool.most));
    lines.push(format!("in all {}; {} where every topic also has {DEAD_SLOTS} dead writers", mib(live), mib(most)));
    lines
}

#[cfg(test)]
mod tests {
    use super::{is_ours, pools, total, version};

    #[test]
    fn the_depth_pool_is_the_greatest() {
        let pools = pools(640 * 480);
        let depth = pools.iter().find(|pool| pool.size.topic == messages::TopicId::DepthFrame).expect("it has a row");
        assert!(depth.size.bytes() as u64 > total(&pools, |pool| pool.live) / 2);
        assert_eq!(depth.live, 1);
    }

    #[test]
    fn a_release_is_read_and_a_prefix_known() {
        assert_eq!(version("6.18.0-rc1+deb"), Some((6, 18)));
        assert_eq!(version("x"), None);
        assert!(is_ours("gd0123456789abcdef_12.data") && !is_ours("gd1_x") && !is_ours("pulse"));
    }
}
