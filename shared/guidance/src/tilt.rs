//! The tilt of the body over the level robot frame. Measurements of its sensors are transformed by it.

use messages::Attitude;
use nalgebra::{Point3, Rotation3, Vector3};

/// From the body, on which sensors are mounted (`base_link`), to the level frame on the floor (`base_footprint`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tilt {
    footprint_from_base: Rotation3<f64>,
    height_m: f64,
    standing_m: f64,
}

impl Tilt {
    /// The tilt of that attitude; `None` where no source tells it, and the body counts as level. The attitude is
    /// usable.
    #[must_use]
    pub fn of(attitude: &Attitude) -> Option<Self> {
        attitude.is_known().then(|| Self {
            footprint_from_base: Rotation3::from_euler_angles(attitude.roll_rad, attitude.pitch_rad, 0.0),
            height_m: attitude.height_m,
            standing_m: attitude.standing_m,
        })
    }

    /// Where a mount is, whose place is told for a body that stands level: x forward, y left, z above the floor,
    /// metres.
    #[must_use]
    pub fn place(&self, mount: Point3<f64>) -> Point3<f64> {
        let from_base = mount.coords - Vector3::z() * self.standing_m;
        Point3::from(self.footprint_from_base * from_base + Vector3::z() * self.height_m)
    }

    /// Where a direction of the level body points.
    #[must_use]
    pub fn direction(&self, of_level_body: Vector3<f64>) -> Vector3<f64> {
        self.footprint_from_base * of_level_body
    }
}

/// The attitude a share of the way from one to another.
#[must_use]
pub(crate) fn between(from: &Attitude, to: &Attitude, share: f64) -> Attitude {
    let mix = |from: f64, to: f64| from + (to - from) * share;
    Attitude {
        stamp_ns: from.stamp_ns + ((to.stamp_ns.saturating_sub(from.stamp_ns)) as f64 * share) as u64,
        roll_rad: mix(from.roll_rad, to.roll_rad),
        pitch_rad: mix(from.pitch_rad, to.pitch_rad),
        height_m: mix(from.height_m, to.height_m),
        standing_m: to.standing_m,
    }
}

#[cfg(test)]
mod tests {
    use super::Tilt;
    use messages::Attitude;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn a_nose_that_is_down_brings_the_camera_down_and_a_left_side_that_is_up_the_left() {
        let attitude = Attitude { stamp_ns: 1, height_m: 0.30, standing_m: 0.30, ..Attitude::default() };
        let tilt = Tilt::of(&Attitude { pitch_rad: 0.1, ..attitude }).expect("known");
        let camera = tilt.place(Point3::new(0.30, 0.0, 0.40));
        assert!((camera.z - (0.40 - 0.30 * 0.1_f64.sin() - 0.1 * (1.0 - 0.1_f64.cos()))).abs() < 1e-12, "{camera}");
        assert!(tilt.direction(Vector3::x()).z < -0.09);
        let tilt = Tilt::of(&Attitude { roll_rad: 0.1, ..attitude }).expect("known");
        assert!(tilt.direction(Vector3::y()).z > 0.09);
        assert_eq!(Tilt::of(&Attitude::default()), None);
    }
}
