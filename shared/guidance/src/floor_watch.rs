//! Whether the camera watches the floor at all: it shows some, and it is mounted as the configuration says.

use std::collections::VecDeque;

use messages::{Attitude, DepthHeader, NS_PER_S, age_ns};
use nalgebra::Vector2;

use crate::depth::{DepthView, Stance};
use crate::se2::Se2;

/// A frame is looked at so often, nanoseconds.
const EVERY_NS: u64 = NS_PER_S / 5;
/// The camera shows no floor in so many of those frames in a row: two seconds.
const SILENT: u32 = 10;
/// The mount is told by so many of them in which the robot walked: two and a half seconds, five strides.
const WALKED: usize = 12;
/// Its mean is off by more than this on an axis, radians: two degrees. An attitude is off by half a degree.
const OFF_RAD: f64 = 0.035;
/// The robot walks ahead at this speed or more, metres per second, and not faster than this aside: it leans there.
const WALKS_MPS: f64 = 0.1;
/// Frames that are farther apart do not follow each other, nanoseconds.
const APART_NS: u64 = NS_PER_S;

/// What is wrong with the view of the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FloorTrouble {
    /// The camera shows no floor, though nothing stands before it.
    NoFloor,
    /// The camera is not mounted as the configuration says.
    Tilted,
}

/// Where the robot was at a frame, and how it was held.
#[derive(Debug, Clone, Copy)]
pub struct Stood<'a> {
    /// Where it was.
    pub odom_from_robot: &'a Se2,
    /// Roll and pitch as a source of its own tells them, radians. None where only the camera tells them.
    pub attitude: Option<&'a Attitude>,
}

/// Roll and pitch, radians, of the body over the floor as the camera sees it, and the same less what is told of them.
#[derive(Debug, Clone, Copy)]
struct Lean {
    seen: Vector2<f64>,
    beyond_told: Vector2<f64>,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub struct FloorWatch {
    stance: Stance,
    last: Option<(u64, Se2)>,
    silent: u32,
    leans: VecDeque<Lean>,
}

impl FloorWatch {
    /// Nothing was seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self { leans: VecDeque::with_capacity(WALKED + 1), ..Self::default() }
    }

    /// A frame came, of which the newest view was made.
    pub fn take(&mut self, header: &DepthHeader, pixels_mm: &[u16], view: Option<&DepthView>, stood: &Stood<'_>) {
        let stamp_ns = header.header.stamp_ns;
        let since_ns = self.last.map_or(u64::MAX, |(last_ns, _)| age_ns(stamp_ns, last_ns));
        if since_ns < EVERY_NS {
            return;
        }
        let before = self.last.replace((stamp_ns, *stood.odom_from_robot));
        match view.and_then(DepthView::shows_any_floor) {
            Some(true) => self.silent = 0,
            Some(false) => self.silent += 1,
            None => {}
        }
        let walks = before.filter(|_| since_ns < APART_NS).is_some_and(|(_, odom_from_before)| {
            let way = (odom_from_before.inverse() * stood.odom_from_robot).translation.vector;
            let least_m = WALKS_MPS * since_ns as f64 / NS_PER_S as f64;
            way.x >= least_m && way.y.abs() < least_m
        });
        if walks && let Ok(Some(seen)) = self.stance.attitude(header, pixels_mm, header.robot_from_camera.z_m) {
            self.lean(&seen, stood.attitude);
        }
    }

    fn lean(&mut self, seen: &Attitude, told: Option<&Attitude>) {
        let of = |attitude: &Attitude| Vector2::new(attitude.roll_rad, attitude.pitch_rad);
        let seen = of(seen);
        if self.leans.len() == WALKED {
            self.leans.pop_front();
        }
        // On a slope the floor leans as the body does. A body that leans by itself tells of it, if anything does.
        self.leans.push_back(Lean { seen, beyond_told: told.map_or(seen, |told| seen - of(told)) });
    }

    /// What is wrong with the view of the floor, if anything.
    #[must_use]
    pub fn trouble(&self) -> Option<FloorTrouble> {
        if self.silent >= SILENT {
            return Some(FloorTrouble::NoFloor);
        }
        let is_off = |of: fn(&Lean) -> Vector2<f64>| {
            let sum: Vector2<f64> = self.leans.iter().map(of).sum();
            sum.amax() > OFF_RAD * WALKED as f64
        };
        let is_tilted = self.leans.len() == WALKED && is_off(|lean| lean.seen) && is_off(|lean| lean.beyond_told);
        is_tilted.then_some(FloorTrouble::Tilted)
    }

    /// What was seen so far counts no more.
    pub fn begin_anew(&mut self) {
        (self.silent, self.last) = (0, None);
        self.leans.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::{FloorTrouble, FloorWatch, Stood};
    use crate::depth::DepthView;
    use crate::depth::ramp_tests::seen;
    use crate::depth::tests::{camera_160, held};
    use crate::se2::Se2;
    use messages::{Attitude, DepthHeader};

    const MS: u64 = 1_000_000;

    /// A walk of so many seconds at 0.5 m/s over such ground, of a camera that is mounted otherwise than its header
    /// says by so much, radians: what is wrong after each second.
    fn walk(ground_m: impl Fn(f64, f64) -> f64, off_rad: f64, told: Option<[f64; 2]>) -> Vec<Option<FloorTrouble>> {
        let (header, mut watch, mut view) = (camera_160(), FloorWatch::new(), DepthView::default());
        let pixels_mm = seen(&header, &ground_m);
        let mut troubles = Vec::new();
        for frame in 0..90_u64 {
            let mut header = DepthHeader { ..header };
            header.header.stamp_ns = (1000 + 33 * frame) * MS;
            header.robot_from_camera.pitch_rad += off_rad;
            let _ = view.fill_tilted(&header, &pixels_mm, Some(&held(2.0, 3.0)));
            let at = Se2::translation(0.0165 * frame as f64, 0.0);
            let attitude = told.map(|[roll_deg, pitch_deg]| {
                Attitude::at_height(header.header.stamp_ns, roll_deg.to_radians(), pitch_deg.to_radians(), 0.3)
            });
            watch.take(&header, &pixels_mm, Some(&view), &Stood { odom_from_robot: &at, attitude: attitude.as_ref() });
            if frame % 30 == 29 {
                troubles.push(watch.trouble());
            }
        }
        troubles
    }

    /// A floor that leans as the body does: height at a place, metres.
    fn along_the_body(x_m: f64, y_m: f64) -> f64 {
        let slope = |deg: f64| deg.to_radians().tan();
        y_m * slope(2.0) - x_m * slope(3.0)
    }

    #[test]
    fn a_mount_that_is_three_degrees_off_is_told_within_three_seconds() {
        for (off_rad, told) in [(-0.0524, Some([0.0, 0.0])), (0.0524, Some([0.0, 0.0])), (0.0524, None)] {
            assert_eq!(walk(along_the_body, off_rad, told)[2], Some(FloorTrouble::Tilted), "{off_rad}");
        }
    }

    #[test]
    fn neither_a_ramp_nor_a_body_that_leans_is_a_wrong_mount() {
        let level = Some([0.0, 0.0]);
        assert_eq!(walk(|_, _| 0.0, 0.0, level)[2], Some(FloorTrouble::Tilted), "nothing else tells that it leans");
        assert_eq!(walk(|_, _| 0.0, 0.0, Some([2.0, 3.0])), [None; 3], "it leans, and says so");
        assert_eq!(walk(along_the_body, 0.0, Some([2.0, 3.0])), [None; 3], "on a ramp");
        assert_eq!(walk(along_the_body, 0.0, None), [None; 3], "nothing tells how it is held");
    }

    #[test]
    fn a_camera_that_shows_no_floor_is_told_within_three_seconds_and_a_wall_is_none() {
        let hidden = |x: f64, _: f64| if x > 4.0 { 2.0 } else { f64::NEG_INFINITY };
        assert_eq!(walk(hidden, 0.0, None)[2], Some(FloorTrouble::NoFloor));
        assert_eq!(
            walk(|x, _| if x > 0.9 { 2.0 } else { 0.0 }, 0.0, Some([2.0, 3.0]))[2],
            None,
            "a wall stands before it"
        );
    }
}
