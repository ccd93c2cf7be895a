//! Scenarios and routes (TOML): where a walk starts and ends, and the cues on the way.
//!
//! A scenario, in `config/scenarios/NAME.toml`; lengths in metres, angles in degrees, places in the world frame:
//!
//! ```toml
//! world = "../worlds/corridor.toml"  # from this file's folder; or a ROS map's .yaml
//! start = { at = [0, 0], yaw_deg = 0 }
//! goal = { at = [33, 0], within_m = 1.5 }  # at will: without it the walk lasts until its time limit
//! time_limit_s = 180
//!
//! [[cue]]                            # cues come in this order, one after the other
//! kind = "forward"                   # "stop", "forward", "left", "right"
//! at_s = 1.0                         # at this run time,
//!
//! [[cue]]
//! kind = "left"
//! at = [14, 0]                       # or where the robot is within `within_m` of a place
//! within_m = 1.2                     # default 1.0
//! ```
//!
//! The handler may disturb the walk; in the flat world they can only let the handle go:
//!
//! ```toml
//! [[handler]]
//! does = "snag"                      # "snag": is caught, and holds on; "let_go": stands without the handle, and walks
//!                                    # back to it afterwards; "pull": pulls at the handle,
//! at_s = 6.0                         # from this run time on,
//! for_s = 1.5                        # for so long,
//! pull_n = [0, -20]                  # so hard, newtons: ahead and to the left as the robot stands; "pull" alone
//! ```
//!
//! A route is the same without `world`, `start` and `handler`, and with `time_limit_s` at will.

use std::path::{Path, PathBuf};

use guidance::HandlerErrors;
use guidance::se2::{Point, pose2, se2};
use messages::{CueKind, Pose2};
use serde::Deserialize;
use toml::Spanned;

use crate::text_file::TomlText;
use crate::{World, WorldError, text_file};

/// Where a walk is to end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Place in the world.
    pub at: Point,
    /// The robot has arrived when it is as near, metres.
    pub within_m: f64,
}

impl Goal {
    /// Whether the robot has arrived.
    #[must_use]
    pub fn reached(&self, world_from_robot: Pose2) -> bool {
        is_within(world_from_robot, self.at, self.within_m)
    }
}

/// When a cue is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CueTrigger {
    /// At a run time, seconds.
    Time(f64),
    /// Where the robot is within some metres of a place in the world.
    Place(Point, f64),
}

/// A cue of a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CuePoint {
    /// What is asked for.
    pub kind: CueKind,
    /// When.
    pub trigger: CueTrigger,
    /// A handler gives it so much later, metres of way from there; less than 0: so much farther from the place, in a
    /// straight line. It counts for a place.
    pub late_m: f64,
}

/// The cues of a walk, in order, and where and when it ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// The cues; none is given before the one before it has been.
    pub cues: Vec<CuePoint>,
    /// Where the walk is to end, if it says so.
    pub goal: Option<Goal>,
    /// Run time at which the walk has failed, seconds, if it says so.
    pub time_limit_s: Option<f64>,
}

/// How a handler disturbs a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DisturbanceKind {
    /// Stands without the handle. Afterwards they walk back to it and take it.
    LetGo,
    /// Is caught by something, and holds on.
    Snag,
    /// Pulls at the handle: ahead and to the left as the robot stands, newtons.
    Pull([f64; 2]),
}

/// A disturbance by the handler, and when it comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// Which.
    pub kind: DisturbanceKind,
    /// It begins at this run time, seconds.
    pub at_s: f64,
    /// It lasts for this time, seconds.
    pub for_s: f64,
}

impl Disturbance {
    /// Whether it is there at a run time, seconds.
    #[must_use]
    pub fn is_at(&self, run_time_s: f64) -> bool {
        (self.at_s..self.at_s + self.for_s).contains(&run_time_s)
    }
}

/// A walk in a world.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// The world's file, or a ROS map's.
    pub world: PathBuf,
    /// Where the robot starts, world frame.
    pub start: Pose2,
    /// Cues, goal and time limit; a scenario has the latter.
    pub route: Route,
    /// How the handler disturbs the walk.
    pub disturbances: Vec<Disturbance>,
}

/// Gives a route's cues as they come due.
#[derive(Debug, Clone)]
pub struct CueSequence {
    cues: Vec<CuePoint>,
    next: usize,
    /// The next cue's place was reached; the way that the robot has walked since, metres, and where it was last.
    since: Option<(f64, Point)>,
}

impl CueSequence {
    /// All cues of a route, none given yet.
    #[must_use]
    pub fn new(route: &Route) -> Self {
        Self { cues: route.cues.clone(), next: 0, since: None }
    }

    /// The next cue, if it is due at this run time with the robot there; it is then given.
    pub fn due(&mut self, run_time_s: f64, world_from_robot: Pose2) -> Option<CueKind> {
        let cue = *self.cues.get(self.next)?;
        let due = match cue.trigger {
            CueTrigger::Time(at_s) => run_time_s >= at_s,
            CueTrigger::Place(at, within_m) => {
                let early_m = (-cue.late_m).max(0.0);
                self.walked_since(|| is_within(world_from_robot, at, within_m + early_m), world_from_robot)
                    .is_some_and(|walked_m| walked_m >= cue.late_m)
            }
        };
        if due {
            (self.next, self.since) = (self.next + 1, None);
        }
        due.then_some(cue.kind)
    }

    /// The way since the next cue's place was reached, metres.
    fn walked_since(&mut self, is_reached: impl Fn() -> bool, world_from_robot: Pose2) -> Option<f64> {
        let at = Point::new(world_from_robot.x_m, world_from_robot.y_m);
        let (walked_m, from) = self.since.or_else(|| is_reached().then_some((0.0, at)))?;
        let step_m = (at - from).norm();
        // A body that sways walks nowhere.
        let (counted_m, from) = if step_m >= STEP_M { (step_m, at) } else { (0.0, from) };
        self.since = Some((walked_m + counted_m, from));
        Some(walked_m + step_m)
    }

    /// How many cues have been given.
    #[must_use]
    pub fn given(&self) -> usize {
        self.next
    }

    /// Takes the first `count` cues as given.
    pub fn skip(&mut self, count: usize) {
        (self.next, self.since) = (count.min(self.cues.len()), None);
    }

    /// Whether all cues have been given.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.next == self.cues.len()
    }
}

fn is_within(world_from_robot: Pose2, at: Point, within_m: f64) -> bool {
    (world_from_robot.x_m - at.x).hypot(world_from_robot.y_m - at.y) <= within_m
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScenarioFile {
    world: PathBuf,
    start: Spanned<StartEntry>,
    goal: Option<Spanned<GoalEntry>>,
    time_limit_s: Spanned<f64>,
    #[serde(default)]
    cue: Vec<Spanned<CueEntry>>,
    #[serde(default)]
    handler: Vec<Spanned<DisturbanceEntry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RouteFile {
    goal: Option<Spanned<GoalEntry>>,
    time_limit_s: Option<Spanned<f64>>,
    #[serde(default)]
    cue: Vec<Spanned<CueEntry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StartEntry {
    at: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GoalEntry {
    at: [f64; 2],
    #[serde(default = "one_metre")]
    within_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CueEntry {
    kind: CueKind,
    at_s: Option<Spanned<f64>>,
    at: Option<Spanned<[f64; 2]>>,
    within_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum EntryKind {
    LetGo,
    Snag,
    Pull,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DisturbanceEntry {
    does: EntryKind,
    at_s: f64,
    for_s: f64,
    pull_n: Option<[f64; 2]>,
}

fn one_metre() -> f64 {
    1.0
}

/// Way is counted in steps of this length, metres.
const STEP_M: f64 = 0.1;
/// No place is farther from the origin, metres.
const PLACE_M: (f64, f64) = (-1e6, 1e6);
/// How near is near, metres.
const WITHIN_M: (f64, f64) = (0.01, 100.0);
/// A day, seconds.
const TIME_S: (f64, f64) = (0.0, 86_400.0);
/// A disturbance lasts for a step of the physics at least, seconds.
const LASTS_S: (f64, f64) = (0.01, 86_400.0);
/// No handler pulls harder on either axis, newtons.
const PULL_N: (f64, f64) = (-500.0, 500.0);
/// A walk that ends at once is none, seconds.
const LIMIT_S: (f64, f64) = (1.0, 86_400.0);

impl Scenario {
    /// Reads a scenario file. Its world is not read; see [`Scenario::load_world`].
    ///
    /// # Errors
    /// Where the file cannot be read, a key is unknown or missing, or a value is out of its bounds; the error names
    /// file, line and key.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        let text = text_file::read(path)?;
        Self::from_toml(&path.display().to_string(), &text, path.parent().unwrap_or(Path::new("")))
    }

    /// A scenario from its text. `file` names it in errors, `folder` is where its world's path starts.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn from_toml(file: &str, text: &str, folder: &Path) -> Result<Self, WorldError> {
        let toml = TomlText { file, text };
        let entry: ScenarioFile = toml.parse()?;
        let (span, start) = (entry.start.span(), entry.start.get_ref());
        let at = place(&toml, &span, "start.at", start.at)?;
        toml.check(&span, "start.yaw_deg", start.yaw_deg, (-720.0, 720.0))?;
        let yaw_rad = guidance::se2::wrap_angle(start.yaw_deg.to_radians());
        let route = RouteFile { goal: entry.goal, time_limit_s: Some(entry.time_limit_s), cue: entry.cue };
        Ok(Self {
            world: folder.join(&entry.world),
            start: Pose2::new(at.x, at.y, yaw_rad),
            route: route.check(&toml)?,
            disturbances: entry.handler.iter().map(|entry| disturbance(&toml, entry)).collect::<Result<_, _>>()?,
        })
    }

    /// The same walk by a handler who errs: who faces off the travel line at the start, and gives the cues of places
    /// too late or too early on the way. Cues at a run time come when they come.
    #[must_use]
    pub fn with_errors(mut self, errors: &HandlerErrors) -> Self {
        for cue in &mut self.route.cues {
            cue.late_m = errors.timing_m;
        }
        self.start = pose2(&errors.start(&se2(self.start)));
        self
    }

    /// Reads the scenario's world.
    ///
    /// # Errors
    /// As [`World::load`].
    pub fn load_world(&self) -> Result<World, WorldError> {
        World::load(&self.world)
    }
}

impl Route {
    /// Reads a route file.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        Self::from_toml(&path.display().to_string(), &text_file::read(path)?)
    }

    /// A route from its text. `file` names it in errors.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn from_toml(file: &str, text: &str) -> Result<Self, WorldError> {
        let toml = TomlText { file, text };
        toml.parse::<RouteFile>()?.check(&toml)
    }
}

impl RouteFile {
    fn check(&self, toml: &TomlText<'_>) -> Result<Route, WorldError> {
        let goal = self.goal.as_ref().map(|entry| -> Result<Goal, WorldError> {
            let (span, goal) = (entry.span(), entry.get_ref());
            toml.check(&span, "goal.within_m", goal.within_m, WITHIN_M)?;
            Ok(Goal { at: place(toml, &span, "goal.at", goal.at)?, within_m: goal.within_m })
        });
        if let Some(limit) = &self.time_limit_s {
            toml.check(&limit.span(), "time_limit_s", *limit.get_ref(), LIMIT_S)?;
        }
        let cues = self.cue.iter().map(|entry| cue(toml, entry)).collect::<Result<Vec<_>, _>>()?;
        Ok(Route {
            cues,
            goal: goal.transpose()?,
            time_limit_s: self.time_limit_s.as_ref().map(|limit| *limit.get_ref()),
        })
    }
}

fn cue(toml: &TomlText<'_>, entry: &Spanned<CueEntry>) -> Result<CuePoint, WorldError> {
    let (span, cue) = (entry.span(), entry.get_ref());
    let trigger = match (&cue.at_s, &cue.at, &cue.within_m) {
        (Some(at_s), None, None) => {
            toml.check(&at_s.span(), "at_s", *at_s.get_ref(), TIME_S)?;
            CueTrigger::Time(*at_s.get_ref())
        }
        (None, Some(at), within_m) => {
            if let Some(within_m) = within_m {
                toml.check(&within_m.span(), "within_m", *within_m.get_ref(), WITHIN_M)?;
            }
            let within_m = within_m.as_ref().map_or_else(one_metre, |within_m| *within_m.get_ref());
            CueTrigger::Place(place(toml, &at.span(), "at", *at.get_ref())?, within_m)
        }
        _ => return Err(toml.refuse(&span, "cue", "needs either at_s, or at with within_m".to_owned())),
    };
    Ok(CuePoint { kind: cue.kind, trigger, late_m: 0.0 })
}

fn disturbance(toml: &TomlText<'_>, entry: &Spanned<DisturbanceEntry>) -> Result<Disturbance, WorldError> {
    let (span, disturbance) = (entry.span(), entry.get_ref());
    toml.check(&span, "handler.at_s", disturbance.at_s, TIME_S)?;
    toml.check(&span, "handler.for_s", disturbance.for_s, LASTS_S)?;
    let kind = match (&disturbance.does, disturbance.pull_n) {
        (EntryKind::LetGo, None) => DisturbanceKind::LetGo,
        (EntryKind::Snag, None) => DisturbanceKind::Snag,
        (EntryKind::Pull, Some(pull_n)) => {
            pull_n.into_iter().try_for_each(|newtons| toml.check(&span, "handler.pull_n", newtons, PULL_N))?;
            DisturbanceKind::Pull(pull_n)
        }
        _ => return Err(toml.refuse(&span, "handler", "pull_n belongs to does = \"pull\", which needs it".to_owned())),
    };
    Ok(Disturbance { kind, at_s: disturbance.at_s, for_s: disturbance.for_s })
}

fn place(
    toml: &TomlText<'_>,
    span: &std::ops::Range<usize>,
    key: &'static str,
    [x, y]: [f64; 2],
) -> Result<Point, WorldError> {
    toml.check(span, key, x, PLACE_M)?;
    toml.check(span, key, y, PLACE_M)?;
    Ok(Point::new(x, y))
}
