//! The physical world in place of the real one: robot, handler, walls and people, in ticks of 10 ms.
//!
//! It stands for the world, so nothing restarts it: its end ends the run. In stepped time it is the clock's master.
//! Its robot keeps the last command when the line goes quiet, as a real one may.

use std::os::unix::net::UnixDatagram;
use std::sync::Arc;

use control::{Collisions, Falls, RunFigures, SimulatorFigures};
use links::{BRAKE_MESSAGE_LEN, BrakeMessage};
use messages::{Formation, Mode, QUANTUM_NS, RobotCommand, Twist2, WorldTruth, ns_from_s};
use serde_json::json;
use settings::Settings;
use transport::{FromChild, Io, Publisher, Service, Subscriber, TransportError, monotonic_ns};
use world::{Goal, Physics, PhysicsConfig, Scenario, World};

/// Without a supervisor, the world ends after this long: after locomotion and brake have stopped the robot.
const LOST_LIMIT_NS: u64 = 700_000_000;
/// In real time, a world that fell behind by more than this does not catch up: it says so and goes on from now.
const BEHIND_LIMIT_TICKS: u64 = 50;
const TOKEN_BRAKE: u64 = 1;

/// Robot, handler and people in motion.
pub trait Motion {
    /// Lets a quantum pass under a commanded velocity (robot frame).
    ///
    /// # Errors
    /// Where the world cannot go on.
    fn step(&mut self, command: Twist2) -> Result<(), TransportError>;

    /// The handler is to walk there.
    fn form(&mut self, formation: Formation);

    /// The truth; header, the command in force and the stamp of a known attitude are left for the publisher.
    fn truth(&self) -> WorldTruth;

    /// Publishes what sensors see, where the world casts their rays itself.
    ///
    /// # Errors
    /// Where it cannot be published.
    fn sense(&mut self, _stamp_ns: u64) -> Result<(), TransportError> {
        Ok(())
    }
}

impl Motion for Physics {
    fn step(&mut self, command: Twist2) -> Result<(), TransportError> {
        self.step(command);
        Ok(())
    }

    fn form(&mut self, formation: Formation) {
        self.form(formation);
    }

    fn truth(&self) -> WorldTruth {
        self.truth()
    }
}

/// The service.
pub struct Simulator<M = Physics> {
    motion: M,
    goal: Option<Goal>,
    ends_at_ns: u64,
    commands: Subscriber<RobotCommand>,
    modes: Subscriber<Mode>,
    truths: Publisher<WorldTruth>,
    brake: UnixDatagram,
    command: Twist2,
    /// Run time since which it is in force.
    command_since_ns: u64,
    /// Locomotion up to this incarnation is worth nothing: the brake said so.
    fenced: u32,
    next_tick_ns: u64,
    skipped_ticks: u64,
    reached: bool,
    over: bool,
    ends_by_wall_ns: Option<u64>,
}

impl Simulator {
    /// The project's own flat world.
    ///
    /// # Errors
    /// Where a file cannot be read or is wrong, the start is not free, or a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        Self::of(io, |_, settings, scenario, world| {
            Physics::new(Arc::new(world), PhysicsConfig::from(settings), scenario.start)
                .and_then(|physics| physics.with_disturbances(scenario.disturbances.clone()))
                .map_err(TransportError::service)
        })
    }
}

impl<M: Motion> Simulator<M> {
    /// Reads the scenario and its world, in which `begin` puts everybody in their places.
    ///
    /// # Errors
    /// Where a file cannot be read or is wrong, `begin` fails, or a port cannot be opened.
    pub fn of(
        io: &mut Io,
        begin: impl FnOnce(&mut Io, &Settings, &Scenario, World) -> Result<M, TransportError>,
    ) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let scenario = world::scenario_of(&settings).map_err(TransportError::service)?;
        let world = scenario.load_world().map_err(TransportError::service)?;
        let motion = begin(io, &settings, &scenario, world)?;
        let brake = UnixDatagram::bind(io.domain.dir.robot_socket()).map_err(TransportError::service)?;
        brake.set_nonblocking(true).map_err(TransportError::service)?;
        io.watch(&brake, TOKEN_BRAKE)?;
        Ok(Self {
            motion,
            goal: scenario.route.goal,
            ends_at_ns: time_limit_ns(&settings, scenario.route.time_limit_s),
            commands: io.subscriber()?,
            modes: io.quiet_subscriber()?,
            truths: io.publisher()?,
            brake,
            command: Twist2::ZERO,
            command_since_ns: 0,
            fenced: 0,
            next_tick_ns: 0,
            skipped_ticks: 0,
            reached: false,
            over: false,
            ends_by_wall_ns: None,
        })
    }

    fn obey(&mut self, velocity: Twist2, now_ns: u64) {
        if velocity != self.command {
            (self.command, self.command_since_ns) = (velocity, now_ns);
        }
    }

    fn take_commands(&mut self, now_ns: u64) -> Result<(), TransportError> {
        while let Some(command) = self.commands.take()? {
            if command.header.incarnation > self.fenced && command.velocity.is_finite() {
                self.obey(command.velocity, now_ns);
            }
        }
        Ok(())
    }

    /// A simulated handler does as they are asked.
    fn take_modes(&mut self) -> Result<(), TransportError> {
        if let Some(mode) = self.modes.take_newest()? {
            self.motion.form(mode.formation_asked);
        }
        Ok(())
    }

    fn take_brake(&mut self, now_ns: u64) {
        let mut bytes = [0u8; BRAKE_MESSAGE_LEN];
        while let Ok(n) = self.brake.recv(&mut bytes) {
            if let Some(message) = BrakeMessage::decode(&bytes[..n]) {
                self.fenced = self.fenced.max(message.fenced);
                self.obey(Twist2::ZERO, now_ns);
            }
        }
    }

    fn tick(&mut self, stamp_ns: u64) -> Result<(), TransportError> {
        self.motion.step(self.command)?;
        let (command, command_since_ns) = (self.command, self.command_since_ns);
        let mut truth = WorldTruth { command, command_since_ns, ..self.motion.truth() };
        if truth.attitude.is_known() {
            truth.attitude.stamp_ns = stamp_ns;
        }
        let truth = self.truths.publish(stamp_ns, truth)?;
        self.motion.sense(stamp_ns)?;
        self.reached |= self.goal.is_some_and(|goal| goal.reached(truth.world_from_robot));
        self.over |= self.reached || stamp_ns >= self.ends_at_ns;
        Ok(())
    }
}

/// The end of the run, whatever happened; a walk without a goal and a limit goes on until it is ended.
fn time_limit_ns(settings: &Settings, scenario_s: Option<f64>) -> u64 {
    settings.walk.time_limit.map(|limit| limit.ns()).or(scenario_s.map(ns_from_s)).unwrap_or(u64::MAX)
}

impl<M: Motion> Service for Simulator<M> {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        self.take_commands(now)?;
        self.take_modes()?;
        self.take_brake(now);
        if self.next_tick_ns == 0 {
            self.next_tick_ns = now.max(QUANTUM_NS);
        }
        let behind = now.saturating_sub(self.next_tick_ns) / QUANTUM_NS;
        if behind > BEHIND_LIMIT_TICKS {
            self.skipped_ticks += behind;
            self.next_tick_ns += behind * QUANTUM_NS;
            io.tell(&FromChild::Note { text: format!("the world stood still for {} ms", behind * 10) });
        }
        // In real time the world goes on after its end, so that the robot can be seen to stop.
        while self.next_tick_ns <= now {
            self.tick(self.next_tick_ns)?;
            self.next_tick_ns += QUANTUM_NS;
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_tick_ns)
    }

    fn on_fd(&mut self, io: &mut Io, _token: u64) -> Result<(), TransportError> {
        self.take_brake(io.now_ns());
        Ok(())
    }

    fn is_clock_master(&self) -> bool {
        true
    }

    fn time_is_over(&self) -> bool {
        self.over
    }

    fn on_time_over(&mut self, io: &mut Io) -> Result<(), TransportError> {
        io.tell(&FromChild::RunEnded { figures: self.figures() });
        Ok(())
    }

    fn on_leave(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.over = true;
        io.tell(&FromChild::RunEnded { figures: self.figures() });
        Ok(())
    }

    fn wants_wall_ticks(&self) -> bool {
        self.ends_by_wall_ns.is_some()
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        self.ends_by_wall_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        false
    }

    fn is_done(&self) -> bool {
        self.ends_by_wall_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}

impl<M: Motion> Simulator<M> {
    fn figures(&self) -> serde_json::Value {
        let truth = self.motion.truth();
        let pose = truth.world_from_robot;
        let (end_pose, skipped_ticks) = ([pose.x_m, pose.y_m, pose.yaw_rad], self.skipped_ticks);
        json!(RunFigures {
            reached: self.reached,
            distance_m: truth.distance_m,
            collisions: Collisions {
                robot: truth.robot_collisions,
                handler: truth.handler_collisions,
                hit_by_others: truth.hit_by_others,
            },
            falls: Falls { robot: truth.robot_falls, handler: truth.handler_falls },
            simulated: Some(SimulatorFigures { end_pose, skipped_ticks }),
            replayed: None,
        })
    }
}
