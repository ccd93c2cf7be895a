//! One sample in five bytes: start bit, its inverse and the quality; the angle in 1/64 degrees over a bit that is
//! always set; the range in quarters of a millimetre. Three bits are all that tells a node from other bytes.

use super::{Sample, TURN_Q6, range_q2};

/// A lidar's geometry may move a reading by this much against its neighbours, degrees: in 197,000 nodes of an A1 no
/// two neighbours were farther apart where no byte was lost.
const NEIGHBOUR_DEG_MAX: f64 = 15.0;

pub(super) fn is_node(bytes: &[u8]) -> bool {
    let (start, inverse) = (bytes[0] & 1, bytes[0] >> 1 & 1);
    start != inverse && bytes[1] & 1 == 1 && i32::from(angle_q6(bytes)) < TURN_Q6
}

/// The steps of nodes that follow on one another differ by less, but for a few, degrees.
const UNEVEN_DEG_MAX: f64 = 2.0;

/// From one node to another, degrees, on the short way.
fn step_deg(before: &[u8], node: &[u8]) -> f64 {
    let (before, here) = (f64::from(angle_q6(before)) / 64.0, f64::from(angle_q6(node)) / 64.0);
    (here - before + 180.0).rem_euclid(360.0) - 180.0
}

/// Whether one node may follow another.
pub(crate) fn may_follow(before: &[u8], node: &[u8]) -> bool {
    step_deg(before, node).abs() <= NEIGHBOUR_DEG_MAX
}

/// Whether it is as far from the first to the second node as from that to the third.
pub(crate) fn turn_evenly(nodes: &[u8]) -> bool {
    let node = |i: usize| &nodes[5 * i..5 * i + 5];
    (step_deg(node(0), node(1)) - step_deg(node(1), node(2))).abs() <= UNEVEN_DEG_MAX
}

fn angle_q6(bytes: &[u8]) -> u16 {
    u16::from_le_bytes([bytes[1], bytes[2]]) >> 1
}

pub(crate) fn decode(bytes: &[u8]) -> Sample {
    let range_q2 = u16::from_le_bytes([bytes[3], bytes[4]]);
    Sample {
        starts_turn: bytes[0] & 1 == 1,
        angle_deg: f64::from(angle_q6(bytes)) / 64.0,
        range_m: (range_q2 > 0).then(|| f32::from(range_q2) / 4000.0),
        quality: bytes[0] >> 2,
        stamp_ns: 0,
    }
}

pub(super) fn encode(sample: &Sample, out: &mut Vec<u8>) {
    let start = u8::from(sample.starts_turn);
    let angle_q6 = ((sample.angle_deg * 64.0).round() as i64).rem_euclid(i64::from(TURN_Q6)) as u16;
    out.push(start | (1 - start) << 1 | sample.quality << 2);
    out.extend((angle_q6 << 1 | 1).to_le_bytes());
    out.extend((range_q2(sample).clamp(0, i64::from(u16::MAX)) as u16).to_le_bytes());
}
