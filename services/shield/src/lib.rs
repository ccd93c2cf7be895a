//! The shield service: draws each decision once, judges it on the newest scan, and renews the permit for the running
//! action at every new scan. [`Core`] judges; this file takes the inputs and publishes.

mod core;
mod digest;

use messages::{
    DepthFrame, Health, Latency, LatencyHistogram, LidarScan, Mode, Odometry, Permit, PolicyAction, SecondScan,
};
use settings::Source;
use transport::{FrameSubscriber, Io, Publisher, Service, Subscriber, TransportError};

pub use crate::core::{Core, CoreConfig};
use digest::Digest;

/// The service.
pub struct ShieldService {
    core: Core,
    scans: FrameSubscriber<LidarScan>,
    depth: Option<FrameSubscriber<DepthFrame>>,
    second: Option<FrameSubscriber<SecondScan>>,
    odometry: Subscriber<Odometry>,
    modes: Subscriber<Mode>,
    actions: Subscriber<PolicyAction>,
    permits: Publisher<Permit>,
    digest: Digest,
    scan_latency: LatencyHistogram,
    depth_latency: LatencyHistogram,
}

impl ShieldService {
    /// Opens the ports.
    ///
    /// # Errors
    /// Where the settings make no harness or a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let config = CoreConfig::of(&settings, settings.policy.actions.table()).map_err(TransportError::service)?;
        let core = Core::new(config);
        let has_depth = settings.depth.source != Source::Absent;
        Ok(Self {
            core,
            scans: io.frame_subscriber()?,
            depth: if has_depth { Some(io.frame_subscriber()?) } else { None },
            second: if settings.lidar.second.is_some() { Some(io.frame_subscriber()?) } else { None },
            odometry: io.subscriber()?,
            modes: io.subscriber()?,
            actions: io.subscriber()?,
            permits: io.publisher()?,
            digest: Digest::default(),
            scan_latency: LatencyHistogram { what: Latency::ScanToPermit, ..LatencyHistogram::default() },
            depth_latency: LatencyHistogram { what: Latency::DepthToConsumer, ..LatencyHistogram::default() },
        })
    }

    fn take_inputs(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(mode) = self.modes.take()? {
            self.core.take_mode(&mode);
        }
        while let Some(odometry) = self.odometry.take()? {
            self.core.take_odometry(&odometry);
        }
        if let Some(scans) = &mut self.second {
            while let Some(scan) = scans.take()? {
                self.core.take_second(scan.meta(), scan.data());
            }
        }
        if let Some(frames) = &mut self.depth {
            while let Some(frame) = frames.take()? {
                self.depth_latency.record(io.now_ns().saturating_sub(frame.meta().header.published_ns));
                self.core.take_depth(frame.meta(), frame.data());
            }
        }
        Ok(())
    }

    fn publish(&mut self, io: &Io, permit: Permit) -> Result<(), TransportError> {
        let sent = self.permits.publish(io.now_ns(), permit)?;
        self.digest.permit(&sent);
        Ok(())
    }
}

impl Service for ShieldService {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.take_inputs(io)?;
        // Every scan gets a verdict; then the decisions are judged on the newest of them.
        while let Some(scan) = self.scans.take()? {
            let permit = self.core.on_scan(io.now_ns(), scan.meta(), scan.data());
            self.publish(io, permit)?;
            self.scan_latency.record(io.now_ns().saturating_sub(scan.meta().header.published_ns));
        }
        while let Some(action) = self.actions.take()? {
            self.digest.action(&action);
            if let Some(permit) = self.core.on_action(io.now_ns(), &action) {
                self.publish(io, permit)?;
            }
        }
        if let Some(permit) = self.core.draw_standby(io.now_ns()) {
            self.publish(io, permit)?;
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        self.core.standby_due_ns()
    }

    fn fill_health(&self, health: &mut Health) {
        self.core.fill_health(health);
        health.digest = self.digest.value();
        health.latencies = [self.scan_latency, self.depth_latency];
    }
}
