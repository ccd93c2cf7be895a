//! The social force model: how people who walk keep clear of each other and of walls, and stay with their group.
//!
//! Helbing and Molnar 1995 have an acceleration towards the desired velocity, and accelerations away from people and
//! walls. The one between people is that of Moussaid et al. 2009 ("Experimental study of the behavioural mechanisms
//! underlying self-organization in human crowds"): it was measured, it looks ahead by the relative velocity, and it
//! turns people aside before it slows them. Groups are those of Moussaid et al. 2010 ("The walking behaviour of
//! pedestrian social groups and its impact on crowd dynamics").
//!
//! Written here: the one crate that was found for it, `rustsim-crowd` 0.0.1, has the forces of Helbing and Molnar 1995.

use guidance::se2::Point;
use nalgebra::Vector2;

/// The interaction was measured between bodies of about this radius, metres: others are that much nearer or farther.
const MEASURED_RADIUS_M: f64 = 0.25;

/// The parameters of the model. [`SocialForce::PUBLISHED`] has those of the papers, and [`SocialForce::default`] those
/// that fit recorded tracks; docs/people.md has the figures of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SocialForce {
    /// The desired velocity is reached with this time constant (tau), seconds.
    pub relaxation_s: f64,
    /// Strength of the interaction between two people (A), m/s^2.
    pub strength_mps2: f64,
    /// Weight of the relative velocity against the direction to the other one (lambda), seconds per metre.
    pub foresight: f64,
    /// Reach of the interaction for each unit of that sum (gamma), metres.
    pub reach_m: f64,
    /// How fast the turning aside falls off with the angle (n).
    pub turning: f64,
    /// How fast the slowing falls off with the angle (n').
    pub slowing: f64,
    /// Preference for the right where both sides are alike (epsilon).
    pub rightward: f64,
    /// Strength of the force from a wall at touch (a), m/s^2.
    pub wall_mps2: f64,
    /// Reach of that force (b), metres.
    pub wall_reach_m: f64,
    /// Slowing for each radian that the head has to turn to see the group (beta 1), 1/s.
    pub gaze_per_s: f64,
    /// Attraction to the middle of the group (beta 2), m/s^2.
    pub attraction_mps2: f64,
    /// Repulsion within the group (beta 3), m/s^2,
    pub apart_mps2: f64,
    /// between members who are nearer than this (d0), metres.
    pub apart_m: f64,
    /// The greatest speed, as a multiple of the desired one (Helbing and Molnar 1995).
    pub hurry: f64,
    /// Least time in which a body in the way is reached (the time gap T of Tordeux et al. 2016, "Collision-free speed
    /// model for pedestrian dynamics", half of theirs), seconds. Forces alone let people walk into each other.
    pub time_gap_s: f64,
    /// People step back from a body that is nearer than this, metres. Chosen so that a handler who sways touches no one
    /// who waits.
    pub stand_off_m: f64,
}

impl SocialForce {
    /// Moussaid et al. 2009; groups: Moussaid et al. 2010.
    pub const PUBLISHED: Self = Self {
        relaxation_s: 0.54,
        strength_mps2: 4.5,
        foresight: 2.0,
        reach_m: 0.35,
        turning: 2.0,
        slowing: 3.0,
        rightward: 0.005,
        wall_mps2: 3.0,
        wall_reach_m: 0.1,
        gaze_per_s: 4.0,
        attraction_mps2: 3.0,
        apart_mps2: 1.0,
        apart_m: 0.8,
        hurry: 1.3,
        time_gap_s: 0.5,
        stand_off_m: 0.2,
    };
}

impl Default for SocialForce {
    /// What is between people is fitted to the recording *hotel* (`cargo run --release -p guidedog-world --example
    /// pedestrians -- FOLDER fit`); the rest is as published.
    fn default() -> Self {
        Self {
            strength_mps2: 1.35,
            reach_m: 0.32,
            gaze_per_s: 0.5,
            attraction_mps2: 0.375,
            apart_mps2: 0.5,
            apart_m: 0.56,
            ..Self::PUBLISHED
        }
    }
}

/// A body in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mover {
    /// Place, world frame.
    pub at: Point,
    /// Velocity, world frame, metres per second.
    pub velocity: Vector2<f64>,
    /// Radius of the body, metres.
    pub radius_m: f64,
}

impl SocialForce {
    /// Towards the desired velocity, m/s^2.
    #[must_use]
    pub fn towards(&self, own: &Mover, desired: Vector2<f64>) -> Vector2<f64> {
        (desired - own.velocity) / self.relaxation_s
    }

    /// Away from another body, m/s^2 (Moussaid et al. 2009).
    #[must_use]
    pub fn from_other(&self, own: &Mover, other: &Mover) -> Vector2<f64> {
        let to_other = other.at - own.at;
        let Some(direction) = to_other.try_normalize(1e-6) else { return Vector2::zeros() };
        let between = (own.velocity - other.velocity) * self.foresight + direction;
        let Some(along) = between.try_normalize(1e-6) else { return Vector2::zeros() };
        let reach_m = self.reach_m * between.norm();
        let apart_m = to_other.norm() + 2.0 * MEASURED_RADIUS_M - own.radius_m - other.radius_m;
        let angle_rad = along.perp(&direction).atan2(along.dot(&direction)) + reach_m * self.rightward;
        let force =
            |falloff: f64| self.strength_mps2 * (-apart_m / reach_m - (falloff * reach_m * angle_rad).powi(2)).exp();
        let left = Vector2::new(-along.y, along.x);
        -along * force(self.slowing) - left * (angle_rad.signum() * force(self.turning))
    }

    /// Away from the nearest wall, which is so far from the body and in that direction (a unit vector), m/s^2.
    #[must_use]
    pub fn from_wall(&self, room_m: f64, towards_wall: Vector2<f64>) -> Vector2<f64> {
        -towards_wall * (self.wall_mps2 * (-room_m.max(0.0) / self.wall_reach_m).exp())
    }

    /// What keeps a person with the `others` of the group, m/s^2. The person looks where they wish to go.
    #[must_use]
    pub fn in_group(&self, own: &Mover, desired: Vector2<f64>, others: &[Mover]) -> Vector2<f64> {
        if others.is_empty() {
            return Vector2::zeros();
        }
        let count = others.len() as f64;
        let middle = others.iter().fold(Vector2::zeros(), |sum, other| sum + (other.at - own.at)) / count;
        // Of all members, oneself among them.
        let to_middle = middle * (count / (count + 1.0));
        let mut force = Vector2::zeros();
        if let (Some(gaze), Some(seen)) = (desired.try_normalize(1e-6), middle.try_normalize(1e-6)) {
            let turned_rad = gaze.dot(&seen).clamp(-1.0, 1.0).acos() - std::f64::consts::FRAC_PI_2;
            force -= own.velocity * (self.gaze_per_s * turned_rad.max(0.0));
        }
        if to_middle.norm() > count / 2.0 {
            force += to_middle.normalize() * self.attraction_mps2;
        }
        for other in others {
            let away = own.at - other.at;
            if away.norm() < self.apart_m {
                force += away.try_normalize(1e-6).unwrap_or_default() * self.apart_mps2;
            }
        }
        force
    }

    /// The velocity after `dt_s` of an acceleration, no faster than [`hurry`](Self::hurry) allows at `desired_mps`.
    #[must_use]
    pub fn next_velocity(&self, own: &Mover, acceleration: Vector2<f64>, desired_mps: f64, dt_s: f64) -> Vector2<f64> {
        (own.velocity + acceleration * dt_s).cap_magnitude(self.hurry * desired_mps)
    }

    /// A velocity without what of it leads too near to one of the others; away from one who is too near already.
    #[must_use]
    pub fn not_into(&self, others: &[Mover], own: &Mover, velocity: Vector2<f64>, desired_mps: f64) -> Vector2<f64> {
        let keep_off = |velocity: Vector2<f64>, other: &Mover| {
            let to_other = other.at - own.at;
            let Some(towards) = to_other.try_normalize(1e-6) else { return velocity };
            let room_m = to_other.norm() - own.radius_m - other.radius_m - self.stand_off_m;
            let most_mps = room_m / self.time_gap_s + other.velocity.dot(&towards);
            velocity - towards * (velocity.dot(&towards) - most_mps).max(0.0)
        };
        others.iter().fold(velocity, keep_off).cap_magnitude(self.hurry * desired_mps)
    }
}

#[cfg(test)]
mod tests {
    use super::{Mover, SocialForce};
    use guidance::se2::Point;
    use nalgebra::Vector2;

    fn mover(x_m: f64, y_m: f64, vx_mps: f64) -> Mover {
        Mover { at: Point::new(x_m, y_m), velocity: Vector2::new(vx_mps, 0.0), radius_m: 0.25 }
    }

    #[test]
    fn two_who_meet_head_on_both_go_to_their_right() {
        let law = SocialForce::PUBLISHED;
        let (one, two) = (mover(0.0, 0.0, 1.3), mover(3.0, 0.0, -1.3));
        let (of_one, of_two) = (law.from_other(&one, &two), law.from_other(&two, &one));
        assert!(of_one.y < 0.0 && of_two.y > 0.0, "{of_one} {of_two}");
        assert!((of_one + of_two).norm() < 1e-9, "{of_one} {of_two}");
        // The other one is seen to the right: aside to the left.
        assert!(law.from_other(&one, &mover(3.0, -0.3, -1.3)).y > 0.0);
        // By the law itself: D = 2 * 2.6 + 1 = 6.2, B = 0.35 * 6.2, and no angle but the preference.
        let (reach_m, preference) = (0.35 * 6.2_f64, 0.005 * 0.35 * 6.2_f64);
        let slowing = 4.5 * (-3.0 / reach_m - (3.0 * reach_m * preference).powi(2)).exp();
        assert!((of_one.x + slowing).abs() < 1e-9);
    }

    #[test]
    fn a_larger_body_is_kept_farther_away_and_one_that_leaves_matters_little() {
        let law = SocialForce::PUBLISHED;
        let own = mover(0.0, 0.0, 1.3);
        let (small, large) = (mover(2.0, 0.0, 0.0), Mover { radius_m: 0.4, ..mover(2.0, 0.0, 0.0) });
        assert!(law.from_other(&own, &large).norm() > law.from_other(&own, &small).norm());
        let leaving = law.from_other(&own, &mover(2.0, 0.0, 2.6));
        assert!(leaving.norm() < 0.05 * law.from_other(&own, &small).norm(), "{leaving}");
        assert_eq!(law.from_other(&own, &own), Vector2::zeros(), "at one place there is no direction");
    }

    #[test]
    fn nobody_walks_into_one_who_is_seen() {
        let law = SocialForce::PUBLISHED;
        let (own, on) = (mover(0.0, 0.0, 1.3), Vector2::new(1.3, 0.2));
        let next = |other: Mover| law.not_into(&[other], &own, on, 1.3);
        let stands = next(mover(0.9, 0.0, 0.0));
        assert!((stands - Vector2::new(0.4, 0.2)).norm() < 1e-9, "0.2 m in half a second, and on aside: {stands}");
        assert!((next(mover(0.9, 0.0, 0.5)).x - 0.9).abs() < 1e-9, "after one who walks on");
        assert!((next(mover(0.6, 0.0, 0.0)).x + 0.2).abs() < 1e-9, "0.1 m too near: steps back");
        assert!(next(mover(0.6, 0.0, -5.0)).norm() < 1.3 * 1.3 + 1e-9, "no faster than in a hurry");
        assert_eq!(next(mover(5.0, 0.0, 0.0)), on);
        assert!((law.next_velocity(&own, Vector2::new(9.0, 0.0), 1.0, 0.5).x - 1.3).abs() < 1e-9);
    }

    #[test]
    fn walls_push_away_and_the_force_falls_off() {
        let law = SocialForce::PUBLISHED;
        let near = law.from_wall(0.05, Vector2::y());
        assert!(near.y < -1.0 && near.x == 0.0);
        assert!(law.from_wall(0.5, Vector2::y()).norm() < 0.03);
        assert_eq!(law.from_wall(-0.1, Vector2::y()), law.from_wall(0.0, Vector2::y()), "never more than at touch");
    }

    #[test]
    fn a_group_waits_for_who_is_behind_and_closes_up() {
        let (law, on) = (SocialForce::PUBLISHED, Vector2::new(1.3, 0.0));
        let own = mover(0.0, 0.0, 1.3);
        let behind = law.in_group(&own, on, &[mover(-3.0, 0.0, 1.3)]);
        assert!(behind.x < -law.attraction_mps2, "turns the head and is drawn back: {behind}");
        let beside = law.in_group(&own, on, &[mover(0.0, 0.7, 1.3)]);
        assert!((beside - Vector2::new(0.0, -law.apart_mps2)).norm() < 1e-9, "too near: {beside}");
        assert_eq!(law.in_group(&own, on, &[mover(0.0, 0.9, 1.3)]), Vector2::zeros());
        assert_eq!(law.in_group(&own, on, &[]), Vector2::zeros());
    }
}
