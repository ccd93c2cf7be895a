//! 32 words of three samples each: one range that is told coarser the farther, and two as differences from it and from
//! the next word's. The lidar's geometry is not corrected in it yet: the angle is ahead by what the range tells.

use std::f64::consts::PI;

use super::capsule::{self, Capsule};
use super::{FirstOfFrame, Format, Sample, Spot, Sweep, range_q2, sample};

const CABIN_BYTES: usize = 4;
const MAJOR_MASK: u32 = 0xfff;
/// Two values of the ten-bit differences say that nothing came back.
const PREDICT_NONE: [i32; 2] = [-512, 511];

/// Coarser steps from a range on: (range in millimetres, code there, millimetres of a step as a power of two).
const SCALES: [(u32, u32, u32); 5] =
    [(1 << 14, 3328, 4), (1 << 12, 1792, 3), (1 << 11, 1280, 2), (1 << 9, 512, 1), (0, 0, 0)];

/// A range in millimetres, and how coarse it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Major {
    range_mm: i32,
    shift: u32,
}

fn decode_major(code: u32) -> Major {
    let (from_mm, from_code, shift) = scale(|(_, from_code, _)| code >= from_code);
    Major { range_mm: (from_mm + ((code - from_code) << shift)) as i32, shift }
}

fn encode_major(range_mm: u32) -> u32 {
    let (from_mm, from_code, shift) = scale(|(from_mm, ..)| range_mm >= from_mm);
    (from_code + ((range_mm - from_mm) >> shift)).min(MAJOR_MASK)
}

/// The coarsest that applies; the last one always does.
fn scale(applies: impl Fn((u32, u32, u32)) -> bool) -> (u32, u32, u32) {
    SCALES.into_iter().find(|scale| applies(*scale)).unwrap_or((0, 0, 0))
}

/// The samples of a capsule; the difference of the last one is from the first of the next.
pub(super) fn decode(capsule: &Capsule, next: &Capsule, sweep: &Sweep, out: &mut Vec<Sample>) {
    let words = capsule.cabins().chunks_exact(CABIN_BYTES).chain(next.cabins().chunks_exact(CABIN_BYTES).take(1));
    let words: [u32; 33] = collect(words.map(|cabin| u32::from_le_bytes([cabin[0], cabin[1], cabin[2], cabin[3]])));
    for (i, pair) in words.windows(2).enumerate() {
        let [here, after] = [pair[0], pair[1]].map(|word| decode_major(word & MAJOR_MASK));
        // Where nothing came back here, both are told from the next.
        let base = if here.range_mm == 0 && after.range_mm != 0 { after } else { here };
        let predicts = [(pair[0] << 10) as i32 >> 22, pair[0] as i32 >> 22];
        let ranges_mm = [here.range_mm, predicted(predicts[0], base), predicted(predicts[1], after)];
        for (third, range_mm) in ranges_mm.into_iter().enumerate() {
            let range_q2 = range_mm << 2;
            let at = Spot { ahead_q16: ahead_q16(range_q2), ..sweep.at(3 * i + third) };
            out.push(sample(at, range_q2, None));
        }
    }
}

fn collect(words: impl Iterator<Item = u32>) -> [u32; 33] {
    let mut all = [0; 33];
    all.iter_mut().zip(words).for_each(|(slot, word)| *slot = word);
    all
}

fn predicted(predict: i32, base: Major) -> i32 {
    if PREDICT_NONE.contains(&predict) { 0 } else { (predict << base.shift) + base.range_mm }
}

/// How far a reading's raw angle is ahead of where it was measured, 1/65536 degrees: the laser sits beside the axis.
fn ahead_q16(range_q2: i32) -> i64 {
    const NEAREST_Q2: i32 = 50 * 4;
    let whole = f64::from(1 << 16);
    let ahead_rad_q16 = if range_q2 >= NEAREST_Q2 {
        let k = 98361 / range_q2;
        (8.0 * PI * whole / 180.0) as i32 - (k << 6) - k * k * k / 98304
    } else {
        (7.5 * PI * whole / 180.0) as i32
    };
    (f64::from(ahead_rad_q16) * 180.0 / PI) as i64
}

/// How far the raw angle of a reading in [`Format::Ultra`] is ahead of where it was measured, degrees.
#[must_use]
pub fn angle_ahead_deg(range_m: Option<f32>) -> f64 {
    ahead_q16(range_m.map_or(0, |range_m| (range_m * 4000.0) as i32)) as f64 / f64::from(1 << 16)
}

/// Writes samples; what a difference cannot tell is told as nothing that came back.
pub(super) fn encode(first: FirstOfFrame, samples: &[Sample], next: &Sample, out: &mut Vec<u8>) {
    let range_mm = |sample: &Sample| ((range_q2(sample) + 2) / 4).max(0) as i32;
    let code = |sample: &Sample| encode_major(range_mm(sample) as u32);
    capsule::encode(Format::Ultra, first, out, |out| {
        for (i, third) in samples.chunks_exact(3).enumerate() {
            let (here, after) = (code(&third[0]), code(samples.get(3 * i + 3).unwrap_or(next)));
            let (near, far) = (decode_major(here), decode_major(after));
            let base = if near.range_mm == 0 && far.range_mm != 0 { far } else { near };
            let predicts = [predict_bits(range_mm(&third[1]), base), predict_bits(range_mm(&third[2]), far)];
            out.extend((predicts[1] << 22 | predicts[0] << 12 | here).to_le_bytes());
        }
    });
}

fn predict_bits(range_mm: i32, base: Major) -> u32 {
    let predict = (range_mm - base.range_mm) >> base.shift;
    let tellable = range_mm > 0 && predict > PREDICT_NONE[0] && predict < PREDICT_NONE[1];
    (if tellable { predict } else { PREDICT_NONE[0] }) as u32 & 0x3ff
}

#[cfg(test)]
mod tests {
    use super::{Major, decode_major, encode_major};

    #[test]
    fn a_code_is_as_coarse_as_its_range_is_far() {
        for (code, range_mm, shift) in [
            (0x1e0, 0x1e0, 0),
            (0x20b, 0x216, 1),
            (0x219, 0x232, 1),
            (0x504, 0x810, 2),
            (0x507, 0x81c, 2),
            (0x51e, 0x878, 2),
        ] {
            assert_eq!(decode_major(code), Major { range_mm, shift });
        }
        assert!((0..=0xfff).all(|code| encode_major(decode_major(code).range_mm as u32) == code));
    }
}
