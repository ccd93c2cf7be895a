//! CARMEN logs as files: real ones and broken ones.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are not seen as tests")]

mod common;

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;
use std::{fs, io};

use common::{bits, chain, read};
use guidedog_recording::carmen::{Clock, ImportError, ImportOptions, ImportReport, import};
use guidedog_recording::{Existing, Reader, Record};
use messages::{Odometry, ScanHeader};
use tempfile::{TempDir, tempdir};
use test_data::data;

/// A folder with a log in it.
struct Bench {
    folder: TempDir,
    log: PathBuf,
    out: PathBuf,
}

impl Bench {
    fn new(log: impl AsRef<[u8]>) -> Self {
        let folder = tempdir().unwrap();
        let (path, out) = (folder.path().join("x.clf"), folder.path().join("x.mcap"));
        fs::write(&path, log).unwrap();
        Self { folder, log: path, out }
    }

    fn import(&self) -> Result<ImportReport, ImportError> {
        import(&self.log, &self.out, ImportOptions::default())
    }

    fn import_truncated(&self) -> Result<ImportReport, ImportError> {
        import(&self.log, &self.out, ImportOptions { existing: Existing::Replace, allow_truncated: true })
    }

    fn files(&self) -> usize {
        fs::read_dir(self.folder.path()).unwrap().count()
    }
}

/// A scan of 180 readings.
fn flaser(reading: &str, x_m: f64, ipc: &str, logger: &str) -> String {
    format!("FLASER 180{} 9 9 9 {x_m} 0 0 {ipc} robbie {logger}\n", format!(" {reading}").repeat(180))
}

/// A log whose scans come at these times.
fn log_at(times: &[(f64, f64)]) -> String {
    let lines = times.iter().enumerate();
    lines.map(|(i, (ipc, logger))| flaser("2.5", i as f64 * 0.1, &ipc.to_string(), &logger.to_string())).collect()
}

fn scans(path: &Path) -> Vec<(ScanHeader, Vec<f32>)> {
    let scan = |record| match record {
        Record::LidarScan(scan) => Some((scan.header, scan.data)),
        _ => None,
    };
    read(path).into_iter().filter_map(scan).collect()
}

fn odometry(path: &Path) -> Vec<Odometry> {
    let odometry = |record| match record {
        Record::Odometry(odometry) => Some(*odometry),
        _ => None,
    };
    read(path).into_iter().filter_map(odometry).collect()
}

fn stamps_s(path: &Path) -> Vec<f64> {
    scans(path).iter().map(|(header, _)| header.header.stamp_ns as f64 * 1e-9).collect()
}

/// A real log's report, and whether everything holds that must hold of any import.
fn import_real(name: &str) -> Option<ImportReport> {
    let log = data(&format!("lidar/radish_{name}.clf.bz2"))?;
    let folder = tempdir().unwrap();
    let out = folder.path().join("out.mcap");
    let begun = Instant::now();
    let report = import(&log, &out, ImportOptions::default()).unwrap();
    let seconds = begun.elapsed().as_secs_f64();
    println!("{name}: {seconds:.2} s, {} bytes: {report:#?}", fs::metadata(&out).unwrap().len());
    let mut reader = Reader::open(&out).unwrap();
    assert_eq!(reader.info().records["lidar/scan"], report.scans);
    assert_eq!(reader.info().records["odometry"], report.odometry);
    assert_eq!((reader.info().start_ns, &reader.info().about.anomalies), (0, &report.anomalies));
    let mut last = [(0, 0); 2];
    let mut scan_stamp_ns = None;
    for record in &mut reader {
        let record = record.unwrap();
        let header = *record.header();
        let kind = usize::from(matches!(record, Record::LidarScan(_)));
        assert!(last[kind].1 == 0 || header.stamp_ns > last[kind].0, "stamps rise");
        assert_eq!(header.seq, last[kind].1 + 1);
        last[kind] = (header.stamp_ns, header.seq);
        match record {
            Record::LidarScan(_) => scan_stamp_ns = Some(header.stamp_ns),
            Record::Odometry(odometry) => {
                assert!(odometry.twist.speed_mps() < 4.0 && odometry.twist.wz_radps.abs() < 7.0, "{odometry:?}");
                if scan_stamp_ns.take_if(|_| true).is_some_and(|stamp_ns| stamp_ns != header.stamp_ns) {
                    panic!("a scan without odometry at its stamp, at {} ns", header.stamp_ns);
                }
            }
            other => panic!("no {} is in such a log", other.topic()),
        }
    }
    Some(report)
}

#[test]
fn aces_is_imported() {
    let Some(report) = import_real("aces") else { return };
    assert_eq!((report.scans, report.beams, report.clock), (7374, 180, Clock::Ipc));
    assert_eq!((report.odometry, report.odometry + report.odometry_left_out), (12_200, 7374 + 7375));
    assert!((report.duration_s - 1365.72).abs() < 0.1 && (report.distance_m - 325.0).abs() < 0.5);
    assert!((report.longest_gap_s - 3.03).abs() < 0.01);
    assert_eq!(report.range_max_m, 50.0, "this log's ceiling");
    assert_eq!((report.anomalies["max_range_reading"], report.anomalies["gap"]), (11_139, 1));
    assert_eq!(report.anomalies["repeated_pose"], 2608);
    assert_eq!(report.first_wall_clock_s, None);
}

#[test]
fn fr079_is_imported() {
    let Some(report) = import_real("fr079") else { return };
    assert_eq!((report.scans, report.beams, report.clock), (4934, 360, Clock::Ipc));
    assert_eq!(report.odometry + report.odometry_left_out, 4934 + 8951);
    assert!((report.duration_s - 1061.7).abs() < 0.1 && (report.distance_m - 391.6).abs() < 0.5);
    assert_eq!(report.robot_from_lidar_x_m, -0.04);
    assert_eq!(report.range_max_m, f64::from(80.99_f32), "this log's parameter");
    assert_eq!((report.anomalies["max_range_reading"], report.anomalies["repeated_pose"]), (36_881, 142));
    assert_eq!(report.first_wall_clock_s, Some(1_071_078_718.462_31));
    assert_eq!(report.robot, "magnum");
}

#[test]
fn mit_csail_is_imported() {
    let Some(report) = import_real("mit-csail") else { return };
    assert_eq!((report.scans, report.odometry, report.beams), (1988, 1988, 361));
    assert!((report.duration_s - 424.0).abs() < 0.1 && (report.distance_m - 373.6).abs() < 0.5);
    assert_eq!((report.range_max_m, report.anomalies["max_range_reading"]), (81.0, 23_711));
    assert_eq!(report.first_wall_clock_s, Some(1_134_864_629.895_182));
}

#[test]
fn a_log_reads_the_same_whatever_it_is_compressed_with() {
    let plain =
        format!("# a log\nPARAM robot_frontlaser_offset 0.17 nohost 0\r\n{}", log_at(&[(5.0, 0.0), (5.2, 0.2)]));
    let bzip2 = |bytes: &[u8]| {
        let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    };
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(plain.as_bytes()).unwrap();
    // In two streams, as pbzip2 writes it, parted in the middle of a line.
    let (first, second) = plain.as_bytes().split_at(plain.len() / 2);
    let logs = [
        plain.clone().into_bytes(),
        bzip2(plain.as_bytes()),
        [bzip2(first), bzip2(second)].concat(),
        gzip.finish().unwrap(),
    ];
    let read = logs.map(|log| {
        let bench = Bench::new(log);
        let report = bench.import().unwrap();
        assert_eq!((report.lines, report.robot_from_lidar_x_m), (4, 0.17));
        read(&bench.out).iter().map(bits).collect::<Vec<_>>()
    });
    assert_eq!(read[0].len(), 4);
    assert!(read.iter().all(|other| *other == read[0]));
}

#[test]
fn the_beams_are_where_carmen_says() {
    for (count, last_deg, increment_deg) in [(180, 89.0, 1.0), (181, 90.0, 1.0), (360, 89.5, 0.5), (361, 90.0, 0.5)] {
        let bench = Bench::new(format!("FLASER {count}{} 0 0 0 0 0 0 1 r 1\n", " 1.5".repeat(count)));
        bench.import().unwrap();
        let (header, ranges_m) = scans(&bench.out).remove(0);
        assert_eq!((ranges_m.len(), header.angle_min_rad), (count, -0.5 * PI));
        assert!((header.angle_increment_rad.to_degrees() - increment_deg).abs() < 1e-12);
        let last_rad = header.angle_min_rad + header.angle_increment_rad * (count - 1) as f64;
        assert!((last_rad.to_degrees() - last_deg).abs() < 1e-9);
    }
}

#[test]
fn odd_readings_are_counted_and_kept_apart() {
    let mut log = String::from("FLASER 180 -1 nan -inf inf 0 81.0 81.91 80.9");
    let _ = writeln!(log, "{} 0 0 0 0 0 0 1 r 1", " 1.5".repeat(172));
    log += &format!("FLASER 181{} 0 0 0 0 0 0 1.2 r 1.2\n", " 1.5".repeat(181));
    log += &format!("FLASER 90{} 0 0 0 0 0 0 1.4 r 1.4\nBLAH 1\nRLASER 7\n", " 1.5".repeat(90));
    let bench = Bench::new(log);
    let report = bench.import().unwrap();
    let count = |kind: &str| report.anomalies[kind];
    assert_eq!((count("unknown_reading"), count("zero_reading"), count("max_range_reading")), (3, 1, 3));
    assert_eq!((count("beam_count_changed"), count("unusual_beam_count"), count("unknown_message")), (2, 1, 1));
    assert_eq!((report.skipped["BLAH"], report.skipped["RLASER"]), (1, 1));
    let scans = scans(&bench.out);
    let ranges_m = &scans[0].1;
    assert!(ranges_m[..3].iter().all(|range_m| range_m.is_nan()));
    assert_eq!(ranges_m[3..8], [f32::INFINITY, 0.0, 81.0, 81.91, 80.9]);
    assert_eq!(scans[1].1.len(), 181);
    assert!((scans[2].0.angle_increment_rad.to_degrees() - 2.0).abs() < 1e-12);
}

#[test]
fn a_wall_is_not_taken_for_the_ceiling() {
    let bench = Bench::new(log_at(&[(1.0, 1.0)]));
    assert_eq!(bench.import().unwrap().range_max_m, 81.0, "every reading equals the greatest, 2.5 m");
}

#[test]
fn twists_come_from_the_robot_or_from_its_poses() {
    let odom = |x_m: f64, tv: f64, time_s: f64| format!("ODOM {x_m} 0 0 {tv} 0.25 0 {time_s} r {time_s}\n");
    let log: String = (0..20).map(|i| odom(0.1 * f64::from(i), 0.9, 0.2 * f64::from(i))).collect();
    let bench = Bench::new(log + &flaser("1", 1.95, "3.9", "3.9"));
    bench.import().unwrap();
    let all = odometry(&bench.out);
    assert_eq!(all.len(), 21);
    assert!(all.iter().all(|odometry| odometry.twist.vx_mps == 0.9 && odometry.twist.wz_radps == 0.25));

    let times: Vec<_> = (0..20).map(|i| (0.2 * f64::from(i), 0.0)).collect();
    let bench = Bench::new(log_at(&times));
    bench.import().unwrap();
    let all = odometry(&bench.out);
    assert!(all[0].twist.is_zero());
    assert!(all[1..].iter().all(|odometry| (odometry.twist.vx_mps - 0.5).abs() < 1e-9), "{all:?}");
}

#[test]
fn a_clock_that_steps_or_slips_costs_no_scan_and_no_time() {
    type Case = (&'static str, &'static [(f64, f64)], &'static str, &'static [f64]);
    let cases: [Case; 6] = [
        (
            "one stamp is back",
            &[(9.0, 0.0), (9.2, 0.2), (3.0, 0.4), (9.6, 0.6)],
            "clock_backwards",
            &[0.0, 0.2, 0.200_001, 0.6],
        ),
        (
            "the clock is set back",
            &[(9.0, 0.0), (9.2, 0.2), (3.0, 0.4), (3.2, 0.6)],
            "clock_backwards",
            &[0.0, 0.2, 0.4, 0.6],
        ),
        ("no other clock", &[(9.0, 0.0), (9.2, 0.0), (3.0, 0.0), (3.2, 0.0)], "clock_backwards", &[0.0, 0.2, 0.4, 0.6]),
        (
            "the clock is set forward",
            &[(9.0, 0.0), (9.2, 0.2), (99.4, 0.4), (99.6, 0.6)],
            "clock_forwards",
            &[0.0, 0.2, 0.4, 0.6],
        ),
        (
            "one stamp is ahead",
            &[(9.0, 0.0), (9.2, 0.0), (99.4, 0.0), (9.6, 0.0)],
            "clock_forwards",
            &[0.0, 0.2, 0.200_001, 0.6],
        ),
        (
            "a stamp comes again",
            &[(9.0, 0.0), (9.2, 0.2), (9.2, 0.2), (9.2, 0.2), (9.4, 0.4)],
            "repeated_stamp",
            &[0.0, 0.2, 0.200_001, 0.200_002, 0.4],
        ),
    ];
    for (case, times, kind, expected) in cases {
        // Enough good stamps after, that the logger's clock is no choice.
        let (ipc_s, logger_s) = times[times.len() - 1];
        let more =
            (1..100).map(|i| 0.2 * f64::from(i)).map(|s| (ipc_s + s, if logger_s == 0.0 { 0.0 } else { logger_s + s }));
        let bench = Bench::new(log_at(&times.iter().copied().chain(more).collect::<Vec<_>>()));
        let report = bench.import().unwrap();
        assert_eq!((report.clock, report.scans), (Clock::Ipc, times.len() as u64 + 99), "{case}");
        assert_eq!(report.anomalies[kind], if kind == "repeated_stamp" { 2 } else { 1 }, "{case}");
        assert_eq!(report.anomalies["gap"], 0, "{case}");
        let stamps_s = stamps_s(&bench.out);
        for (stamp_s, expected_s) in stamps_s.iter().zip(expected) {
            assert!((stamp_s - expected_s).abs() < 1e-7, "{case}: {:?}", &stamps_s[..times.len()]);
        }
    }
}

#[test]
fn a_clock_that_stands_still_gives_way_to_the_other() {
    let times: Vec<_> = (0..50).map(|i| (7.0, 0.2 * f64::from(i))).collect();
    let bench = Bench::new(log_at(&times));
    let report = bench.import().unwrap();
    assert_eq!((report.clock, report.anomalies["repeated_stamp"]), (Clock::Logger, 0));
    assert!((report.duration_s - 9.8).abs() < 1e-6);
}

#[test]
fn a_bad_line_is_told_with_its_number_and_leaves_nothing_behind() {
    let good = flaser("1.5", 0.0, "1", "1");
    let cases = [
        (
            flaser("1.5", 0.0, "1.2", "1.2").replace("FLASER 180", "FLASER 181"),
            "line 3: FLASER announces 181 readings, and its fields leave 180",
        ),
        (
            "FLASER 4 1 1 1 1 0 0 0 0 0 0 1 r 1\n".to_owned(),
            "line 3: FLASER announces \"4\" readings; a scan has 30 to",
        ),
        ("FLASER 99999999999999999999 1\n".to_owned(), "line 3: FLASER announces \"99999999999999999999\" readings"),
        ("FLASER -5 1\n".to_owned(), "line 3: FLASER announces \"-5\" readings"),
        ("FLASER\n".to_owned(), "line 3: FLASER ends before its field num_readings"),
        (
            flaser("1.5", 0.0, "1", "1").replacen("1.5", "1,5", 1),
            "line 3: FLASER field range is \"1,5\", which is no number",
        ),
        (flaser("1.5", f64::NAN, "1", "1"), "line 3: FLASER field odom_x is \"NaN\""),
        (flaser("1.5", 0.0, "inf", "1"), "line 3: FLASER field ipc_time is \"inf\""),
        (flaser("1.5", 0.0, "1", "1e300"), "line 3: FLASER field logger_time is \"1e300\""),
        ("ODOM 1 2\n".to_owned(), "line 3: ODOM ends before its field theta"),
        ("ODOM 1 2 3 4 x 6 7 r 8\n".to_owned(), "line 3: ODOM field rv is \"x\""),
        ("ODOM 1 2 3 4 5 6 7 r 8 9\n".to_owned(), "line 3: ODOM goes on after its last field"),
        (
            "PARAM robot_frontlaser_offset far r 0\n".to_owned(),
            "line 3: PARAM field robot_frontlaser_offset is \"far\"",
        ),
        ("PARAM robot_front_laser_max 0.1 r 0\n".to_owned(), "line 3: PARAM field robot_front_laser_max is \"0.1\""),
        ("X".repeat(3 << 20), "line 3: the line is over 1 MiB long"),
    ];
    for (bad, expected) in cases {
        let bench = Bench::new(format!("# a log\n{good}{bad}{good}"));
        let error = chain(&bench.import().unwrap_err());
        assert!(error.contains("x.clf ") && error.contains(expected), "{error}\nis not\n{expected}");
        assert_eq!(bench.files(), 1, "nothing but the log");
        assert!(matches!(bench.import_truncated(), Err(ImportError::Line { line: 3, .. })), "not a truncated log");
    }
}

#[test]
fn what_is_no_log_is_told() {
    let cases: [(&[u8], &str); 7] = [
        (b"# only words\n\nhello there\n", "is not a CARMEN log: line 3 begins with \"hello\""),
        (b"\x00\xFF\xFE\x01\n", "is not a CARMEN log: line 1 begins with"),
        (b"", "holds no scan: not one of its 0 lines is a FLASER message"),
        (b"# nothing\n", "holds no scan: not one of its 1 lines"),
        (b"ROBOTLASER1 1\nODOM 1 2 3 4 5 6 7 r 8\n", "is a FLASER message (not imported: 1 ROBOTLASER1)"),
        (b"BZh9no bzip2, whatever it begins with", "failed to read"),
        (b"\x1f\x8b", "its compressed data ends early, after 0 whole lines"),
    ];
    for (log, expected) in cases {
        let bench = Bench::new(log);
        let error = chain(&bench.import().unwrap_err());
        assert!(error.contains("x.clf") && error.contains(expected), "{error}\nis not\n{expected}");
        assert_eq!(bench.files(), 1);
    }
    let folder = tempdir().unwrap();
    let import = |log: &Path| import(log, &folder.path().join("out.mcap"), ImportOptions::default()).unwrap_err();
    assert!(matches!(import(folder.path()), ImportError::NotAFile { .. }));
    let missing = import(&folder.path().join("missing.clf"));
    assert!(matches!(missing, ImportError::Read { ref source, .. } if source.kind() == io::ErrorKind::NotFound));
}

#[test]
fn a_truncated_log_is_refused_or_taken_as_far_as_it_goes() {
    let whole = log_at(&[(1.0, 1.0), (1.2, 1.2), (1.4, 1.4)]);
    for cut in [3, 12, 400, whole.len() / 3 - 12, whole.len() / 3 - 4] {
        let bench = Bench::new(&whole[..whole.len() / 3 * 2 + cut]);
        let error = bench.import().unwrap_err();
        assert!(matches!(error, ImportError::TruncatedLine { line: 3, .. }), "{cut}: {error}");
        assert!(error.to_string().ends_with("x.clf is truncated: it ends inside line 3"));
        let report = bench.import_truncated().unwrap();
        assert_eq!((report.scans, report.truncated_at_line), (2, Some(3)));
        assert_eq!(scans(&bench.out).len(), 2);
    }
    let bench = Bench::new(whole.trim_end());
    assert_eq!(bench.import().unwrap().scans, 3, "a last line without an end may be whole");
}

#[test]
fn a_truncated_stream_is_refused_or_taken_as_far_as_it_goes() {
    let Some(path) = data("lidar/radish_fr079.clf.bz2") else { return };
    let packed = fs::read(path).unwrap();
    let bench = Bench::new(&packed[..packed.len() / 2]);
    let Err(ImportError::TruncatedStream { lines, .. }) = bench.import() else { panic!("a half file was taken") };
    let report = bench.import_truncated().unwrap();
    assert_eq!((report.lines, report.truncated_at_line), (lines, Some(lines + 1)));
    assert!(report.scans > 1000 && report.scans < 4934, "{}", report.scans);

    let mut changed = packed.clone();
    changed[packed.len() / 2] ^= 0xFF;
    let bench = Bench::new(changed);
    let error = bench.import().unwrap_err();
    // A block's checksum comes after its lines, the first of which may already make no sense.
    assert!(matches!(error, ImportError::Read { lines: 1.., .. } | ImportError::Line { .. }), "{error:?}");
    assert_eq!(bench.files(), 1);
}

#[test]
fn a_recording_is_not_written_over_a_file() {
    let bench = Bench::new(log_at(&[(1.0, 1.0)]));
    bench.import().unwrap();
    assert!(matches!(bench.import(), Err(ImportError::Write(_))));
    let options = ImportOptions { existing: Existing::Replace, ..ImportOptions::default() };
    import(&bench.log, &bench.out, options).unwrap();
    assert!(matches!(import(&bench.log, &bench.log, options), Err(ImportError::SameFile { .. })));
    let nowhere = bench.folder.path().join("no/such/folder.mcap");
    let error = chain(&import(&bench.log, &nowhere, options).unwrap_err());
    assert!(error.contains("folder.mcap") && error.contains("No such file"), "{error}");
}

#[test]
fn no_change_of_a_log_makes_it_panic() {
    let log = format!("ODOM 1 2 3 4 5 6 0.9 r 0.9\n{}", log_at(&[(1.0, 1.0), (1.2, 1.2), (1.4, 1.4)]));
    let mut random = 7_u64;
    let mut below = |most: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % most
    };
    let mut taken = 0;
    for _ in 0..300 {
        let mut changed = log.clone().into_bytes();
        for _ in 0..=below(3) {
            let (at, with) = (below(changed.len()), b"\n 9-.enNaA\x00\xFF"[below(12)]);
            changed[at] = with;
        }
        let bench = Bench::new(changed);
        if bench.import_truncated().is_ok() {
            taken += 1;
            assert!(!scans(&bench.out).is_empty());
        }
    }
    assert!((1..300).contains(&taken), "{taken}");
}
