//! Injected faults, for testing: what an operator may break in a run that was started for it, and what mends by itself.
//!
//! A fault of a stream stands for the device or the wire: it outlives the process that publishes there. A fault of a
//! process ends with that life of it.

use std::fs::File;

use messages::{Fault, Injection, ServiceId, Target};
use rustix::fs::FallocateFlags;
use rustix::process::Signal;
use transport::{Io, SHM, ToChild, monotonic_ns};

use crate::Supervisor;

/// What a full `/dev/shm` may cost the machine: its pages are memory, and filling them is the supervisor's time.
const FILL_MAX_BYTES: u64 = 128 << 20;

/// The faults of a run.
#[derive(Debug, Default)]
pub struct Faults {
    allowed: bool,
    /// Those that last.
    lasting: Vec<Injection>,
}

impl Faults {
    /// No faults yet; whether there may be any is the run's.
    #[must_use]
    pub fn new(allowed: bool) -> Self {
        Self { allowed, lasting: Vec::new() }
    }

    fn keep(&mut self, injection: Injection) {
        self.lasting.retain(|old| old.target != injection.target);
        if injection.fault.is_some() {
            self.lasting.push(injection);
        }
    }

    /// What a new life of a publisher has to suffer: the faults of its streams, which know their end.
    fn inherited(&self, service: ServiceId, now_ns: u64) -> Vec<Injection> {
        let of_it = |injection: &&Injection| {
            let stream = matches!(injection.target, Target::Stream(..));
            stream && now_ns < injection.until_ns() && injection.target.publishers().contains(&service)
        };
        self.lasting.iter().filter(of_it).copied().collect()
    }
}

impl Supervisor {
    /// Injects a fault, or mends it: when, on the monotonic clock, nanoseconds.
    ///
    /// # Errors
    /// Says why, where it may not be or would do nothing.
    pub(crate) fn inject(
        &mut self,
        target: &str,
        fault: &str,
        for_ms: Option<u64>,
        seed: u64,
        io: &Io,
    ) -> Result<u64, String> {
        if !self.faults.allowed {
            return Err("this run allows none; start it with --faults".to_owned());
        }
        let (target, kind) = messages::fault::parse(target, fault)?;
        if for_ms.is_some() && kind == Some(Fault::Hang) && target == Target::Service(ServiceId::Supervisor) {
            return Err("a supervisor that hangs cannot end its own fault; send it SIGCONT".to_owned());
        }
        let for_ns = for_ms.map(|ms| ms.saturating_mul(1_000_000));
        let injection = Injection { target, fault: kind, seed, since_ns: io.now_ns(), for_ns };
        let at_ns = monotonic_ns();
        let done = match target {
            Target::Stream(..) => self.inject_stream(&injection, io),
            Target::Service(service) => self.inject_service(service, &injection, io),
            Target::Line(_) => self.inject_line(&injection),
            Target::Host => self.inject_host(&injection, io),
        };
        // Whoever is down now is mended by that: the next life inherits nothing.
        if let Err(why) = done
            && kind.is_some()
        {
            return Err(why);
        }
        self.faults.keep(injection);
        self.figures.note(io.now_ns(), format!("fault injected: {target} {fault}"));
        Ok(at_ns)
    }

    fn inject_stream(&mut self, injection: &Injection, io: &Io) -> Result<(), String> {
        let mut told = false;
        for service in injection.target.publishers() {
            if *service == ServiceId::Supervisor {
                told |= io.inject(injection);
            } else if self.machine.is_ready(*service) {
                // A candidate publishes there as well.
                self.children.tell_all(*service, &ToChild::Inject { injection: *injection });
                told = true;
            }
        }
        if told { Ok(()) } else { Err(format!("nobody publishes {} now", injection.target)) }
    }

    fn inject_service(&mut self, service: ServiceId, injection: &Injection, io: &Io) -> Result<(), String> {
        if service == ServiceId::Supervisor {
            let signal = match injection.fault {
                Some(Fault::Kill) => Signal::KILL,
                Some(Fault::Hang) => Signal::STOP,
                Some(Fault::ExitOnStart) => return Err("the supervisor starts only once".to_owned()),
                _ => return if io.inject(injection) { Ok(()) } else { Err("this run allows none".to_owned()) },
            };
            return rustix::process::kill_process(rustix::process::getpid(), signal).map_err(|e| e.to_string());
        }
        if injection.fault.is_none() {
            self.children.doom(service, 0);
        }
        if !self.machine.is_ready(service) {
            return Err(format!("{service} is not up in this run"));
        }
        let Some(life) = self.victim(service) else { return Err(format!("{service} is not up in this run")) };
        match injection.fault {
            Some(Fault::Kill) => self.children.signal(service, life, Signal::KILL),
            Some(Fault::Hang) => self.children.signal(service, life, Signal::STOP),
            Some(Fault::ExitOnStart) => {
                self.children.doom(service, messages::fault::EXITS_ON_START);
                self.children.signal(service, life, Signal::KILL);
            }
            fault => {
                if fault.is_none() {
                    self.children.signal(service, life, Signal::CONT);
                }
                self.children.tell_life(service, life, &ToChild::Inject { injection: *injection });
            }
        }
        Ok(())
    }

    /// The life of a service that a fault of its process is meant for: of two policies the one in force.
    pub(crate) fn victim(&self, service: ServiceId) -> Option<u32> {
        let lives = || self.children.running().iter().filter(|c| c.service == service).map(|c| c.incarnation);
        let active = self.machine.mode().active_policy;
        let in_force = service == ServiceId::Policy && lives().any(|life| life == active);
        if in_force { Some(active) } else { lives().max() }
    }

    fn inject_line(&mut self, injection: &Injection) -> Result<(), String> {
        if !self.machine.is_ready(ServiceId::Emulator) {
            return Err("no device is emulated in this run; start it with --emulated".to_owned());
        }
        self.children.tell(ServiceId::Emulator, &ToChild::Inject { injection: *injection });
        Ok(())
    }

    fn inject_host(&mut self, injection: &Injection, io: &Io) -> Result<(), String> {
        if matches!(injection.fault, Some(Fault::FullDisk)) {
            if !self.machine.is_ready(ServiceId::Recorder) {
                return Err("nothing is recorded in this run".to_owned());
            }
            self.children.tell(ServiceId::Recorder, &ToChild::Inject { injection: *injection });
            return Ok(());
        }
        if injection.fault.is_none() {
            self.children.tell(ServiceId::Recorder, &ToChild::Inject { injection: *injection });
            return empty_shm(&io.domain.dir.prefix());
        }
        fill_shm(&io.domain.dir.prefix())
    }

    /// Tells a child that has just been started what it inherits.
    pub(crate) fn pass_faults_on(&self, service: ServiceId, io: &Io) {
        for injection in self.faults.inherited(service, io.now_ns()) {
            self.children.tell(service, &ToChild::Inject { injection });
        }
    }

    /// Ends what has lasted long enough and does not end by itself.
    pub(crate) fn end_faults(&mut self, io: &Io) {
        let now_ns = io.now_ns();
        let over = self.faults.lasting.iter().filter(|injection| now_ns >= injection.until_ns());
        let over: Vec<Injection> = over.map(|injection| Injection { fault: None, ..*injection }).collect();
        for mended in over {
            // A service that is down has lost its fault with its life.
            let _ = match mended.target {
                // It knows its end.
                Target::Stream(..) | Target::Line(_) => Ok(()),
                Target::Service(service) => self.inject_service(service, &mended, io),
                Target::Host => self.inject_host(&mended, io),
            };
            self.faults.keep(mended);
        }
    }
}

/// Takes all that is left of `/dev/shm` in one file, under the run's prefix, so that whoever cleans up after the run
/// gives it back.
fn fill_shm(prefix: &str) -> Result<(), String> {
    let (_, bytes) = transport::shared_memory_bytes().map_err(|error| error.to_string())?;
    if bytes > FILL_MAX_BYTES {
        return Err(format!(
            "{SHM} has {} MiB left, and filling it would take as much of the machine's memory; start the run where it \
             is under {} MiB: unshare --mount, then mount -t tmpfs -o size=64m tmpfs {SHM}",
            bytes >> 20,
            FILL_MAX_BYTES >> 20
        ));
    }
    let path = fill_path(prefix);
    let file = File::create(&path).map_err(|error| format!("{path}: {error}"))?;
    let mut taken = 0;
    // In ever smaller pieces: others take and give back meanwhile.
    for piece in [1 << 20, 64 << 10, 4 << 10] {
        while taken < 2 * FILL_MAX_BYTES {
            match rustix::fs::fallocate(&file, FallocateFlags::empty(), taken, piece) {
                Ok(()) => taken += piece,
                Err(rustix::io::Errno::NOSPC) => break,
                Err(errno) => return Err(format!("{path}: {errno}")),
            }
        }
    }
    Ok(())
}

fn empty_shm(prefix: &str) -> Result<(), String> {
    match std::fs::remove_file(fill_path(prefix)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.to_string()),
        _ => Ok(()),
    }
}

fn fill_path(prefix: &str) -> String {
    format!("{SHM}/{prefix}fill")
}

#[cfg(test)]
mod tests {
    use super::Faults;
    use messages::{Fault, Injection, ServiceId, Target, TopicId};

    #[test]
    fn a_streams_fault_outlives_its_publisher_and_a_process_takes_its_own_along() {
        let mut faults = Faults::new(true);
        let scan = Target::Stream(TopicId::LidarScan, ServiceId::None);
        let off = Injection { target: scan, fault: Some(Fault::Off), seed: 1, since_ns: 500, for_ns: Some(1000) };
        faults.keep(off);
        faults.keep(Injection { target: Target::Service(ServiceId::Lidar), fault: Some(Fault::Leak), ..off });
        assert_eq!(faults.inherited(ServiceId::Lidar, 1200), [off]);
        assert_eq!(faults.inherited(ServiceId::Depth, 1200), []);
        assert_eq!(faults.inherited(ServiceId::Lidar, 1500), []);
        faults.keep(Injection { fault: None, ..off });
        assert_eq!(faults.inherited(ServiceId::Lidar, 1300), []);
    }
}
