//! The alignment itself: where the robot must have been to see these surfaces there.
//!
//! Censi 2008: each point of the scan is held against the *line* at the nearest point of the reference, and only its
//! distance square to that line counts, which is quadratic near the solution and lets a wall slide along itself. To
//! that sum comes the prior, weighed by its covariance, so that the result is the most probable pose given both (the
//! iterated update of a Kalman filter). Least squares over a motion of the robot, by Gauss and Newton.

use guidance::se2::{Se2, exp, log};
use messages::Twist2;
use nalgebra::{Matrix3, Vector3};

use crate::contour::ContourPoint;
use crate::reference::Reference;
use crate::uncertainty::Covariance;

/// Rounds at most.
const ROUNDS: usize = 20;
/// Smaller steps change nothing, metres and radians.
const STEP_MIN: f64 = 1e-4;
/// A point is held against what is this near at first, metres: as far as legs slip between two scans,
const REACH_FIRST_M: f64 = 0.4;
/// and so near in the end. What has nothing there is new, or walks about.
const REACH_LAST_M: f64 = 0.12;
/// Each round reaches for so much of the one before.
const REACH_SHRINKS: f64 = 0.7;
/// A point this far off its line counts a quarter (Geman and McClure's weights), metres.
const ROBUST_M: f64 = 0.1;
/// Points of one wall are off by the same plaster, edge and mounting: so many tell no more than one.
const ALIKE: f64 = 4.0;
/// A direction to which less than this share of all normals points is not seen: what shows there is noise of normals
/// that are off by a few degrees.
const SEEN_SHARE: f64 = 0.005;

/// Where a scan lies on the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Where the robot was.
    pub odom_from_robot: Se2,
    /// How far that may be off, prior and scan together, robot frame.
    pub covariance: Covariance,
    /// Root mean square distance of the points to their lines, metres.
    pub residual_m: f64,
    /// Share of the points that have a line.
    pub inlier_share: f64,
    /// The direction of which the scan says nothing and odometry alone tells, if there is one: its bearing in the
    /// odometry frame, radians in [0, pi).
    pub unseen_rad: Option<f64>,
}

/// Lays the points of a scan (robot frame) onto the reference, from `prior`, which is known to `covariance`. `None`
/// where there is nothing to lay them onto, or no finite answer.
#[must_use]
pub fn align(
    points: &[ContourPoint],
    reference: &Reference,
    prior: &Se2,
    covariance: &Covariance,
    sigma_m: f64,
) -> Option<Alignment> {
    let known = covariance.try_inverse()?;
    let (mut at, mut reach_m) = (*prior, REACH_FIRST_M);
    for round in 1.. {
        let seen = Seen::from(points, reference, &at, reach_m)?;
        let (scan, pull, unseen) = seen.weighed(sigma_m);
        let off = vector(log(&(prior.inverse() * at), 1.0));
        let information = scan + known;
        let step = -(information.try_inverse()? * (pull + known * off));
        if !step.iter().all(|part| part.is_finite()) {
            return None;
        }
        at *= exp(Twist2 { vx_mps: step.x, vy_mps: step.y, wz_radps: step.z }, 1.0);
        let is_last_reach = reach_m <= REACH_LAST_M;
        if round == ROUNDS || (is_last_reach && step.amax() < STEP_MIN) {
            let direction = unseen.map(|robot| at.rotation * robot);
            return Some(Alignment {
                odom_from_robot: at,
                covariance: information.try_inverse()?,
                residual_m: (seen.squares / seen.count.max(1) as f64).sqrt(),
                inlier_share: seen.count as f64 / points.len() as f64,
                unseen_rad: direction.map(|way| way.y.atan2(way.x).rem_euclid(std::f64::consts::PI)),
            });
        }
        reach_m = (reach_m * REACH_SHRINKS).max(REACH_LAST_M);
    }
    None
}

fn vector(twist: Twist2) -> Vector3<f64> {
    Vector3::new(twist.vx_mps, twist.vy_mps, twist.wz_radps)
}

/// What the points that have a line say of the pose.
#[derive(Debug)]
struct Seen {
    /// Sum of the squared directions in which the points constrain x, y, and yaw times `lever_m`.
    directions: Matrix3<f64>,
    pull: Vector3<f64>,
    weight: f64,
    /// How far away points are, so that a turn is as long as the way it moves them, metres.
    lever_m: f64,
    squares: f64,
    count: usize,
}

impl Seen {
    fn from(points: &[ContourPoint], reference: &Reference, odom_from_robot: &Se2, reach_m: f64) -> Option<Self> {
        let lever = points.iter().map(|point| point.at.coords.norm_squared()).sum::<f64>() / points.len() as f64;
        let lever_m = lever.sqrt();
        if !(lever_m > 0.0 && lever_m.is_finite()) {
            return None;
        }
        let (directions, pull) = (Matrix3::zeros(), Vector3::zeros());
        let mut seen = Self { directions, pull, weight: 0.0, lever_m, squares: 0.0, count: 0 };
        for point in points {
            let there = point.seen_from(odom_from_robot);
            let Some(line) = reference.nearest(&there, reach_m) else { continue };
            let off_m = line.normal.dot(&(there.at - line.at));
            let normal = odom_from_robot.rotation.inverse() * line.normal;
            let turn = point.at.x * normal.y - point.at.y * normal.x;
            let direction = Vector3::new(normal.x, normal.y, turn / lever_m);
            let weight = (1.0 + (off_m / ROBUST_M).powi(2)).powi(-2);
            seen.directions += direction * direction.transpose() * weight;
            seen.pull += direction * (weight * off_m);
            (seen.weight, seen.squares, seen.count) =
                (seen.weight + weight, seen.squares + off_m * off_m, seen.count + 1);
        }
        Some(seen)
    }

    /// Information and pull of the scan over x, y and yaw, without the directions that it does not see; and the one of
    /// these, robot frame, that is a way rather than a turn.
    fn weighed(&self, sigma_m: f64) -> (Matrix3<f64>, Vector3<f64>, Option<nalgebra::Vector2<f64>>) {
        let eigen = self.directions.symmetric_eigen();
        let (mut directions, mut pull, mut unseen) = (self.directions, self.pull, None);
        for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value >= SEEN_SHARE * self.weight && self.weight > 0.0 {
                continue;
            }
            directions -= direction * direction.transpose() * *value;
            pull -= direction * direction.dot(&pull);
            let way = direction.xy();
            unseen = unseen.or((way.norm() > 0.7).then_some(way));
        }
        let scale = Matrix3::from_diagonal(&[1.0, 1.0, self.lever_m].into());
        let each = 1.0 / (ALIKE * sigma_m * sigma_m);
        (scale * directions * scale * each, scale * pull * each, unseen)
    }
}
