//! The cue's start frame: its origin is where the robot was when the cue was given, its x axis the direction of travel
//! (Kim et al. 2023, section 3: travel line and target orientation).

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

/// Whether a left or right cue is done: the robot has turned more than half-way into the branch.
#[must_use]
pub fn turn_done(kind: CueKind, start_from_robot: &Se2) -> bool {
    let target = target_yaw_rad(kind);
    target != 0.0 && wrap_angle(start_from_robot.rotation.angle()) / target > 0.5
}

/// Who was asked to turn looks for an opening for so long a way, straight from the cue's start, metres.
pub const TURN_REACH_M: f64 = 15.0;

/// Whether a left or right cue has found nothing to turn into: the robot stands from there on, until another cue comes
/// (Kim et al. 2023, section 3: "find the next available turn or stop if no turn is available").
#[must_use]
pub fn turn_missed(kind: CueKind, start_from_robot: &Se2) -> bool {
    target_yaw_rad(kind) != 0.0 && start_from_robot.translation.vector.norm() > TURN_REACH_M
}

/// The start frame of the forward that follows a done turn: the robot's place, the branch's direction.
#[must_use]
pub fn start_after_turn(kind: CueKind, odom_from_start: &Se2, odom_from_robot: &Se2) -> Se2 {
    let yaw_rad = odom_from_start.rotation.angle() + target_yaw_rad(kind);
    Se2::new(odom_from_robot.translation.vector, yaw_rad)
}

#[cfg(test)]
mod tests {
    use super::{TURN_REACH_M, start_after_turn, turn_done, turn_missed};
    use crate::se2::Se2;
    use messages::CueKind;
    use nalgebra::Vector2;

    #[test]
    fn a_turn_is_done_half_way_to_its_own_side() {
        let at = |deg: f64| Se2::new(Vector2::new(3.0, 0.5), deg.to_radians());
        assert!(turn_done(CueKind::Left, &at(46.0)) && !turn_done(CueKind::Left, &at(44.0)));
        assert!(turn_done(CueKind::Right, &at(-46.0)) && !turn_done(CueKind::Right, &at(46.0)));
        assert!(!turn_done(CueKind::Forward, &at(80.0)));
    }

    #[test]
    fn a_turn_that_is_nowhere_ends_after_its_reach() {
        let at = |x: f64| Se2::new(Vector2::new(x, 0.5), 0.0);
        assert!(turn_missed(CueKind::Right, &at(TURN_REACH_M)) && !turn_missed(CueKind::Right, &at(14.0)));
        assert!(!turn_missed(CueKind::Forward, &at(99.0)));
    }

    #[test]
    fn forward_goes_on_along_the_branch() {
        let start = Se2::new(Vector2::new(1.0, 1.0), 0.2);
        let robot = Se2::new(Vector2::new(4.0, 2.0), 1.0);
        let next = start_after_turn(CueKind::Left, &start, &robot);
        assert!((next.rotation.angle() - 0.2 - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(next.translation.vector, robot.translation.vector);
    }
}
