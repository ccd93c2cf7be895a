//! What a microphone may make of the same word: at other speeds and levels, coloured, over noise.

use hearing::{FRAMES_AN_EMBEDDING, HOP, faster, mean_square, peak, speech_power, word_end};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Scenes of each clip.
const SCENES: usize = 24;
/// From one embedding to the next, samples.
const STEP_SAMPLES: usize = FRAMES_AN_EMBEDDING * HOP;
/// Windows of each scene, an embedding apart: the word is in all of them.
pub const SHIFTS: usize = 6;
/// Samples of a scene: what the head sees of its last window, and the steps before.
const SPAN: usize = (hearing::FRAMES - 1) * HOP + hearing::FRAME + (hearing::WINDOWS - 1 + SHIFTS - 1) * STEP_SAMPLES;
/// Resampled by up to e to the power of this, either way.
const SPEED: f32 = 0.12;
/// The word over the noise, decibels.
const SNR_DB: std::ops::Range<f32> = 5.0..35.0;
/// The scene's peak, decibels of full scale.
const PEAK_DB: std::ops::Range<f32> = -30.0..0.0;
/// Near-silence before and after a clip that is judged, samples. The first frame whose level counts is the clip's own:
/// what is always there is then its noise, not ours, beside which all of it would be loud.
pub const SILENCE: usize =
    (hearing::FRAMES + (hearing::WINDOWS - 1) * FRAMES_AN_EMBEDDING - hearing::FRAMES_A_STEP - 1) * HOP;
/// How loud near-silence is, of full scale.
pub const HISS: f32 = 3.2e-4;

fn normal(dice: &mut ChaCha8Rng) -> f32 {
    StandardNormal.sample(dice)
}

/// A clip as it is judged: between two stretches of near-silence.
#[must_use]
pub fn amid_silence(clip: &[f32], dice: &mut ChaCha8Rng) -> Vec<f32> {
    let mut heard = vec![0.0; clip.len() + 2 * SILENCE];
    heard[SILENCE..SILENCE + clip.len()].copy_from_slice(clip);
    heard.iter_mut().for_each(|sample| *sample += HISS * normal(dice));
    heard
}

/// Scenes of a clip, the first as it was recorded. The word ends up to 80 ms before the first window does.
#[must_use]
pub fn scenes(clip: &[f32], dice: &mut ChaCha8Rng) -> Vec<Vec<f32>> {
    (0..SCENES).map(|number| scene(clip, number == 0, dice)).collect()
}

fn scene(clip: &[f32], as_recorded: bool, dice: &mut ChaCha8Rng) -> Vec<f32> {
    let audio = if as_recorded { clip.to_vec() } else { faster(clip, dice.random_range(-SPEED..SPEED).exp()) };
    let (mut placed, at) = (vec![0.0; SPAN], SPAN - (SHIFTS - 1) * STEP_SAMPLES - dice.random_range(0..STEP_SAMPLES));
    let end = word_end(&audio);
    let (from, to) = (end.saturating_sub(at), at.saturating_sub(end));
    for (placed, sample) in placed[to..].iter_mut().zip(&audio[from..]) {
        *placed = *sample;
    }
    if !as_recorded {
        placed = tilted(&placed, dice.random_range(-0.4..0.4));
    }
    let noise: Vec<f32> = (0..SPAN).map(|_| normal(dice)).collect();
    let noise = tilted(&noise, dice.random_range(-0.9..0.0));
    let snr_db = if as_recorded { SNR_DB.end } else { dice.random_range(SNR_DB) };
    let scale = (speech_power(&placed) / 10_f32.powf(snr_db / 10.0) / mean_square(&noise)).sqrt();
    let mut mixed: Vec<f32> = placed.iter().zip(&noise).map(|(sample, noise)| sample + scale * noise).collect();
    let level = 10_f32.powf(dice.random_range(PEAK_DB) / 20.0) / peak(&mixed).max(1e-6);
    mixed.iter_mut().for_each(|sample| *sample *= level);
    mixed
}

/// y\[n\] = x\[n\] + a x\[n - 1\]: darker above zero, brighter below.
fn tilted(samples: &[f32], a: f32) -> Vec<f32> {
    let before = std::iter::once(&0.0).chain(samples);
    samples.iter().zip(before).map(|(sample, before)| sample + a * before).collect()
}

#[cfg(test)]
mod tests {
    use super::{SCENES, SHIFTS, SPAN, STEP_SAMPLES, scenes};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_word_is_in_every_window_of_every_scene() {
        let word = |i: usize| if (8000..14_400).contains(&i) { 0.3 * (i as f32 * 0.4).sin() } else { 0.0 };
        let clip: Vec<f32> = (0..20_000).map(word).collect();
        let made = scenes(&clip, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(made.len(), SCENES);
        for scene in &made {
            assert_eq!(scene.len(), SPAN);
            let power = |part: &[f32]| part.iter().map(|x| x * x).sum::<f32>() / part.len() as f32;
            let first_end = SPAN - (SHIFTS - 1) * STEP_SAMPLES;
            let (word, after) = (power(&scene[first_end - 5000..first_end - 1280]), power(&scene[first_end + 200..]));
            assert!(word > 2.0 * after, "{word} {after}");
            assert!(scene.iter().all(|sample| sample.abs() <= 1.0));
        }
    }
}
