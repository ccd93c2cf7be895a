//! Imports what an RPLIDAR of the A series sent on its serial line in standard scan mode, byte for byte.
//!
//! What comes before the reply that begins the scan, `A5 5A 05 00 00 40 81`, is stale; the rest is read as the driver
//! reads it ([`rplidar::Decoder`]).
//!
//! * **Scans** are the whole revolutions, from start bit to start bit. A revolution's nodes are sorted into beams of
//!   one width, of which there are nine for ten nodes, so that hardly any is left empty; the nearest reading of a
//!   beam counts.
//! * **A distance of 0 is unknown**, never free. Where the lidar looks at its own mount, that is so in every
//!   revolution: [`ImportOptions::field_of_view_rad`] leaves out what it cannot see, as if it did not look there.
//! * **Time** is not in the bytes: nodes come at the standard mode's 2,000 a second. A second lies between two
//!   captures, and each has an incarnation of its own: nobody knows where the lidar was meanwhile.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use messages::{Header, LidarScan, MAX_BEAMS, NS_PER_S, ScanHeader, s_from_ns};
use rplidar::{Beams, Decoder, Descriptor, Fan, Format, Sample, Timing};
use serde::Serialize;

use crate::{About, Existing, Slice, WriteError, Writer};

/// From one node to the next in standard mode.
const NODE_NS: u64 = NS_PER_S / 2000;
/// When what came was measured is not asked.
const TIMING: Timing = Timing { sample_ns: NODE_NS, byte_ns: 0 };
/// Between two captures.
const GAP_NS: u64 = NS_PER_S;
/// What an A1 sees, metres.
const RANGE_M: (f64, f64) = (0.15, 12.0);
/// One standard deviation of a reading of an A1 within a few metres, metres.
const SIGMA_M: f64 = 0.02;
/// Fewer nodes are no revolution.
const NODES_MIN: usize = 20;
/// No capture is longer, bytes: hours.
const CAPTURE_MAX: u64 = 256 << 20;

/// What is in the bytes of a capture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Capture {
    /// In the order in which they came.
    pub nodes: Vec<Sample>,
    /// Bytes between nodes that belong to none.
    pub skipped_bytes: u64,
}

/// Reads the nodes of a capture; none where it holds no standard scan.
#[must_use]
pub fn decode(bytes: &[u8]) -> Option<Capture> {
    let mut from = 0;
    let begins = |descriptor: Descriptor| descriptor.answer_type == Format::Standard.answer_type();
    loop {
        let (descriptor, after) = Descriptor::find(&bytes[from..])?;
        from += after;
        if descriptor.repeats && begins(descriptor) {
            break;
        }
    }
    let (mut decoder, mut nodes) = (Decoder::new(Format::Standard, TIMING), Vec::new());
    decoder.push(&bytes[from..], 0, &mut nodes);
    decoder.finish(0, &mut nodes);
    Some(Capture { nodes, skipped_bytes: decoder.counters().skipped_bytes })
}

/// Why captures cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A capture cannot be read.
    #[error("{} cannot be read", path.display())]
    Read {
        /// The capture.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is a folder, a pipe or a device.
    #[error("{} is not a file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The recording would replace a capture.
    #[error("{} is to be read and written at once", path.display())]
    SameFile {
        /// The file.
        path: PathBuf,
    },
    /// It is larger than any capture.
    #[error("{} has {bytes} bytes, over {CAPTURE_MAX}", path.display())]
    TooLong {
        /// The capture.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// No reply to the command that begins a standard scan is in it.
    #[error("{} holds no standard scan of an RPLIDAR: no bytes a5 5a 05 00 00 40 81", path.display())]
    NoScan {
        /// The capture.
        path: PathBuf,
    },
    /// There is not one whole revolution in all of them.
    #[error("the captures hold no whole revolution")]
    NoRevolution,
    /// The recording could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// How to import.
#[derive(Debug, Clone, Copy)]
pub struct ImportOptions {
    /// What to do where the recording is already there.
    pub existing: Existing,
    /// Beams beyond it, half to either side of straight ahead, are left out, radians; at most a whole turn.
    pub field_of_view_rad: f64,
}

/// What was imported.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportReport {
    /// The captures.
    pub sources: Vec<PathBuf>,
    /// The recording.
    pub recording: PathBuf,
    /// Whole revolutions.
    pub scans: u64,
    /// Beams of a scan.
    pub beams: usize,
    /// Nodes, those of broken revolutions among them.
    pub nodes: u64,
    /// Nodes whose distance is 0.
    pub zero_distance: u64,
    /// Bytes that belong to no node.
    pub skipped_bytes: u64,
    /// By the sample rate, seconds.
    pub duration_s: f64,
}

/// Imports captures, in this order, into a recording at `out`, which is written whole or not at all.
///
/// # Errors
/// For a capture that cannot be read or holds no scan, and where the recording cannot be written.
pub fn import(captures: &[PathBuf], out: &Path, options: ImportOptions) -> Result<ImportReport, ImportError> {
    if let Ok(out) = out.canonicalize()
        && captures.iter().any(|path| path.canonicalize().is_ok_and(|path| path == out))
    {
        return Err(ImportError::SameFile { path: out });
    }
    let mut writer = Writer::create(out, options.existing)?;
    let decoded = captures.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    let lengths = decoded.iter().flat_map(|capture| revolutions(&capture.nodes)).map(|(from, to)| to - from);
    let beams = fan(beams_for(lengths.collect()).ok_or(ImportError::NoRevolution)?, options.field_of_view_rad);
    let (mut at_ns, mut seq) = (0, 0);
    for (i, capture) in decoded.iter().enumerate() {
        for (from, to) in revolutions(&capture.nodes) {
            let stamp_ns = at_ns + to as u64 * NODE_NS;
            let header = Header { stamp_ns, seq, incarnation: i as u32 + 1, ..Header::default() };
            writer.write(&scan(header, &capture.nodes[from..to], &beams).into())?;
            seq += 1;
        }
        at_ns += capture.nodes.len() as u64 * NODE_NS + GAP_NS;
    }
    let nodes = decoded.iter().map(|capture| capture.nodes.len() as u64).sum();
    let zeros = decoded.iter().flat_map(|capture| &capture.nodes).filter(|node| node.range_m.is_none()).count();
    let skipped_bytes = decoded.iter().map(|capture| capture.skipped_bytes).sum();
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let info = writer.finish(About {
        source: captures.first().map(name).unwrap_or_default(),
        robot: "rplidar".to_owned(),
        field_of_view_rad: beams.count as f64 * beams.angle_increment_rad,
        first_wall_clock_s: None,
        anomalies: BTreeMap::from([
            ("zero_distance".to_owned(), zeros as u64),
            ("skipped_bytes".to_owned(), skipped_bytes),
        ]),
        run: None,
    })?;
    Ok(ImportReport {
        sources: captures.to_owned(),
        recording: out.to_owned(),
        scans: seq,
        beams: beams.count,
        nodes,
        zero_distance: zeros as u64,
        skipped_bytes,
        duration_s: s_from_ns(info.duration_ns),
    })
}

fn read(path: &Path) -> Result<Capture, ImportError> {
    let failed = |source| ImportError::Read { path: path.to_owned(), source };
    let found = std::fs::metadata(path).map_err(failed)?;
    // Before it is opened: opening a pipe would wait for its writer.
    if !found.is_file() {
        return Err(ImportError::NotAFile { path: path.to_owned() });
    }
    let bytes = found.len();
    if bytes > CAPTURE_MAX {
        return Err(ImportError::TooLong { path: path.to_owned(), bytes });
    }
    decode(&std::fs::read(path).map_err(failed)?).ok_or_else(|| ImportError::NoScan { path: path.to_owned() })
}

/// The whole revolutions: from a start to the node before the next.
fn revolutions(nodes: &[Sample]) -> Vec<(usize, usize)> {
    let starts: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].starts_turn).collect();
    starts.windows(2).map(|pair| (pair[0], pair[1])).filter(|(from, to)| to - from >= NODES_MIN).collect()
}

/// Nine beams for ten nodes of the middle one of all revolutions.
fn beams_for(mut lengths: Vec<usize>) -> Option<usize> {
    lengths.sort_unstable();
    let middle = lengths.get(lengths.len() / 2)?;
    Some((middle * 9 / 10).clamp(NODES_MIN / 2, MAX_BEAMS))
}

/// Of a whole turn's beams those within a field of view, centred on straight ahead; beam 0 of a whole turn looks
/// straight back.
fn fan(whole_turn: usize, field_of_view_rad: f64) -> Beams {
    let left_out = (whole_turn as f64 * (1.0 - field_of_view_rad / TAU) / 2.0).ceil();
    let first = (left_out.max(0.0) as usize).min((whole_turn - 1) / 2);
    let angle_increment_rad = TAU / whole_turn as f64;
    // Straight back is one beam, which has no twin on the other side.
    let count = whole_turn - 2 * first + usize::from(first > 0);
    Beams { count, angle_min_rad: first as f64 * angle_increment_rad - PI, angle_increment_rad }
}

fn scan(header: Header, nodes: &[Sample], beams: &Beams) -> Slice<LidarScan> {
    let mut fan = Fan::new(*beams, SIGMA_M);
    nodes.iter().for_each(|node| fan.enter(node));
    let ranges_m = fan.ranges_m().to_vec();
    let header = ScanHeader {
        header,
        angle_min_rad: beams.angle_min_rad,
        angle_increment_rad: beams.angle_increment_rad,
        range_min_m: RANGE_M.0,
        range_max_m: RANGE_M.1,
        sigma_m: SIGMA_M,
        ..ScanHeader::default()
    };
    Slice { header, data: ranges_m }
}

#[cfg(test)]
mod tests {
    use super::{decode, fan, revolutions, scan};
    use crate::Slice;
    use messages::Header;
    use std::f64::consts::TAU;

    fn bytes(starts: bool, angle_deg: f64, distance_mm: u16) -> [u8; 5] {
        let angle = ((angle_deg * 64.0) as u16) << 1 | 1;
        let [low, high] = angle.to_le_bytes();
        let [near, far] = (distance_mm * 4).to_le_bytes();
        [if starts { 0b01 } else { 0b10 }, low, high, near, far]
    }

    fn capture() -> Vec<u8> {
        let mut stream = vec![0x3e, 0x7b, 0x00];
        stream.extend([0xa5, 0x5a, 0x05, 0x00, 0x00, 0x40, 0x81]);
        for i in 0..100 {
            let degrees = f64::from(i % 40) * 9.0;
            stream.extend(bytes(i % 40 == 0, degrees, if i % 5 == 3 { 0 } else { 1000 + 10 * (i % 40) as u16 }));
        }
        stream
    }

    #[test]
    fn nodes_come_after_the_descriptor_and_a_lost_byte_costs_few() {
        let whole = decode(&capture()).expect("a scan");
        assert_eq!((whole.nodes.len(), whole.skipped_bytes), (100, 0));
        assert_eq!(whole.nodes[41].angle_deg, 9.0);
        assert_eq!((whole.nodes[3].range_m, whole.nodes[2].range_m), (None, Some(1.02)));
        let mut torn = capture();
        torn.remove(10 + 5 * 30 + 2);
        let torn = decode(&torn).expect("a scan");
        assert!(torn.nodes.len() >= 95 && torn.skipped_bytes > 0, "{} {}", torn.nodes.len(), torn.skipped_bytes);
        assert_eq!(decode(b"nothing of a lidar"), None);
    }

    #[test]
    fn a_revolution_turns_the_other_way_and_zero_is_unknown() {
        let nodes = decode(&capture()).expect("a scan").nodes;
        assert_eq!(revolutions(&nodes), [(0, 40), (40, 80)], "the last one is not whole");
        let ranges_m = scan(Header::default(), &nodes[..40], &fan(40, TAU)).data;
        // 90 degrees clockwise is to the right: a quarter turn before beam 20, which looks ahead.
        assert_eq!((ranges_m[20], ranges_m[10]), (1.0, 1.1));
        assert!(ranges_m[20 - 3].is_nan(), "its distance was 0");
        // Half a turn: from the right over ahead to the left.
        let half = fan(40, std::f64::consts::PI);
        let Slice { header, data: ranges_m } = scan(Header::default(), &nodes[..40], &half);
        assert!((header.angle_min_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!((ranges_m.len(), ranges_m[10], ranges_m[0]), (21, 1.0, 1.1));
    }
}
