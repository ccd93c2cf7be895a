//! Reads recordings, in the records' order: the file of the small topics, and that of the depth frames beside it.

use std::io;
use std::path::{Path, PathBuf};

use messages::TopicId;

use crate::file_reader::FileReader;
use crate::info::{METADATA_NAME, OLDEST_VERSION};
use crate::record::Order;
use crate::{FORMAT_VERSION, Info, Record};

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
    #[error("{} has format {found}; {OLDEST_VERSION} to {FORMAT_VERSION} are known", path.display())]
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
    /// The file of depth frames is that of another recording.
    #[error("{} does not belong to {}: it was recorded in {run}", path.display(), recording.display())]
    OtherRecording {
        /// The file of depth frames.
        path: PathBuf,
        /// The recording that names it.
        recording: PathBuf,
        /// What the file says of its run.
        run: String,
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
/// It holds one chunk's records of each file at a time, and as many chunks' as overlap in time. Channels that it does
/// not know are passed over. The file with the depth frames is taken along where the recording names one that is there.
#[derive(Debug)]
pub struct Reader {
    small: FileReader,
    depth: Option<FileReader>,
    depth_missing: Option<PathBuf>,
    info: Info,
    /// The next record of each file.
    heads: [Option<(Order, Record)>; 2],
    begun: bool,
    ended: bool,
}

impl Reader {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// For a file that cannot be read, is not MCAP, not ours or not whole.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let small = FileReader::open(path)?;
        let mut info = small.info().clone();
        let beside = match info.about.run.as_ref().and_then(|run| run.depth_file.as_deref()) {
            // A hostile name must not lead elsewhere.
            Some(name) if Path::new(name).file_name().is_none_or(|file| file != name) => {
                let what = format!("its depth file {name:?} is no file name");
                return Err(ReadError::Damaged { path: path.to_owned(), byte: 0, what });
            }
            name => name.map(|name| path.with_file_name(name)),
        };
        let is_there = beside.as_ref().is_some_and(|beside| beside.is_file());
        let depth = beside.as_ref().filter(|_| is_there).map(|beside| FileReader::open(beside)).transpose()?;
        if let Some(depth) = &depth {
            check_same_run(path, &info, beside.as_deref(), depth.info())?;
            take_along(&mut info, depth.info());
        }
        let depth_missing = beside.filter(|_| !is_there);
        Ok(Self { small, depth, depth_missing, info, heads: [None, None], begun: false, ended: false })
    }

    /// What the recording says about itself, its depth frames included where they are there.
    #[must_use]
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The file of depth frames that the recording names and that is not there.
    #[must_use]
    pub fn depth_missing(&self) -> Option<&Path> {
        self.depth_missing.as_deref()
    }

    /// The settings of the run that was recorded, as TOML; an import has none.
    ///
    /// # Errors
    /// Where they cannot be read.
    pub fn settings(&mut self) -> Result<Option<String>, ReadError> {
        self.small.settings()
    }

    /// Compares every byte of the recording with its checksums, which takes as long as reading it. Reading its records
    /// checks only those: a changed byte of the settings is found here.
    ///
    /// # Errors
    /// Where a file is damaged or cannot be read.
    pub fn check_bytes(&mut self) -> Result<(), ReadError> {
        self.small.check_bytes()?;
        self.depth.as_mut().map_or(Ok(()), FileReader::check_bytes)
    }

    /// Passes over what was recorded before `time_ns`, as far as that goes without reading it. The records are then no
    /// longer counted.
    pub fn skip_before(&mut self, time_ns: u64) {
        self.small.skip_before(time_ns);
        self.depth.iter_mut().for_each(|depth| depth.skip_before(time_ns));
    }

    fn advance(&mut self) -> Result<Option<Record>, ReadError> {
        if !self.begun {
            self.begun = true;
            self.heads = [self.small.advance()?, self.depth.as_mut().map_or(Ok(None), FileReader::advance)?];
        }
        let orders = self.heads.each_ref().map(|head| head.as_ref().map(|(order, _)| *order));
        let from_depth = match orders {
            [Some(small), Some(depth)] => depth < small,
            [small, _] => small.is_none(),
        };
        let (head, file) = if from_depth {
            (&mut self.heads[1], self.depth.as_mut())
        } else {
            (&mut self.heads[0], Some(&mut self.small))
        };
        let next = file.map_or(Ok(None), FileReader::advance);
        let record = head.take().map(|(_, record)| record);
        *head = next?;
        Ok(record)
    }
}

/// Both files of a recording begin with the same words about its run.
fn check_same_run(path: &Path, info: &Info, beside: Option<&Path>, depth: &Info) -> Result<(), ReadError> {
    let of = |info: &Info| {
        let run = info.about.run.as_ref();
        (info.about.first_wall_clock_s.map(f64::to_bits), run.map(|run| (run.name.clone(), run.incarnation)))
    };
    if of(info) == of(depth) {
        return Ok(());
    }
    let path_of_depth = beside.unwrap_or(path).to_owned();
    Err(ReadError::OtherRecording { path: path_of_depth, recording: path.to_owned(), run: depth.about.source.clone() })
}

/// Adds what the depth file says.
fn take_along(info: &mut Info, depth: &Info) {
    let records: u64 = depth.records.values().sum();
    if records > 0 {
        let end_ns = (info.start_ns + info.duration_ns).max(depth.start_ns + depth.duration_ns);
        info.start_ns = info.start_ns.min(depth.start_ns);
        info.duration_ns = end_ns - info.start_ns;
    }
    info.records.extend(depth.records.clone());
    if let (Some(run), Some(of_depth)) = (&mut info.about.run, &depth.about.run) {
        for (topic, n) in &of_depth.lost {
            *run.lost.entry(topic.clone()).or_default() += n;
        }
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
