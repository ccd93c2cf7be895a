//! Reads recordings, in the records' order, a chunk at a time.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use mcap::records::{ChunkIndex, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use messages::TopicId;

use crate::channel::{CHANNELS, Channel, MESSAGE_ENCODING};
use crate::index::{Flaw, Index, RECORD_BYTES_MAX, body, read_index, read_record};
use crate::info::{METADATA_NAME, format_version};
use crate::{FORMAT_VERSION, Info, Record, lengths};

/// Chunks that overlap in time wait together; so much of them, and no more.
const WAITING_BYTES_MAX: usize = 512 << 20;

/// Why a recording could not be read. Every variant names the file.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system failed.
    #[error("failed to read {} at byte {byte}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Where in it.
        byte: u64,
        /// Why.
        source: io::Error,
    },
    /// It is a folder, a pipe or a device.
    #[error("{} is not a file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// It has no bytes.
    #[error("{} is empty", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// It is a file of another kind.
    #[error("{} is not a recording: it does not begin with MCAP's magic bytes (byte 0)", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// It was cut, or its recording was not finished.
    #[error("{} is torn: it ends at byte {bytes} without MCAP's footer", path.display())]
    Torn {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// It is somebody else's MCAP file.
    #[error("{} is MCAP and no recording of guidedog: it has no metadata named `{METADATA_NAME}`", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// It was written by another version.
    #[error("{} has format {found}, and {FORMAT_VERSION} is the one known", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// It was changed after it was written.
    #[error("{} is damaged at byte {byte}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where in it.
        byte: u64,
        /// What is wrong.
        what: String,
    },
    /// A record makes no sense.
    #[error("{} has a bad record of {topic} at {log_time_ns} ns (chunk at byte {byte}): {what}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// The record's topic.
        topic: TopicId,
        /// The record's log time, nanoseconds.
        log_time_ns: u64,
        /// Where its chunk begins.
        byte: u64,
        /// What is wrong.
        what: String,
    },
    /// Records are missing, or there are too many.
    #[error("{} should hold {expected} records of {topic}, and holds {found}", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// The records' topic.
        topic: String,
        /// As the recording says.
        expected: u64,
        /// As it is.
        found: u64,
    },
}

/// Reads one recording: an iterator over its records in the order of [`Record::order`]. After an error it ends.
///
/// It holds one chunk's records at a time, and as many chunks' as overlap in time. Channels that it does not know are
/// passed over.
#[derive(Debug)]
pub struct Reader {
    path: PathBuf,
    file: File,
    bytes: u64,
    info: Info,
    channels: BTreeMap<u16, &'static Channel>,
    chunks: VecDeque<ChunkIndex>,
    waiting: BinaryHeap<Reverse<Waiting>>,
    waiting_bytes: usize,
    found: BTreeMap<TopicId, u64>,
    ended: bool,
}

impl Reader {
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
            let known = CHANNELS.iter().find(|channel| channel.topic.name() == topic && encoding == MESSAGE_ENCODING);
            known.map(|channel| (id, channel))
        });
        Ok(Self {
            path: path.to_owned(),
            channels: channels.collect(),
            file,
            bytes,
            info,
            chunks: index.chunks.into(),
            waiting: BinaryHeap::new(),
            waiting_bytes: 0,
            found: BTreeMap::new(),
            ended: false,
        })
    }

    /// What the recording says about itself.
    #[must_use]
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The next record; `None` at the end.
    fn advance(&mut self) -> Result<Option<Record>, ReadError> {
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
                    Ok(Some(first.record))
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
        if !lengths::fit(op::CHUNK, body(&raw)) {
            return Err(damaged(lengths::BEYOND.to_owned()));
        }
        let mut records = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_skip_start_magic(true)
                .with_skip_end_magic(true)
                .with_prevalidate_chunk_crcs(true)
                .with_record_length_limit(RECORD_BYTES_MAX as usize),
        );
        let mut rest = &raw[..];
        while let Some(event) = records.next_event() {
            match event.map_err(|error| damaged(error.to_string()))? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let (piece, after) = rest.split_at(wanted.min(rest.len()));
                    records.insert(piece.len()).copy_from_slice(piece);
                    records.notify_read(piece.len());
                    rest = after;
                }
                LinearReadEvent::Record { opcode: op::MESSAGE, data } => {
                    let parsed = mcap::parse_record(op::MESSAGE, data).map_err(|error| damaged(error.to_string()))?;
                    let mcap::records::Record::Message { header, data } = parsed else { continue };
                    let Some(channel) = self.channels.get(&header.channel_id) else { continue };
                    let record = decode(channel, header.log_time, &data).and_then(|record| self.in_span(record));
                    let record = record.map_err(|what| ReadError::Record {
                        path: self.path.clone(),
                        topic: channel.topic,
                        log_time_ns: header.log_time,
                        byte,
                        what,
                    })?;
                    let waiting = Waiting { order: record.order(), bytes: data.len(), record };
                    self.waiting_bytes += waiting.bytes;
                    self.waiting.push(Reverse(waiting));
                }
                LinearReadEvent::Record { .. } => {}
            }
        }
        if self.waiting_bytes > WAITING_BYTES_MAX {
            return Err(damaged(format!("chunks of over {WAITING_BYTES_MAX} bytes overlap in time")));
        }
        Ok(())
    }

    /// Who plays a recording back reckons with the time that it says it lasts.
    fn in_span(&self, record: Record) -> Result<Record, String> {
        let (start_ns, end_ns) = (self.info.start_ns, self.info.start_ns + self.info.duration_ns);
        if (start_ns..=end_ns).contains(&record.stamp_ns()) {
            Ok(record)
        } else {
            Err(format!("its stamp is not within the recording's own {start_ns} to {end_ns} ns"))
        }
    }

    fn check_counts(&self) -> Result<(), ReadError> {
        for (topic, &expected) in &self.info.records {
            let Some(channel) = CHANNELS.iter().find(|channel| channel.topic.name() == topic) else { continue };
            let found = self.found.get(&channel.topic).copied().unwrap_or(0);
            if found != expected {
                return Err(ReadError::Count { path: self.path.clone(), topic: topic.clone(), expected, found });
            }
        }
        Ok(())
    }
}

impl Iterator for Reader {
    type Item = Result<Record, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let next = self.advance().transpose();
        self.ended = !matches!(next, Some(Ok(_)));
        next
    }
}

fn decode(channel: &Channel, log_time_ns: u64, json: &[u8]) -> Result<Record, String> {
    let record = (channel.decode)(json)?;
    if record.stamp_ns() != log_time_ns {
        return Err(format!("its stamp is {} ns", record.stamp_ns()));
    }
    Ok(record)
}

fn read_info(path: &Path, file: &mut File, bytes: u64, index: &Index) -> Result<Info, ReadError> {
    let Some(place) = index.metadata.iter().find(|place| place.name == METADATA_NAME) else {
        return Err(ReadError::NotOurs { path: path.to_owned() });
    };
    let damaged = |what: String| ReadError::Damaged { path: path.to_owned(), byte: place.offset, what };
    let raw = read_record(file, place.offset, bytes).map_err(|flaw| name_flaw(path, bytes, flaw))?;
    if raw.first() != Some(&op::METADATA) {
        return Err(damaged("the index says metadata, and there is none".to_owned()));
    }
    if !lengths::fit(op::METADATA, body(&raw)) {
        return Err(damaged(lengths::BEYOND.to_owned()));
    }
    let parsed = mcap::parse_record(op::METADATA, body(&raw)).map_err(|error| damaged(error.to_string()))?;
    let mcap::records::Record::Metadata(metadata) = parsed else {
        return Err(damaged("no metadata".to_owned()));
    };
    match format_version(&metadata.metadata).map_err(damaged)? {
        FORMAT_VERSION => Info::from_map(&metadata.metadata).map_err(damaged),
        found => Err(ReadError::Version { path: path.to_owned(), found }),
    }
}

fn name_flaw(path: &Path, bytes: u64, flaw: Flaw) -> ReadError {
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
    order: (u64, TopicId, u64),
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
