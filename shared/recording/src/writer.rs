//! Writes recordings.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use mcap::records::{MessageHeader, Metadata};
use messages::TopicId;

use crate::channel::{CHANNELS, MESSAGE_ENCODING, SCHEMA_ENCODING, encode};
use crate::info::{METADATA_NAME, check_size};
use crate::{About, Info, Record};

/// What a reader must hold at once; a larger chunk compresses hardly better.
const CHUNK_BYTES: u64 = 4 << 20;

/// The fastest level, so that recording live costs little.
const ZSTD_LEVEL: u32 = 1;

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

/// Writes one recording, under a temporary name beside the wanted one until it is finished. Dropped unfinished, it
/// removes what it wrote; killed, it leaves a `.NAME.PID-N.partial` and never a `NAME`.
pub struct Writer {
    path: PathBuf,
    partial: Partial,
    existing: Existing,
    mcap: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<TopicId, u16>,
    records: BTreeMap<TopicId, u64>,
    span_ns: Option<(u64, u64)>,
    json: Vec<u8>,
}

impl Writer {
    /// Begins a recording at `path`.
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
        let file = file.map_err(|source| WriteError::Io { action: "create", path: partial.0.clone(), source })?;
        let failed = |source| WriteError::Mcap { path: path.to_owned(), source };
        let options = mcap::WriteOptions::new().library(concat!("guidedog ", env!("CARGO_PKG_VERSION")));
        let options = options.chunk_size(Some(CHUNK_BYTES)).compression_level(ZSTD_LEVEL).compression_threads(0);
        let mut mcap = options.create(BufWriter::new(file)).map_err(failed)?;
        let mut channels = BTreeMap::new();
        for channel in &CHANNELS {
            let schema = mcap.add_schema(channel.schema_name, SCHEMA_ENCODING, channel.schema.as_bytes());
            let id = schema
                .and_then(|schema| mcap.add_channel(schema, channel.topic.name(), MESSAGE_ENCODING, &BTreeMap::new()));
            channels.insert(channel.topic, id.map_err(failed)?);
        }
        let records = BTreeMap::new();
        Ok(Self { path: path.to_owned(), partial, existing, mcap, channels, records, span_ns: None, json: Vec::new() })
    }

    /// Adds a record. Records may come in any order: a reader puts them in theirs, in less memory the nearer to it they
    /// were written.
    ///
    /// # Errors
    /// [`WriteError::Record`] leaves the recording as it was; after any other it is lost.
    pub fn write(&mut self, record: &Record) -> Result<(), WriteError> {
        let (stamp_ns, topic, seq) = record.order();
        let refused = |what| WriteError::Record { path: self.path.clone(), topic, seq, stamp_ns, what };
        let Some(&channel_id) = self.channels.get(&topic) else {
            return Err(refused("the topic has no channel".to_owned()));
        };
        encode(record, &mut self.json).map_err(refused)?;
        // MCAP's sequence has 32 bits; the whole seq is in the message.
        let header = MessageHeader { channel_id, sequence: seq as u32, log_time: stamp_ns, publish_time: stamp_ns };
        let written = self.mcap.write_to_known_channel(&header, &self.json);
        written.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })?;
        *self.records.entry(topic).or_default() += 1;
        let (first_ns, last_ns) = self.span_ns.unwrap_or((stamp_ns, stamp_ns));
        self.span_ns = Some((first_ns.min(stamp_ns), last_ns.max(stamp_ns)));
        Ok(())
    }

    /// Ends the running chunk and hands it to the operating system.
    ///
    /// # Errors
    /// Where that fails; the recording is then lost.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.mcap.flush().map_err(|source| WriteError::Mcap { path: self.path.clone(), source })
    }

    /// Ends the recording: writes what it says about itself, waits until the disk has it, and gives it its name.
    ///
    /// # Errors
    /// Where that fails, or a file has come to be there meanwhile; the recording is then lost.
    pub fn finish(mut self, about: About) -> Result<Info, WriteError> {
        let (first_ns, last_ns) = self.span_ns.unwrap_or_default();
        let info = Info {
            about,
            records: CHANNELS
                .iter()
                .map(|c| (c.topic.name().to_owned(), self.records.get(&c.topic).copied().unwrap_or(0)))
                .collect(),
            start_ns: first_ns,
            duration_ns: last_ns - first_ns,
        };
        let map = info.to_map();
        check_size(&map).map_err(|what| WriteError::About { path: self.path.clone(), what })?;
        let metadata = Metadata { name: METADATA_NAME.to_owned(), metadata: map };
        let ended = self.mcap.write_metadata(&metadata).and_then(|()| self.mcap.finish().map(drop));
        ended.map_err(|source| WriteError::Mcap { path: self.path.clone(), source })?;
        let Self { path, partial, existing, mcap, .. } = self;
        let file = mcap.into_inner().into_inner().map_err(io::IntoInnerError::into_error);
        file.and_then(|file| file.sync_all()).map_err(|source| WriteError::Io {
            action: "write",
            path: path.clone(),
            source,
        })?;
        partial.become_file(&path, existing)?;
        Ok(info)
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
