//! The control socket: what a client sends, in pieces. Lines do not depend on how they were cut, nothing grows beyond
//! its limit, and what is no request is refused.
#![no_main]

use control::Request;
use control::framing::{Inbox, MAX_REQUEST, MAX_WAITING};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some((&size, sent)) = input.split_first() else { return };
    let mut inbox = Inbox::default();
    let mut heard: Vec<Vec<u8>> = Vec::new();
    let mut abuse = None;
    for piece in sent.chunks(usize::from(size).max(1)) {
        let (lines, end) = inbox.take(piece);
        assert!(lines.len() <= MAX_WAITING);
        heard.extend(lines);
        if end.is_some() {
            abuse = end;
            break;
        }
    }
    let meant: Vec<&[u8]> = sent.split(|byte| *byte == b'\n').collect();
    for (line, meant) in heard.iter().zip(&meant) {
        assert_eq!(line, meant);
        assert!(line.len() <= MAX_REQUEST);
        let _ = Request::parse(line).map(|request| request.needs());
    }
    assert!(abuse.is_some() || heard.len() + 1 == meant.len());
});
