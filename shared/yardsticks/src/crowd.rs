//! Recorded people. They walk where they walked, whatever the robot does.

use guidance::se2::Point;
use messages::Walker;

/// Where a person was recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded {
    /// Their name in reports.
    pub name: String,
    /// Rising times, seconds, each with a place, metres. Between two of them the person walks straight. Before the
    /// first and after the last one they are not there.
    pub places: Vec<(f64, Point)>,
}

impl Recorded {
    /// Where they are at a time; none: they are not there.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<Point> {
        let after = self.places.partition_point(|(at_s, _)| *at_s <= time_s);
        let (from_s, from) = *self.places.get(after.checked_sub(1)?)?;
        let (to_s, to) = *self.places.get(after)?;
        Some(from + (to - from) * ((time_s - from_s) / (to_s - from_s)))
    }
}

/// All recorded people of a passage.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Crowd {
    /// They.
    pub people: Vec<Recorded>,
    /// Radius of each, metres.
    pub radius_m: f64,
}

impl Crowd {
    /// Those who are there at a time, by their number in [`Crowd::people`].
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = (usize, Point)> {
        self.people.iter().enumerate().filter_map(move |(number, person)| Some((number, person.at(time_s)?)))
    }

    /// The same as sensors see them. There may be more of them than fit into a message: no message holds them.
    #[must_use]
    pub fn walkers(&self, time_s: f64) -> Vec<Walker> {
        let walker = |at: Point| Walker { x_m: at.x, y_m: at.y, radius_m: self.radius_m };
        self.at(time_s).map(|(_, at)| walker(at)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Crowd, Recorded};
    use guidance::se2::Point;

    #[test]
    fn a_person_is_between_two_sightings_and_nowhere_before_and_after() {
        let places = vec![(1.0, Point::new(0.0, 0.0)), (2.0, Point::new(1.0, 0.0)), (4.0, Point::new(1.0, 2.0))];
        let crowd = Crowd { people: vec![Recorded { name: "1".into(), places }], radius_m: 0.2 };
        let at = |time_s| crowd.at(time_s).next().map(|(_, at)| at);
        assert_eq!([at(0.9), at(4.0)], [None, None]);
        assert_eq!(at(1.5), Some(Point::new(0.5, 0.0)));
        assert_eq!(at(3.0), Some(Point::new(1.0, 1.0)));
        assert_eq!(crowd.walkers(2.0).len(), 1);
    }
}
