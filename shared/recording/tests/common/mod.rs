//! What the tests share.

#![allow(dead_code, reason = "each test file uses its own part")]

use std::path::Path;

use guidedog_recording::{About, Existing, Reader, Record, Slice, Writer};
use messages::{Attitude, Header, LidarScan, Odometry, Pose2, ScanHeader, SecondScanHeader, Twist2};

pub fn header(stamp_ns: u64, seq: u64) -> Header {
    Header { stamp_ns, seq, step: 3, published_ns: 0, incarnation: 2, reserved: 0 }
}

pub fn scan(stamp_ns: u64, seq: u64, ranges_m: Vec<f32>) -> Record {
    let header = ScanHeader {
        header: header(stamp_ns, seq),
        angle_min_rad: -std::f64::consts::FRAC_PI_2,
        angle_increment_rad: std::f64::consts::PI / 180.0,
        range_min_m: 0.02,
        range_max_m: 81.0,
        sigma_m: 0.025,
        robot_from_lidar: Pose2::new(0.1 + 0.2, -1.0 / 3.0, 1e-17),
        height_m: 0.0,
    };
    Slice::<LidarScan> { header, data: ranges_m }.into()
}

pub fn odometry(stamp_ns: u64, seq: u64) -> Record {
    Record::from(Odometry {
        header: header(stamp_ns, seq),
        odom_from_robot: Pose2::new(seq as f64 / 7.0, -0.0, std::f64::consts::PI),
        twist: Twist2 { vx_mps: 5e-324, vy_mps: f64::MIN_POSITIVE, wz_radps: f64::NEG_INFINITY },
        sigma: [f64::NAN, f64::INFINITY, 0.3],
        attitude: Attitude::default(),
    })
}

pub fn about() -> About {
    About { source: "a log".to_owned(), robot: "spot".to_owned(), field_of_view_rad: 3.1, ..About::default() }
}

pub fn write(path: &Path, records: &[Record]) {
    let mut writer = Writer::create(path, Existing::Refuse).unwrap();
    for record in records {
        writer.write(record).unwrap();
    }
    writer.finish(about()).unwrap();
}

pub fn read(path: &Path) -> Vec<Record> {
    Reader::open(path).unwrap().collect::<Result<_, _>>().unwrap()
}

/// Every number of a record as its bits, with all NaNs alike.
pub fn bits(record: &Record) -> Vec<u64> {
    let real = |number: f64| if number.is_nan() { u64::MAX } else { number.to_bits() };
    let pose = |pose: &Pose2| [real(pose.x_m), real(pose.y_m), real(pose.yaw_rad)];
    let h = record.header();
    let mut bits = vec![record.topic() as u64, h.stamp_ns, h.seq, h.step, u64::from(h.incarnation)];
    match record {
        Record::LidarScan(scan) => {
            let s = &scan.header;
            bits.extend([s.angle_min_rad, s.angle_increment_rad, s.range_min_m, s.range_max_m, s.sigma_m].map(real));
            bits.extend(pose(&s.robot_from_lidar));
            bits.extend(scan.data.iter().map(|r| if r.is_nan() { u64::MAX } else { u64::from(r.to_bits()) }));
        }
        Record::SecondScan(scan) => {
            let SecondScanHeader { scan: s, pitch_rad, .. } = &scan.header;
            bits.extend([s.angle_min_rad, s.height_m, *pitch_rad].map(real));
            bits.extend(pose(&s.robot_from_lidar));
            bits.extend(scan.data.iter().map(|r| if r.is_nan() { u64::MAX } else { u64::from(r.to_bits()) }));
        }
        Record::Odometry(o) => {
            bits.extend(pose(&o.odom_from_robot));
            bits.extend([o.twist.vx_mps, o.twist.vy_mps, o.twist.wz_radps].map(real));
            bits.extend(o.sigma.map(real));
        }
        other => panic!("no {} in these tests", other.topic()),
    }
    bits
}

/// An error with its causes.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text = format!("{text}: {error}");
        source = error.source();
    }
    text
}
