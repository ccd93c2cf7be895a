//! One episode: senses, shield, observation, motion, reward.

use std::sync::Arc;

use guidance::cue::CueTrack;
use guidance::observation::{Frames, Senses};
use guidance::se2::{Point, Se2, pose2};
use guidance::shield::{leaves_only_stop, masked_at_edge};
use guidance::{
    ActionTable, Awareness, Evidence, HandlerBody, InteractionModel, Judgement, Measure, Reward, Shield, Work,
};
use messages::{Attitude, CueKind, DepthHeader, Header, Odometry, ScanHeader, Twist2, UnsafeCause};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use world::{DepthSensor, HandlerProfile, LidarSensor, OdometrySensor, Site, Team};

use crate::config::{Config, Handlers, RewardMeasure};
use crate::part_seed;
use crate::score::{Report, Score};
use crate::task::Task;
use crate::teacher::Teacher;

/// Worlds and tasks are drawn anew until there is room to begin: nearly always the first few do.
const TRIES: u64 = 10_000;

/// An edge that is farther from robot and handler forbids nothing, metres.
const NEAR_EDGE_M: f64 = 1.0;
/// The same of a low step, from the robot's middle, metres.
const NEAR_STEP_M: f64 = 1.6;
/// A robot that waits before a low step tells it at its second decision there, and the handler answers after as many
/// more.
const ANNOUNCED_AFTER: u32 = 2;
const ALLOWED_AFTER: u32 = 4;
/// Stops so near to each other are one, metres.
const SAME_STOP_M: f64 = 0.5;
/// Dark floor is looked at from so far, metres.
const DARK_M: f64 = 2.0;

/// What one decision came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// The reward (Kim et al. 2023, eq. 1).
    pub reward: f64,
    /// Whether it was the episode's last.
    pub ended: bool,
}

/// What is there in an episode.
#[derive(Debug, Clone)]
struct Scenery {
    site: Arc<Site>,
    task: Task,
    team: Team,
    reward: Reward,
    score: Score,
}

/// One episode after another. [`Episode::begin`] first, then decide from [`Episode::observation`] and
/// [`Episode::unsafe_mask`], and [`Episode::step`].
#[derive(Debug, Clone)]
pub struct Episode {
    config: Arc<Config>,
    incarnation: u32,
    scenery: Option<Scenery>,
    lidar: LidarSensor,
    scan: Vec<f32>,
    scan_header: ScanHeader,
    depth: Option<(DepthSensor, DepthHeader, Vec<u16>)>,
    odometry: OdometrySensor,
    odom_from_before: Se2,
    /// The motion that was to lead here, in the robot's frame then.
    begun: Se2,
    awareness: Awareness,
    shield: Shield,
    judgements: Vec<Judgement>,
    unsafe_mask: u32,
    /// Decisions in a row in which the robot waits before a low step.
    waits_at_step: u32,
    /// Where the robot stopped for the floor the last time.
    stopped_for_floor: Option<Point>,
    /// Nothing could be used of the last scan, or the handler is lost.
    is_blind: bool,
    cue: CueKind,
    cue_is_new: bool,
    odom_from_start: Se2,
    track: CueTrack,
    decision: u64,
    /// How often sensors have looked, from before the cue on, and when they did the last time, nanoseconds.
    looks: u64,
    now_ns: u64,
    frames: Frames,
    velocities: Vec<Twist2>,
}

impl Episode {
    /// Episodes of that kind.
    ///
    /// # Errors
    /// Where a sensor's configuration is out of its bounds.
    pub fn new(config: Arc<Config>) -> Result<Self, world::ConfigError> {
        config.legs.validate()?;
        let lidar = LidarSensor::new(config.lidar_config(), 0, 0)?;
        let depth = match config.depth_config() {
            Some(depth) => {
                let sensor = DepthSensor::new(depth, 0, 0)?;
                let (header, pixels) = (sensor.depth_header(), vec![0; sensor.pixels()]);
                Some((sensor, header, pixels))
            }
            None => None,
        };
        let (_, told) = config.draw_handler(&mut ChaCha8Rng::seed_from_u64(0));
        Ok(Self {
            incarnation: 0,
            scenery: None,
            scan: vec![0.0; lidar.config().beams],
            scan_header: lidar.scan_header(),
            lidar,
            depth,
            odometry: OdometrySensor::new(config.odometry_config(), 0, 0)?,
            odom_from_before: Se2::identity(),
            begun: Se2::identity(),
            awareness: Awareness::new(told, config.awareness.clone()),
            shield: Shield::new(config.shield.clone()),
            judgements: Vec::new(),
            unsafe_mask: 0,
            waits_at_step: 0,
            stopped_for_floor: None,
            is_blind: false,
            cue: CueKind::Stop,
            cue_is_new: true,
            odom_from_start: Se2::identity(),
            track: CueTrack::default(),
            decision: 0,
            looks: 0,
            now_ns: 0,
            frames: Frames::new(config.frames),
            velocities: config.table.actions().iter().map(|action| action.velocity(config.dt_s)).collect(),
            config,
        })
    }

    /// Begins the episode of a seed.
    pub fn begin(&mut self, seed: u64) {
        self.incarnation += 1;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (handler, told) = self.config.draw_handler(&mut random);
        let profile = match self.config.handlers {
            Handlers::Nominal => HandlerProfile::exact(handler),
            Handlers::Personal => HandlerProfile::about(handler, &mut random),
        };
        let cue = self.config.draw_cue(&mut random);
        let (site, task, team) = self.draw_start(cue, &profile, &mut random);
        let team = team.on_legs(self.config.draw_legs(&mut random));
        let world_from_handler = team.world_from_handler();
        let measure = match self.config.measure {
            RewardMeasure::Line => Measure::Line(task.line.clone()),
            RewardMeasure::Start => Measure::Start(guidance::CueStart { cue, world_from_start: world_from_handler }),
        };
        let reward = Reward::begin(self.config.reward.clone(), measure, &world_from_handler);
        let score = Score::begin(&task, site.drop, &team, &site.world);
        self.scenery = Some(Scenery { site, task, team, reward, score });
        self.lidar.reseed(part_seed(seed, 1));
        if let Some((sensor, ..)) = &mut self.depth {
            sensor.reseed(part_seed(seed, 2));
        }
        self.odometry.reseed(part_seed(seed, 3));
        self.shield.take_place(&told);
        self.awareness = Awareness::new(told, self.config.awareness.clone());
        (self.cue, self.cue_is_new, self.decision, self.looks, self.now_ns) = (cue, true, 0, 0, 0);
        let start_from_robot = self.config.draw_walked_before(cue, &mut random);
        self.begun = Se2::identity();
        self.stopped_for_floor = None;
        self.waits_at_step = 0;
        self.track.clear();
        self.arrive();
        self.rest();
        self.odom_from_before = *self.odom_from_robot();
        self.odom_from_start = self.odom_from_robot() * start_from_robot.inverse();
        self.judge();
    }

    /// They come to where the cue is given, beside the middle of the way as they are there: what was seen on the way is
    /// remembered. Where something stands at one of these places they came another way, and have seen what comes behind
    /// it.
    fn arrive(&mut self) {
        if !self.config.judges || self.config.awareness.memory.is_none() {
            return;
        }
        let Scenery { site, task, team, .. } = self.scenery();
        let on_the_way: Vec<Team> = self.config.arrivals(task, team).flatten().collect();
        let blocked = on_the_way.iter().rposition(|team| !team.is_free(&site.world, 0.0));
        let arrived = team.clone();
        for team in on_the_way.into_iter().skip(blocked.map_or(0, |last| last + 1)) {
            self.place(team);
            self.rest();
        }
        self.place(arrived);
    }

    fn place(&mut self, team: Team) {
        if let Some(scenery) = &mut self.scenery {
            scenery.team = team;
        }
    }

    /// They have come here and stand.
    fn rest(&mut self) {
        self.look(self.config.arrival.apart_s);
        self.awareness.rest();
        self.observe();
    }

    /// A world and a task in it with room to begin.
    fn draw_start(&self, cue: CueKind, profile: &HandlerProfile, random: &mut ChaCha8Rng) -> (Arc<Site>, Task, Team) {
        let mut site: Option<Arc<Site>> = None;
        for try_number in 0..TRIES {
            // A few tasks in each world, then another one.
            let here = site.take().filter(|_| try_number % 8 != 0).or_else(|| self.config.draw_site(random));
            let Some(here) = here else { continue };
            if let Some((task, team)) = self.config.draw_start(&here, cue, profile, random) {
                return (here, task, team);
            }
            site = Some(here);
        }
        unreachable!("checked: there is a place for {cue:?}")
    }

    /// The mask in which every action is unsafe.
    fn all(&self) -> u32 {
        (1u32 << self.velocities.len()) - 1
    }

    fn scenery(&self) -> &Scenery {
        self.scenery.as_ref().unwrap_or_else(|| unreachable!("an episode has begun"))
    }

    /// What is measured where the robot is now, so long after the last look.
    fn look(&mut self, after_s: f64) {
        let Some(scenery) = &mut self.scenery else { return };
        self.now_ns += (after_s * 1e9) as u64;
        let scene = scenery.team.scene(&scenery.site.world);
        self.lidar.scan(&scene, self.looks, &mut self.scan);
        let header =
            Header { stamp_ns: self.now_ns, seq: self.looks, incarnation: self.incarnation, ..Header::default() };
        self.scan_header.header = header;
        if let Some((sensor, depth, pixels)) = &mut self.depth {
            sensor.render(&scene, self.looks, pixels);
            depth.header = header;
        }
        let reading = self.odometry.update(self.looks, pose2(scenery.team.world_from_robot()), scenery.team.twist());
        let attitude = self.odometry.attitude(self.looks, &scenery.team.attitude());
        let (odom_from_robot, stamp_ns) = (reading.odom_from_robot, header.stamp_ns);
        let attitude = if attitude.is_known() { Attitude { stamp_ns, ..attitude } } else { attitude };
        self.odom_from_before = *self.awareness.odom_from_robot();
        let odometry = Odometry { header, odom_from_robot, twist: reading.twist, attitude, ..Odometry::default() };
        self.awareness.take_odometry(&odometry);
        self.looks += 1;
    }

    /// What is known of it.
    fn observe(&mut self) {
        if !self.config.judges {
            return;
        }
        if let Some((_, header, pixels)) = &self.depth {
            self.awareness.take_depth(header, pixels);
        }
        self.awareness.take_scan(self.now_ns, 1.0, &self.scan_header, &self.scan);
        // On what cannot be judged nothing is decided: as in a run, the robot stands.
        self.is_blind = self.awareness.unusable(self.now_ns).is_some();
    }

    /// What the shield says of it, and what the policy sees.
    fn judge(&mut self) {
        if !self.config.judges {
            return;
        }
        self.awareness.moved(&self.odom_from_before, &self.begun);
        self.take_turn();
        self.awareness.begin_step();
        let (evidence, handler) = (self.awareness.evidence(self.now_ns), self.awareness.handler());
        self.unsafe_mask = self.shield.judge_actions(&self.config.table, evidence, handler, &mut self.judgements);
        if self.is_blind {
            self.unsafe_mask = self.all();
        }
        self.encode();
    }

    /// A turn that is done goes on as forward, as in a run.
    fn take_turn(&mut self) {
        self.track.observe(&(self.odom_from_start.inverse() * self.odom_from_robot()));
        if let Some(start_from_branch) = self.track.after_turn(self.cue) {
            self.odom_from_start *= start_from_branch;
            (self.cue, self.cue_is_new) = (CueKind::Forward, true);
            self.track.clear();
        }
    }

    fn encode(&mut self) {
        let (evidence, odom_from_robot) = (self.awareness.evidence(self.now_ns), self.odom_from_robot());
        let senses = Senses {
            beams: evidence.beams,
            depth: evidence.depth,
            memory: evidence.memory,
            handler: self.awareness.body(),
            start_from_robot: self.odom_from_start.inverse() * odom_from_robot,
            before_from_robot: self.odom_from_before.inverse() * odom_from_robot,
            cue: self.cue,
        };
        if self.config.frames > 0 {
            self.frames.push(&senses, self.cue_is_new);
        }
    }

    /// What the policy sees: [`Config::frames`] observations, the newest last.
    #[must_use]
    pub fn observation(&self) -> &[f32] {
        self.frames.senses()
    }

    /// Bit *i* is set where the shield forbids action *i*.
    #[must_use]
    pub fn unsafe_mask(&self) -> u32 {
        self.unsafe_mask
    }

    /// The actions that are taken away from a policy whose first choice is `wanted`: those of [`Self::unsafe_mask`],
    /// and all of them where the robot waits before an edge.
    #[must_use]
    pub fn mask_for(&self, wanted: usize) -> u32 {
        let is_judged = self.config.judges && self.cue == CueKind::Forward && !self.is_blind;
        if !is_judged {
            return self.unsafe_mask;
        }
        masked_at_edge(&self.config.table, &self.judgements, self.unsafe_mask, wanted)
    }

    /// The policy would take one action, and another one is taken. A stop for the floor where no edge is near is
    /// counted once at each place. Before a low step the handler is told, and says forward.
    pub fn wants(&mut self, action: usize, taken: usize) {
        let Judgement { cause: why, place, .. } = self.judgements.get(action).copied().unwrap_or_default();
        let waits = why.is_low_step() && taken == ActionTable::STOP && self.cue == CueKind::Forward;
        self.waits_at_step = if waits { self.waits_at_step + 1 } else { 0 };
        match (self.waits_at_step, place, &mut self.scenery) {
            (ANNOUNCED_AFTER, Some(place), Some(scenery)) => {
                let place = scenery.team.world_from_robot() * place;
                scenery.score.announced(place, &scenery.site.world);
            }
            (ALLOWED_AFTER, Some(place), _) => {
                self.awareness.allow_step(self.odom_from_robot() * place);
                self.give(CueKind::Forward);
            }
            _ => {}
        }
        // Without usable measurements the robot stands, whatever the policy wants.
        let is_to_move = self.cue != CueKind::Stop && !self.track.must_stand(self.cue);
        if taken == ActionTable::STOP && is_to_move && !self.is_blind {
            let held_by = self.held_by(action);
            self.scenery.iter_mut().for_each(|scenery| scenery.score.held(held_by));
        }
        let why = if action == ActionTable::STOP { self.why_none_leads_ahead() } else { why };
        self.count_stop(why, taken);
    }

    /// Why the robot stands: the cause that forbids what the policy wants. Where the policy wants to stand, and nothing
    /// else is left, it is the cause that forbids the first motion. None: the policy stands although more is allowed.
    fn held_by(&self, wanted: usize) -> UnsafeCause {
        let stands = wanted == ActionTable::STOP;
        if stands && !leaves_only_stop(self.unsafe_mask, &self.config.table) {
            return UnsafeCause::None;
        }
        let asked = if stands { ActionTable::STOP + 1 } else { wanted };
        self.judgements.get(asked).map_or(UnsafeCause::None, |judgement| judgement.cause)
    }

    /// Why a policy stands that has no way ahead: the floor, where it forbids every action that leads ahead.
    fn why_none_leads_ahead(&self) -> UnsafeCause {
        if self.cue == CueKind::Stop || self.track.must_stand(self.cue) {
            return UnsafeCause::None;
        }
        let ahead = self.config.table.actions().iter().zip(&self.judgements).filter(|(action, _)| action.leads_ahead());
        let mut causes = ahead.map(|(_, judgement)| judgement.cause);
        let first = causes.next().unwrap_or_default();
        causes.fold(first, |why, cause| if cause.is_floor() && why.is_floor() { why } else { UnsafeCause::None })
    }

    fn count_stop(&mut self, why: UnsafeCause, taken: usize) {
        let is_floor = why.is_floor();
        let Some(Scenery { team, site, score, .. }) = &mut self.scenery else { return };
        let (world, at) = (&site.world, Point::from(team.world_from_robot().translation.vector));
        let is_new = self.stopped_for_floor.is_none_or(|before| (at - before).norm() > SAME_STOP_M);
        let is_near_edge =
            team.to_edge_m(world).iter().any(|edge_m| *edge_m <= NEAR_EDGE_M) || world.to_low_step_m(at) <= NEAR_STEP_M;
        if is_floor && taken == ActionTable::STOP && is_new && !is_near_edge {
            self.stopped_for_floor = Some(at);
            score.stopped_for_nothing(why, world.dark_floor().iter().any(|dark| dark.distance_m(at) < DARK_M));
        }
    }

    /// Where shield and policy take the handler to be, robot frame.
    #[must_use]
    pub fn handler_estimate(&self) -> &Se2 {
        self.awareness.handler().robot_from_handler()
    }

    /// How the handler follows, as a fit to them would tell: shield and policy know no more.
    #[must_use]
    pub fn handler_model(&self) -> &InteractionModel {
        self.awareness.handler().model()
    }

    /// Decisions of the episode.
    #[must_use]
    pub fn decisions(&self) -> usize {
        let task = self.scenery.as_ref().filter(|_| self.config.has_time).map(|scenery| &scenery.task);
        self.config.decisions.max(task.map_or(0, Task::decisions))
    }

    /// What shield and policy judge on.
    #[must_use]
    pub fn evidence(&self) -> Evidence<'_> {
        self.awareness.evidence(self.now_ns)
    }

    /// The room that shield and policy take the handler to need.
    #[must_use]
    pub fn body(&self) -> HandlerBody {
        self.awareness.body()
    }

    /// The newest scan, its ranges as over the level floor.
    #[must_use]
    pub fn scan(&self) -> (&ScanHeader, &[f32]) {
        (&self.scan_header, self.awareness.level_ranges_m(&self.scan))
    }

    /// What the shield has had to do so far, in all episodes.
    #[must_use]
    pub fn work(&self) -> Work {
        self.shield.work()
    }

    /// Another number in each episode: nothing of the one before holds in its odometry frame.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.incarnation
    }

    /// The robot in the odometry frame.
    #[must_use]
    pub fn odom_from_robot(&self) -> &Se2 {
        self.awareness.odom_from_robot()
    }

    /// The cue in force, the robot in its start frame, and whether it is another one than at the last decision.
    #[must_use]
    pub fn cue(&self) -> (CueKind, Se2, bool) {
        (self.cue, self.odom_from_start.inverse() * self.odom_from_robot(), self.cue_is_new)
    }

    /// Another cue is given, here and now.
    pub fn give(&mut self, cue: CueKind) {
        (self.cue, self.cue_is_new, self.odom_from_start) = (cue, true, *self.odom_from_robot());
        self.track.clear();
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &Task {
        &self.scenery().task
    }

    /// The world that it is in.
    #[must_use]
    pub fn site(&self) -> &Site {
        &self.scenery().site
    }

    /// Robot and handler.
    #[must_use]
    pub fn team(&self) -> &Team {
        &self.scenery().team
    }

    /// Who knows what the robot does not, and says what it would do now.
    #[must_use]
    pub fn teacher(&self) -> Teacher<'_> {
        let Scenery { site, task, team, .. } = self.scenery();
        let table = &self.config.table;
        Teacher { world: &site.world, team, line: &task.line, table, unsafe_mask: self.unsafe_mask }
    }

    /// What became of it, so far.
    #[must_use]
    pub fn report(&self) -> Report {
        self.scenery().score.report()
    }

    /// Carries out an action of the table.
    pub fn step(&mut self, action: usize) -> Step {
        let action = if self.is_blind || self.track.must_stand(self.cue) { ActionTable::STOP } else { action };
        // Where nothing is left, stop is what the shield itself leaves.
        let all_unsafe =
            self.unsafe_mask >> ActionTable::STOP & 1 == 1 && leaves_only_stop(self.unsafe_mask, &self.config.table);
        let taken = self.unsafe_mask >> action & 1 == 1 && !(all_unsafe && action == ActionTable::STOP);
        let velocity = self.velocities[action];
        let Some(scenery) = &mut self.scenery else { unreachable!("an episode has begun") };
        scenery.score.judged(all_unsafe, taken);
        if scenery.site.world.doors().len() > 0 {
            scenery.team.swing_doors(&mut Arc::make_mut(&mut scenery.site).world, self.config.dt_s);
        }
        let stepped = scenery.team.step(&scenery.site.world, velocity, self.config.dt_s);
        self.awareness.permit(self.now_ns, velocity);
        let world_from_handler = scenery.team.world_from_handler();
        let moved = action != ActionTable::STOP;
        self.begun = self.config.table.actions()[action].start_from_end();
        let before = scenery.score.followed();
        scenery.score.step(&scenery.task, &world_from_handler, stepped);
        scenery.score.stands(&scenery.team, &scenery.site.world);
        let has_fallen = scenery.team.falls().any();
        let followed = self.config.followed_reward * (scenery.score.followed() - before);
        let forbidden = if taken { self.config.forbidden_penalty } else { 0.0 };
        let reward = scenery.reward.step(&world_from_handler, moved, stepped.collided()).sum() + followed - forbidden;
        scenery.score.rewarded(reward);
        self.decision += 1;
        self.cue_is_new = false;
        self.look(self.config.dt_s);
        self.observe();
        self.judge();
        Step { reward, ended: has_fallen || self.decision >= self.decisions() as u64 }
    }
}
