//! Depth noise after Choi et al. 2015 (the "Redwood" model that Kim et al. 2023 trained with), with a stand-in for its
//! table of distortions, which is not ours to ship.
//!
//! A pixel reads a neighbour, at half the resolution; its depth is divided by a distortion that varies smoothly over
//! image and depth; then the disparity is jittered and rounded. Some pixels never say anything. The table's own
//! statistics are kept: how much the distortion spreads at each depth, and how many pixels are dumb. The field itself
//! is drawn anew for each camera, so that nothing can be learnt by heart.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::noise::{Source, generator};

/// Depths at which the distortion is known, metres.
const DEPTHS_M: [f32; 5] = [1.0, 3.0, 5.0, 7.0, 9.0];
/// Mean of the table's factor at those depths, and one standard deviation over the image.
const MEAN: [f32; 5] = [0.999, 1.001, 1.004, 1.005, 0.995];
const SPREAD: [f32; 5] = [0.0025, 0.011, 0.022, 0.032, 0.032];
/// Knots of the smooth field in either direction.
const KNOTS: usize = 6;
/// Cells of the table in either direction.
const CELLS: usize = 80;
/// First and last rows and columns of the table's cells that say nothing, and the share of the others.
const DUMB_ROWS: [usize; 4] = [0, 1, 78, 79];
const DUMB_COLUMNS: [usize; 5] = [0, 76, 77, 78, 79];
const DUMB_SHARE: f64 = 0.055;
/// Baseline times focal length, in metres and steps of an eighth of a pixel of disparity.
const DISPARITY_M: f32 = 35.130;
const STEPS: f32 = 8.0;
/// One standard deviation of the disparity, pixels, and of the place that is read.
const DISPARITY_SIGMA: f32 = 0.027_778;
const PLACE_SIGMA_PX: f32 = 0.25;
/// Farther is not seen, metres.
const FARTHEST_M: f32 = 10.0;

/// The distortions of one camera.
#[derive(Debug, Clone)]
pub(crate) struct Redwood {
    intensity: f32,
    width: usize,
    height: usize,
    /// For each pixel whether it says nothing.
    dumb: Vec<bool>,
    /// The distortion of each pixel at each of the depths.
    factors: Vec<[f32; DEPTHS_M.len()]>,
    /// The frame before it is disturbed.
    clean: Vec<u16>,
}

impl Redwood {
    /// A camera of this resolution.
    pub(crate) fn new(intensity: f64, width: usize, height: usize, seed: u64) -> Self {
        let mut redwood = Self {
            intensity: intensity as f32,
            width,
            height,
            dumb: vec![false; width * height],
            factors: vec![[1.0; DEPTHS_M.len()]; width * height],
            clean: Vec::new(),
        };
        redwood.reseed(seed);
        redwood
    }

    /// Another camera of the same resolution.
    pub(crate) fn reseed(&mut self, seed: u64) {
        let mut random = generator(Source::Redwood, seed, 0, 0);
        let knots: Vec<f32> = (0..DEPTHS_M.len() * KNOTS * KNOTS).map(|_| StandardNormal.sample(&mut random)).collect();
        for (i, factors) in self.factors.iter_mut().enumerate() {
            let place = [(i / self.width, self.height), (i % self.width, self.width)];
            for (bin, factor) in factors.iter_mut().enumerate() {
                *factor = MEAN[bin] + SPREAD[bin] * field(&knots[bin * KNOTS * KNOTS..], place);
            }
        }
        let mut cells = [false; CELLS * CELLS];
        for (i, cell) in cells.iter_mut().enumerate() {
            let (row, column) = (i / CELLS, i % CELLS);
            let edge = DUMB_ROWS.contains(&row) || DUMB_COLUMNS.contains(&column);
            *cell = random.random_bool(DUMB_SHARE) || edge;
        }
        for (i, dumb) in self.dumb.iter_mut().enumerate() {
            let (row, column) = (i / self.width * CELLS / self.height, i % self.width * CELLS / self.width);
            *dumb = cells[row * CELLS + column];
        }
    }

    /// Disturbs a frame, millimetres. `normals` are standard normal numbers, three for each pixel.
    pub(crate) fn disturb(&mut self, pixels_mm: &mut [u16], mut normals: impl Iterator<Item = [f32; 3]>) {
        self.clean.clear();
        self.clean.extend_from_slice(pixels_mm);
        let read = |at: usize, off: f32, count: usize| {
            let at = (at as f32 + off + 0.5).clamp(0.0, (count - 1) as f32) as usize;
            at - at % 2
        };
        let rows = pixels_mm.chunks_exact_mut(self.width).enumerate();
        for (row, column, pixel) in
            rows.flat_map(|(row, out)| out.iter_mut().enumerate().map(move |(u, p)| (row, u, p)))
        {
            let [dx, dy, dd] = normals.next().unwrap_or_default().map(|normal| normal * self.intensity);
            let y = read(row, dy * PLACE_SIGMA_PX, self.height);
            let x = read(column, dx * PLACE_SIGMA_PX, self.width);
            let depth_m = f32::from(self.clean[y * self.width + x]) / 1000.0;
            let i = row * self.width + column;
            if self.dumb[i] || depth_m <= 0.0 || depth_m >= FARTHEST_M {
                *pixel = 0;
                continue;
            }
            let disparity = DISPARITY_M * factor(&self.factors[i], depth_m) / depth_m + dd * DISPARITY_SIGMA;
            let steps = (disparity * STEPS).round();
            *pixel = if steps > 0.0 { (1000.0 * DISPARITY_M * STEPS / steps).min(65_535.0) as u16 } else { 0 };
        }
    }
}

/// The distortion at a depth: between those of the depths beside it.
fn factor(factors: &[f32; DEPTHS_M.len()], depth_m: f32) -> f32 {
    let at = ((depth_m - DEPTHS_M[0]) / 2.0).clamp(0.0, 4.0);
    let bin = (at as usize).min(DEPTHS_M.len() - 2);
    let share = at - bin as f32;
    (1.0 - share) * factors[bin] + share * factors[bin + 1]
}

/// A smooth field: knots, interpolated. The place is (row, rows) and (column, columns).
fn field(knots: &[f32], place: [(usize, usize); 2]) -> f32 {
    let [(y, v), (x, u)] = place.map(|(at, count)| {
        let at = at as f32 / count as f32 * (KNOTS - 1) as f32;
        (at as usize, at - at.floor())
    });
    let knot = |y: usize, x: usize| knots[y * KNOTS + x];
    (1.0 - v) * ((1.0 - u) * knot(y, x) + u * knot(y, x + 1))
        + v * ((1.0 - u) * knot(y + 1, x) + u * knot(y + 1, x + 1))
}

#[cfg(test)]
mod tests {
    use super::{DISPARITY_M, Redwood, STEPS};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A wall at that depth, seen by many cameras: spread of the readings in metres, and the share without any.
    fn wall(depth_mm: u16) -> (f64, f64) {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (mut readings, mut none, mut all) = (Vec::new(), 0, 0);
        for seed in 0..40 {
            let mut pixels = vec![depth_mm; 160 * 120];
            let mut redwood = Redwood::new(1.0, 160, 120, seed);
            redwood
                .disturb(&mut pixels, std::iter::from_fn(|| Some([0; 3].map(|_| StandardNormal.sample(&mut random)))));
            none += pixels.iter().filter(|mm| **mm == 0).count();
            all += pixels.len();
            readings.extend(pixels.iter().filter(|mm| **mm > 0).map(|mm| f64::from(*mm) / 1000.0));
        }
        let mean = readings.iter().sum::<f64>() / readings.len() as f64;
        let variance = readings.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / readings.len() as f64;
        (variance.sqrt(), none as f64 / all as f64)
    }

    #[test]
    fn the_spread_is_that_of_the_table() {
        // Choi et al.'s table gives 0.113 m at 5 m and 0.301 m at 9 m; interpolating between knots takes a third of it.
        let ((at_5, none), (at_9, _)) = (wall(5000), wall(9000));
        assert!((0.06..0.13).contains(&at_5) && (0.17..0.36).contains(&at_9), "{at_5} {at_9}");
        assert!((0.09..0.19).contains(&none), "{none}");
    }

    #[test]
    fn depths_are_steps_of_an_eighth_of_a_pixel() {
        let mut pixels = vec![4000u16; 64 * 32];
        Redwood::new(0.0, 64, 32, 3).disturb(&mut pixels, std::iter::empty());
        let steps = |mm: u16| 1000.0 * DISPARITY_M * STEPS / f32::from(mm);
        assert!(pixels.iter().filter(|mm| **mm > 0).all(|mm| (steps(*mm) - steps(*mm).round()).abs() < 0.1));
    }
}
