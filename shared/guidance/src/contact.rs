//! What was felt and not seen: a motion was begun and did not come about, so something stands there that no sensor
//! tells of. Nobody pushes on against it.

use std::collections::VecDeque;

use messages::Twist2;

use crate::se2::Se2;

/// Ends of motions that are so near to each other are the same, metres; a radian counts as the handler's arm.
const SAME_M: f64 = 0.24;
/// About how far the handler is from the robot, metres: so far a turn of a radian moves them.
const ARM_M: f64 = 0.83;
/// What was felt so long ago may be tried again, nanoseconds: who stood there has had the time to go.
const KEPT_NS: u64 = 60_000_000_000;
/// At most so many are kept.
const KEPT: usize = 16;
/// Of a motion that comes about, more than this share does.
const COMES_ABOUT: f64 = 0.3;

/// See the module.
#[derive(Debug, Clone, Default)]
pub struct Contacts {
    /// When, and where the robot was to come in the odometry frame; the oldest first.
    felt: VecDeque<(u64, Se2)>,
}

impl Contacts {
    /// The robot was to move by `begin_from_end` from where it was, and did not get there.
    pub fn feel(&mut self, now_ns: u64, odom_from_begin: &Se2, begin_from_end: &Se2) {
        self.felt.retain(|(at_ns, _)| now_ns.saturating_sub(*at_ns) <= KEPT_NS);
        if self.felt.len() == KEPT {
            self.felt.pop_front();
        }
        self.felt.push_back((now_ns, odom_from_begin * begin_from_end));
    }

    /// Whether a motion that begins here leads to where one did not get before. One that leads away from there does
    /// not, nor does to stand.
    #[must_use]
    pub fn is_met(&self, now_ns: u64, odom_from_robot: &Se2, robot_from_end: &Se2) -> bool {
        let odom_from_end = odom_from_robot * robot_from_end;
        let recent = self.felt.iter().filter(|(at_ns, _)| now_ns.saturating_sub(*at_ns) <= KEPT_NS);
        recent.into_iter().any(|(_, felt)| {
            let left_m = apart_m(&odom_from_end, felt);
            left_m < SAME_M && left_m < apart_m(odom_from_robot, felt) - 1e-6
        })
    }
}

/// Whether a motion came about, as odometry tells it.
#[must_use]
pub fn comes_about(begin_from_end: &Se2, begin_from_there: &Se2) -> bool {
    let meant_m = apart_m(&Se2::identity(), begin_from_end);
    meant_m == 0.0 || apart_m(begin_from_there, begin_from_end) < (1.0 - COMES_ABOUT) * meant_m
}

/// Whether a robot moves far less than it is commanded (both robot frame): something holds it. A robot that moves too
/// much met nothing. An odometry that tells no velocity excuses nothing.
#[must_use]
pub fn falls_short(commanded: &Twist2, seen: &Twist2) -> bool {
    let along =
        |a: &Twist2, b: &Twist2| a.vx_mps * b.vx_mps + a.vy_mps * b.vy_mps + ARM_M * ARM_M * a.wz_radps * b.wz_radps;
    along(commanded, seen) < COMES_ABOUT * along(commanded, commanded)
}

fn apart_m(a: &Se2, b: &Se2) -> f64 {
    let between = a.inverse() * b;
    between.translation.vector.norm() + ARM_M * between.rotation.angle().abs()
}

#[cfg(test)]
mod tests {
    use super::{Contacts, KEPT_NS, comes_about};
    use crate::ActionTable;
    use crate::se2::{Se2, se2};
    use messages::Pose2;

    /// The names of the actions that are not tried from there.
    fn met(contacts: &Contacts, now_ns: u64, odom_from_robot: &Se2) -> Vec<String> {
        let table = ActionTable::eight();
        let met = table.actions().iter().filter(|a| contacts.is_met(now_ns, odom_from_robot, &a.start_from_end()));
        met.map(|action| action.name.clone()).collect()
    }

    fn after(name: &str) -> (Contacts, Se2) {
        let (mut contacts, here) = (Contacts::default(), se2(Pose2::new(3.0, -1.0, 2.0)));
        let table = ActionTable::eight();
        let action = table.actions().iter().find(|action| action.name == name).expect("there is one");
        contacts.feel(5, &here, &action.start_from_end());
        (contacts, here)
    }

    #[test]
    fn where_forward_did_not_get_nothing_leads_that_is_as_far_ahead() {
        let (contacts, here) = after("forward");
        assert_eq!(met(&contacts, 6, &here), ["forward", "diagonal_left", "diagonal_right"]);
        let aside = here * Se2::translation(0.0, 0.3);
        assert_eq!(met(&contacts, 6, &aside), ["diagonal_right"]);
        let turned = |deg: f64| met(&contacts, 6, &(here * Se2::rotation(deg.to_radians())));
        assert!(turned(10.0) == ["forward"] && turned(20.0).is_empty(), "two turns lead past it");
        assert!(met(&contacts, 6, &(here * Se2::translation(-0.3, 0.0))).is_empty(), "what leads up to it is free");
        assert!(met(&contacts, 6 + KEPT_NS, &here).is_empty(), "whoever stood there may have gone");
        assert!(met(&Contacts::default(), 6, &here).is_empty());
    }

    #[test]
    fn a_turn_that_did_not_come_about_leaves_the_way_on_and_the_other_turn() {
        let (contacts, here) = after("turn_left");
        assert_eq!(met(&contacts, 6, &here), ["turn_left"]);
        assert!(met(&contacts, 6, &(here * Se2::translation(0.25, 0.0))).is_empty());
    }

    #[test]
    fn a_motion_comes_about_or_does_not() {
        let on = Se2::translation(0.25, 0.0);
        assert!(comes_about(&on, &Se2::translation(0.2, 0.01)) && !comes_about(&on, &Se2::translation(0.02, 0.01)));
        assert!(!comes_about(&Se2::rotation(0.17), &Se2::rotation(0.01)));
        assert!(comes_about(&Se2::identity(), &Se2::identity()), "to stand always does");
    }
}
