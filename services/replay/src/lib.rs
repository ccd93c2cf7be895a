//! Recorded frames in the drivers' place: publishes what they would, at the times at which they did. What consumes the
//! topics cannot tell. In stepped time it is the clock's master.

use messages::{LidarScan, MAX_BEAMS, NS_PER_S, Odometry, Pose2};
use recording::{Info, Reader, Record};
use serde_json::json;
use transport::{FramePublisher, FromChild, Io, Publisher, Service, ToChild, TransportError};

/// From the run's beginning to the first record.
const LEAD_IN_NS: u64 = NS_PER_S / 10;
/// From the last record to the run's end, so that everything published is taken.
const LEAD_OUT_NS: u64 = NS_PER_S / 2;

/// From one scan to the next, where several are due.
const SCAN_DISTANCE_NS: u64 = 5_000_000;

/// The service.
pub struct Replay {
    records: Reader,
    info: Info,
    next: Option<Record>,
    scans: FramePublisher<LidarScan>,
    odometry: Publisher<Odometry>,
    /// Run time of the recording's time 0; none while the run has not begun.
    begins_at_ns: Option<u64>,
    /// Records from this time of the recording on are left out.
    until_ns: u64,
    last_ns: u64,
    ended_ns: Option<u64>,
    over: bool,
    /// Run time before which no further scan is published.
    next_scan_ns: u64,
    scan_count: u64,
    distance_m: f64,
    last_pose: Option<Pose2>,
}

impl Replay {
    /// Opens the recording that the settings name.
    ///
    /// # Errors
    /// Where it cannot be read, or a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let path = settings.replay.recording.ok_or_else(|| TransportError::service("replay.recording is not set"))?;
        let records = Reader::open(&path).map_err(TransportError::service)?;
        let info = records.info().clone();
        let mut replay = Self {
            records,
            info,
            next: None,
            scans: io.frame_publisher(MAX_BEAMS)?,
            odometry: io.publisher()?,
            begins_at_ns: io.domain.clock.is_stepped().then_some(LEAD_IN_NS),
            until_ns: settings.replay.duration.map_or(u64::MAX, |duration| duration.ns()),
            last_ns: 0,
            ended_ns: None,
            over: false,
            next_scan_ns: 0,
            scan_count: 0,
            distance_m: 0.0,
            last_pose: None,
        };
        replay.advance()?;
        Ok(replay)
    }

    fn advance(&mut self) -> Result<(), TransportError> {
        self.next = self.records.next().transpose().map_err(TransportError::service)?;
        let over = self.next.as_ref().is_some_and(|record| self.since_start(record) >= self.until_ns);
        if over {
            self.next = None;
        }
        Ok(())
    }

    fn since_start(&self, record: &Record) -> u64 {
        record.stamp_ns().saturating_sub(self.info.start_ns)
    }

    fn publish(&mut self, record: &Record, stamp_ns: u64) -> Result<(), TransportError> {
        match record {
            Record::Scan { header, ranges_m } => {
                let mut loan = self.scans.loan(ranges_m.len())?;
                *loan.meta_mut() = *header;
                loan.data_mut().copy_from_slice(ranges_m);
                self.scans.publish(stamp_ns, loan)?;
                self.scan_count += 1;
            }
            Record::Odometry(odometry) => {
                let pose = odometry.odom_from_robot;
                if let Some(last) = self.last_pose.replace(pose) {
                    self.distance_m += (pose.x_m - last.x_m).hypot(pose.y_m - last.y_m);
                }
                self.odometry.publish(stamp_ns, *odometry)?;
            }
        }
        Ok(())
    }

    /// Publishes what is due. Scans keep a distance, so that one that is late does not push another out of a reader's
    /// queue.
    fn publish_due(&mut self, begins_at_ns: u64, now_ns: u64) -> Result<(), TransportError> {
        while let Some(record) = &self.next {
            let stamp_ns = begins_at_ns.saturating_add(self.since_start(record));
            let is_scan = matches!(record, Record::Scan { .. });
            if stamp_ns > now_ns || (is_scan && now_ns < self.next_scan_ns) {
                return Ok(());
            }
            if is_scan {
                self.next_scan_ns = now_ns + SCAN_DISTANCE_NS;
            }
            self.last_ns = stamp_ns;
            if let Some(record) = self.next.take() {
                self.publish(&record, stamp_ns)?;
            }
            self.advance()?;
        }
        self.ended_ns.get_or_insert(now_ns);
        Ok(())
    }

    fn figures(&self) -> serde_json::Value {
        json!({
            "reached": self.next.is_none(),
            "recording": self.info.about.source,
            "scans": self.scan_count,
            "recorded_s": messages::s_from_ns(self.info.duration_ns),
            "distance_m": self.distance_m,
            "collisions": { "robot": 0, "handler": 0, "hit_by_others": 0 },
            "input_anomalies": self.info.about.anomalies,
        })
    }
}

impl Service for Replay {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        if let Some(begins_at) = self.begins_at_ns {
            self.publish_due(begins_at, now)?;
        }
        self.over |= self.ended_ns.is_some_and(|ended| now >= ended + LEAD_OUT_NS);
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        let begins_at = self.begins_at_ns?;
        match (&self.next, self.ended_ns) {
            (Some(record @ Record::Scan { .. }), _) => {
                Some((begins_at + self.since_start(record)).max(self.next_scan_ns))
            }
            (Some(record), _) => Some(begins_at + self.since_start(record)),
            (None, Some(ended)) if !self.over => Some(ended + LEAD_OUT_NS),
            _ => None,
        }
    }

    fn on_control(
        &mut self,
        io: &mut Io,
        message: ToChild,
        _fd: Option<std::os::fd::OwnedFd>,
    ) -> Result<(), TransportError> {
        if message == ToChild::Begin && self.begins_at_ns.is_none() {
            self.begins_at_ns = Some(io.now_ns() + LEAD_IN_NS);
        }
        Ok(())
    }

    fn is_clock_master(&self) -> bool {
        true
    }

    fn time_is_over(&self) -> bool {
        self.over
    }

    fn on_time_over(&mut self, io: &mut Io) -> Result<(), TransportError> {
        io.tell(&FromChild::RunEnded { figures: self.figures() });
        Ok(())
    }

    fn on_leave(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.over = true;
        io.tell(&FromChild::RunEnded { figures: self.figures() });
        Ok(())
    }
}
