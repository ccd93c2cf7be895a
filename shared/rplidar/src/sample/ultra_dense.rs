//! 32 pairs of samples in five bytes each: two low words and the four highest bits of both. The two lowest bits of a
//! sample's 20 say how coarse its range is; the farther, the fewer bits are left for the quality.

use super::capsule::{self, Capsule};
use super::{FirstOfFrame, Format, Sample, Sweep, range_q2, sample};

const CABIN_BYTES: usize = 5;

/// How the ranges from one distance on are told.
struct Scale {
    /// From here on, millimetres.
    from_mm: i64,
    /// Millimetres from one range to the next.
    step_mm: i64,
    /// Bits of the range, without the two of the scale.
    range_bits: u32,
}

const SCALES: [Scale; 4] = [
    Scale { from_mm: 0, step_mm: 2, range_bits: 10 },
    Scale { from_mm: 2046, step_mm: 3, range_bits: 11 },
    Scale { from_mm: 8187, step_mm: 4, range_bits: 12 },
    Scale { from_mm: 24567, step_mm: 5, range_bits: 13 },
];

pub(super) fn decode(capsule: &Capsule, sweep: &Sweep, out: &mut Vec<Sample>) {
    for (i, cabin) in capsule.cabins().chunks_exact(CABIN_BYTES).enumerate() {
        let high = [cabin[4] & 0xf, cabin[4] >> 4];
        for half in 0..2 {
            let low = u16::from_le_bytes([cabin[2 * half], cabin[2 * half + 1]]);
            let word = u32::from(high[half]) << 16 | u32::from(low);
            let which = (word & 3) as usize;
            let Scale { from_mm, step_mm, range_bits } = SCALES[which];
            let range = i64::from(word >> 2 & ((1 << range_bits) - 1));
            let quality = (word >> (2 + range_bits)) << which;
            let range_q2 = (4 * (from_mm + step_mm * range)) as i32;
            out.push(sample(sweep.at(2 * i + half), range_q2, Some(quality as u8)));
        }
    }
}

pub(super) fn encode(first: FirstOfFrame, samples: &[Sample], out: &mut Vec<u8>) {
    capsule::encode(Format::UltraDense, first, out, |out| {
        for pair in samples.chunks_exact(2) {
            let words = [word(&pair[0]), word(&pair[1])];
            words.iter().for_each(|word| out.extend((*word as u16).to_le_bytes()));
            out.push((words[0] >> 16) as u8 | ((words[1] >> 16) as u8) << 4);
        }
    });
}

fn word(sample: &Sample) -> u32 {
    let range_mm = (range_q2(sample) + 2) / 4;
    let which = SCALES.iter().rposition(|scale| range_mm >= scale.from_mm).unwrap_or(0);
    let Scale { from_mm, step_mm, range_bits } = SCALES[which];
    let range = ((range_mm - from_mm) / step_mm).min((1 << range_bits) - 1) as u32;
    u32::from(sample.quality >> which) << (2 + range_bits) | range << 2 | which as u32
}
