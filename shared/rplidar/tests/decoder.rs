//! What is read from a lidar's line: real capsules, every format there and back, and losses.

use guidedog_rplidar::{Counters, Decoder, FirstOfFrame, Format, Sample, Timing, angle_ahead_deg};

const TIMING: Timing = Timing { sample_ns: 62_500, byte_ns: 10_000 };

fn decode(format: Format, bytes: &[u8]) -> (Vec<Sample>, Counters) {
    let (mut decoder, mut samples) = (Decoder::new(format, TIMING), Vec::new());
    decoder.push(bytes, 10_000_000_000, &mut samples);
    (samples, decoder.counters())
}

/// A lidar that turns evenly in a room without corners: every frame of some turns.
fn stream(format: Format, frames: usize, step_deg: f64) -> (Vec<u8>, Vec<Sample>) {
    let (mut bytes, mut all) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        let from = frame * format.frame_samples();
        let samples: Vec<Sample> = (from..from + format.frame_samples()).map(|i| sample_at(i, step_deg)).collect();
        let first = FirstOfFrame { angle_deg: samples[0].angle_deg, restarted: frame == 0, lidar_us: 0 };
        let next = sample_at(from + format.frame_samples(), step_deg);
        format.encode(first, &samples, &next, &mut bytes);
        all.extend(samples);
    }
    (bytes, all)
}

fn sample_at(i: usize, step_deg: f64) -> Sample {
    let angle_deg = (i as f64 * step_deg) % 360.0;
    let starts_turn = angle_deg < step_deg;
    // Now and then nothing comes back.
    let range_m = (i % 17 != 5).then(|| (2.0 + angle_deg.to_radians().sin()) as f32);
    Sample { starts_turn, angle_deg, range_m, quality: 40, stamp_ns: 0 }
}

fn apart_deg(a: f64, b: f64) -> f64 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

#[test]
fn real_capsules_hold_what_an_independent_reader_finds() {
    let vectors: serde_json::Value = serde_json::from_str(include_str!("vectors.json")).expect("JSON");
    for (format, name) in [(Format::Express, "express"), (Format::Ultra, "ultra")] {
        let hex: String =
            vectors[name]["capsules"].as_array().expect("capsules").iter().filter_map(|c| c.as_str()).collect();
        let byte = |i: usize| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hex");
        let bytes: Vec<u8> = (0..hex.len() / 2).map(byte).collect();
        let (samples, counters) = decode(format, &bytes);
        assert_eq!((counters.frames, counters.skipped_bytes), (5, 0), "{name}");
        let found: Vec<_> = samples
            .iter()
            .map(|sample| {
                let angle_z_q14 = ((sample.angle_deg * 64.0) as u64 * 256) / 90;
                [u64::from(sample.starts_turn), angle_z_q14, (sample.range_m.unwrap_or(0.0) * 4000.0).round() as u64]
            })
            .collect();
        let expected: Vec<[u64; 3]> = serde_json::from_value(vectors[name]["nodes"].clone()).expect("nodes");
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn every_format_says_what_was_measured() {
    for format in Format::ALL {
        let (bytes, truth) = stream(format, 600 / format.frame_samples() + 40, 0.9);
        let (samples, counters) = decode(format, &bytes);
        assert_eq!((counters.skipped_bytes, counters.losses), (0, 0), "{format:?}");
        assert!(samples.len() + 2 * format.frame_samples() >= truth.len(), "{format:?}");
        for (sample, truth) in samples.iter().zip(&truth) {
            assert!(is_of(format, sample, truth), "{format:?}: {sample:?} {truth:?}");
        }
        let told = samples.iter().zip(&truth).filter(|(told, truth)| told.range_m.is_some() == truth.range_m.is_some());
        assert!(told.count() * 10 > samples.len() * 9, "{format:?}");
    }
}

/// Whether that is what was measured. Where a range cannot be told as a difference from one that is not there,
/// [`Format::Ultra`] tells nothing.
fn is_of(format: Format, sample: &Sample, truth: &Sample) -> bool {
    // The lidar's geometry, which the encoder leaves to its caller.
    let ahead_deg = if format == Format::Ultra { angle_ahead_deg(sample.range_m) } else { 0.0 };
    let told = match (sample.range_m, truth.range_m) {
        (Some(told_m), Some(true_m)) => (told_m - true_m).abs() <= 0.004,
        (told, truth) => told.is_none() && (truth.is_none() || format == Format::Ultra),
    };
    apart_deg(sample.angle_deg + ahead_deg, truth.angle_deg) < 0.05 && told
}

#[test]
fn a_sample_is_as_old_as_what_came_after_it() {
    for format in Format::ALL {
        let (bytes, _) = stream(format, 8, 0.9);
        let (samples, _) = decode(format, &bytes);
        let within = samples.windows(2).filter(|pair| pair[1].stamp_ns == pair[0].stamp_ns + TIMING.sample_ns).count();
        // All came in one piece: between frames lies the time of a frame's bytes.
        assert_eq!(within, samples.len() - samples.len() / format.frame_samples(), "{format:?}");
        // A capsule is told by the next one, a node by the next two.
        let frames_after = if format == Format::Standard { 2 } else { 1 };
        let came_ns = 10_000_000_000 - frames_after * format.frame_bytes() as u64 * TIMING.byte_ns;
        let age_ns = came_ns - samples.last().expect("samples").stamp_ns;
        assert_eq!(age_ns, format.frame_bytes() as u64 * TIMING.byte_ns + TIMING.sample_ns * 3 / 2, "{format:?}");
    }
}

#[test]
fn pieces_of_any_size_make_the_same_samples() {
    for format in Format::ALL {
        let (bytes, _) = stream(format, 20, 0.9);
        let (whole, _) = decode(format, &bytes);
        for size in [1, 2, 3, 7, 64, 171, 4096] {
            let (mut decoder, mut samples) = (Decoder::new(format, TIMING), Vec::new());
            bytes.chunks(size).for_each(|piece| decoder.push(piece, 0, &mut samples));
            let bare = |samples: &[Sample]| samples.iter().map(|s| Sample { stamp_ns: 0, ..*s }).collect::<Vec<_>>();
            assert_eq!(bare(&samples), bare(&whole), "{format:?} in pieces of {size}");
        }
    }
}

/// A byte lost, added or falsified costs a few frames and never gives a reading that was not measured.
#[test]
fn a_loss_costs_little_and_invents_nothing() {
    for format in Format::ALL {
        let (bytes, truth) = stream(format, 1200 / format.frame_samples() + 8, 0.9);
        let at = bytes.len() / 2;
        for offset in 0..format.frame_bytes() {
            for kind in 0..3 {
                let mut torn = bytes.clone();
                match kind {
                    0 => drop(torn.remove(at + offset)),
                    1 => torn.insert(at + offset, 0x5a),
                    _ => torn[at + offset] ^= 0x02,
                }
                let (samples, counters) = decode(format, &torn);
                let lost = truth.len() - samples.len().min(truth.len());
                assert!(lost <= 4 * format.frame_samples().max(3), "{format:?} {kind} {offset}: {lost} lost");
                let invented =
                    samples.iter().filter(|sample| !truth.iter().any(|truth| is_of(format, sample, truth))).count();
                // A node has no checksum: a bit of its angle or range that is falsified goes unseen.
                let unseen = usize::from(format == Format::Standard && kind == 2);
                assert!(invented <= unseen, "{format:?} {kind} {offset}: {invented} invented, {counters:?}");
            }
        }
    }
}

/// Bytes lost or doubled anywhere, again and again, in a stream of nodes that have no checksum.
#[test]
fn standard_nodes_that_lost_bytes_give_hardly_a_reading_that_was_not_measured() {
    let (bytes, truth) = stream(Format::Standard, 20_000, 0.9);
    let mut state = 5_u32;
    let mut dice = |sides: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize % sides
    };
    let (mut torn, mut faults) = (bytes, 0_usize);
    for from in (0..torn.len() - 500).step_by(500).rev() {
        let at = from + dice(400);
        match dice(3) {
            0 => drop(torn.remove(at)),
            1 => torn.insert(at, torn[at]),
            // Where it is a multiple of a node's five bytes, one has the range of another that is up to twelve nodes
            // on: of those nobody can know.
            _ => drop(torn.drain(at..at + 5 * dice(12) + 1 + dice(4))),
        }
        faults += 1;
    }
    let (samples, _) = decode(Format::Standard, &torn);
    // Every 17th sample is none: after 17 turns it is all as before.
    let turn = &truth[..17 * 400];
    let invented = samples.iter().filter(|sample| !turn.iter().any(|truth| is_of(Format::Standard, sample, truth)));
    let invented = invented.count();
    assert!(invented * 30 <= faults, "{invented} readings of {faults} faults");
    assert!(samples.len() + 12 * faults >= truth.len() - faults * 13, "{} of {}", samples.len(), truth.len());
}

#[test]
fn noise_is_no_scan() {
    let mut state = 7u32;
    let noise: Vec<u8> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    })
    .take(1 << 20)
    .collect();
    for format in Format::ALL {
        let (samples, counters) = decode(format, &noise);
        // By chance a frame in 65,536 places; by chance four nodes that fit together in more than 100,000.
        assert!(samples.len() < 200, "{format:?}: {} samples of noise, {counters:?}", samples.len());
    }
}
