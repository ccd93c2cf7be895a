//! 16 pairs of samples in five bytes each: two ranges in quarters of a millimetre, the two lowest bits of each being
//! the highest of what is taken off its angle, in 1/8 degrees; the other four bits of both are in the last byte.

use super::capsule::{self, Capsule};
use super::{FirstOfFrame, Format, Sample, Spot, Sweep, range_q2, sample};

const CABIN_BYTES: usize = 5;
/// The two lowest bits of a range are the angle's.
const ANGLE_BITS: u16 = 0x3;

pub(super) fn decode(capsule: &Capsule, sweep: &Sweep, out: &mut Vec<Sample>) {
    for (i, cabin) in capsule.cabins().chunks_exact(CABIN_BYTES).enumerate() {
        let words = [u16::from_le_bytes([cabin[0], cabin[1]]), u16::from_le_bytes([cabin[2], cabin[3]])];
        let low = [cabin[4] & 0xf, cabin[4] >> 4];
        for half in 0..2 {
            let ahead_q3 = (words[half] & ANGLE_BITS) << 4 | u16::from(low[half]);
            let at = Spot { ahead_q16: i64::from(ahead_q3) << 13, ..sweep.at(2 * i + half) };
            out.push(sample(at, i32::from(words[half] & !ANGLE_BITS), None));
        }
    }
}

/// Writes samples whose angles need no correction.
pub(super) fn encode(first: FirstOfFrame, samples: &[Sample], out: &mut Vec<u8>) {
    capsule::encode(Format::Express, first, out, |out| {
        for pair in samples.chunks_exact(2) {
            for sample in pair {
                let range = range_q2(sample).clamp(0, i64::from(u16::MAX)) as u16;
                out.extend((range & !ANGLE_BITS).to_le_bytes());
            }
            out.push(0);
        }
    });
}
