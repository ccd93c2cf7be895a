//! How the floor rises, near the camera and farther off: a camera that is mounted otherwise than configured sees both
//! rise by the same.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::DepthView;

/// Near floor and far floor: from here to here along the camera's axis, metres.
const NEAR_M: [f64; 2] = [0.5, 1.1];
const FAR_M: [f64; 2] = [1.3, 2.4];
/// And to this distance on either side of it, metres: most walls are farther off.
const ASIDE_M: f64 = 0.5;
/// What is higher or lower is no floor: at the camera, metres, and an increase per metre of distance.
const HIGH_M: f64 = 0.03;
const HIGH_PER_M: f64 = 0.12;
/// Points farther off the fitted slope are outliers, metres.
const OUTSIDE_M: f64 = 0.04;
/// At least this many points, and this share of those that may be floor, must lie on it.
const POINTS_MIN: usize = 12;
const SHARE_MIN: f64 = 0.7;

/// By how much the floor rises from the camera's foot on, per metre ahead and per metre to the left. Gravity is the
/// reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slopes {
    /// Of the near floor.
    pub near: Vector2<f64>,
    /// Of the far floor.
    pub far: Vector2<f64>,
}

impl Slopes {
    /// Level floor.
    pub const LEVEL: Self = Self { near: Vector2::new(0.0, 0.0), far: Vector2::new(0.0, 0.0) };
}

impl DepthView {
    /// How near and far floor rise. None where the frame shows too little of either, or where the attitude of the body
    /// is not known.
    #[must_use]
    pub fn slopes(&self) -> Option<Slopes> {
        let slope = |[from_m, to_m]: [f64; 2]| {
            let from_camera = |place: &Vector3<f64>| {
                let to = place.xy() - self.camera.coords;
                (to, place.z)
            };
            let is_within = |to: &Vector2<f64>| {
                let is_ahead = (from_m..to_m).contains(&to.dot(&self.forward));
                is_ahead && self.forward.perp(to).abs() <= ASIDE_M
            };
            slope(|| self.low.iter().map(from_camera).filter(|(to, _)| is_within(to)))
        };
        Some(Slopes { near: slope(NEAR_M)?, far: slope(FAR_M)? })
    }
}

/// The slope of floor from places on it (from the camera's foot: ahead and left; height), metres.
fn slope<I: Iterator<Item = (Vector2<f64>, f64)>>(places: impl Fn() -> I) -> Option<Vector2<f64>> {
    let may_be_floor = |(to, height_m): &(Vector2<f64>, f64)| height_m.abs() <= HIGH_M + HIGH_PER_M * to.norm();
    let fitted = |is_inlier: &dyn Fn(&Vector2<f64>, f64) -> bool| {
        let (mut normal, mut right, mut count) = (Matrix2::zeros(), Vector2::zeros(), 0_usize);
        for (to, height_m) in places().filter(may_be_floor).filter(|(to, height_m)| is_inlier(to, *height_m)) {
            normal += to * to.transpose();
            right += to * height_m;
            count += 1;
        }
        Some((normal.try_inverse()? * right, count))
    };
    let (first, all) = fitted(&|_, _| true)?;
    let near =
        |slope: Vector2<f64>| move |to: &Vector2<f64>, height_m: f64| (height_m - slope.dot(to)).abs() <= OUTSIDE_M;
    let (second, _) = fitted(&near(first))?;
    let (slope, count) = fitted(&near(second))?;
    (count >= POINTS_MIN && count as f64 >= SHARE_MIN * all as f64).then_some(slope)
}
