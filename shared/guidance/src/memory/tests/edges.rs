//! Edges of the floor that the camera saw, and what the shield makes of them.

use super::{MS, config, handler, memory, scan};
use crate::depth::DepthView;
use crate::depth::ramp_tests::seen as seen_ground;
use crate::depth::tests::{camera_160, held};
use crate::handler::{HandlerBody, Seen};
use crate::memory::{Footing, Memory, MemoryConfig, Remembered};
use crate::scan::Beams;
use crate::se2::{Se2, se2};
use crate::shield::{EdgeDistance, Evidence, Judgement, Motion, Shield, ShieldConfig};
use messages::{Pose2, UnsafeCause};

const EDGES: EdgeDistance = EdgeDistance { ahead_m: 0.3, beside_m: 0.15 };

/// A memory that a camera tells of the floor, while the lidar sees nothing.
pub(super) struct Bench {
    pub memory: Memory,
    view: DepthView,
    beams: Beams,
    /// Each scan sees the handler.
    pub sees_handler: bool,
}

impl Bench {
    pub fn new() -> Self {
        Self { memory: memory(), view: DepthView::default(), beams: scan(&[]), sees_handler: false }
    }

    /// One that remembers floor as well.
    pub fn watching(footing: Footing) -> Self {
        let memory = Memory::new(MemoryConfig { footing: Some(footing), ..memory().config });
        Self { memory, view: DepthView::with_steps(footing.step_max), ..Self::new() }
    }

    /// At that time and place the camera sees such ground. `ground_m` is its height, metres.
    pub fn sees(&mut self, ms: u64, x_m: f64, ground_m: impl Fn(f64, f64) -> f64) {
        let pixels = seen_ground(&camera_160(), &ground_m);
        self.view.expect_steps(self.memory.low_steps_from(&Se2::translation(x_m, 0.0)));
        self.view.fill_tilted(&camera_160(), &pixels, Some(&held(2.0, 3.0))).expect("usable");
        self.update(ms, x_m);
    }

    /// At that time and place it sees nothing.
    pub fn sees_nothing(&mut self, ms: u64, x_m: f64) {
        self.view.clear();
        self.update(ms, x_m);
    }

    /// At that time it stands at the origin, turned so far, and sees nothing.
    pub fn turns(&mut self, ms: u64, heading_rad: f64) {
        self.view.clear();
        self.stands(ms, &Se2::rotation(heading_rad));
    }

    fn update(&mut self, ms: u64, x_m: f64) {
        self.stands(ms, &Se2::translation(x_m, 0.0));
    }

    fn stands(&mut self, ms: u64, odom_from_robot: &Se2) {
        let at = handler().center;
        let seen = self.sees_handler.then_some(Seen { at, next: at, by_default_m: 0.83 });
        let handler = HandlerBody { seen, ..handler() };
        self.memory.update(ms * MS, odom_from_robot, &self.beams, Some(&self.view), &handler);
    }

    /// Places of edges near the robot's axis.
    fn ahead(&self) -> Vec<Remembered> {
        self.memory.edges().iter().filter(|edge| edge.place.y.abs() < 0.3).copied().collect()
    }

    pub fn judge(&self, start_from_end: Pose2) -> Judgement {
        self.judge_with(start_from_end, handler())
    }

    pub fn judge_with(&self, start_from_end: Pose2, handler: HandlerBody) -> Judgement {
        let evidence = Evidence { memory: Some(&self.memory), ..Evidence::scan(&self.beams) };
        let robot = se2(start_from_end);
        let motion = Motion::new(robot, robot * Se2::translation(-0.75, -0.35));
        let mut judgements = Vec::new();
        let mut shield = Shield::new(ShieldConfig { edges: EDGES, back_from_edges_m: Some(1.0), ..config() });
        shield.judge_motions([motion].into_iter(), evidence, handler, &mut judgements);
        judgements[0]
    }
}

/// Ground that lies half a metre lower from there on.
pub(super) fn cliff(edge_m: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, _| if x > edge_m { -0.5 } else { 0.0 }
}

const FORWARD: Pose2 = Pose2::new(0.15, 0.0, 0.0);

#[test]
fn an_edge_stays_below_the_image_for_as_long_as_the_robot_stands() {
    let mut bench = Bench::new();
    for frame in 0..8 {
        bench.sees(33 * frame, 0.0, cliff(1.5));
    }
    assert!(bench.ahead().iter().any(|edge| (1.4..1.52).contains(&edge.place.x)), "{:?}", bench.ahead());
    // From here on the edge is below the image, whose first row sees what lies beyond it.
    bench.sees(2_000, 0.9, cliff(0.6));
    let near = bench.ahead();
    assert!(near.iter().any(|edge| (0.5..0.62).contains(&edge.place.x)), "{near:?}");
    assert!(near.iter().any(|edge| edge.uncertainty_m > 0.02), "drift grows it: {near:?}");
    let ahead = bench.judge(FORWARD);
    assert_eq!((ahead.safe, ahead.cause, ahead.beam), (false, UnsafeCause::DropOff, None), "{ahead:?}");
    // The robot stands there for an hour, and its odometry jitters.
    for second in 3..3_600 {
        bench.sees_nothing(1_000 * second, 0.9 + 0.002 * (second % 3) as f64);
    }
    assert_eq!(bench.judge(FORWARD).cause, UnsafeCause::DropOff, "an hour later");
    assert!(bench.judge(Pose2::new(0.0, 0.0, 0.3)).safe, "it may turn away");
}

#[test]
fn an_edge_goes_where_floor_is_seen() {
    let mut bench = Bench::new();
    for frame in 0..9 {
        bench.sees(33 * frame, 0.0, cliff(1.5));
    }
    assert!(!bench.ahead().is_empty());
    // A ramp is put there.
    for frame in 0..10 {
        bench.sees(1_000 + 33 * frame, 0.0, |x, _| if x > 1.5 { (1.5 - x) / 12.0 } else { 0.0 });
    }
    assert!(bench.ahead().is_empty(), "{:?}", bench.ahead());
}

#[test]
fn one_frame_is_noise_and_what_a_second_one_saw_stays() {
    let mut bench = Bench::new();
    bench.sees(0, 0.0, cliff(1.4));
    assert!(bench.ahead().is_empty(), "{:?}", bench.ahead());
    bench.sees_nothing(10_100, 0.0);
    bench.sees(10_200, 0.0, cliff(1.4));
    assert!(bench.ahead().is_empty(), "the first one was let go: {:?}", bench.ahead());
    bench.sees(10_300, 0.0, cliff(1.4));
    bench.sees(10_400, 0.0, cliff(1.4));
    assert!(!bench.ahead().is_empty());
    bench.sees_nothing(3_600_000, 0.0);
    assert!(!bench.ahead().is_empty());
}

#[test]
fn one_frame_that_sees_floor_does_not_take_a_sure_edge_away() {
    let mut bench = Bench::new();
    for frame in 0..20 {
        bench.sees(33 * frame, 0.0, cliff(1.4));
    }
    bench.sees(700, 0.0, |_, _| 0.0);
    assert!(!bench.ahead().is_empty());
    bench.sees(733, 0.0, cliff(1.4));
    for frame in 0..10 {
        bench.sees(800 + 33 * frame, 0.0, |_, _| 0.0);
    }
    assert!(bench.ahead().is_empty(), "{:?}", bench.ahead());
}

#[test]
fn more_is_kept_from_an_edge_ahead_than_from_one_beside() {
    let mut bench = Bench::new();
    for frame in 0..2 {
        bench.sees(33 * frame, 0.0, |_, y| if y > 0.62 { -0.5 } else { 0.0 });
    }
    bench.sees_nothing(100, 1.2);
    let beside = bench.memory.edges().iter().filter(|edge| edge.place.x.abs() < 0.5).map(|edge| edge.place.y);
    let edge_m = beside.fold(f64::INFINITY, f64::min);
    assert!((0.52..0.63).contains(&edge_m), "{edge_m}");
    // Along it, a body of 0.3 m and 0.15 m; towards it, 0.3 m.
    assert!(bench.judge(Pose2::new(0.3, 0.0, 0.0)).safe);
    assert_eq!(bench.judge(Pose2::new(0.0, 0.05, 0.0)).cause, UnsafeCause::DropOff);
    assert!(bench.judge(Pose2::new(0.0, -0.1, 0.0)).safe, "away from it");
    assert!(bench.judge(Pose2::default()).safe, "who stands does not come nearer");
}

#[test]
fn no_handler_excuses_an_edge_under_them() {
    let mut bench = Bench::new();
    for frame in 0..4 {
        bench.sees(33 * frame, 0.0, |x, y| if y < -0.4 && x < 1.4 { -0.5 } else { 0.0 });
    }
    // The robot has walked on, and the handler is where the edge was seen.
    bench.sees_nothing(1_000, 1.9);
    let places: Vec<_> = bench.memory.edges().iter().map(|edge| edge.place).collect();
    assert!(places.iter().any(|place| handler().masks(*place)), "{places:?}");
    assert!(places.iter().all(|place| place.coords.norm() > 0.3 + 0.3), "none is the robot's: {places:?}");
    // Only the handler comes nearer.
    assert_eq!(bench.judge(Pose2::new(0.0, 0.0, -0.3)).cause, UnsafeCause::DropOff);
}

#[test]
fn what_is_ahead_of_the_handler_is_ahead() {
    let mut bench = Bench::new();
    for frame in 0..4 {
        bench.sees(33 * frame, 0.0, |x, y| if (-0.75..-0.1).contains(&y) && x > 1.35 { -0.5 } else { 0.0 });
    }
    // Beside the robot a hole begins, which the handler walks towards.
    bench.sees_nothing(1_000, 1.35);
    assert_eq!(bench.judge(Pose2::new(0.1, 0.0, 0.0)).cause, UnsafeCause::DropOff);
}
