//! The policy service: decision *n* at run time *n dt*, in every mode, active or not.

pub mod geometric;

use geometric::{GeometricConfig, GeometricEngine, Observation};
use guidance::se2::{pose2, se2};
use guidance::{ActionTable, DepthView};
use messages::{
    CueKind, DepthFrame, Health, Latency, LatencyHistogram, LidarScan, MAX_ACTIONS, Mode, ModeClass, Odometry,
    PolicyAction, age_ns,
};
use settings::{Settings, Source};
use transport::{FrameSample, FrameSubscriber, Io, Publisher, Service, Subscriber, TransportError};

/// The service.
pub struct PolicyService {
    engine: GeometricEngine,
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
    /// Opens ports and engine.
    ///
    /// # Errors
    /// Where a port cannot be opened or the settings are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let table = settings.policy.actions.table();
        let has_depth = settings.depth.source != Source::Absent;
        let dt_ns = settings.policy.dt.ns();
        Ok(Self {
            action_table_id: table.id(),
            action_count: table.len() as u32,
            engine: GeometricEngine::new(engine_config(&settings)?, table),
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
        let probabilities = self.engine.decide(&Observation {
            scan: scan.meta(),
            ranges: scan.data(),
            obstacles: self.view.points(),
            odom_from_robot: pose.odom_from_robot,
            odometry_incarnation: pose.header.incarnation,
            start_from_robot: pose2(&(odom_from_start.inverse() * odom_from_robot)),
            cue: cue.map_or(CueKind::Stop, |cue| cue.kind),
            cue_is_new,
        });
        action.probabilities = finite_or_stop(probabilities);
        action
    }
}

/// What an engine gives must be probabilities; anything else is a stop.
fn finite_or_stop(probabilities: [f32; MAX_ACTIONS]) -> [f32; MAX_ACTIONS] {
    if probabilities.iter().all(|p| p.is_finite() && *p >= 0.0) {
        return probabilities;
    }
    let mut stop = [0.0; MAX_ACTIONS];
    stop[ActionTable::STOP] = 1.0;
    stop
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
