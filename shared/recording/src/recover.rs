//! Makes a whole recording of one whose end is missing: its recorder was killed, or its disk was full.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use mcap::records::{self, op};
use messages::TopicId;
use serde::Serialize;

use crate::channel::{CHANNELS, Channel};
use crate::chunk::{Entry, each_entry};
use crate::file_reader::name_flaw;
use crate::index::{Flaw, MAGIC, body, check_data, read_at, read_record};
use crate::info::{BEGUN_NAME, METADATA_NAME, OLDEST_VERSION, SETTINGS_KEY, SETTINGS_NAME, format_version};
use crate::writer::{Part, Writer};
use crate::{About, FORMAT_VERSION, Info, ReadError, Record, Viewer, WriteError, lengths};

/// What a recovered file says of its end.
const ENDED: &str = "recovered";
/// What the file of a recording's last part says of its end.
const LAST: &str = "the last part of a recording";

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recovered {
    /// The torn file.
    pub from: PathBuf,
    /// The whole one.
    pub to: PathBuf,
    /// What the whole one says about itself.
    pub info: Info,
    /// Length of the torn file.
    pub bytes: u64,
    /// From here on nothing could be read; the torn file's length where nothing is missing but the end.
    pub cut_at_byte: u64,
    /// What is wrong there; at the end: with the torn file as a whole.
    pub why: Option<String>,
}

/// Why a recording could not be recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The torn file cannot be read, or is none of ours.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The whole one cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// What stands before the first chunk, and what was found behind it.
#[derive(Default)]
struct Found {
    about: Option<About>,
    settings: String,
    channels: BTreeMap<u16, &'static Channel>,
    viewers: BTreeMap<u16, Viewer>,
    /// The last seq of every life of every topic.
    seqs: BTreeMap<(TopicId, u32), u64>,
    /// Gaps between the seqs.
    lost: BTreeMap<String, u64>,
}

/// Makes a whole recording at `to` of the torn one at `from`, as far as it can be read: to its first record that is not
/// whole, or that makes no sense. It takes a whole recording as well. `from` stays as it is; of a `to` that could not
/// be written to its end nothing is left.
///
/// # Errors
/// Where `from` cannot be read or is no live recording of ours, and where `to` exists or cannot be written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    write_or_remove(from, to, None)
}

/// Writes the last `span_ns` of a recording, which may be torn, to `to`, without its depth frames.
///
/// # Errors
/// As [`recover`].
pub fn write_last(from: &Path, to: &Path, span_ns: u64) -> Result<Recovered, RecoverError> {
    write_or_remove(from, to, Some(last_ns(from)?.saturating_sub(span_ns)))
}

/// Run time of the last readable record, nanoseconds; 0 if there is none.
fn last_ns(path: &Path) -> Result<u64, ReadError> {
    let (mut torn, mut found) = (Torn::open(path)?, Found::default());
    let mut last_ns = 0;
    while let Step::Records(records) = torn.next(&mut found)? {
        last_ns = records.iter().map(Kept::time_ns).fold(last_ns, u64::max);
    }
    Ok(last_ns)
}

/// Of a `to` that could not be written to its end nothing is left.
fn write_or_remove(from: &Path, to: &Path, cut_ns: Option<u64>) -> Result<Recovered, RecoverError> {
    let mut began = false;
    write_whole(from, to, cut_ns, &mut began).inspect_err(|_| {
        if began {
            // Why it could not be written is what counts.
            let _ = std::fs::remove_file(to);
        }
    })
}

/// Leaves out what was before `cut_ns`. `began` tells whether there is a file at `to` that is ours.
fn write_whole(from: &Path, to: &Path, cut_ns: Option<u64>, began: &mut bool) -> Result<Recovered, RecoverError> {
    let mut torn = Torn::open(from)?;
    let mut found = Found::default();
    let mut writer: Option<Writer> = None;
    let why = loop {
        match torn.next(&mut found)? {
            Step::Over => break None,
            Step::Flaw(what) => break Some(what),
            Step::Records(records) if records.is_empty() => {}
            Step::Records(records) => {
                let writer = match &mut writer {
                    Some(writer) => writer,
                    none => none.insert(found.begin(from, to, None)?),
                };
                *began = true;
                let mut kept = records.iter().filter(|kept| cut_ns.is_none_or(|cut_ns| kept.time_ns() >= cut_ns));
                kept.try_for_each(|kept| kept.write(writer)).and_then(|()| writer.flush())?;
            }
        }
    };
    let writer = match writer {
        Some(writer) => writer,
        None => found.begin(from, to, why.as_ref().map(|what| (torn.byte, what)))?,
    };
    *began = true;
    let mut about = found.finish(to);
    if let Some(run) = about.run.as_mut().filter(|_| cut_ns.is_some()) {
        // Its first step is missing, and so are the depth frames.
        (run.first_step, run.depth_file, run.ended) = (0, None, LAST.to_owned());
    }
    let info = writer.finish(about)?;
    Ok(Recovered { from: from.to_owned(), to: to.to_owned(), info, bytes: torn.bytes, cut_at_byte: torn.byte, why })
}

/// A file that is read from its beginning, as far as it goes.
struct Torn {
    path: PathBuf,
    file: File,
    bytes: u64,
    /// Up to here everything made sense.
    byte: u64,
}

/// What is taken over.
enum Kept {
    Record(Record),
    /// For viewers: as it is.
    Shown(Viewer, u64, Vec<u8>),
}

impl Kept {
    fn time_ns(&self) -> u64 {
        match self {
            Self::Record(record) => record.time_ns(),
            Self::Shown(_, time_ns, _) => *time_ns,
        }
    }

    fn write(&self, writer: &mut Writer) -> Result<(), WriteError> {
        match self {
            Self::Record(record) => writer.write(record),
            Self::Shown(viewer, time_ns, json) => writer.show(*viewer, *time_ns, json),
        }
    }
}

/// What comes next.
enum Step {
    /// Records, or none.
    Records(Vec<Kept>),
    /// Something that cannot be read.
    Flaw(String),
    /// Nothing.
    Over,
}

impl Torn {
    fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |source| ReadError::Io { path: path.to_owned(), byte: 0, source };
        if !path.metadata().map_err(failed)?.is_file() {
            return Err(ReadError::NotAFile { path: path.to_owned() });
        }
        let mut file = File::open(path).map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        let mark = MAGIC.len() as u64;
        match read_at(&mut file, 0, mark.min(bytes)).map_err(|flaw| name_flaw(path, bytes, flaw))? {
            magic if magic.is_empty() => Err(ReadError::Empty { path: path.to_owned() }),
            magic if magic != MAGIC => Err(ReadError::NotMcap { path: path.to_owned() }),
            _ => Ok(Self { path: path.to_owned(), file, bytes, byte: mark }),
        }
    }

    fn next(&mut self, found: &mut Found) -> Result<Step, ReadError> {
        if self.byte >= self.bytes {
            return Ok(Step::Over);
        }
        let raw = match read_record(&mut self.file, self.byte, self.bytes) {
            Ok(raw) => raw,
            Err(Flaw::Io { byte, source }) => return Err(ReadError::Io { path: self.path.clone(), byte, source }),
            Err(flaw) => return Ok(Step::Flaw(name_flaw(&self.path, self.bytes, flaw).to_string())),
        };
        let records = match raw.first().copied().unwrap_or_default() {
            // No record has this number: a file system that lost the end fills it with zeros.
            0 => return Ok(Step::Flaw("nothing was written here".to_owned())),
            // The data is over, and what the summary says is said anew.
            op::DATA_END => {
                let checked = check_data(&mut self.file, self.byte);
                self.byte = self.bytes;
                let Err(flaw) = checked else { return Ok(Step::Over) };
                return Ok(Step::Flaw(name_flaw(&self.path, self.bytes, flaw).to_string()));
            }
            op::FOOTER => {
                self.byte = self.bytes;
                return Ok(Step::Over);
            }
            op::CHUNK => found.read_chunk(&raw),
            opcode => found.take(opcode, body(&raw)).map(|()| Vec::new()),
        };
        Ok(match records {
            Ok(records) => {
                self.byte += raw.len() as u64;
                Step::Records(records)
            }
            Err(what) => Step::Flaw(what),
        })
    }
}

impl Found {
    /// Begins the whole file, once it is known what it is about; `flaw` is where the torn one ended before that.
    fn begin(&self, from: &Path, to: &Path, flaw: Option<(u64, &String)>) -> Result<Writer, RecoverError> {
        let path = from.to_owned();
        match (&self.about, flaw) {
            (Some(about), _) => Ok(Writer::live(to, self.part(), about, &self.settings)?),
            (None, Some((byte, what))) => Err(ReadError::Damaged { path, byte, what: what.clone() }.into()),
            (None, None) => Err(ReadError::NotOurs { path }.into()),
        }
    }

    /// What the whole file says about itself.
    fn finish(&self, to: &Path) -> About {
        let mut about = self.about.clone().unwrap_or_default();
        if let Some(run) = &mut about.run {
            if run.ended.is_empty() {
                ENDED.clone_into(&mut run.ended);
                run.lost.clone_from(&self.lost);
            }
            if self.part() == Part::Small && run.depth_file.is_some() {
                run.depth_file = Part::Depth.path(to).file_name().map(|name| name.to_string_lossy().into_owned());
            }
        }
        about
    }

    /// The depth file has one channel.
    fn part(&self) -> Part {
        match self.channels.values().next() {
            Some(first) if self.channels.len() == 1 => Part::of(first.topic),
            _ => Part::Small,
        }
    }

    fn take(&mut self, opcode: u8, body: &[u8]) -> Result<(), String> {
        if !matches!(opcode, op::CHANNEL | op::METADATA) {
            return Ok(());
        }
        if !lengths::fit(opcode, body) {
            return Err(lengths::BEYOND.to_owned());
        }
        match mcap::parse_record(opcode, body).map_err(|error| error.to_string())? {
            records::Record::Channel(channel) => {
                let known = CHANNELS
                    .iter()
                    .find(|known| known.topic.name() == channel.topic && known.encoding == channel.message_encoding);
                self.channels.extend(known.map(|known| (channel.id, known)));
                let viewer = Viewer::ALL.into_iter().find(|viewer| viewer.topic() == channel.topic);
                self.viewers.extend(viewer.map(|viewer| (channel.id, viewer)));
            }
            records::Record::Metadata(mut metadata) => match metadata.name.as_str() {
                BEGUN_NAME | METADATA_NAME => {
                    let version = format_version(&metadata.metadata)?;
                    if !(OLDEST_VERSION..=FORMAT_VERSION).contains(&version) {
                        return Err(format!("it has format {version}, which is not known"));
                    }
                    self.about = Some(Info::from_map(&metadata.metadata)?.about);
                }
                SETTINGS_NAME => self.settings = metadata.metadata.remove(SETTINGS_KEY).unwrap_or_default(),
                _ => {}
            },
            _ => {}
        }
        Ok(())
    }

    /// What the recorder knew of its losses went with it; the gaps tell.
    fn count_gap(&mut self, record: &Record) {
        let header = record.header();
        let last = self.seqs.insert((record.topic(), header.incarnation), header.seq);
        let gap = last.map_or(0, |last| header.seq.saturating_sub(last.saturating_add(1)));
        if gap > 0 {
            *self.lost.entry(record.topic().name().to_owned()).or_default() += gap;
        }
    }

    /// The records of a chunk, all of them or none.
    fn read_chunk(&mut self, raw: &[u8]) -> Result<Vec<Kept>, String> {
        let mut records: Vec<Kept> = Vec::new();
        each_entry::<String>(raw, |entry| match entry {
            Entry::Other(opcode, body) => self.take(opcode, body),
            Entry::Message(header, data) => {
                if let Some(channel) = self.channels.get(&header.channel_id) {
                    let record = (channel.decode)(data);
                    records.push(Kept::Record(record.map_err(|what| format!("{}: {what}", channel.topic))?));
                } else if let Some(viewer) = self.viewers.get(&header.channel_id) {
                    records.push(Kept::Shown(*viewer, header.log_time, data.to_vec()));
                }
                Ok(())
            }
        })?;
        for kept in &records {
            if let Kept::Record(record) = kept {
                self.count_gap(record);
            }
        }
        Ok(records)
    }
}
