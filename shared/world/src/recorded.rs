//! The social force model held against recorded tracks: each recorded pedestrian walks again among the others, who stay
//! on their tracks, from their first place towards their last; once on a straight line, once by the model.

use guidance::se2::Point;
use nalgebra::Vector2;

use crate::people::social::{Mover, SocialForce};
use crate::tracks::Track;

/// Pedestrians whose first and last place are nearer than this have no goal that one could tell: they stand or stroll.
/// They are among the others, and do not walk again, metres.
pub const WALKED_M: f64 = 2.0;
/// Pairs that keep farther from each other than this say nothing about keeping clear, metres.
pub const NEAR_M: f64 = 2.0;
/// Two pedestrians are companions where they are in view together for this long, seconds,
const TOGETHER_S: f64 = 2.0;
/// are no farther apart than this, in the mean and at the most, metres,
const COMPANIONS_M: [f64; 2] = [1.2, 2.5];
/// and both walk, metres per second: those who stand beside each other wait.
const WALKS_MPS: f64 = 0.4;
/// Pairs nearer than this nearly touch, metres.
const TOUCH_M: f64 = 0.5;
/// A pair has come nearer than the recorded one where it is by more than this, metres.
const NEARER_M: f64 = 0.1;
/// Radius of a pedestrian, metres.
const RADIUS_M: f64 = 0.25;
/// The longest step, seconds.
const STEP_S: f64 = 0.05;

/// How a pedestrian walks again.
#[derive(Debug, Clone, Copy)]
pub enum Again<'a> {
    /// As recorded.
    Recorded,
    /// At a constant velocity that leads from the first place to the last one in the recorded time.
    Straight,
    /// By the model, with the recorded mean speed and the last place as goal.
    Social(&'a SocialForce),
}

/// A recording, and who walks with whom in it.
#[derive(Debug, Clone)]
pub struct Recording {
    tracks: Vec<Track>,
    frame_s: f64,
    companions: Vec<Vec<usize>>,
}

/// What came of it, over all who walked again.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Figures {
    /// How many walked again.
    pub pedestrians: usize,
    /// Mean over them of the mean distance to where they were recorded at the same time, metres.
    pub displacement_m: f64,
    /// Mean of their mean speeds, metres per second.
    pub speed_mps: f64,
    /// Of pairs of strangers, those that come within [`NEAR_M`] as recorded or on the straight line.
    pub strangers: Pairs,
    /// Of companions.
    pub companions: Pairs,
}

/// The least distances of pairs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pairs {
    /// How many pairs; each counts once for each of the two who walks again.
    pub count: usize,
    /// Mean least distance, metres.
    pub least_m: f64,
    /// Mean difference to the recorded least distance, metres.
    pub error_m: f64,
    /// Share of pairs that come nearer than recorded, by over 0.1 m.
    pub nearer: f64,
    /// Share of pairs that come nearer than 0.5 m.
    pub touching: f64,
}

impl Pairs {
    fn add(&mut self, recorded_m: f64, least_m: f64) {
        self.count += 1;
        self.least_m += least_m;
        self.error_m += (least_m - recorded_m).abs();
        self.nearer += f64::from(u8::from(least_m < recorded_m - NEARER_M));
        self.touching += f64::from(u8::from(least_m < TOUCH_M));
    }

    fn mean(self) -> Self {
        let count = self.count.max(1) as f64;
        Self {
            least_m: self.least_m / count,
            error_m: self.error_m / count,
            nearer: self.nearer / count,
            touching: self.touching / count,
            ..self
        }
    }
}

impl Recording {
    /// A recording at this frame rate.
    #[must_use]
    pub fn new(tracks: Vec<Track>, frames_hz: f64) -> Self {
        let mut recording = Self { companions: vec![Vec::new(); tracks.len()], tracks, frame_s: 1.0 / frames_hz };
        for one in 0..recording.tracks.len() {
            for two in one + 1..recording.tracks.len() {
                if recording.walk_together(one, two) {
                    recording.companions[one].push(two);
                    recording.companions[two].push(one);
                }
            }
        }
        recording
    }

    /// How many walk in company.
    #[must_use]
    pub fn in_company(&self) -> usize {
        self.companions.iter().filter(|others| !others.is_empty()).count()
    }

    /// All who walk somewhere walk again.
    #[must_use]
    pub fn walk(&self, again: Again<'_>) -> Figures {
        let mut figures = Figures::default();
        for number in (0..self.tracks.len()).filter(|number| self.tracks[*number].straight_m() >= WALKED_M) {
            let (track, walked) = (&self.tracks[number], self.again(number, again));
            let off = walked.iter().zip(&track.places).map(|(is, was)| (is - was).norm());
            figures.pedestrians += 1;
            figures.displacement_m += off.sum::<f64>() / walked.len() as f64;
            let way_m: f64 = walked.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
            figures.speed_mps += way_m / ((walked.len() - 1) as f64 * self.frame_s);
            let straight = self.again(number, Again::Straight);
            for other in (0..self.tracks.len()).filter(|other| *other != number) {
                let least_m = |walked: &[Point]| self.least_m(number, walked, other);
                let Some(recorded_m) = least_m(&track.places) else { continue };
                let near = recorded_m < NEAR_M || least_m(&straight).is_some_and(|least_m| least_m < NEAR_M);
                let is_companion = self.companions[number].contains(&other);
                let pairs = if is_companion { &mut figures.companions } else { &mut figures.strangers };
                if let Some(least_m) = least_m(&walked).filter(|_| near) {
                    pairs.add(recorded_m, least_m);
                }
            }
        }
        let count = figures.pedestrians.max(1) as f64;
        Figures {
            displacement_m: figures.displacement_m / count,
            speed_mps: figures.speed_mps / count,
            strangers: figures.strangers.mean(),
            companions: figures.companions.mean(),
            ..figures
        }
    }

    /// Where a pedestrian who walks again is in each frame of their track.
    fn again(&self, number: usize, again: Again<'_>) -> Vec<Point> {
        let places = &self.tracks[number].places;
        let (first, last) = (places[0], places[places.len() - 1]);
        match again {
            Again::Recorded => places.clone(),
            Again::Straight => {
                let steps = (places.len() - 1).max(1) as f64;
                (0..places.len()).map(|step| first + (last - first) * (step as f64 / steps)).collect()
            }
            Again::Social(law) => self.by_law(number, law),
        }
    }

    fn by_law(&self, number: usize, law: &SocialForce) -> Vec<Point> {
        let track = &self.tracks[number];
        let (first, goal) = (track.places[0], track.places[track.places.len() - 1]);
        let speed_mps = track.length_m() / ((track.places.len() - 1) as f64 * self.frame_s);
        let mut own = Mover { at: first, velocity: (goal - first).normalize() * speed_mps, radius_m: RADIUS_M };
        let (mut walked, parts) = (vec![first], (self.frame_s / STEP_S).ceil());
        let part_s = self.frame_s / parts;
        for step in 1..track.places.len() as u32 {
            let frame = track.first_frame + step - 1;
            let (group, others) = self.around(number, frame);
            for _ in 0..parts as usize {
                let to_goal = goal - own.at;
                // At the goal they stay.
                if to_goal.norm() <= speed_mps * part_s {
                    own = Mover { at: goal, velocity: Vector2::zeros(), ..own };
                    break;
                }
                let desired = to_goal.normalize() * speed_mps;
                let pushed = others.iter().fold(Vector2::zeros(), |sum, other| sum + law.from_other(&own, other));
                let acceleration = law.towards(&own, desired) + law.in_group(&own, desired, &group) + pushed;
                own.velocity = law.next_velocity(&own, acceleration, speed_mps, part_s);
                own.at += own.velocity * part_s;
            }
            walked.push(own.at);
        }
        walked
    }

    /// Companions and strangers in a frame, as they were recorded.
    fn around(&self, number: usize, frame: u32) -> (Vec<Mover>, Vec<Mover>) {
        let (mut group, mut others) = (Vec::new(), Vec::new());
        for (other, track) in self.tracks.iter().enumerate().filter(|(other, _)| *other != number) {
            let Some(at) = track.at(frame) else { continue };
            let velocity = self.velocity(track, frame);
            let is_companion = self.companions[number].contains(&other);
            if is_companion { &mut group } else { &mut others }.push(Mover { at, velocity, radius_m: RADIUS_M });
        }
        (group, others)
    }

    /// The velocity up to a frame; in the first one, that to the next.
    fn velocity(&self, track: &Track, frame: u32) -> Vector2<f64> {
        let ends = (frame.checked_sub(1).and_then(|before| track.at(before)), track.at(frame), track.at(frame + 1));
        match ends {
            (Some(before), Some(now), _) => (now - before) / self.frame_s,
            (None, Some(now), Some(after)) => (after - now) / self.frame_s,
            _ => Vector2::zeros(),
        }
    }

    /// The least distance between a pedestrian who walks again and another one on their track; none where they are
    /// never in view together.
    fn least_m(&self, number: usize, walked: &[Point], other: usize) -> Option<f64> {
        let (first, other) = (self.tracks[number].first_frame, &self.tracks[other]);
        let apart = walked.iter().zip(first..).filter_map(|(at, frame)| Some((other.at(frame)? - at).norm()));
        apart.min_by(f64::total_cmp)
    }

    fn walk_together(&self, one: usize, two: usize) -> bool {
        let (one, two) = (&self.tracks[one], &self.tracks[two]);
        let first = one.first_frame.max(two.first_frame);
        let last = [one, two].map(|track| track.first_frame + track.places.len() as u32).into_iter().min();
        let frames = first..last.unwrap_or(first).max(first);
        let count = frames.len() as f64;
        if count * self.frame_s < TOGETHER_S {
            return false;
        }
        let walks = |track: &Track| {
            let ends = (track.at(frames.start), track.at(frames.end - 1));
            let (Some(from), Some(to)) = ends else { return false };
            (to - from).norm() > WALKS_MPS * count * self.frame_s
        };
        let apart = |frame| Some((one.at(frame)? - two.at(frame)?).norm());
        let (sum, most) =
            frames.clone().filter_map(apart).fold((0.0, 0.0_f64), |(sum, most), m| (sum + m, most.max(m)));
        walks(one) && walks(two) && sum / count < COMPANIONS_M[0] && most < COMPANIONS_M[1]
    }
}
