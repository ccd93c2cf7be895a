//! Bytes of a running scan to samples, through losses.
//!
//! Where what comes is no frame, one byte at a time is left out until there is one again. A checksum tells a capsule; a
//! standard node has three bits only, so that several in a row have to fit together before the first is believed. What
//! no reader of such a stream can tell: a bit that is wrong in a node's angle or range, and whole nodes that are lost.

use crate::sample::{Capsule, FRAME_BYTES_MAX, Format, Sample, standard};

/// Standard nodes that fit together before the second is believed, where it is not known where one begins: the first
/// may be the end of one that is torn and fit by chance,
const NODES_TO_LOCK: usize = 5;
/// and where it follows another: a byte that is lost within a node makes its range of the next one's first byte, which
/// only those behind it tell.
const NODES_TO_BELIEVE: usize = 3;

/// A lidar samples more slowly than it says by at most one part of so many.
const CLOCK_SHARE: u64 = 20;
/// What came later than this was held up for too long to know when it was sent, nanoseconds.
const LATE_NS_MAX: u64 = 100_000_000;

/// How long things take on the way from the lidar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// From one sample to the next, nanoseconds.
    pub sample_ns: u64,
    /// A byte on the line, nanoseconds.
    pub byte_ns: u64,
}

/// What was met so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Whole frames.
    pub frames: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Times that frames no longer followed on one another.
    pub losses: u64,
    /// Times that the lidar said that it has begun to scan anew.
    pub restarts: u64,
}

impl Counters {
    /// Those of two scans.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            skipped_bytes: self.skipped_bytes + other.skipped_bytes,
            losses: self.losses + other.losses,
            restarts: self.restarts + other.restarts,
        }
    }
}

/// Reads one scan's bytes.
#[derive(Debug, Clone)]
pub struct Decoder {
    format: Format,
    timing: Timing,
    /// What is no whole frame yet.
    rest: Vec<u8>,
    /// Whether the bytes before the rest were a frame.
    locked: bool,
    /// A capsule's samples are told when the next one has come.
    previous: Option<(Capsule, u64)>,
    last_node: Option<[u8; 5]>,
    /// When the last frame must have come, nanoseconds.
    last_ns: Option<u64>,
    counters: Counters,
    /// Whether nothing more comes.
    is_over: bool,
}

impl Decoder {
    /// A decoder of that format.
    #[must_use]
    pub fn new(format: Format, timing: Timing) -> Self {
        let rest = Vec::with_capacity(2 * FRAME_BYTES_MAX);
        Self {
            format,
            timing,
            rest,
            locked: true,
            previous: None,
            last_node: None,
            last_ns: None,
            counters: Counters::default(),
            is_over: false,
        }
    }

    /// The format.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    /// What was met so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Takes bytes whose last one came at `arrival_ns`, and adds the samples that they make whole.
    pub fn push(&mut self, bytes: &[u8], arrival_ns: u64, samples: &mut Vec<Sample>) {
        let mut behind = bytes.len();
        // No more than a frame or two at a time, so that the rest stays small.
        for piece in bytes.chunks(FRAME_BYTES_MAX) {
            self.rest.extend_from_slice(piece);
            behind -= piece.len();
            self.take_frames(arrival_ns, behind, samples);
        }
    }

    /// Nothing more will come: what waits for what is behind it is taken without.
    pub fn finish(&mut self, arrival_ns: u64, samples: &mut Vec<Sample>) {
        self.is_over = true;
        self.take_frames(arrival_ns, 0, samples);
    }

    /// Takes the frames that are whole; `behind` bytes of the same arrival are still to come.
    fn take_frames(&mut self, arrival_ns: u64, behind: usize, samples: &mut Vec<Sample>) {
        let length = self.format.frame_bytes();
        let mut from = 0;
        while let Some(begins) = self.begins_frame(&self.rest[from..]) {
            let rest = &self.rest[from..];
            if begins {
                // Of a standard stream that is found again the first node may be none.
                if self.format == Format::Standard && !self.locked && !standard::turn_evenly(rest) {
                    (self.locked, self.last_node) = (true, rest[..length].try_into().ok());
                    self.counters.skipped_bytes += length as u64;
                    from += length;
                    continue;
                }
                let after = (rest.len() - length + behind) as u64;
                let whole_ns = arrival_ns.saturating_sub(after * self.timing.byte_ns);
                let mut frame = [0; FRAME_BYTES_MAX];
                frame[..length].copy_from_slice(&rest[..length]);
                self.take_frame(&frame[..length], whole_ns, samples);
                from += length;
            } else {
                self.lose();
                self.counters.skipped_bytes += 1;
                from += 1;
            }
        }
        self.rest.drain(..from);
    }

    /// Whether a frame begins there; none where more has to come to tell.
    fn begins_frame(&self, bytes: &[u8]) -> Option<bool> {
        let frame = bytes.get(..self.format.frame_bytes())?;
        if self.format != Format::Standard || !self.format.is_frame(frame) {
            return Some(self.format.is_frame(frame));
        }
        // The first one follows the answer that begins the scan: there is no doubt where it begins.
        let follows = |before: [u8; 5]| standard::may_follow(&before, frame);
        let is_next = self.locked && self.last_node.is_none_or(follows);
        let needed = match is_next {
            true if self.is_over => 1,
            true => NODES_TO_BELIEVE,
            false => NODES_TO_LOCK,
        };
        let nodes = bytes.get(..needed * frame.len())?;
        let pairs = nodes.chunks_exact(frame.len()).zip(nodes.chunks_exact(frame.len()).skip(1));
        Some(pairs.into_iter().all(|(before, node)| self.format.is_frame(node) && standard::may_follow(before, node)))
    }

    fn take_frame(&mut self, frame: &[u8], whole_ns: u64, samples: &mut Vec<Sample>) {
        self.locked = true;
        self.counters.frames += 1;
        let whole_ns = self.smoothed_ns(whole_ns);
        let from = samples.len();
        let came_ns = if self.format == Format::Standard {
            samples.push(standard::decode(frame));
            self.last_node = frame.try_into().ok();
            whole_ns
        } else {
            let capsule = Capsule::of(self.format, frame);
            if capsule.restarts() {
                self.counters.restarts += 1;
                self.previous = None;
            }
            let Some((previous, came_ns)) = self.previous.replace((capsule, whole_ns)) else { return };
            previous.decode(&capsule, self.timing.sample_ns, samples);
            came_ns
        };
        let count = samples.len() - from;
        for (i, sample) in samples[from..].iter_mut().enumerate() {
            sample.stamp_ns = came_ns.saturating_sub(self.age_ns(count - 1 - i));
        }
    }

    /// When the last byte of a frame must have come. A line and a reader can only be late, and a lidar keeps its time:
    /// so it is no later than a frame after the one before, but for what the lidar's clock may be wrong by.
    fn smoothed_ns(&mut self, seen_ns: u64) -> u64 {
        let frame_ns = self.format.frame_samples() as u64 * self.timing.sample_ns;
        let due_ns = self.last_ns.map(|last_ns| last_ns + frame_ns + frame_ns / CLOCK_SHARE);
        let late = due_ns.filter(|due_ns| seen_ns > *due_ns && seen_ns - due_ns < LATE_NS_MAX);
        *self.last_ns.insert(late.unwrap_or(seen_ns))
    }

    /// From the measurement of a sample to the arrival of its frame's last byte, where so many samples came after it:
    /// half of the measurement itself, one sample for the lidar's filter, and the frame's way over the line.
    fn age_ns(&self, later: usize) -> u64 {
        let Timing { sample_ns, byte_ns } = self.timing;
        sample_ns * 3 / 2 + self.format.frame_bytes() as u64 * byte_ns + later as u64 * sample_ns
    }

    fn lose(&mut self) {
        self.counters.losses += u64::from(self.locked);
        self.locked = false;
        self.previous = None;
        self.last_ns = None;
    }
}
