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
    last_of(&text).map_or_else(|| status.to_owned(), |words| format!("{status}; its last words: {words}"))
}

/// What a panic said, which may stand before a backtrace; the last line of anything else.
fn last_of(text: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    match lines.iter().rposition(|line| line.contains(" panicked at ")) {
        Some(at) => Some(lines[at..].iter().take(2).copied().collect::<Vec<_>>().join(" ")),
        None => lines.last().map(|line| (*line).to_owned()),
    }
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

#[cfg(test)]
mod tests {
    use super::last_of;

    #[test]
    fn a_panic_is_told_and_not_its_backtrace() {
        let log =
            "ready\nthread 'main' (7) panicked at src/a.rs:3:5:\nno room\nstack backtrace:\n   0: a\n  at b.rs:1\n";
        assert_eq!(last_of(log).as_deref(), Some("thread 'main' (7) panicked at src/a.rs:3:5: no room"));
        assert_eq!(last_of("one\n\ntwo\n \n").as_deref(), Some("two"));
        assert_eq!(last_of("\n"), None);
    }
}
