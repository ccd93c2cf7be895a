//! Randomness that depends on nothing but a key, so that a frame's noise is the same however often, and in whatever
//! order, frames are made.

use std::sync::LazyLock;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Runs of [`normals`] begin at one of so many places.
const BEGINNINGS: usize = 1 << 16;
/// The longest run: three for each column of the widest image.
const LONGEST: usize = 3 * crate::depth::MAX_SIZE[0];

/// Drawn once for all sensors, so that it stays in the cache.
static NORMALS: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let mut random = generator(Source::Table, 0, 0, 0);
    (0..BEGINNINGS + LONGEST).map(|_| StandardNormal.sample(&mut random)).collect()
});

/// No number of the table is farther out, standard deviations.
pub(crate) const NORMAL_MAX: f32 = 6.0;

/// A run of standard normal numbers from a random place of a table: for what takes too many to draw each.
pub(crate) fn normals(random: &mut ChaCha8Rng, count: usize) -> &'static [f32] {
    let begin = random.random_range(0..BEGINNINGS);
    &NORMALS[begin..begin + count]
}

/// Keeps the sensors' noises apart.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    Lidar = 1,
    Depth,
    Odometry,
    OdometryScale,
    Table,
    Redwood,
    Legs,
    Attitude,
    AttitudeBias,
}

/// The generator of one frame of one incarnation of a sensor.
pub(crate) fn generator(source: Source, seed: u64, incarnation: u32, frame: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&frame.to_le_bytes());
    key[16..20].copy_from_slice(&incarnation.to_le_bytes());
    key[20] = source as u8;
    ChaCha8Rng::from_seed(key)
}

#[cfg(test)]
mod tests {
    use super::{NORMAL_MAX, NORMALS};

    #[test]
    fn no_number_of_the_table_is_far_out() {
        assert!(NORMALS.iter().all(|normal| normal.abs() < NORMAL_MAX));
    }
}
