//! A figure with its interval of 95 %: by resampling the motions (bootstrap), by a fixed seed.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Resamples of a mean, and of a fit, which takes longer.
const MEANS: usize = 1000;
pub(super) const FITS: usize = 300;
/// Ends of the interval.
const SHARES: [f64; 2] = [0.025, 0.975];

/// What was found over a number of motions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figure {
    /// The mean, or what was fitted.
    pub value: f64,
    /// Lower end of the interval.
    pub lo: f64,
    /// Its upper end.
    pub hi: f64,
    /// The largest of all; of a fit, as `hi`.
    pub max: f64,
    /// Of how many motions.
    pub n: usize,
}

impl Figure {
    /// The mean of one value for each motion. Without motions all is zero.
    #[must_use]
    pub fn mean(values: &[f64]) -> Self {
        let n = values.len();
        if n == 0 {
            return Self { value: 0.0, lo: 0.0, hi: 0.0, max: 0.0, n };
        }
        let mean = |indices: &mut dyn Iterator<Item = usize>| indices.map(|i| values[i]).sum::<f64>() / n as f64;
        let resampled = resamples(n, MEANS).map(|indices| mean(&mut indices.into_iter())).collect();
        let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self { max, ..Self::fitted(mean(&mut (0..n)), resampled, n) }
    }

    /// What was fitted to `n` motions, and again to resamples of them.
    #[must_use]
    pub(super) fn fitted(value: f64, mut resampled: Vec<f64>, n: usize) -> Self {
        resampled.sort_by(f64::total_cmp);
        let last = resampled.len().saturating_sub(1);
        let at = |share: f64| resampled.get((share * last as f64).round() as usize).copied().unwrap_or(value);
        let [lo, hi] = SHARES.map(at);
        Self { value, lo: lo.min(value), hi: hi.max(value), max: hi.max(value), n }
    }
}

/// Draws of `n` indices below `n`, with replacement.
pub(super) fn resamples(n: usize, count: usize) -> impl Iterator<Item = Vec<usize>> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    (0..count).map(move |_| (0..n).map(|_| random.random_range(0..n)).collect())
}

#[cfg(test)]
mod tests {
    use super::Figure;

    #[test]
    fn the_interval_of_a_mean_is_about_that_of_the_normal_distribution() {
        let values: Vec<f64> = (0..100).map(|i| f64::from(i % 10)).collect();
        let figure = Figure::mean(&values);
        let half = 1.96 * (8.25_f64 / 100.0).sqrt();
        assert!((figure.value - 4.5).abs() < 1e-12 && figure.max == 9.0 && figure.n == 100);
        assert!((figure.lo - (4.5 - half)).abs() < 0.1 && (figure.hi - (4.5 + half)).abs() < 0.1, "{figure:?}");
        assert_eq!(Figure::mean(&values), figure, "by a fixed seed");
        assert_eq!(Figure::mean(&[]).n, 0);
    }
}
