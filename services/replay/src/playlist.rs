//! What is played, and when: the records of a part of a recording, once or again and again, at times of this run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use messages::{Cue, Header, NS_PER_S, TopicId};
use recording::{Info, ReadError, Reader, Record};
use settings::Settings;

/// From the run's beginning to the first record, where the recording does not say; and from one pass to the next.
pub const LEAD_IN_NS: u64 = NS_PER_S / 10;

/// Plays a recording.
#[derive(Debug)]
pub struct Playlist {
    path: PathBuf,
    reader: Reader,
    info: Info,
    topics: Vec<TopicId>,
    /// The part that is played, run time of the recording.
    part: (u64, u64),
    /// How many times; 0 = again and again.
    times: u64,
    pass: u64,
    /// Decision period, nanoseconds: a shift of whole periods keeps decisions at the records that they were made on.
    dt_ns: u64,
    /// Run time of this run at the recording's time 0, in real time: its beginning.
    shift_ns: i128,
    next: Option<Record>,
    seqs: BTreeMap<TopicId, Seqs>,
    lives: u32,
    lives_before: u32,
}

/// How the seqs of a topic go on from one pass to the next, without a gap.
#[derive(Debug, Default)]
struct Seqs {
    /// Added to the recorded ones.
    base: u64,
    /// The last one played.
    last: u64,
    /// The first one of this pass, as recorded.
    first: Option<u64>,
}

impl Seqs {
    fn play(&mut self, recorded: u64) -> u64 {
        self.first.get_or_insert(recorded);
        let seq = self.base.saturating_add(recorded);
        self.last = seq.max(self.last);
        seq
    }

    /// A recorded message is played that was played already, or comes from before the part: the next one, and those
    /// recorded after it follow.
    fn play_anew(&mut self, recorded: u64) -> u64 {
        if self.last == 0 {
            return self.play(recorded);
        }
        self.last = self.last.saturating_add(1);
        self.base = self.last.saturating_sub(recorded);
        self.last
    }

    fn next_pass(&mut self) {
        if let Some(first) = self.first.take() {
            self.base = self.last.saturating_add(1).saturating_sub(first);
        }
    }
}

impl Playlist {
    /// Opens the recording at `path` at the beginning of the part that the settings name.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn open(path: PathBuf, settings: &Settings) -> Result<Self, ReadError> {
        let reader = Reader::open(&path)?;
        let info = reader.info().clone();
        let at = |time: u64| info.start_ns.saturating_add(time);
        let from_ns = settings.replay.from.map_or(info.start_ns, |from| at(from.ns()));
        let to_ns = settings.replay.to.map_or(u64::MAX, |to| at(to.ns()));
        let mut playlist = Self {
            path,
            reader,
            topics: settings.replayed_topics(),
            part: (from_ns, to_ns),
            times: settings.replay.times.into(),
            pass: 0,
            dt_ns: settings.policy.dt.ns(),
            shift_ns: 0,
            next: None,
            seqs: BTreeMap::new(),
            lives: 1,
            lives_before: 0,
            info,
        };
        playlist.shift_ns = playlist.first_shift_ns();
        playlist.begin_pass()?;
        Ok(playlist)
    }

    /// What the recording says about itself.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The streams that are played.
    pub fn topics(&self) -> &[TopicId] {
        &self.topics
    }

    /// Whether the recording is played from its beginning, in its own run time: where it is of a whole stepped run,
    /// what is decided on it is what was decided then, to the byte.
    pub fn is_exact(&self) -> bool {
        let whole = self.info.about.run.as_ref().is_some_and(recording::RunAbout::is_whole);
        whole && self.shift_ns == 0 && self.part.0 == self.info.start_ns
    }

    /// Decisions of the recording that were made before those of this run begin.
    pub fn decisions_before(&self) -> u64 {
        u64::try_from(-self.shift_ns).unwrap_or(0) / self.dt_ns
    }

    /// How long one pass lasts, nanoseconds.
    fn span_ns(&self) -> u64 {
        let end_ns = self.part.1.min(self.info.start_ns + self.info.duration_ns);
        end_ns.saturating_sub(self.part.0)
    }

    /// Run time, nanoseconds, that the recorded run ended at, where that was recorded and is played. No run goes on for
    /// long after its last record, whatever the file says.
    pub fn run_end_ns(&self) -> Option<u64> {
        let latest_ns = self.info.start_ns.saturating_add(self.info.duration_ns).saturating_add(1_000_000_000);
        let last = self.info.about.run.as_ref().map(|run| run.last_step).filter(|last| *last > 0)?;
        (self.is_exact() && self.part.1 == u64::MAX && self.times == 1)
            .then(|| last.saturating_mul(messages::QUANTUM_NS).min(latest_ns))
    }

    /// A run keeps the recording's own run time, less whole decision periods before its first record; an import, which
    /// counts from 0, begins a moment later.
    fn first_shift_ns(&self) -> i128 {
        if self.info.about.run.is_none() {
            return i128::from(LEAD_IN_NS) - i128::from(self.part.0);
        }
        let before_ns = self.part.0.saturating_sub(LEAD_IN_NS) / self.dt_ns * self.dt_ns;
        -i128::from(before_ns)
    }

    /// Real time: the first record is played a moment after `now_ns`.
    pub fn begin_at(&mut self, now_ns: u64) {
        self.shift_ns = i128::from(now_ns + LEAD_IN_NS) - i128::from(self.part.0);
    }

    /// A restarted process begins anew, as lives of the drivers that nobody has seen.
    pub fn begin_again_at(&mut self, now_ns: u64, lives_before: u32) {
        self.begin_at(now_ns);
        self.lives_before = lives_before;
    }

    fn begin_pass(&mut self) -> Result<(), ReadError> {
        self.reader.skip_before(self.part.0);
        self.advance()
    }

    /// Run time at which the next record is due, nanoseconds.
    pub fn next_due_ns(&self) -> Option<u64> {
        self.next.as_ref().map(|record| self.shifted(record.time_ns()))
    }

    /// The topic of the next record.
    pub fn next_topic(&self) -> Option<TopicId> {
        self.next.as_ref().map(Record::topic)
    }

    fn shifted(&self, time_ns: u64) -> u64 {
        u64::try_from(i128::from(time_ns) + self.shift_ns).unwrap_or(0)
    }

    /// Takes the next record, as it is to be played: its header is this run's.
    ///
    /// # Errors
    /// Where the recording cannot be read on.
    pub fn take(&mut self) -> Result<Option<Record>, ReadError> {
        let Some(mut record) = self.next.take() else { return Ok(None) };
        let topic = record.topic();
        let header = *record.header();
        self.lives = self.lives.max(header.incarnation);
        let played = Header {
            stamp_ns: u64::try_from(i128::from(header.stamp_ns) + self.shift_ns).unwrap_or(0),
            seq: self.seqs.entry(topic).or_default().play(header.seq),
            incarnation: self.lives_before.saturating_add(header.incarnation),
            ..header
        };
        set_header(&mut record, played, self.lives_before);
        self.advance()?;
        Ok(Some(record))
    }

    /// A cue that was in force in the recording, as one that comes after all that were played.
    pub fn anew(&mut self, cue: &Cue, now_ns: u64) -> Cue {
        let seq = self.seqs.entry(TopicId::Cue).or_default().play_anew(cue.header.seq);
        let incarnation = self.lives_before.saturating_add(cue.header.incarnation);
        let header = Header { stamp_ns: now_ns, seq, incarnation, ..cue.header };
        Cue { header, odometry_incarnation: self.lives_before.saturating_add(cue.odometry_incarnation), ..*cue }
    }

    fn advance(&mut self) -> Result<(), ReadError> {
        loop {
            let record = self.reader.next().transpose()?.filter(|record| record.time_ns() < self.part.1);
            let Some(record) = record else {
                if self.times != 0 && self.pass + 1 >= self.times || self.span_ns() == 0 {
                    self.next = None;
                    return Ok(());
                }
                self.rewind()?;
                continue;
            };
            let judged = matches!(record.topic(), TopicId::ShieldPermit | TopicId::PolicyAction);
            // The mode tells which cue was in force.
            let wanted = judged && self.pass == 0 || record.topic() == TopicId::Mode;
            if record.time_ns() >= self.part.0 && (wanted || self.topics.contains(&record.topic())) {
                self.next = Some(record);
                return Ok(());
            }
        }
    }

    /// From the beginning again. Seqs and lives go on, so that nobody takes a record for one that came before.
    fn rewind(&mut self) -> Result<(), ReadError> {
        self.pass += 1;
        self.shift_ns += i128::from(self.span_ns() + LEAD_IN_NS);
        self.lives_before = self.lives_before.saturating_add(self.lives.saturating_sub(1));
        self.seqs.values_mut().for_each(Seqs::next_pass);
        self.reader = Reader::open(&self.path)?;
        self.reader.skip_before(self.part.0);
        Ok(())
    }
}

/// Gives what is played its new header.
fn set_header(record: &mut Record, header: Header, lives_before: u32) {
    match record {
        Record::LidarScan(scan) => scan.header.header = header,
        Record::SecondScan(scan) => scan.header.header = header,
        Record::DepthFrame(frame) => frame.header.header = header,
        Record::Odometry(odometry) => odometry.header = header,
        Record::Cue(cue) => {
            cue.header = header;
            // Its start frame is one of the odometry's that is played beside it.
            cue.odometry_incarnation = lives_before.saturating_add(cue.odometry_incarnation);
        }
        // What was decided is compared, not played.
        _ => {}
    }
}
