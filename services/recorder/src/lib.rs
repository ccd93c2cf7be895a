//! Records a run: takes every topic as the tap that the topic table counts in, and hands the messages to threads that
//! write them.
//!
//! Duties: never slows the chain, loses nothing in stepped time (which waits for it), and counts what it loses in real
//! time. Motion needs it not: it has no lifeline, and where its disk is full it says so and the walk goes on.

mod queue;
mod show;

use std::collections::BTreeMap;
use std::path::Path;

use messages::{
    Cue, CueAnswer, CueHeard, CueRequest, DepthFrame, EmergencyStop, Health, LidarScan, LocomotionState, Mode,
    Odometry, Permit, PolicyAction, PortRole, SpeechSaid, TopicId, WorldTruth,
};
use recording::{About, Part, Record, RunAbout, Writer, life_path};
use settings::{Settings, Source};
use transport::{FrameSubscriber, FromChild, Io, Service, Subscriber, TransportError, unix_time_s};

use queue::{Queue, chain};
use show::Show;

/// Real time: the shallowest queue that does not wake its reader holds 40 ms.
const PERIOD_NS: u64 = 10_000_000;
/// Records that may wait for the file of the small topics: some ten seconds of them.
const SMALL_ROOM: usize = 4096;
/// Frames that may wait for the file of the depth frames: half a second, 30 MB at 1280x720.
const DEPTH_ROOM: usize = 16;

/// The service.
pub struct Recorder {
    scans: FrameSubscriber<LidarScan>,
    frames: Option<FrameSubscriber<DepthFrame>>,
    odometry: Subscriber<Odometry>,
    cues: Subscriber<Cue>,
    requests: Subscriber<CueRequest>,
    actions: Subscriber<PolicyAction>,
    permits: Subscriber<Permit>,
    modes: Subscriber<Mode>,
    states: Subscriber<LocomotionState>,
    estop: Subscriber<EmergencyStop>,
    answers: Subscriber<CueAnswer>,
    heard: Subscriber<CueHeard>,
    said: Subscriber<SpeechSaid>,
    truths: Subscriber<WorldTruth>,
    small: Option<Queue>,
    depth: Option<Queue>,
    about: About,
    first_step: u64,
    next_ns: u64,
    not_recorded: u64,
}

/// Stepped time waits for room anyway; with little of it a killed recorder loses little.
const STEPPED_ROOM: usize = 16;

/// Which messages are taken.
#[derive(Clone, Copy, PartialEq)]
enum Take {
    /// Those that may be seen by now.
    Seen,
    /// All, whatever the step: time stands still.
    All,
}

impl Recorder {
    /// Begins the files that the run's order names.
    ///
    /// # Errors
    /// Where there is no order, a file is there already or cannot be written, or a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let text = std::fs::read_to_string(io.domain.dir.settings()).map_err(TransportError::service)?;
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let order = io.domain.dir.read_recording_order()?;
        let path = life_path(&order.path, io.identity().incarnation.saturating_sub(order.lives_before));
        let with_depth = settings.record.depth && settings.depth.source != Source::Absent;
        let about = about(&settings, &path, with_depth, io);
        let begin = |part: Part, room: usize, io: &Io| {
            let writer = Writer::live(&part.path(&path), part, &about, &text);
            let writer = writer.map_err(|error| TransportError::Service(chain(&error)))?;
            let stepped = io.domain.clock.is_stepped();
            let show = (part == Part::Small).then(|| Show::new(&settings));
            Ok::<_, TransportError>(Queue::new(writer, if stepped { STEPPED_ROOM } else { room }, stepped, show))
        };
        Ok(Self {
            small: Some(begin(Part::Small, SMALL_ROOM, io)?),
            depth: if with_depth { Some(begin(Part::Depth, DEPTH_ROOM, io)?) } else { None },
            scans: io.frame_subscriber()?,
            frames: if with_depth { Some(io.frame_subscriber()?) } else { None },
            odometry: io.quiet_subscriber()?,
            cues: io.quiet_subscriber()?,
            requests: io.quiet_subscriber()?,
            actions: io.quiet_subscriber()?,
            permits: io.quiet_subscriber()?,
            modes: io.quiet_subscriber()?,
            states: io.quiet_subscriber()?,
            estop: io.quiet_subscriber()?,
            answers: io.quiet_subscriber()?,
            heard: io.quiet_subscriber()?,
            said: io.quiet_subscriber()?,
            truths: io.quiet_subscriber()?,
            about,
            first_step: 0,
            next_ns: 0,
            not_recorded: 0,
        })
    }

    fn keep(&mut self, record: Record) {
        let queue = match Part::of(record.topic()) {
            Part::Small => &mut self.small,
            Part::Depth => &mut self.depth,
        };
        if let Some(queue) = queue {
            queue.keep(record);
        }
    }

    fn take_frames(&mut self, take: Take) -> Result<(), TransportError> {
        while let Some(scan) = if take == Take::All { self.scans.take_at_once() } else { self.scans.take() }? {
            self.keep(Record::Scan { header: *scan.meta(), ranges_m: scan.data().to_vec() });
        }
        while let Some(frames) = &mut self.frames
            && let Some(frame) = if take == Take::All { frames.take_at_once() } else { frames.take() }?
        {
            self.keep(Record::Depth { header: *frame.meta(), pixels_mm: frame.data().to_vec() });
        }
        Ok(())
    }

    fn take_messages(&mut self, take: Take) -> Result<(), TransportError> {
        /// Takes from a port what is there.
        macro_rules! take {
            ($port:ident, $record:expr) => {
                while let Some(message) = if take == Take::All { self.$port.take_at_once() } else { self.$port.take() }?
                {
                    self.keep($record(message));
                }
            };
        }
        take!(odometry, Record::Odometry);
        take!(cues, Record::Cue);
        take!(requests, Record::CueRequest);
        take!(actions, |action| Record::Action(Box::new(action)));
        take!(permits, |permit| Record::Permit(Box::new(permit)));
        take!(modes, |mode| Record::Mode(Box::new(mode)));
        take!(states, |state| Record::Locomotion(Box::new(state)));
        take!(estop, Record::Estop);
        take!(answers, |answer| Record::CueAnswer(Box::new(answer)));
        take!(heard, Record::Heard);
        take!(said, |said| Record::Said(Box::new(said)));
        take!(truths, |truth| Record::Truth(Box::new(truth)));
        Ok(())
    }

    /// Says why a file came to its end before its time.
    fn tell_failures(&mut self, io: &Io) {
        for queue in [&mut self.small, &mut self.depth].into_iter().flatten() {
            if let Some(why) = queue.failure() {
                io.tell(&FromChild::Note { text: format!("recording ended, and can be recovered: {why}") });
            }
        }
    }

    fn count_losses(&mut self) {
        let queues = [&self.small, &self.depth].into_iter().flatten();
        self.not_recorded = queues.flat_map(|queue| queue.left_out().values()).sum();
    }
}

fn about(settings: &Settings, path: &Path, with_depth: bool, io: &Io) -> About {
    let depth_file = Part::Depth.path(path).file_name().map(|name| name.to_string_lossy().into_owned());
    About {
        source: format!("run {}", io.domain.info.name),
        robot: (settings.locomotion.link.row().robot)(&settings.locomotion).to_owned(),
        field_of_view_rad: settings.lidar.field_of_view_deg.get().to_radians(),
        first_wall_clock_s: Some(unix_time_s()),
        anomalies: BTreeMap::new(),
        run: Some(RunAbout {
            name: io.domain.info.name.clone(),
            stepped: io.domain.clock.is_stepped(),
            seed: settings.simulation.seed,
            incarnation: io.identity().incarnation,
            depth_file: depth_file.filter(|_| with_depth),
            ..RunAbout::default()
        }),
    }
}

/// Gaps that the ports of the recorder saw, by topic.
fn gaps(io: &Io, part: Part) -> BTreeMap<String, u64> {
    let counters = io.port_counters();
    let ports = counters.iter().filter(|port| port.role == PortRole::Subscriber && port.lost > 0);
    // Its clock is not recorded.
    let recorded = ports.filter(|port| part.topics().contains(&port.topic) && port.topic != TopicId::None);
    recorded.map(|port| (port.topic.name().to_owned(), port.lost)).collect()
}

impl Service for Recorder {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if self.first_step == 0 {
            self.first_step = io.domain.clock.step();
        }
        self.next_ns = io.now_ns() + PERIOD_NS;
        self.take_frames(Take::Seen)?;
        self.take_messages(Take::Seen)?;
        if io.disk_is_full() {
            [&self.small, &self.depth].into_iter().flatten().for_each(Queue::fill_disk);
        }
        self.tell_failures(io);
        self.count_losses();
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_leave(&mut self, io: &mut Io) -> Result<(), TransportError> {
        // What was published in the last step is seen in no later one.
        self.take_frames(Take::All)?;
        self.take_messages(Take::All)?;
        self.tell_failures(io);
        self.count_losses();
        let (first_step, last_step) = (self.first_step, io.domain.clock.step());
        for (part, queue) in [(Part::Small, self.small.take()), (Part::Depth, self.depth.take())] {
            let Some(queue) = queue else { continue };
            let mut about = self.about.clone();
            let lost = gaps(io, part);
            let finished = queue.finish(|left_out| {
                if let Some(run) = &mut about.run {
                    (run.first_step, run.last_step, run.lost) = (first_step, last_step, lost);
                    for (topic, n) in left_out {
                        *run.lost.entry(topic.name().to_owned()).or_default() += n;
                    }
                    "finished".clone_into(&mut run.ended);
                }
                about
            });
            if let Err(why) = finished {
                io.tell(&FromChild::Note { text: format!("recording not finished, and can be recovered: {why}") });
            }
        }
        Ok(())
    }

    fn fill_health(&self, health: &mut Health) {
        health.not_recorded = self.not_recorded;
    }
}
