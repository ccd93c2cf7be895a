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
use crate::index::{Flaw, MAGIC, body, read_record};
use crate::info::{BEGUN_NAME, METADATA_NAME, OLDEST_VERSION, SETTINGS_KEY, SETTINGS_NAME, format_version};
use crate::writer::{Part, Writer};
use crate::{About, FORMAT_VERSION, Info, ReadError, Record, WriteError, lengths};

/// What a recovered file says of its end.
const ENDED: &str = "recovered";

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
    /// What is wrong there.
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
    /// The last seq of every life of every topic.
    seqs: BTreeMap<(TopicId, u32), u64>,
    /// Gaps between the seqs.
    lost: BTreeMap<String, u64>,
}

/// Makes a whole recording at `to` of the torn one at `from`, as far as it can be read: to its first record that is not
/// whole, or that makes no sense. It takes a whole recording as well. `from` stays as it is.
///
/// # Errors
/// Where `from` cannot be read or is no live recording of ours, and where `to` exists or cannot be written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    let failed = |byte| move |source| ReadError::Io { path: from.to_owned(), byte, source };
    if !from.metadata().map_err(failed(0))?.is_file() {
        return Err(ReadError::NotAFile { path: from.to_owned() }.into());
    }
    let mut file = File::open(from).map_err(failed(0))?;
    let bytes = file.metadata().map_err(failed(0))?.len();
    let mark = MAGIC.len() as u64;
    let magic = crate::index::read_at(&mut file, 0, mark.min(bytes));
    match magic.map_err(|flaw| name_flaw(from, bytes, flaw))? {
        magic if magic.is_empty() => return Err(ReadError::Empty { path: from.to_owned() }.into()),
        magic if magic != MAGIC => return Err(ReadError::NotMcap { path: from.to_owned() }.into()),
        _ => {}
    }
    let mut found = Found::default();
    let mut writer: Option<Writer> = None;
    let mut byte = mark;
    let mut why = None;
    while byte < bytes {
        let raw = match read_record(&mut file, byte, bytes) {
            Ok(raw) => raw,
            Err(Flaw::Io { byte, source }) => return Err(failed(byte)(source).into()),
            Err(flaw) => {
                why = Some(name_flaw(from, bytes, flaw).to_string());
                break;
            }
        };
        let opcode = raw.first().copied().unwrap_or_default();
        // The data is over, and what the summary says is said anew.
        if matches!(opcode, op::DATA_END | op::FOOTER) {
            byte = bytes;
            break;
        }
        if opcode == op::CHUNK {
            let records = match found.read_chunk(&raw) {
                Ok(records) => records,
                Err(what) => {
                    why = Some(what);
                    break;
                }
            };
            if !records.is_empty() && writer.is_none() {
                let about = found.about.clone().ok_or_else(|| ReadError::NotOurs { path: from.to_owned() })?;
                writer = Some(Writer::live(to, found.part(), &about, &found.settings)?);
            }
            if let Some(writer) = &mut writer {
                records.iter().try_for_each(|record| writer.write(record)).and_then(|()| writer.flush())?;
            }
        } else if let Err(what) = found.take(opcode, body(&raw)) {
            why = Some(what);
            break;
        }
        byte += raw.len() as u64;
    }
    let mut about = found.about.clone().ok_or_else(|| match why.clone() {
        Some(what) => ReadError::Damaged { path: from.to_owned(), byte, what },
        None => ReadError::NotOurs { path: from.to_owned() },
    })?;
    let writer = match writer {
        Some(writer) => writer,
        None => Writer::live(to, found.part(), &about, &found.settings)?,
    };
    if let Some(run) = about.run.as_mut().filter(|run| run.ended.is_empty()) {
        ENDED.clone_into(&mut run.ended);
        run.lost.clone_from(&found.lost);
    }
    if let Some(run) = &mut about.run
        && found.part() == Part::Small
        && run.depth_file.is_some()
    {
        run.depth_file = Part::Depth.path(to).file_name().map(|name| name.to_string_lossy().into_owned());
    }
    let info = writer.finish(about)?;
    Ok(Recovered { from: from.to_owned(), to: to.to_owned(), info, bytes, cut_at_byte: byte, why })
}

impl Found {
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
    fn read_chunk(&mut self, raw: &[u8]) -> Result<Vec<Record>, String> {
        let mut records: Vec<Record> = Vec::new();
        each_entry::<String>(raw, |entry| match entry {
            Entry::Other(opcode, body) => self.take(opcode, body),
            Entry::Message(header, data) => {
                if let Some(channel) = self.channels.get(&header.channel_id) {
                    let record = (channel.decode)(data);
                    records.push(record.map_err(|what| format!("{}: {what}", channel.topic))?);
                }
                Ok(())
            }
        })?;
        records.iter().for_each(|record| self.count_gap(record));
        Ok(records)
    }
}
