//! Scan after scan: what is laid onto what, what is refused, and what is known of the pose.

use guidance::se2::Se2;
use guidance::{Beams, Disc, ScanError};
use messages::ScanHeader;

use crate::align::{Alignment, align};
use crate::contour::Contour;
use crate::reference::Reference;
use crate::uncertainty::{Covariance, LegNoise, carried, sigma};

/// A keyframe is taken where the robot has gone so far since the last one, metres and radians: most of what is seen
/// then was seen in it.
const KEYFRAME: (f64, f64) = (0.4, 0.35);
/// Where less of a scan is on the reference the robot looks into a room that it had not seen, which becomes a keyframe
/// as soon as it has moved at all.
const FAMILIAR: f64 = 0.6;
/// The reference holds so many keyframes.
const KEYFRAMES: usize = 20;
/// Fewer points on surfaces tell no pose.
const POINTS_MIN: usize = 12;
/// A lidar that claims less noise meets walls that have some, metres.
const SIGMA_MIN_M: f64 = 0.02;
/// Where fewer of the points have a line, this is not what was seen before.
const INLIERS_MIN: f64 = 0.2;
/// Points are off their lines by noise and plaster; by more where they are held against the wrong ones, metres.
const RESIDUAL_MAX_M: f64 = 0.08;
/// Odometry is wrong by at most so many standard deviations,
const GATE_SIGMAS: f64 = 4.0;
/// and these besides, metres and radians: of the alignment itself.
const GATE: (f64, f64) = (0.03, 0.02);
/// After so many refusals in a row the reference is given up: the world is another one, or the place was lost.
const REFUSALS_MAX: u32 = 10;
/// A robot that has moved further than this sees another scan, metres and radians.
const REPEATED: (f64, f64) = (0.02, 0.02);
/// From one keyframe to the next something is always lost, metres and radians: corners are rounded, floors uneven.
const HANDOVER: (f64, f64) = (0.005, 0.001);

/// How the matcher is set.
#[derive(Debug, Clone, PartialEq)]
pub struct MatcherConfig {
    /// How odometry wanders.
    pub legs: LegNoise,
    /// What moves with the robot, such as the handler: what is seen there tells nothing of the motion. Robot frame.
    pub left_out: Vec<Disc>,
}

/// Why a scan corrected nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// It is no scan.
    #[error(transparent)]
    Unusable(#[from] ScanError),
    /// The lidar says the same again, to the bit, though the robot has moved.
    #[error("the scan is the one before, though the robot has moved")]
    Repeated,
    /// Hardly anything in it is a surface.
    #[error("{points} points on surfaces, of {POINTS_MIN} that are needed")]
    Bare {
        /// How many.
        points: usize,
    },
    /// It does not look like what was seen before.
    #[error("{:.0} % of the points fit, and are {residual_m:.3} m off", 100.0 * inlier_share)]
    Misfit {
        /// Share of the points that have a line.
        inlier_share: f64,
        /// Their root mean square distance to it, metres.
        residual_m: f64,
    },
    /// Odometry cannot have been so wrong.
    #[error("{way_m:.3} m and {turn_rad:.3} rad off odometry, more than that can be")]
    Innovation {
        /// By how much the place is off, metres,
        way_m: f64,
        /// and the heading, radians.
        turn_rad: f64,
    },
}

/// How the matching goes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Health {
    /// Scans that corrected the pose.
    pub accepted: u64,
    /// Scans that did not.
    pub refused: u64,
    /// Of these, since the last that did.
    pub refused_in_a_row: u32,
    /// How often the reference was given up.
    pub restarts: u64,
    /// Why the last one was refused that was.
    pub last_refusal: Option<Refusal>,
    /// Of the last alignment, metres.
    pub residual_m: f64,
    /// Of the last alignment.
    pub inlier_share: f64,
    /// Of the last alignment: the direction that odometry alone tells, odometry frame, radians in [0, pi).
    pub unseen_rad: Option<f64>,
}

/// Follows a robot through its scans.
#[derive(Debug, Clone)]
pub struct Matcher {
    config: MatcherConfig,
    odom_from_robot: Se2,
    /// Of the pose, from the beginning on.
    covariance: Covariance,
    /// Of the pose on the reference.
    on_reference: Covariance,
    /// Of the newest keyframe, and where it was.
    keyframe: (Covariance, Se2),
    reference: Reference,
    beams: Beams,
    contour: Contour,
    readings_m: Vec<f64>,
    /// Since those readings.
    moved: Se2,
    health: Health,
}

impl Matcher {
    /// A matcher that begins at `odom_from_robot`.
    #[must_use]
    pub fn new(config: MatcherConfig, odom_from_robot: Se2) -> Self {
        let zero = Covariance::zeros();
        Self {
            config,
            odom_from_robot,
            covariance: zero,
            on_reference: zero,
            keyframe: (zero, odom_from_robot),
            reference: Reference::default(),
            beams: Beams::default(),
            contour: Contour::default(),
            readings_m: Vec::new(),
            moved: Se2::identity(),
            health: Health::default(),
        }
    }

    /// Where the robot is, as of the last call that moved it.
    #[must_use]
    pub fn odom_from_robot(&self) -> &Se2 {
        &self.odom_from_robot
    }

    /// How far that may be off, robot frame.
    #[must_use]
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// How it goes.
    #[must_use]
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// Goes on by `moved`, as odometry has it.
    pub fn advance(&mut self, moved: &Se2) {
        let noise = self.config.legs.of(moved);
        self.odom_from_robot *= moved;
        self.covariance = carried(&self.covariance, moved) + noise;
        self.on_reference = carried(&self.on_reference, moved) + noise;
        self.moved *= moved;
    }

    /// Takes the scan at the place that [`Matcher::advance`] led to, and corrects that place.
    ///
    /// # Errors
    /// Where the scan corrects nothing: the place is then odometry's.
    pub fn take_scan(&mut self, header: &ScanHeader, ranges_m: &[f32]) -> Result<(), Refusal> {
        match self.judge(header, ranges_m) {
            Ok(alignment) => {
                self.health.accepted += 1;
                self.health.refused_in_a_row = 0;
                if let Some(alignment) = alignment {
                    self.correct(&alignment);
                }
                self.keep_keyframe();
                Ok(())
            }
            Err(refusal) => {
                self.health.refused += 1;
                self.health.refused_in_a_row += 1;
                self.health.last_refusal = Some(refusal.clone());
                let is_elsewhere = matches!(refusal, Refusal::Misfit { .. } | Refusal::Innovation { .. });
                if is_elsewhere && self.health.refused_in_a_row >= REFUSALS_MAX {
                    self.reference.clear();
                    self.health.restarts += 1;
                    self.health.refused_in_a_row = 0;
                    self.keep_keyframe();
                }
                Err(refusal)
            }
        }
    }

    /// Where the scan lies on the reference; `None` where there is no reference yet.
    fn judge(&mut self, header: &ScanHeader, ranges_m: &[f32]) -> Result<Option<Alignment>, Refusal> {
        self.beams.fill(header, ranges_m)?;
        if self.is_repeated() {
            return Err(Refusal::Repeated);
        }
        self.contour.fill(&self.beams, &self.config.left_out);
        let points = self.contour.points();
        if points.len() < POINTS_MIN {
            return Err(Refusal::Bare { points: points.len() });
        }
        if self.reference.odom_from_newest().is_none() {
            return Ok(None);
        }
        let sigma_m = header.sigma_m.max(SIGMA_MIN_M);
        let found = align(points, &self.reference, &self.odom_from_robot, &self.on_reference, sigma_m);
        let none = Refusal::Misfit { inlier_share: 0.0, residual_m: 0.0 };
        let alignment = found.ok_or(none)?;
        let Alignment { inlier_share, residual_m, unseen_rad, .. } = alignment;
        (self.health.inlier_share, self.health.residual_m, self.health.unseen_rad) =
            (inlier_share, residual_m, unseen_rad);
        if inlier_share < INLIERS_MIN || residual_m > RESIDUAL_MAX_M {
            return Err(Refusal::Misfit { inlier_share, residual_m });
        }
        self.gate(&alignment)?;
        Ok(Some(alignment))
    }

    fn gate(&self, alignment: &Alignment) -> Result<(), Refusal> {
        let off = self.odom_from_robot.inverse() * alignment.odom_from_robot;
        let (way_m, turn_rad) = (off.translation.vector.norm(), off.rotation.angle().abs());
        let sigma = sigma(&self.on_reference, &Se2::identity());
        let is_possible =
            way_m <= GATE.0 + GATE_SIGMAS * sigma[0].max(sigma[1]) && turn_rad <= GATE.1 + GATE_SIGMAS * sigma[2];
        if is_possible { Ok(()) } else { Err(Refusal::Innovation { way_m, turn_rad }) }
    }

    fn is_repeated(&mut self) -> bool {
        let readings_m = self.beams.beams().iter().map(|beam| beam.reading_m);
        let is_same = readings_m.clone().eq(self.readings_m.iter().copied());
        let has_moved =
            self.moved.translation.vector.norm() > REPEATED.0 || self.moved.rotation.angle().abs() > REPEATED.1;
        if !is_same {
            self.readings_m.clear();
            self.readings_m.extend(readings_m);
            self.moved = Se2::identity();
        }
        is_same && has_moved
    }

    fn correct(&mut self, alignment: &Alignment) {
        self.odom_from_robot = alignment.odom_from_robot;
        self.on_reference = alignment.covariance;
        let since = self.keyframe.1.inverse() * self.odom_from_robot;
        self.covariance = carried(&self.keyframe.0, &since) + self.on_reference;
    }

    fn keep_keyframe(&mut self) {
        let is_far = self.reference.odom_from_newest().is_none_or(|newest| {
            let moved = newest.inverse() * self.odom_from_robot;
            let (way_m, turn_rad) = (moved.translation.vector.norm(), moved.rotation.angle().abs());
            let is_new = self.health.inlier_share < FAMILIAR && (way_m > REPEATED.0 || turn_rad > REPEATED.1);
            is_new || way_m > KEYFRAME.0 || turn_rad > KEYFRAME.1
        });
        if is_far {
            self.reference.add(&self.odom_from_robot, self.contour.points(), KEYFRAMES);
            let (place, yaw) = (HANDOVER.0.powi(2), HANDOVER.1.powi(2));
            self.on_reference = Covariance::from_diagonal(&[place, place, yaw].into());
            self.covariance += self.on_reference;
            self.keyframe = (self.covariance, self.odom_from_robot);
        }
    }
}
