//! Records a run: takes every topic as the tap that the topic table counts in, and hands the messages to threads that
//! write them.
//!
//! Duties: never slows the chain, loses nothing in stepped time (which waits for it), and counts what it loses in real
//! time. Motion needs it not: it has no lifeline, and where its disk is full it says so and the walk goes on.

mod queue;
mod show;

use std::collections::BTreeMap;
use std::path::Path;

use messages::{Frame, Health, Message, PortRole, for_each_recorded_topic};
use recording::{About, Part, Record, RunAbout, Slice, Writer, life_path};
use settings::{Settings, Source};
use transport::{FrameSubscriber, FromChild, Io, Service, Subscriber, TransportError, ZeroCopySend, unix_time_s};

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
    /// One for each recorded topic, in the order of the topic table.
    taps: Vec<Box<dyn Tap>>,
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

/// A reader of one topic, whatever it carries.
trait Tap {
    /// Takes the next message, if there is one.
    fn take(&mut self, take: Take) -> Result<Option<Record>, TransportError>;
}

impl<M: Message + ZeroCopySend + Into<Record>> Tap for Subscriber<M> {
    fn take(&mut self, take: Take) -> Result<Option<Record>, TransportError> {
        let message = if take == Take::All { self.take_at_once() } else { Self::take(self) };
        Ok(message?.map(Into::into))
    }
}

impl<F: Frame<Element: ZeroCopySend, Meta: ZeroCopySend>> Tap for FrameSubscriber<F>
where
    Slice<F>: Into<Record>,
{
    fn take(&mut self, take: Take) -> Result<Option<Record>, TransportError> {
        let frame = if take == Take::All { self.take_at_once() } else { Self::take(self) };
        Ok(frame?.map(|frame| Slice::<F> { header: *frame.meta(), data: frame.data().to_vec() }.into()))
    }
}

/// Opens a tap on every recorded topic of these files.
fn open_taps(io: &mut Io, with_depth: bool) -> Result<Vec<Box<dyn Tap>>, TransportError> {
    let mut taps: Vec<Box<dyn Tap>> = Vec::new();
    macro_rules! open {
        ($($kind:ident $id:ident $type:ident in $part:ident as $form:ident;)+) => {$(
            if with_depth || Part::$part != Part::Depth {
                taps.push(open!($kind $type));
            }
        )+};
        // The recorder wakes by its timer: events of the topics would wake it for each message.
        (message $type:ident) => { Box::new(io.quiet_subscriber::<messages::$type>()?) };
        (frame $type:ident) => { Box::new(io.frame_subscriber::<messages::$type>()?) };
    }
    for_each_recorded_topic!(open);
    Ok(taps)
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
            taps: open_taps(io, with_depth)?,
            about,
            first_step: 0,
            next_ns: 0,
            not_recorded: 0,
        })
    }

    fn take(&mut self, take: Take) -> Result<(), TransportError> {
        for tap in &mut self.taps {
            while let Some(record) = tap.take(take)? {
                let queue = match Part::of(record.topic()) {
                    Part::Small => &mut self.small,
                    Part::Depth => &mut self.depth,
                };
                if let Some(queue) = queue {
                    queue.keep(record);
                }
            }
        }
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
    let recorded = ports.filter(|port| part.topics().any(|topic| topic == port.topic));
    recorded.map(|port| (port.topic.name().to_owned(), port.lost)).collect()
}

impl Service for Recorder {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if self.first_step == 0 {
            self.first_step = io.domain.clock.step();
        }
        self.next_ns = io.now_ns() + PERIOD_NS;
        self.take(Take::Seen)?;
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
        self.take(Take::All)?;
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
