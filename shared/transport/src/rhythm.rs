//! What is due again and again.

/// Something due at whole periods of run time, so that a restarted process keeps the rhythm.
#[derive(Debug, Clone, Copy)]
pub struct Rhythm {
    period_ns: u64,
    next_ns: u64,
}

impl Rhythm {
    /// Due `rate_hz` times a second, and now for the first time.
    #[must_use]
    pub fn at_hz(rate_hz: f64) -> Self {
        Self { period_ns: (1e9 / rate_hz).max(1.0) as u64, next_ns: 0 }
    }

    /// Run time at which it is due next, nanoseconds.
    #[must_use]
    pub fn next_ns(&self) -> u64 {
        self.next_ns
    }

    /// The number of the period, where it is due; what was missed is not made up for.
    pub fn due(&mut self, now_ns: u64) -> Option<u64> {
        if now_ns < self.next_ns {
            return None;
        }
        let number = now_ns / self.period_ns;
        self.next_ns = (number + 1) * self.period_ns;
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::Rhythm;

    #[test]
    fn it_is_due_once_a_period_and_catches_nothing_up() {
        let mut rhythm = Rhythm::at_hz(10.0);
        assert_eq!(rhythm.due(30_000_000), Some(0));
        assert_eq!(rhythm.due(99_000_000), None);
        assert_eq!(rhythm.due(100_000_000), Some(1));
        assert_eq!(rhythm.due(570_000_000), Some(5));
        assert_eq!(rhythm.next_ns(), 600_000_000);
    }
}
