//! A log's lines, whatever it is compressed with.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use bzip2::read::MultiBzDecoder;
use flate2::read::MultiGzDecoder;

use super::line::LineError;
use super::report::ImportError;

/// 4,096 readings of 32 characters are 128 KiB; what is longer is no line of a log.
const LINE_BYTES_MAX: u64 = 1 << 20;

const BUFFER_BYTES: usize = 256 << 10;

/// A log, line by line.
pub struct Lines {
    path: PathBuf,
    input: Box<dyn BufRead>,
    compressed: bool,
    buffer: Vec<u8>,
    read: u64,
}

/// What comes next in a log.
pub enum Next<'a> {
    /// A line, without its end.
    Line {
        /// Counted from 1.
        number: u64,
        /// What it says.
        text: &'a [u8],
        /// Whether its end was there.
        whole: bool,
    },
    /// The end.
    End,
    /// The compressed data ends before its end.
    CutOff,
}

impl Lines {
    pub fn open(path: &Path) -> Result<Self, ImportError> {
        let failed = |source| ImportError::Read { path: path.to_owned(), lines: 0, source };
        // Before it is opened: opening a pipe would wait for its writer.
        if !path.metadata().map_err(failed)?.is_file() {
            return Err(ImportError::NotAFile { path: path.to_owned() });
        }
        let mut file = File::open(path).map_err(failed)?;
        let mut magic = Vec::new();
        file.by_ref().take(3).read_to_end(&mut magic).map_err(failed)?;
        file.seek(SeekFrom::Start(0)).map_err(failed)?;
        let compressed = magic == *b"BZh" || magic.starts_with(b"\x1f\x8b");
        let input: Box<dyn Read> = match compressed {
            true if magic == *b"BZh" => Box::new(MultiBzDecoder::new(file)),
            true => Box::new(MultiGzDecoder::new(file)),
            false => Box::new(file),
        };
        let input = Box::new(BufReader::with_capacity(BUFFER_BYTES, input));
        Ok(Self { path: path.to_owned(), input, compressed, buffer: Vec::new(), read: 0 })
    }

    /// Whole lines read so far.
    pub fn count(&self) -> u64 {
        self.read
    }

    pub fn advance(&mut self) -> Result<Next<'_>, ImportError> {
        self.buffer.clear();
        let number = self.read + 1;
        match (&mut self.input).take(LINE_BYTES_MAX).read_until(b'\n', &mut self.buffer) {
            Ok(0) => return Ok(Next::End),
            Ok(_) => {}
            Err(error) if self.compressed && error.kind() == io::ErrorKind::UnexpectedEof => return Ok(Next::CutOff),
            Err(source) => return Err(ImportError::Read { path: self.path.clone(), lines: self.read, source }),
        }
        let whole = self.buffer.ends_with(b"\n");
        if !whole && self.buffer.len() as u64 == LINE_BYTES_MAX {
            return Err(ImportError::Line { path: self.path.clone(), line: number, error: LineError::TooLong });
        }
        self.read += u64::from(whole);
        Ok(Next::Line { number, text: self.buffer.trim_ascii(), whole })
    }
}
