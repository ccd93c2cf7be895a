//! What a world is built of: vertical faces over an outline.

use guidance::se2::{Point, Se2};
use nalgebra::Vector2;

/// The most that a polygon may lie off the arc it stands for, metres: under the noise of any sensor here.
const SAGITTA_M: f64 = 0.002;

/// Vertical faces over an outline in the world frame, from `z0_m` to `z1_m` above the floor, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    /// Corners. Of a solid: convex and counter-clockwise, the last joined to the first. Otherwise a polyline.
    pub outline: Vec<Point>,
    /// Whether the outline bounds a body; otherwise the faces are thin, and seen from both sides.
    pub solid: bool,
    /// Lower edge above the floor, metres.
    pub z0_m: f64,
    /// Upper edge above the floor, metres.
    pub z1_m: f64,
    /// Who sees it. What nobody sees blocks all the same.
    pub seen_by: SeenBy,
}

/// Which sensors see something.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SeenBy {
    /// Lidar and camera.
    #[default]
    Both,
    /// The camera alone: glass that is dirty, or has a print on it.
    Camera,
    /// Nobody: clean glass.
    Nobody,
}

impl Prism {
    /// A thin wall along a polyline.
    #[must_use]
    pub fn wall(points: Vec<Point>, [z0_m, z1_m]: [f64; 2]) -> Self {
        Self { outline: points, solid: false, z0_m, z1_m, seen_by: SeenBy::Both }
    }

    /// A thin wall along an arc, as a polygon that is at most 2 mm off it. Angles in radians, counter-clockwise from
    /// the x axis.
    #[must_use]
    pub fn arc(center: Point, radius_m: f64, [from_rad, to_rad]: [f64; 2], z: [f64; 2]) -> Self {
        let steps = ((to_rad - from_rad).abs() / step_rad(radius_m)).ceil().max(1.0) as usize;
        let at = |i: usize| from_rad + (to_rad - from_rad) * i as f64 / steps as f64;
        Self::wall((0..=steps).map(|i| on_circle(center, radius_m, at(i))).collect(), z)
    }

    /// A body over a convex, counter-clockwise outline.
    #[must_use]
    pub fn solid(outline: Vec<Point>, [z0_m, z1_m]: [f64; 2]) -> Self {
        Self { outline, solid: true, z0_m, z1_m, seen_by: SeenBy::Both }
    }

    /// A box, `size` along its own x and y axes, turned by `yaw_rad` about its centre.
    #[must_use]
    pub fn cuboid(at: Point, size: [f64; 2], yaw_rad: f64, z: [f64; 2]) -> Self {
        let (x, y) = (size[0] / 2.0, size[1] / 2.0);
        let world_from_box = Se2::new(at.coords, yaw_rad);
        let corners = [(-x, -y), (x, -y), (x, y), (-x, y)];
        Self::solid(corners.iter().map(|&(x, y)| world_from_box * Point::new(x, y)).collect(), z)
    }

    /// A round pillar, as a polygon that is at most 2 mm off the circle on either side.
    #[must_use]
    pub fn pillar(at: Point, radius_m: f64, z: [f64; 2]) -> Self {
        let count = ((std::f64::consts::TAU / step_rad(radius_m)).ceil() as usize).max(8);
        let step = std::f64::consts::TAU / count as f64;
        // Corners half the sagitta outside, middles of the sides half of it inside.
        let corner_m = 2.0 * radius_m / (1.0 + (step / 2.0).cos());
        Self::solid((0..count).map(|i| on_circle(at, corner_m, step * i as f64)).collect(), z)
    }

    /// The same, seen by these sensors.
    #[must_use]
    pub fn seen_by(self, seen_by: SeenBy) -> Self {
        Self { seen_by, ..self }
    }

    /// The faces as segments of the outline.
    pub fn sides(&self) -> impl Iterator<Item = (Point, Point)> + '_ {
        let closing = if self.solid { self.outline.first().copied() } else { None };
        let ends = self.outline.iter().copied().skip(1).chain(closing);
        self.outline.iter().copied().zip(ends)
    }

    /// Whether a point is in a solid's outline.
    #[must_use]
    pub fn contains(&self, p: Point) -> bool {
        self.solid && self.sides().all(|(a, b)| (b - a).perp(&(p - a)) >= 0.0)
    }

    /// Whether some of it is between two heights, metres.
    #[must_use]
    pub fn reaches(&self, [z0_m, z1_m]: [f64; 2]) -> bool {
        self.z0_m < z1_m && self.z1_m > z0_m
    }
}

/// The angle of a chord that is [`SAGITTA_M`] off its arc.
fn step_rad(radius_m: f64) -> f64 {
    2.0 * (1.0 - (SAGITTA_M / radius_m).min(0.3)).acos()
}

fn on_circle(center: Point, radius_m: f64, angle_rad: f64) -> Point {
    center + Vector2::new(angle_rad.cos(), angle_rad.sin()) * radius_m
}

#[cfg(test)]
mod tests {
    use super::Prism;
    use guidance::se2::Point;

    #[test]
    fn a_pillar_is_round_to_two_millimetres() {
        let pillar = Prism::pillar(Point::new(1.0, 2.0), 0.3, [0.0, 2.0]);
        for (a, b) in pillar.sides() {
            let center = Point::new(1.0, 2.0);
            assert!(((a - center).norm() - 0.3).abs() < 2e-3);
            assert!((nalgebra::center(&a, &b) - center).norm() - 0.3 > -2e-3);
        }
        assert!(pillar.contains(Point::new(1.1, 2.1)) && !pillar.contains(Point::new(1.3, 2.3)));
    }

    #[test]
    fn a_box_is_turned_about_its_centre() {
        let cuboid = Prism::cuboid(Point::new(1.0, 0.0), [2.0, 0.2], std::f64::consts::FRAC_PI_2, [0.0, 1.0]);
        assert!(cuboid.contains(Point::new(1.0, 0.95)) && !cuboid.contains(Point::new(1.95, 0.0)));
        assert_eq!(cuboid.sides().count(), 4);
    }
}
