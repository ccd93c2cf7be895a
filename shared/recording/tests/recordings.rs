//! Recordings as files: what goes in comes out, and what is no whole recording is told.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are not seen as tests")]

mod common;

use std::fs;

use common::{about, bits, chain, odometry, read, scan, write};
use guidedog_recording::{About, Existing, ReadError, Reader, Record, WriteError, Writer};
use messages::{MAX_BEAMS, TopicId};
use tempfile::tempdir;
use test_data::data;

/// Floats whose shortest decimals are hard to read back, by their bits.
fn hard_floats() -> Vec<f32> {
    let mut bits = 0x9E37_79B9_u32;
    let random = std::iter::repeat_with(|| {
        bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f32::from_bits(bits)
    });
    let special =
        [0.0, -0.0, 1e-45, f32::MIN_POSITIVE, 16_777_217.0, 81.91, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    special.into_iter().chain(random.take(4000)).collect()
}

#[test]
fn numbers_come_back_to_the_bit() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let records = [scan(0, 1, hard_floats()), odometry(0, u64::MAX), scan(7, 2, vec![]), odometry(u64::MAX, u64::MAX)];
    write(&path, &records);
    let back = read(&path);
    assert_eq!(back.iter().map(bits).collect::<Vec<_>>(), records.iter().map(bits).collect::<Vec<_>>());
}

#[test]
fn records_come_in_order_across_chunks() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut records = Vec::new();
    for seq in 1..=3000_u64 {
        // Stamps in pairs, so that some pairs are parted by the end of a chunk, the second of the pair first.
        let stamp_ns = seq / 2 * 1000;
        records.push(odometry(stamp_ns, 9000 - seq));
        records.push(scan(stamp_ns, 9000 - seq, vec![1.0 / seq as f32; 400]));
    }
    write(&path, &records);
    let mut back = Reader::open(&path).unwrap();
    assert_eq!(back.info().records[TopicId::LidarScan.name()], 3000);
    assert_eq!(back.info().duration_ns, 1_500_000);
    assert_eq!(back.info().about, about());
    records.sort_by_key(Record::order);
    for expected in &records {
        assert_eq!(bits(&back.next().unwrap().unwrap()), bits(expected));
    }
    assert!(back.next().is_none());
    assert!(fs::metadata(&path).unwrap().len() > 1000);
}

#[test]
fn an_empty_recording_is_one() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, &[]);
    assert!(read(&path).is_empty());
}

#[test]
fn a_file_is_replaced_only_when_told_and_only_by_a_whole_one() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, &[odometry(1, 1)]);
    assert!(matches!(Writer::create(&path, Existing::Refuse), Err(WriteError::Exists { .. })));
    let before = fs::read(&path).unwrap();
    let mut writer = Writer::create(&path, Existing::Replace).unwrap();
    writer.write(&odometry(2, 1)).unwrap();
    writer.flush().unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "the unfinished one stands beside");
    drop(writer);
    assert_eq!(fs::read(&path).unwrap(), before);
    let writer = Writer::create(&path, Existing::Replace).unwrap();
    writer.finish(about()).unwrap();
    assert!(read(&path).is_empty());
    let late = folder.path().join("b.mcap");
    let writer = Writer::create(&late, Existing::Refuse).unwrap();
    fs::write(&late, "somebody else's").unwrap();
    assert!(matches!(writer.finish(about()), Err(WriteError::Exists { .. })));
    assert_eq!(fs::read(&late).unwrap(), b"somebody else's");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
}

#[test]
fn too_many_beams_are_refused_and_the_recording_goes_on() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = Writer::create(&path, Existing::Refuse).unwrap();
    let error = writer.write(&scan(5, 6, vec![1.0; MAX_BEAMS + 1])).unwrap_err().to_string();
    assert!(error.contains("record 6 of lidar/scan at 5 ns") && error.contains("4097 ranges"), "{error}");
    writer.write(&scan(5, 6, vec![1.0; MAX_BEAMS])).unwrap();
    writer.finish(about()).unwrap();
    assert_eq!(read(&path).len(), 1);
}

/// Reads all of it; the error, if there is one.
fn try_read(path: &std::path::Path) -> Result<usize, ReadError> {
    let mut count = 0;
    for record in Reader::open(path)? {
        record?;
        count += 1;
    }
    Ok(count)
}

#[test]
fn what_is_no_recording_is_told_with_its_name() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let told = |expected: &str| {
        let error = chain(&try_read(&path).unwrap_err());
        assert!(error.contains("x.mcap") && error.contains(expected), "{error}");
    };
    told("No such file");
    fs::write(&path, "").unwrap();
    told("is empty");
    fs::write(&path, "FLASER 3 1.0").unwrap();
    told("does not begin with MCAP's magic bytes (byte 0)");
    fs::write(&path, b"\x89MCAP0\r\n").unwrap();
    told("is torn: it ends at byte 8");
    let mut other = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    other.finish().unwrap();
    fs::write(&path, other.into_inner().into_inner()).unwrap();
    told("it has no metadata named `guidedog`");
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    told("is not a file");
}

#[test]
fn a_torn_or_changed_file_is_told_and_never_panics() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    write(&path, &[scan(0, 1, hard_floats()[..300].to_vec()), odometry(1, 1), odometry(2, 2)]);
    let whole = fs::read(&path).unwrap();
    for cut in (0..whole.len()).step_by(97).chain(whole.len() - 60..whole.len()) {
        fs::write(&path, &whole[..cut]).unwrap();
        let error = try_read(&path).unwrap_err();
        match cut {
            0 => assert!(matches!(error, ReadError::Empty { .. })),
            1..8 => assert!(matches!(error, ReadError::NotMcap { .. })),
            _ => assert!(matches!(error, ReadError::Torn { bytes, .. } if bytes == cut as u64), "{cut}: {error}"),
        }
    }
    let mut told = 0;
    for at in (0..whole.len()).step_by(7).chain(whole.len() - 2000..whole.len()) {
        for flip in [1, 0x80, 0xFF] {
            let mut changed = whole.clone();
            changed[at] ^= flip;
            fs::write(&path, &changed).unwrap();
            told += usize::from(try_read(&path).is_err());
        }
    }
    assert!(told > whole.len() / 7, "most changes are told: {told} of {} bytes", whole.len());
}

#[test]
fn a_change_inside_a_chunk_is_told_with_its_byte() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    write(&path, &[scan(0, 1, hard_floats())]);
    let mut changed = fs::read(&path).unwrap();
    let middle = changed.len() / 2;
    changed[middle] ^= 1;
    fs::write(&path, changed).unwrap();
    let error = try_read(&path).unwrap_err().to_string();
    assert!(error.contains("x.mcap is damaged at byte"), "{error}");
}

#[test]
fn the_schemas_are_foxgloves() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, &[scan(1_500_000_000, 1, vec![1.0, f32::NAN]), odometry(1_500_000_000, 1)]);
    let bytes = fs::read(&path).unwrap();
    let mut seen = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((schema.encoding.as_str(), message.channel.message_encoding.as_str()), ("jsonschema", "json"));
        assert_eq!(message.log_time, 1_500_000_000);
        let schema_json: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
        assert_eq!(schema_json["title"], schema.name);
        let json: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        for member in json.as_object().unwrap().keys() {
            assert!(schema_json["properties"][member].is_object(), "{member} is in the schema");
        }
        assert_eq!((&json["timestamp"]["sec"], &json["timestamp"]["nsec"]), (&1.into(), &500_000_000.into()));
        seen.push((message.channel.topic.clone(), schema.name.clone()));
    }
    let expected = [("lidar/scan", "foxglove.LaserScan"), ("odometry", "foxglove.FrameTransform")];
    assert_eq!(seen, expected.map(|(topic, schema)| (topic.to_owned(), schema.to_owned())));
}

#[test]
fn a_foreign_real_file_is_told() {
    let Some(path) = data("lidar/radish_aces.clf.bz2") else { return };
    assert!(matches!(try_read(&path), Err(ReadError::NotMcap { .. })));
}

#[test]
fn what_a_recording_says_of_itself_is_bounded() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let mut writer = Writer::create(&path, Existing::Refuse).unwrap();
    writer.write(&scan(5, 1, vec![1.0; 8])).unwrap();
    let error = writer.finish(About { source: "s".repeat(4000), ..about() }).unwrap_err();
    assert!(chain(&error).contains("over 3000") && !path.exists(), "{error}");
}
