//! The services: one row for each, from which the type, its name, and what every process is held to follow.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

use crate::json::named;

/// How early a service gets the processor. `transport` has the priorities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Priority {
    /// As any other process.
    Ordinary,
    /// Real time: what lets the robot move, or tells it to stop.
    Gate,
    /// Real time, before the gate: what stops the robot when the gate is gone.
    Brake,
    /// Real time, before both: the simulated robot, a machine of its own, which waits for no process of this one.
    Robot,
}

/// What the kernel sends a service when the supervisor dies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeathSignal {
    /// SIGKILL: it dies at once.
    Kill,
    /// SIGHUP: it stops the robot, and then ends. The signal comes before that of all services which die at once, whose
    /// ends keep the processor busy for long.
    HangUp,
    /// Nothing. It reads of the death from its line, and ends by itself.
    Nothing,
}

/// How much memory of its own a service may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryClass {
    /// `supervision.memory_mib`: the kernel frees a dying process's memory before it closes its lifeline.
    Small,
    /// `supervision.large_memory_mib`: it holds frames or networks.
    Large,
    /// No limit.
    Any,
}

/// What a service has to do with stepped time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockRole {
    /// It gives out the steps, or takes part like a member where another service does.
    Master,
    /// It acknowledges each step.
    Member,
    /// It takes no part: it is in no stepped run, or looks on.
    Outside,
}

/// A row of the table: what holds for a service in every run. The supervisor's plan adds what a configuration changes.
#[derive(Debug, Clone, Copy)]
pub struct ServiceSpec {
    /// Which.
    pub id: ServiceId,
    /// The name, as in topic names, configuration keys and reports; `guidedog-<name>` is the executable.
    pub name: &'static str,
    /// It starts when everything of lower stages is ready.
    pub stage: u8,
    /// Whether motion needs it: its death is a fault.
    pub critical: bool,
    /// Whether it is restarted. The end of what is not restarted ends the run.
    pub restartable: bool,
    /// Whether it runs only while an operator wants it.
    pub on_demand: bool,
    /// Whether the run begins only once it is up.
    pub waited_for: bool,
    /// The service that stops the robot when this one's lifeline closes.
    pub watched_by: Option<ServiceId>,
    /// Whether it is what stops the robot: it outlives the supervisor by as much as the stop takes.
    pub stops_robot: bool,
    /// How early it gets the processor.
    pub priority: Priority,
    /// What the kernel sends it when the supervisor dies.
    pub at_supervisor_death: DeathSignal,
    /// From one beat to the next, milliseconds.
    pub beat_period_ms: u32,
    /// Its last beat may be this old, milliseconds; without a limit of its own, `supervision.beat_limit`.
    pub beat_limit_ms: Option<u32>,
    /// How much memory of its own it may have.
    pub memory: MemoryClass,
    /// What it has to do with stepped time.
    pub clock: ClockRole,
}

/// Beats that motion depends on: 50 Hz.
const BEAT_FAST_MS: u32 = 20;
/// Beats of the others: 10 Hz.
const BEAT_SLOW_MS: u32 = 100;
/// What stands for the world is not restarted, so it is judged late.
const WORLD_BEAT_LIMIT_MS: u32 = 1_000;
/// A voice that is silent for so long will say nothing any more; it beats at 10 Hz.
const SPEAK_BEAT_LIMIT_MS: u32 = 2_000;
/// The recorder beats at 10 Hz, and a disk may take its time.
const RECORDER_BEAT_LIMIT_MS: u32 = 5_000;

/// Declares the services in the order of their start. The number is the one in shared memory: it never changes.
macro_rules! services {
    ($($(#[doc = $doc:literal])+ $id:ident = $number:literal { $($field:ident: $value:expr),+ $(,)? })+) => {
        /// A service: one process, one executable.
        #[derive(
            Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, TryFromBytes,
        )]
        #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
        #[cfg_attr(feature = "ipc", type_name("guidedog/ServiceId/1"))]
        #[repr(C)]
        #[serde(rename_all = "snake_case")]
        pub enum ServiceId {
            /// No service: where a message has none to name.
            #[default]
            None = 0,
            $($(#[doc = $doc])+ $id = $number,)+
        }

        named!(ServiceId);

        impl ServiceId {
            /// Every service, in the order of start: what stops the robot comes first.
            pub const ALL: [Self; SERVICES.len()] = [$(Self::$id),+];
        }

        /// The table, in the order of start.
        pub const SERVICES: &[ServiceSpec] = &[$(ServiceSpec { id: ServiceId::$id, $($field: $value),+ }),+];
    };
}

services! {
    /// Starts, watches, restarts, stops.
    Supervisor = 1 {
        name: "supervisor",
        stage: 0,
        critical: true,
        restartable: false,
        on_demand: false,
        waited_for: true,
        watched_by: None,
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Nothing,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Any,
        clock: ClockRole::Member,
    }
    /// Permit to robot: the last gate.
    Locomotion = 8 {
        name: "locomotion",
        stage: 0,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Brake),
        stops_robot: true,
        priority: Priority::Gate,
        at_supervisor_death: DeathSignal::HangUp,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Stops the robot when locomotion is gone.
    Brake = 9 {
        name: "brake",
        stage: 0,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: true,
        priority: Priority::Brake,
        at_supervisor_death: DeathSignal::HangUp,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Locomotion's voice on a robot's DDS network.
    Bridge = 15 {
        name: "bridge",
        stage: 0,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: true,
        priority: Priority::Gate,
        at_supervisor_death: DeathSignal::HangUp,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Outside,
    }
    /// The brake's voice there, and the one that speaks where the bridge is gone.
    Backstop = 16 {
        name: "backstop",
        stage: 0,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: true,
        priority: Priority::Brake,
        at_supervisor_death: DeathSignal::HangUp,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Outside,
    }
    /// The physical world in place of the real one.
    Simulator = 10 {
        name: "simulator",
        stage: 1,
        critical: false,
        restartable: false,
        on_demand: false,
        waited_for: true,
        watched_by: None,
        stops_robot: false,
        priority: Priority::Robot,
        at_supervisor_death: DeathSignal::Nothing,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: Some(WORLD_BEAT_LIMIT_MS),
        memory: MemoryClass::Any,
        clock: ClockRole::Master,
    }
    /// Emulated devices in the simulated world, for the real drivers and the real link.
    Emulator = 13 {
        name: "emulator",
        stage: 1,
        critical: false,
        restartable: false,
        on_demand: false,
        waited_for: true,
        watched_by: None,
        stops_robot: false,
        priority: Priority::Robot,
        at_supervisor_death: DeathSignal::Nothing,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: Some(WORLD_BEAT_LIMIT_MS),
        memory: MemoryClass::Any,
        clock: ClockRole::Outside,
    }
    /// Recorded frames in, in the drivers' place.
    Replay = 12 {
        name: "replay",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Master,
    }
    /// The emergency stop input. A press does not wait for a busy machine.
    Estop = 14 {
        name: "estop",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Gate,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Outside,
    }
    /// Odometry driver.
    Odometry = 4 {
        name: "odometry",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Lidar driver.
    Lidar = 2 {
        name: "lidar",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Driver of the second lidar.
    SecondLidar = 18 {
        name: "second_lidar",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Depth camera driver.
    Depth = 3 {
        name: "depth",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Large,
        clock: ClockRole::Member,
    }
    /// Cue recogniser.
    Cue = 5 {
        name: "cue",
        stage: 2,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Observation to action.
    Policy = 6 {
        name: "policy",
        stage: 3,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Large,
        clock: ClockRole::Member,
    }
    /// Action to permit.
    Shield = 7 {
        name: "shield",
        stage: 3,
        critical: true,
        restartable: true,
        on_demand: false,
        waited_for: true,
        watched_by: Some(ServiceId::Locomotion),
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_FAST_MS,
        beat_limit_ms: None,
        memory: MemoryClass::Small,
        clock: ClockRole::Member,
    }
    /// Tells the handler aloud what the robot does, and why it stands. It starts beside what stops the robot, comes
    /// back whatever else is down, and has a last word after the supervisor's death.
    Speak = 17 {
        name: "speak",
        stage: 0,
        critical: false,
        restartable: true,
        on_demand: false,
        waited_for: false,
        watched_by: None,
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Nothing,
        beat_period_ms: BEAT_SLOW_MS,
        beat_limit_ms: Some(SPEAK_BEAT_LIMIT_MS),
        memory: MemoryClass::Large,
        clock: ClockRole::Outside,
    }
    /// Records the run. It starts last: what it records from the beginning waits for it.
    Recorder = 11 {
        name: "recorder",
        stage: 4,
        critical: false,
        restartable: true,
        on_demand: true,
        waited_for: true,
        watched_by: None,
        stops_robot: false,
        priority: Priority::Ordinary,
        at_supervisor_death: DeathSignal::Kill,
        beat_period_ms: BEAT_SLOW_MS,
        beat_limit_ms: Some(RECORDER_BEAT_LIMIT_MS),
        memory: MemoryClass::Any,
        clock: ClockRole::Member,
    }
}

impl ServiceId {
    /// Its row; `None` for [`ServiceId::None`].
    #[must_use]
    pub fn spec(self) -> Option<&'static ServiceSpec> {
        SERVICES.iter().find(|spec| spec.id == self)
    }

    /// The name, as in topic names, configuration keys and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.spec().map_or("none", |spec| spec.name)
    }

    /// Whether the service is what stops the robot: it outlives the supervisor by as much as the stop takes, and hears
    /// of its end by SIGHUP.
    #[must_use]
    pub fn stops_robot(self) -> bool {
        self.spec().is_some_and(|spec| spec.stops_robot)
    }

    /// The service as a list of one, as the topic table has its publishers; no service for [`ServiceId::None`].
    #[must_use]
    pub fn alone(self) -> &'static [Self] {
        Self::ALL.iter().position(|service| *service == self).map_or(&[], |i| &Self::ALL[i..=i])
    }

    /// The service of that name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|service| service.name() == name)
    }
}

impl core::fmt::Display for ServiceId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::{BEAT_FAST_MS, DeathSignal, SERVICES, ServiceId};

    #[test]
    fn every_service_has_a_number_and_a_name_of_its_own() {
        for spec in SERVICES {
            assert!((1..=SERVICES.len()).contains(&(spec.id as usize)), "{}: numbers leave no gap", spec.name);
            assert_eq!(ServiceId::from_name(spec.name), Some(spec.id), "{}", spec.name);
            let json = serde_json::to_value(spec.id).expect("a name");
            assert_eq!(json, spec.name, "reports and topics use one name");
        }
        assert_eq!((ServiceId::None.spec().is_none(), ServiceId::None.name()), (true, "none"));
    }

    #[test]
    fn motion_depends_on_watched_services_alone() {
        for spec in SERVICES.iter().filter(|spec| spec.id != ServiceId::Supervisor) {
            assert_eq!(spec.critical, spec.watched_by.is_some(), "{}", spec.name);
            assert_eq!(spec.stops_robot, spec.at_supervisor_death == DeathSignal::HangUp, "{}", spec.name);
            // `supervision.beat_limit` is three fast beats.
            let limit_ms = spec.beat_limit_ms.unwrap_or(3 * BEAT_FAST_MS);
            assert!(limit_ms >= 3 * spec.beat_period_ms, "{} beats slower than it is judged", spec.name);
        }
    }
}
