//! Handlers to fit models to where no motion capture is at hand. They are none of the fitted models, so that the
//! comparison is not circular: a handler feels where the handle was a reaction time ago, is drawn there like a mass
//! on a spring with a damper, sways from step to step, stands a little beside where they think they stand, and
//! drifts.

use guidance::Se2;
use guidance::se2::{Point, wrap_angle};
use nalgebra::Vector2;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal, Uniform};

use crate::data::{Recording, Sample};
use crate::script::trajectories;

/// As many handlers, and walks of each trajectory, as in the paper.
const SUBJECTS: usize = 9;
const REPETITIONS: u32 = 3;
/// Samples are so far apart, as of motion capture, seconds.
const DT_S: f64 = 0.02;
/// Names of handlers that nobody ever met begin so.
pub const SIMULATED: &str = "sim-";
/// One standard deviation of a marker, metres and radians.
const MARKER_M: f64 = 0.002;
const MARKER_RAD: f64 = 0.01;

/// What one handler is like.
#[derive(Debug, Clone)]
struct Person {
    /// Where they walk in the robot's frame.
    offset: [f64; 3],
    reaction_s: f64,
    /// Of the spring between body and handle, radians per second; and of its damper.
    stiffness_radps: f64,
    damping: f64,
    sway_m: f64,
    step_hz: f64,
    /// Their place wanders by so much, and forgets it in so long.
    drift_m: f64,
    drift_s: f64,
}

/// Nine handlers on the paper's five trajectories, three walks each.
#[must_use]
pub fn synthesize(seed: u64) -> Vec<Recording> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let scripts = trajectories(DT_S);
    let mut recordings = Vec::new();
    for subject in 1..=SUBJECTS {
        let person = Person::any(&mut random);
        for (trajectory, robot) in &scripts {
            for repetition in 1..=REPETITIONS {
                recordings.push(Recording {
                    subject: format!("{SIMULATED}{subject}"),
                    trajectory: (*trajectory).to_owned(),
                    repetition,
                    samples: person.walk(robot, &mut random),
                });
            }
        }
    }
    recordings
}

fn between(random: &mut impl Rng, from: f64, to: f64) -> f64 {
    Uniform::new(from, to).map_or(from, |uniform| uniform.sample(random))
}

fn normal(random: &mut impl Rng, sigma: f64) -> f64 {
    Normal::new(0.0, sigma).map_or(0.0, |normal| normal.sample(random))
}

impl Person {
    fn any(random: &mut impl Rng) -> Self {
        Self {
            offset: [between(random, -0.95, -0.6), between(random, -0.45, -0.25), between(random, -0.15, 0.15)],
            // A harness is rigid: hand and arm give way, and the body follows within a step.
            reaction_s: between(random, 0.08, 0.25),
            stiffness_radps: between(random, 6.0, 10.0),
            damping: between(random, 0.6, 1.0),
            sway_m: between(random, 0.01, 0.025),
            step_hz: between(random, 1.5, 2.0),
            drift_m: between(random, 0.03, 0.06),
            drift_s: between(random, 2.0, 5.0),
        }
    }

    /// Follows the robot's poses.
    fn walk(&self, robot: &[Se2], random: &mut impl Rng) -> Vec<Sample> {
        let delay = (self.reaction_s / DT_S).round() as usize;
        let mut drift = [normal(random, self.drift_m), normal(random, self.drift_m)];
        let mut phase = between(random, 0.0, std::f64::consts::TAU);
        let mut sway_m = self.sway_m;
        let start = robot[0] * self.place(drift, 0.0);
        let mut body = Body {
            at: Point::from(start.translation.vector),
            velocity: Vector2::zeros(),
            yaw_rad: start.rotation.angle(),
            turn_radps: 0.0,
        };
        let mut samples = Vec::with_capacity(robot.len());
        for (i, world_from_robot) in robot.iter().enumerate() {
            let felt = robot[i.saturating_sub(delay)];
            let walking =
                i > 0 && (felt.translation.vector - robot[i.saturating_sub(delay + 1)].translation.vector).norm() > 0.0;
            let forget = DT_S / self.drift_s;
            for d in &mut drift {
                *d += -*d * forget + normal(random, self.drift_m * (2.0 * forget).sqrt());
            }
            phase += std::f64::consts::TAU * self.step_hz * DT_S;
            if phase > std::f64::consts::TAU {
                phase -= std::f64::consts::TAU;
                sway_m = (self.sway_m * (1.0 + normal(random, 0.3))).abs();
            }
            let side_m = if walking { sway_m * phase.sin() } else { 0.0 };
            body.follow(&(felt * self.place(drift, side_m)), self);
            let noise = [normal(random, MARKER_M), normal(random, MARKER_M), normal(random, MARKER_RAD)];
            samples.push(Sample {
                t_s: i as f64 * DT_S,
                world_from_robot: *world_from_robot,
                world_from_handler: Se2::new(
                    body.at.coords + Vector2::new(noise[0], noise[1]),
                    wrap_angle(body.yaw_rad + noise[2]),
                ),
            });
        }
        samples
    }

    fn place(&self, drift: [f64; 2], side_m: f64) -> Se2 {
        let [x, y, yaw] = self.offset;
        Se2::new(Vector2::new(x + drift[0], y + drift[1] + side_m), yaw)
    }
}

/// A body on a spring with a damper, in the plane and in its heading.
#[derive(Debug)]
struct Body {
    at: Point,
    velocity: Vector2<f64>,
    yaw_rad: f64,
    turn_radps: f64,
}

impl Body {
    /// The next moment, drawn to where the handle is felt to be.
    fn follow(&mut self, felt: &Se2, person: &Person) {
        let (stiff, damp) = (person.stiffness_radps.powi(2), 2.0 * person.damping * person.stiffness_radps);
        let pull = (felt.translation.vector - self.at.coords) * stiff - self.velocity * damp;
        self.velocity += pull * DT_S;
        self.at += self.velocity * DT_S;
        let twist = wrap_angle(felt.rotation.angle() - self.yaw_rad) * stiff - self.turn_radps * damp;
        self.turn_radps += twist * DT_S;
        self.yaw_rad += self.turn_radps * DT_S;
    }
}

#[cfg(test)]
mod tests {
    use super::synthesize;
    use guidance::interaction::place;

    #[test]
    fn nine_handlers_walk_five_trajectories_three_times_and_keep_near_the_robot() {
        let recordings = synthesize(1);
        assert_eq!(recordings.len(), 9 * 5 * 3);
        for recording in &recordings {
            for sample in &recording.samples {
                let away = (place(&sample.world_from_handler) - place(&sample.world_from_robot)).norm();
                assert!((0.2..1.8).contains(&away), "{away} m in {} {}", recording.subject, recording.trajectory);
            }
        }
        assert_eq!(synthesize(1), recordings, "by its seed");
        assert_ne!(synthesize(2), recordings);
    }
}
