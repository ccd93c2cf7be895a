//! Whatever comes over a device's line: the lidar's conversation and its samples, in pieces of any size; a robot's
//! messages.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rplidar::{Beams, Decoder, Fan, Format, Requests, Session, Timing, Turns, Wanted};

const MS: u64 = 1_000_000;

fuzz_target!(|input: &[u8]| {
    let [piece, mode, bytes @ ..] = input else { return };
    let size = usize::from(*piece).max(1);
    let beams = Beams { count: 360, angle_min_rad: -3.2, angle_increment_rad: 0.0175 };
    let (mut turns, mut fan) = (Turns::default(), Fan::new(beams, 0.1));
    let mut samples = Vec::new();
    let wanted = Wanted { baud: 115_200, mode: (*mode > 127).then(|| "Boost".to_owned()), motor_rpm: 600, searches: *mode > 191 };
    let mut session = Session::new(wanted, 0);
    for (i, piece) in bytes.chunks(size).enumerate() {
        let now_ns = i as u64 * u64::from(*mode) * MS;
        session.received(now_ns, piece, &mut samples);
        session.tick(now_ns);
        while session.next_to_do().is_some() {}
    }
    for format in Format::ALL {
        let mut decoder = Decoder::new(format, Timing { sample_ns: 62_500, byte_ns: 10_000 });
        for (i, piece) in bytes.chunks(size).enumerate() {
            decoder.push(piece, i as u64 * MS, &mut samples);
        }
    }
    for sample in &samples {
        assert!((0.0..360.0).contains(&sample.angle_deg) && sample.range_m.is_none_or(|range_m| range_m > 0.0));
        if let Some(turn) = turns.push(sample) {
            turn.iter().for_each(|sample| fan.enter(sample));
            assert_eq!(fan.ranges_m().len(), beams.count);
        }
    }
    let _ = Requests::default().push(bytes);
    for profile in unitree::Profile::ALL {
        let _ = unitree::State::decode(profile, bytes);
        let _ = unitree::Command::decode(profile, bytes);
    }
});
