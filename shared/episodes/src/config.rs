//! What episodes are like.

use std::f64::consts::PI;
use std::sync::Arc;

use guidance::se2::{Point, Se2};
use guidance::{
    ActionTable, AwarenessConfig, DelayedHarness, HarnessError, Interaction, InteractionModel, RewardConfig,
    RigidHarness, ShieldConfig,
};
use messages::{CueKind, Pose2};
use nalgebra::Vector2;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use world::{
    Bodies, DepthConfig, FloorPlan, GeneratorConfig, HandlerProfile, Legs, LegsConfig, LidarConfig, OdometryConfig,
    Site, Team, generate, generate_drops,
};

use crate::task::Task;

/// How exact the sensors are (Kim et al. 2023, section 5.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noise {
    /// They measure what is.
    Ideal,
    /// Gaussian lidar noise with drop-outs, Redwood depth noise at intensity 1, drifting odometry.
    Noisy,
    /// The same, and a robot that walks on [`Config::legs`].
    Legged,
}

/// How handlers follow (Kim et al. 2023, table 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Harness {
    /// At a fixed offset.
    Rigid,
    /// By the delayed harness.
    Delayed,
}

/// Who the handlers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handlers {
    /// The one of the configuration, who does what the model says.
    Nominal,
    /// Another one in each episode, with an offset and an alpha of their own, who sways; the shield is told what a fit
    /// to them would have found, which is not quite right.
    Personal,
}

/// What handlers are drawn from, least and greatest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandlerRanges {
    /// Their remembered share per decision.
    pub alpha: [f64; 2],
    /// Where they walk, robot frame, metres and radians.
    pub x_m: [f64; 2],
    /// See [`HandlerRanges::x_m`].
    pub y_m: [f64; 2],
    /// See [`HandlerRanges::x_m`].
    pub yaw_rad: [f64; 2],
}

/// How the reward is measured; see [`guidance::Measure`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RewardMeasure {
    /// From the cue's start.
    Start,
    /// Along the travel line.
    Line,
}

/// Where episodes take place.
#[derive(Debug, Clone)]
pub enum Places {
    /// In another generated world each time.
    Generated(GeneratorConfig),
    /// In another generated world each time, whose floor ends at edges.
    Drops(GeneratorConfig),
    /// In corridors of these floor plans, with other things and people each time.
    Plans(Arc<Vec<FloorPlan>>, GeneratorConfig),
}

/// How robot and handler came to where a cue is given: the robot looked around on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// So often,
    pub looks: usize,
    /// so far from each other and from the place of the cue, metres,
    pub apart_m: f64,
    /// with so much time between two of them, seconds.
    pub apart_s: f64,
    /// Where something stands on the way the cue is given elsewhere. Otherwise they came another way.
    pub must_be_free: bool,
}

impl Arrival {
    /// A few looks. The time between them is enough for the way, and short enough that the first floor is remembered.
    pub const SPARSE: Self = Self { looks: 3, apart_m: 0.75, apart_s: 2.5, must_be_free: false };
    /// A look at each decision on the way.
    pub const DENSE: Self = Self { looks: 9, apart_m: 0.25, apart_s: 0.5, must_be_free: true };

    /// Where it looked, so far before the place of the cue, metres.
    pub(crate) fn before_m(&self) -> impl Iterator<Item = f64> {
        let apart_m = self.apart_m;
        (1..=self.looks).rev().map(move |look| look as f64 * apart_m)
    }
}

/// There is nowhere to give a cue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "no place for the cue {0:?}: no corridor with room for robot and handler, in which one could say what is meant"
)]
pub struct NoTask(pub CueKind);

/// See [`Config::walked_before`], metres: beyond, the observation tells no farther.
const WALKED_BEFORE_M: f64 = 30.0;
/// So many corridors are looked at, each for so many tasks, before a cue is said to have no place.
const SITES: usize = 200;
const TASKS: usize = 10;
/// Robot and handler begin with so much room about them, metres.
const ROOM_M: f64 = 0.06;
/// The robot's middle begins so far from a low step, metres: nearer ones are not in view from the start.
const FROM_STEP_M: f64 = 1.3;
/// Draws of a handler until a model describes them: nearly always the first does.
const HANDLER_TRIES: usize = 1000;

/// See the module.
#[derive(Debug, Clone)]
pub struct Config {
    /// Where.
    pub places: Places,
    /// How they came to where the cue is given.
    pub arrival: Arrival,
    /// How exact the sensors are.
    pub noise: Noise,
    /// How handlers follow.
    pub harness: Harness,
    /// Who they are.
    pub handlers: Handlers,
    /// Where the handler of the configuration walks, robot frame; others walk about there.
    pub robot_from_handler: Pose2,
    /// Their remembered share per decision; that of others is about as great.
    pub alpha: f64,
    /// Robot and handler as they touch things.
    pub bodies: Bodies,
    /// What measurements are held to; without a memory there is one scan and one frame, as in the paper.
    pub awareness: AwarenessConfig,
    /// The actions.
    pub table: ActionTable,
    /// Decision period, seconds.
    pub dt_s: f64,
    /// Decisions of an episode.
    pub decisions: usize,
    /// Where the way of a task takes longer, with pauses, the episode has as many decisions more.
    pub has_time: bool,
    /// The cues, and how often each is given in relation to the others.
    pub cues: Vec<(CueKind, f64)>,
    /// Handlers face off the travel line by up to this, radians.
    pub orientation_max_rad: f64,
    /// Cues to turn are given so much too early or too late at the most, metres of way before the place where they are
    /// due; none: anywhere.
    pub timing_max_m: Option<f64>,
    /// Share of the episodes with *forward* in which that cue was given long before, anywhere up to 30 m off: who is
    /// led along a corridor for minutes gives it once.
    pub walked_before: f64,
    /// The reward.
    pub reward: RewardConfig,
    /// Reward, once, for a cue that is followed as [`Task`] counts it, and for an error of orientation put right; who
    /// walks on where they were to stand gives it back. Ours; 0 in the paper.
    pub followed_reward: f64,
    /// What an action costs that the shield forbade, taken all the same: behind a beta above 0 it mostly does no harm,
    /// and is lost behind beta 0. Ours; 0 in the paper.
    pub forbidden_penalty: f64,
    /// What the reward is measured by.
    pub measure: RewardMeasure,
    /// The shield.
    pub shield: ShieldConfig,
    /// The lidar; its noise is [`Config::noise`]'s.
    pub lidar: LidarConfig,
    /// The depth camera, likewise; none: there is none.
    pub depth: Option<DepthConfig>,
    /// Odometry, likewise.
    pub odometry: OdometryConfig,
    /// How the robot walks on legs, where [`Config::noise`] says that it does.
    pub legs: LegsConfig,
    /// Whether the shield judges every action at every decision; without it nothing is forbidden, nor observed.
    pub judges: bool,
    /// Observations of the last so many decisions stand in one; 0: none is made.
    pub frames: usize,
}

impl Config {
    /// The lidar with its noise.
    #[must_use]
    pub fn lidar_config(&self) -> LidarConfig {
        match self.noise {
            Noise::Ideal => LidarConfig { sigma_m: 0.0, drop_out: 0.0, ..self.lidar.clone() },
            Noise::Noisy | Noise::Legged => self.lidar.clone(),
        }
    }

    /// The camera with its noise.
    #[must_use]
    pub fn depth_config(&self) -> Option<DepthConfig> {
        let redwood = if self.noise == Noise::Ideal { 0.0 } else { 1.0 };
        Some(DepthConfig { noise_per_m: 0.0, redwood, ..self.depth.clone()? })
    }

    /// The odometry with its drift.
    #[must_use]
    pub fn odometry_config(&self) -> OdometryConfig {
        match self.noise {
            Noise::Ideal => OdometryConfig {
                scale_sigma: 0.0,
                yaw_walk_rad_per_sqrt_m: 0.0,
                yaw_walk_rad_per_sqrt_rad: 0.0,
                ..self.odometry.clone()
            },
            Noise::Noisy | Noise::Legged => self.odometry.clone(),
        }
    }

    /// Who the handlers are, least and greatest.
    #[must_use]
    pub fn handler_ranges(&self) -> HandlerRanges {
        let Pose2 { x_m, y_m, yaw_rad } = self.robot_from_handler;
        let spread = if self.handlers == Handlers::Personal { 1.0 } else { 0.0 };
        let about = |middle: f64, by: f64| [middle - spread * by, middle + spread * by];
        HandlerRanges {
            alpha: about(self.alpha, 0.2).map(|alpha| alpha.max(0.0)),
            x_m: about(x_m, 0.12),
            y_m: about(y_m, 0.10),
            yaw_rad: about(yaw_rad, 0.08),
        }
    }

    /// How a handler follows, and what a fit to them has found. Whom no model describes is drawn anew.
    #[must_use]
    pub(crate) fn draw_handler(&self, random: &mut impl Rng) -> (InteractionModel, InteractionModel) {
        for _ in 0..HANDLER_TRIES {
            if let Ok(drawn) = self.try_handler(random) {
                return drawn;
            }
        }
        let nominal = || self.model(self.robot_from_handler, self.alpha);
        nominal().and_then(|model| Ok((model, nominal()?))).unwrap_or_else(|error| unreachable!("checked: {error}"))
    }

    fn try_handler(&self, random: &mut impl Rng) -> Result<(InteractionModel, InteractionModel), HarnessError> {
        let ranges = self.handler_ranges();
        let mut within = |[least, most]: [f64; 2]| least + (most - least) * random.random::<f64>();
        let offset = Pose2::new(within(ranges.x_m), within(ranges.y_m), within(ranges.yaw_rad));
        let alpha = within(ranges.alpha);
        let mut about = |middle: f64, by: f64| match self.handlers {
            Handlers::Nominal => middle,
            Handlers::Personal => within([middle - by, middle + by]),
        };
        let x_m = about(offset.x_m, 0.04);
        let fitted = Pose2::new(x_m, about(offset.y_m, 0.04), about(offset.yaw_rad, 0.05));
        let fitted = (fitted, about(alpha, 0.05).max(0.0));
        Ok((self.model(offset, alpha)?, self.model(fitted.0, fitted.1)?))
    }

    fn model(&self, offset: Pose2, alpha: f64) -> Result<InteractionModel, HarnessError> {
        Ok(match self.harness {
            Harness::Rigid => InteractionModel::Rigid(RigidHarness::new(offset)?),
            Harness::Delayed => InteractionModel::Delayed(DelayedHarness::new(offset, alpha, self.dt_s)?),
        })
    }

    /// Another world; none where a floor plan's draw finds no way.
    pub(crate) fn draw_site(&self, random: &mut ChaCha8Rng) -> Option<Arc<Site>> {
        match &self.places {
            Places::Generated(config) => Some(Arc::new(generate(config, random.random()))),
            Places::Drops(config) => Some(Arc::new(generate_drops(config, random))),
            Places::Plans(plans, config) => {
                let plan = &plans[random.random_range(0..plans.len())];
                plan.site(config, random.random()).map(Arc::new)
            }
        }
    }

    /// Whether each cue can be given somewhere: a floor plan may have nothing to turn into, and no place where there is
    /// nothing; and who is too stout has room nowhere.
    ///
    /// # Errors
    /// The first cue for which there is no place.
    pub fn check_tasks(&self) -> Result<(), NoTask> {
        for (cue, _) in self.cues.iter().filter(|(_, share)| *share > 0.0) {
            let mut random = ChaCha8Rng::seed_from_u64(0);
            let profile = HandlerProfile::exact(self.draw_handler(&mut random).0);
            let mut finds = || {
                let site = self.draw_site(&mut random)?;
                (0..TASKS).find_map(|_| self.draw_start(&site, *cue, &profile, &mut random))
            };
            (0..SITES).find_map(|_| finds()).ok_or(NoTask(*cue))?;
        }
        Ok(())
    }

    /// Somebody gives that cue there, where both have room.
    pub(crate) fn draw_start(
        &self,
        site: &Site,
        cue: CueKind,
        profile: &HandlerProfile,
        random: &mut impl Rng,
    ) -> Option<(Task, Team)> {
        let task = Task::draw(&site.course, cue, self, &profile.model.robot_from_default(), random)?;
        let team = Team::new(&site.world, self.bodies, profile.clone(), &task.world_from_robot);
        let came = || {
            let mut on_the_way = self.arrivals(&task, &team);
            on_the_way.all(|on_the_way| on_the_way.is_some_and(|team| team.is_free(&site.world, 0.0)))
        };
        let at = Point::from(task.world_from_robot.translation.vector);
        let is_near_step = site.world.to_low_step_m(at) < FROM_STEP_M;
        let may_start = !is_near_step && team.is_free(&site.world, ROOM_M) && (!self.arrival.must_be_free || came());
        may_start.then_some((task, team))
    }

    /// They come along the corridor to a task's place, beside its middle as they are there; none before its beginning.
    pub(crate) fn arrivals(&self, task: &Task, team: &Team) -> impl Iterator<Item = Option<Team>> {
        let foot = task.line.foot(Point::from(task.world_from_robot.translation.vector));
        self.arrival.before_m().map(move |before_m| {
            let way_m = foot.way_m - before_m;
            (way_m > 0.0).then(|| team.coming_by(&(task.line.at(way_m) * Se2::translation(0.0, foot.left_m))))
        })
    }

    /// The robot's legs, where it walks on any.
    pub(crate) fn draw_legs(&self, random: &mut impl Rng) -> Option<Legs> {
        (self.noise == Noise::Legged).then(|| {
            Legs::new(self.legs.clone(), random.random()).unwrap_or_else(|error| unreachable!("checked: {error}"))
        })
    }

    pub(crate) fn draw_cue(&self, random: &mut impl Rng) -> CueKind {
        let all: f64 = self.cues.iter().map(|(_, share)| share).sum();
        let mut left = random.random::<f64>() * all;
        for (cue, share) in &self.cues {
            left -= share;
            if left < 0.0 {
                return *cue;
            }
        }
        self.cues.first().map_or(CueKind::Forward, |(cue, _)| *cue)
    }

    /// The robot in the cue's start frame when an episode begins.
    pub(crate) fn draw_walked_before(&self, cue: CueKind, random: &mut impl Rng) -> Se2 {
        if cue != CueKind::Forward || self.walked_before <= 0.0 || !random.random_bool(self.walked_before) {
            return Se2::identity();
        }
        let mut within = |most: f64| random.random_range(-most..most);
        Se2::new(Vector2::new(within(WALKED_BEFORE_M), within(WALKED_BEFORE_M)), within(PI))
    }
}
