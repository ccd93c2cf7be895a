//! One trial: a walking robot, a fault at a random moment, and what came of it.

use std::time::{Duration, Instant};

use control::{AskError, Request};
use messages::fault::{Device, Dice, Fault, Target};
use messages::{ModeClass, ServiceId, StopKind, TopicId};
use rustix::process::{Pid, Signal, kill_process};
use transport::monotonic_ns;

use super::rig::{LOOK, Rig};
use super::table::{Cell, Expect};
use super::tap::{Seen, Truth};
use crate::exit::{EXIT_REFUSED, Failure};

/// A fault comes at any moment of a decision, its scans and its poses: within this of the robot's walking, nanoseconds.
const PHASE_NS: u64 = 600_000_000;
/// A robot that has walked for so long suffers nothing more from the fault before.
const UNDISTURBED: Duration = Duration::from_millis(300);
/// A fault that is refused is tried again so many times.
const TRIES: u32 = 5;
/// A fault that lasts is mended after this, or once the robot stands: three decisions, and four beams of a slow lidar.
const SPAN: Duration = Duration::from_millis(2500);
/// What should stop the robot is waited for at most so long.
const PATIENCE: Duration = Duration::from_secs(6);
/// A robot that got zero stands within this.
const STANDS_WITHIN: Duration = Duration::from_secs(2);
/// And whatever became of it is recovered within this, or never.
const RECOVERS_WITHIN: Duration = Duration::from_secs(20);
/// One that is to stand on is watched for so long after the fault.
const STAYS_FOR: Duration = Duration::from_secs(3);

/// What came of a fault.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// The fault, on the monotonic clock, nanoseconds.
    pub struck_ns: u64,
    /// From the fault to zero at the link (of locomotion's own faults: at the robot), milliseconds.
    pub stop_ms: Option<f64>,
    /// Way from the fault to standstill, metres.
    pub standstill_m: Option<f64>,
    /// From the end of the process, or of the fault, until the robot is ready again, milliseconds.
    pub recovery_ms: Option<f64>,
    /// It walked again after the fault, where it was to stand on.
    pub went_on: bool,
    /// What it was told to stand for.
    pub reasons: Vec<StopKind>,
    /// What was not as the matrix wants it, if anything.
    pub unmet: Option<String>,
}

impl Outcome {
    /// When zero came, on the monotonic clock, nanoseconds.
    pub fn zero_ns(&self) -> Option<u64> {
        self.stop_ms.map(|ms| self.struck_ns + (ms * 1e6) as u64)
    }

    /// Whether the robot stood for its way alone: after the fault before it may stand aslant, and come near a wall.
    pub fn is_of_its_way(&self) -> bool {
        let of_its_way =
            |kind: &StopKind| matches!(kind, StopKind::PolicyStop | StopKind::AllUnsafe | StopKind::RemainderUnsafe);
        !self.reasons.is_empty() && self.reasons.iter().all(of_its_way)
    }
}

/// Does the cell's fault to a walking robot; limits count `slack` times.
///
/// # Errors
/// Where the robot cannot be made to walk, or the fault cannot be injected.
pub fn run(rig: &mut Rig, cell: &Cell, dice: &mut Dice, slack: f64) -> Result<Outcome, Failure> {
    let mut tries = TRIES;
    let (truth, epoch, struck_ns) = loop {
        if cell.needs_a_recorder() {
            rig.walk()?;
            rig.record()?;
        }
        let (truth, epoch) = walking(rig, dice)?;
        if cell.needs_a_recorder() && !rig.is_recording() {
            // The corridor was at its end, and another run began.
            continue;
        }
        match strike(rig, cell, dice) {
            Ok(struck_ns) => break (truth, epoch, struck_ns),
            // Who was to suffer it has just died of something else.
            Err(refused) if refused.code == EXIT_REFUSED && tries > 1 => tries -= 1,
            Err(failure) => return Err(failure),
        }
    };
    let mut outcome = Outcome { struck_ns, ..Outcome::default() };
    watch(rig, cell, struck_ns, truth.distance_m, &mut outcome);
    let ended_ns = if cell.is_momentary() { struck_ns } else { mend(rig, cell) };
    if cell.recovers() {
        outcome.recovery_ms = recover(rig, ended_ns, epoch, &outcome);
    } else if cell.stays {
        outcome.went_on = goes_on(rig);
    }
    let collided = rig.seen(|seen| seen.truth.is_some_and(|now| now.collisions > truth.collisions));
    outcome.reasons = rig.seen(|seen| seen.reasons.clone());
    let faulted = rig.seen(|seen| seen.modes.iter().any(|(_, mode)| mode.class != ModeClass::Run));
    outcome.unmet = judge(cell, &outcome, collided, faulted, slack);
    if let (Some(unmet), false) = (&mut outcome.unmet, cell.ends_the_run())
        && let Some(why) = rig.obituary()
    {
        *unmet = format!("{unmet}; the run has ended: {why}");
    }
    if cell.needs_a_recorder() {
        rig.end_recording();
    }
    if !cell.recovers() {
        rig.end();
    }
    Ok(outcome)
}

/// Waits until the robot walks undisturbed, and then for a random moment more: the world and the epoch then.
fn walking(rig: &mut Rig, dice: &mut Dice) -> Result<(Truth, u64), Failure> {
    loop {
        rig.walk()?;
        let epoch = || rig.seen(|seen| seen.mode.map(|mode| mode.epoch));
        let begun = epoch();
        std::thread::sleep(UNDISTURBED + Duration::from_nanos(dice.between((0, PHASE_NS))));
        let undisturbed = rig.seen(Seen::walks) && epoch() == begun;
        if let (true, Some(truth), Some(epoch)) = (undisturbed, rig.seen(|seen| seen.truth), begun) {
            rig.forget();
            return Ok((truth, epoch));
        }
    }
}

impl Cell {
    /// Whether nothing is to be mended: the supervisor does.
    fn is_momentary(&self) -> bool {
        let restarted = !matches!(self.target, Target::Service(ServiceId::Supervisor));
        let signal = matches!(self.fault, Fault::Kill | Fault::Hang | Fault::ExitOnStart);
        restarted && signal && matches!(self.target, Target::Service(_))
    }

    /// Whether no run is left after it: without a world, or without a supervisor.
    fn ends_the_run(&self) -> bool {
        match self.target {
            Target::Service(ServiceId::Supervisor) => self.fault == Fault::Kill,
            Target::Service(ServiceId::Simulator) => {
                matches!(self.fault, Fault::Kill | Fault::Hang | Fault::ExitOnStart)
            }
            _ => false,
        }
    }

    /// Whether the robot is ready again once the fault is over.
    fn recovers(&self) -> bool {
        !self.ends_the_run() && !self.stays
    }

    /// Whether the stop is the brake's, which no command at the link tells of.
    fn is_locomotions(&self) -> bool {
        self.target == Target::Service(ServiceId::Locomotion)
    }

    /// Whether it is of the recorder, which runs only where one is wanted.
    fn needs_a_recorder(&self) -> bool {
        self.target == Target::Service(ServiceId::Recorder) || self.fault == Fault::FullDisk
    }

    /// Whether the operator has to resume after it.
    fn locks(&self) -> bool {
        self.fault == Fault::RemoteStop || self.target == Target::Line(Device::Estop)
    }

    /// Whether it touches cues, which come only when somebody gives one.
    fn is_of_cues(&self) -> bool {
        matches!(self.target, Target::Stream(TopicId::Cue | TopicId::CueRequest, _))
    }
}

/// Does the fault: its instant on the monotonic clock.
fn strike(rig: &mut Rig, cell: &Cell, dice: &mut Dice) -> Result<u64, Failure> {
    let signal = match cell.fault {
        Fault::Kill => Some(Signal::KILL),
        Fault::Hang => Some(Signal::STOP),
        _ => None,
    };
    if let (Target::Service(service), Some(signal)) = (cell.target, signal) {
        let pid = match service {
            ServiceId::Supervisor => rig.supervisor_pid(),
            service => rig.seen(|seen| seen.pids.get(&service).copied()),
        };
        let pid = pid.and_then(|pid| i32::try_from(pid).ok()).and_then(Pid::from_raw);
        let pid = pid.ok_or_else(|| Failure::run(format!("{service} has not said which process it is")))?;
        let at_ns = monotonic_ns();
        kill_process(pid, signal).map_err(Failure::of_run)?;
        return Ok(at_ns);
    }
    let request = inject(cell, cell.fault.name(), Some(dice.bits() >> 1));
    let at_ns = monotonic_ns();
    rig.tell(&request).map_err(|error| match error {
        AskError::Refused(why) => Failure::refused(format!("{}:{}: {why}", cell.target, cell.fault.name())),
        AskError::Unanswered(_) => Failure::run("the supervisor does not answer"),
        AskError::Unreadable { .. } => Failure::of_run(error),
    })?;
    if cell.is_of_cues() {
        rig.cue();
    }
    Ok(at_ns)
}

fn inject(cell: &Cell, fault: &str, seed: Option<u64>) -> Request {
    Request::Inject { target: cell.target.to_string(), fault: fault.to_owned(), for_ms: None, seed }
}

/// Watches until the robot stands, or nothing more is to be expected.
fn watch(rig: &mut Rig, cell: &Cell, struck_ns: u64, from_m: f64, outcome: &mut Outcome) {
    let since = Instant::now();
    let patience = if cell.expect == Expect::Stop { PATIENCE } else { SPAN };
    let mut zero_ns = None;
    while since.elapsed() < patience && zero_ns.is_none() {
        std::thread::sleep(LOOK);
        zero_ns = rig.seen(|seen| {
            let command = seen.commands.iter().find(|c| c.zero && c.at_ns >= struck_ns).map(|c| c.at_ns);
            let robot = seen.truths.iter().filter_map(|t| t.zero_since_ns).find(|at_ns| *at_ns >= struck_ns);
            // A locomotion that is gone commands nothing; a new one's first word comes long after the brake's.
            if cell.is_locomotions() { robot } else { command }
        });
        if !rig.is_alive() && zero_ns.is_none() && since.elapsed() > STANDS_WITHIN {
            break;
        }
    }
    let Some(zero_ns) = zero_ns else { return };
    outcome.stop_ms = Some((zero_ns - struck_ns) as f64 / 1e6);
    let since = Instant::now();
    while since.elapsed() < STANDS_WITHIN && outcome.standstill_m.is_none() {
        outcome.standstill_m = rig.seen(|seen| {
            let stands = seen.truths.iter().find(|truth| truth.stands && truth.at_ns >= struck_ns);
            stands.map(|truth| truth.distance_m - from_m)
        });
        std::thread::sleep(LOOK);
    }
}

/// Ends the fault: when.
fn mend(rig: &mut Rig, cell: &Cell) -> u64 {
    if let (Target::Service(ServiceId::Supervisor), Fault::Hang, Some(pid)) =
        (cell.target, cell.fault, rig.supervisor_pid())
        && let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw)
    {
        // It may be gone, which is seen at the next trial.
        let _ = kill_process(pid, Signal::CONT);
    } else {
        // A service that is being restarted has lost its fault already.
        let _ = rig.tell(&inject(cell, "none", None));
    }
    if cell.locks() {
        // Whoever pressed it lets go of it first.
        std::thread::sleep(UNDISTURBED);
        // Whether it is out of the lock is seen by its mode.
        let _ = rig.tell(&Request::Resume {});
    }
    if cell.is_of_cues() {
        // The handler says again what was lost or misheard.
        rig.cue();
    }
    monotonic_ns()
}

/// Whether the robot walks within a while after a fault.
fn goes_on(rig: &mut Rig) -> bool {
    let since = Instant::now();
    let mut walks = false;
    while since.elapsed() < STAYS_FOR && rig.is_alive() && !walks {
        std::thread::sleep(LOOK);
        walks = rig.seen(Seen::walks);
    }
    walks
}

/// Waits until the robot is ready for a cue, or walks on: how long that took since the fault's end.
fn recover(rig: &mut Rig, ended_ns: u64, epoch: u64, outcome: &Outcome) -> Option<f64> {
    let since = Instant::now();
    while since.elapsed() < RECOVERS_WITHIN && rig.is_alive() {
        let ready_ns = rig.seen(|seen| {
            let walks = seen.walks().then(|| seen.command.map(|command| command.at_ns)).flatten();
            // Of a process that died, news is what comes with the next epoch.
            let ready = seen.modes.iter().find(|(at_ns, mode)| {
                let waits = mode.class == ModeClass::Fault && mode.epoch != epoch && mode.ready_for_cue;
                // A cue that was taken for a stop ends the walk as a stop does.
                *at_ns >= ended_ns && (waits || mode.class == ModeClass::Run && !mode.cue.valid)
            });
            let went_on = outcome.stop_ms.is_none() || seen.modes.last().is_some_and(|(_, mode)| mode.epoch == epoch);
            ready.map(|(at_ns, _)| *at_ns).or(walks.filter(|at_ns| went_on && *at_ns >= ended_ns))
        });
        if let Some(ready_ns) = ready_ns {
            return Some((ready_ns - ended_ns) as f64 / 1e6);
        }
        std::thread::sleep(LOOK);
    }
    None
}

/// What is not as the matrix wants it.
fn judge(cell: &Cell, outcome: &Outcome, collided: bool, faulted: bool, slack: f64) -> Option<String> {
    let limit_ms = cell.limit_ms * slack;
    if collided {
        return Some("something was run into".to_owned());
    }
    if cell.recovers() && outcome.recovery_ms.is_none() {
        return Some(format!("not ready again within {} s", RECOVERS_WITHIN.as_secs()));
    }
    if outcome.went_on {
        return Some("the robot walks again, though the matrix says that it stays".to_owned());
    }
    match cell.expect {
        Expect::Stop => match outcome.stop_ms {
            None => Some("no zero came".to_owned()),
            Some(ms) if ms > limit_ms => Some(format!("zero came after {ms:.1} ms, limit {limit_ms:.0} ms")),
            Some(_) if outcome.standstill_m.is_none() && cell.target != Target::Service(ServiceId::Simulator) => {
                Some("the robot did not stand".to_owned())
            }
            Some(_) => None,
        },
        Expect::Degrade => outcome
            .recovery_ms
            .filter(|ms| *ms > limit_ms)
            .map(|ms| format!("ready again after {ms:.0} ms, limit {limit_ms:.0} ms")),
        Expect::None if outcome.stop_ms.is_some() || faulted => {
            Some(format!("the robot stood: {:?}", outcome.reasons.iter().map(|r| r.name()).collect::<Vec<_>>()))
        }
        Expect::None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{Outcome, judge};
    use crate::bench::faults::table::cells;

    #[test]
    fn a_cell_is_met_only_by_what_it_wants() {
        let cell = |pattern: &str| cells(Some(pattern)).expect("it is there").remove(0);
        let stop = cell("lidar:kill");
        let stopped =
            Outcome { stop_ms: Some(1.0), standstill_m: Some(0.01), recovery_ms: Some(200.0), ..Outcome::default() };
        assert_eq!(judge(&stop, &stopped, false, true, 1.0), None);
        let late = Outcome { stop_ms: Some(stop.limit_ms * 1.5), ..stopped.clone() };
        assert!(judge(&stop, &late, false, true, 1.0).is_some());
        assert_eq!(judge(&stop, &late, false, true, 2.0), None);
        assert!(judge(&stop, &stopped, true, true, 1.0).is_some(), "a collision is never met");
        assert!(judge(&stop, &Outcome { stop_ms: None, ..stopped.clone() }, false, true, 1.0).is_some());
        assert!(judge(&stop, &Outcome { standstill_m: None, ..stopped.clone() }, false, true, 1.0).is_some());
        assert!(judge(&stop, &Outcome { recovery_ms: None, ..stopped.clone() }, false, true, 1.0).is_some());
        let stays = cell("depth/frame:wrong");
        let stood = Outcome { recovery_ms: None, ..stopped.clone() };
        assert_eq!(judge(&stays, &stood, false, true, 1.0), None);
        assert!(judge(&stays, &Outcome { went_on: true, ..stood }, false, true, 1.0).is_some());
        let none = cell("locomotion/state:wrong");
        let walked = Outcome { recovery_ms: Some(0.0), ..Outcome::default() };
        assert_eq!(judge(&none, &walked, false, false, 1.0), None);
        assert!(judge(&none, &walked, false, true, 1.0).is_some());
        assert!(judge(&none, &stopped, false, false, 1.0).is_some());
    }
}
