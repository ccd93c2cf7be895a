//! What a lidar measures, and how it is packed.

mod capsule;
mod dense;
mod express;
pub(crate) mod standard;
mod ultra;
mod ultra_dense;

pub(crate) use capsule::Capsule;
pub use ultra::angle_ahead_deg;

/// The most bytes of a frame of any format.
pub const FRAME_BYTES_MAX: usize = 170;
/// The most samples of a frame of any format.
pub const FRAME_SAMPLES_MAX: usize = 96;
/// No lidar turns faster, turns a second: a capsule that spans more is none.
const TURNS_PER_S_MAX: u64 = 100;
/// A whole turn in 1/64 degrees.
const TURN_Q6: i32 = 360 << 6;
/// A whole turn in 1/65536 degrees.
const TURN_Q16: i64 = 360 << 16;

/// One reading.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Whether it is the first of a turn.
    pub starts_turn: bool,
    /// Clockwise from straight ahead, degrees, from 0 to under 360.
    pub angle_deg: f64,
    /// Metres; none where nothing came back, which is unknown and not free.
    pub range_m: Option<f32>,
    /// As the lidar tells it, 0 to 63; the capsules that have none give 47 for a reading.
    pub quality: u8,
    /// When it was measured, nanoseconds of the clock of [`crate::Decoder::push`].
    pub stamp_ns: u64,
}

/// How samples are packed: the type of the answer that begins a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One sample in five bytes, without a checksum.
    Standard,
    /// 32 samples in 84 bytes, each with an angle of its own.
    Express,
    /// 96 samples in 132 bytes, two of three told as differences.
    Ultra,
    /// 40 samples in 84 bytes, whole millimetres.
    Dense,
    /// 64 samples in 170 bytes, with quality; coarser the farther.
    UltraDense,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Standard, Self::Express, Self::Ultra, Self::Dense, Self::UltraDense];

    /// The type byte of the answer that begins such a scan.
    #[must_use]
    pub const fn answer_type(self) -> u8 {
        match self {
            Self::Standard => 0x81,
            Self::Express => 0x82,
            Self::Ultra => 0x84,
            Self::Dense => 0x85,
            Self::UltraDense => 0x86,
        }
    }

    /// The format of that type byte.
    #[must_use]
    pub fn of_answer_type(answer_type: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.answer_type() == answer_type)
    }

    /// Bytes of a frame.
    #[must_use]
    pub const fn frame_bytes(self) -> usize {
        match self {
            Self::Standard => 5,
            Self::Express | Self::Dense => 84,
            Self::Ultra => 132,
            Self::UltraDense => 170,
        }
    }

    /// Samples of a frame.
    #[must_use]
    pub const fn frame_samples(self) -> usize {
        match self {
            Self::Standard => 1,
            Self::Express => 32,
            Self::Ultra => 96,
            Self::Dense => 40,
            Self::UltraDense => 64,
        }
    }

    /// Whether such bytes, as many as a frame has, are a frame: what is fixed is as it must be, the checksum is right.
    pub(crate) fn is_frame(self, bytes: &[u8]) -> bool {
        match self {
            Self::Standard => standard::is_node(bytes),
            _ => Capsule::is_whole(self, bytes),
        }
    }

    /// Writes one frame: what a lidar sends. `samples` are as many as a frame has; their angles are those of a lidar
    /// that turns evenly from the first one's, and are not looked at. `next` is the first of the next frame, from
    /// which [`Format::Ultra`] tells the last.
    pub fn encode(self, first: FirstOfFrame, samples: &[Sample], next: &Sample, out: &mut Vec<u8>) {
        let from = out.len();
        match self {
            Self::Standard => standard::encode(&samples[0], out),
            Self::Express => express::encode(first, samples, out),
            Self::Ultra => ultra::encode(first, samples, next, out),
            Self::Dense => dense::encode(first, samples, out),
            Self::UltraDense => ultra_dense::encode(first, samples, out),
        }
        debug_assert_eq!(out.len() - from, self.frame_bytes());
    }
}

/// What a capsule says of its first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstOfFrame {
    /// Its angle, degrees clockwise, before any correction.
    pub angle_deg: f64,
    /// Whether the lidar has begun to scan anew: nothing before belongs to it.
    pub restarted: bool,
    /// When, by the lidar's own clock, microseconds; only told by [`Format::UltraDense`].
    pub lidar_us: u32,
}

/// Quality of a reading where the format has none, as the maker's own library gives it.
const QUALITY_UNTOLD: u8 = 0x2f;

/// A sample of a capsule at a raw angle and what it is corrected by, 1/65536 degrees.
fn sample(at: Spot, range_q2: i32, quality: Option<u8>) -> Sample {
    let angle_q6 = ((at.angle_q16 - at.ahead_q16) >> 10) as i32;
    Sample {
        starts_turn: at.starts_turn,
        angle_deg: f64::from(angle_q6.rem_euclid(TURN_Q6)) / 64.0,
        range_m: (range_q2 > 0).then(|| range_q2 as f32 / 4000.0),
        quality: quality.unwrap_or(if range_q2 > 0 { QUALITY_UNTOLD } else { 0 }),
        stamp_ns: 0,
    }
}

/// Where the lidar looked.
#[derive(Debug, Clone, Copy)]
struct Spot {
    starts_turn: bool,
    /// By the even turning of the lidar, 1/65536 degrees.
    angle_q16: i64,
    /// What the lidar's geometry takes off, 1/65536 degrees.
    ahead_q16: i64,
}

/// The even turning of a lidar through a capsule, from its first angle to that of the next one.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    first_q16: i64,
    step_q16: i64,
}

impl Sweep {
    /// `None` where no lidar turns so fast: it is another turn, and capsules between were lost.
    fn between(previous: &Capsule, next: &Capsule, format: Format, sample_ns: u64) -> Option<Self> {
        let samples = format.frame_samples() as i64;
        let (from, to) = (i64::from(previous.start_q6()), i64::from(next.start_q6()));
        let turned_q6 = (to - from).rem_euclid(i64::from(TURN_Q6));
        let most_q6 = i64::from(TURN_Q6) * (TURNS_PER_S_MAX * samples as u64 * sample_ns) as i64 / 1_000_000_000;
        (turned_q6 <= most_q6).then_some(Self { first_q16: from << 10, step_q16: (turned_q6 << 10) / samples })
    }

    /// Where the lidar looked at sample `index`, uncorrected. The first of a turn is the last before straight ahead,
    /// as the maker's library has it.
    fn at(&self, index: usize) -> Spot {
        let angle_q16 = self.first_q16 + index as i64 * self.step_q16;
        let starts_turn = (angle_q16 + self.step_q16).rem_euclid(TURN_Q16) < self.step_q16;
        Spot { starts_turn, angle_q16, ahead_q16: 0 }
    }
}

/// A range in quarters of a millimetre, 0 for none.
fn range_q2(sample: &Sample) -> i64 {
    sample.range_m.map_or(0, |range_m| (f64::from(range_m) * 4000.0).round() as i64)
}
