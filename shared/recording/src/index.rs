//! The summary at the end of an MCAP file: where its chunks, channels and metadata are.
//!
//! Read here rather than by `mcap`'s summary reader, which parses every kind of record, attachments among them, on
//! which a hostile length makes it panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use crc32fast::Hasher;
use mcap::records::{ChunkIndex, MetadataIndex, Record, op};

use crate::lengths;

/// MCAP's first and last bytes.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Opcode and length stand before each record's body.
const PREFIX_BYTES: u64 = 9;

/// Length of the footer's body.
const FOOTER_BYTES: u64 = 20;

/// No record, compressed or not, may be larger: a file must not make its reader use up the memory.
pub const RECORD_BYTES_MAX: u64 = 64 << 20;

/// A checksum is taken of so many bytes at a time.
const PIECE_BYTES: usize = 1 << 20;

/// Length of the body of the record behind the last chunk: one checksum.
const DATA_END_BYTES: u64 = 4;

/// What the summary says.
#[derive(Debug, Default)]
pub struct Index {
    /// Where the data ends, and the summary is still to come.
    pub data_end: u64,
    /// By their first log time.
    pub chunks: Vec<ChunkIndex>,
    /// Topic and encoding by channel id.
    pub channels: BTreeMap<u16, (String, String)>,
    /// Where metadata is.
    pub metadata: Vec<MetadataIndex>,
}

/// What is wrong with a file, and where.
#[derive(Debug)]
pub enum Flaw {
    /// Reading failed.
    Io {
        /// Where.
        byte: u64,
        /// Why.
        source: io::Error,
    },
    /// It does not begin as MCAP does.
    NoMagic,
    /// It does not end as MCAP does.
    Torn,
    /// What stands there makes no sense.
    Damaged {
        /// Where.
        byte: u64,
        /// What is wrong.
        what: String,
    },
}

impl Flaw {
    /// What stands at `byte` makes no sense.
    pub fn damaged(byte: u64, what: impl ToString) -> Self {
        Self::Damaged { byte, what: what.to_string() }
    }
}

/// Reads the summary of a file of `len` bytes.
pub fn read_index(file: &mut File, len: u64) -> Result<Index, Flaw> {
    let mark = MAGIC.len() as u64;
    if len < mark || read_at(file, 0, mark)? != MAGIC {
        return Err(Flaw::NoMagic);
    }
    let footer_at = match len.checked_sub(mark + PREFIX_BYTES + FOOTER_BYTES) {
        Some(at) if at >= mark && read_at(file, len - mark, mark)? == MAGIC => at,
        _ => return Err(Flaw::Torn),
    };
    let raw = read_record(file, footer_at, len)?;
    if raw.first() != Some(&op::FOOTER) {
        return Err(Flaw::Torn);
    }
    let summary_at = match mcap::parse_record(op::FOOTER, body(&raw)) {
        Ok(Record::Footer(footer)) if (mark..=footer_at).contains(&footer.summary_start) => footer.summary_start,
        // Other programs may leave the summary out; ours never does.
        _ => return Err(Flaw::damaged(footer_at, "the footer names no summary")),
    };
    let summary_bytes = footer_at - summary_at;
    if summary_bytes > RECORD_BYTES_MAX {
        return Err(Flaw::damaged(summary_at, format_args!("a summary of {summary_bytes} bytes")));
    }
    let summary = read_at(file, summary_at, summary_bytes)?;
    check_summary(&summary, &raw).map_err(|what| Flaw::damaged(summary_at, what))?;
    let data_end = summary_at.checked_sub(PREFIX_BYTES + DATA_END_BYTES).filter(|at| *at >= mark);
    let data_end = data_end.ok_or_else(|| Flaw::damaged(footer_at, "the footer's summary lies before all data"))?;
    let mut index = Index { data_end, ..Index::default() };
    let mut rest = &summary[..];
    while !rest.is_empty() {
        let byte = footer_at - rest.len() as u64;
        let (opcode, body, after) =
            split_record(rest).ok_or_else(|| Flaw::damaged(byte, "a record that reaches past the summary"))?;
        if !lengths::fit(opcode, body) {
            return Err(Flaw::damaged(byte, lengths::BEYOND));
        }
        index.take(opcode, body).map_err(|error| Flaw::damaged(byte, error))?;
        rest = after;
    }
    index.chunks.sort_by_key(|chunk| (chunk.message_start_time, chunk.chunk_start_offset));
    Ok(index)
}

impl Index {
    fn take(&mut self, opcode: u8, body: &[u8]) -> Result<(), mcap::McapError> {
        if !matches!(opcode, op::CHANNEL | op::CHUNK_INDEX | op::METADATA_INDEX) {
            return Ok(());
        }
        match mcap::parse_record(opcode, body)? {
            Record::Channel(channel) => {
                self.channels.insert(channel.id, (channel.topic, channel.message_encoding));
            }
            Record::ChunkIndex(chunk) => self.chunks.push(chunk),
            Record::MetadataIndex(metadata) => self.metadata.push(metadata),
            _ => {}
        }
        Ok(())
    }
}

/// The footer's checksum is of the summary and of the footer up to the checksum itself; 0: none was taken.
fn check_summary(summary: &[u8], footer: &[u8]) -> Result<(), &'static str> {
    let Some((covered, &crc)) = footer.split_last_chunk() else { return Err("the footer has no checksum") };
    let mut hasher = Hasher::new();
    hasher.update(summary);
    hasher.update(covered);
    match u32::from_le_bytes(crc) {
        0 => Ok(()),
        // A fuzzer would never come past it.
        crc if crc == hasher.finalize() || cfg!(fuzzing) => Ok(()),
        _ => Err("the summary is not what its checksum says"),
    }
}

/// Reads all that stands before `data_end`, and compares it with the checksum that stands there.
pub fn check_data(file: &mut File, data_end: u64) -> Result<(), Flaw> {
    let failed = |source| Flaw::Io { byte: data_end, source };
    let end = read_at(file, data_end, PREFIX_BYTES + DATA_END_BYTES)?;
    let crc = match (split_prefix(&end), end.split_last_chunk()) {
        (Some((op::DATA_END, DATA_END_BYTES)), Some((_, &crc))) => u32::from_le_bytes(crc),
        _ => return Err(Flaw::damaged(data_end, "the data has no end there")),
    };
    file.rewind().map_err(failed)?;
    let mut data = file.take(data_end);
    let (mut hasher, mut piece) = (Hasher::new(), vec![0; PIECE_BYTES]);
    loop {
        match data.read(&mut piece).map_err(failed)? {
            0 => break,
            n => hasher.update(piece.get(..n).unwrap_or_default()),
        }
    }
    if crc != 0 && crc != hasher.finalize() {
        return Err(Flaw::damaged(data_end, "what stands before is not what its checksum says"));
    }
    Ok(())
}

/// The body of a whole record.
pub fn body(record: &[u8]) -> &[u8] {
    record.get(PREFIX_BYTES as usize..).unwrap_or_default()
}

/// The whole record that begins at `byte` of a file of `len` bytes: opcode, length, body.
pub fn read_record(file: &mut File, byte: u64, len: u64) -> Result<Vec<u8>, Flaw> {
    let room = len.checked_sub(byte).and_then(|room| room.checked_sub(PREFIX_BYTES));
    let Some(room) = room else {
        return Err(Flaw::damaged(byte, format_args!("a record past the file's end at {len}")));
    };
    let prefix = read_at(file, byte, PREFIX_BYTES)?;
    let (_, body_bytes) = split_prefix(&prefix).ok_or(Flaw::Torn)?;
    if body_bytes > room.min(RECORD_BYTES_MAX) {
        return Err(Flaw::damaged(byte, format_args!("a record of {body_bytes} bytes, with {room} left in the file")));
    }
    read_at(file, byte, PREFIX_BYTES + body_bytes)
}

fn split_prefix(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&[opcode], rest) = bytes.split_first_chunk()?;
    let (&length, _) = rest.split_first_chunk()?;
    Some((opcode, u64::from_le_bytes(length)))
}

fn split_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (opcode, body_bytes) = split_prefix(bytes)?;
    let (body, after) = bytes.get(PREFIX_BYTES as usize..)?.split_at_checked(usize::try_from(body_bytes).ok()?)?;
    Some((opcode, body, after))
}

/// `count` bytes from `byte` on; the caller has bounded `count`.
pub fn read_at(file: &mut File, byte: u64, count: u64) -> Result<Vec<u8>, Flaw> {
    let mut bytes = vec![0; count as usize];
    let read = file.seek(SeekFrom::Start(byte)).and_then(|_| file.read_exact(&mut bytes));
    read.map_err(|source| Flaw::Io { byte, source })?;
    Ok(bytes)
}
