//! What emergency stops, cameras' programs, robots on DDS and the processes that speak for us there say.
#![no_main]

use camera::{HEAD_BYTES, Head, Raw, Trust};
use cdr_encoding::from_bytes;
use byteorder::LittleEndian;
use dds::ros2::{Odometry, TwistStamped};
use dds::sport::{LowState, Request, Response, SportModeState};
use guidedog_buttons::Keys;
use guidedog_estop::Heartbeat;
use libfuzzer_sys::fuzz_target;
use links::{FromBridge, ToBridge};

/// Frames of more pixels are as any other.
const PIXELS_MAX: usize = 1 << 16;

fuzz_target!(|input: &[u8]| {
    let [piece, options, bytes @ ..] = input else { return };
    let size = usize::from(*piece).max(1);
    let mut keys = Keys::new((options & 1 == 1).then_some(304), options & 3 == 3);
    let mut heartbeat = Heartbeat::new(0);
    for (i, piece) in bytes.chunks(size).enumerate() {
        let _ = keys.take(piece);
        if *options > 127 {
            keys.answered(piece);
        }
        let _ = heartbeat.take(piece, i as u64 * u64::from(*options) * 1_000_000);
    }
    let _ = (ToBridge::of(bytes), FromBridge::of(bytes));
    if let Some((head, pixels)) = bytes.split_first_chunk::<HEAD_BYTES>()
        && let Ok(head) = Head::read(head)
        && head.pixels() <= PIXELS_MAX
    {
        assert_eq!(Head::read(&head.bytes()).map(|again| again.bytes()), Ok(head.bytes()));
        let mut pixels_mm = vec![0; head.pixels()];
        let raw = Raw { bytes: pixels, row_bytes: size * 2, unit_mm: f32::from(*options) / 64.0 };
        let _ = raw.write_mm(&head, Trust::of_m([0.3, 6.0]), &mut pixels_mm);
    }
    let _ = from_bytes::<Request, LittleEndian>(bytes).map(|(request, _)| request.velocity());
    let _ = from_bytes::<Response, LittleEndian>(bytes);
    let _ = from_bytes::<TwistStamped, LittleEndian>(bytes);
    let _ = from_bytes::<LowState, LittleEndian>(bytes).map(|(state, _)| state.remote());
    for state in [
        from_bytes::<SportModeState, LittleEndian>(bytes).ok().and_then(|(state, _)| state.state()),
        from_bytes::<Odometry, LittleEndian>(bytes).ok().and_then(|(odometry, _)| odometry.state()),
    ]
    .into_iter()
    .flatten()
    {
        assert!(state.velocity.is_finite() && state.own_from_robot.is_finite());
    }
});
