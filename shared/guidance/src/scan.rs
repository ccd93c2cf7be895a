//! A scan in the robot frame, beam by beam.

use std::ops::Range;

use messages::{MAX_BEAMS, ScanHeader};
use nalgebra::{Point3, Vector2, Vector3};

use crate::boundary::{Directions, Readings};
use crate::se2::{Point, Se2, about_bearing_rad, pose2, se2};
use crate::tilt::Tilt;

/// No lidar's beams are nearer to each other, radians.
const INCREMENT_MIN_RAD: f64 = 1e-6;
/// Beyond it angles lose the digits that tell beams apart, radians.
const ANGLE_MAX_RAD: f64 = 1e4;
/// A lidar that is less exact is none, metres: the handler's mask is three times as wide.
pub const SIGMA_MAX_M: f64 = 0.1;

/// A beam that ends lower than this met the floor: a height over the level floor, metres, and an increase per metre of
/// range for the error of the attitude.
const FLOOR_M: f64 = 0.10;
const FLOOR_PER_M: f64 = 0.02;

/// What a beam says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BeamKind {
    /// It ended on something.
    Hit,
    /// It hit nothing up to the lidar's range.
    Free,
    /// It says nothing, and what it did not see is never taken as free.
    Unknown,
}

/// One beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// What it says.
    pub kind: BeamKind,
    /// Metres from the lidar; the lidar's range where it hit nothing, 0 where it is unknown.
    pub reading_m: f64,
    /// Unit vector, robot frame.
    pub direction: Vector2<f64>,
    /// Where it ends, robot frame.
    pub end: Point,
}

/// Why a scan cannot be used. The driver, or whoever recorded it, is at fault.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScanError {
    /// No beams, or more than the topic table has room for.
    #[error("a scan of {0} beams, not 1 to {MAX_BEAMS}")]
    Count(usize),
    /// Angles, ranges or the mounting pose are not finite, or make no sense.
    #[error("the scan's {0} is not usable")]
    Geometry(&'static str),
    /// No beam says anything.
    #[error("all {0} beams are unknown")]
    AllUnknown(usize),
}

/// A scan taken to the robot frame. Reused from scan to scan, so that a steady state allocates nothing.
///
/// The beams are kept in the order in which they turn counter-clockwise, whichever way the lidar turns.
#[derive(Debug, Clone, Default)]
pub struct Beams {
    beams: Vec<Beam>,
    /// The beams' directions once more, apart, for who works on many side by side.
    x: Vec<f64>,
    y: Vec<f64>,
    /// The beams' readings likewise; infinite where a beam is unknown.
    readings: Readings,
    unknown: Vec<usize>,
    origin: Vector2<f64>,
    first_rad: f64,
    increment_rad: f64,
    sigma_m: f64,
    whole_turn: bool,
    /// The lidar turns clockwise: the first beam here is its last.
    reversed: bool,
    layout: Layout,
}

/// What the directions of a scan follow from: a lidar keeps it, and its sines and cosines with it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Layout {
    first_rad: f64,
    increment_rad: f64,
    count: usize,
}

impl Beams {
    /// Takes in a scan.
    ///
    /// # Errors
    /// Where the scan cannot be used; the beams are then empty.
    pub fn fill(&mut self, header: &ScanHeader, ranges_m: &[f32]) -> Result<(), ScanError> {
        self.fill_with(header, ranges_m.len(), |i| f64::from(ranges_m[i]))?;
        if self.unknown.len() == self.beams.len() {
            let count = self.beams.len();
            self.clear();
            return Err(ScanError::AllUnknown(count));
        }
        Ok(())
    }

    /// The same with readings from wherever they are, in the lidar's order, metres; NaN says nothing, and all may say
    /// nothing: who judges then, judges on that.
    ///
    /// # Errors
    /// Where the scan cannot be used but for that; there are no beams then.
    pub fn fill_with(
        &mut self,
        header: &ScanHeader,
        count: usize,
        range_m: impl Fn(usize) -> f64,
    ) -> Result<(), ScanError> {
        self.beams.clear();
        check(header, count).inspect_err(|_| self.clear())?;
        let robot_from_lidar: Se2 = se2(header.robot_from_lidar);
        self.origin = robot_from_lidar.translation.vector;
        self.increment_rad = header.angle_increment_rad.abs();
        self.sigma_m = header.sigma_m;
        self.whole_turn = self.increment_rad * (count as f64 + 0.5) >= std::f64::consts::TAU;
        self.reversed = header.angle_increment_rad < 0.0;
        let last = header.angle_min_rad + (count - 1) as f64 * header.angle_increment_rad;
        self.first_rad = pose2(&robot_from_lidar).yaw_rad + if self.reversed { last } else { header.angle_min_rad };
        self.turn_to(count);
        self.unknown.clear();
        for i in 0..count {
            let direction = Vector2::new(self.x[i], self.y[i]);
            let (kind, reading_m) = classify(range_m(self.number(i, count)), header);
            self.beams.push(Beam { kind, reading_m, direction, end: Point::from(self.origin + direction * reading_m) });
            if kind == BeamKind::Unknown {
                self.unknown.push(i);
            }
        }
        self.sort_readings();
        Ok(())
    }

    /// No beams, and nothing that speaks of any.
    fn clear(&mut self) {
        self.beams.clear();
        self.unknown.clear();
        self.x.clear();
        self.y.clear();
        self.layout = Layout::default();
        self.sort_readings();
    }

    /// Projects the beams of a lidar on a tilted body to the level floor. `height_m` is the height of the lidar's plane
    /// on a level body. A beam that met the floor, or would have, is free up to there and unknown behind. With a height
    /// of 0 (not known) no beam counts as one that met the floor.
    ///
    /// Beams keep their bearings: at 5 degrees of roll and pitch the error is below half a degree.
    pub fn level(&mut self, tilt: &Tilt, height_m: f64) {
        let lidar_m = tilt.place(Point3::new(self.origin.x, self.origin.y, height_m)).z;
        for beam in self.beams.iter_mut().filter(|beam| beam.kind != BeamKind::Unknown) {
            let way = tilt.direction(Vector3::new(beam.direction.x, beam.direction.y, 0.0));
            let floor_m = if height_m > 0.0 { to_floor_m(lidar_m, way.z) } else { f64::INFINITY };
            if beam.reading_m >= floor_m {
                (beam.kind, beam.reading_m) = (BeamKind::Free, floor_m);
            }
            beam.reading_m *= way.xy().norm();
            beam.end = Point::from(self.origin + beam.direction * beam.reading_m);
        }
        self.sort_readings();
    }

    /// The readings that a lidar over the level floor would give, in the lidar's order, metres: NaN for an unknown
    /// beam, infinite for a beam that met nothing but floor.
    pub fn ranges_m(&self, ranges_m: &mut Vec<f32>) {
        ranges_m.clear();
        ranges_m.extend((0..self.beams.len()).map(|i| {
            let beam = self.beams[self.number(i, self.beams.len())];
            match beam.kind {
                BeamKind::Hit => beam.reading_m as f32,
                BeamKind::Free => f32::INFINITY,
                BeamKind::Unknown => f32::NAN,
            }
        }));
    }

    fn sort_readings(&mut self) {
        let known = |beam: &Beam| if beam.kind == BeamKind::Unknown { f64::INFINITY } else { beam.reading_m };
        self.readings.fill(self.beams.iter().map(known));
    }

    /// Computes the directions, where they are not those of the scan before.
    fn turn_to(&mut self, count: usize) {
        let layout = Layout { first_rad: self.first_rad, increment_rad: self.increment_rad, count };
        if self.layout == layout && self.x.len() == count {
            return;
        }
        self.layout = layout;
        let angle = |i: usize| layout.first_rad + i as f64 * layout.increment_rad;
        self.x.clear();
        self.y.clear();
        self.x.extend((0..count).map(|i| angle(i).cos()));
        self.y.extend((0..count).map(|i| angle(i).sin()));
    }

    /// The lidar's own number of a beam.
    #[must_use]
    pub fn number_of(&self, beam: usize) -> usize {
        self.number(beam, self.beams.len())
    }

    fn number(&self, beam: usize, count: usize) -> usize {
        if self.reversed { count - 1 - beam } else { beam }
    }

    /// The beams' directions, robot frame.
    #[must_use]
    pub fn directions(&self) -> Directions<'_> {
        Directions { x: &self.x, y: &self.y, first_rad: self.first_rad, increment_rad: self.increment_rad }
    }

    /// The same beams seen from where the robot is now, into `seen`: `now_from_stamped` is the robot of the scan's
    /// stamp in the robot frame of now.
    pub fn seen_from(&self, now_from_stamped: &Se2, seen: &mut Self) {
        if *now_from_stamped == Se2::identity() {
            seen.copy_from(self);
            return;
        }
        seen.beams.clear();
        let turned = self.beams.iter().map(|beam| Beam {
            direction: now_from_stamped.rotation * beam.direction,
            end: now_from_stamped * beam.end,
            ..*beam
        });
        seen.beams.extend(turned);
        seen.x.clear();
        seen.y.clear();
        seen.x.extend(seen.beams.iter().map(|beam| beam.direction.x));
        seen.y.extend(seen.beams.iter().map(|beam| beam.direction.y));
        // These directions are of no layout.
        seen.layout = Layout::default();
        seen.first_rad = self.first_rad + now_from_stamped.rotation.angle();
        seen.reversed = self.reversed;
        seen.origin = (now_from_stamped * Point::from(self.origin)).coords;
        (seen.increment_rad, seen.sigma_m, seen.whole_turn) = (self.increment_rad, self.sigma_m, self.whole_turn);
        seen.readings.copy_from(&self.readings);
        seen.unknown.clone_from(&self.unknown);
    }

    /// Takes over another's; `clone_from` would allocate.
    fn copy_from(&mut self, other: &Self) {
        // Every field by its name: a new one cannot be forgotten.
        let Self {
            beams,
            x,
            y,
            readings,
            unknown,
            origin,
            first_rad,
            increment_rad,
            sigma_m,
            whole_turn,
            reversed,
            layout,
        } = other;
        self.beams.clone_from(beams);
        self.x.clone_from(x);
        self.y.clone_from(y);
        self.readings.copy_from(readings);
        self.unknown.clone_from(unknown);
        (self.origin, self.first_rad, self.increment_rad) = (*origin, *first_rad, *increment_rad);
        (self.sigma_m, self.whole_turn, self.reversed, self.layout) = (*sigma_m, *whole_turn, *reversed, *layout);
    }

    /// The beams, counter-clockwise.
    #[must_use]
    pub fn beams(&self) -> &[Beam] {
        &self.beams
    }

    /// The readings of the beams that say something.
    #[must_use]
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// The beams that say nothing, in rising order.
    #[must_use]
    pub fn unknown(&self) -> &[usize] {
        &self.unknown
    }

    /// Where the lidar is, robot frame.
    #[must_use]
    pub fn origin(&self) -> Point {
        Point::from(self.origin)
    }

    /// Angle from one beam to the next, radians, positive.
    #[must_use]
    pub fn increment_rad(&self) -> f64 {
        self.increment_rad
    }

    /// One standard deviation of a reading, metres.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.sigma_m
    }

    /// Whether the last beam is the neighbour of the first.
    #[must_use]
    pub fn is_whole_turn(&self) -> bool {
        self.whole_turn
    }

    /// Where the beams go.
    #[must_use]
    pub fn fan(&self) -> Fan {
        Fan {
            origin: self.origin(),
            first_rad: self.first_rad,
            increment_rad: self.increment_rad,
            count: self.beams.len(),
            whole_turn: self.whole_turn,
        }
    }
}

/// Where the beams of a scan go, counter-clockwise, without what they say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fan {
    /// Where the lidar is.
    pub origin: Point,
    first_rad: f64,
    increment_rad: f64,
    count: usize,
    whole_turn: bool,
}

impl Fan {
    /// Where a beam goes, robot frame, radians.
    #[must_use]
    pub fn bearing_rad(&self, beam: usize) -> f64 {
        self.first_rad + beam as f64 * self.increment_rad
    }

    /// The beams to the right and to the left of the way to a point; none outside the field of view.
    #[must_use]
    pub fn beside(&self, point: Point) -> Option<(usize, usize)> {
        let to = point - self.origin;
        let turn = (to.y.atan2(to.x) - self.first_rad).rem_euclid(std::f64::consts::TAU);
        let right = (turn / self.increment_rad) as usize;
        match (right + 1, self.count) {
            (left, count) if left < count => Some((right, left)),
            (left, count) if self.whole_turn && left > 0 && count > 0 => Some((count - 1, 0)),
            _ => None,
        }
    }

    /// Beams among which are all that pass within `radius_m` of a point: one run, or two where it goes over the end.
    #[must_use]
    pub fn towards(&self, point: Point, radius_m: f64) -> [Range<usize>; 2] {
        let to = point - self.origin;
        let distance_m = to.norm();
        if distance_m <= radius_m {
            return [0..self.count, 0..0];
        }
        let half_rad = (radius_m / distance_m).asin() + self.increment_rad;
        let begin_rad = (to.y.atan2(to.x) - half_rad - self.first_rad).rem_euclid(std::f64::consts::TAU);
        let index = |rad: f64| ((rad / self.increment_rad) as usize).min(self.count);
        let end_rad = begin_rad + 2.0 * half_rad;
        // Wide beams may be in both; each is told once.
        let over = index(end_rad - std::f64::consts::TAU);
        [0..over, index(begin_rad).max(over)..index(end_rad)]
    }

    /// The beam that passes nearest to a point, as far as it lies within the field of view.
    #[must_use]
    pub fn nearest(&self, point: Point) -> Option<usize> {
        let to = point - self.origin;
        // Half an increment to the right of the first beam is nearest to it.
        let turn = about_bearing_rad(to) - self.first_rad + self.increment_rad / 2.0;
        let beam = (turn.rem_euclid(std::f64::consts::TAU) / self.increment_rad) as usize;
        match beam {
            beam if beam < self.count => Some(beam),
            _ if self.whole_turn && self.count > 0 => Some(0),
            _ => None,
        }
    }
}

pub(crate) fn check(header: &ScanHeader, count: usize) -> Result<(), ScanError> {
    if count == 0 || count > MAX_BEAMS {
        return Err(ScanError::Count(count));
    }
    let increment = header.angle_increment_rad;
    if !(header.angle_min_rad.abs() < ANGLE_MAX_RAD && increment.is_finite() && increment.abs() > INCREMENT_MIN_RAD) {
        return Err(ScanError::Geometry("angles"));
    }
    // Half a beam over a whole turn is rounding; more would be seen twice.
    if increment.abs() * (count as f64 - 1.5) > std::f64::consts::TAU {
        return Err(ScanError::Geometry("field of view"));
    }
    let (min, max) = (header.range_min_m, header.range_max_m);
    if !(min.is_finite() && max.is_finite() && min >= 0.0 && min < max) {
        return Err(ScanError::Geometry("range"));
    }
    if !(0.0..=SIGMA_MAX_M).contains(&header.sigma_m) {
        return Err(ScanError::Geometry("sigma"));
    }
    if !header.robot_from_lidar.is_finite() {
        return Err(ScanError::Geometry("mounting pose"));
    }
    Ok(())
}

/// Range at which a beam that rises by `rise` per metre reaches the floor, metres.
fn to_floor_m(lidar_m: f64, rise: f64) -> f64 {
    let falls = FLOOR_PER_M - rise;
    if falls > 0.0 { (lidar_m - FLOOR_M).max(0.0) / falls } else { f64::INFINITY }
}

pub(crate) fn classify(range_m: f64, header: &ScanHeader) -> (BeamKind, f64) {
    if range_m.is_nan() || range_m < header.range_min_m {
        (BeamKind::Unknown, 0.0)
    } else if range_m >= header.range_max_m {
        (BeamKind::Free, header.range_max_m)
    } else {
        (BeamKind::Hit, range_m)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{BeamKind, Beams, ScanError};
    use crate::se2::{Point, se2};
    use messages::{Pose2, ScanHeader};

    /// A lidar of 360 beams at the robot's origin that reads 0.1 to 10 m.
    pub(crate) fn header() -> ScanHeader {
        ScanHeader {
            angle_min_rad: -std::f64::consts::PI,
            angle_increment_rad: std::f64::consts::TAU / 360.0,
            range_min_m: 0.1,
            range_max_m: 10.0,
            sigma_m: 0.01,
            ..ScanHeader::default()
        }
    }

    #[test]
    fn readings_are_hit_free_or_unknown() {
        let mut ranges = [5.0f32; 360];
        (ranges[0], ranges[1], ranges[2], ranges[3], ranges[4]) = (f32::NAN, -1.0, 0.05, f32::INFINITY, 10.0);
        let mut beams = Beams::default();
        beams.fill(&header(), &ranges).expect("usable");
        let kinds: Vec<_> = beams.beams()[..6].iter().map(|beam| beam.kind).collect();
        use BeamKind::{Free, Hit, Unknown};
        assert_eq!(kinds, [Unknown, Unknown, Unknown, Free, Free, Hit]);
        assert!(beams.is_whole_turn());
    }

    #[test]
    fn a_mounting_pose_moves_the_ends() {
        let mut header = header();
        header.robot_from_lidar = Pose2::new(0.2, 0.1, std::f64::consts::FRAC_PI_2);
        let mut beams = Beams::default();
        beams.fill(&header, &[2.0; 360]).expect("usable");
        // Beam 180 looks along the lidar's x axis, which is the robot's y axis.
        let end = beams.beams()[180].end;
        assert!((end.x - 0.2).abs() < 1e-9 && (end.y - 2.1).abs() < 1e-9);
    }

    #[test]
    fn a_robot_that_moved_on_sees_the_same_ends() {
        let (mut beams, mut seen) = (Beams::default(), Beams::default());
        beams.fill(&header(), &[2.0; 360]).expect("usable");
        // The robot has gone 0.3 m ahead and turned left by a quarter since.
        let stamped_from_now = se2(Pose2::new(0.3, 0.0, std::f64::consts::FRAC_PI_2));
        beams.seen_from(&stamped_from_now.inverse(), &mut seen);
        // Beam 180 looked ahead: now it ends to the right, 1.7 m away.
        let beam = seen.beams()[180];
        assert!((beam.end - Point::new(0.0, -1.7)).norm() < 1e-9 && (beam.reading_m - 2.0).abs() < 1e-9);
        assert!((seen.origin() - Point::new(0.0, 0.3)).norm() < 1e-9);
        assert!((seen.origin() + beam.direction * beam.reading_m - beam.end).norm() < 1e-9);
    }

    #[test]
    fn a_point_lies_between_the_beams_beside_it() {
        let mut beams = Beams::default();
        beams.fill(&header(), &[2.0; 360]).expect("usable");
        let at = |degrees: f64| Point::new(degrees.to_radians().cos(), degrees.to_radians().sin());
        let fan = beams.fan();
        assert_eq!((fan.beside(at(0.3)), fan.nearest(at(0.3))), (Some((180, 181)), Some(180)));
        assert_eq!(fan.nearest(at(0.7)), Some(181));
        // Beam 0 looks straight back: a whole turn has no gap there.
        assert_eq!((fan.beside(at(179.5)), fan.nearest(at(179.8))), (Some((359, 0)), Some(0)));
        let mut front = header();
        front.angle_min_rad = -1.0;
        front.angle_increment_rad = 0.1;
        beams.fill(&front, &[2.0; 21]).expect("usable");
        let fan = beams.fan();
        assert_eq!((fan.beside(at(58.0)), fan.nearest(at(58.0))), (None, Some(20)), "just beyond the last beam");
        assert_eq!((fan.beside(at(-58.0)), fan.nearest(at(-58.0))), (None, Some(0)));
        assert_eq!((fan.beside(at(90.0)), fan.nearest(at(90.0))), (None, None));
    }

    #[test]
    fn a_scan_that_cannot_be_used_is_refused() {
        let mut beams = Beams::default();
        assert_eq!(beams.fill(&header(), &[]), Err(ScanError::Count(0)));
        assert_eq!(beams.fill(&header(), &[f32::NAN; 360]), Err(ScanError::AllUnknown(360)));
        let mut bad = header();
        bad.angle_increment_rad = 0.0;
        assert_eq!(beams.fill(&bad, &[1.0; 360]), Err(ScanError::Geometry("angles")));
        assert_eq!(beams.fill(&header(), &[1.0; 400]), Err(ScanError::Geometry("field of view")));
        for increment in [1e-19, 5e-324, f64::NAN, f64::INFINITY] {
            bad.angle_increment_rad = increment;
            assert_eq!(beams.fill(&bad, &[1.0; 10]), Err(ScanError::Geometry("angles")), "{increment}");
        }
        let far = ScanHeader { angle_min_rad: 1e12, ..header() };
        assert_eq!(beams.fill(&far, &[1.0; 360]), Err(ScanError::Geometry("angles")));
        let vague = ScanHeader { sigma_m: 1.0, ..header() };
        assert_eq!(beams.fill(&vague, &[1.0; 360]), Err(ScanError::Geometry("sigma")), "its mask would hide the robot");
        let mut bad = header();
        bad.range_min_m = f64::NAN;
        assert_eq!(beams.fill(&bad, &[1.0; 360]), Err(ScanError::Geometry("range")));
        assert!(beams.beams().is_empty());
    }

    #[test]
    fn a_beam_that_meets_the_floor_is_free_up_to_there_and_a_wall_stands_where_it_stands() {
        use messages::Attitude;
        let attitude = Attitude { stamp_ns: 1, height_m: 0.3, standing_m: 0.3, ..Attitude::default() };
        let tilt = crate::Tilt::of(&Attitude { pitch_rad: 0.1, ..attitude }).expect("known");
        let mut beams = Beams::default();
        // The floor ahead, a wall to the left, nothing to the right, the handler behind.
        let mut ranges = vec![f32::INFINITY; 360];
        let ahead = |i: usize| i % 360;
        let (front, left, behind) = (ahead(180), ahead(270), ahead(0));
        (ranges[front], ranges[left], ranges[behind]) = (3.5, 2.0, 0.8);
        beams.fill(&header(), &ranges).expect("usable");
        let nearest = |x: f64, y: f64| beams.fan().nearest(Point::new(x, y)).expect("in the fan");
        let [front, left, behind] = [nearest(3.0, 0.0), nearest(0.0, 3.0), nearest(-3.0, 0.0)];
        beams.level(&tilt, 0.35);
        let of = |i: usize| (beams.beams()[i].kind, beams.beams()[i].reading_m);
        let (kind, free_m) = of(front);
        assert!(kind == BeamKind::Free && (1.9..3.5).contains(&free_m), "{free_m}");
        assert!(of(left).0 == BeamKind::Hit && (of(left).1 - 2.0).abs() < 0.01);
        assert!(of(behind).0 == BeamKind::Hit && (of(behind).1 - 0.8 * 0.1_f64.cos()).abs() < 0.01);
        let mut told = Vec::new();
        beams.ranges_m(&mut told);
        assert_eq!((told.len(), told[beams.number_of(front)]), (360, f32::INFINITY));
        // The height of the lidar is not known: no beam counts as one that met the floor.
        beams.fill(&header(), &ranges).expect("usable");
        beams.level(&tilt, 0.0);
        assert_eq!(beams.beams()[front].kind, BeamKind::Hit);
    }
}
