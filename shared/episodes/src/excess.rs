//! Whether robot and handler stay within the hull that was judged: how far they leave it, and by how much it is wider
//! than what they do. On open floor, over random actions that begin anew every decision, and stops after a few.

use guidance::se2::se2;
use guidance::{ActionTable, Awareness, AwarenessConfig, Shield};
use messages::{Attitude, Header, Odometry, ScanHeader, Twist2, WorldTruth};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use settings::Settings;
use world::{LidarConfig, LidarSensor, Scene, TICK_S, World};

use crate::judged::{Judged, Shape};

/// The most actions before a stop, and the decisions in which robot and handler then come to rest.
const BURST: usize = 4;
const REST: usize = 6;
/// Ticks between two checks of where robot and handler are.
const LOOK: usize = 5;

/// What came of a run.
#[derive(Debug, Clone, Default)]
pub struct Excess {
    /// Decisions judged.
    pub decisions: usize,
    /// For each decision by how much robot or handler left the hull, metres; 0 or less: they did not.
    pub robot_beyond_m: Vec<f64>,
    /// See `robot_beyond_m`.
    pub handler_beyond_m: Vec<f64>,
    /// For each action that a stop followed, and each disc in which the hull ends, by how much it reaches beyond what
    /// that body ever covered, metres; the margin is in it.
    pub wider_m: Vec<f64>,
}

impl Excess {
    /// Decisions in which robot or handler left the hull.
    #[must_use]
    pub fn beyond(&self) -> usize {
        self.robot_beyond_m
            .iter()
            .zip(&self.handler_beyond_m)
            .filter(|(robot, handler)| robot.max(**handler) > 0.0)
            .count()
    }

    /// Adds what came of another run.
    pub fn add(&mut self, other: Self) {
        self.decisions += other.decisions;
        self.robot_beyond_m.extend(other.robot_beyond_m);
        self.handler_beyond_m.extend(other.handler_beyond_m);
        self.wider_m.extend(other.wider_m);
    }

    /// A quantile of some of its figures, 0 to 1, metres; NaN where there are none.
    #[must_use]
    pub fn quantile_m(figures: &[f64], share: f64) -> f64 {
        let mut sorted = figures.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.get(((sorted.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(f64::NAN)
    }
}

impl std::fmt::Display for Excess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {} decisions beyond the hull", self.beyond(), self.decisions)?;
        for (what, figures) in [
            ("robot beyond", &self.robot_beyond_m),
            ("handler beyond", &self.handler_beyond_m),
            ("the hull wider by", &self.wider_m),
        ]
        .into_iter()
        .filter(|(_, figures)| !figures.is_empty())
        {
            let [p50, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| 100.0 * Self::quantile_m(figures, share));
            let n = figures.len();
            write!(f, "\n{what}: p50 {p50:.1}, p95 {p95:.1}, p99 {p99:.1}, max {max:.1} cm (n = {n})")?;
        }
        Ok(())
    }
}

/// A shield over a pair on open floor.
pub struct OpenFloor {
    world: World,
    lidar: LidarSensor,
    ranges_m: Vec<f32>,
    awareness: Awareness,
    shield: Shield,
    table: ActionTable,
    dt_s: f64,
    shape: Shape,
    ticks: u64,
    /// The command before.
    moves: Twist2,
}

impl OpenFloor {
    /// The robot, handler and shield of these settings.
    ///
    /// # Errors
    /// Where the handler's model or the lidar is out of its bounds.
    pub fn new(settings: &Settings) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let lidar = LidarSensor::new(LidarConfig::from(&settings.lidar), 1, 1)?;
        let model = settings.interaction()?;
        Ok(Self {
            world: World::new(2.6, Vec::new()),
            ranges_m: vec![0.0; lidar.config().beams],
            lidar,
            awareness: Awareness::new(model, AwarenessConfig { memory: None, ..settings.awareness_config() }),
            shield: Shield::new(settings.shield_config()),
            table: settings.policy.actions.table(),
            dt_s: settings.policy.dt.s(),
            shape: Shape::of(settings),
            ticks: 0,
            moves: Twist2::ZERO,
        })
    }

    /// Carries out random actions. `step` moves robot and handler by one tick under a command.
    ///
    /// # Errors
    /// Of `step`.
    pub fn measure<E>(
        &mut self,
        decisions: usize,
        seed: u64,
        mut step: impl FnMut(Twist2) -> Result<WorldTruth, E>,
    ) -> Result<Excess, E> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut excess = Excess::default();
        let mut truth = step(Twist2::ZERO)?;
        self.awareness.rest();
        while excess.decisions < decisions {
            let burst = random.random_range(1..=BURST);
            for n in 1..=burst {
                let action = random.random_range(1..self.table.len());
                let velocity = self.table.actions()[action].velocity(self.dt_s);
                let mut judged = self.judge(&truth, action);
                self.carry_out(velocity, &mut truth, &mut step, &mut judged)?;
                if n == burst {
                    for _ in 0..REST {
                        self.judge(&truth, ActionTable::STOP);
                        self.carry_out(Twist2::ZERO, &mut truth, &mut step, &mut judged)?;
                    }
                    excess.wider_m.extend(&judged.missed_m);
                }
                excess.decisions += 1;
                excess.robot_beyond_m.push(judged.beyond_m[0]);
                excess.handler_beyond_m.push(judged.beyond_m[1]);
            }
        }
        Ok(excess)
    }

    /// The hull of an action that begins now.
    fn judge(&mut self, truth: &WorldTruth, action: usize) -> Judged {
        let world_from_robot = se2(truth.world_from_robot);
        self.look(truth, 1.0);
        self.awareness.begin_step();
        let handler = self.awareness.handler();
        let motion = Shield::predict(handler, &self.table.actions()[action].start_from_end());
        let body = handler.body(self.lidar.config().sigma_m);
        let discs = self.shield.swept(&motion, self.moves, body);
        Judged::new(self.shape, world_from_robot, &self.moves, body, discs)
    }

    fn carry_out<E>(
        &mut self,
        velocity: Twist2,
        truth: &mut WorldTruth,
        step: &mut impl FnMut(Twist2) -> Result<WorldTruth, E>,
        judged: &mut Judged,
    ) -> Result<(), E> {
        let ticks = (self.dt_s / TICK_S).round() as usize;
        self.moves = velocity;
        for tick in 1..=ticks {
            *truth = step(velocity)?;
            if tick % LOOK == 0 {
                judged.hold(truth);
            }
            // A lidar of 10 Hz; the decision's own scan is taken where it is judged.
            if tick % 10 == 0 && tick < ticks {
                self.look(truth, tick as f64 / ticks as f64);
            }
        }
        Ok(())
    }

    fn look(&mut self, truth: &WorldTruth, share: f64) {
        self.ticks += 10;
        let level = WorldTruth { attitude: Attitude::default(), ..*truth };
        self.lidar.scan(&Scene::from_truth(&mut self.world, &level), self.ticks, &mut self.ranges_m);
        let now_ns = self.ticks * 10_000_000;
        let header = Header { stamp_ns: now_ns, seq: self.ticks, ..Header::default() };
        let (odom_from_robot, twist) = (truth.world_from_robot, truth.robot_twist);
        self.awareness.take_odometry(&Odometry { header, odom_from_robot, twist, ..Odometry::default() });
        let scan = ScanHeader { header, ..self.lidar.scan_header() };
        self.awareness.take_scan(now_ns, share, &scan, &self.ranges_m);
    }
}
