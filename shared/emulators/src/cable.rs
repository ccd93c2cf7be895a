//! What goes wrong on the way between a device and who speaks to it.

use std::collections::VecDeque;

use messages::Fault;
use messages::fault::{DELAY_NS, Dice, LOSS_OF, NOISE_BITS};

/// One way of a line of datagrams: what is put in comes out, as far and as soon as its fault lets it.
#[derive(Debug, Default)]
pub(crate) struct Cable {
    dice: Dice,
    /// Datagrams on their way, each with the time at which it comes out, nanoseconds.
    on_way: VecDeque<(u64, Vec<u8>)>,
}

impl Cable {
    /// A sound line whose faults are random by that seed.
    pub fn new(seed: u64) -> Self {
        Self { dice: Dice::new(seed), on_way: VecDeque::new() }
    }

    /// Puts a datagram in.
    pub fn put(&mut self, now_ns: u64, bytes: &[u8], fault: Option<Fault>) {
        let lost = match fault {
            Some(Fault::Unplugged) => true,
            Some(Fault::Loss) => self.dice.between((0, LOSS_OF)) < 3,
            _ => false,
        };
        if lost {
            return;
        }
        let mut bytes = bytes.to_vec();
        if fault == Some(Fault::Noise) {
            flip(&mut self.dice, &mut bytes);
        }
        let out_ns = if fault == Some(Fault::Delayed) { now_ns + DELAY_NS } else { now_ns };
        if fault == Some(Fault::Duplicated) {
            self.on_way.push_back((out_ns, bytes.clone()));
        }
        self.on_way.push_back((out_ns, bytes));
    }

    /// The next datagram that has come through.
    pub fn take(&mut self, now_ns: u64) -> Option<Vec<u8>> {
        let is_out = self.on_way.front().is_some_and(|(out_ns, _)| *out_ns <= now_ns);
        is_out.then(|| self.on_way.pop_front()).flatten().map(|(_, bytes)| bytes)
    }
}

/// Flips bits of a noisy line.
pub(crate) fn flip(dice: &mut Dice, bytes: &mut [u8]) {
    for byte in bytes {
        for bit in 0..8 {
            if dice.between((0, NOISE_BITS)) == 0 {
                *byte ^= 1 << bit;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Cable;
    use messages::Fault;

    const MS: u64 = 1_000_000;

    /// Of 1,000 datagrams: how many came out by then, and how many of them damaged.
    fn through(fault: Option<Fault>, at_ns: u64) -> (usize, usize) {
        let mut cable = Cable::new(1);
        (0..1000).for_each(|_| cable.put(0, &[0x55; 113], fault));
        let came: Vec<_> = std::iter::from_fn(|| cable.take(at_ns)).collect();
        (came.len(), came.iter().filter(|bytes| bytes[..] != [0x55; 113]).count())
    }

    #[test]
    fn every_fault_does_what_the_table_says() {
        assert_eq!(through(None, 0), (1000, 0));
        assert_eq!(through(Some(Fault::Unplugged), MS), (0, 0));
        assert_eq!(through(Some(Fault::Duplicated), 0), (2000, 0));
        assert_eq!(through(Some(Fault::Delayed), 399 * MS), (0, 0));
        assert_eq!(through(Some(Fault::Delayed), 400 * MS), (1000, 0));
        let (came, _) = through(Some(Fault::Loss), 0);
        assert!((600..800).contains(&came), "{came}");
        let (came, damaged) = through(Some(Fault::Noise), 0);
        assert!(came == 1000 && (250..450).contains(&damaged), "{damaged}");
    }
}
