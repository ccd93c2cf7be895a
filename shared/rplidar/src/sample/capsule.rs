//! What all capsules share: two sync nibbles, a checksum, the angle of the first sample.

use super::{FRAME_BYTES_MAX, FirstOfFrame, Format, Sample, Sweep, TURN_Q6, dense, express, ultra, ultra_dense};

/// A whole capsule, as it came.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Capsule {
    format: Format,
    bytes: [u8; FRAME_BYTES_MAX],
}

/// High nibbles of the first two bytes; the low ones are the checksum's.
const SYNC: [u8; 2] = [0xa, 0x5];
/// Set in the first angle where the lidar has begun to scan anew.
const RESTARTED: u16 = 0x8000;

impl Capsule {
    /// The capsule in such bytes, which [`Format::is_frame`] has found to be one.
    pub(crate) fn of(format: Format, frame: &[u8]) -> Self {
        let mut bytes = [0; FRAME_BYTES_MAX];
        bytes[..frame.len()].copy_from_slice(frame);
        Self { format, bytes }
    }

    pub(crate) fn is_whole(format: Format, bytes: &[u8]) -> bool {
        let told = bytes[0] & 0xf | bytes[1] << 4;
        let synced = [bytes[0] >> 4, bytes[1] >> 4] == SYNC;
        synced
            && bytes.len() == format.frame_bytes()
            && checksum(&bytes[2..]) == told
            && i32::from(start_word(format, bytes) & !RESTARTED) < TURN_Q6
    }

    /// Whether nothing before it belongs to it.
    pub(crate) fn restarts(&self) -> bool {
        start_word(self.format, &self.bytes) & RESTARTED != 0
    }

    /// Angle of the first sample, 1/64 degrees.
    pub(super) fn start_q6(&self) -> u16 {
        start_word(self.format, &self.bytes) & !RESTARTED
    }

    /// The samples of this capsule, told by the next one's first angle; none where capsules between were lost.
    pub(crate) fn decode(&self, next: &Self, sample_ns: u64, out: &mut Vec<Sample>) {
        let Some(sweep) = Sweep::between(self, next, self.format, sample_ns) else { return };
        match self.format {
            Format::Standard => {}
            Format::Express => express::decode(self, &sweep, out),
            Format::Ultra => ultra::decode(self, next, &sweep, out),
            Format::Dense => dense::decode(self, &sweep, out),
            Format::UltraDense => ultra_dense::decode(self, &sweep, out),
        }
    }

    /// The packed samples.
    pub(super) fn cabins(&self) -> &[u8] {
        &self.bytes[cabins_at(self.format)..self.format.frame_bytes()]
    }
}

/// Where the samples begin.
const fn cabins_at(format: Format) -> usize {
    match format {
        Format::UltraDense => 10,
        _ => 4,
    }
}

fn start_word(format: Format, bytes: &[u8]) -> u16 {
    let at = cabins_at(format) - 2;
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Writes what comes before the samples, lets them be written, and puts the checksum in.
pub(super) fn encode(format: Format, first: FirstOfFrame, out: &mut Vec<u8>, cabins: impl FnOnce(&mut Vec<u8>)) {
    let from = out.len();
    out.extend([0, 0]);
    if format == Format::UltraDense {
        out.extend(first.lidar_us.to_le_bytes());
        // No status that anybody has described.
        out.extend([0, 0]);
    }
    let angle_q6 = ((first.angle_deg * 64.0).round() as i64).rem_euclid(i64::from(TURN_Q6)) as u16;
    out.extend((angle_q6 | if first.restarted { RESTARTED } else { 0 }).to_le_bytes());
    cabins(out);
    let sum = checksum(&out[from + 2..]);
    out[from] = SYNC[0] << 4 | sum & 0xf;
    out[from + 1] = SYNC[1] << 4 | sum >> 4;
}
