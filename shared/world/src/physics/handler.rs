//! What the handler does with the handle: holds it, stands without it, and walks back to it.

use guidance::se2::{Point, pose2, se2, wrap_angle};
use messages::{Formation, Pose2};
use nalgebra::Vector2;

use super::{CLOSING_MPS, HANDLER, Physics, TICK_S, placed};
use crate::outline::Outline;
use crate::{Disturbance, DisturbanceKind, WorldError};

/// A handler walks back to the handle so fast, m/s.
pub const RETURNING_MPS: f64 = 0.8;
/// They take it from so near, metres.
const TAKES_M: f64 = 0.05;
/// Something holds the handler up: they are so far from where the harness leads, metres. After so many ticks they let
/// the handle go. After as many again they walk back to it.
const HELD_UP_M: f64 = 0.3;
const HELD_UP_TICKS: u32 = 100;
/// The robot's way is remembered in places so far apart, metres, and so many of them.
const TRAIL_STEP_M: f64 = 0.1;
const TRAIL: usize = 100;

/// What the handler does with the handle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Grip {
    /// Holds it, and is drawn after the robot.
    #[default]
    Holds,
    /// Stands without it for so many ticks more.
    Stands(u32),
    /// Walks back to it.
    Returns,
}

/// The handler's hand, and the way on which a handler who was left behind finds the robot.
#[derive(Debug, Clone, Default)]
pub(super) struct Hand {
    grip: Grip,
    formation: Formation,
    held_up_ticks: u32,
    /// Where the robot was (world frame), the newest place last.
    trail: Vec<Point>,
    disturbances: Vec<Disturbance>,
}

impl Hand {
    /// Whether the handle is held.
    pub fn holds(&self) -> bool {
        self.grip == Grip::Holds
    }

    /// The robot has come to a place.
    fn follow(&mut self, robot: Point) {
        if self.trail.last().is_none_or(|last| (robot - last).norm() >= TRAIL_STEP_M) {
            if self.trail.len() == TRAIL {
                self.trail.remove(0);
            }
            self.trail.push(robot);
        }
    }
}

impl Physics {
    /// A handler who lets the handle go at those times, and walks back to it after each.
    ///
    /// # Errors
    /// Where they do anything else: that needs the physics of a body that is pulled.
    pub fn with_disturbances(mut self, disturbances: Vec<Disturbance>) -> Result<Self, WorldError> {
        if disturbances.iter().any(|disturbance| disturbance.kind != DisturbanceKind::LetGo) {
            return Err(WorldError::Disturbances);
        }
        self.hand.disturbances = disturbances;
        Ok(self)
    }

    /// The handler was asked to walk there: they let the handle go, and take it again in their new place.
    pub fn form(&mut self, formation: Formation) {
        if self.hand.formation != formation && self.hand.holds() {
            self.hand.grip = Grip::Returns;
        }
        self.hand.formation = formation;
    }

    /// Where the handler walks, robot frame.
    fn robot_from_place(&self) -> Pose2 {
        let handler = &self.config.handler;
        match self.hand.formation {
            Formation::Beside => handler.robot_from_handler,
            Formation::Behind => Pose2::new(-handler.behind_m, 0.0, 0.0),
        }
    }

    /// One tick of the handler.
    pub(super) fn move_handler(&mut self) {
        let (robot, time_s) = (self.place(super::ROBOT), self.ticks as f64 * TICK_S);
        self.hand.follow(robot);
        if self.hand.disturbances.iter().any(|disturbance| disturbance.is_at(time_s)) {
            self.hand.grip = Grip::Stands(0);
            return;
        }
        match self.hand.grip {
            Grip::Holds => self.be_drawn(),
            Grip::Stands(0) => self.hand.grip = Grip::Returns,
            Grip::Stands(ticks) => self.hand.grip = Grip::Stands(ticks - 1),
            Grip::Returns => self.walk_back(),
        }
    }

    /// The offset in the robot's frame relaxes to its default.
    fn be_drawn(&mut self) {
        let handler = &self.config.handler;
        let tau_s = handler.time_constant_s();
        let keep = tau_s / (tau_s + TICK_S);
        let mut target = self.robot_from_place();
        if self.twist.speed_mps() > CLOSING_MPS {
            let phase = std::f64::consts::TAU * (self.ticks as f64 * TICK_S) / handler.sway_period_s;
            target.y_m += handler.sway_m * phase.sin();
        }
        let now = pose2(&(self.world_from_robot.inverse() * self.world_from_handler));
        let next = Pose2::new(
            target.x_m + keep * (now.x_m - target.x_m),
            target.y_m + keep * (now.y_m - target.y_m),
            target.yaw_rad + keep * wrap_angle(now.yaw_rad - target.yaw_rad),
        );
        let wanted = self.world_from_robot * se2(next);
        let is_far = (target.x_m - now.x_m).hypot(target.y_m - now.y_m) > HELD_UP_M;
        let is_free = self.go(Point::from(wanted.translation.vector), wanted.rotation.angle());
        let held_up_ticks = if is_far && !is_free { self.hand.held_up_ticks + 1 } else { 0 };
        self.hand.held_up_ticks = held_up_ticks;
        if held_up_ticks == HELD_UP_TICKS {
            self.hand.held_up_ticks = 0;
            self.hand.grip = Grip::Stands(HELD_UP_TICKS);
        }
    }

    /// Goes straight to a place, as far as it is free: whether all of it is.
    fn go(&mut self, to: Point, yaw_rad: f64) -> bool {
        let from = self.place(HANDLER);
        let share = self.free_share(HANDLER, &self.outline(HANDLER), &Outline::of(&placed(to, yaw_rad), 0.0));
        let reached = if share < 1.0 { from + (to - from) * share } else { to };
        self.world_from_handler = placed(reached, yaw_rad);
        share == 1.0
    }

    /// Back to the handle: straight, or else along the way that the robot went, up to the robot.
    fn walk_back(&mut self) {
        let at = self.place(HANDLER);
        let handle = self.world_from_robot * se2(self.robot_from_place());
        let to_handle = Point::from(handle.translation.vector);
        let body = &self.bodies[HANDLER];
        let (radius_m, z) = (body.radius_m, body.z);
        let is_free = |to: &Point| !self.world.is_blocked(at, *to, radius_m, z);
        let robot = self.place(super::ROBOT);
        let clear_m = self.bodies[super::ROBOT].radius_m + self.config.robot.nose_m + radius_m;
        let is_clear = move |place: &Point| (place - robot).norm() >= clear_m;
        let newest_first = || self.hand.trail.iter().rev().copied().filter(is_clear);
        let Some(aim) = std::iter::once(to_handle).chain(newest_first()).find(is_free) else { return };
        let way: Vector2<f64> = aim - at;
        let next = at + way.cap_magnitude(RETURNING_MPS * TICK_S);
        let yaw_rad = if way.norm() > TAKES_M { way.y.atan2(way.x) } else { handle.rotation.angle() };
        let is_free = self.go(next, yaw_rad);
        if is_free && (to_handle - next).norm() <= TAKES_M {
            self.world_from_handler = placed(next, handle.rotation.angle());
            self.hand.grip = Grip::Holds;
        }
    }
}
