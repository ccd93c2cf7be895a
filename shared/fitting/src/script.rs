//! The five robot trajectories of the data collection (Kim et al. 2023, supplement, table of robot trajectories).

use guidance::Se2;
use guidance::se2::exp;
use messages::Twist2;

/// Speed of the robot, metres per second; the paper does not say, and a room for motion capture is small.
const SPEED_MPS: f64 = 0.4;
/// Its turns in place, radians per second; likewise.
const TURN_RADPS: f64 = 0.4;
/// Radius of its turns while walking, metres.
const RADIUS_M: f64 = 0.6;
/// It stands for so long before and after, seconds.
const STAND_S: f64 = 0.8;

/// A part of a trajectory.
#[derive(Debug, Clone, Copy)]
enum Part {
    /// So many metres straight on.
    Forward(f64),
    /// In place, degrees to the left.
    Turn(f64),
    /// While walking, degrees to the left.
    Arc(f64),
}

/// The five, by their numbers in the paper.
const TRAJECTORIES: [(&str, &[Part]); 5] = [
    ("1", &[Part::Forward(2.5), Part::Turn(90.0)]),
    ("2", &[Part::Forward(1.2), Part::Arc(90.0)]),
    ("3", &[Part::Forward(0.75), Part::Arc(45.0), Part::Turn(-135.0)]),
    ("4", &[Part::Forward(0.5), Part::Arc(-90.0), Part::Forward(0.5), Part::Arc(90.0), Part::Forward(0.5)]),
    (
        "5",
        &[
            Part::Forward(0.6),
            Part::Turn(-90.0),
            Part::Forward(0.6),
            Part::Arc(180.0),
            Part::Forward(0.6),
            Part::Arc(-90.0),
            Part::Forward(0.6),
        ],
    ),
];

/// Name and poses of each trajectory, one every `dt_s`, from the origin along x.
#[must_use]
pub fn trajectories(dt_s: f64) -> Vec<(&'static str, Vec<Se2>)> {
    TRAJECTORIES.iter().map(|(name, parts)| (*name, poses(parts, dt_s))).collect()
}

fn poses(parts: &[Part], dt_s: f64) -> Vec<Se2> {
    let stand = (Twist2::ZERO, STAND_S);
    let motions: Vec<(Twist2, f64)> =
        std::iter::once(stand).chain(parts.iter().map(|part| twist(*part))).chain([stand]).collect();
    let whole_s: f64 = motions.iter().map(|(_, time_s)| time_s).sum();
    (0..=(whole_s / dt_s) as usize).map(|k| pose_at(&motions, k as f64 * dt_s)).collect()
}

fn pose_at(motions: &[(Twist2, f64)], mut t_s: f64) -> Se2 {
    let mut at = Se2::identity();
    for (twist, time_s) in motions {
        at *= exp(*twist, t_s.clamp(0.0, *time_s));
        t_s -= time_s;
    }
    at
}

fn twist(part: Part) -> (Twist2, f64) {
    match part {
        Part::Forward(way_m) => (Twist2 { vx_mps: SPEED_MPS, ..Twist2::ZERO }, way_m / SPEED_MPS),
        Part::Turn(left_deg) => (
            Twist2 { wz_radps: TURN_RADPS * left_deg.signum(), ..Twist2::ZERO },
            left_deg.to_radians().abs() / TURN_RADPS,
        ),
        Part::Arc(left_deg) => {
            let turn = SPEED_MPS / RADIUS_M * left_deg.signum();
            (Twist2 { vx_mps: SPEED_MPS, wz_radps: turn, ..Twist2::ZERO }, (left_deg.to_radians() / turn).abs())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::trajectories;

    #[test]
    fn each_ends_where_the_paper_says_it_turns_to() {
        let ends: Vec<f64> = trajectories(0.02)
            .iter()
            .map(|(_, poses)| poses.last().map_or(0.0, |end| end.rotation.angle().to_degrees()))
            .collect();
        for (end, expected) in ends.iter().zip([90.0, 90.0, -90.0, 0.0, 0.0]) {
            assert!((end - expected).abs() < 1e-6, "{ends:?}");
        }
        let first = &trajectories(0.02)[0].1;
        assert!(first.last().is_some_and(|end| (end.translation.x - 2.5).abs() < 1e-9));
    }
}
