//! Sound as it comes over a pipe, and the files by which it is heard and answered: manifests, heads, rehearsal sets,
//! languages.
#![no_main]

use std::path::Path;

use enrolment::{HeadFile, Rehearsal, Takes};
use hearing::{Head, Manifest, PcmError, PcmStream};
use libfuzzer_sys::fuzz_target;
use speech::Language;

const MANIFEST: &[u8] = include_bytes!("../../config/cues/cues.toml");

/// The samples, or why there are none, and what is missing at the end.
fn heard(bytes: &[u8], piece: usize) -> Result<(Vec<f32>, Option<&'static str>), PcmError> {
    let (mut stream, mut samples) = (PcmStream::default(), Vec::new());
    for piece in bytes.chunks(piece) {
        stream.push(piece, &mut samples)?;
    }
    assert_eq!(stream.is_new(), bytes.is_empty());
    Ok((samples, stream.missing()))
}

fuzz_target!(|input: &[u8]| {
    let [piece, kind, bytes @ ..] = input else { return };
    match kind % 5 {
        0 => {
            let whole = heard(bytes, usize::MAX);
            assert_eq!(heard(bytes, usize::from(*piece).max(1)), whole, "pieces are nobody's business");
            let Ok((samples, _)) = whole else { return };
            assert!(samples.iter().all(|sample| (-1.0..1.0).contains(sample)));
            let mut takes = Takes::default();
            for samples in samples.chunks(usize::from(*piece).max(1) * 16) {
                if let Some(Ok(word)) = takes.push(samples) {
                    assert!(!word.is_empty());
                }
            }
        }
        1 => drop(Manifest::parse(Path::new("manifest"), bytes)),
        2 => {
            let manifest = Manifest::parse(Path::new("manifest"), MANIFEST).expect("it is shipped");
            let head = Head { path: "head".into(), bytes: bytes.to_vec(), manifest };
            if let Ok(file) = HeadFile::parse(&head) {
                let _ = file.convolutions();
                let same = file.with(file.dense());
                let again = HeadFile::parse(&same).expect("what was written is read");
                assert_eq!((again.dense(), again.flat()), (file.dense(), file.flat()));
            }
        }
        3 => drop(Rehearsal::parse(bytes)),
        _ => drop(std::str::from_utf8(bytes).map(|text| Language::parse("language", text))),
    }
});
