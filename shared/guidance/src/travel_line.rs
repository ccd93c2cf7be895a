//! The travel line: the middle of the way that the cue means (Kim et al. 2023, section 3). The robot is not told it;
//! who judges a walk, and who teaches one, knows it.

use crate::se2::{Point, Se2, wrap_angle};

/// Corners nearer to each other are one, metres.
const SAME_M: f64 = 1e-6;

/// A polyline with the way along it.
#[derive(Debug, Clone, PartialEq)]
pub struct TravelLine {
    corners: Vec<Point>,
    /// Way from the first corner to each, metres.
    ways_m: Vec<f64>,
}

/// Where a place is, seen from a travel line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Way along the line to the nearest point of it, metres.
    pub way_m: f64,
    /// How far beside the line the place is, metres, positive to the left.
    pub left_m: f64,
}

impl TravelLine {
    /// The line through these places; `None` where fewer than two of them differ, or one is not finite.
    #[must_use]
    pub fn new(places: &[Point]) -> Option<Self> {
        let mut line = Self { corners: Vec::with_capacity(places.len()), ways_m: Vec::with_capacity(places.len()) };
        for place in places {
            if !(place.x.is_finite() && place.y.is_finite()) {
                return None;
            }
            let step_m = line.corners.last().map_or(0.0, |last| (place - last).norm());
            if line.corners.is_empty() || step_m > SAME_M {
                line.ways_m.push(line.length_m() + step_m);
                line.corners.push(*place);
            }
        }
        (line.corners.len() > 1).then_some(line)
    }

    /// Its length, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.ways_m.last().copied().unwrap_or(0.0)
    }

    /// Its corners, the first and the last included.
    #[must_use]
    pub fn corners(&self) -> &[Point] {
        &self.corners
    }

    /// The stretch on which a way is: between the corner of that number and the next.
    fn stretch(&self, way_m: f64) -> usize {
        let after = self.ways_m.partition_point(|corner_m| *corner_m <= way_m);
        after.clamp(1, self.corners.len() - 1) - 1
    }

    /// The place on the line so far along it, facing on; the nearer end where the way is not on it.
    #[must_use]
    pub fn at(&self, way_m: f64) -> Se2 {
        let way_m = way_m.clamp(0.0, self.length_m());
        let i = self.stretch(way_m);
        let along = (self.corners[i + 1] - self.corners[i]).normalize();
        let place = self.corners[i] + along * (way_m - self.ways_m[i]);
        Se2::new(place.coords, along.y.atan2(along.x))
    }

    /// The part between two ways.
    #[must_use]
    pub fn part(&self, from_m: f64, to_m: f64) -> Option<Self> {
        let mut places = vec![Point::from(self.at(from_m).translation.vector)];
        let inner = self.corners.iter().zip(&self.ways_m).filter(|(_, way_m)| **way_m > from_m && **way_m < to_m);
        places.extend(inner.map(|(corner, _)| *corner));
        places.push(Point::from(self.at(to_m).translation.vector));
        Self::new(&places)
    }

    /// The nearest point of the line to a place.
    #[must_use]
    pub fn foot(&self, place: Point) -> Foot {
        self.foot_within(place, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// The nearest point between two ways: for who walks along and knows about where they were.
    #[must_use]
    pub fn foot_within(&self, place: Point, from_m: f64, to_m: f64) -> Foot {
        let from_m = from_m.clamp(0.0, self.length_m());
        let to_m = to_m.clamp(from_m, self.length_m());
        let mut best = (f64::INFINITY, Foot { way_m: from_m, left_m: 0.0 });
        for i in self.stretch(from_m)..=self.stretch(to_m) {
            let run = self.corners[i + 1] - self.corners[i];
            let length_m = self.ways_m[i + 1] - self.ways_m[i];
            let along = run / length_m;
            let to = place - self.corners[i];
            let part_m =
                to.dot(&along).clamp((from_m - self.ways_m[i]).max(0.0), (to_m - self.ways_m[i]).min(length_m));
            let away_m = (to - along * part_m).norm();
            if away_m < best.0 {
                let left_m = away_m.copysign(along.perp(&to));
                best = (away_m, Foot { way_m: self.ways_m[i] + part_m, left_m });
            }
        }
        best.1
    }

    /// By how much a heading differs from the line's at a way, radians, on the short arc, positive to the left.
    #[must_use]
    pub fn heading_error_rad(&self, way_m: f64, heading_rad: f64) -> f64 {
        wrap_angle(heading_rad - self.at(way_m).rotation.angle())
    }
}

#[cfg(test)]
mod tests {
    use super::TravelLine;
    use crate::se2::Point;
    use std::f64::consts::FRAC_PI_2;

    fn bend() -> TravelLine {
        TravelLine::new(&[Point::new(0.0, 0.0), Point::new(10.0, 0.0), Point::new(10.0, 5.0)]).expect("a line")
    }

    #[test]
    fn a_way_along_the_line_is_a_place_and_a_heading() {
        let line = bend();
        assert_eq!(line.length_m(), 15.0);
        let place = line.at(12.0);
        assert!((place.translation.y - 2.0).abs() < 1e-12 && (place.rotation.angle() - FRAC_PI_2).abs() < 1e-12);
        assert_eq!(line.at(-3.0).translation.x, 0.0);
        assert!((line.at(99.0).translation.y - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_place_beside_the_line_is_told_left_or_right_of_it() {
        let foot = bend().foot(Point::new(4.0, 0.5));
        assert!((foot.way_m - 4.0).abs() < 1e-12 && (foot.left_m - 0.5).abs() < 1e-12);
        let foot = bend().foot(Point::new(10.5, 3.0));
        assert!((foot.way_m - 13.0).abs() < 1e-12 && (foot.left_m + 0.5).abs() < 1e-12);
    }

    #[test]
    fn who_is_past_a_bend_is_not_taken_to_be_before_it() {
        // Nearer to the first stretch, but known to be on the second.
        let foot = bend().foot_within(Point::new(8.0, 1.0), 10.5, 14.0);
        assert!((foot.way_m - 11.0).abs() < 1e-12);
    }

    #[test]
    fn a_part_has_the_corners_between() {
        let part = bend().part(8.0, 12.0).expect("a part");
        assert_eq!(part.corners().len(), 3);
        assert!((part.length_m() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_line_is_refused() {
        assert!(TravelLine::new(&[Point::origin()]).is_none());
        assert!(TravelLine::new(&[Point::origin(), Point::origin()]).is_none());
        assert!(TravelLine::new(&[Point::origin(), Point::new(f64::NAN, 0.0)]).is_none());
    }
}
