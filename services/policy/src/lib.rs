//! The policy service: decision *n* at run time *n dt*, in every mode, active or not. A [`Pilot`] decides; which
//! engine it has is the model's to say.

use std::path::PathBuf;

use guidance::se2::{pose2, se2};
use guidance::{ActionTable, Awareness, InteractionModel};
use messages::{
    Cue, CueKind, DepthFrame, Formation, Health, Latency, LatencyHistogram, LidarScan, MAX_ACTIONS, Mode, ModeClass,
    Odometry, PolicyAction,
};
use policies::{Engine, Expected, GeometricConfig, Model, Pilot, Probabilities, Situation, stand};
use settings::{PolicyModel, Settings, Source};
use transport::{
    ChildArgs, FrameSample, FrameSubscriber, FromChild, Io, Publisher, Service, Subscriber, TransportError,
};

/// The service.
pub struct PolicyService {
    pilot: Pilot,
    awareness: Awareness,
    /// How the handler follows beside the robot, and behind it.
    models: [InteractionModel; 2],
    action_table_id: u64,
    action_count: u32,
    scans: FrameSubscriber<LidarScan>,
    depth: Option<FrameSubscriber<DepthFrame>>,
    odometry: Subscriber<Odometry>,
    modes: Subscriber<Mode>,
    actions: Publisher<PolicyAction>,
    scan: Option<FrameSample<LidarScan>>,
    /// It has come since the last decision.
    scan_is_new: bool,
    /// The depth frame that has come since the last decision.
    frame: Option<FrameSample<DepthFrame>>,
    mode: Option<Mode>,
    /// Why the engine could not decide the last time; told once.
    undecided: Option<String>,
    is_told: bool,
    /// The cue of the last decision.
    last_cue: (u32, u64),
    dt_ns: u64,
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
        let swapped_in = std::env::var_os(ChildArgs::MODEL).map(|name| PolicyModel::from(PathBuf::from(name)));
        let named = swapped_in.as_ref().unwrap_or(&settings.policy.model);
        let model = Model::named(named, &Expected::of(&settings)).map_err(TransportError::service)?;
        let library = settings.policy.onnx_runtime.as_deref();
        let config = GeometricConfig::of(&settings).map_err(TransportError::service)?;
        let planner = settings.policy.planner;
        let engine = policies::named_engine(named, model.as_ref(), config, planner, &table, library)
            .map_err(TransportError::service)?;
        let built_in = || serde_json::json!({ "engine": PathBuf::from(named.clone()) });
        let about = model.as_ref().map_or_else(built_in, |model| model.about(&settings));
        io.tell(&FromChild::About { about });
        Self::with_engine(io, &settings, &table, engine)
    }

    /// The service around any engine that decides over `table`.
    ///
    /// # Errors
    /// Where a port cannot be opened, or the handler's parameters are no handler's.
    pub fn with_engine(
        io: &mut Io,
        settings: &Settings,
        table: &ActionTable,
        engine: Box<dyn Engine>,
    ) -> Result<Self, TransportError> {
        let has_depth = settings.depth.source != Source::Absent;
        let dt_ns = settings.policy.dt.ns();
        let model = |formation| settings.interaction_in(formation).map_err(TransportError::service);
        let models = [model(Formation::Beside)?, model(Formation::Behind)?];
        Ok(Self {
            pilot: Pilot::new(engine),
            awareness: Awareness::new(models[0].clone(), settings.awareness_config()),
            models,
            action_table_id: table.id(),
            action_count: table.len() as u32,
            scans: io.frame_subscriber()?,
            depth: if has_depth { Some(io.frame_subscriber()?) } else { None },
            odometry: io.quiet_subscriber()?,
            modes: io.subscriber()?,
            actions: io.publisher()?,
            scan: None,
            scan_is_new: false,
            frame: None,
            mode: None,
            undecided: None,
            is_told: false,
            last_cue: (0, 0),
            dt_ns,
            next_decision: io.now_ns() / dt_ns + 1,
            decisions: 0,
            latency: LatencyHistogram { what: Latency::Decision, ..LatencyHistogram::default() },
            depth_latency: LatencyHistogram { what: Latency::DepthToConsumer, ..LatencyHistogram::default() },
        })
    }

    fn take_inputs(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(scan) = self.scans.take()? {
            (self.scan, self.scan_is_new) = (Some(scan), true);
        }
        if let Some(frames) = &mut self.depth {
            while let Some(frame) = frames.take()? {
                self.depth_latency.record(io.now_ns().saturating_sub(frame.meta().header.published_ns));
                self.frame = Some(frame);
            }
        }
        while let Some(pose) = self.odometry.take()? {
            self.awareness.take_odometry(&pose);
        }
        if let Some(mode) = self.modes.take_newest()? {
            let [beside, behind] = &self.models;
            self.awareness.take_place(if mode.formation == Formation::Beside { beside } else { behind });
            self.mode = Some(mode);
        }
        Ok(())
    }

    /// Takes in the newest measurements. They are needed at a decision only.
    fn look(&mut self, now_ns: u64) {
        if let Some(frame) = self.frame.take() {
            self.awareness.take_depth(frame.meta(), frame.data());
            // The decision is now.
            self.awareness.look_at_once();
        }
        match self.scan.as_ref().filter(|_| self.scan_is_new) {
            Some(scan) => {
                self.awareness.take_scan(now_ns, 1.0, scan.meta(), scan.data());
            }
            None => self.awareness.come_to(now_ns, 1.0),
        }
        self.scan_is_new = false;
        self.awareness.begin_step();
    }

    fn decide(&mut self, now_ns: u64) -> PolicyAction {
        let mut action = PolicyAction {
            decision: self.next_decision,
            action_table_id: self.action_table_id,
            action_count: self.action_count,
            probabilities: stand(),
            formation: self.formation(),
            ..PolicyAction::default()
        };
        let cue = self.mode.filter(|mode| mode.class == ModeClass::Run && mode.cue.valid).map(|mode| mode.cue.cue);
        let cue_id = cue.map_or((0, 0), |cue| (cue.header.incarnation, cue.header.seq));
        (action.cue_incarnation, action.cue_seq) = cue_id;
        if let Some(probabilities) = self.look_and_decide(now_ns, &mut action, cue, cue_id != self.last_cue) {
            // Told to the pilot: where nothing could be decided, the cue is new at the next decision still.
            self.last_cue = cue_id;
            action.probabilities = probabilities;
        }
        action
    }

    /// What the pilot makes of the newest inputs; none where there is no fresh scan, or no place where it was taken.
    fn look_and_decide(
        &mut self,
        now_ns: u64,
        action: &mut PolicyAction,
        cue: Option<Cue>,
        cue_is_new: bool,
    ) -> Option<Probabilities> {
        self.look(now_ns);
        let (scan, pose) = (self.awareness.fresh_scan(now_ns)?, *self.awareness.odometry()?);
        let depth = self.awareness.fresh_depth(now_ns).unwrap_or_default();
        (action.scan_stamp_ns, action.scan_seq) = (scan.stamp_ns, scan.seq);
        (action.depth_stamp_ns, action.depth_seq) = (depth.stamp_ns, depth.seq);
        (action.odometry_stamp_ns, action.odometry_seq) = (pose.header.stamp_ns, pose.header.seq);
        let sample = self.scan.as_ref()?;
        let odom_from_robot = *self.awareness.odom_from_robot();
        // A cue given in another odometry frame has no start here.
        let cue = cue.filter(|cue| cue.odometry_incarnation == pose.header.incarnation);
        let odom_from_start = cue.map_or(odom_from_robot, |cue| se2(cue.odom_from_start));
        let situation = Situation {
            scan: sample.meta(),
            ranges: self.awareness.level_ranges_m(sample.data()),
            evidence: self.awareness.evidence(now_ns),
            handler: self.awareness.body(),
            odom_from_robot,
            odometry_incarnation: pose.header.incarnation,
            start_from_robot: se2(pose2(&(odom_from_start.inverse() * odom_from_robot))),
            cue: cue.map_or(CueKind::Stop, |cue| cue.kind),
            cue_is_new,
            formation: self.formation(),
        };
        let decided = self.pilot.decide(&situation);
        action.formation = self.pilot.formation();
        self.undecided = decided.as_ref().err().map(ToString::to_string);
        // What is no probability is refused by the shield, which says so.
        Some(decided.unwrap_or([f32::NAN; MAX_ACTIONS]))
    }

    /// Where the handler walks.
    fn formation(&self) -> Formation {
        self.mode.map_or(Formation::Beside, |mode| mode.formation)
    }

    /// Why the engine cannot decide, once for as long as it cannot.
    fn tell_undecided(&mut self, io: &mut Io) {
        if let Some(why) = self.undecided.as_ref().filter(|_| !self.is_told) {
            io.tell(&FromChild::Note { text: format!("the engine cannot decide: {why}") });
        }
        self.is_told = self.undecided.is_some();
    }
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
        self.tell_undecided(io);
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
