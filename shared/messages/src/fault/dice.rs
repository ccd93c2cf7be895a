//! Random numbers for faults.

/// Random numbers by seed (SplitMix64): the same seed makes the same fault.
#[derive(Debug, Clone, Default)]
pub struct Dice(u64);

impl Dice {
    /// Dice of that seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Any 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number from `from` up to, but not including, `to`.
    pub fn between(&mut self, (from, to): (u64, u64)) -> u64 {
        from + self.bits() % to.saturating_sub(from).max(1)
    }

    /// What a broken sensor might say: NaN, an infinity, something absurd, or something ordinary.
    pub fn number(&mut self) -> f64 {
        match self.bits() % 8 {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => f64::NEG_INFINITY,
            3 => f64::MAX,
            4 => -1e-300,
            5 => f64::from_bits(self.bits()),
            _ => self.between((0, 20_000)) as f64 / 1000.0 - 10.0,
        }
    }

    /// A count or a time: absurd, or ordinary.
    pub fn count(&mut self) -> u64 {
        match self.bits() % 3 {
            0 => u64::MAX,
            1 => self.bits(),
            _ => self.bits() % 1000,
        }
    }
}
