//! How the body is held, from one depth frame alone: for robots that no source tells the attitude of.
//!
//! The largest even surface at the robot's feet is taken for level floor. So a ramp counts as a tilt of the body, and
//! a low step near by can tip it (docs/odometry.md has the figures). A source that measures gravity knows better.

use messages::{Attitude, DepthHeader};
use nalgebra::{Rotation3, Vector3};

use super::floor::{Plane, Prior, REACH_M};
use super::{DepthError, check, left_of, up_of};

/// About so many columns and rows are looked at.
const COLUMNS: usize = 40;
const ROWS: usize = 60;
/// The most that the floor may be off under the body, metres, and slope on either axis: 16 degrees.
const MOST: Prior = Prior { off_sigma_m: 0.02, slope_sigma: 0.10, off_max_m: 0.05, slope_max: 0.287 };
/// Slopes are tried in steps of two degrees to either side.
const STEPS: i32 = 8;
/// A point lies on a slope that is tried within this, metres, and as much more for each metre of distance.
const NEAR_M: f64 = 0.02;
const NEAR_PER_M: f64 = 0.02;
/// A slope that is steeper has to hold more of the points by this share.
const STEEPER: f64 = 1.02;
/// Between two places of a floor, one below the other in the image, it does not rise or fall more steeply than this.
const FLAT: f64 = 0.5;
/// Fewer points, counted as if 1 m away, are no floor.
const POINTS_MIN: f64 = 20.0;
/// A fit takes what lies within so many times the distance that a slope was tried with.
const GATES: [f64; 5] = [1.25, 1.0, 0.75, 0.5, 0.5];

/// Looks for the floor that the robot stands on. Reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Stance {
    /// What may be floor, in the frame of a body that stands level (ahead, left, height over the floor), metres.
    places: Vec<Vector3<f64>>,
}

impl Stance {
    /// The attitude of a body that stands `standing_m` high, metres, at the frame's stamp. Level where the frame shows
    /// no floor.
    ///
    /// # Errors
    /// Where the frame cannot be used.
    pub fn attitude(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        standing_m: f64,
    ) -> Result<Attitude, DepthError> {
        check(header, pixels_mm.len())?;
        self.look(header, pixels_mm);
        let Some(mut floor) = self.steepness() else {
            return Ok(Attitude::at_height(header.header.stamp_ns, 0.0, 0.0, standing_m));
        };
        for gate in GATES {
            floor = floor.fitted(&self.places, |distance_m| near_m(distance_m) * gate, &MOST);
        }
        let (slope, rise_m) = (floor.slope(), floor.height_m(0.0, 0.0));
        let normal = Vector3::new(-slope.x, -slope.y, 1.0).normalize();
        Ok(Attitude {
            stamp_ns: header.header.stamp_ns,
            roll_rad: normal.y.atan2(normal.z),
            pitch_rad: (-normal.x).asin(),
            height_m: (standing_m - rise_m) * normal.z,
            standing_m,
        })
    }

    fn look(&mut self, header: &DepthHeader, pixels_mm: &[u16]) {
        self.places.clear();
        let mount = header.robot_from_camera;
        let eye = Vector3::new(mount.x_m, mount.y_m, mount.z_m);
        let turned = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
        let (width, height) = (header.width as usize, header.height as usize);
        let seen = |u: usize, v: usize| {
            let depth_m = f64::from(pixels_mm[v * width + u]) / 1000.0;
            let ray = turned * Vector3::new(1.0, left_of(header, u), up_of(header, v));
            (depth_m > 0.0).then(|| eye + ray * depth_m)
        };
        let rows = (height / ROWS).max(1);
        for u in (0..width).step_by((width / COLUMNS).max(1)) {
            let mut below = None;
            for place in (0..height).rev().step_by(rows).map(|v| seen(u, v)) {
                let pair = place.zip(std::mem::replace(&mut below, place));
                self.places.extend(pair.filter(|(place, below)| may_be_floor(place, below)).map(|(place, _)| place));
            }
        }
    }

    /// The slope that most of the places lie on, roughly; `None` where too few lie on any. Of two that hold about as
    /// many it is the gentler one.
    fn steepness(&self) -> Option<Plane> {
        let step = MOST.slope_max / f64::from(STEPS);
        let mut slopes: Vec<(i32, i32)> =
            (-STEPS..=STEPS).flat_map(|b| (-STEPS..=STEPS).map(move |c| (b, c))).collect();
        slopes.sort_by_key(|(ahead, left)| ahead * ahead + left * left);
        let mut best = (None, POINTS_MIN);
        for (ahead, left) in slopes {
            let plane = Plane::sloped(f64::from(ahead) * step, f64::from(left) * step);
            let held = self.held_by(&plane);
            if held > best.1 * STEEPER {
                best = (Some(plane), held);
            }
        }
        best.0
    }

    /// How many places lie on it. Those at its edge count for less, and near ones for more: they are at the feet.
    fn held_by(&self, plane: &Plane) -> f64 {
        let weight = |place: &Vector3<f64>| {
            let distance_m = place.xy().norm();
            let off = (place.z - plane.height_m(place.x, place.y)) / near_m(distance_m);
            (1.0 - off * off).max(0.0) * distance_m.max(0.5).powi(-2)
        };
        self.places.iter().map(weight).sum()
    }
}

/// Whether a place and the one below it in the image may be floor: low, near, and flat between them.
fn may_be_floor(place: &Vector3<f64>, below: &Vector3<f64>) -> bool {
    let (distance_m, between) = (place.xy().norm(), place - below);
    let is_low = place.z.abs() <= MOST.off_max_m + MOST.slope_max * distance_m;
    is_low && distance_m <= REACH_M && between.z.abs() <= FLAT * between.xy().norm()
}

fn near_m(distance_m: f64) -> f64 {
    NEAR_M + NEAR_PER_M * distance_m
}

#[cfg(test)]
mod tests {
    use super::super::ramp_tests::seen;
    use super::super::tests::camera_160;
    use super::Stance;

    /// What is found of a body that is rolled by 2 degrees, pitched by 3, and 0.28 m high, on such ground: roll and
    /// pitch, degrees, and height, metres.
    fn found(ground_m: impl Fn(f64, f64) -> f64) -> [f64; 3] {
        let header = camera_160();
        let attitude = Stance::default().attitude(&header, &seen(&header, &ground_m), 0.30).expect("a frame");
        [attitude.roll_rad.to_degrees(), attitude.pitch_rad.to_degrees(), attitude.height_m]
    }

    fn is_found(what: &str, off_deg: f64, ground_m: impl Fn(f64, f64) -> f64) {
        let [roll_deg, pitch_deg, height_m] = found(ground_m);
        let is_right = (roll_deg - 2.0).abs() < off_deg && (pitch_deg - 3.0).abs() < off_deg;
        assert!(is_right && (height_m - 0.28).abs() < 0.02, "{what}: {roll_deg} {pitch_deg} {height_m}");
    }

    #[test]
    fn what_stands_on_the_floor_and_what_is_missing_of_it_does_not_tip_it() {
        is_found("bare floor", 0.1, |_, _| 0.0);
        is_found("a hole", 0.2, |x, _| if x > 1.5 { -0.3 } else { 0.0 });
        is_found("stairs down", 0.2, |x, _| if x > 1.2 { -0.17 - 0.17 * ((x - 1.2) / 0.28).floor() } else { 0.0 });
        is_found("stairs up", 0.4, |x, _| if x > 1.2 { 0.17 + 0.17 * ((x - 1.2) / 0.28).floor() } else { 0.0 });
        is_found("an edge at the feet", 0.6, |x, _| if x > 0.9 { -0.5 } else { 0.0 });
        is_found("a box", 0.2, |x, y| if x > 1.1 && y.abs() < 0.3 { 0.12 } else { 0.0 });
        is_found("a wall ahead", 0.5, |x, _| if x > 1.2 { 2.0 } else { 0.0 });
        is_found("a wall beside", 0.2, |_, y| if y > 0.4 { 2.0 } else { 0.0 });
        is_found("a corridor", 0.2, |_, y| if y.abs() > 0.7 { 2.0 } else { 0.0 });
    }

    #[test]
    fn without_floor_in_view_it_is_level() {
        let [roll_deg, pitch_deg, height_m] = found(|x, _| if x > 0.6 { 2.0 } else { 0.0 });
        assert!(roll_deg.abs() < 0.1 && pitch_deg.abs() < 0.1 && (height_m - 0.30).abs() < 1e-3);
    }

    #[test]
    fn a_ramp_is_taken_for_a_tilt() {
        let [_, pitch_deg, _] = found(|x, _| x / 12.0);
        assert!((pitch_deg - (3.0 + (1.0_f64 / 12.0).atan().to_degrees())).abs() < 0.5, "{pitch_deg}");
    }
}
