//! The shipped head and its rehearsal set are such as enrolment needs.

use std::path::{Path, PathBuf};

use guidedog_enrolment::{HeadFile, Rehearsal};
use hearing::{EMBEDDING, Head, Network, WINDOWS};

fn shipped() -> (PathBuf, Head) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/cues");
    let head = Head::read(&folder.join("cues.toml")).expect("it is shipped");
    (folder, head)
}

fn runtime() -> Option<PathBuf> {
    std::env::var_os("GUIDEDOG_ONNX_RUNTIME").map(PathBuf::from)
}

fn run(bytes: &[u8], seen: &[f32]) -> Vec<f32> {
    let mut network = Network::new(Path::new("head"), bytes, "head", runtime().as_deref()).expect("it can be run");
    network.run(&[1, WINDOWS, EMBEDDING], seen).expect("it runs")
}

#[test]
fn a_head_without_its_dense_layers_gives_what_they_take_and_with_the_same_ones_says_the_same() {
    let (_, head) = shipped();
    let file = HeadFile::parse(&head).expect("its parts are known");
    let seen: Vec<f32> = (0..WINDOWS * EMBEDDING).map(|i| 20.0 * (i as f32 * 0.37).sin()).collect();
    let flat = run(&file.convolutions(), &seen);
    assert_eq!(flat.len(), file.flat());
    assert!(flat.iter().all(|number| *number >= 0.0) && flat.iter().any(|number| *number > 0.0), "after its relu");
    let same = file.with(file.dense());
    assert_eq!(run(&same.bytes, &seen), run(&head.bytes, &seen));
    let mut other = file.dense().clone();
    other.w2.fill(0.0);
    other.b2.copy_from_slice(&[0.0, 0.0, 0.0, 9.0, 0.0, 0.0]);
    let other = file.with(&other);
    assert!(run(&other.bytes, &seen)[3] > 0.99, "its new layers are asked");
    assert_ne!(other.manifest.sha256, head.manifest.sha256);
}

#[test]
fn the_rehearsal_set_is_the_heads_own_and_another_is_refused() {
    let (folder, head) = shipped();
    let set = Rehearsal::read(&folder.join("rehearsal.bin"), &head).expect("it is shipped");
    assert_eq!(set.features().flat(), HeadFile::parse(&head).expect("its parts are known").flat());
    assert!(set.features().len() > 1000);
    let error = Rehearsal::read(&folder.join("cues.onnx"), &head).expect_err("it is another file").to_string();
    assert!(error.contains("cues.onnx: its digest is"), "{error}");
}
