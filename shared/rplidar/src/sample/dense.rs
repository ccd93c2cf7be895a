//! 40 ranges in whole millimetres.

use super::capsule::{self, Capsule};
use super::{FirstOfFrame, Format, Sample, Sweep, range_q2, sample};

pub(super) fn decode(capsule: &Capsule, sweep: &Sweep, out: &mut Vec<Sample>) {
    for (i, range) in capsule.cabins().chunks_exact(2).enumerate() {
        out.push(sample(sweep.at(i), i32::from(u16::from_le_bytes([range[0], range[1]])) << 2, None));
    }
}

pub(super) fn encode(first: FirstOfFrame, samples: &[Sample], out: &mut Vec<u8>) {
    capsule::encode(Format::Dense, first, out, |out| {
        for sample in samples {
            let range_mm = ((range_q2(sample) + 2) / 4).clamp(0, i64::from(u16::MAX)) as u16;
            out.extend(range_mm.to_le_bytes());
        }
    });
}
