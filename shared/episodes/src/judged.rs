//! A hull that was judged, held against where robot and handler really are.

use guidance::se2::{Point, Se2, se2};
use guidance::{Discs, HandlerBody, Hull, Reach};
use messages::{Twist2, WorldTruth};
use settings::Settings;

/// Room that robot and handler really take.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    reach: Reach,
    radii_m: [f64; 2],
}

impl Shape {
    pub fn of(settings: &Settings) -> Self {
        let radii_m = [settings.robot.radius_m.get(), settings.handler.radius_m.get()];
        Self { reach: settings.shield_config().reach, radii_m }
    }

    fn robot_discs(&self) -> usize {
        if self.reach.nose_m > 0.0 { 2 } else { 1 }
    }
}

/// A hull that was judged, and what it has held so far.
#[derive(Debug, Clone)]
pub(crate) struct Judged {
    shape: Shape,
    /// Robot of then (world frame).
    world_from_robot: Se2,
    hull: Hull,
    /// Where robot (0) and handler (1) end in it, as discs: body, middle, radius.
    ends: Vec<(usize, Point, f64)>,
    /// By how much each reaches beyond the nearest disc that its body covered, metres.
    pub missed_m: Vec<f64>,
    /// How far robot and handler left the hull, metres; 0 or less: they did not.
    pub beyond_m: [f64; 2],
}

impl Judged {
    /// The hull of these discs (robot frame), as `guidance::Shield::swept` orders them for that handler and a robot
    /// that moves so.
    pub fn new(shape: Shape, world_from_robot: Se2, moves: &Twist2, handler: HandlerBody, discs: Discs) -> Self {
        let robots = shape.robot_discs();
        // Those of now come first: robot and handler. Then the robot's end, the handler's, and those of their rest.
        let now = robots + 1 + usize::from(handler.elsewhere().is_some());
        let body = |i: usize| usize::from(i >= robots);
        let rests = [shape.reach.robot_from_rest.is_some(), shape.reach.walks_on(moves).is_some()];
        let handlers = 1 + rests.iter().filter(|has| **has).count();
        let ends = discs[now..].iter().take(robots + handlers).enumerate();
        let ends: Vec<_> = ends.map(|(i, disc)| (body(i), disc.center, disc.radius_m)).collect();
        let missed_m = vec![f64::INFINITY; ends.len()];
        Self { shape, world_from_robot, hull: Hull::new(discs), ends, missed_m, beyond_m: [f64::NEG_INFINITY; 2] }
    }

    /// Where robot and handler are now.
    pub fn hold(&mut self, truth: &WorldTruth) {
        let then_from_world = self.world_from_robot.inverse();
        let robot = then_from_world * se2(truth.world_from_robot);
        let handler = then_from_world * se2(truth.world_from_handler);
        let Shape { reach: Reach { nose_m, .. }, radii_m } = self.shape;
        let noses = [nose_m, -nose_m].map(|ahead_m| robot * Point::new(ahead_m, 0.0));
        let discs = [(0, noses[0]), (0, noses[1]), (1, Point::from(handler.translation.vector))];
        for (body, at) in discs {
            let beyond_m = self.hull.signed_distance_m(at) + radii_m[body];
            self.beyond_m[body] = self.beyond_m[body].max(beyond_m);
            let ends = self.ends.iter().zip(&mut self.missed_m);
            for ((_, end, radius_m), missed_m) in ends.filter(|((of, ..), _)| *of == body) {
                *missed_m = missed_m.min((end - at).norm() + radius_m - radii_m[body]);
            }
        }
    }
}
