//! A legged robot in MuJoCo as the world of a run: the ground on which everything else has to stand.

pub mod legs;
pub mod motion;
pub mod person;
pub mod rays;
pub mod robot;
pub mod scene;
pub mod sight;
pub mod touch;
pub mod walls;
