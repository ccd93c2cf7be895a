//! Floor that is not plain: holes, stairs, and floor of which a camera sees little.

use guidance::se2::{Point, Se2, se2};
use messages::Pose2;

use crate::World;
use crate::prism::Prism;
use crate::sweep::to_segment;

/// A step down by no more is no fall, metres: robot and handler take it.
pub const FALL_M: f64 = 0.12;
/// Floor that lies lower by less than this has no step, metres.
const STEP_MIN_M: f64 = 0.03;
/// A tread of open stairs is so thick, metres.
const TREAD_THICK_M: f64 = 0.04;
/// Outlines that overlap by less only touch, metres.
const TOUCH_M: f64 = 1e-6;

/// Floor that lies lower than the rest: a hole, a tread of stairs that lead down, the ground beside a platform. Holes
/// do not overlap.
#[derive(Debug, Clone, PartialEq)]
pub struct Hole {
    /// Corners in the world frame, convex and counter-clockwise.
    pub outline: Vec<Point>,
    /// How much lower its floor lies, metres.
    pub depth_m: f64,
}

/// Floor of which some pixels of a depth camera say nothing: it is dark, or shines.
#[derive(Debug, Clone, PartialEq)]
pub struct DarkFloor {
    /// Corners in the world frame, convex and counter-clockwise.
    pub outline: Vec<Point>,
    /// The share of its pixels that say nothing, 0 to 1.
    pub silent: f64,
}

/// A straight flight of stairs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stairs {
    /// Middle of its first edge, and the way over it (world frame).
    pub foot: Pose2,
    /// Steps.
    pub steps: usize,
    /// Depth of a tread along the way, metres.
    pub tread_m: f64,
    /// Width across, metres.
    pub width_m: f64,
    /// Height of a step, metres; less than 0: they lead down.
    pub rise_m: f64,
    /// Length of the floor beyond the last step, at its height, metres.
    pub landing_m: f64,
    /// Its treads are thin, with nothing between: one sees through. Only of stairs that lead up.
    pub open: bool,
}

/// A rectangle from the middle of its near side, along its own x axis.
#[must_use]
pub fn rectangle(near: Pose2, length_m: f64, width_m: f64) -> Vec<Point> {
    let (near, half_m) = (se2(near), width_m / 2.0);
    let corners = [(0.0, -half_m), (length_m, -half_m), (length_m, half_m), (0.0, half_m)];
    corners.map(|(x_m, y_m)| near * Point::new(x_m, y_m)).to_vec()
}

/// The sides of a convex outline.
pub(crate) fn sides(outline: &[Point]) -> impl Iterator<Item = (Point, Point)> + '_ {
    let ends = outline.iter().cycle().skip(1);
    outline.iter().copied().zip(ends.copied())
}

/// Whether a point is in a convex outline.
pub(crate) fn contains(outline: &[Point], p: Point) -> bool {
    sides(outline).all(|(a, b)| (b - a).perp(&(p - a)) >= 0.0)
}

/// Whether two convex outlines overlap: no side of either has the other beyond it.
pub(crate) fn overlap(a: &[Point], b: &[Point]) -> bool {
    let is_apart = |of: &[Point], other: &[Point]| {
        sides(of).any(|(from, to)| {
            let along = (to - from).normalize();
            other.iter().all(|p| along.perp(&(p - from)) <= TOUCH_M)
        })
    };
    !is_apart(a, b) && !is_apart(b, a)
}

/// Distance from a place to a convex outline, metres; 0 in it.
fn distance_m(outline: &[Point], at: Point) -> f64 {
    if contains(outline, at) {
        return 0.0;
    }
    sides(outline).map(|(a, b)| to_segment(at, a, b)).fold(f64::INFINITY, f64::min)
}

impl Hole {
    /// Distance from a place to it, metres; 0 in it.
    #[must_use]
    pub fn distance_m(&self, at: Point) -> f64 {
        distance_m(&self.outline, at)
    }
}

impl DarkFloor {
    /// Distance from a place to it, metres; 0 on it.
    #[must_use]
    pub fn distance_m(&self, at: Point) -> f64 {
        distance_m(&self.outline, at)
    }
}

impl Stairs {
    /// Its treads: the near side's middle, the length along the way, and the height.
    fn treads(&self) -> impl Iterator<Item = (Pose2, f64, f64)> + '_ {
        (1..=self.steps).map(|step| {
            let ahead_m = (step - 1) as f64 * self.tread_m;
            let near = guidance::se2::pose2(&(se2(self.foot) * Se2::translation(ahead_m, 0.0)));
            let landing_m = if step == self.steps { self.landing_m } else { 0.0 };
            (near, self.tread_m + landing_m, step as f64 * self.rise_m)
        })
    }

    /// The floor of stairs that lead down; none of others.
    pub fn holes(&self) -> impl Iterator<Item = Hole> + '_ {
        self.treads()
            .filter(|(.., high_m)| *high_m < 0.0)
            .map(|(near, length_m, high_m)| Hole { outline: rectangle(near, length_m, self.width_m), depth_m: -high_m })
    }

    /// The bodies of stairs that lead up; none of others.
    pub fn bodies(&self) -> impl Iterator<Item = Prism> + '_ {
        self.treads().filter(|(.., high_m)| *high_m > 0.0).map(|(near, length_m, high_m)| {
            let low_m = if self.open { (high_m - TREAD_THICK_M).max(0.0) } else { 0.0 };
            Prism::solid(rectangle(near, length_m, self.width_m), [low_m, high_m])
        })
    }
}

/// Whose footprints have left the floor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Falls {
    counts: [u32; 2],
    over: [bool; 2],
}

impl Falls {
    /// Looks at the discs of robot and handler (world frame) and their radii, metres. Each fall counts once.
    pub fn look(&mut self, world: &World, discs: [&[Point]; 2], radii_m: [f64; 2]) {
        for (body, (discs, radius_m)) in discs.into_iter().zip(radii_m).enumerate() {
            let is_over = discs.iter().any(|at| world.is_over_edge(*at, radius_m));
            self.counts[body] += u32::from(is_over && !self.over[body]);
            self.over[body] = is_over;
        }
    }

    /// Of the robot.
    #[must_use]
    pub fn robot(&self) -> u32 {
        self.counts[0]
    }

    /// Of the handler.
    #[must_use]
    pub fn handler(&self) -> u32 {
        self.counts[1]
    }

    /// Whether there were any.
    #[must_use]
    pub fn any(&self) -> bool {
        self.counts != [0; 2]
    }
}

/// Distance from a place to the nearest hole that is a fall, metres. Infinite in a world without one.
#[must_use]
pub fn to_edge_m(holes: &[Hole], at: Point) -> f64 {
    let deep = holes.iter().filter(|hole| hole.depth_m > FALL_M);
    deep.map(|hole| hole.distance_m(at)).fold(f64::INFINITY, f64::min)
}

/// Distance from a place to the nearest low step, metres: the rim of floor that lies lower and is no fall. Infinite in
/// a world without one.
#[must_use]
pub fn to_low_step_m(holes: &[Hole], at: Point) -> f64 {
    let low = holes.iter().filter(|hole| (STEP_MIN_M..=FALL_M).contains(&hole.depth_m));
    let rims = low.flat_map(|hole| sides(&hole.outline));
    rims.map(|(a, b)| to_segment(at, a, b)).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::{Hole, Stairs, overlap, rectangle, to_edge_m, to_low_step_m};
    use guidance::se2::Point;
    use messages::Pose2;

    fn hole(at: (f64, f64), depth_m: f64) -> Hole {
        Hole { outline: rectangle(Pose2::new(at.0, at.1, 0.0), 2.0, 1.0), depth_m }
    }

    #[test]
    fn an_edge_is_where_one_falls() {
        let holes = [hole((1.0, 0.0), 1.0), hole((0.0, 3.0), 0.02)];
        assert!((to_edge_m(&holes, Point::new(0.4, 0.2)) - 0.6).abs() < 1e-12);
        assert_eq!(to_edge_m(&holes, Point::new(2.0, 0.0)), 0.0);
        assert!(to_edge_m(&holes, Point::new(0.0, 3.0)) > 1.0, "2 cm are no fall");
        assert_eq!(to_edge_m(&[], Point::origin()), f64::INFINITY);
    }

    #[test]
    fn a_low_step_is_at_the_rim_of_low_floor_on_either_side_of_it() {
        let holes = [hole((1.0, 0.0), 0.08), hole((0.0, 3.0), 0.02), hole((0.0, -3.0), 0.5)];
        assert!((to_low_step_m(&holes, Point::new(0.4, 0.2)) - 0.6).abs() < 1e-12);
        assert!((to_low_step_m(&holes, Point::new(1.3, 0.0)) - 0.3).abs() < 1e-12, "from within");
        assert!(to_low_step_m(&holes, Point::new(0.0, -3.0)) > 2.0, "a deep hole is no low step");
        assert_eq!(to_low_step_m(&[], Point::origin()), f64::INFINITY);
    }

    #[test]
    fn stairs_lead_down_in_holes_and_up_in_bodies() {
        let foot = Pose2::new(1.0, 0.0, std::f64::consts::FRAC_PI_2);
        let down = Stairs { foot, steps: 3, tread_m: 0.3, width_m: 2.0, rise_m: -0.17, landing_m: 1.0, open: false };
        let holes: Vec<Hole> = down.holes().collect();
        assert_eq!((holes.len(), down.bodies().count()), (3, 0));
        assert!((holes[2].depth_m - 0.51).abs() < 1e-12);
        assert_eq!(holes[1].distance_m(Point::new(1.0, 0.45)), 0.0);
        assert!((to_edge_m(&holes, Point::new(1.0, -0.5)) - 0.5).abs() < 1e-12);
        assert!(holes.windows(2).all(|pair| !overlap(&pair[0].outline, &pair[1].outline)), "treads only touch");
        let up = Stairs { rise_m: 0.17, open: true, ..down };
        let bodies: Vec<_> = up.bodies().collect();
        assert_eq!((bodies.len(), up.holes().count()), (3, 0));
        assert!(bodies[1].contains(Point::new(1.0, 0.45)) && bodies[1].z0_m > 0.25 && bodies[1].solid);
    }

    #[test]
    fn outlines_overlap_or_touch() {
        let square = |x_m: f64, yaw_rad: f64| rectangle(Pose2::new(x_m, 0.0, yaw_rad), 1.0, 1.0);
        assert!(overlap(&square(0.0, 0.0), &square(0.9, 0.0)) && overlap(&square(0.0, 0.0), &square(0.2, 0.7)));
        assert!(!overlap(&square(0.0, 0.0), &square(1.0, 0.0)) && !overlap(&square(0.0, 0.0), &square(1.4, 0.7)));
    }
}
