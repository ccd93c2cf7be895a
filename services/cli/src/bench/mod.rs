//! `bench`: figures of this machine.

pub mod decoders;
pub mod depth;
pub mod faults;
pub mod idle;
pub mod link;
pub mod odometry;
mod plain;
pub mod receiver;
pub mod replay;
pub mod shield;
pub mod soak;
pub mod swaps;
pub mod transport;
pub mod world;

/// Percentiles of latencies.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Percentiles {
    /// How many values.
    pub n: usize,
    /// Half of them are not over it, microseconds.
    pub p50_us: f64,
    /// All but a hundredth of them are not over it, microseconds.
    pub p99_us: f64,
    /// The greatest, microseconds.
    pub max_us: f64,
}

impl Percentiles {
    /// Of these values, by nearest rank; none of none.
    pub(crate) fn of(mut ns: Vec<u64>) -> Option<Self> {
        ns.sort_unstable();
        let rank = |q: f64| ((q * ns.len() as f64).ceil() as usize).clamp(1, ns.len()) - 1;
        let us = |i: usize| (ns[i] as f64 / 100.0).round() / 10.0;
        if ns.is_empty() {
            return None;
        }
        Some(Self { n: ns.len(), p50_us: us(rank(0.5)), p99_us: us(rank(0.99)), max_us: us(ns.len() - 1) })
    }
}

#[cfg(test)]
mod tests {
    use super::Percentiles;

    #[test]
    fn percentiles_are_by_nearest_rank() {
        let of = Percentiles::of((1..=100).map(|i| i * 1000).collect()).expect("there are values");
        assert_eq!((of.n, of.p50_us, of.p99_us, of.max_us), (100, 50.0, 99.0, 100.0));
        assert_eq!(Percentiles::of(Vec::new()), None);
    }
}
