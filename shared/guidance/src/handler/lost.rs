//! When a handler who was lost is back.

use crate::se2::Point;

/// A person who stands in the handler's place for so long is the handler, nanoseconds. A passer-by does not stay.
const BACK_NS: u64 = 1_000_000_000;
/// Scans that are farther apart do not follow each other, nanoseconds.
const APART_NS: u64 = 500_000_000;
/// They stand so near to their place, and move by no more than that, metres. Of a handler who comes to another place a
/// scan shows a part only, which lies between the two.
const NEAR_M: f64 = 0.4;
const NEAR_AWAITED_M: f64 = 0.25;
const STAYS_M: f64 = 0.25;

/// A handler who has been missing for too long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lost {
    near_m: f64,
    person: Option<Person>,
}

impl Default for Lost {
    fn default() -> Self {
        Self { near_m: NEAR_M, person: None }
    }
}

/// A person in the handler's place.
#[derive(Debug, Clone, Copy)]
struct Person {
    since_ns: u64,
    last_ns: u64,
    /// Where they were seen first (odometry frame).
    at: Point,
}

impl Lost {
    /// A handler who is to come to another place.
    pub fn awaited() -> Self {
        Self { near_m: NEAR_AWAITED_M, person: None }
    }

    /// Nobody has been seen yet.
    pub fn anew(self) -> Self {
        Self { person: None, ..self }
    }

    /// Whether a person stands near one of the places where the handler may be.
    pub fn is_near_one(&self, middle: Point, places: [Point; 2]) -> bool {
        places.iter().any(|place| (middle - place).norm() <= self.near_m)
    }

    /// Takes the person whom a scan shows in the handler's place (odometry frame). The handler is back where that
    /// person has stood there for long enough.
    pub fn ends(&mut self, at: Option<Point>, now_ns: u64) -> bool {
        let is_same = |person: &Person, at: Point| {
            now_ns.saturating_sub(person.last_ns) <= APART_NS && (at - person.at).norm() <= STAYS_M
        };
        self.person = at.map(|at| match self.person.filter(|person| is_same(person, at)) {
            Some(person) => Person { last_ns: now_ns, ..person },
            None => Person { since_ns: now_ns, last_ns: now_ns, at },
        });
        self.person.is_some_and(|person| now_ns.saturating_sub(person.since_ns) >= BACK_NS)
    }
}
