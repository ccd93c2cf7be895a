//! How the body is held, from one depth frame alone: for robots that do not measure their attitude.
//!
//! The largest even surface at the robot's feet is taken for level floor. So a gentle ramp counts as a tilt of the
//! body, and a low step near by can tip it (docs/odometry.md has the figures). A source that measures gravity knows
//! better. What is found is bounded: a body that leans further has no attitude, and the robot stops.

use messages::{Attitude, DepthHeader};
use nalgebra::{Rotation3, Vector3};

use super::floor::{Plane, Prior, REACH_M};
use super::{DepthError, check, left_of, up_of};

/// At most this many columns and rows are looked at.
const COLUMNS: usize = 40;
const ROWS: usize = 60;
/// The most that the floor may be off under the body, metres, and slope on either axis: 12 degrees.
const MOST: Prior = Prior { off_sigma_m: 0.02, slope_sigma: 0.08, off_max_m: 0.03, slope_max: 0.21 };
/// Slopes are tried in this number of steps to either side: of 1.7 degrees.
const STEPS: i32 = 7;
/// A point lies on a slope that is tried within this, metres, plus an increase per metre of distance.
const NEAR_M: f64 = 0.02;
const NEAR_PER_M: f64 = 0.02;
/// A slope that is steeper has to hold more of the points by this share.
const STEEPER: f64 = 1.02;
/// Between two places of a floor, one below the other in the image, it does not rise or fall more steeply than this.
const FLAT: f64 = 0.5;
/// Fewer points, counted as if 1 m away, are no floor.
const POINTS_MIN: f64 = 20.0;
/// A fit takes the points within that distance, times these.
const GATES: [f64; 5] = [1.25, 1.0, 0.75, 0.5, 0.5];

/// Looks for the floor that the robot stands on. Reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Stance {
    /// What may be floor, in the frame of a body that stands level (ahead, left, height over the floor), metres.
    places: Vec<Vector3<f64>>,
    /// Of each place: how far off a slope that is tried it may be, metres, and what it counts for. Near ones count for
    /// more: they are at the feet.
    weighed: Vec<(f64, f64)>,
}

impl Stance {
    /// The attitude of a body that stands `standing_m` high, metres, at the frame's stamp; `None` where the frame shows
    /// no floor, or one that is at the bounds: the body then leans further than this can tell.
    ///
    /// # Errors
    /// Where the frame cannot be used.
    pub fn attitude(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        standing_m: f64,
    ) -> Result<Option<Attitude>, DepthError> {
        check(header, pixels_mm.len())?;
        self.look(header, pixels_mm);
        let Some(mut floor) = self.steepness() else { return Ok(None) };
        for gate in GATES {
            floor = floor.fitted(&self.places, |distance_m| near_m(distance_m) * gate, &MOST);
        }
        let (slope, rise_m) = (floor.slope(), floor.height_m(0.0, 0.0));
        // A fit that lost its points is the prior alone, which is level.
        if slope.amax() >= MOST.slope_max || self.held_by(&floor) < POINTS_MIN {
            return Ok(None);
        }
        let normal = Vector3::new(-slope.x, -slope.y, 1.0).normalize();
        Ok(Some(Attitude {
            stamp_ns: header.header.stamp_ns,
            roll_rad: normal.y.atan2(normal.z),
            pitch_rad: (-normal.x).asin(),
            height_m: (standing_m - rise_m) * normal.z,
            standing_m,
        }))
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
        let rows = height.div_ceil(ROWS);
        for u in (0..width).step_by(width.div_ceil(COLUMNS)) {
            let mut below = None;
            for place in (0..height).rev().step_by(rows).map(|v| seen(u, v)) {
                let pair = place.zip(std::mem::replace(&mut below, place));
                self.places.extend(pair.filter(|(place, below)| may_be_floor(place, below)).map(|(place, _)| place));
            }
        }
        let weigh = |place: &Vector3<f64>| {
            let distance_m = place.xy().norm();
            (near_m(distance_m), distance_m.max(0.5).powi(-2))
        };
        self.weighed.clear();
        self.weighed.extend(self.places.iter().map(weigh));
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

    /// How many places lie on it. Those at its edge count for less.
    fn held_by(&self, plane: &Plane) -> f64 {
        let weight = |(place, (near_m, weight)): (&Vector3<f64>, &(f64, f64))| {
            let off = (place.z - plane.height_m(place.x, place.y)) / near_m;
            (1.0 - off * off).max(0.0) * weight
        };
        self.places.iter().zip(&self.weighed).map(weight).sum()
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
    /// pitch, degrees, and height, metres; `None`: no floor.
    fn found(ground_m: impl Fn(f64, f64) -> f64) -> Option<[f64; 3]> {
        let header = camera_160();
        let attitude = Stance::default().attitude(&header, &seen(&header, &ground_m), 0.30).expect("a frame")?;
        Some([attitude.roll_rad.to_degrees(), attitude.pitch_rad.to_degrees(), attitude.height_m])
    }

    fn is_found(what: &str, off_deg: f64, ground_m: impl Fn(f64, f64) -> f64) {
        let [roll_deg, pitch_deg, height_m] = found(ground_m).expect(what);
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
        is_found("a kerb down", 0.5, |x, _| if x > 0.9 { -0.1 } else { 0.0 });
        is_found("a kerb up", 0.3, |x, _| if x > 1.5 { 0.1 } else { 0.0 });
        is_found("a box", 0.2, |x, y| if x > 1.1 && y.abs() < 0.3 { 0.12 } else { 0.0 });
        is_found("a wall ahead", 0.5, |x, _| if x > 1.2 { 2.0 } else { 0.0 });
        is_found("a wall beside", 0.2, |_, y| if y > 0.4 { 2.0 } else { 0.0 });
        is_found("a corridor", 0.2, |_, y| if y.abs() > 0.7 { 2.0 } else { 0.0 });
    }

    #[test]
    fn without_floor_in_view_there_is_none() {
        assert_eq!(found(|x, _| if x > 0.6 { 2.0 } else { 0.0 }), None);
        let (header, mut stance) = (camera_160(), Stance::default());
        assert_eq!(stance.attitude(&header, &[0; 160 * 120], 0.30), Ok(None));
        assert!(stance.attitude(&header, &[0; 7], 0.30).is_err());
    }

    #[test]
    fn a_gentle_ramp_is_taken_for_a_tilt_and_no_slope_for_more_than_twelve_degrees() {
        for slope in [-1.0 / 12.0, 1.0 / 12.0] {
            let [_, pitch_deg, _] = found(|x, _| x * slope).expect("a floor");
            assert!((pitch_deg - (3.0 + slope.atan().to_degrees())).abs() < 0.5, "{pitch_deg}");
        }
        for slope in [-0.3, -0.2, 0.2, 0.3] {
            let found = found(|x, _| if x > 0.3 { (x - 0.3) * slope } else { 0.0 });
            assert!(found.is_none_or(|[_, pitch_deg, _]| pitch_deg.abs() < 12.0), "{found:?}");
        }
        // The body's own 3 degrees and these 11 are together more than it can tell.
        assert_eq!(found(|x, _| x / 5.0), None);
    }
}
