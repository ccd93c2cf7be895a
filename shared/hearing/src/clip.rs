//! A recorded word: where it ends, how loud it is, and the same said faster. Pure.

/// Samples of a block of which the loudness is taken, and of one by which the end of a word is found.
const BLOCK: usize = 320;
const FINE: usize = 160;

/// Mean power.
#[must_use]
pub fn mean_square(samples: &[f32]) -> f32 {
    samples.iter().map(|sample| sample * sample).sum::<f32>() / samples.len().max(1) as f32
}

/// The loudest sample, either way.
#[must_use]
pub fn peak(samples: &[f32]) -> f32 {
    samples.iter().fold(0.0, |peak: f32, sample| peak.max(sample.abs()))
}

/// Mean power of the louder half of what was recorded.
#[must_use]
pub fn speech_power(samples: &[f32]) -> f32 {
    let mut blocks: Vec<f32> = samples.chunks(BLOCK).map(mean_square).collect();
    blocks.sort_by(f32::total_cmp);
    let louder = &blocks[blocks.len() / 2..];
    louder.iter().sum::<f32>() / louder.len().max(1) as f32 + 1e-12
}

/// Where what is said ends, samples: above the recording's own floor, treble raised, as its last consonant is no
/// louder.
#[must_use]
pub fn word_end(samples: &[f32]) -> usize {
    let bright: Vec<f32> = samples.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let levels_db: Vec<f32> =
        bright.chunks_exact(FINE).map(|block| 10.0 * (mean_square(block) + 1e-12).log10()).collect();
    let smooth = |i: usize| {
        let near = &levels_db[i.saturating_sub(1)..(i + 2).min(levels_db.len())];
        near.iter().sum::<f32>() / near.len() as f32
    };
    let smooth_db: Vec<f32> = (0..levels_db.len()).map(smooth).collect();
    let mut sorted = smooth_db.clone();
    sorted.sort_by(f32::total_cmp);
    let (Some(floor_db), Some(peak_db)) = (sorted.get(sorted.len() / 10), sorted.last()) else { return samples.len() };
    let loud_db = (peak_db - 35.0).max((floor_db + 9.0).min(peak_db - 6.0));
    smooth_db.iter().rposition(|level_db| *level_db > loud_db).map_or(samples.len(), |last| (last + 1) * FINE)
}

/// Played faster by a factor: shorter, and higher in pitch and formants.
#[must_use]
pub fn faster(samples: &[f32], factor: f32) -> Vec<f32> {
    let count = (samples.len().saturating_sub(1) as f64 / f64::from(factor)) as usize;
    let at = |i: usize| {
        let at = i as f64 * f64::from(factor);
        let (from, share) = (at as usize, at.fract() as f32);
        samples[from] * (1.0 - share) + samples[(from + 1).min(samples.len() - 1)] * share
    };
    (0..count).map(at).collect()
}
