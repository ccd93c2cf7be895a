//! The cue's start frame: its origin is where the robot was when the cue was given, its x axis the direction of travel
//! (Kim et al. 2023, section 3: travel line and target orientation).

use std::collections::VecDeque;

use messages::CueKind;

use crate::se2::{Se2, wrap_angle};

/// Target orientation of a cue in its start frame, radians: 0 for forward, 90 degrees to the side for a turn
/// (Kim et al. 2023, eq. 1).
#[must_use]
pub fn target_yaw_rad(kind: CueKind) -> f64 {
    match kind {
        CueKind::Stop | CueKind::Forward => 0.0,
        CueKind::Left => std::f64::consts::FRAC_PI_2,
        CueKind::Right => -std::f64::consts::FRAC_PI_2,
    }
}

/// A turn is done within so short a way, metres; a corridor that bends more slowly is followed, and no turn.
pub const TURN_WITHIN_M: f64 = 2.0;
/// Who was asked to turn looks for an opening for so long a way from the cue's start, metres.
pub const TURN_REACH_M: f64 = 15.0;
/// The way is measured by chords of this length, metres: swaying is not walking.
const CHORD_M: f64 = 0.5;

/// The way since a cue was given: whether its turn is done, or has found nothing to turn into.
#[derive(Debug, Clone, Default)]
pub struct CueTrack {
    /// Way and pose in the cue's start frame, the oldest first, for the last [`TURN_WITHIN_M`].
    trail: VecDeque<(f64, Se2)>,
    newest: Option<(f64, Se2)>,
}

impl CueTrack {
    /// Another cue: nothing has been walked.
    pub fn clear(&mut self) {
        self.trail.clear();
        self.newest = None;
    }

    /// Takes the robot's pose in the cue's start frame. Whoever begins in the middle, restarted, knows the start and
    /// the straight way from it.
    pub fn observe(&mut self, start_from_robot: &Se2) {
        let start = (0.0, Se2::identity());
        if self.trail.is_empty() {
            self.trail.push_back(start);
        }
        let (before_m, before) = self.trail.back().copied().unwrap_or(start);
        let step_m = (start_from_robot.translation.vector - before.translation.vector).norm();
        let way_m = before_m + step_m;
        if step_m >= CHORD_M {
            self.trail.push_back((way_m, *start_from_robot));
        }
        self.newest = Some((way_m, *start_from_robot));
        while self.trail.front().is_some_and(|(at_m, _)| at_m + TURN_WITHIN_M < way_m) && self.trail.len() > 1 {
            self.trail.pop_front();
        }
    }

    /// The start frame of the forward that follows a done turn, in the cue's start frame: the robot's place, the
    /// branch's direction. `None`: the robot has not turned more than half-way to the cue's side, or the cue is none to
    /// turn.
    #[must_use]
    pub fn after_turn(&self, kind: CueKind) -> Option<Se2> {
        let target_rad = target_yaw_rad(kind);
        let (_, now) = self.newest.filter(|_| target_rad != 0.0)?;
        let turned = |before: &Se2| wrap_angle(now.rotation.angle() - before.rotation.angle()) * target_rad.signum();
        let before = self.trail.iter().map(|(_, pose)| pose).max_by(|a, b| turned(a).total_cmp(&turned(b)))?;
        let is_done = turned(before) > target_rad.abs() / 2.0;
        is_done.then(|| Se2::new(now.translation.vector, before.rotation.angle() + target_rad))
    }

    /// Whether a left or right cue has found nothing to turn into: the robot stands from there on, until another cue
    /// comes (Kim et al. 2023, section 3: "find the next available turn or stop if no turn is available").
    #[must_use]
    pub fn turn_missed(&self, kind: CueKind) -> bool {
        target_yaw_rad(kind) != 0.0 && self.newest.is_some_and(|(way_m, _)| way_m > TURN_REACH_M)
    }

    /// Whether the robot stands whatever a policy says: stop was asked for, or a turn has found nothing to turn into.
    #[must_use]
    pub fn must_stand(&self, kind: CueKind) -> bool {
        kind == CueKind::Stop || self.turn_missed(kind)
    }
}

#[cfg(test)]
mod tests {
    use super::{CueTrack, TURN_REACH_M};
    use crate::se2::Se2;
    use messages::CueKind;
    use nalgebra::Vector2;

    /// Who walked `way_m` along an arc of that radius, metres (0: straight), and then turned on the spot.
    fn walked(way_m: f64, radius_m: f64, turned_deg: f64) -> CueTrack {
        let mut track = CueTrack::default();
        let mut pose = Se2::identity();
        for _ in 0..(way_m / 0.1) as usize {
            let yaw_rad = if radius_m == 0.0 { 0.0 } else { 0.1 / radius_m };
            pose *= Se2::new(Vector2::new(0.1, 0.0), yaw_rad);
            track.observe(&pose);
        }
        pose *= Se2::new(Vector2::zeros(), turned_deg.to_radians());
        track.observe(&pose);
        track
    }

    #[test]
    fn a_turn_is_done_half_way_to_its_own_side() {
        let is_done = |kind: CueKind, deg: f64| walked(3.0, 0.0, deg).after_turn(kind).is_some();
        assert!(is_done(CueKind::Left, 46.0) && !is_done(CueKind::Left, 44.0));
        assert!(is_done(CueKind::Right, -46.0) && !is_done(CueKind::Right, 46.0));
        assert!(!is_done(CueKind::Forward, 80.0));
    }

    #[test]
    fn a_corridor_that_bends_slowly_is_no_turn_and_one_off_it_is() {
        let quarter_m = 6.0 * std::f64::consts::FRAC_PI_2;
        assert_eq!(walked(quarter_m, 6.0, 0.0).after_turn(CueKind::Left), None);
        let after = walked(quarter_m, 6.0, 50.0).after_turn(CueKind::Left).expect("50 degrees and what bent");
        // The way before the turn led across the start's, two metres back by 19 degrees less.
        assert!((after.rotation.angle().to_degrees() - (71.0 - 180.0 + 180.0 + 90.0)).abs() < 6.0, "{after}");
        assert!(walked(1.5 * std::f64::consts::FRAC_PI_2, 1.5, 0.0).after_turn(CueKind::Left).is_some(), "a corner");
    }

    #[test]
    fn forward_goes_on_along_the_branch() {
        let after = walked(4.0, 0.0, 60.0).after_turn(CueKind::Left).expect("done");
        assert!((after.rotation.angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((after.translation.vector - Vector2::new(4.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_turn_that_is_nowhere_ends_after_its_reach_of_way() {
        assert!(!walked(TURN_REACH_M - 0.2, 0.0, 0.0).must_stand(CueKind::Right));
        assert!(walked(TURN_REACH_M + 0.2, 0.0, 0.0).must_stand(CueKind::Right));
        // Round and round: never far from the start.
        assert!(walked(TURN_REACH_M + 0.5, 2.0, 0.0).must_stand(CueKind::Right));
        assert!(!walked(99.0, 0.0, 0.0).must_stand(CueKind::Forward));
        assert!(CueTrack::default().must_stand(CueKind::Stop));
        // Who comes in the middle, restarted, knows how far the start is.
        let mut late = CueTrack::default();
        late.observe(&Se2::new(Vector2::new(16.0, 0.0), 0.0));
        assert!(late.turn_missed(CueKind::Left));
        // And in the middle of a turn, how far it has turned.
        let mut late = CueTrack::default();
        late.observe(&Se2::new(Vector2::new(1.0, 0.3), 0.6));
        assert_eq!(late.after_turn(CueKind::Left), None);
        late.observe(&Se2::new(Vector2::new(1.1, 0.4), 0.9));
        assert!(late.after_turn(CueKind::Left).is_some());
    }

    #[test]
    fn swaying_is_not_walking() {
        let mut track = CueTrack::default();
        for i in 0..400 {
            let aside_m = if i % 2 == 0 { 0.0 } else { 0.15 };
            track.observe(&Se2::new(Vector2::new(0.025 * f64::from(i), aside_m), 0.0));
        }
        assert!(track.newest.is_some_and(|(way_m, _)| way_m < 10.5), "{track:?}");
    }
}
