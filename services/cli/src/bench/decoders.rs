//! `bench decoders`: how fast lidar samples are decoded and sorted into turns, on one core, beside the fastest line.

use std::time::Instant;

use rplidar::{Beams, Decoder, Fan, FirstOfFrame, Format, Sample, Timing, Turns};
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::out::{self, table};
use crate::workers::progress;

/// Frames of a format in one measurement.
const FRAMES: usize = 20_000;
/// Samples of a turn.
const TURN_SAMPLES: usize = 1600;
/// The kernel hands over so many bytes at a time, as a serial port's buffer holds.
const SIGMA_M: f64 = 0.025;
const PIECE: usize = 64;
/// The fastest line that any of the series has, an RPLIDAR S2's or S3's: a million bits a second, ten of them a byte.
const LINE_BYTES_PER_S: f64 = 100_000.0;

struct Row {
    format: Format,
    bytes: Vec<u8>,
    bytes_per_s: Vec<f64>,
}

impl Row {
    fn new(format: Format) -> Self {
        let count = format.frame_samples();
        let mut bytes = Vec::new();
        let frame = |number: usize| -> Vec<Sample> { (number * count..(number + 1) * count).map(sample).collect() };
        for number in 0..FRAMES {
            let samples = frame(number);
            let first = FirstOfFrame { angle_deg: samples[0].angle_deg, restarted: false, lidar_us: 0 };
            format.encode(first, &samples, &sample((number + 1) * count), &mut bytes);
        }
        Self { format, bytes, bytes_per_s: Vec::new() }
    }

    /// Decodes all of it.
    fn measure(&mut self) -> Result<(), Failure> {
        let beams = Beams { count: 360, angle_min_rad: -std::f64::consts::PI, angle_increment_rad: 0.0175 };
        let mut decoder = Decoder::new(self.format, Timing { sample_ns: 31_250, byte_ns: 10_000 });
        let (mut turns, mut fan) = (Turns::default(), Fan::new(beams, SIGMA_M));
        let (mut samples, mut found) = (Vec::new(), 0);
        let begun = Instant::now();
        for (i, piece) in self.bytes.chunks(PIECE).enumerate() {
            samples.clear();
            decoder.push(piece, i as u64 * (PIECE as u64) * 10_000, &mut samples);
            for sample in &samples {
                let Some(turn) = turns.push(sample) else { continue };
                turn.iter().for_each(|sample| fan.enter(sample));
                found += usize::from(fan.ranges_m().iter().any(|range_m| range_m.is_finite()));
            }
        }
        self.bytes_per_s.push(self.bytes.len() as f64 / begun.elapsed().as_secs_f64());
        let lost = decoder.counters().losses + decoder.counters().skipped_bytes;
        if lost > 0 || found == 0 {
            return Err(Failure::run(format!("{:?}: {lost} lost, {found} turns", self.format)));
        }
        Ok(())
    }

    fn json(&mut self) -> Value {
        self.bytes_per_s.sort_by(f64::total_cmp);
        let median = self.bytes_per_s[self.bytes_per_s.len() / 2];
        let (min, max) = (self.bytes_per_s.first(), self.bytes_per_s.last());
        json!({
            "format": format!("{:?}", self.format),
            "bytes_per_s": { "p50": median, "min": min, "max": max, "n": self.bytes_per_s.len() },
            "samples_per_s": median * self.format.frame_samples() as f64 / self.format.frame_bytes() as f64,
            "of_the_fastest_line": median / LINE_BYTES_PER_S,
        })
    }
}

/// A reading of a room of some corners.
fn sample(number: usize) -> Sample {
    let share = (number % TURN_SAMPLES) as f64 / TURN_SAMPLES as f64;
    let range_m = 3.0 + (share * std::f64::consts::TAU * 4.0).sin();
    Sample {
        starts_turn: number.is_multiple_of(TURN_SAMPLES),
        angle_deg: share * 360.0,
        range_m: (!number.is_multiple_of(50)).then_some(range_m as f32),
        quality: 47,
        stamp_ns: 0,
    }
}

/// `guidedog bench decoders`.
///
/// # Errors
/// Where what was encoded is not decoded whole, or the report cannot be written.
pub fn bench(times: u32, as_json: bool) -> Result<(), Failure> {
    let mut rows = Format::ALL.map(Row::new);
    for _ in progress(times.into(), "rounds").wrap_iter(0..times) {
        for row in &mut rows {
            row.measure()?;
        }
    }
    let rows: Vec<Value> = rows.iter_mut().map(Row::json).collect();
    let report = json!({ "line_bytes_per_s": LINE_BYTES_PER_S, "rows": rows });
    out::tell(as_json, &report, || told(&rows))
}

fn told(rows: &[Value]) -> Vec<String> {
    let lines = rows.iter().map(|row| {
        vec![
            out::text(row, "/format").to_owned(),
            format!("{:.1}", out::number(row, "/bytes_per_s/p50") / 1e6),
            format!("{:.1}", out::number(row, "/bytes_per_s/min") / 1e6),
            format!("{:.1}", out::number(row, "/bytes_per_s/max") / 1e6),
            format!("{:.1}", out::number(row, "/samples_per_s") / 1e6),
            format!("{:.0}", out::number(row, "/of_the_fastest_line")),
        ]
    });
    let head = "lidar samples decoded and sorted into turns, one core; a million bytes a second, and samples";
    let heads = ["format", "p50", "min", "max", "samples", "times the fastest line"];
    [vec![head.to_owned()], table(&heads, &lines.collect::<Vec<_>>())].concat()
}
