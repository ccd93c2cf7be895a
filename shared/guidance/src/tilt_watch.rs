//! Whether the camera looks where its configured mount says.
//!
//! A camera that is knocked out of its mount sees near and far floor rise at once, and by the same. A ramp comes into
//! view from afar: its far end rises first, and the robot walks most of a metre until the floor at its feet rises.

use messages::{NS_PER_S, age_ns};
use nalgebra::Vector2;

use crate::depth::{DepthView, Slopes};
use crate::se2::Se2;

/// Least time between two frames that are looked at, nanoseconds.
const EVERY_NS: u64 = NS_PER_S * 9 / 50;
/// Two looks tell of a knock where they are no farther apart than this: nanoseconds, metres, radians.
const APART_NS: u64 = NS_PER_S * 7 / 10;
const WAY_M: f64 = 0.35;
const TURN_RAD: f64 = 0.25;
/// The floor rises by at least this, per metre: 1.7 degrees,
const OFF: f64 = 0.03;
/// and the near and the far floor by the same, give or take a degree.
const ALIKE: f64 = 0.0175;
/// A camera that is knocked comes to rest within this, nanoseconds.
const MOVES_NS: u64 = NS_PER_S;
/// It is told after this many looks: a second at five a second.
const LOOKS: u32 = 5;
/// At a start where the floor goes on level from the robot, it is told after this way, metres. On that way, a ramp
/// right before the robot comes nearer and looks steeper.
const BEGUN_M: f64 = 0.5;
/// The floor within this distance to either side of the robot tells whether it goes on level, metres.
const ASIDE_M: f64 = 0.3;

/// A frame that was looked at.
#[derive(Debug, Clone, Copy)]
struct Look {
    stamp_ns: u64,
    odom_from_robot: Se2,
    slopes: Slopes,
}

/// The camera may be tilted.
#[derive(Debug, Clone, Copy)]
struct Suspicion {
    /// The floor as it was seen before.
    before: Slopes,
    /// The first look that showed this tilt, and the stamp of the first that showed any, nanoseconds.
    first: Look,
    began_ns: u64,
    /// It needs the way [`BEGUN_M`] to be told.
    needs_way: bool,
    /// The camera was knocked, perhaps in more than one look; else it was off from the start.
    is_knock: bool,
    /// Looks that showed it, less those that did not.
    looks: u32,
    is_told: bool,
}

/// Compares the floor that the camera sees with the one that it saw a moment ago. At a start it is compared with
/// gravity.
#[derive(Debug, Clone, Default)]
pub struct TiltWatch {
    last: Option<Look>,
    /// A look showed no tilt.
    has_begun: bool,
    suspicion: Option<Suspicion>,
}

impl TiltWatch {
    /// A frame of that stamp came, of which the newest view was made, seen from there. One that cannot be used has
    /// none, and says nothing.
    pub fn take(&mut self, stamp_ns: u64, odom_from_robot: &Se2, view: Option<&DepthView>) {
        let Some(view) = view else { return };
        if self.last.is_some_and(|last| age_ns(stamp_ns, last.stamp_ns) < EVERY_NS) {
            return;
        }
        let Some(slopes) = view.slopes() else { return };
        let look = Look { stamp_ns, odom_from_robot: *odom_from_robot, slopes };
        let last = self.last.replace(look);
        if let Some(suspicion) = self.suspicion {
            self.suspicion = suspicion.held_against(&look);
            self.has_begun |= self.suspicion.is_none();
            return;
        }
        self.has_begun |= !is_tilted(&Slopes::LEVEL, &slopes);
        let suspect = |before, needs_way, is_knock| Suspicion {
            before,
            first: look,
            began_ns: stamp_ns,
            needs_way,
            is_knock,
            looks: 1,
            is_told: false,
        };
        if let Some(last) = last.filter(|last| is_knock(last, &look)) {
            self.suspicion = Some(suspect(last.slopes, false, true));
        } else if !self.has_begun {
            let goes_on_level = view.level_floor_from_m(-ASIDE_M, ASIDE_M).is_some();
            self.suspicion = Some(suspect(Slopes::LEVEL, goes_on_level, false));
        }
    }

    /// Whether the camera is tilted against its configured mount, or the robot began on a slope. It stays so until the
    /// camera sees the floor again as before.
    #[must_use]
    pub fn is_tilted(&self) -> bool {
        self.suspicion.is_some_and(|suspicion| suspicion.is_told)
    }
}

impl Suspicion {
    /// What the next look makes of it; none: it was unfounded, or is over.
    fn held_against(self, look: &Look) -> Option<Self> {
        let is_as_first = (look.slopes.near - self.first.slopes.near).norm() <= ALIKE;
        let is_off = is_tilted(&self.before, &look.slopes);
        let is_moving = self.is_knock && !self.is_told && age_ns(look.stamp_ns, self.began_ns) <= MOVES_NS;
        if is_off && is_moving && !is_as_first {
            return Some(Self { first: *look, looks: 1, ..self });
        }
        let is_tilted = is_off && (self.is_told || is_as_first);
        let looks = if is_tilted { (self.looks + 1).min(LOOKS) } else { self.looks - 1 };
        let has_way = !self.needs_way || way_m(&self.first, look) >= BEGUN_M;
        let is_told = self.is_told || looks == LOOKS && has_way;
        (looks > 0).then_some(Self { looks, is_told, ..self })
    }
}

fn way_m(from: &Look, to: &Look) -> f64 {
    (from.odom_from_robot.inverse() * to.odom_from_robot).translation.vector.norm()
}

/// Whether near and far floor rise otherwise than before, and by the same.
fn is_tilted(before: &Slopes, now: &Slopes) -> bool {
    let (near, far): (Vector2<f64>, Vector2<f64>) = (now.near - before.near, now.far - before.far);
    near.norm() >= OFF && far.norm() >= OFF && (near - far).norm() <= ALIKE
}

fn is_knock(before: &Look, now: &Look) -> bool {
    let turned = before.odom_from_robot.rotation.inverse() * now.odom_from_robot.rotation;
    age_ns(now.stamp_ns, before.stamp_ns) <= APART_NS
        && way_m(before, now) <= WAY_M
        && turned.angle().abs() <= TURN_RAD
        && is_tilted(&before.slopes, &now.slopes)
}

#[cfg(test)]
mod tests {
    use super::TiltWatch;
    use crate::depth::DepthView;
    use crate::depth::ramp_tests::seen;
    use crate::depth::tests::{camera_160, held};
    use crate::se2::{Se2, se2};
    use messages::{DepthHeader, Pose2};

    /// A camera whose pitch is off by an angle, degrees.
    fn mounted(off_deg: f64) -> DepthHeader {
        let mut header = camera_160();
        header.robot_from_camera.pitch_rad += off_deg.to_radians();
        header
    }

    fn at(x_m: f64) -> Se2 {
        se2(Pose2 { x_m, ..Pose2::default() })
    }

    /// Watches a robot that walks at 0.5 m/s, five frames a second, on a floor of that height. From frame `off_from` on
    /// the mount is off by `off_deg`. Gives the frame after which the tilt is told.
    fn told_at(frames: u64, ground_m: impl Fn(f64) -> f64, off_from: u64, off_deg: f64) -> Option<u64> {
        told_with(frames, ground_m, |frame| if frame >= off_from { off_deg } else { 0.0 })
    }

    /// The same, where `off_deg` gives how far the mount is off at each frame, degrees.
    fn told_with(frames: u64, ground_m: impl Fn(f64) -> f64, off_deg: impl Fn(u64) -> f64) -> Option<u64> {
        let (mut watch, mut view) = (TiltWatch::default(), DepthView::default());
        (0..frames).find(|frame| {
            let here_m = 0.1 * *frame as f64;
            let pixels = seen(&mounted(0.0), &|x, _| ground_m(here_m + x) - ground_m(here_m));
            view.fill_tilted(&mounted(off_deg(*frame)), &pixels, Some(&held(2.5, 3.4))).expect("usable");
            watch.take(200_000_000 * (frame + 5), &at(here_m), Some(&view));
            watch.is_tilted()
        })
    }

    #[test]
    fn a_camera_that_is_knocked_is_told_within_a_second_and_a_half_and_one_that_was_off_from_the_start_too() {
        for off_deg in [-6.0, -3.0, 3.0, 6.0] {
            assert_eq!(told_at(20, |_| 0.0, 7, off_deg), Some(11), "{off_deg}");
            assert!(told_at(20, |_| 0.0, 0, off_deg).is_some_and(|frame| (4..=6).contains(&frame)), "{off_deg}");
        }
        let moving = |frame: u64| 2.0 * frame.saturating_sub(6).min(3) as f64;
        assert_eq!(told_with(20, |_| 0.0, moving), Some(13), "in three looks, by 2 degrees each");
        assert_eq!(told_at(20, |_| 0.0, 7, 1.0), None, "one degree is no more than an attitude is off");
    }

    #[test]
    fn ramps_steps_and_stairs_are_no_tilt() {
        for slope in [-1.0 / 12.0, 1.0 / 12.0] {
            // Nearer ones begin where the floor would have to go on level.
            for from_m in [0.8, 1.0, 1.3, 1.7] {
                let told = told_at(15, |x| slope * (x - from_m).max(0.0), u64::MAX, 0.0);
                assert_eq!(told, None, "a ramp of {slope} from {from_m} m on");
            }
        }
        for slope in [-0.16, -0.05, 0.05, 0.16] {
            let ramp = |x: f64| slope * (x - 2.0).clamp(0.0, 4.0);
            assert_eq!(told_at(50, ramp, u64::MAX, 0.0), None, "a ramp of {slope}");
        }
        for rise_m in [-0.5, -0.1, -0.05, 0.05, 0.17] {
            assert_eq!(
                told_at(20, |x| if x > 3.0 { rise_m } else { 0.0 }, u64::MAX, 0.0),
                None,
                "a step of {rise_m} m"
            );
            let stairs = |x: f64| rise_m.signum() * 0.17 * ((x - 2.0) / 0.28).floor().max(0.0);
            assert_eq!(told_at(15, stairs, u64::MAX, 0.0), None, "stairs");
        }
    }

    #[test]
    fn a_tilt_is_over_once_the_floor_looks_as_before() {
        let (mut watch, mut view) = (TiltWatch::default(), DepthView::default());
        let pixels = seen(&mounted(0.0), &|_, _| 0.0);
        let mut told = Vec::new();
        for frame in 0..30 {
            let header = mounted(if (5..15).contains(&frame) { 3.0 } else { 0.0 });
            view.fill_tilted(&header, &pixels, Some(&held(2.0, 3.0))).expect("usable");
            watch.take(200_000_000 * (frame + 5), &at(0.0), Some(&view));
            told.push(watch.is_tilted());
        }
        assert!(!told[8] && told[9] && told[18] && !told[19], "{told:?}");
    }

    #[test]
    fn a_frame_of_a_body_whose_attitude_is_not_known_tells_nothing() {
        let mut view = DepthView::default();
        view.fill_tilted(&mounted(0.0), &seen(&mounted(0.0), &|_, _| 0.0), Some(&held(2.0, 3.0))).expect("usable");
        assert!(view.slopes().is_some());
        view.fill(&mounted(0.0), &seen(&mounted(0.0), &|_, _| 0.0)).expect("usable");
        assert!(view.slopes().is_none());
    }
}
