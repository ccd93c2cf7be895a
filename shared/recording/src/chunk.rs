//! The messages of one chunk.

use mcap::records::{MessageHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::index::{RECORD_BYTES_MAX, body};
use crate::lengths;

/// What an MCAP record within a chunk is.
#[derive(Debug)]
pub enum Entry<'a> {
    /// A message.
    Message(MessageHeader, &'a [u8]),
    /// Another record: opcode and body.
    Other(u8, &'a [u8]),
}

/// Goes through the records of a chunk, which is given whole: opcode, length and body. Checksums are checked first.
///
/// # Errors
/// Where the chunk is damaged, in words; or the error of `take`.
pub fn each_entry<E: From<String>>(chunk: &[u8], mut take: impl FnMut(Entry<'_>) -> Result<(), E>) -> Result<(), E> {
    let damaged = |error: mcap::McapError| E::from(error.to_string());
    if !lengths::fit(op::CHUNK, body(chunk)) {
        return Err(E::from(lengths::BEYOND.to_owned()));
    }
    let mut records = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX as usize),
    );
    let mut rest = chunk;
    while let Some(event) = records.next_event() {
        match event.map_err(damaged)? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (piece, after) = rest.split_at(wanted.min(rest.len()));
                records.insert(piece.len()).copy_from_slice(piece);
                records.notify_read(piece.len());
                rest = after;
            }
            LinearReadEvent::Record { opcode: op::MESSAGE, data } => {
                let parsed = mcap::parse_record(op::MESSAGE, data).map_err(damaged)?;
                if let mcap::records::Record::Message { header, data } = parsed {
                    take(Entry::Message(header, &data))?;
                }
            }
            LinearReadEvent::Record { opcode, data } => take(Entry::Other(opcode, data))?,
        }
    }
    Ok(())
}
