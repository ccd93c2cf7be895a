//! Least squares over a model's parameters (Kim et al. 2023, section 4, data collection and model fitting).

use guidance::se2::{Se2, pose2, wrap_angle};
use guidance::{DelayedHarness, HarnessError, Interaction, InteractionModel, RigidHarness, RotatingRod};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use messages::Pose2;
use nalgebra_of_solver::storage::Owned;
use nalgebra_of_solver::{DMatrix, DVector, Dyn};

use crate::data::Recording;

/// A radian of heading counts like so many metres of place.
const HEADING_M: f64 = 0.25;
/// Step of the central differences, in a parameter's own unit.
const DIFFERENCE: f64 = 1e-5;
/// Alpha is held to this, that the model is defined.
const ALPHA_MAX: f64 = 0.98;
/// A rod is held to this, metres.
const ROD_M: (f64, f64) = (0.05, 2.0);
/// Where the search begins: behind and to the right, remembering some.
const OFFSET: [f64; 3] = [-0.75, -0.35, 0.0];

/// Which model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// Offset x, y, yaw.
    Rigid,
    /// Grip x, y, and length.
    Rod,
    /// Offset x, y, yaw, and alpha.
    Delayed,
}

impl ModelKind {
    /// Names of the parameters, with units.
    #[must_use]
    pub fn parameters(self) -> &'static [&'static str] {
        match self {
            Self::Rigid => &["offset_x_m", "offset_y_m", "offset_yaw_rad"],
            Self::Rod => &["grip_x_m", "grip_y_m", "length_m"],
            Self::Delayed => &["offset_x_m", "offset_y_m", "offset_yaw_rad", "alpha"],
        }
    }

    /// The name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rigid => "rigid",
            Self::Rod => "rod",
            Self::Delayed => "delayed",
        }
    }

    fn first_guess(self) -> Vec<f64> {
        match self {
            Self::Rigid => OFFSET.to_vec(),
            Self::Rod => vec![-0.3, 0.0, 0.7],
            Self::Delayed => vec![OFFSET[0], OFFSET[1], OFFSET[2], 0.4],
        }
    }

    fn model(self, p: &[f64], dt_s: f64) -> Result<InteractionModel, HarnessError> {
        let offset = || Pose2::new(p[0], p[1], p[2]);
        Ok(match self {
            Self::Rigid => InteractionModel::Rigid(RigidHarness::new(offset())?),
            Self::Rod => InteractionModel::Rod(RotatingRod::new(p[0], p[1], p[2].clamp(ROD_M.0, ROD_M.1))?),
            Self::Delayed => {
                InteractionModel::Delayed(DelayedHarness::unbounded(offset(), p[3].clamp(0.0, ALPHA_MAX), dt_s)?)
            }
        })
    }
}

/// Why nothing was fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Fewer recordings than parameters can be told from.
    #[error(
        "{recordings} recordings of {whom}, too few: the last of each trajectory that has more than one validates, and \
         two must be left to fit"
    )]
    TooFew {
        /// Whose.
        whom: String,
        /// How many there are.
        recordings: usize,
    },
    /// The search left what the model is defined for, or the data does not fix a parameter.
    #[error("{model} for {whom}: {why}")]
    NotFound {
        /// Which model.
        model: &'static str,
        /// Whose.
        whom: String,
        /// What happened.
        why: String,
    },
}

impl FitError {
    /// Whom nothing was fitted to.
    #[must_use]
    pub fn whom(&self) -> &str {
        match self {
            Self::TooFew { whom, .. } | Self::NotFound { whom, .. } => whom,
        }
    }
}

/// Root mean square errors over all steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rmse {
    /// Of the place, millimetres.
    pub position_mm: f64,
    /// Of the heading, degrees.
    pub heading_deg: f64,
}

/// Sums from which a [`Rmse`] follows, for any set of recordings.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Squares {
    place_m2: f64,
    heading_rad2: f64,
    steps: usize,
}

impl Squares {
    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            place_m2: self.place_m2 + other.place_m2,
            heading_rad2: self.heading_rad2 + other.heading_rad2,
            steps: self.steps + other.steps,
        }
    }

    /// The errors; none of no step.
    #[must_use]
    pub fn rmse(&self) -> Option<Rmse> {
        let mean = |sum: f64| (sum / self.steps as f64).sqrt();
        (self.steps > 0).then(|| Rmse {
            position_mm: mean(self.place_m2) * 1000.0,
            heading_deg: mean(self.heading_rad2).to_degrees(),
        })
    }
}

/// A model fitted to somebody.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Which model.
    pub kind: ModelKind,
    /// Its parameters, as [`ModelKind::parameters`] names them.
    pub parameters: Vec<f64>,
    /// Half the width of each one's 95 % confidence interval, by recordings: steps of one walk are not independent.
    pub half_width: Vec<f64>,
    /// Errors on what it was fitted to.
    pub fitted: Squares,
    /// Errors on what it was not.
    pub validated: Squares,
    /// How many recordings each.
    pub recordings: (usize, usize),
    /// Why the runtime would refuse it, where it would.
    pub refused: Option<HarnessError>,
}

/// Splits recordings into those to fit and those to validate: the last walk of each trajectory validates, so that of
/// fifteen ten fit and five validate, as in the paper.
#[must_use]
pub fn split(recordings: &[&Recording]) -> (Vec<usize>, Vec<usize>) {
    let of = |i: usize| (&recordings[i].subject, &recordings[i].trajectory);
    let is_last = |i: usize| {
        let same = (0..recordings.len()).filter(|j| of(*j) == of(i));
        let walks: Vec<u32> = same.map(|j| recordings[j].repetition).collect();
        walks.len() > 1 && walks.iter().all(|walk| *walk <= recordings[i].repetition)
    };
    (0..recordings.len()).partition(|i| !is_last(*i))
}

/// Fits a model to recordings of one handler, or of all.
///
/// # Errors
/// Where there are too few recordings, or the data does not fix the parameters.
pub fn fit(kind: ModelKind, whom: &str, recordings: &[&Recording], dt_s: f64) -> Result<Fit, FitError> {
    let (to_fit, to_validate) = split(recordings);
    if to_fit.len() < 2 || to_validate.is_empty() {
        return Err(FitError::TooFew { whom: whom.to_owned(), recordings: recordings.len() });
    }
    let walks =
        |which: &[usize]| -> Vec<Vec<(Se2, Se2)>> { which.iter().map(|i| recordings[*i].steps(dt_s)).collect() };
    let (fitting, validating) = (walks(&to_fit), walks(&to_validate));
    let not_found = |why: &str| FitError::NotFound { model: kind.name(), whom: whom.to_owned(), why: why.to_owned() };
    let problem = Problem { kind, dt_s, walks: &fitting, parameters: DVector::from_vec(kind.first_guess()) };
    let (solved, report) = LevenbergMarquardt::new().minimize(problem);
    if !report.termination.was_successful() {
        return Err(not_found(&format!("the search ended without a result: {:?}", report.termination)));
    }
    let half_width = solved.half_widths().ok_or_else(|| not_found("the data does not fix its parameters"))?;
    let mut parameters: Vec<f64> = solved.parameters.iter().copied().collect();
    let model = kind.model(&parameters, dt_s).map_err(|error| not_found(&error.to_string()))?;
    let refused = match (kind, &model) {
        (ModelKind::Delayed, InteractionModel::Delayed(harness)) => {
            parameters[3] = harness.alpha();
            DelayedHarness::new(pose2(&harness.robot_from_default()), harness.alpha(), dt_s).err()
        }
        _ => None,
    };
    Ok(Fit {
        kind,
        parameters,
        half_width,
        fitted: squares(&model, &fitting),
        validated: squares(&model, &validating),
        recordings: (to_fit.len(), to_validate.len()),
        refused,
    })
}

/// The rigid harness of whom nobody fitted: the mean offset at the beginning of the walks to fit, alpha 0
/// (Kim et al. 2023, section 6.1, Fixed-unopt-ind). Its errors on the walks to validate.
#[must_use]
pub fn unfitted(recordings: &[&Recording], dt_s: f64) -> Option<Squares> {
    let (to_fit, to_validate) = split(recordings);
    let starts: Vec<Se2> = to_fit
        .iter()
        .filter_map(|i| recordings[*i].samples.first())
        .map(|sample| sample.world_from_robot.inverse() * sample.world_from_handler)
        .collect();
    let n = starts.len() as f64;
    let mean = |of: fn(&Se2) -> f64| starts.iter().map(of).sum::<f64>() / n;
    let offset = Pose2::new(mean(|s| s.translation.x), mean(|s| s.translation.y), mean(|s| s.rotation.angle()));
    let model = InteractionModel::Rigid(RigidHarness::new(offset).ok()?);
    let walks: Vec<_> = to_validate.iter().map(|i| recordings[*i].steps(dt_s)).collect();
    Some(squares(&model, &walks))
}

/// Where a model predicts the handler in a walk, from where they were at its beginning: one pose for each step.
#[must_use]
pub fn predict(model: &InteractionModel, walk: &[(Se2, Se2)]) -> Vec<Se2> {
    let Some((robot, handler)) = walk.first() else { return Vec::new() };
    let mut offset = robot.inverse() * handler;
    let mut poses = vec![*handler];
    for pair in walk.windows(2) {
        let (before, after) = (pair[0].0, pair[1].0);
        offset = model.step(&offset, &(before.inverse() * after));
        poses.push(after * offset);
    }
    poses
}

/// Errors of a step: place, and heading.
fn errors<'a>(predicted: &'a [Se2], walk: &'a [(Se2, Se2)]) -> impl Iterator<Item = (f64, f64, f64)> + 'a {
    predicted.iter().zip(walk).skip(1).map(|(predicted, (_, seen))| {
        let off = predicted.translation.vector - seen.translation.vector;
        (off.x, off.y, wrap_angle(predicted.rotation.angle() - seen.rotation.angle()))
    })
}

fn squares(model: &InteractionModel, walks: &[Vec<(Se2, Se2)>]) -> Squares {
    let mut sum = Squares::default();
    for walk in walks {
        for (x, y, heading) in errors(&predict(model, walk), walk) {
            sum = sum.and(Squares { place_m2: x * x + y * y, heading_rad2: heading * heading, steps: 1 });
        }
    }
    sum
}

/// The search: parameters in, errors of all steps out.
struct Problem<'a> {
    kind: ModelKind,
    dt_s: f64,
    walks: &'a [Vec<(Se2, Se2)>],
    parameters: DVector<f64>,
}

impl Problem<'_> {
    /// The errors with some parameters, one walk after the other; none where the model is not defined.
    fn errors_with(&self, parameters: &DVector<f64>) -> Option<Vec<Vec<f64>>> {
        let model = self.kind.model(parameters.as_slice(), self.dt_s).ok()?;
        let of = |walk: &Vec<(Se2, Se2)>| {
            errors(&predict(&model, walk), walk).flat_map(|(x, y, heading)| [x, y, heading * HEADING_M]).collect()
        };
        Some(self.walks.iter().map(of).collect())
    }

    /// Half the widths of the 95 % confidence intervals, clustered by walks; none where the errors do not depend on
    /// one of the parameters.
    fn half_widths(&self) -> Option<Vec<f64>> {
        let jacobian = self.jacobian()?;
        let residuals = self.errors_with(&self.parameters)?;
        let bread = (jacobian.transpose() * &jacobian).try_inverse()?;
        let count = self.parameters.len();
        let mut meat = DMatrix::zeros(count, count);
        let mut row = 0;
        for walk in &residuals {
            let part = jacobian.rows(row, walk.len()).transpose() * DVector::from_column_slice(walk);
            meat += &part * part.transpose();
            row += walk.len();
        }
        let walks = residuals.len() as f64;
        let covariance = &bread * meat * &bread * (walks / (walks - 1.0));
        let t = student_t(walks - 1.0);
        Some((0..count).map(|i| t * covariance[(i, i)].max(0.0).sqrt()).collect())
    }
}

/// Student's t at 97.5 %, by its expansion about the normal distribution; within 2 % from 4 degrees of freedom on.
fn student_t(freedom: f64) -> f64 {
    let z: f64 = 1.959_964;
    let first = (z.powi(3) + z) / (4.0 * freedom);
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * freedom * freedom);
    z + first + second
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.parameters.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(DVector::from_vec(self.errors_with(&self.parameters)?.concat()))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let columns: Option<Vec<DVector<f64>>> = (0..self.parameters.len())
            .map(|i| {
                let with = |by: f64| {
                    let mut moved = self.parameters.clone();
                    moved[i] += by;
                    self.errors_with(&moved).map(|errors| DVector::from_vec(errors.concat()))
                };
                Some((with(DIFFERENCE)? - with(-DIFFERENCE)?) / (2.0 * DIFFERENCE))
            })
            .collect();
        Some(DMatrix::from_columns(&columns?))
    }
}

#[cfg(test)]
mod tests {
    use super::{ModelKind, fit, predict, split, student_t};
    use crate::data::{Recording, Sample};
    use crate::script::trajectories;
    use crate::walker::synthesize;
    use guidance::Se2;

    const DT_S: f64 = 0.5;

    /// Walks of somebody who follows a model exactly, from a start that is off.
    fn walks(kind: ModelKind, truth: &[f64]) -> Vec<Recording> {
        let model = kind.model(truth, DT_S).expect("a model");
        let mut recordings = Vec::new();
        for (trajectory, robot) in trajectories(DT_S) {
            for repetition in 1..=3u32 {
                let start = Se2::new(nalgebra::Vector2::new(-0.7, -0.2 - 0.05 * f64::from(repetition)), 0.1);
                let pairs: Vec<_> = robot.iter().map(|robot| (*robot, robot * start)).collect();
                // A recording's gaps are small: the steps in between are walked straight on.
                let poses = predict(&model, &pairs);
                let mut samples = Vec::new();
                for (i, (robot, handler)) in robot.iter().zip(&poses).enumerate() {
                    let sample =
                        Sample { t_s: i as f64 * DT_S, world_from_robot: *robot, world_from_handler: *handler };
                    samples.push(sample);
                }
                recordings.push(Recording { subject: "x".into(), trajectory: trajectory.into(), repetition, samples });
            }
        }
        recordings
    }

    #[test]
    fn a_handler_who_follows_a_model_is_found_again() {
        for (kind, truth) in [
            (ModelKind::Rigid, vec![-0.8, -0.3, 0.1]),
            (ModelKind::Delayed, vec![-0.8, -0.3, 0.1, 0.55]),
            (ModelKind::Rod, vec![-0.25, 0.05, 0.8]),
        ] {
            let recordings = walks(kind, &truth);
            let all: Vec<&Recording> = recordings.iter().collect();
            let fit = fit(kind, "x", &all, DT_S).expect("found");
            for (found, truth) in fit.parameters.iter().zip(&truth) {
                assert!((found - truth).abs() < 1e-5, "{kind:?}: {:?}", fit.parameters);
            }
            assert!(fit.validated.rmse().is_some_and(|rmse| rmse.position_mm < 1e-2));
            assert_eq!(fit.recordings, (10, 5));
        }
    }

    #[test]
    fn the_delayed_harness_predicts_a_walker_that_is_none_best() {
        let recordings: Vec<Recording> =
            synthesize(3).into_iter().filter(|recording| recording.subject == "sim-4").collect();
        let all: Vec<&Recording> = recordings.iter().collect();
        let error = |kind| {
            let fit = fit(kind, "sim-4", &all, DT_S).expect("found");
            assert!(fit.half_width.iter().all(|half| half.is_finite() && *half > 0.0), "{fit:?}");
            fit.validated.rmse().expect("steps").position_mm
        };
        let (rigid, rod, delayed) = (error(ModelKind::Rigid), error(ModelKind::Rod), error(ModelKind::Delayed));
        assert!(delayed < rigid && delayed < rod, "delayed {delayed}, rigid {rigid}, rod {rod}");
    }

    #[test]
    fn of_three_walks_the_last_validates() {
        let recordings = walks(ModelKind::Rigid, &[-0.8, -0.3, 0.0]);
        let all: Vec<&Recording> = recordings.iter().collect();
        let (to_fit, to_validate) = split(&all);
        assert_eq!((to_fit.len(), to_validate.len()), (10, 5));
        assert!(to_validate.iter().all(|i| all[*i].repetition == 3));
        assert!(fit(ModelKind::Rigid, "x", &all[..1], DT_S).is_err());
    }

    #[test]
    fn students_t_is_as_in_the_tables() {
        for (freedom, t) in [(4.0, 2.776), (9.0, 2.262), (89.0, 1.987)] {
            assert!((student_t(freedom) / t - 1.0).abs() < 0.02, "{freedom}");
        }
    }
}
