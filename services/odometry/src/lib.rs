//! The odometry driver: poses from a source, corrected by the lidar's scans where that is wanted, with an attitude from
//! the camera where no source tells one. A new incarnation is a new odometry frame.

mod matching;
mod robot;
mod seen;
mod simulated;
mod tracked;

use messages::Odometry;
use settings::{AttitudeSource, OdometryDevice, Source};
use transport::{FromChild, Io, Publisher, Service, TransportError};

pub use matching::ScanMatching;
pub use robot::RobotOdometry;
use seen::AlwaysLevel;
pub use seen::SeenAttitude;
pub use simulated::SimulatedOdometry;
pub use tracked::TrackedOdometry;

/// Where poses come from: the simulated world, or a device.
pub trait PoseSource {
    /// Run time at which the source wants to be asked, nanoseconds.
    fn next_timer_ns(&self) -> Option<u64>;

    /// The next pose with its stamp, if there is one.
    ///
    /// # Errors
    /// Where the source is broken for good, or a new life with a frame of its own has to go on.
    fn poll(&mut self, io: &Io) -> Result<Option<(u64, Odometry)>, TransportError>;
}

/// The service.
pub struct OdometryDriver {
    source: Box<dyn PoseSource>,
    matching: Option<ScanMatching>,
    seen: Option<SeenAttitude>,
    /// Where the source is a real one and tells the attitude.
    always_level: Option<AlwaysLevel>,
    poses: Publisher<Odometry>,
}

impl OdometryDriver {
    /// Opens the source that the settings name.
    ///
    /// # Errors
    /// Where source or port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let source: Box<dyn PoseSource> = match settings.odometry.source {
            Source::Simulated => Box::new(SimulatedOdometry::open(&settings, io)?),
            Source::Device => match settings.odometry.device {
                OdometryDevice::Robot => Box::new(RobotOdometry::open(&settings, io)?),
                OdometryDevice::T265 => Box::new(TrackedOdometry::open(&settings, io)?),
            },
            Source::Replayed | Source::Absent => {
                return Err(TransportError::Service("odometry.source names no source for this driver".to_owned()));
            }
        };
        let matching = if settings.matches_scans() { Some(ScanMatching::open(&settings, io)?) } else { None };
        let is_seen = settings.odometry.attitude == AttitudeSource::Depth;
        let seen = if is_seen { Some(SeenAttitude::open(&settings, io)?) } else { None };
        let always_level = (settings.has_real_odometry() && !is_seen).then(AlwaysLevel::default);
        Ok(Self { source, matching, seen, always_level, poses: io.publisher()? })
    }
}

impl Service for OdometryDriver {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.seen.as_mut().map_or(Ok(()), |seen| seen.look(io))?;
        while let Some((stamp_ns, pose)) = self.source.poll(io)? {
            if let Some(text) = self.always_level.as_mut().and_then(|level| level.note(&pose.attitude)) {
                io.tell(&FromChild::Note { text: text.to_owned() });
            }
            let pose = self.seen.as_mut().map_or(pose, |seen| seen.hold(io, pose));
            let pose = self.matching.as_mut().map_or(pose, |matching| matching.correct(stamp_ns, pose));
            self.poses.publish(stamp_ns, pose)?;
        }
        // Poses are out: no pose waits for a match.
        self.matching.as_mut().map_or(Ok(()), |matching| matching.work(io))
    }

    fn next_timer_ns(&self) -> Option<u64> {
        self.source.next_timer_ns()
    }
}
