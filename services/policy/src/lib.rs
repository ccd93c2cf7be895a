//! The policy service: decision *n* at run time *n dt*, in every mode, active or not. An [`Engine`] decides; a model
//! file may tune it.

pub mod geometric;
mod model;

use std::path::PathBuf;

use geometric::{GeometricConfig, GeometricEngine, Observation};
use guidance::se2::{pose2, se2};
use guidance::{ActionTable, DepthView};
use messages::{
    CueKind, DepthFrame, Health, Latency, LatencyHistogram, LidarScan, MAX_ACTIONS, Mode, ModeClass, Odometry,
    PolicyAction, age_ns,
};
use settings::{Settings, Source};
use transport::{
    ChildArgs, FrameSample, FrameSubscriber, FromChild, Io, Publisher, Service, Subscriber, TransportError,
};

pub use model::{Expected, GeometricTuning, Manifest, Model, ModelError, OBSERVATION};

/// From an observation to probabilities over the action table.
pub trait Engine {
    /// Probabilities over the table that the engine was made for, summing to 1; called once in each decision period.
    /// What is no probability is published as it is, and refused by the shield.
    fn decide(&mut self, observation: &Observation) -> [f32; MAX_ACTIONS];
}

impl Engine for GeometricEngine {
    fn decide(&mut self, observation: &Observation) -> [f32; MAX_ACTIONS] {
        Self::decide(self, observation)
    }
}

/// The service.
pub struct PolicyService {
    engine: Box<dyn Engine>,
    action_table_id: u64,
    action_count: u32,
    scans: FrameSubscriber<LidarScan>,
    depth: Option<FrameSubscriber<DepthFrame>>,
    odometry: Subscriber<Odometry>,
    modes: Subscriber<Mode>,
    actions: Publisher<PolicyAction>,
    scan: Option<FrameSample<LidarScan>>,
    frame: Option<FrameSample<DepthFrame>>,
    view: DepthView,
    pose: Option<Odometry>,
    mode: Option<Mode>,
    /// The cue of the last decision.
    last_cue: (u32, u64),
    dt_ns: u64,
    scan_max_age_ns: u64,
    depth_max_age_ns: u64,
    next_decision: u64,
    decisions: u64,
    latency: LatencyHistogram,
    depth_latency: LatencyHistogram,
}

impl PolicyService {
    /// Loads and verifies the model, where there is one, and opens ports and engine.
    ///
    /// # Errors
    /// Where the model is refused, a port cannot be opened or the settings are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let table = settings.policy.actions.table();
        let mut config = engine_config(&settings)?;
        let named = std::env::var_os(ChildArgs::MODEL).map(PathBuf::from).or_else(|| settings.policy.model.clone());
        let mut about = serde_json::json!({ "engine": "geometric" });
        if let Some(path) = named {
            let expected = Expected { table: table.clone(), dt_ns: settings.policy.dt.ns() };
            let model = Model::load(&path, &expected).map_err(TransportError::service)?;
            model.tuning.apply(&mut config);
            about = model.about();
        }
        io.tell(&FromChild::About { about });
        let engine = GeometricEngine::new(config, table.clone());
        Self::with_engine(io, &settings, &table, Box::new(engine))
    }

    /// The service around any engine that decides over `table`.
    ///
    /// # Errors
    /// Where a port cannot be opened.
    pub fn with_engine(
        io: &mut Io,
        settings: &Settings,
        table: &ActionTable,
        engine: Box<dyn Engine>,
    ) -> Result<Self, TransportError> {
        let has_depth = settings.depth.source != Source::Absent;
        let dt_ns = settings.policy.dt.ns();
        Ok(Self {
            action_table_id: table.id(),
            action_count: table.len() as u32,
            engine,
            scans: io.frame_subscriber()?,
            depth: if has_depth { Some(io.frame_subscriber()?) } else { None },
            odometry: io.quiet_subscriber()?,
            modes: io.subscriber()?,
            actions: io.publisher()?,
            scan: None,
            frame: None,
            view: DepthView::default(),
            pose: None,
            mode: None,
            last_cue: (0, 0),
            dt_ns,
            scan_max_age_ns: settings.max_age.scan.ns(),
            depth_max_age_ns: settings.max_age.depth.ns(),
            next_decision: io.now_ns() / dt_ns + 1,
            decisions: 0,
            latency: LatencyHistogram { what: Latency::Decision, ..LatencyHistogram::default() },
            depth_latency: LatencyHistogram { what: Latency::DepthToConsumer, ..LatencyHistogram::default() },
        })
    }

    fn take_inputs(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(scan) = self.scans.take()? {
            self.scan = Some(scan);
        }
        if let Some(frames) = &mut self.depth {
            while let Some(frame) = frames.take()? {
                self.depth_latency.record(io.now_ns().saturating_sub(frame.meta().header.published_ns));
                self.frame = Some(frame);
            }
        }
        if let Some(pose) = self.odometry.take_newest()? {
            self.pose = Some(pose);
        }
        if let Some(mode) = self.modes.take_newest()? {
            self.mode = Some(mode);
        }
        Ok(())
    }

    fn decide(&mut self, now_ns: u64) -> PolicyAction {
        let mut action = PolicyAction {
            decision: self.next_decision,
            action_table_id: self.action_table_id,
            action_count: self.action_count,
            ..PolicyAction::default()
        };
        action.probabilities[ActionTable::STOP] = 1.0;
        let cue = self.mode.filter(|mode| mode.class == ModeClass::Run && mode.cue.valid).map(|mode| mode.cue.cue);
        let cue_id = cue.map_or((0, 0), |cue| (cue.header.incarnation, cue.header.seq));
        (action.cue_incarnation, action.cue_seq) = cue_id;
        let cue_is_new = cue_id != self.last_cue;
        self.last_cue = cue_id;
        let fresh = |stamp_ns: u64, max_age_ns: u64| age_ns(now_ns, stamp_ns) <= max_age_ns;
        let (Some(scan), Some(pose)) = (&self.scan, &self.pose) else { return action };
        if !fresh(scan.meta().header.stamp_ns, self.scan_max_age_ns) {
            return action;
        }
        self.view.clear();
        if let Some(frame) = self.frame.as_ref().filter(|f| fresh(f.meta().header.stamp_ns, self.depth_max_age_ns))
            && self.view.fill(frame.meta(), frame.data()).is_ok()
        {
            (action.depth_stamp_ns, action.depth_seq) = (frame.meta().header.stamp_ns, frame.meta().header.seq);
        }
        (action.scan_stamp_ns, action.scan_seq) = (scan.meta().header.stamp_ns, scan.meta().header.seq);
        (action.odometry_stamp_ns, action.odometry_seq) = (pose.header.stamp_ns, pose.header.seq);
        // A cue given in another odometry frame has no start here.
        let cue = cue.filter(|cue| cue.odometry_incarnation == pose.header.incarnation);
        let odom_from_robot = se2(pose.odom_from_robot);
        let odom_from_start = cue.map_or(odom_from_robot, |cue| se2(cue.odom_from_start));
        action.probabilities = self.engine.decide(&Observation {
            scan: scan.meta(),
            ranges: scan.data(),
            obstacles: self.view.points(),
            odom_from_robot: pose.odom_from_robot,
            odometry_incarnation: pose.header.incarnation,
            start_from_robot: pose2(&(odom_from_start.inverse() * odom_from_robot)),
            cue: cue.map_or(CueKind::Stop, |cue| cue.kind),
            cue_is_new,
        });
        action
    }
}

fn engine_config(settings: &Settings) -> Result<GeometricConfig, TransportError> {
    let model = settings.interaction().map_err(TransportError::service)?;
    Ok(GeometricConfig {
        dt_s: settings.policy.dt.s(),
        robot_radius_m: settings.robot.radius_m.get() + settings.shield.margin_m,
        handler_radius_m: settings.handler.radius_m.get() + settings.shield.margin_m,
        model,
        ..GeometricConfig::default()
    })
}

impl Service for PolicyService {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.take_inputs(io)?;
        let now = io.now_ns();
        if now < self.next_decision * self.dt_ns {
            return Ok(());
        }
        // One that is over already would be drawn for nobody.
        self.next_decision = self.next_decision.max(now / self.dt_ns);
        let due_ns = self.next_decision * self.dt_ns;
        let action = self.decide(now);
        self.actions.publish(due_ns, action)?;
        self.latency.record(io.now_ns().saturating_sub(due_ns));
        self.next_decision += 1;
        self.decisions += 1;
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_decision * self.dt_ns)
    }

    fn fill_health(&self, health: &mut Health) {
        health.decisions = self.decisions;
        health.latencies = [self.latency, self.depth_latency];
    }
}
