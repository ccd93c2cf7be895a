//! Writes recordings.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use mcap::records::{MessageHeader, Metadata};
use messages::TopicId;

use crate::channel::{CHANNELS, JSON, JSON_SCHEMA, channel_of, encode};
use crate::info::{BEGUN_NAME, METADATA_NAME, SETTINGS_KEY, SETTINGS_NAME, check_size};
use crate::{About, Info, Record, Viewer};

/// What a reader must hold at once; a larger chunk compresses hardly better.
const CHUNK_BYTES: u64 = 4 << 20;

/// The fastest level, so that recording live costs little.
const ZSTD_LEVEL: u32 = 1;

/// Later lives of a recorder that are looked for; a restart budget allows far fewer at a time.
const LIVES_MAX: u32 = 99;

/// What to do where the file to write is already there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Existing {
    /// Refuse, and leave it as it is.
    #[default]
    Refuse,
    /// Replace it, once the new one is whole.
    Replace,
}

/// Why a recording could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file is there, and was not to be replaced.
    #[error("{} already exists", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The path names no file: it ends in `..` or is a root.
    #[error("{} is no file name", path.display())]
    NoName {
        /// The path.
        path: PathBuf,
    },
    /// The operating system failed: no room, no right, no such folder.
    #[error("failed to {action} {}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The MCAP library failed, mostly because writing did.
    #[error("failed to write {}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: mcap::McapError,
    },
    /// What whoever records has to say is too long to be read back.
    #[error("{} cannot be finished: {what}", path.display())]
    About {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// What stands there is a folder, a device or a link, and is not replaced.
    #[error("{} is no regular file, and is left as it is", path.display())]
    NotAFile {
        /// What stands there.
        path: PathBuf,
    },
    /// The record cannot be recorded; the recording goes on without it.
    #[error("record {seq} of {topic} at {stamp_ns} ns cannot be written to {}: {what}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// The record's topic.
        topic: TopicId,
        /// The record's seq.
        seq: u64,
        /// The record's stamp, nanoseconds.
        stamp_ns: u64,
        /// What is wrong with it.
        what: String,
    },
}

/// The topics of an import.
const IMPORTED: [TopicId; 2] = [TopicId::LidarScan, TopicId::Odometry];

/// The file that a live recording is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The small topics, which are read without reading megabytes of pixels.
    Small,
    /// The depth frames.
    Depth,
}

impl Part {
    /// The topics of the file, in the order of the topic table.
    pub fn topics(self) -> impl Iterator<Item = TopicId> {
        CHANNELS.iter().map(|channel| channel.topic).filter(move |topic| Self::of(*topic) == self)
    }

    /// The file of this part, for the recording `NAME.mcap`.
    #[must_use]
    pub fn path(self, recording: &Path) -> PathBuf {
        match self {
            Self::Small => recording.to_owned(),
            Self::Depth => recording.with_extension("depth.mcap"),
        }
    }
}

macro_rules! part_of {
    ($($kind:ident $id:ident $type:ident in $part:ident as $form:ident;)+) => {
        impl Part {
            /// Which file a topic is in.
            #[must_use]
            pub const fn of(topic: TopicId) -> Self {
                match topic {
                    $(TopicId::$id => Self::$part,)+
                    // Not recorded.
                    _ => Self::Small,
                }
            }
        }
    };
}

messages::for_each_recorded_topic!(part_of);

/// The recording of a recorder's `life`, counted from 1, where `NAME.mcap` was ordered: `NAME.2.mcap` and so on for one
/// that was restarted. Nothing is ever overwritten.
#[must_use]
pub fn life_path(ordered: &Path, life: u32) -> PathBuf {
    if life <= 1 { ordered.to_owned() } else { ordered.with_extension(format!("{life}.mcap")) }
}

/// The recordings of a recorder's later lives that are there.
pub fn later_lives(ordered: &Path) -> impl Iterator<Item = PathBuf> {
    (2..=LIVES_MAX).map(|life| life_path(ordered, life)).filter(|path| path.symlink_metadata().is_ok())
}

/// What a recording is written to.
pub trait Sink: Write + Seek + Send {}

impl<T: Write + Seek + Send> Sink for T {}

/// Writes one file of a recording.
///
/// An import is written under a temporary name beside the wanted one until it is finished: dropped unfinished, it
/// removes what it wrote; killed, it leaves a `.NAME.PID-N.partial` and never a `NAME`. A live recording has its own
/// name from the beginning, and is a whole one at every [`Writer::flush`] but for its end, which
/// [`recover`](crate::recover) makes up for.
pub struct Writer {
    path: PathBuf,
    /// Of an import: the temporary name.
    partial: Option<(Partial, Existing)>,
    /// For the last word to the disk.
    file: Option<File>,
    mcap: mcap::Writer<Box<dyn Sink>>,
    channels: BTreeMap<TopicId, u16>,
    /// Channels that nobody reads back.
    viewers: BTreeMap<Viewer, u16>,
    records: BTreeMap<TopicId, u64>,
    span_ns: Option<(u64, u64)>,
    bytes: Vec<u8>,
}

impl Writer {
    /// Begins an import at `path`.
    ///
    /// # Errors
    /// Where `path` exists and is not to be replaced, and where nothing can be written beside it.
    pub fn create(path: &Path, existing: Existing) -> Result<Self, WriteError> {
        if existing == Existing::Refuse && path.symlink_metadata().is_ok() {
            return Err(WriteError::Exists { path: path.to_owned() });
        }
        if path.symlink_metadata().is_ok_and(|there| !there.is_file()) {
            return Err(WriteError::NotAFile { path: path.to_owned() });
        }
        let partial = Partial::beside(path)?;
        let create = || OpenOptions::new().write(true).create_new(true).open(&partial.0);
        let file = create().or_else(|error| match error.kind() {
            // Only a dead process of our own number can have left it.
            io::ErrorKind::AlreadyExists => fs::remove_file(&partial.0).and_then(|()| create()),
            _ => Err(error),
        });
        let failed = |source| WriteError::Io { action: "create", path: partial.0.clone(), source };
        let file = file.map_err(failed)?;
        let same = file.try_clone().map_err(failed)?;
        let writer = Self::into_sink(path, Box::new(BufWriter::new(file)), IMPORTED.into_iter())?;
        Ok(Self { partial: Some((partial, existing)), file: Some(same), ..writer })
    }

    /// Begins one file of a live recording at `path`, with what is known about the run by now, and its settings.
    ///
    /// # Errors
    /// Where `path` exists: nothing is ever overwritten; and where it cannot be written.
    pub fn live(path: &Path, part: Part, about: &About, settings: &str) -> Result<Self, WriteError> {
        let file =
            OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| match source.kind() {
                io::ErrorKind::AlreadyExists => WriteError::Exists { path: path.to_owned() },
                _ => WriteError::Io { action: "create", path: path.to_owned(), source },
            })?;
        let failed = |source| WriteError::Io { action: "create", path: path.to_owned(), source };
        let same = file.try_clone().map_err(failed)?;
        let writer = Self::live_into(path, Box::new(file), part, about, settings);
        let writer = writer.inspect_err(|_| {
            // A file with nothing in it is no recording; why it could not be begun is what counts.
            let _ = fs::remove_file(path);
        })?;
        Ok(Self { file: Some(same), ..writer })
    }

    /// As [`Writer::live`], into any sink; `path` is only told in errors.
    ///
    /// # Errors
    /// Where the sink cannot be written.
    pub fn live_into(
        path: &Path,
        sink: Box<dyn Sink>,
        part: Part,
        about: &About,
        settings: &str,
    ) -> Result<Self, WriteError> {
        let mut writer = Self::into_sink(path, Box::new(UntilFailure { sink, failed: false }), part.topics())?;
        if part == Part::Small {
            writer.add_viewers()?;
        }
        let begun = Info { about: about.clone(), ..Info::default() };
        writer.write_metadata(BEGUN_NAME, begun.to_map())?;
        writer.write_metadata(SETTINGS_NAME, BTreeMap::from([(SETTINGS_KEY.to_owned(), settings.to_owned())]))?;
        writer.flush()?;
        Ok(writer)
    }

    fn into_sink(path: &Path, sink: Box<dyn Sink>, topics: impl Iterator<Item = TopicId>) -> Result<Self, WriteError> {
        let failed = |source| WriteError::Mcap { path: path.to_owned(), source };
        let options = mcap::WriteOptions::new().library(concat!("guidedog ", env!("CARGO_PKG_VERSION")));
        let options = options.chunk_size(Some(CHUNK_BYTES)).compression_level(ZSTD_LEVEL).compression_threads(0);
        // A chunk is written whole: what the file holds is never waiting for its length to be filled in.
        let mut mcap = options.disable_seeking(true).create(sink).map_err(failed)?;
        let mut channels = BTreeMap::new();
        for channel in topics.filter_map(channel_of) {
            let schema = mcap.add_schema(channel.schema_name, channel.schema_encoding, &(channel.schema)());
            let id = schema
                .and_then(|schema| mcap.add_channel(schema, channel.topic.name(), channel.encoding, &BTreeMap::new()));
            channels.insert(channel.topic, id.map_err(failed)?);
        }
        let records = BTreeMap::new();
        let (partial, file, span_ns, bytes) = (None, None, None, Vec::new());
        let viewers = BTreeMap::new();
        Ok(Self { path: path.to_owned(), partial, file, mcap, channels, viewers, records, span_ns, bytes })
    }

    fn add_viewers(&mut self) -> Result<(), WriteError> {
        for viewer in Viewer::ALL {
            let (name, schema) = viewer.schema();
            let schema = self.mcap.add_schema(name, JSON_SCHEMA, schema.as_bytes());
            let id = schema.and_then(|schema| self.mcap.add_channel(schema, viewer.topic(), JSON, &BTreeMap::new()));
            let id = id.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })?;
            self.viewers.insert(viewer, id);
        }
        Ok(())
    }

    /// Adds something for people to see, at that run time; only where the small topics of a live run are.
    ///
    /// # Errors
    /// Where it cannot be written; the recording is then lost.
    pub fn show(&mut self, viewer: Viewer, time_ns: u64, json: &[u8]) -> Result<(), WriteError> {
        let Some(&channel_id) = self.viewers.get(&viewer) else { return Ok(()) };
        let header = MessageHeader { channel_id, sequence: 0, log_time: time_ns, publish_time: time_ns };
        let written = self.mcap.write_to_known_channel(&header, json);
        written.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })
    }

    fn write_metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), WriteError> {
        let written = self.mcap.write_metadata(&Metadata { name: name.to_owned(), metadata });
        written.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })
    }

    /// The file that is, or will be, the recording.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a record. Records may come in any order: a reader puts them in theirs, in less memory the nearer to it they
    /// were written.
    ///
    /// # Errors
    /// [`WriteError::Record`] leaves the recording as it was; after any other it is lost.
    pub fn write(&mut self, record: &Record) -> Result<(), WriteError> {
        let (time_ns, topic, seq) = record.order();
        let stamp_ns = record.stamp_ns();
        let refused = |what| WriteError::Record { path: self.path.clone(), topic, seq, stamp_ns, what };
        let Some(&channel_id) = self.channels.get(&topic) else {
            return Err(refused("the topic has no channel".to_owned()));
        };
        encode(record, &mut self.bytes).map_err(refused)?;
        // MCAP's sequence has 32 bits; the whole seq is in the message.
        let header = MessageHeader { channel_id, sequence: seq as u32, log_time: time_ns, publish_time: time_ns };
        let written = self.mcap.write_to_known_channel(&header, &self.bytes);
        written.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })?;
        *self.records.entry(topic).or_default() += 1;
        let (first_ns, last_ns) = self.span_ns.unwrap_or((time_ns, time_ns));
        self.span_ns = Some((first_ns.min(time_ns), last_ns.max(time_ns)));
        Ok(())
    }

    /// Ends the running chunk and hands it to the operating system.
    ///
    /// # Errors
    /// Where that fails; the recording is then lost.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.mcap.flush().map_err(|source| WriteError::Mcap { path: self.path.clone(), source })
    }

    /// Ends the recording: writes what it says about itself, and waits until the disk has it. An import gets its name.
    ///
    /// # Errors
    /// Where that fails, or a file has come to be there meanwhile; an import is then lost.
    pub fn finish(mut self, about: About) -> Result<Info, WriteError> {
        let (first_ns, last_ns) = self.span_ns.unwrap_or_default();
        let count = |topic: &TopicId| (topic.name().to_owned(), self.records.get(topic).copied().unwrap_or(0));
        let records = self.channels.keys().map(count).collect();
        let info = Info { about, records, start_ns: first_ns, duration_ns: last_ns - first_ns };
        let map = info.to_map();
        check_size(&map).map_err(|what| WriteError::About { path: self.path.clone(), what })?;
        self.write_metadata(METADATA_NAME, map)?;
        let Self { path, partial, file, mut mcap, .. } = self;
        let ended = mcap.finish().map(drop).and_then(|()| mcap.into_inner().flush().map_err(mcap::McapError::Io));
        ended.map_err(|source| WriteError::Mcap { path: path.clone(), source })?;
        file.map_or(Ok(()), |file| file.sync_all()).map_err(|source| WriteError::Io {
            action: "write",
            path: path.clone(),
            source,
        })?;
        if let Some((partial, existing)) = partial {
            partial.become_file(&path, existing)?;
        }
        Ok(info)
    }
}

/// Writes nothing more once it failed: what came after a piece that is missing would be no recording.
struct UntilFailure {
    sink: Box<dyn Sink>,
    failed: bool,
}

impl UntilFailure {
    fn attempt<T>(&mut self, what: impl FnOnce(&mut dyn Sink) -> io::Result<T>) -> io::Result<T> {
        if self.failed {
            return Err(io::Error::other("the file could not be written before"));
        }
        let done = what(self.sink.as_mut());
        self.failed = done.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::Interrupted);
        done
    }
}

impl Write for UntilFailure {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|sink| sink.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(|sink| sink.flush())
    }
}

impl Seek for UntilFailure {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.attempt(|sink| sink.seek(to))
    }
}

/// The temporary name; whatever still has it when this is dropped is removed.
#[derive(Debug)]
struct Partial(PathBuf);

impl Partial {
    fn beside(path: &Path) -> Result<Self, WriteError> {
        /// Two writers of one process must not share a name either.
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let Some(name) = path.file_name() else {
            return Err(WriteError::NoName { path: path.to_owned() });
        };
        let mut partial = OsString::from(".");
        partial.push(name);
        partial.push(format!(".{}-{}.partial", std::process::id(), COUNT.fetch_add(1, Relaxed)));
        Ok(Self(path.with_file_name(partial)))
    }

    fn become_file(&self, path: &Path, existing: Existing) -> Result<(), WriteError> {
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::AlreadyExists => WriteError::Exists { path: path.to_owned() },
            _ => WriteError::Io { action: "name", path: path.to_owned(), source },
        };
        if existing == Existing::Refuse {
            // Unlike a rename, a link never replaces. Where there are no links, a look first is the next best.
            match fs::hard_link(&self.0, path) {
                Ok(()) => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(failed(error)),
                Err(_) if path.symlink_metadata().is_ok() => return Err(failed(io::ErrorKind::AlreadyExists.into())),
                Err(_) => {}
            }
        }
        fs::rename(&self.0, path).map_err(failed)
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        // After a rename there is nothing to remove; otherwise nobody is left to be told.
        let _ = fs::remove_file(&self.0);
    }
}
