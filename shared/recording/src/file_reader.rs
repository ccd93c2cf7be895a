//! Reads one MCAP file of ours, in the records' order, a chunk at a time.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::fs::File;
use std::path::{Path, PathBuf};

use mcap::records::{ChunkIndex, op};
use messages::TopicId;

use crate::channel::{CHANNELS, Channel};
use crate::chunk::{Entry, each_entry};
use crate::index::{Flaw, Index, body, check_data, read_index, read_record};
use crate::info::{METADATA_NAME, OLDEST_VERSION, SETTINGS_KEY, SETTINGS_NAME, format_version};
use crate::record::Order;
use crate::{FORMAT_VERSION, Info, ReadError, Record, lengths};

/// Chunks that overlap in time wait together; so much of them, and no more.
const WAITING_BYTES_MAX: usize = 512 << 20;

/// Reads the records of one file in the order of [`Record::order`].
#[derive(Debug)]
pub struct FileReader {
    path: PathBuf,
    file: File,
    bytes: u64,
    info: Info,
    settings_at: Option<u64>,
    data_end: u64,
    channels: BTreeMap<u16, &'static Channel>,
    chunks: VecDeque<ChunkIndex>,
    waiting: BinaryHeap<Reverse<Waiting>>,
    waiting_bytes: usize,
    found: BTreeMap<TopicId, u64>,
    /// Whether chunks were passed over, so that the records cannot be counted.
    skipped: bool,
}

impl FileReader {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// For a file that cannot be read, is not MCAP, not ours or not whole.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |source| ReadError::Io { path: path.to_owned(), byte: 0, source };
        // Before it is opened: opening a pipe would wait for its writer.
        let metadata = path.metadata().map_err(failed)?;
        if !metadata.is_file() {
            return Err(ReadError::NotAFile { path: path.to_owned() });
        }
        let mut file = File::open(path).map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        if bytes == 0 {
            return Err(ReadError::Empty { path: path.to_owned() });
        }
        let flawed = |flaw| name_flaw(path, bytes, flaw);
        let index = read_index(&mut file, bytes).map_err(flawed)?;
        let info = read_info(path, &mut file, bytes, &index)?;
        let channels = index.channels.iter().filter_map(|(&id, (topic, encoding))| {
            let known = CHANNELS.iter().find(|channel| channel.topic.name() == topic && encoding == channel.encoding);
            known.map(|channel| (id, channel))
        });
        Ok(Self {
            path: path.to_owned(),
            channels: channels.collect(),
            file,
            bytes,
            info,
            data_end: index.data_end,
            settings_at: index.metadata.iter().find(|place| place.name == SETTINGS_NAME).map(|place| place.offset),
            chunks: index.chunks.into(),
            waiting: BinaryHeap::new(),
            waiting_bytes: 0,
            found: BTreeMap::new(),
            skipped: false,
        })
    }

    /// What the recording says about itself.
    #[must_use]
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The settings of the run, where the file has them.
    pub fn settings(&mut self) -> Result<Option<String>, ReadError> {
        let Some(byte) = self.settings_at else { return Ok(None) };
        let mut map = read_metadata(&self.path, &mut self.file, self.bytes, byte)?;
        map.remove(SETTINGS_KEY).map(Some).ok_or_else(|| ReadError::Damaged {
            path: self.path.clone(),
            byte,
            what: format!("metadata entry `{SETTINGS_KEY}` is missing"),
        })
    }

    /// Compares the file's bytes with its checksum; what lies in chunks has checksums of its own.
    pub fn check_bytes(&mut self) -> Result<(), ReadError> {
        check_data(&mut self.file, self.data_end).map_err(|flaw| name_flaw(&self.path, self.bytes, flaw))
    }

    /// Passes over the chunks that end before `time_ns`.
    pub fn skip_before(&mut self, time_ns: u64) {
        let all = self.chunks.len();
        self.chunks.retain(|chunk| chunk.message_end_time >= time_ns);
        self.skipped |= self.chunks.len() < all;
    }

    /// The next record with its order; `None` at the end.
    pub fn advance(&mut self) -> Result<Option<(Order, Record)>, ReadError> {
        loop {
            // A chunk that begins at the stamp itself may hold a record that goes before.
            let due = match (self.waiting.peek(), self.chunks.front()) {
                (Some(Reverse(first)), Some(chunk)) => first.order.0 < chunk.message_start_time,
                (first, chunk) => first.is_some() || chunk.is_none(),
            };
            if !due && let Some(chunk) = self.chunks.pop_front() {
                self.load(&chunk)?;
                continue;
            }
            return match self.waiting.pop() {
                Some(Reverse(first)) => {
                    self.waiting_bytes -= first.bytes;
                    *self.found.entry(first.record.topic()).or_default() += 1;
                    Ok(Some((first.order, first.record)))
                }
                None => self.check_counts().map(|()| None),
            };
        }
    }

    fn load(&mut self, chunk: &ChunkIndex) -> Result<(), ReadError> {
        let byte = chunk.chunk_start_offset;
        let raw = read_record(&mut self.file, byte, self.bytes);
        let raw = raw.map_err(|flaw| name_flaw(&self.path, self.bytes, flaw))?;
        let damaged = |what: String| ReadError::Damaged { path: self.path.clone(), byte, what };
        if raw.first() != Some(&op::CHUNK) {
            return Err(damaged("the index says chunk, and there is none".to_owned()));
        }
        let (channels, waiting, waiting_bytes) = (&self.channels, &mut self.waiting, &mut self.waiting_bytes);
        let (start_ns, end_ns) = (self.info.start_ns, self.info.start_ns + self.info.duration_ns);
        let taken = each_entry::<Wrong>(&raw, |entry| {
            let Entry::Message(header, data) = entry else { return Ok(()) };
            let Some(channel) = channels.get(&header.channel_id) else { return Ok(()) };
            let record = decode(channel, header.log_time, data).and_then(|record| in_span(record, start_ns, end_ns));
            let record = record.map_err(|what| Wrong::Record(channel.topic, header.log_time, what))?;
            *waiting_bytes += data.len();
            waiting.push(Reverse(Waiting { order: record.order(), bytes: data.len(), record }));
            Ok(())
        });
        taken.map_err(|wrong| match wrong {
            Wrong::Chunk(what) => damaged(what),
            Wrong::Record(topic, log_time_ns, what) => {
                ReadError::Record { path: self.path.clone(), topic, log_time_ns, byte, what }
            }
        })?;
        if self.waiting_bytes > WAITING_BYTES_MAX {
            return Err(damaged(format!("chunks of over {WAITING_BYTES_MAX} bytes overlap in time")));
        }
        Ok(())
    }

    fn check_counts(&self) -> Result<(), ReadError> {
        for (topic, &expected) in self.info.records.iter().filter(|_| !self.skipped) {
            let Some(channel) = CHANNELS.iter().find(|channel| channel.topic.name() == topic) else { continue };
            let found = self.found.get(&channel.topic).copied().unwrap_or(0);
            if found != expected {
                return Err(ReadError::Count { path: self.path.clone(), topic: topic.clone(), expected, found });
            }
        }
        Ok(())
    }
}

/// What is wrong with a chunk: itself, or a record in it.
enum Wrong {
    Chunk(String),
    Record(TopicId, u64, String),
}

impl From<String> for Wrong {
    fn from(what: String) -> Self {
        Self::Chunk(what)
    }
}

fn decode(channel: &Channel, log_time_ns: u64, bytes: &[u8]) -> Result<Record, String> {
    let record = (channel.decode)(bytes)?;
    if record.time_ns() != log_time_ns {
        return Err(format!("its own time is {} ns", record.time_ns()));
    }
    Ok(record)
}

/// Who plays a recording back reckons with the time that it says it lasts.
fn in_span(record: Record, start_ns: u64, end_ns: u64) -> Result<Record, String> {
    if (start_ns..=end_ns).contains(&record.time_ns()) {
        Ok(record)
    } else {
        Err(format!("its time is not within the recording's own {start_ns} to {end_ns} ns"))
    }
}

fn read_info(path: &Path, file: &mut File, bytes: u64, index: &Index) -> Result<Info, ReadError> {
    let Some(place) = index.metadata.iter().find(|place| place.name == METADATA_NAME) else {
        return Err(ReadError::NotOurs { path: path.to_owned() });
    };
    let map = read_metadata(path, file, bytes, place.offset)?;
    let damaged = |what: String| ReadError::Damaged { path: path.to_owned(), byte: place.offset, what };
    match format_version(&map).map_err(damaged)? {
        OLDEST_VERSION..=FORMAT_VERSION => Info::from_map(&map).map_err(damaged),
        found => Err(ReadError::Version { path: path.to_owned(), found }),
    }
}

fn read_metadata(path: &Path, file: &mut File, bytes: u64, byte: u64) -> Result<BTreeMap<String, String>, ReadError> {
    let damaged = |what: String| ReadError::Damaged { path: path.to_owned(), byte, what };
    let raw = read_record(file, byte, bytes).map_err(|flaw| name_flaw(path, bytes, flaw))?;
    if raw.first() != Some(&op::METADATA) {
        return Err(damaged("the index says metadata, and there is none".to_owned()));
    }
    if !lengths::fit(op::METADATA, body(&raw)) {
        return Err(damaged(lengths::BEYOND.to_owned()));
    }
    let parsed = mcap::parse_record(op::METADATA, body(&raw)).map_err(|error| damaged(error.to_string()))?;
    match parsed {
        mcap::records::Record::Metadata(metadata) => Ok(metadata.metadata),
        _ => Err(damaged("no metadata".to_owned())),
    }
}

pub fn name_flaw(path: &Path, bytes: u64, flaw: Flaw) -> ReadError {
    let path = path.to_owned();
    match flaw {
        Flaw::Io { byte, source } => ReadError::Io { path, byte, source },
        Flaw::NoMagic => ReadError::NotMcap { path },
        Flaw::Torn => ReadError::Torn { path, bytes },
        Flaw::Damaged { byte, what } => ReadError::Damaged { path, byte, what },
    }
}

/// A record whose turn has not come.
#[derive(Debug)]
struct Waiting {
    order: Order,
    bytes: usize,
    record: Record,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        // Two lives of one service may give the same seq.
        let life = |waiting: &Self| (waiting.order, waiting.record.header().incarnation);
        life(self).cmp(&life(other))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}
