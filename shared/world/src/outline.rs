//! The outline of a body as discs: one, or two for a long one.

use guidance::se2::{Point, Se2};

/// Middles of a body's discs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outline {
    at: [Point; 2],
    count: usize,
}

impl Outline {
    /// A body there, whose discs are so far ahead of its middle and behind it, metres; 0: one disc.
    pub(crate) fn of(pose: &Se2, nose_m: f64) -> Self {
        if nose_m == 0.0 {
            return Self { at: [Point::from(pose.translation.vector); 2], count: 1 };
        }
        Self { at: [nose_m, -nose_m].map(|ahead_m| pose * Point::new(ahead_m, 0.0)), count: 2 }
    }
}

impl std::ops::Deref for Outline {
    type Target = [Point];
    fn deref(&self) -> &[Point] {
        &self.at[..self.count]
    }
}
