//! Skeleton.

pub mod geometric;
