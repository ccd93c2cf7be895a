//! One passage from a start to a goal: what the sensors see, what the shield leaves, what the planner chooses, and what
//! comes of it. As in an episode of the project, the shield judges once at each decision and guards all of them.

use guidance::awareness::Awareness;
use guidance::se2::{Point, Se2, pose2, wrap_angle};
use guidance::shield::{choose, suppress};
use guidance::{ActionTable, Company, Draw, Interaction, InteractionModel, Judgement, Nobody, Shield};
use messages::{Attitude, CueKind, DepthHeader, Formation, Header, Odometry, ScanHeader, Twist2};
use policies::{Pilot, Probabilities, Situation, SoloEngine, SoloSituation};
use world::{DepthSensor, Legs, LidarSensor, OdometrySensor, World};

use crate::{Crowd, Party, Touch, YardstickError};

pub use episodes::Noise;

/// What happens within a decision is looked at so often, seconds.
pub const TICK_S: f64 = 0.025;
/// The handler says *forward* again, facing the goal, where it lies so far off the line that was meant, radians, and
/// not sooner than this after the last time, seconds.
const OFF_LINE_RAD: f64 = 0.35;
const CUE_AGAIN_S: f64 = 2.0;
/// People in the way of a body that moves towards them faster than this were walked into, m/s.
const CLOSING_MPS: f64 = 0.05;

/// Who walks, and by what plan.
pub enum Body {
    /// The robot alone, to a goal that it is told.
    Robot(Box<SoloEngine>),
    /// The robot with a handler at its harness, who says *forward*.
    Pair(Box<Pilot>),
}

/// Robot, sensors, shield and noise.
#[derive(Debug, Clone)]
pub struct Config {
    /// Those of an episode; its table and its decision period are those of the walk.
    pub base: episodes::Config,
    /// How the handler follows, and how the shield takes them to follow.
    pub interaction: InteractionModel,
    /// How the pair's action is drawn among those that are left.
    pub draw: Draw,
}

/// From where to where, in what world.
#[derive(Debug, Clone)]
pub struct Passage {
    /// What stands there.
    pub world: World,
    /// Who walks there.
    pub crowd: Crowd,
    /// The robot at the start.
    pub world_from_start: Se2,
    /// The goal, world frame.
    pub goal: Point,
    /// A robot that is so near to the goal is there, metres.
    pub goal_m: f64,
    /// Time begins when the robot is so far from its start, metres.
    pub begins_m: f64,
    /// Time that it has, seconds.
    pub time_max_s: f64,
    /// The robot is told at each decision where the goal is from it. Otherwise it knows it by its odometry, which
    /// drifts.
    pub is_localised: bool,
}

/// How a passage ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The robot is at the goal.
    Goal,
    /// Robot or handler touched something that stands.
    Collision(Touch),
    /// Its time is over.
    TimeOut,
}

/// A touch with a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Met {
    /// When, seconds from the start.
    pub time_s: f64,
    /// Their number in the crowd.
    pub person: usize,
    /// They walked into robot or handler; otherwise these walked into them.
    pub by_them: bool,
}

/// Where a passage went: the robot at each tick from the start on.
#[derive(Debug, Clone)]
pub struct Trace {
    /// How it ended.
    pub end: End,
    /// When the robot began to move ([`Passage::begins_m`]), seconds from the start.
    pub began_s: f64,
    /// The robot at each tick, world frame.
    pub robot: Vec<Se2>,
    /// The handler likewise, where there is one.
    pub handler: Vec<Point>,
    /// Touches with people, each once.
    pub met: Vec<Met>,
    /// Decisions at which the shield left nothing but to stand.
    pub all_unsafe: u32,
    /// All decisions.
    pub decisions: u32,
}

impl Trace {
    /// From when the robot began to move to the end, seconds.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        (self.robot.len() - 1) as f64 * TICK_S - self.began_s
    }
}

/// The sensors of the robot.
struct Sensors {
    lidar: LidarSensor,
    scan: Vec<f32>,
    scan_header: ScanHeader,
    depth: Option<(DepthSensor, DepthHeader, Vec<u16>)>,
    odometry: OdometrySensor,
    looks: u64,
    now_ns: u64,
}

/// What is known, and by whom it is planned.
enum Mind<'a> {
    Robot(Box<Awareness<Nobody>>, &'a mut SoloEngine),
    Pair(Box<Awareness>, &'a mut Pilot, Cue),
}

/// The cue of a pair: always *forward*.
struct Cue {
    odom_from_start: Se2,
    given_s: f64,
    is_new: bool,
}

/// Walks passages.
pub struct Walk {
    config: Config,
    body: Body,
    shield: Shield,
    velocities: Vec<Twist2>,
    judgements: Vec<Judgement>,
}

impl Walk {
    /// Passages of that body.
    #[must_use]
    pub fn new(config: Config, body: Body) -> Self {
        let base = &config.base;
        let velocities = base.table.actions().iter().map(|action| action.velocity(base.dt_s)).collect();
        let shield = Shield::new(base.shield.clone());
        Self { config, body, shield, velocities, judgements: Vec::new() }
    }

    /// Walks one passage. Noise depends on `seed`.
    ///
    /// # Errors
    /// Where sensors or legs are like none, or the policy cannot decide.
    pub fn walk(&mut self, passage: &Passage, seed: u64) -> Result<Trace, YardstickError> {
        let base = self.config.base.clone();
        let legs = match base.noise {
            Noise::Legged => Some(Legs::new(base.legs.clone(), episodes::part_seed(seed, 4))?),
            Noise::Ideal | Noise::Noisy => None,
        };
        let awareness = base.awareness.clone();
        let mut mind = match &mut self.body {
            Body::Robot(engine) => {
                engine.clear();
                Mind::Robot(Box::new(Awareness::alone(awareness)), engine)
            }
            Body::Pair(pilot) => {
                let awareness = Awareness::new(self.config.interaction.clone(), awareness);
                let cue = Cue { odom_from_start: Se2::identity(), given_s: f64::NEG_INFINITY, is_new: true };
                Mind::Pair(Box::new(awareness), pilot, cue)
            }
        };
        let handler = matches!(mind, Mind::Pair(..)).then(|| self.config.interaction.clone());
        let mut party = Party::new(base.bodies, handler, passage.world_from_start, legs);
        let mut sensors = Sensors::new(&base, seed)?;
        let mut course = Course::new(passage, &party);
        let ticks = (base.dt_s / TICK_S).round().max(1.0) as usize;
        let draw = match self.config.draw {
            Draw::ArgMax => Draw::ArgMax,
            Draw::Seeded(_) => Draw::Seeded(seed),
            Draw::Surest(_) => Draw::Surest(seed),
        };
        let reach = base.shield.reach;
        let (mut begun, mut before) = (Se2::identity(), Twist2::ZERO);
        loop {
            let walkers = passage.crowd.walkers(course.time_s());
            let scene = party.scene(&passage.world, &walkers);
            let odometry = sensors.look(&scene, &party, if course.trace.decisions == 0 { 0.0 } else { base.dt_s });
            let decided = decide(Decision {
                mind: &mut mind,
                sensors: &sensors,
                odometry: &odometry,
                begun: &begun,
                passage,
                table: &base.table,
                shield: &mut self.shield,
                judgements: &mut self.judgements,
                time_s: course.time_s(),
                world_from_robot: party.world_from_robot(),
            })?;
            let action = decided.chosen(&base.table, draw, u64::from(course.trace.decisions));
            course.trace.decisions += 1;
            let all_unsafe = guidance::shield::leaves_only_stop(decided.unsafe_mask, &base.table);
            course.trace.all_unsafe += u32::from(all_unsafe);
            // A robot that is carried on begins and ends a motion later.
            let velocity = self.velocities[action];
            let goes = reach.carries_to(&before) * base.table.actions()[action].start_from_end();
            begun = if velocity.is_zero() { Se2::identity() } else { goes * reach.carries_to(&velocity).inverse() };
            before = velocity;
            mind.permit(sensors.now_ns, velocity);
            party.begin_step();
            for tick in 1..=ticks {
                party.walk(velocity, base.dt_s / ticks as f64, tick as f64 / ticks as f64);
                if let Some(end) = course.take(passage, &party) {
                    course.trace.end = end;
                    return Ok(course.trace);
                }
            }
        }
    }
}

/// What became of a passage so far.
struct Course {
    trace: Trace,
    began: bool,
    touching: Vec<bool>,
    /// Middles of the discs of robot and handler at the last tick, world frame.
    discs: Vec<Point>,
}

impl Course {
    fn new(passage: &Passage, party: &Party) -> Self {
        let trace = Trace {
            end: End::TimeOut,
            began_s: 0.0,
            robot: vec![*party.world_from_robot()],
            handler: party
                .world_from_handler()
                .map(|handler| Point::from(handler.translation.vector))
                .into_iter()
                .collect(),
            met: Vec::new(),
            all_unsafe: 0,
            decisions: 0,
        };
        let touching = vec![false; passage.crowd.people.len()];
        Self { trace, began: passage.begins_m <= 0.0, touching, discs: middles(party) }
    }

    fn time_s(&self) -> f64 {
        (self.trace.robot.len() - 1) as f64 * TICK_S
    }

    /// A tick has passed: whether it was the last, and why.
    fn take(&mut self, passage: &Passage, party: &Party) -> Option<End> {
        let robot = *party.world_from_robot();
        self.trace.robot.push(robot);
        self.trace.handler.extend(party.world_from_handler().map(|handler| Point::from(handler.translation.vector)));
        self.meet(&passage.crowd, party);
        let at = Point::from(robot.translation.vector);
        let came_m = (robot.translation.vector - passage.world_from_start.translation.vector).norm();
        if !self.began && came_m >= passage.begins_m {
            (self.began, self.trace.began_s) = (true, self.time_s());
        }
        if let Some(touch) = party.touches(&passage.world) {
            return Some(End::Collision(touch));
        }
        if (passage.goal - at).norm() <= passage.goal_m {
            return Some(End::Goal);
        }
        (self.time_s() - self.trace.began_s >= passage.time_max_s).then_some(End::TimeOut)
    }

    /// Counts touches with people. Robot or handler have caused one where the disc that touches moved towards the
    /// person in this tick: a turning robot swings its nose, and its handler.
    fn meet(&mut self, crowd: &Crowd, party: &Party) {
        let time_s = self.time_s();
        let before = std::mem::replace(&mut self.discs, middles(party));
        let mut now = vec![false; self.touching.len()];
        for (person, at) in crowd.at(time_s) {
            if party.apart_m(at, crowd.radius_m) >= 0.0 {
                continue;
            }
            now[person] = true;
            if !self.touching[person] {
                let discs = party.discs().zip(&before).map(|((disc, radius_m, _), before)| {
                    let (to, went) = (at - disc, disc - before);
                    (to.norm() - radius_m, went.dot(&to) / to.norm().max(1e-9) / TICK_S)
                });
                let closing_mps = discs.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, closing_mps)| closing_mps);
                self.trace.met.push(Met { time_s, person, by_them: closing_mps <= CLOSING_MPS });
            }
        }
        self.touching = now;
    }
}

impl Sensors {
    fn new(base: &episodes::Config, seed: u64) -> Result<Self, YardstickError> {
        let lidar = LidarSensor::new(base.lidar_config(), episodes::part_seed(seed, 1), 0)?;
        let depth = match base.depth_config() {
            Some(config) => {
                let sensor = DepthSensor::new(config, episodes::part_seed(seed, 2), 0)?;
                let (header, pixels) = (sensor.depth_header(), vec![0; sensor.pixels()]);
                Some((sensor, header, pixels))
            }
            None => None,
        };
        let odometry = OdometrySensor::new(base.odometry_config(), episodes::part_seed(seed, 3), 0)?;
        let (scan, scan_header) = (vec![0.0; lidar.config().beams], lidar.scan_header());
        Ok(Self { lidar, scan, scan_header, depth, odometry, looks: 0, now_ns: messages::NS_PER_S })
    }

    /// All of them look, so long after the last time.
    fn look(&mut self, scene: &world::Scene<'_>, party: &Party, after_s: f64) -> Odometry {
        self.now_ns += (after_s * 1e9).round() as u64;
        let header = Header { stamp_ns: self.now_ns, seq: self.looks, incarnation: 1, ..Header::default() };
        self.lidar.scan(scene, self.looks, &mut self.scan);
        self.scan_header.header = header;
        if let Some((sensor, depth, pixels)) = &mut self.depth {
            sensor.render(scene, self.looks, pixels);
            depth.header = header;
        }
        let reading = self.odometry.update(self.looks, scene.world_from_robot, party.twist());
        let attitude = self.odometry.attitude(self.looks, &party.attitude());
        let attitude = if attitude.is_known() { Attitude { stamp_ns: self.now_ns, ..attitude } } else { attitude };
        self.looks += 1;
        let (odom_from_robot, twist) = (reading.odom_from_robot, reading.twist);
        Odometry { header, odom_from_robot, twist, attitude, ..Odometry::default() }
    }

    /// Tells what they saw; `begun` is the motion that was to lead here.
    fn tell<H: Company>(&self, awareness: &mut Awareness<H>, odometry: &Odometry, begun: &Se2) {
        let before = *awareness.odom_from_robot();
        awareness.take_odometry(odometry);
        if let Some((_, header, pixels)) = &self.depth {
            awareness.take_depth(header, pixels);
        }
        awareness.take_scan(self.now_ns, 1.0, &self.scan_header, &self.scan);
        awareness.moved(&before, begun);
        awareness.begin_step();
    }
}

impl Mind<'_> {
    fn permit(&mut self, now_ns: u64, velocity: Twist2) {
        match self {
            Self::Robot(awareness, _) => awareness.permit(now_ns, velocity),
            Self::Pair(awareness, ..) => awareness.permit(now_ns, velocity),
        }
    }
}

impl Cue {
    /// Gives the cue again where the goal lies off the line (odometry frame).
    fn aim(&mut self, odom_from_robot: &Se2, goal: Point, time_s: f64) {
        let to = goal - Point::from(odom_from_robot.translation.vector);
        let towards_rad = to.y.atan2(to.x);
        let off_rad = wrap_angle(towards_rad - self.odom_from_start.rotation.angle()).abs();
        self.is_new = time_s - self.given_s >= CUE_AGAIN_S && (off_rad > OFF_LINE_RAD || !self.given_s.is_finite());
        if self.is_new {
            self.odom_from_start = Se2::new(odom_from_robot.translation.vector, towards_rad);
            self.given_s = time_s;
        }
    }
}

/// What one decision needs.
struct Decision<'a, 'b> {
    mind: &'a mut Mind<'b>,
    sensors: &'a Sensors,
    odometry: &'a Odometry,
    begun: &'a Se2,
    passage: &'a Passage,
    table: &'a ActionTable,
    shield: &'a mut Shield,
    judgements: &'a mut Vec<Judgement>,
    time_s: f64,
    world_from_robot: &'a Se2,
}

/// What was decided.
struct Decided {
    probabilities: Probabilities,
    unsafe_mask: u32,
}

impl Decided {
    /// The action that is taken: never one that the shield forbids, but for standing where nothing is left.
    fn chosen(&self, table: &ActionTable, draw: Draw, decision: u64) -> usize {
        let probabilities: Vec<f64> = self.probabilities[..table.len()].iter().map(|p| f64::from(*p)).collect();
        let suppressed = suppress(&probabilities, self.unsafe_mask, 0.0);
        choose(&suppressed.probabilities[..table.len()], draw, decision)
    }
}

fn decide(decision: Decision<'_, '_>) -> Result<Decided, YardstickError> {
    let Decision { mind, sensors, odometry, begun, passage, table, shield, judgements, time_s, world_from_robot } =
        decision;
    let all = (1u32 << table.len()) - 1;
    let robot_from_goal = world_from_robot.inverse() * passage.goal;
    let goal_by = |odom_from_robot: &Se2| match passage.is_localised {
        true => odom_from_robot * robot_from_goal,
        false => passage.world_from_start.inverse() * passage.goal,
    };
    match mind {
        Mind::Robot(awareness, engine) => {
            sensors.tell(awareness, odometry, begun);
            let evidence = awareness.evidence(sensors.now_ns);
            let judged = shield.judge_actions_alone(table, evidence, judgements);
            let unsafe_mask = if awareness.unusable(sensors.now_ns).is_some() { all } else { judged };
            let probabilities = engine.decide(&SoloSituation {
                scan: &sensors.scan_header,
                ranges: awareness.level_ranges_m(&sensors.scan),
                obstacles: evidence.depth.map_or(&[][..], guidance::DepthView::points),
                odom_from_robot: *awareness.odom_from_robot(),
                moves: evidence.moves,
                goal: goal_by(awareness.odom_from_robot()),
                unsafe_mask,
            });
            Ok(Decided { probabilities, unsafe_mask })
        }
        Mind::Pair(awareness, pilot, cue) => {
            sensors.tell(awareness, odometry, begun);
            cue.aim(awareness.odom_from_robot(), goal_by(awareness.odom_from_robot()), time_s);
            let evidence = awareness.evidence(sensors.now_ns);
            let judged = shield.judge_actions(table, evidence, awareness.handler(), judgements);
            let unsafe_mask = if awareness.unusable(sensors.now_ns).is_some() { all } else { judged };
            let probabilities = pilot.decide(&Situation {
                scan: &sensors.scan_header,
                ranges: awareness.level_ranges_m(&sensors.scan),
                evidence,
                handler: awareness.body(),
                odom_from_robot: *awareness.odom_from_robot(),
                odometry_incarnation: 1,
                start_from_robot: cue.odom_from_start.inverse() * awareness.odom_from_robot(),
                cue: CueKind::Forward,
                cue_is_new: cue.is_new,
                formation: Formation::Beside,
            })?;
            Ok(Decided { probabilities, unsafe_mask })
        }
    }
}

/// The middles of the discs that robot and handler are, world frame.
fn middles(party: &Party) -> Vec<Point> {
    party.discs().map(|(middle, ..)| middle).collect()
}

/// The pose of a start, world frame: metres and radians.
#[must_use]
pub fn start(x_m: f64, y_m: f64, yaw_rad: f64) -> Se2 {
    Se2::new(nalgebra::Vector2::new(x_m, y_m), yaw_rad)
}

/// The place of a pose.
pub(crate) fn place(pose: &Se2) -> Point {
    let pose = pose2(pose);
    Point::new(pose.x_m, pose.y_m)
}

impl Config {
    /// The table and period of a robot that walks alone.
    #[must_use]
    pub fn alone(mut self, table: ActionTable, dt_s: f64) -> Self {
        (self.base.table, self.base.dt_s) = (table, dt_s);
        self
    }

    /// How far robot and handler are apart by default, metres.
    #[must_use]
    pub fn harness_m(&self) -> f64 {
        self.interaction.robot_from_default().translation.vector.norm()
    }
}

#[cfg(test)]
mod tests {
    use super::{Course, Passage, TICK_S, start};
    use crate::{Crowd, Party, Recorded};
    use guidance::se2::Point;
    use messages::Twist2;
    use world::{Bodies, World};

    /// The touches of a robot with two discs, 0.5 m ahead of its middle and behind it. The person stands until 1 s and
    /// then comes nearer.
    fn met(person: [Point; 2], velocity: Twist2) -> Vec<bool> {
        let bodies = Bodies {
            robot_radius_m: 0.2,
            robot_nose_m: 0.5,
            robot_height_m: 0.5,
            handler_radius_m: 0.25,
            handler_height_m: 1.7,
        };
        let places = vec![(0.0, person[0]), (1.0, person[0]), (2.0, person[1]), (9.0, person[1])];
        let crowd = Crowd { people: vec![Recorded { name: "1".into(), places }], radius_m: 0.2 };
        let passage = Passage {
            world: World::new(10.0, Vec::new()),
            crowd,
            world_from_start: start(0.0, 0.0, 0.0),
            goal: Point::new(50.0, 0.0),
            goal_m: 0.3,
            begins_m: 0.0,
            time_max_s: 3.0,
            is_localised: true,
        };
        let mut party = Party::new(bodies, None, passage.world_from_start, None);
        let mut course = Course::new(&passage, &party);
        while course.take(&passage, &party).is_none() {
            party.walk(velocity, TICK_S, 1.0);
        }
        course.trace.met.iter().map(|met| met.by_them).collect()
    }

    #[test]
    fn a_touch_counts_for_the_side_that_moved() {
        let [ahead, aside] = [Point::new(1.5, 0.0), Point::new(0.0, 0.7)];
        assert_eq!(met([ahead, ahead], Twist2 { vx_mps: 0.5, ..Twist2::ZERO }), [false], "the robot walks into them");
        assert_eq!(met([ahead, Point::new(0.8, 0.0)], Twist2::ZERO), [true], "they walk into the robot");
        assert!(met([aside, aside], Twist2::ZERO).is_empty());
        // A robot that turns on the spot goes nowhere, and its nose does.
        assert_eq!(met([aside, aside], Twist2 { wz_radps: 0.5, ..Twist2::ZERO }), [false], "its nose swings into them");
        // It walks away, and they come faster.
        let back = Twist2 { vx_mps: -0.2, ..Twist2::ZERO };
        assert_eq!(met([ahead, Point::new(-0.1, 0.0)], back), [true]);
    }
}
