//! The body that walks: a robot alone, or with a handler at its harness. [`world::Team`] moves by decisions and always
//! has a handler; yardsticks ask what happens within a decision, and stop at a touch.

use guidance::se2::{Point, Se2, exp, pose2, wrap_angle};
use guidance::{Interaction, InteractionModel, Tilt};
use messages::{Attitude, Twist2, Walker};
use world::{Bodies, Legs, Scene, World};

/// What the body treads over without touching it, metres.
const STEP_M: f64 = 0.05;

/// Robot, and handler where there is one.
#[derive(Debug, Clone)]
pub struct Party {
    bodies: Bodies,
    world_from_robot: Se2,
    twist: Twist2,
    legs: Option<Legs>,
    handler: Option<Handler>,
}

/// How the handler follows.
#[derive(Debug, Clone)]
struct Handler {
    model: InteractionModel,
    robot_from_handler: Se2,
    /// Robot (world frame) and handler (robot frame) when the running decision began.
    began: (Se2, Se2),
}

/// What a body is in touch with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// The robot with something that stands.
    Robot,
    /// The handler with something that stands.
    Handler,
}

impl Party {
    /// At rest; the handler, if there is one, where they walk by default.
    #[must_use]
    pub fn new(bodies: Bodies, handler: Option<InteractionModel>, world_from_robot: Se2, legs: Option<Legs>) -> Self {
        let handler = handler.map(|model| {
            let robot_from_handler = model.robot_from_default();
            Handler { model, robot_from_handler, began: (world_from_robot, robot_from_handler) }
        });
        Self { bodies, world_from_robot, twist: Twist2::ZERO, legs, handler }
    }

    /// The robot.
    #[must_use]
    pub fn world_from_robot(&self) -> &Se2 {
        &self.world_from_robot
    }

    /// The handler, if there is one.
    #[must_use]
    pub fn world_from_handler(&self) -> Option<Se2> {
        self.handler.as_ref().map(|handler| self.world_from_robot * handler.robot_from_handler)
    }

    /// How the robot moves (robot frame).
    #[must_use]
    pub fn twist(&self) -> Twist2 {
        self.twist
    }

    /// How the robot's body is held; none where it is level.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        self.legs.as_ref().map_or(Attitude::default(), Legs::attitude)
    }

    /// A decision begins.
    pub fn begin_step(&mut self) {
        if let Some(handler) = &mut self.handler {
            handler.began = (self.world_from_robot, handler.robot_from_handler);
        }
    }

    /// The robot is commanded a velocity (robot frame) for `dt_s`, after which the share `share` of the decision has
    /// passed.
    pub fn walk(&mut self, velocity: Twist2, dt_s: f64, share: f64) {
        self.twist = self.legs.as_mut().map_or(velocity, |legs| legs.go(velocity, dt_s));
        let next = self.world_from_robot * exp(self.twist, dt_s);
        self.world_from_robot = Se2::new(next.translation.vector, wrap_angle(next.rotation.angle()));
        if let Some(handler) = &mut self.handler {
            let (robot, robot_from_handler) = &handler.began;
            let moved = robot.inverse() * self.world_from_robot;
            handler.robot_from_handler = handler.model.follow(robot_from_handler, &moved, share);
        }
    }

    /// The discs that robot and handler are: middle, radius, and whose.
    pub fn discs(&self) -> impl Iterator<Item = (Point, f64, Touch)> {
        let nose_m = self.bodies.robot_nose_m;
        let noses = if nose_m > 0.0 { vec![nose_m, -nose_m] } else { vec![0.0] };
        let robot = noses.into_iter().map(|ahead_m| {
            (self.world_from_robot * Point::new(ahead_m, 0.0), self.bodies.robot_radius_m, Touch::Robot)
        });
        let handler = self
            .world_from_handler()
            .map(|handler| (Point::from(handler.translation.vector), self.bodies.handler_radius_m, Touch::Handler));
        robot.chain(handler)
    }

    /// Who touches something that stands.
    #[must_use]
    pub fn touches(&self, world: &World) -> Option<Touch> {
        let height_m = |whose| match whose {
            Touch::Robot => self.bodies.robot_height_m,
            Touch::Handler => self.bodies.handler_height_m,
        };
        let touches = |(at, radius_m, whose): &(Point, f64, Touch)| {
            world.clearance(*at, [STEP_M, height_m(*whose)], *radius_m) < *radius_m
        };
        self.discs().find(touches).map(|(.., whose)| whose)
    }

    /// The room between a person and the nearer of robot and handler, metres; less than 0 in a touch.
    #[must_use]
    pub fn apart_m(&self, person: Point, radius_m: f64) -> f64 {
        self.discs().map(|(at, own_m, _)| (at - person).norm() - own_m - radius_m).fold(f64::INFINITY, f64::min)
    }

    /// What sensors look at.
    #[must_use]
    pub fn scene<'a>(&'a self, world: &'a World, walkers: &'a [Walker]) -> Scene<'a> {
        Scene {
            world,
            world_from_robot: pose2(&self.world_from_robot),
            tilt: Tilt::of(&self.attitude()),
            world_from_handler: self.world_from_handler().as_ref().map(pose2),
            walkers,
        }
    }
}
