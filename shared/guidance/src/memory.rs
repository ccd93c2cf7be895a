//! What the shield remembers: obstacles that were seen and cannot be seen now, and what was seen free a moment ago.
//!
//! A shield that looks at one scan is blind behind the handler and where its sensors do not look (Kim et al. 2023,
//! sections 5 and 7). What stood there when it was last seen still stands there, as far as anybody knows. Where the
//! lidar sees now, the scan of now alone counts: memory adds nothing to it.

use std::collections::VecDeque;

use crate::contact::Contacts;
use crate::depth::DepthView;
use crate::handler::HandlerBody;
use crate::scan::{BeamKind, Beams, Fan};
use crate::se2::{Point, Se2};

/// Side of a cell: it keeps one point, metres.
const CELL_M: f64 = 0.05;
/// Cells along one side of what is remembered.
const SIDE: i32 = 160;
/// Points farther from the robot than this are let go, metres: no hull reaches so far, and twice as much is less than
/// what the cells cover.
const REACH_M: f64 = 3.9;
/// A point that is seen again moves by this share of the difference: the lidar's noise is averaged.
const GAIN: f64 = 0.4;
/// However long ago a point was seen, it is let go only once the robot has walked this far since, metres.
const WALKED_MIN_M: f64 = 1.0;
/// Who waits for so long may be walked around: what only the lidar saw is let go, nanoseconds. What the camera saw
/// stays: it lies below what the camera sees from there.
const STANDING_MAX_NS: u64 = 60_000_000_000;
/// Nearer than this a camera says well enough where something is, metres. From farther off a wall may look so much
/// nearer than the lidar has it that something seems to stand before it.
const EXACT_M: f64 = 2.0;
/// Evidence for what the camera saw: each frame counts 1 up to this distance, metres, and less with the square of a
/// greater one, as the pixel's footprint grows.
const FOOTPRINT_M: f64 = 1.0;
/// With this much evidence it is there. With less it may be the noise of a frame, and is let go sooner.
const ENOUGH: f64 = 2.0;
/// What the camera sees this near to the end of a beam, the lidar sees as well, metres.
const SAME_M: f64 = 0.15;
/// At most so many scans tell what was free a moment ago.
const GLIMPSES: usize = 8;

/// How long, and how exactly, is remembered.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryConfig {
    /// Obstacles are kept for so long after they were last seen, nanoseconds; longer while the robot stands.
    pub kept_ns: u64,
    /// What the camera alone saw, from near by and in more than one frame: it lies below the lidar's plane, or hangs
    /// above it, and does not walk away as people do. What a single frame saw is let go after `kept_ns`, also while the
    /// robot stands.
    pub kept_off_plane_ns: u64,
    /// What a scan saw free counts as free for so long, nanoseconds.
    pub free_ns: u64,
    /// By how much a remembered place is off: metres for each metre walked, and for each radian turned and metre away.
    pub drift: f64,
}

/// A remembered obstacle that cannot be seen now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Remembered {
    /// Robot frame of now.
    pub place: Point,
    /// It may be this far from there, metres.
    pub uncertainty_m: f64,
}

/// Which sensor saw a point, and may see that it is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Lidar,
    Camera,
}

/// What the newest scan and frame said of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sight {
    /// It cannot be seen from here.
    Hidden,
    /// It could be seen: it goes, unless it is seen again.
    Due,
    /// It was seen again.
    Seen,
}

/// How far the robot has come, along its way.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Odometer {
    walked_m: f64,
    turned_rad: f64,
}

impl Odometer {
    /// By how much a place seen at `then` is off when it is so far away.
    fn error_m(&self, then: &Self, drift: f64, distance_m: f64) -> f64 {
        drift * (self.walked_m - then.walked_m + (self.turned_rad - then.turned_rad) * distance_m)
    }
}

/// An obstacle.
#[derive(Debug, Clone, Copy)]
struct Spot {
    cell: (i32, i32),
    odom: Point,
    /// How high over the camera it was seen, at the most, metres.
    rise_m: f64,
    source: Source,
    sight: Sight,
    seen_ns: u64,
    seen_at: Odometer,
    /// It is kept for so long after that.
    kept_ns: u64,
    /// Of camera frames, see [`ENOUGH`], and the last frame that counts in it.
    evidence: f64,
    frame: u64,
}

impl Spot {
    /// Whether it may be the noise of a frame.
    fn is_doubtful(&self) -> bool {
        self.source == Source::Camera && self.evidence < ENOUGH
    }
}

/// What one scan saw free.
#[derive(Debug, Clone)]
struct Glimpse {
    at_ns: u64,
    at: Odometer,
    odom_from_robot: Se2,
    fan: Fan,
    sigma_m: f64,
    /// As far as each beam saw, metres; 0 where it says nothing.
    readings_m: Vec<f64>,
}

/// The memory, in the odometry frame.
#[derive(Debug, Clone)]
pub struct Memory {
    config: MemoryConfig,
    spots: Vec<Spot>,
    /// For each cell the number of its spot and one more; 0: none. Cells repeat every [`SIDE`].
    numbers: Vec<u16>,
    /// The oldest first.
    glimpses: VecDeque<Glimpse>,
    /// Of the newest scan.
    stamp_ns: u64,
    now_ns: u64,
    /// Where the robot was at the newest scan.
    odom_from_scanned: Option<Se2>,
    odom_from_robot: Se2,
    odometer: Odometer,
    hidden: Vec<Remembered>,
    contacts: Contacts,
}

impl Memory {
    /// A memory of nothing.
    #[must_use]
    pub fn new(config: MemoryConfig) -> Self {
        Self {
            config,
            spots: Vec::new(),
            numbers: vec![0; (SIDE * SIDE) as usize],
            glimpses: VecDeque::new(),
            stamp_ns: 0,
            now_ns: 0,
            odom_from_scanned: None,
            odom_from_robot: Se2::identity(),
            odometer: Odometer::default(),
            hidden: Vec::new(),
            contacts: Contacts::default(),
        }
    }

    /// Forgets everything: a new odometry frame, or a jump within one.
    pub fn clear(&mut self) {
        *self = Self::new(self.config.clone());
    }

    /// Takes in a scan of that stamp and the newest depth frame, both seen from where the robot is now, and who of the
    /// handler is in them: what ends on the handler is never remembered.
    pub fn update(
        &mut self,
        stamp_ns: u64,
        odom_from_robot: &Se2,
        beams: &Beams,
        depth: Option<&DepthView>,
        handler: &HandlerBody,
    ) {
        self.stamp_ns = stamp_ns;
        if let Some(before) = self.odom_from_scanned.replace(*odom_from_robot) {
            let moved = before.inverse() * odom_from_robot;
            self.odometer.walked_m += moved.translation.vector.norm();
            self.odometer.turned_rad += moved.rotation.angle().abs();
        }
        self.look_again(odom_from_robot, beams, depth, handler);
        for beam in beams.beams().iter().filter(|beam| beam.kind == BeamKind::Hit && !handler.masks(beam.end)) {
            self.see(odom_from_robot, beam.end, f64::NEG_INFINITY, Source::Lidar, 0);
        }
        let frame = depth.map_or(0, DepthView::number);
        let (points, rises_m) = depth.map_or((&[][..], &[][..]), |depth| (depth.points(), depth.rises_m()));
        for (point, rise_m) in points.iter().zip(rises_m) {
            if !handler.masks(*point) && !ends_at(beams, *point) {
                self.see(odom_from_robot, *point, *rise_m, Source::Camera, frame);
            }
        }
        self.keep(|spot| spot.sight != Sight::Due);
        self.glimpse(odom_from_robot, beams);
        self.move_to(stamp_ns, odom_from_robot);
    }

    /// What the new scan and frame say of each spot: each sensor sees that what it saw is gone, and nobody stands
    /// where the handler stands.
    fn look_again(&mut self, odom_from_robot: &Se2, beams: &Beams, depth: Option<&DepthView>, handler: &HandlerBody) {
        let robot_from_odom = odom_from_robot.inverse();
        let (stamp_ns, odometer) = (self.stamp_ns, self.odometer);
        // The mask is wider than the handler by what the lidar is off: there something else may stand.
        let body_m = handler.mask_radius_m.map(|mask_m| mask_m - 3.0 * beams.sigma_m());
        let on_handler = |place: Point| body_m.is_some_and(|body_m| (place - handler.center).norm() <= body_m);
        self.keep(|spot| {
            let place = robot_from_odom * spot.odom;
            let visible = match spot.source {
                Source::Lidar => on_handler(place) || sees_as_far_as(beams, place, handler),
                Source::Camera => depth.is_some_and(|depth| depth.sees_free_up_to(place, spot.rise_m)),
            };
            spot.sight = if visible { Sight::Due } else { Sight::Hidden };
            let age_ns = stamp_ns.saturating_sub(spot.seen_ns);
            let walked_on = odometer.walked_m - spot.seen_at.walked_m > WALKED_MIN_M;
            let old = age_ns > spot.kept_ns && (walked_on || spot.is_doubtful())
                || age_ns > STANDING_MAX_NS && spot.source == Source::Lidar;
            !old && place.coords.norm() < REACH_M
        });
    }

    /// Keeps what `wanted` says.
    fn keep(&mut self, mut wanted: impl FnMut(&mut Spot) -> bool) {
        let mut i = 0;
        while i < self.spots.len() {
            if wanted(&mut self.spots[i]) {
                i += 1;
                continue;
            }
            self.numbers[slot_of(self.spots[i].cell)] = 0;
            self.spots.swap_remove(i);
            if let Some(moved) = self.spots.get(i) {
                self.numbers[slot_of(moved.cell)] = i as u16 + 1;
            }
        }
    }

    /// A point that a sensor sees, so high over the camera; `frame` is the number of the camera's frame.
    fn see(&mut self, odom_from_robot: &Se2, place: Point, rise_m: f64, source: Source, frame: u64) {
        let distance_m = place.coords.norm();
        if distance_m >= REACH_M {
            return;
        }
        let odom = odom_from_robot * place;
        let cell = cell_of(odom);
        let (seen_ns, seen_at, kept_ns) = (self.stamp_ns, self.odometer, self.config.kept_ns);
        let evidence = (FOOTPRINT_M / distance_m).powi(2).min(1.0);
        let sight = Sight::Seen;
        let mut spot = Spot { cell, odom, rise_m, source, sight, seen_ns, seen_at, kept_ns, evidence, frame };
        let number = &mut self.numbers[slot_of(cell)];
        match usize::from(*number).checked_sub(1) {
            Some(i) => {
                let old = self.spots[i];
                if old.cell == cell {
                    // The lidar that meets its edge takes nothing from what the camera knows of it.
                    spot.evidence = spot.evidence.max(old.evidence);
                    spot.rise_m = spot.rise_m.max(old.rise_m);
                    spot.kept_ns = kept_ns.max(old.kept_ns);
                }
                if old.cell == cell && old.source == source {
                    spot.odom = old.odom + (odom - old.odom) * GAIN;
                    spot.evidence = if frame == old.frame { old.evidence } else { old.evidence + evidence };
                }
                if source == Source::Camera && distance_m < EXACT_M && !spot.is_doubtful() {
                    spot.kept_ns = self.config.kept_off_plane_ns;
                }
                self.spots[i] = spot;
            }
            None => {
                self.spots.push(spot);
                *number = self.spots.len() as u16;
            }
        }
    }

    fn glimpse(&mut self, odom_from_robot: &Se2, beams: &Beams) {
        let oldest = if self.glimpses.len() == GLIMPSES { self.glimpses.pop_front() } else { None };
        let mut readings_m = oldest.map(|glimpse| glimpse.readings_m).unwrap_or_default();
        readings_m.clear();
        readings_m.extend(beams.beams().iter().map(|beam| beam.reading_m));
        self.glimpses.push_back(Glimpse {
            at_ns: self.stamp_ns,
            at: self.odometer,
            odom_from_robot: *odom_from_robot,
            fan: beams.fan(),
            sigma_m: beams.sigma_m(),
            readings_m,
        });
    }

    /// From now on told as of now, from where the robot is.
    pub fn move_to(&mut self, now_ns: u64, odom_from_robot: &Se2) {
        self.now_ns = now_ns;
        self.odom_from_robot = *odom_from_robot;
        let robot_from_odom = odom_from_robot.inverse();
        self.hidden.clear();
        for spot in self.spots.iter().filter(|spot| spot.sight == Sight::Hidden) {
            let place = robot_from_odom * spot.odom;
            let uncertainty_m = self.odometer.error_m(&spot.seen_at, self.config.drift, place.coords.norm());
            self.hidden.push(Remembered { place, uncertainty_m });
        }
    }

    /// The robot was to move by `begin_from_end` from where it was, and did not get there.
    pub fn feel(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2) {
        self.contacts.feel(self.now_ns, odom_from_begin, begin_from_end);
    }

    /// Whether a motion from here leads to where one did not get before.
    #[must_use]
    pub fn meets_contact(&self, robot_from_end: &Se2) -> bool {
        self.contacts.is_met(self.now_ns, &self.odom_from_robot, robot_from_end)
    }

    /// The obstacles that cannot be seen now.
    #[must_use]
    pub fn hidden(&self) -> &[Remembered] {
        &self.hidden
    }

    /// Whether one of the last scans saw that nothing is at a point (robot frame), nor on the way to it.
    #[must_use]
    pub fn saw_free(&self, point: Point) -> bool {
        let recent = self.glimpses.iter().rev();
        let mut recent = recent.take_while(|glimpse| self.now_ns.saturating_sub(glimpse.at_ns) <= self.config.free_ns);
        recent.any(|glimpse| {
            let then = glimpse.odom_from_robot.inverse() * (self.odom_from_robot * point);
            let distance_m = (then - glimpse.fan.origin).norm();
            let error_m = self.odometer.error_m(&glimpse.at, self.config.drift, distance_m);
            let enough_m = distance_m + 3.0 * glimpse.sigma_m + error_m;
            let beside = glimpse.fan.beside(then);
            beside.is_some_and(|(a, b)| glimpse.readings_m[a] > enough_m && glimpse.readings_m[b] > enough_m)
        })
    }
}

fn cell_of(odom: Point) -> (i32, i32) {
    ((odom.x / CELL_M).floor() as i32, (odom.y / CELL_M).floor() as i32)
}

fn slot_of((i, j): (i32, i32)) -> usize {
    (j.rem_euclid(SIDE) * SIDE + i.rem_euclid(SIDE)) as usize
}

/// Whether the beam towards a place shows what is there: it passes, or ends on it.
fn sees_as_far_as(beams: &Beams, place: Point, handler: &HandlerBody) -> bool {
    let Some(beam) = beams.fan().nearest(place).map(|i| beams.beams()[i]) else { return false };
    let distance_m = (place - beams.origin()).norm();
    let on_handler = beam.kind == BeamKind::Hit && handler.masks(beam.end);
    // What the handler hides begins where the beam ends.
    let noise_m = if on_handler { 0.0 } else { CELL_M + 3.0 * beams.sigma_m() };
    beam.kind != BeamKind::Unknown && distance_m <= beam.reading_m + noise_m
}

/// Whether the beam towards a place ends there.
fn ends_at(beams: &Beams, place: Point) -> bool {
    let nearest = beams.fan().nearest(place).map(|i| beams.beams()[i]);
    nearest.is_some_and(|beam| beam.kind == BeamKind::Hit && (beam.end - place).norm() <= SAME_M)
}

#[cfg(test)]
mod tests;
