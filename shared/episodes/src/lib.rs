//! The wayfinding task in simulation: one cue, a hundred decisions (Kim et al. 2023, sections 3 and 5). What is learnt
//! from and what is evaluated on are the same episodes, made of the same worlds, sensors, shield, observation and
//! reward.
//!
//! No clock, no I/O: the same configuration and seed give the same episode, to the bit.

pub mod batch;
pub mod config;
pub mod episode;
mod of_settings;
pub mod score;
pub mod task;
pub mod teacher;

pub use batch::{Batch, Finished};
pub use config::{Config, Handlers, Harness, Noise, Places, RewardMeasure};
pub use episode::{Episode, Step};
pub use score::{Report, Score};
pub use task::{Goal, Task};
pub use teacher::Teacher;

/// The seed of part `part` of something with the seed `seed`: what the parts draw does not hang together.
#[must_use]
pub fn part_seed(seed: u64, part: u64) -> u64 {
    let mut z = seed.wrapping_add(part.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
