//! Randomness that depends on nothing but a key, so that a frame's noise is the same however often, and in whatever
//! order, frames are made.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Keeps the sensors' noises apart.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    Lidar = 1,
    Depth,
    Odometry,
    OdometryScale,
    Table,
    Redwood,
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
