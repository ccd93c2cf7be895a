//! Recorded frames in the drivers' place: publishes what they would, at the times at which they did. What consumes the
//! topics cannot tell. In the place of all of them it is the master of stepped time; in that of single ones it is a
//! driver beside those of a simulated world.
//!
//! A stepped run that was recorded whole is played step by step, with the headers that it had: what is decided on it is
//! what was decided then, to the byte, and is held against it.

mod compare;
mod playlist;
mod prompter;

use std::fs::File;
use std::io::{BufWriter, Write};

use control::{ReplayFigures, RunFigures};
use messages::{
    Cue, DepthFrame, Frame, LidarScan, MAX_BEAMS, Mode, NS_PER_S, Odometry, Permit, PolicyAction, Pose2, SecondScan,
    TopicId,
};
use recording::{Record, Slice};
use serde_json::json;
use settings::Settings;
use transport::{FramePublisher, FromChild, Io, Publisher, Service, Subscriber, ToChild, TransportError, ZeroCopySend};

use compare::{Compare, Side};
use playlist::Playlist;
use prompter::Prompter;

/// From the last record to the run's end, so that everything published is taken.
const LEAD_OUT_NS: u64 = NS_PER_S / 2;

/// From one frame to the next of the same topic, where several are due.
const FRAME_DISTANCE_NS: u64 = 5_000_000;

/// The ports of the drivers whose place is taken.
struct Ports {
    scans: Option<FramePublisher<LidarScan>>,
    second: Option<FramePublisher<SecondScan>>,
    frames: Option<FramePublisher<DepthFrame>>,
    odometry: Option<Publisher<Odometry>>,
    cues: Option<Publisher<Cue>>,
}

/// What the run decides, where it can be held against the recording.
struct Judge {
    compare: Compare,
    permits: Subscriber<Permit>,
    actions: Subscriber<PolicyAction>,
    differences: Option<BufWriter<File>>,
}

/// The service.
pub struct Replay {
    playlist: Playlist,
    ports: Ports,
    judge: Option<Judge>,
    /// Where the recorded cues are played, but not in the recorded run's own steps.
    prompter: Option<(Prompter, Subscriber<Mode>)>,
    /// Whether it stands for the whole world.
    is_world: bool,
    begun: bool,
    /// Of a restarted process: the lives before it, until its first record.
    begins_again: Option<u32>,
    ended_ns: Option<u64>,
    over: bool,
    /// Run time before which no further scan, or depth frame, is published.
    next_frame_ns: [u64; 3],
    scan_count: u64,
    frame_count: u64,
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
        let path = settings.replay.recording.clone();
        let path = path.ok_or_else(|| TransportError::service("replay.recording is not set"))?;
        let playlist = Playlist::open(path.into(), &settings).map_err(TransportError::service)?;
        let lives_before = io.identity().incarnation.saturating_sub(1);
        let is_world = !settings.has_world();
        // In real time nothing is equal to the byte, and decisions are not made on the same records.
        let judge = is_world && io.domain.clock.is_stepped() && settings.replay.times == 1;
        let prompts = playlist.topics().contains(&TopicId::Cue)
            && !(playlist.is_exact() && io.domain.clock.is_stepped() && settings.replay.times == 1);
        Ok(Self {
            ports: Ports::open(playlist.topics(), &settings, io)?,
            judge: if judge { Some(Judge::open(&playlist, &settings, io)?) } else { None },
            prompter: if prompts { Some((Prompter::default(), io.quiet_subscriber()?)) } else { None },
            playlist,
            is_world,
            begun: io.domain.clock.is_stepped() || lives_before > 0,
            begins_again: (lives_before > 0).then_some(lives_before),
            ended_ns: None,
            over: false,
            next_frame_ns: [0; 3],
            scan_count: 0,
            frame_count: 0,
            distance_m: 0.0,
            last_pose: None,
        })
    }

    fn publish(&mut self, record: &Record, now_ns: u64) -> Result<(), TransportError> {
        match record {
            Record::LidarScan(scan) => {
                if let Some(scans) = &mut self.ports.scans {
                    republish(scans, scan)?;
                    self.scan_count += 1;
                }
            }
            Record::SecondScan(scan) => {
                if let Some(scans) = &mut self.ports.second {
                    republish(scans, scan)?;
                }
            }
            Record::DepthFrame(frame) => {
                if let Some(frames) = &mut self.ports.frames {
                    republish(frames, frame)?;
                    self.frame_count += 1;
                }
            }
            Record::Odometry(odometry) => {
                let pose = odometry.odom_from_robot;
                if let Some(last) = self.last_pose.replace(pose) {
                    self.distance_m += (pose.x_m - last.x_m).hypot(pose.y_m - last.y_m);
                }
                self.ports.odometry.as_mut().map_or(Ok(()), |port| port.republish(**odometry).map(drop))?;
            }
            Record::Cue(cue) => {
                self.prompter.iter_mut().for_each(|(prompter, _)| prompter.given(now_ns));
                self.ports.cues.as_mut().map_or(Ok(()), |port| port.republish(**cue).map(drop))?;
            }
            Record::Mode(mode) => self.prompter.iter_mut().for_each(|(prompter, _)| prompter.recorded(mode)),
            Record::ShieldPermit(permit) => {
                self.judge.iter_mut().for_each(|j| j.compare.permit(Side::Recorded, permit))
            }
            Record::PolicyAction(action) => {
                self.judge.iter_mut().for_each(|j| j.compare.action(Side::Recorded, action))
            }
            // The run has its own.
            _ => {}
        }
        Ok(())
    }

    /// Gives the cue that is in force in the recording, where the run waits for it.
    fn prompt(&mut self, now_ns: u64) -> Result<(), TransportError> {
        let Some((prompter, modes)) = &mut self.prompter else { return Ok(()) };
        if let Some(cue) = modes.take_newest()?.and_then(|mode| prompter.due(&mode, now_ns))
            && let Some(port) = &mut self.ports.cues
        {
            port.republish(self.playlist.anew(&cue, now_ns))?;
        }
        Ok(())
    }

    /// When the next record may be published. Frames keep a distance, so that one that is late does not push another
    /// out of a reader's queue.
    fn next_ns(&self) -> Option<u64> {
        let not_before = match self.playlist.next_topic()? {
            TopicId::LidarScan => self.next_frame_ns[0],
            TopicId::DepthFrame => self.next_frame_ns[1],
            TopicId::SecondScan => self.next_frame_ns[2],
            _ => 0,
        };
        Some(self.playlist.next_due_ns()?.max(not_before))
    }

    fn publish_due(&mut self, now_ns: u64) -> Result<(), TransportError> {
        while let Some(next_ns) = self.next_ns() {
            if next_ns > now_ns {
                return Ok(());
            }
            match self.playlist.next_topic() {
                Some(TopicId::LidarScan) => self.next_frame_ns[0] = now_ns + FRAME_DISTANCE_NS,
                Some(TopicId::DepthFrame) => self.next_frame_ns[1] = now_ns + FRAME_DISTANCE_NS,
                Some(TopicId::SecondScan) => self.next_frame_ns[2] = now_ns + FRAME_DISTANCE_NS,
                _ => {}
            }
            if let Some(record) = self.playlist.take().map_err(TransportError::service)? {
                self.publish(&record, now_ns)?;
            }
        }
        self.ended_ns.get_or_insert(now_ns);
        Ok(())
    }

    /// Run time at which the run is over: that of the recorded run, or a moment after the last record.
    fn end_ns(&self) -> Option<u64> {
        let ended_ns = self.ended_ns.filter(|_| self.is_world)?;
        Some(self.playlist.run_end_ns().unwrap_or(ended_ns + LEAD_OUT_NS))
    }

    fn figures(&self) -> serde_json::Value {
        let info = self.playlist.info();
        let (exact, to_its_end) = (self.playlist.is_exact(), self.playlist.run_end_ns().is_some());
        json!(RunFigures {
            reached: self.playlist.next_topic().is_none(),
            distance_m: self.distance_m,
            replayed: Some(ReplayFigures {
                recording: info.about.source.clone(),
                scans: self.scan_count,
                depth_frames: self.frame_count,
                recorded_s: messages::s_from_ns(info.duration_ns),
                input_anomalies: info.about.anomalies.clone(),
                compared: self.judge.as_ref().map(|judge| judge.compare.figures(exact, to_its_end)),
            }),
            ..RunFigures::default()
        })
    }

    fn tell_end(&mut self, io: &Io) -> Result<(), TransportError> {
        if let Some(judge) = &mut self.judge {
            judge.take(true)?;
        }
        if io.tell(&FromChild::RunEnded { figures: self.figures() }) {
            Ok(())
        } else {
            Err(TransportError::service("the replay's figures could not be told"))
        }
    }
}

/// Publishes a recorded frame again.
fn republish<F: Frame<Element: ZeroCopySend, Meta: ZeroCopySend>>(
    port: &mut FramePublisher<F>,
    frame: &Slice<F>,
) -> Result<(), TransportError> {
    let mut loan = port.loan(frame.data.len())?;
    *loan.meta_mut() = frame.header;
    loan.data_mut().copy_from_slice(&frame.data);
    port.republish(loan).map(drop)
}

impl Ports {
    fn open(topics: &[TopicId], settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let pixels = (settings.depth.width * settings.depth.height) as usize;
        let has = |topic| topics.contains(&topic);
        Ok(Self {
            scans: if has(TopicId::LidarScan) { Some(io.frame_publisher(MAX_BEAMS)?) } else { None },
            second: if has(TopicId::SecondScan) { Some(io.frame_publisher(MAX_BEAMS)?) } else { None },
            frames: if has(TopicId::DepthFrame) { Some(io.frame_publisher(pixels)?) } else { None },
            odometry: if has(TopicId::Odometry) { Some(io.publisher()?) } else { None },
            cues: if has(TopicId::Cue) { Some(io.publisher()?) } else { None },
        })
    }
}

impl Judge {
    fn open(playlist: &Playlist, settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let create = |path| File::create(path).map(BufWriter::new).map_err(TransportError::service);
        Ok(Self {
            compare: Compare::new(playlist.decisions_before()),
            permits: io.quiet_subscriber()?,
            actions: io.quiet_subscriber()?,
            differences: settings.replay.differences.as_ref().map(create).transpose()?,
        })
    }

    /// Takes what was decided; at the end also what may be seen in no later step.
    fn take(&mut self, at_end: bool) -> Result<(), TransportError> {
        while let Some(action) = if at_end { self.actions.take_at_once() } else { self.actions.take() }? {
            self.compare.action(Side::Now, &action);
        }
        while let Some(permit) = if at_end { self.permits.take_at_once() } else { self.permits.take() }? {
            self.compare.permit(Side::Now, &permit);
        }
        let lines = self.compare.take_lines();
        if let Some(file) = &mut self.differences {
            for line in lines {
                writeln!(file, "{line}").map_err(TransportError::service)?;
            }
            if at_end {
                file.flush().map_err(TransportError::service)?;
            }
        }
        Ok(())
    }
}

impl Service for Replay {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        if let Some(lives_before) = self.begins_again.take() {
            self.playlist.begin_again_at(now, lives_before);
        }
        if self.begun {
            self.publish_due(now)?;
            self.prompt(now)?;
        }
        if let Some(judge) = &mut self.judge {
            judge.take(false)?;
        }
        self.over |= self.end_ns().is_some_and(|end| now >= end);
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        if !self.begun {
            return None;
        }
        self.next_ns().or_else(|| self.end_ns().filter(|_| !self.over))
    }

    fn on_control(
        &mut self,
        io: &mut Io,
        message: ToChild,
        _fd: Option<std::os::fd::OwnedFd>,
    ) -> Result<(), TransportError> {
        if message == ToChild::Begin && !self.begun {
            self.begun = true;
            self.playlist.begin_at(io.now_ns());
        }
        Ok(())
    }

    fn is_clock_master(&self) -> bool {
        self.is_world
    }

    fn time_is_over(&self) -> bool {
        self.over
    }

    fn on_time_over(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.tell_end(io)
    }

    fn on_leave(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.over = true;
        if self.is_world { self.tell_end(io) } else { Ok(()) }
    }
}
