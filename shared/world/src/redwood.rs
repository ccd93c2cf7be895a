//! Depth noise after Choi et al. 2015 (the "Redwood" model that Kim et al. 2023 trained with), with a stand-in for its
//! table of distortions, which is not ours to ship.
//!
//! A pixel of an image of 640x480 reads a neighbour, at half the resolution. A coarser camera reads as far away as an
//! angle, and so nearly always its own pixel. The depth is divided by a distortion that varies smoothly over image and
//! depth; then the disparity is jittered and rounded. Some pixels never say anything. The table's own
//! statistics are kept: how much the distortion spreads at each depth, and how many pixels are dumb. The field itself
//! is drawn anew for each camera, so that nothing can be learnt by heart.

use multiversion::multiversion;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::noise::{NORMAL_MAX, Source, generator};

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
/// Columns and rows of the image whose pixels read neighbours.
const GRID: [f32; 2] = [640.0, 480.0];
/// One standard deviation of the disparity, and of the place that is read, pixels of that image.
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
    /// Its pixels are so coarse that each of them reads itself, however it is jittered.
    reads_itself: bool,
    /// For each pixel 1, or 0 where it says nothing.
    says: Vec<u32>,
    /// For each of the depths the distortion of each pixel.
    factors: [Vec<f32>; DEPTHS_M.len()],
    /// The frame before it is disturbed.
    clean: Vec<u16>,
    /// What a row's pixels read, metres.
    read_m: Vec<f32>,
}

impl Redwood {
    /// A camera of this resolution.
    pub(crate) fn new(intensity: f64, width: usize, height: usize, seed: u64) -> Self {
        let most_px = PLACE_SIGMA_PX * intensity as f32 * NORMAL_MAX;
        let sides = [Neighbours::of(width, GRID[0]), Neighbours::of(height, GRID[1])];
        let mut redwood = Self {
            intensity: intensity as f32,
            width,
            height,
            reads_itself: sides.iter().all(|side| side.reads_itself(most_px)),
            says: vec![0; width * height],
            factors: std::array::from_fn(|_| vec![1.0; width * height]),
            clean: Vec::new(),
            read_m: vec![0.0; width],
        };
        redwood.reseed(seed);
        redwood
    }

    /// Another camera of the same resolution.
    pub(crate) fn reseed(&mut self, seed: u64) {
        let mut random = generator(Source::Redwood, seed, 0, 0);
        let knots: Vec<f32> = (0..DEPTHS_M.len() * KNOTS * KNOTS).map(|_| StandardNormal.sample(&mut random)).collect();
        for (bin, factors) in self.factors.iter_mut().enumerate() {
            for (i, factor) in factors.iter_mut().enumerate() {
                let place = [(i / self.width, self.height), (i % self.width, self.width)];
                *factor = MEAN[bin] + SPREAD[bin] * field(&knots[bin * KNOTS * KNOTS..], place);
            }
        }
        let mut cells = [false; CELLS * CELLS];
        for (i, cell) in cells.iter_mut().enumerate() {
            let (row, column) = (i / CELLS, i % CELLS);
            let edge = DUMB_ROWS.contains(&row) || DUMB_COLUMNS.contains(&column);
            *cell = random.random_bool(DUMB_SHARE) || edge;
        }
        for (i, says) in self.says.iter_mut().enumerate() {
            let (row, column) = (i / self.width * CELLS / self.height, i % self.width * CELLS / self.width);
            *says = u32::from(!cells[row * CELLS + column]);
        }
    }

    /// Disturbs a frame, millimetres. Each call of `normals` gives standard normal numbers for one row, three for each
    /// column.
    pub(crate) fn disturb<'a>(&mut self, pixels_mm: &mut [u16], mut normals: impl FnMut() -> &'a [f32]) {
        self.clean.clear();
        self.clean.extend_from_slice(pixels_mm);
        for (row, out) in pixels_mm.chunks_exact_mut(self.width).enumerate() {
            let (aside, rest) = normals().split_at(self.width);
            let (above, jitter) = rest.split_at(self.width);
            self.read_neighbours(row, aside, above);
            distort(self, row, jitter, out);
        }
    }

    /// Which depths a row's pixels read.
    fn read_neighbours(&mut self, row: usize, aside: &[f32], above: &[f32]) {
        if self.reads_itself {
            let own = &self.clean[row * self.width..][..self.width];
            self.read_m.iter_mut().zip(own).for_each(|(depth_m, mm)| *depth_m = f32::from(*mm) * 0.001);
            return;
        }
        let sigma_px = PLACE_SIGMA_PX * self.intensity;
        let (across, down) = (Neighbours::of(self.width, GRID[0]), Neighbours::of(self.height, GRID[1]));
        for (column, ((depth_m, dx), dy)) in self.read_m.iter_mut().zip(aside).zip(above).enumerate() {
            let (y, x) = (down.read(row, dy * sigma_px), across.read(column, dx * sigma_px));
            *depth_m = f32::from(self.clean[y * self.width + x]) * 0.001;
        }
    }
}

/// What a row's pixels make of what they have read. No branches and no gathers: the compiler does several at once.
#[multiversion(targets("x86_64+avx2"))]
fn distort(redwood: &Redwood, row: usize, jitter: &[f32], out: &mut [u16]) {
    let sigma = DISPARITY_SIGMA * redwood.intensity;
    let own = row * redwood.width..(row + 1) * redwood.width;
    let factors: [&[f32]; DEPTHS_M.len()] = std::array::from_fn(|bin| &redwood.factors[bin][own.clone()]);
    let says = &redwood.says[own];
    for (i, (pixel, &depth_m)) in out.iter_mut().zip(&redwood.read_m).enumerate() {
        // Between the depths of the table on either side.
        let at = ((depth_m - DEPTHS_M[0]) * 0.5).clamp(0.0, (DEPTHS_M.len() - 1) as f32);
        let mut factor = 0.0;
        for (bin, factors) in factors.iter().enumerate() {
            factor += factors[i] * (1.0 - (at - bin as f32).abs()).max(0.0);
        }
        let disparity = DISPARITY_M * factor / depth_m.max(0.001) + jitter[i] * sigma;
        // Less than half a step from infinity is nothing.
        let steps = nearest((disparity * STEPS).clamp(0.0, 1e6));
        let depth_mm = nearest((1000.0 * DISPARITY_M * STEPS / steps.max(1) as f32).min(65_535.0));
        let seen = says[i] & u32::from(depth_m > 0.0) & u32::from(depth_m < FARTHEST_M) & u32::from(steps > 0);
        *pixel = (depth_mm * seen) as u16;
    }
}

/// Which pixel is read in place of another, along one side of the image.
struct Neighbours {
    last: usize,
    /// The last pixel of the grid.
    edge: f32,
    /// Pixels of the grid to one of the image.
    step: f32,
}

impl Neighbours {
    fn of(pixels: usize, grid: f32) -> Self {
        Self { last: pixels - 1, edge: grid - 1.0, step: grid / pixels as f32 }
    }

    /// Whether each pixel reads itself, wherever within `off` of its middle it reads.
    fn reads_itself(&self, off: f32) -> bool {
        (0..=self.last).all(|at| [-off, off].iter().all(|off| self.read(at, *off) == at))
    }

    /// Every second pixel of the grid is read; `off` is in its pixels.
    fn read(&self, at: usize, off: f32) -> usize {
        let middle = (at as f32 + 0.5) * self.step - 0.5;
        let even = nearest((middle + off).clamp(0.0, self.edge)) & !1;
        (((even as f32 + 0.5) / self.step) as usize).min(self.last)
    }
}

/// Here a float has no digits left for less than 1.
const WHOLE: f32 = (1 << 23) as f32;

/// The nearest whole number to one between 0 and 4e6: where a float has no digits left for less, it rounds by itself.
#[inline(always)]
fn nearest(value: f32) -> u32 {
    (value + WHOLE).to_bits() - WHOLE.to_bits()
}

/// The greatest whole number that is not greater than one between 0 and 4e6. The compiler does four at once; a cast
/// looks at each of them.
#[inline(always)]
pub(crate) fn whole(value: f32) -> u32 {
    let above = value + WHOLE - WHOLE > value;
    nearest(value) - u32::from(above)
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
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A wall at that depth, seen by many cameras: spread of the readings in metres, and the share without any.
    fn wall(depth_mm: u16) -> (f64, f64) {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (mut readings, mut none, mut all) = (Vec::new(), 0, 0);
        for seed in 0..40 {
            let mut pixels = vec![depth_mm; 160 * 120];
            let normals: Vec<f32> = (0..3 * 160 * 120).map(|_| StandardNormal.sample(&mut random)).collect();
            let mut rows = normals.chunks(3 * 160);
            Redwood::new(1.0, 160, 120, seed).disturb(&mut pixels, || rows.next().expect("one for each row"));
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
    fn a_coarse_image_reads_its_own_pixels_and_a_fine_one_its_neighbours() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut share = |width: usize, height: usize| {
            // Every second column is near: who reads the next one is off by 5 m.
            let clean: Vec<u16> = (0..width * height).map(|i| if i % 2 == 0 { 1000 } else { 6000 }).collect();
            let mut pixels = clean.clone();
            let normals: Vec<f32> = (0..3 * clean.len()).map(|_| StandardNormal.sample(&mut random)).collect();
            let mut rows = normals.chunks(3 * width);
            Redwood::new(1.0, width, height, 1).disturb(&mut pixels, || rows.next().expect("one for each row"));
            let is_off = |(clean, noisy): &(&u16, &u16)| **noisy > 0 && clean.abs_diff(**noisy) > 2500;
            clean.iter().zip(&pixels).filter(is_off).count() as f64 / clean.len() as f64
        };
        assert_eq!(share(128, 64), 0.0);
        assert!(share(640, 480) > 0.2);
    }

    #[test]
    fn where_each_pixel_reads_itself_the_short_way_gives_the_same() {
        let (width, height) = (128, 64);
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let clean: Vec<u16> = (0..width * height).map(|_| random.random_range(0..9000)).collect();
        let normals: Vec<f32> = (0..3 * clean.len()).map(|_| StandardNormal.sample(&mut random)).collect();
        let disturbed = |reads_itself: bool| {
            let mut redwood = Redwood { reads_itself, ..Redwood::new(1.0, width, height, 1) };
            let (mut pixels, mut rows) = (clean.clone(), normals.chunks(3 * width));
            redwood.disturb(&mut pixels, || rows.next().expect("one for each row"));
            pixels
        };
        assert!(Redwood::new(1.0, width, height, 1).reads_itself && !Redwood::new(1.0, 640, 480, 1).reads_itself);
        assert_eq!(disturbed(true), disturbed(false));
    }

    #[test]
    fn a_whole_number_is_what_a_cast_gives() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let drawn = (0..100_000).map(|_| random.random_range(0.0..65_536.0f32));
        let halves = (0..=u16::MAX).flat_map(|i| [-1, 0, 1].map(|ulps| (i, ulps)));
        let halves = halves.map(|(i, ulps)| f32::from_bits((f32::from(i) / 2.0).to_bits().saturating_add_signed(ulps)));
        for value in drawn.chain(halves) {
            assert_eq!(super::whole(value), value as u32, "{value}");
        }
    }

    #[test]
    fn depths_are_steps_of_an_eighth_of_a_pixel() {
        let mut pixels = vec![4000u16; 64 * 32];
        Redwood::new(0.0, 64, 32, 3).disturb(&mut pixels, || &[0.0; 3 * 64]);
        let steps = |mm: u16| 1000.0 * DISPARITY_M * STEPS / f32::from(mm);
        assert!(pixels.iter().filter(|mm| **mm > 0).all(|mm| (steps(*mm) - steps(*mm).round()).abs() < 0.1));
    }
}
