//! What a process that died had to say.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use messages::ServiceId;
use transport::Io;

/// The last line that a dead child wrote, beside how it ended. However much it wrote, only the end is read.
pub fn last_words(io: &Io, service: ServiceId, incarnation: u32, status: &str) -> String {
    let tail = tail_of(&io.domain.dir.log(service, incarnation)).unwrap_or_default();
    let text = String::from_utf8_lossy(&tail);
    let last = text.lines().rev().find(|line| !line.trim().is_empty() && !line.contains("RUST_BACKTRACE"));
    last.map_or_else(|| status.to_owned(), |line| format!("{status}; its last words: {line}"))
}

/// The last 4 KiB of a file.
fn tail_of(path: &Path) -> std::io::Result<Vec<u8>> {
    const TAIL_BYTES: u64 = 4096;
    let mut file = File::open(path)?;
    let begin = file.metadata()?.len().saturating_sub(TAIL_BYTES);
    file.seek(SeekFrom::Start(begin))?;
    let mut tail = Vec::new();
    file.take(TAIL_BYTES).read_to_end(&mut tail)?;
    Ok(tail)
}
