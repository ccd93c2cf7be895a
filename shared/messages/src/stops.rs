//! The stops that an operator may read of: each with its class, whose doing it is, and what to do about it.

use crate::StopKind;

/// What is to be known of a kind of stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopInfo {
    /// Which.
    pub kind: StopKind,
    /// "hold" ends by itself, "fault" by an accepted cue, "lock" by `resume` and then a cue.
    pub class: &'static str,
    /// What happened.
    pub meaning: &'static str,
    /// What to do about it.
    pub advice: &'static str,
}

const fn row(kind: StopKind, class: &'static str, meaning: &'static str, advice: &'static str) -> StopInfo {
    StopInfo { kind, class, meaning, advice }
}

const CUE: &str = "give a cue once the robot is ready";
const LOG: &str = "its log in the run directory says why; it is restarted: give a cue once the robot is ready";

/// Every kind of stop.
pub const STOPS: [StopInfo; 36] = [
    row(StopKind::Boot, "fault", "the run has just begun", CUE),
    row(StopKind::ServiceDied, "fault", "a process that motion needs is dead", LOG),
    row(StopKind::ServiceHung, "fault", "a process takes input and gives nothing back, or no longer takes part", LOG),
    row(StopKind::BeatsMissed, "fault", "a process fell silent: stopped, stuck, or starved of the CPU", LOG),
    row(StopKind::MemoryExhausted, "fault", "a process has more memory of its own than it may: it leaks", LOG),
    row(StopKind::FilesExhausted, "fault", "a process has more descriptors open than it may: it leaks them", LOG),
    row(StopKind::StreamSlow, "fault", "a stream comes too seldom, though its process has all its input", LOG),
    row(
        StopKind::StreamStale,
        "fault",
        "a stream is over twice its max age",
        "look at its driver or device; then a cue",
    ),
    row(
        StopKind::SupervisorStalled,
        "fault",
        "the supervisor itself did not run for too long",
        "free the CPU; then a cue",
    ),
    row(StopKind::BrakeEngaged, "fault", "locomotion was gone or silent, and the brake stopped the robot", LOG),
    row(
        StopKind::PoseJump,
        "fault",
        "the odometry pose jumped further than the robot can walk",
        "look at odometry; then a cue",
    ),
    row(StopKind::Resumed, "fault", "the operator ended a lock", CUE),
    row(StopKind::OperatorStop, "lock", "the operator's stop", "guidedog resume, then a cue"),
    row(StopKind::RestartBudgetSpent, "lock", "a service died too often", "mend it, guidedog resume, then a cue"),
    row(StopKind::ShuttingDown, "lock", "the run is ending", "none"),
    row(StopKind::NoCue, "hold", "no cue is in force", "give a cue"),
    row(StopKind::StopCue, "hold", "the handler's stop cue", "give a cue"),
    row(StopKind::PolicyStop, "hold", "the policy chose to stand: the way has ended, or there is none", "another cue"),
    row(StopKind::NoPermit, "hold", "the shield has given no permit for this run, cue and policy yet", "wait"),
    row(
        StopKind::PermitExpired,
        "hold",
        "no permit came in time",
        "ages and loads of shield and sensors: guidedog status",
    ),
    row(
        StopKind::PermitInvalid,
        "hold",
        "a permit that no shield of ours would give",
        "report it: a process does not do as it should",
    ),
    row(
        StopKind::AllUnsafe,
        "hold",
        "every action would hit something",
        "make way, or take robot and handler out by hand",
    ),
    row(StopKind::RemainderUnsafe, "hold", "something came into the way of the running action", "wait"),
    row(StopKind::HandlerNotSeen, "hold", "nobody is where the handler should be", "take the handle again"),
    row(
        StopKind::InputUnusable,
        "hold",
        "a stream cannot be judged on: too old, or no measurement",
        "look at its driver or device",
    ),
    row(StopKind::OdometryStale, "hold", "odometry is over its max age at locomotion", "look at its driver or device"),
    row(StopKind::ModeStale, "hold", "nothing was heard of the supervisor for too long", "free the CPU; then a cue"),
    row(StopKind::LifelineClosed, "hold", "a process that motion needs has just died", CUE),
    row(StopKind::SupervisorLost, "fault", "the supervisor is gone, and the run ends", "start another run"),
    row(StopKind::StreamStuck, "hold", "a sensor sends the same again while the robot moves", "look at its device"),
    row(
        StopKind::ScanContradicts,
        "hold",
        "a scan contradicts the last one wholesale",
        "look at the lidar; where the robot was carried elsewhere, start another run",
    ),
    row(
        StopKind::OdometryContradicts,
        "hold",
        "odometry contradicts what the robot was commanded",
        "look which is wrong: odometry, or a robot that is blocked or slips; then a cue",
    ),
    row(
        StopKind::RemoteStop,
        "lock",
        "somebody stopped the robot by its hand remote",
        "make it stand by the remote and let go of it; guidedog resume, then a cue",
    ),
    row(
        StopKind::BatteryLow,
        "fault",
        "the robot's battery is nearly empty: it may lie down where it is",
        "charge it; where it has to go on, lower locomotion.charge_stop_percent",
    ),
    row(
        StopKind::EmergencyStop,
        "lock",
        "the emergency stop was pressed, unplugged, or fell silent",
        "look why; release it, or plug it in; guidedog resume, then a cue",
    ),
    row(StopKind::Arrived, "lock", "the walk has come to its goal, and the run is ending", "none"),
];

#[cfg(test)]
mod tests {
    use super::STOPS;
    use crate::StopKind;

    #[test]
    fn every_kind_of_stop_has_one_row_in_the_order_of_its_number() {
        for (i, info) in STOPS.iter().enumerate() {
            assert_eq!(info.kind as usize, i + 1, "{}", info.kind.name());
            assert!(["hold", "fault", "lock"].contains(&info.class) && !info.advice.is_empty());
        }
        assert_eq!(STOPS.last().map(|info| info.kind), Some(StopKind::Arrived), "the last kind there is");
    }
}
