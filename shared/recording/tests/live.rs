//! Live recordings: every topic comes back to the bit, and a file that was cut anywhere is recovered to its last chunk.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are not seen as tests")]

mod common;

use std::fs;
use std::path::Path;

use common::{chain, scan};
use guidedog_recording::{
    About, Part, ReadError, Reader, Record, RecoverError, RunAbout, Slice, Writer, life_path, recover, write_last,
};
use messages::{
    Attitude, Cue, CueAnswer, CueHeard, CueInForce, CueKind, CueRefusal, CueRequest, CueSource, DepthFrame,
    DepthHeader, Header, LocomotionState, Mode, ModeClass, Odometry, Outcome, Permit, PermitCause, PolicyAction, Pose2,
    Pose3, ScanHeader, SecondScan, SecondScanHeader, ServiceId, SpeechPhase, SpeechSaid, StopKind, StopReason, TopicId,
    Twist2, UnsafeCause, Urgency, Walker, WorldTruth,
};
use tempfile::tempdir;

fn header(seq: u64) -> Header {
    Header { stamp_ns: seq * 10 - 3, seq, step: seq, published_ns: seq * 10, incarnation: 7, reserved: 0 }
}

const POSE: Pose2 = Pose2 { x_m: 0.1 + 0.2, y_m: -0.0, yaw_rad: 5e-324 };
const TWIST: Twist2 = Twist2 { vx_mps: f64::NAN, vy_mps: f64::INFINITY, wz_radps: f64::NEG_INFINITY };
const ATTITUDE: Attitude =
    Attitude { stamp_ns: 7, roll_rad: -0.0, pitch_rad: 1.0 / 3.0, height_m: 0.31, standing_m: f64::NAN };
const REASON: StopReason = StopReason {
    kind: StopKind::StreamStale,
    service: ServiceId::Lidar,
    topic: TopicId::LidarScan,
    incarnation: 3,
    age_ns: u64::MAX,
    limit_ns: 5,
    used: 6,
    used_limit: 7,
    ahead_mm: -8,
    left_mm: 9,
    away_mm: -10,
    kept_mm: 11,
    step_mm: -12,
};

fn cue(seq: u64) -> Cue {
    Cue {
        header: header(seq),
        kind: CueKind::Left,
        source: CueSource::TurnDone,
        confidence: 0.1,
        signal_db: 12.5,
        clipped: 0.25,
        odom_from_start: POSE,
        odometry_incarnation: 2,
        request_seq: u64::MAX,
    }
}

fn permit(seq: u64) -> Permit {
    Permit {
        header: header(seq),
        outcome: Outcome::RemainderUnsafe,
        cause: PermitCause::Decision,
        unsafe_cause: UnsafeCause::Memory,
        velocity: TWIST,
        margin_m: 1.0 / 3.0,
        robot_from_handler: POSE,
        unsafe_mask: u32::MAX,
        ..Permit::default()
    }
}

/// One record of every topic, the small ones first.
fn every_topic() -> (Vec<Record>, Record) {
    let mode = Mode {
        header: header(8),
        class: ModeClass::Lock,
        ready_for_cue: true,
        reason: REASON,
        cue: CueInForce { valid: true, cue: cue(4) },
        ..Mode::default()
    };
    let state = LocomotionState { header: header(9), limited_by: REASON, applied: TWIST, ..LocomotionState::default() };
    let mut truth =
        WorldTruth { header: header(10), world_from_handler: POSE, walker_count: 1, ..WorldTruth::default() };
    truth.walkers[0] = Walker { x_m: 1.5, y_m: f64::MIN_POSITIVE, radius_m: 0.3 };
    let mut action = PolicyAction { header: header(6), decision: 9, ..PolicyAction::default() };
    action.probabilities[3] = f32::from_bits(0x3EAA_AAAB);
    let mut turn = scan(1, 1, vec![0.1, f32::NAN, f32::INFINITY]);
    *turn.header_mut() = header(1);
    let second = SecondScanHeader {
        header: header(15),
        scan: ScanHeader { angle_min_rad: -0.1, robot_from_lidar: POSE, height_m: 0.4, ..ScanHeader::default() },
        pitch_rad: 0.1 + 0.2,
    };
    let small = vec![
        turn,
        Slice::<SecondScan> { header: second, data: vec![0.2, f32::NAN, f32::INFINITY] }.into(),
        Record::from(Odometry {
            header: header(3),
            odom_from_robot: POSE,
            twist: TWIST,
            sigma: [0.1; 3],
            attitude: ATTITUDE,
        }),
        Record::from(cue(4)),
        Record::from(CueRequest { header: header(5), kind: CueKind::Right }),
        Record::from(action),
        Record::from(permit(7)),
        Record::from(mode),
        Record::from(state),
        Record::from(messages::EmergencyStop { header: header(11), input: messages::StopInput::Pressed }),
        Record::from(CueAnswer {
            header: header(12),
            kind: CueKind::Left,
            refusal: CueRefusal::StreamStale,
            reason: REASON,
            ..CueAnswer::default()
        }),
        Record::from(CueHeard { header: header(14), kind: CueKind::Forward, confidence: 0.93 }),
        Record::from(SpeechSaid {
            header: header(13),
            phase: SpeechPhase::Cut,
            urgency: Urgency::Stop,
            text: "Gestoppt: Lidar-Ausfall, startet für dich neu.".into(),
            ..SpeechSaid::default()
        }),
        Record::from(truth),
    ];
    let camera = Pose3 { x_m: 0.1, y_m: 0.2, z_m: 0.3, yaw_rad: -0.0, pitch_rad: 0.7 };
    let depth = DepthHeader {
        header: header(2),
        width: 3,
        height: 2,
        fx_px: 0.1 + 0.2,
        fy_px: f64::NAN,
        cx_px: 1.0,
        cy_px: 2.0,
        robot_from_camera: camera,
    };
    (small, Slice::<DepthFrame> { header: depth, data: vec![0, 1, 256, 65_535, 7, 8] }.into())
}

fn about(depth_file: Option<&str>) -> About {
    let run = RunAbout {
        name: "test".to_owned(),
        stepped: true,
        seed: 5,
        incarnation: 1,
        depth_file: depth_file.map(str::to_owned),
        ..RunAbout::default()
    };
    About { source: "run test".to_owned(), robot: "none".to_owned(), run: Some(run), ..About::default() }
}

fn record(path: &Path, part: Part, records: &[Record]) {
    let about = about((part == Part::Small).then_some("a.depth.mcap"));
    let mut writer = Writer::live(path, part, &about, "[shield]\nmargin_m = 0.1\n").unwrap();
    for record in records {
        writer.write(record).unwrap();
    }
    writer.finish(about).unwrap();
}

#[test]
fn every_topic_comes_back_to_the_bit_and_in_order() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (small, depth) = every_topic();
    record(&path, Part::Small, &small);
    let reader = Reader::open(&path).unwrap();
    assert_eq!(reader.depth_missing(), Some(folder.path().join("a.depth.mcap").as_path()));
    assert_eq!(reader.count(), small.len(), "the small topics are read without the depth frames");
    record(&folder.path().join("a.depth.mcap"), Part::Depth, std::slice::from_ref(&depth));
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!((reader.depth_missing(), reader.info().records["depth/frame"]), (None, 1));
    assert_eq!(reader.settings().unwrap().as_deref(), Some("[shield]\nmargin_m = 0.1\n"));
    let mut expected = small;
    expected.push(depth);
    expected.sort_by_key(Record::order);
    let back: Vec<Record> = reader.map(Result::unwrap).collect();
    assert_eq!(back.len(), expected.len());
    for (back, expected) in back.iter().zip(&expected) {
        assert_eq!(back.header(), expected.header());
        assert!(back.is_same(expected), "{back:?} is not {expected:?}");
    }
    // Field by field, where the fields have numbers that are equal to themselves.
    let cue = back.iter().find(|record| matches!(record, Record::Cue(_)));
    assert_eq!(cue, expected.iter().find(|record| matches!(record, Record::Cue(_))));
    let requests = |all: &[Record]| all.iter().filter(|record| matches!(record, Record::CueRequest(_))).count();
    assert_eq!(requests(&back), 1);
}

#[test]
fn our_schemas_name_every_member() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    record(&path, Part::Small, &every_topic().0);
    let bytes = fs::read(&path).unwrap();
    let mut seen = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        let described: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
        let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        check(&described, &value, &schema.name);
        seen += usize::from(schema.name.starts_with("guidedog."));
    }
    assert_eq!(seen, 11);
}

/// As far as our schemas go: types, members, items.
fn check(schema: &serde_json::Value, value: &serde_json::Value, at: &str) {
    if let Some(members) = value.as_object() {
        for (name, member) in members {
            assert!(schema["properties"][name].is_object(), "{at}.{name} is in the schema");
            check(&schema["properties"][name], member, &format!("{at}.{name}"));
        }
    } else if let Some(items) = value.as_array() {
        items.iter().for_each(|item| check(&schema["items"], item, at));
    }
}

#[test]
fn a_file_that_was_cut_anywhere_is_recovered_to_its_last_flush() {
    let folder = tempdir().unwrap();
    let (path, torn) = (folder.path().join("a.mcap"), folder.path().join("torn.mcap"));
    let about = about(None);
    let mut writer = Writer::live(&path, Part::Small, &about, "x = 1\n").unwrap();
    let mut flushed = Vec::new();
    for seq in 1..=60 {
        writer.write(&Record::from(permit(seq))).unwrap();
        if seq % 10 == 0 {
            writer.flush().unwrap();
            flushed.push((path.metadata().unwrap().len(), seq));
        }
    }
    let whole_but_its_end = fs::read(&path).unwrap();
    writer.finish(about).unwrap();
    let mut tried = 0;
    for cut in (flushed[0].0..=whole_but_its_end.len() as u64).step_by(131).chain(flushed.iter().map(|(at, _)| *at)) {
        fs::write(&torn, &whole_but_its_end[..cut as usize]).unwrap();
        assert!(matches!(Reader::open(&torn), Err(ReadError::Torn { .. })));
        let out = folder.path().join(format!("out-{cut}-{tried}.mcap"));
        let recovered = recover(&torn, &out).unwrap();
        let (_, expected) = flushed.iter().rev().find(|(at, _)| *at <= cut).unwrap();
        // A chunk may be whole though the index behind it is not.
        let kept = recovered.info.records["shield/permit"];
        assert!(kept == *expected || kept == *expected + 10, "cut at {cut}: {kept}, not {expected}");
        assert!(recovered.cut_at_byte <= cut);
        let mut reader = Reader::open(&out).unwrap();
        assert_eq!(reader.info().about.run.as_ref().unwrap().ended, "recovered");
        assert_eq!(reader.settings().unwrap().as_deref(), Some("x = 1\n"));
        assert_eq!(reader.map(Result::unwrap).count() as u64, kept);
        fs::remove_file(&out).unwrap();
        tried += 1;
    }
    assert!(tried > 10);
    // Cut before anything was recorded: told, and nothing is made of it.
    for cut in [0, 5, 40, 300] {
        fs::write(&torn, &whole_but_its_end[..cut]).unwrap();
        let out = folder.path().join("none.mcap");
        assert!(recover(&torn, &out).is_err() && !out.exists(), "{cut}");
    }
}

#[test]
fn a_flipped_bit_ends_a_recovery_there_and_never_panics() {
    let folder = tempdir().unwrap();
    let (path, torn) = (folder.path().join("a.mcap"), folder.path().join("torn.mcap"));
    let records: Vec<Record> = (1..=40).map(|seq| Record::from(permit(seq))).collect();
    record(&path, Part::Small, &records);
    let whole = fs::read(&path).unwrap();
    let mut fewer = 0;
    for at in (8..whole.len()).step_by(37) {
        let mut changed = whole.clone();
        changed[at] ^= 0x41;
        fs::write(&torn, changed).unwrap();
        let out = folder.path().join(format!("out-{at}.mcap"));
        match recover(&torn, &out) {
            Ok(recovered) => {
                fewer += usize::from(recovered.info.records["shield/permit"] < 40);
                assert!(Reader::open(&out).unwrap().all(|record| record.is_ok()));
            }
            Err(RecoverError::Read(error)) => assert!(chain(&error).contains("torn.mcap"), "{error}"),
            Err(error) => panic!("{error}"),
        }
    }
    assert!(fewer > 3, "{fewer}");
}

#[test]
fn a_recording_leads_to_no_other_folder_and_nothing_is_overwritten() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let evil = about(Some("../../etc/passwd"));
    Writer::live(&path, Part::Small, &evil, "").unwrap().finish(evil).unwrap();
    let error = Reader::open(&path).unwrap_err();
    assert!(matches!(&error, ReadError::Damaged { what, .. } if what.contains("no file name")), "{error}");
    assert!(Writer::live(&path, Part::Small, &about(None), "").is_err(), "it is there already");
}

#[test]
fn a_changed_byte_anywhere_is_found_by_the_checksums() {
    let folder = tempdir().unwrap();
    let (path, changed_path) = (folder.path().join("a.mcap"), folder.path().join("changed.mcap"));
    let records: Vec<Record> = (1..=20).map(|seq| Record::from(permit(seq))).collect();
    record(&path, Part::Small, &records);
    let whole = fs::read(&path).unwrap();
    Reader::open(&path).unwrap().check_bytes().unwrap();
    let ends_at = whole.len();
    for at in (0..ends_at).step_by(53).chain(ends_at - 40..ends_at) {
        let mut changed = whole.clone();
        changed[at] ^= 0x04;
        fs::write(&changed_path, changed).unwrap();
        let checked = Reader::open(&changed_path).and_then(|mut reader| reader.check_bytes());
        assert!(checked.is_err(), "byte {at} of {ends_at}");
    }
}

#[test]
fn a_depth_file_of_another_recording_is_told() {
    let folder = tempdir().unwrap();
    let [ours, other] = ["ours.mcap", "other.mcap"].map(|name| folder.path().join(name));
    for (path, at_s) in [(&ours, 1.0), (&other, 2.0)] {
        let depth = Part::Depth.path(path);
        let mut about = about(Some(&depth.file_name().unwrap().to_string_lossy()));
        about.first_wall_clock_s = Some(at_s);
        for part in [Part::Small, Part::Depth] {
            Writer::live(&part.path(path), part, &about, "").unwrap().finish(about.clone()).unwrap();
        }
    }
    Reader::open(&ours).unwrap();
    fs::copy(Part::Depth.path(&other), Part::Depth.path(&ours)).unwrap();
    let error = Reader::open(&ours).unwrap_err();
    assert!(matches!(error, ReadError::OtherRecording { .. }), "{error}");
}

#[test]
fn zeros_at_the_end_are_no_records() {
    let folder = tempdir().unwrap();
    let (path, torn, out) =
        (folder.path().join("a.mcap"), folder.path().join("torn.mcap"), folder.path().join("out.mcap"));
    let mut writer = Writer::live(&path, Part::Small, &about(None), "").unwrap();
    writer.write(&Record::from(permit(1))).unwrap();
    writer.flush().unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let written = bytes.len() as u64;
    bytes.resize(bytes.len() + (64 << 20), 0);
    fs::write(&torn, bytes).unwrap();
    let recovered = recover(&torn, &out).unwrap();
    assert_eq!((recovered.cut_at_byte, recovered.info.records["shield/permit"]), (written, 1));
    assert_eq!(recovered.why.as_deref(), Some("nothing was written here"));
}

#[test]
fn the_last_part_of_a_torn_recording_is_one_of_its_own() {
    let folder = tempdir().unwrap();
    let [path, last] = ["a.mcap", "last.mcap"].map(|name| folder.path().join(name));
    let mut writer = Writer::live(&path, Part::Small, &about(Some("a.depth.mcap")), "x = 1\n").unwrap();
    let records: Vec<Record> = (1..=60).map(|seq| Record::from(permit(seq))).collect();
    for record in &records {
        writer.write(record).unwrap();
    }
    writer.flush().unwrap();
    drop(writer);
    let span_ns = records[59].time_ns() - records[40].time_ns();
    write_last(&path, &last, span_ns).unwrap();
    let reader = Reader::open(&last).unwrap();
    let run = reader.info().about.run.clone().unwrap();
    assert!(!run.is_whole() && run.depth_file.is_none(), "{run:?}");
    let read: Vec<Record> = reader.map(Result::unwrap).collect();
    assert!(read.len() == 20 && read.iter().zip(&records[40..]).all(|(read, written)| read.is_same(written)));
}

#[test]
fn a_recovery_that_fails_leaves_nothing() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    // The whole one says more of itself than the torn one did: its depth file has a longer name.
    let out = folder.path().join(format!("{}.mcap", "o".repeat(200)));
    let fails = (2500..3000).rev().step_by(50).find(|&bytes| {
        let _ = fs::remove_file(&path);
        let long = About { source: "s".repeat(bytes), ..about(Some("a.depth.mcap")) };
        let mut writer = Writer::live(&path, Part::Small, &long, "").unwrap();
        writer.write(&Record::from(permit(1))).unwrap();
        writer.flush().unwrap();
        let recovered = recover(&path, &out);
        matches!(recovered, Err(RecoverError::Write(_)))
    });
    assert!(fails.is_some() && !out.exists(), "what could not be finished is gone: {fails:?}");
    fs::write(&out, "somebody's").unwrap();
    assert!(recover(&path, &out).is_err());
    assert_eq!(fs::read(&out).unwrap(), b"somebody's", "what was there stays");
}

#[test]
fn every_life_of_a_recorder_has_a_file_of_its_own() {
    assert_eq!(life_path(Path::new("/a/walk.mcap"), 1), Path::new("/a/walk.mcap"));
    assert_eq!(life_path(Path::new("/a/walk.mcap"), 3), Path::new("/a/walk.3.mcap"));
}
