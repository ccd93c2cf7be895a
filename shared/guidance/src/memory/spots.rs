//! Places that were seen, in the odometry frame: at most one for each cell.

use nalgebra::Vector2;

use super::{MemoryConfig, Odometer, REACH_M};
use crate::se2::{Point, Se2};

/// Side of a cell: it keeps one point, metres.
pub(super) const CELL_M: f64 = 0.05;
/// Cells along one side of what is remembered.
const SIDE: i32 = 160;
/// Spots for which room is made at first.
pub(super) const SPOTS: usize = 2048;
/// Nearer than this a camera says well enough where something is, metres. From farther off a wall may look so much
/// nearer than the lidar has it that something seems to stand before it.
const EXACT_M: f64 = 2.0;
/// A point that is seen again moves by this share of the difference: the sensor's noise is averaged.
const GAIN: f64 = 0.4;
/// Evidence for what the camera saw: each frame counts 1 up to this distance, metres, and less with the square of a
/// greater one, as the pixel's footprint grows.
const FOOTPRINT_M: f64 = 1.0;
/// An edge is told with this much evidence of two frames or more: they saw it from 2 m.
const EDGE_TOLD: f64 = 0.5;
/// A column of pixels crosses an edge at another place in each frame. Sightings up to this many cells apart count as
/// one edge.
const EDGE_BESIDE: i32 = 2;
/// With this much evidence it is there. With less it may be the noise of a frame, and is let go sooner.
const ENOUGH: f64 = 2.0;
/// Places of one step are at most so far apart, metres.
const JOINED_M: f64 = 0.12;
/// No spot that near is more cells away.
const JOINED_CELLS: i32 = 3;
/// A step that the handler allowed may be taken for so much way, metres: until the handler is over it.
const ALLOWED_FOR_M: f64 = 3.0;
/// It is allowed where it is so high as told, give or take, metres.
const ALLOWED_OFF_M: f64 = 0.03;
/// Farther than this from their middle nothing belongs to the handler, neither an arm nor a bag, metres.
const APART_M: f64 = 0.5;
/// More evidence than this makes no edge surer: frames that see floor there can still take it away.
const EDGE_SURE: f64 = 4.0;

/// What saw a place, and may see that nothing is there any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    Lidar,
    Camera,
    /// The camera, of the last floor before a drop.
    Edge,
    /// The camera, of a step in the floor.
    Step,
}

/// What the newest scan and frame said of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sight {
    /// It cannot be seen from here.
    Hidden,
    /// It could be seen: it goes, unless it is seen again.
    Due,
    /// It was seen again.
    Seen,
}

/// A place that was seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    cell: (i32, i32),
    pub odom: Point,
    /// How high over the camera it was seen, at the most, metres. Of a step, how much the floor rises there.
    pub rise_m: f64,
    pub source: Source,
    pub sight: Sight,
    pub seen_ns: u64,
    pub seen_at: Odometer,
    /// It is kept for so long after that.
    pub kept_ns: u64,
    /// Of camera frames, see [`ENOUGH`], and the last frame that counts in it.
    evidence: f64,
    frame: u64,
    /// Frames that saw it, or an edge beside it.
    frames: u32,
    /// The last frame that saw floor there.
    denied_by: u64,
    /// Of a step, the way in which it was seen (odometry frame): along it the floor rises so.
    pub onward: Vector2<f64>,
    /// How far the robot had come when the handler allowed this step, metres.
    allowed_at_m: f64,
    /// A sensor saw it while the handler was farther than [`APART_M`] away: it is not a part of the handler.
    pub is_apart: bool,
}

impl Spot {
    /// Whether it may be the noise of a frame.
    pub fn is_doubtful(&self) -> bool {
        self.source != Source::Lidar && self.evidence < ENOUGH
    }

    /// A frame sees from a distance, metres, that there is no edge: whether any evidence for it is left.
    pub fn outweighs(&mut self, distance_m: f64, frame: u64) -> bool {
        if frame != self.denied_by {
            (self.evidence, self.denied_by) = (self.evidence - weight(distance_m), frame);
        }
        self.evidence > 0.0
    }

    /// Whether the handler allows this step.
    pub fn is_allowed(&self, at: Odometer) -> bool {
        at.walked_m - self.allowed_at_m < ALLOWED_FOR_M
    }

    /// Whether a step is one with another: they lead the same way, and are equally high.
    fn is_as_high_as(&self, other: &Self) -> bool {
        (self.rise_m > 0.0) == (other.rise_m > 0.0) && (self.rise_m - other.rise_m).abs() <= ALLOWED_OFF_M
    }

    /// Whether more than one frame saw it, near enough to count.
    pub fn was_seen_again(&self) -> bool {
        self.frames > 1 && self.evidence >= EDGE_TOLD
    }
}

/// When, where and in which frame of the camera something is seen.
#[derive(Debug)]
pub(super) struct Sighting<'a> {
    pub seen_ns: u64,
    pub seen_at: Odometer,
    pub frame: u64,
    pub odom_from_robot: &'a Se2,
    /// Where the handler is, robot frame.
    pub handler: Option<Point>,
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Spots {
    spots: Vec<Spot>,
    /// For each cell the number of its spot and one more; 0: none. Cells repeat every [`SIDE`].
    numbers: Vec<u16>,
}

impl Spots {
    pub fn new() -> Self {
        Self { spots: Vec::with_capacity(SPOTS), numbers: vec![0; (SIDE * SIDE) as usize] }
    }

    pub fn iter(&self) -> impl Iterator<Item = &Spot> {
        self.spots.iter()
    }

    /// Keeps what `wanted` says.
    pub fn keep(&mut self, mut wanted: impl FnMut(&mut Spot) -> bool) {
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

    /// Takes over all of another odometry frame that more than one frame of the camera saw, as if the robot had walked
    /// so far since, metres. The handler has allowed none of them.
    pub fn take_over(&mut self, others: &Self, now_from_then: &Se2, walked_m: f64) {
        for spot in others.iter().filter(|spot| spot.was_seen_again()) {
            let odom = now_from_then * spot.odom;
            let seen_at = Odometer { walked_m: spot.seen_at.walked_m - walked_m, ..spot.seen_at };
            let cell = cell_of(odom);
            let number = &mut self.numbers[slot_of(cell)];
            if *number == 0 {
                let allowed_at_m = f64::NEG_INFINITY;
                self.spots.push(Spot { cell, odom, seen_at, sight: Sight::Hidden, allowed_at_m, ..*spot });
                *number = self.spots.len() as u16;
            }
        }
    }

    /// The handler allows the step at a place (odometry frame), from one side to the other: all spots of it that lead
    /// the same way and are equally high. It goes from spot to spot over neighbouring cells.
    pub fn allow(&mut self, odom: Point, walked_m: f64) {
        let is_joined = |spot: &Spot, at: Point| spot.was_seen_again() && (spot.odom - at).norm() <= JOINED_M;
        let first = self.beside(cell_of(odom), JOINED_CELLS).find(|spot| is_joined(spot, odom));
        let Some(told) = first.copied() else { return };
        self.allow_where(walked_m, |_, spot| spot.is_as_high_as(&told) && is_joined(spot, odom));
        let goes_on = |spots: &Self, spot: &Spot| {
            let is_allowed = |other: &Spot| {
                other.allowed_at_m == walked_m && other.is_as_high_as(&told) && is_joined(spot, other.odom)
            };
            spot.is_as_high_as(&told) && spots.beside(spot.cell, JOINED_CELLS).any(is_allowed)
        };
        while self.allow_where(walked_m, goes_on) {}
    }

    /// The handler allows no step any more.
    pub fn allow_none(&mut self) {
        self.spots.iter_mut().for_each(|spot| spot.allowed_at_m = f64::NEG_INFINITY);
    }

    /// Marks the spots for which that holds: whether there were new ones.
    fn allow_where(&mut self, walked_m: f64, holds: impl Fn(&Self, &Spot) -> bool) -> bool {
        let mut any = false;
        for i in 0..self.spots.len() {
            let is_new = self.spots[i].allowed_at_m != walked_m && holds(self, &self.spots[i]);
            if is_new {
                self.spots[i].allowed_at_m = walked_m;
                any = true;
            }
        }
        any
    }

    /// The spots of a cell and of the cells around it, up to `cells` away.
    fn beside(&self, (i, j): (i32, i32), cells: i32) -> impl Iterator<Item = &Spot> {
        let about = (-cells..=cells).flat_map(move |up| (-cells..=cells).map(move |on| (i + on, j + up)));
        about.filter_map(|cell| {
            let number = usize::from(self.numbers[slot_of(cell)]).checked_sub(1)?;
            Some(&self.spots[number]).filter(|spot| spot.cell == cell)
        })
    }

    /// Adds what other frames saw of the edge, up to [`EDGE_BESIDE`] cells away.
    fn count_edges_beside(&self, spot: &mut Spot) {
        let (mut frames, mut evidence, source) = (0, 0.0_f64, spot.source);
        for other in self.beside(spot.cell, EDGE_BESIDE).filter(|other| other.source == source) {
            // What this frame has added to one of them is not added again.
            let is_new = other.frame == spot.frame;
            if spot.is_as_high_as(other) {
                spot.allowed_at_m = spot.allowed_at_m.max(other.allowed_at_m);
            }
            frames = frames.max(other.frames - u32::from(is_new));
            evidence = evidence.max(other.evidence - if is_new { spot.evidence } else { 0.0 });
        }
        (spot.frames, spot.evidence) = (spot.frames + frames, spot.evidence + evidence);
    }

    /// A place (robot frame) that is seen, so high over the camera.
    pub fn see(&mut self, by: &Sighting<'_>, place: Point, rise_m: f64, source: Source, config: &MemoryConfig) {
        let distance_m = place.coords.norm();
        if distance_m >= REACH_M {
            return;
        }
        let Sighting { seen_ns, seen_at, frame, odom_from_robot, handler } = *by;
        let odom = odom_from_robot * place;
        let (cell, kept_ns, sight) = (cell_of(odom), config.kept_ns, Sight::Seen);
        let evidence = weight(distance_m);
        let mut spot = Spot {
            cell,
            odom,
            rise_m,
            source,
            sight,
            seen_ns,
            seen_at,
            kept_ns,
            evidence,
            frame,
            frames: 1,
            denied_by: 0,
            allowed_at_m: f64::NEG_INFINITY,
            is_apart: handler.is_none_or(|handler| (place - handler).norm() > APART_M),
            onward: odom_from_robot.rotation * place.coords / distance_m.max(f64::MIN_POSITIVE),
        };
        if matches!(source, Source::Edge | Source::Step) {
            self.count_edges_beside(&mut spot);
            spot.evidence = spot.evidence.min(EDGE_SURE);
            // No drop and no step goes away by itself.
            spot.kept_ns = if spot.was_seen_again() { u64::MAX } else { kept_ns };
        }
        let number = &mut self.numbers[slot_of(cell)];
        let Some(i) = usize::from(*number).checked_sub(1) else {
            self.spots.push(spot);
            *number = self.spots.len() as u16;
            return;
        };
        let old = self.spots[i];
        if old.cell == cell {
            // The lidar that meets its edge takes nothing from what the camera knows of it.
            spot.evidence = spot.evidence.max(old.evidence);
            spot.rise_m = match source {
                // From its other side it leads the other way.
                Source::Step if old.onward.dot(&spot.onward) < 0.0 || old.rise_m * rise_m < 0.0 => rise_m,
                Source::Step => old.rise_m + (rise_m - old.rise_m) * GAIN,
                _ => rise_m.max(old.rise_m),
            };
            spot.kept_ns = spot.kept_ns.max(old.kept_ns);
            spot.is_apart |= old.is_apart;
        }
        if old.cell == cell && old.source == source {
            spot.odom = old.odom + (odom - old.odom) * GAIN;
            if source == Source::Camera {
                spot.evidence = if frame == old.frame { old.evidence } else { old.evidence + evidence };
            }
        }
        if source == Source::Camera && distance_m < EXACT_M && !spot.is_doubtful() {
            spot.kept_ns = config.kept_off_plane_ns;
        }
        self.spots[i] = spot;
    }
}

/// What a frame of the camera counts from a distance, metres.
fn weight(distance_m: f64) -> f64 {
    (FOOTPRINT_M / distance_m).powi(2).min(1.0)
}

pub(super) fn cell_of(odom: Point) -> (i32, i32) {
    ((odom.x / CELL_M).floor() as i32, (odom.y / CELL_M).floor() as i32)
}

fn slot_of((i, j): (i32, i32)) -> usize {
    (j.rem_euclid(SIDE) * SIDE + i.rem_euclid(SIDE)) as usize
}

#[cfg(test)]
impl Spots {
    pub fn all(&self) -> &[Spot] {
        &self.spots
    }

    /// Every spot is found by its cell, and no cell points elsewhere.
    pub fn is_consistent(&self) -> bool {
        let found = |i: usize| usize::from(self.numbers[slot_of(self.spots[i].cell)]) == i + 1;
        (0..self.spots.len()).all(found)
            && self.numbers.iter().filter(|number| **number > 0).count() == self.spots.len()
    }
}

#[cfg(test)]
impl Spot {
    pub fn cell(&self) -> (i32, i32) {
        self.cell
    }
}
