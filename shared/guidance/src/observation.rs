//! What a learnt policy sees: one encoder, for training and for the robot.
//!
//! Lidar, camera and memory are laid out by bearing about the robot, in [`SECTORS`] sectors; beside them stand the
//! robot's pose in the cue's start frame, the cue (Kim et al. 2023, section 5.1), where the handler is, and the last
//! motion. All numbers are about 0 to 1.

use std::f64::consts::{PI, TAU};

use messages::CueKind;

use crate::depth::DepthView;
use crate::handler::HandlerBody;
use crate::memory::Memory;
use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2, about_bearing_rad};

/// The observation and its version: a model that was trained on another one is refused.
pub const OBSERVATION: &str = "sectors-pose-cue-handler-motion/2";
/// Sectors about the robot, counter-clockwise from straight behind: 3 degrees each.
pub const SECTORS: usize = 120;
/// What is told of each sector: how far the lidar sees, whether it sees, and what camera and memory know beside it.
pub const CHANNELS: usize = 3;
/// Pose (4), cue (4), handler (2), last motion (3).
pub const STATE: usize = 13;
/// Numbers of one observation: the channels one after the other, then the state.
pub const LENGTH: usize = CHANNELS * SECTORS + STATE;

/// So many observations are stacked at the most.
pub const FRAMES_MAX: usize = 16;

/// The width of a sector.
const SECTOR_RAD: f64 = TAU / SECTORS as f64;
/// A lidar this near to the robot's middle is in it, metres.
const MIDDLE_M: f64 = 1e-3;
/// Farther is as far, metres.
const RANGE_M: f64 = 12.0;
/// Places in the cue's start frame are told in this unit, metres.
const PLACE_M: f64 = 10.0;

/// What an observation is made from, all seen from where the robot is now.
#[derive(Debug, Clone, Copy)]
pub struct Senses<'a> {
    /// The newest scan.
    pub beams: &'a Beams,
    /// The newest depth frame, where there is one.
    pub depth: Option<&'a DepthView>,
    /// What was seen before.
    pub memory: Option<&'a Memory>,
    /// Where the handler is taken to be: what ends on them is no obstacle.
    pub handler: HandlerBody,
    /// The robot in the cue's start frame.
    pub start_from_robot: Se2,
    /// The robot of now in its frame of the decision before.
    pub before_from_robot: Se2,
    /// The cue in force.
    pub cue: CueKind,
}

/// Writes the observation: [`LENGTH`] numbers.
///
/// # Panics
/// Where `out` has another length.
pub fn encode(senses: &Senses<'_>, out: &mut [f32]) {
    assert_eq!(out.len(), LENGTH, "an observation has {LENGTH} numbers");
    let (sectors, state) = out.split_at_mut(CHANNELS * SECTORS);
    let (ranges, others) = sectors.split_at_mut(SECTORS);
    let (known, near) = others.split_at_mut(SECTORS);
    ranges.fill(0.0);
    known.fill(0.0);
    near.fill(1.0);
    encode_lidar(senses, ranges, known);
    let mut stands = |place: Point, nearer_m: f64| {
        if !senses.handler.masks(place) {
            let away = closeness((place.coords.norm() - nearer_m).max(0.0));
            let sector = &mut near[sector_of(place)];
            *sector = sector.min(away);
        }
    };
    for place in senses.depth.map_or(&[][..], DepthView::points) {
        stands(*place, 0.0);
    }
    for spot in senses.memory.map_or(&[][..], Memory::hidden) {
        stands(spot.place, spot.uncertainty_m);
    }
    encode_state(senses, state);
}

/// The observations of the last few decisions, the newest last.
#[derive(Debug, Clone)]
pub struct Frames {
    numbers: Vec<f32>,
}

impl Frames {
    /// Room for so many, at least one.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { numbers: vec![0.0; count.max(1) * LENGTH] }
    }

    /// Adds the newest. What was seen before a cue was given has no place in its frame: with `begins` all are the
    /// newest.
    pub fn push(&mut self, senses: &Senses<'_>, begins: bool) {
        self.numbers.copy_within(LENGTH.., 0);
        let kept = self.numbers.len() - LENGTH;
        let (older, newest) = self.numbers.split_at_mut(kept);
        encode(senses, newest);
        if begins {
            older.chunks_exact_mut(LENGTH).for_each(|frame| frame.copy_from_slice(newest));
        }
    }

    /// All of them, one after the other.
    #[must_use]
    pub fn senses(&self) -> &[f32] {
        &self.numbers
    }
}

/// Each beam speaks for the sectors that it and half of the gap to its neighbours fall into; of several, the nearest.
fn encode_lidar(senses: &Senses<'_>, ranges: &mut [f32], known: &mut [f32]) {
    let (beams, fan) = (senses.beams, senses.beams.fan());
    let half = beams.increment_rad() / 2.0 / SECTOR_RAD;
    // Seen from the lidar itself the beams' bearings are known beforehand.
    let is_middle = beams.origin().coords.norm() < MIDDLE_M;
    let mut nearest_m = [f64::INFINITY; SECTORS];
    for (i, beam) in beams.beams().iter().enumerate() {
        let on_handler = beam.kind == BeamKind::Hit && senses.handler.masks(beam.end);
        if beam.kind == BeamKind::Unknown || on_handler {
            continue;
        }
        let middle = if is_middle { turns(fan.bearing_rad(i)) } else { turn_of(beam.end) };
        let away_m = if is_middle { beam.reading_m } else { beam.end.coords.norm() };
        for sector in (middle - half).floor() as i64..=(middle + half).floor() as i64 {
            let nearest_m = &mut nearest_m[sector.rem_euclid(SECTORS as i64) as usize];
            *nearest_m = nearest_m.min(away_m);
        }
    }
    for (sector, away_m) in nearest_m.into_iter().enumerate().filter(|(_, away_m)| away_m.is_finite()) {
        (ranges[sector], known[sector]) = (closeness(away_m), 1.0);
    }
}

fn encode_state(senses: &Senses<'_>, state: &mut [f32]) {
    let pose = &senses.start_from_robot;
    let handler = senses.handler.center;
    let motion = &senses.before_from_robot;
    let is = |cue: CueKind| f64::from(u8::from(senses.cue == cue));
    let numbers: [f64; STATE] = [
        (pose.translation.x / PLACE_M).clamp(-3.0, 3.0),
        (pose.translation.y / PLACE_M).clamp(-3.0, 3.0),
        pose.rotation.angle().sin(),
        pose.rotation.angle().cos(),
        is(CueKind::Forward),
        is(CueKind::Left),
        is(CueKind::Right),
        is(CueKind::Stop),
        handler.x.clamp(-2.0, 2.0),
        handler.y.clamp(-2.0, 2.0),
        (motion.translation.x * 4.0).clamp(-2.0, 2.0),
        (motion.translation.y * 4.0).clamp(-2.0, 2.0),
        (motion.rotation.angle() * 4.0).clamp(-2.0, 2.0),
    ];
    for (out, number) in state.iter_mut().zip(numbers) {
        *out = number as f32;
    }
}

/// A distance between 0 and 1, finer where it is near.
fn closeness(distance_m: f64) -> f32 {
    ((1.0 + distance_m.min(RANGE_M)).ln() / (1.0 + RANGE_M).ln()) as f32
}

/// A bearing in sectors from straight behind.
fn turns(bearing_rad: f64) -> f64 {
    (bearing_rad + PI) / SECTOR_RAD
}

fn turn_of(place: Point) -> f64 {
    turns(about_bearing_rad(place.coords))
}

fn sector_of(place: Point) -> usize {
    (turn_of(place) as usize).min(SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::{CHANNELS, LENGTH, SECTORS, Senses, encode};
    use crate::handler::HandlerBody;
    use crate::scan::Beams;
    use crate::scan::tests::header;
    use crate::se2::{Point, Se2, se2};
    use messages::{CueKind, Pose2};

    fn beams(range_m: impl Fn(f64) -> f64) -> Beams {
        let header = header();
        let range = |i: u16| range_m(header.angle_min_rad + f64::from(i) * header.angle_increment_rad) as f32;
        let ranges: Vec<f32> = (0..360).map(range).collect();
        let mut beams = Beams::default();
        beams.fill(&header, &ranges).expect("usable");
        beams
    }

    fn observe(beams: &Beams, cue: CueKind) -> [f32; LENGTH] {
        let handler =
            HandlerBody { center: Point::new(-0.75, -0.35), radius_m: 0.25, mask_radius_m: Some(0.3), seen: None };
        let senses = Senses {
            beams,
            depth: None,
            memory: None,
            handler,
            start_from_robot: se2(Pose2::new(5.0, -1.0, 0.5)),
            before_from_robot: Se2::identity(),
            cue,
        };
        let mut out = [9.0; LENGTH];
        encode(&senses, &mut out);
        out
    }

    #[test]
    fn what_stands_ahead_is_in_the_middle_sector_and_nothing_is_as_far_as_the_lidar_sees() {
        let seen = observe(&beams(|angle| if angle.abs() < 0.02 { 2.0 } else { f64::INFINITY }), CueKind::Left);
        let ahead = SECTORS / 2;
        assert!((seen[ahead] - 3f32.ln() / 13f32.ln()).abs() < 1e-3);
        assert!((seen[ahead + 10] - 11f32.ln() / 13f32.ln()).abs() < 1e-3 && seen[SECTORS + ahead] == 1.0);
        assert!(seen[2 * SECTORS..CHANNELS * SECTORS].iter().all(|near| *near == 1.0));
        assert_eq!(seen[CHANNELS * SECTORS + 4..CHANNELS * SECTORS + 8], [0.0, 1.0, 0.0, 0.0]);
        assert!((seen[CHANNELS * SECTORS] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn what_says_nothing_and_the_handler_are_unknown() {
        let right = |angle: f64| if (-1.6..-1.4).contains(&angle) { f64::NAN } else { 5.0 };
        let seen = observe(&beams(right), CueKind::Forward);
        let sector = ((std::f64::consts::PI - 1.5) / std::f64::consts::TAU * SECTORS as f64) as usize;
        assert_eq!((seen[sector], seen[SECTORS + sector]), (0.0, 0.0));
        let toward: f64 = (-0.35f64).atan2(-0.75);
        let seen = observe(&beams(|angle| if (angle - toward).abs() < 0.2 { 0.7 } else { 5.0 }), CueKind::Forward);
        let sector = ((std::f64::consts::PI + toward) / std::f64::consts::TAU * SECTORS as f64) as usize;
        assert_eq!(seen[SECTORS + sector], 0.0);
    }

    #[test]
    fn a_lidar_of_few_beams_leaves_no_sector_between_them_out() {
        let mut header = header();
        header.angle_increment_rad = std::f64::consts::TAU / 60.0;
        let mut sparse = Beams::default();
        sparse.fill(&header, &[4.0; 60]).expect("usable");
        assert!(observe(&sparse, CueKind::Forward)[SECTORS..2 * SECTORS].iter().all(|known| *known == 1.0));
    }
}
