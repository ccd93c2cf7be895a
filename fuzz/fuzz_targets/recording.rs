//! The recording reader: a file as it is, or messages in a file that is right otherwise.
#![no_main]

use guidedog_fuzz::{file, recording};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some((kind, rest)) = input.split_first() else { return };
    let bytes = if kind % 2 == 0 { Some(rest.to_vec()) } else { recording(rest).ok() };
    let Some(bytes) = bytes else { return };
    if let Ok(reader) = recording::Reader::open(&file("r.mcap", &bytes)) {
        for record in reader {
            let _ = record.map(|record| record.order());
        }
    }
});
