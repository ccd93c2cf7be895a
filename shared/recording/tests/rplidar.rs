//! Real captures of an RPLIDAR against what an independent decoder counted in them.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are tests too")]

use guidedog_recording::{Existing, Reader, Record, rplidar};

#[test]
fn real_captures_hold_the_nodes_that_another_decoder_counts() {
    let Some(list) = test_data::data("rplidar/expected.json") else { return };
    let folder = list.parent().expect("a folder").to_owned();
    let text = std::fs::read_to_string(&list).expect("readable");
    let expected: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let mut files = 0;
    for file in expected.as_array().expect("a list") {
        let name = file["file"].as_str().expect("a name");
        let capture = rplidar::decode(&std::fs::read(folder.join(name)).expect("readable")).expect("a scan");
        let count = |key: &str| file[key].as_u64().expect("a count") as usize;
        let starts = capture.nodes.iter().filter(|node| node.starts_turn).count();
        let zeros = capture.nodes.iter().filter(|node| node.range_m.is_none()).count();
        // After a lost byte two decoders need not agree at once.
        let lost = 5 * (1 + capture.skipped_bytes as usize);
        for (ours, key) in
            [(capture.nodes.len(), "nodes_after_descriptor"), (starts, "rev_starts"), (zeros, "zero_distance")]
        {
            assert!(ours.abs_diff(count(key)) <= lost, "{name}: {key}: {ours}, not {}", count(key));
        }
        if count("skipped_bytes") == 0 && count("descriptors") == 1 {
            // But for the last ones: nodes are believed once those behind them fit to them.
            let missing = count("nodes_after_descriptor").checked_sub(capture.nodes.len());
            assert!(missing.is_some_and(|missing| missing < 6), "{name}: {missing:?} nodes are missing");
            assert!(zeros <= count("zero_distance") && zeros + 6 > count("zero_distance"), "{name}: {zeros}");
        }
        files += 1;
    }
    assert!(files > 50, "{files} captures");
}

fn options(existing: Existing) -> rplidar::ImportOptions {
    rplidar::ImportOptions { existing, field_of_view_rad: std::f64::consts::TAU }
}

#[test]
fn captures_become_a_recording_of_whole_revolutions() {
    let Some(list) = test_data::data("rplidar/expected.json") else { return };
    let folder = list.parent().expect("a folder").to_owned();
    let out = tempfile::tempdir().expect("a folder");
    let recording = out.path().join("room.mcap");
    let sources = [folder.join("sample_data_1.bin"), folder.join("sample_data_pyserial_1.bin")];
    let report = rplidar::import(&sources, &recording, options(Existing::Refuse)).expect("imported");
    // The first capture ends with a node that says that a turn begins, in the middle of one.
    assert_eq!(report.scans, 1 + 32);
    let mut scans = 0;
    for record in Reader::open(&recording).expect("a recording") {
        let Record::LidarScan(scan) = record.expect("readable") else { panic!("only scans") };
        let (header, ranges_m) = (scan.header, scan.data);
        assert_eq!((ranges_m.len(), header.header.seq), (report.beams, scans));
        let known = ranges_m.iter().filter(|range| range.is_finite()).count();
        assert!(known * 4 > ranges_m.len(), "scan {scans}: {known} known beams");
        scans += 1;
    }
    assert_eq!(scans, report.scans);
    let copy = out.path().join("copy.bin");
    std::fs::copy(&sources[0], &copy).unwrap();
    let same = rplidar::import(std::slice::from_ref(&copy), &copy, options(Existing::Replace));
    assert!(same.is_err_and(|error| error.to_string().contains("at once")), "the capture is still there");
    let none = rplidar::import(&[folder.join("expected.json")], &recording, options(Existing::Replace));
    assert!(none.is_err_and(|error| error.to_string().contains("expected.json holds no standard scan")));
}
