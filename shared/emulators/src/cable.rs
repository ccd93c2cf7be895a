//! What goes wrong on the way between a device and who speaks to it.

use std::collections::VecDeque;

use messages::Fault;
use messages::fault::{DELAY_NS, Dice, LOSS_OF, LOW_CHARGE_PERCENT, NOISE_BITS};

/// A robot's line, both ways, and what goes wrong with it or the robot.
#[derive(Debug)]
pub(crate) struct Trouble<H, S> {
    pub fault: Option<Fault>,
    /// To the robot.
    pub heard: Cable<H>,
    /// From it.
    pub said: Cable<S>,
}

impl<H: Clone, S: Clone> Trouble<H, S> {
    /// A sound line.
    pub fn none() -> Self {
        Self { fault: None, heard: Cable::new(1), said: Cable::new(2) }
    }

    /// From now on that goes wrong; by that seed, where it is random. Whether somebody has pressed stop on the hand
    /// remote, or has let go of it, where that is news.
    pub fn suffer(&mut self, fault: Option<(Fault, u64)>) -> Option<bool> {
        let before = self.fault;
        if let Some((fault, seed)) = fault.filter(|(fault, _)| before != Some(*fault)) {
            (self.fault, self.heard, self.said) = (Some(fault), Cable::new(seed), Cable::new(!seed));
        }
        self.fault = fault.map(|(fault, _)| fault);
        let stops = |fault| fault == Some(Fault::RemoteStop);
        (stops(before) != stops(self.fault)).then(|| stops(self.fault))
    }

    /// The charge that the robot tells where it has that, percent.
    pub fn charge_percent(&self, charge_percent: Option<u8>) -> Option<u8> {
        if self.fault == Some(Fault::LowBattery) { Some(LOW_CHARGE_PERCENT) } else { charge_percent }
    }
}

/// One way of a line: what is put in comes out, as far and as soon as its fault lets it. What is put in are datagrams,
/// or messages of a network that does not let a garbled one through.
#[derive(Debug)]
pub(crate) struct Cable<T> {
    dice: Dice,
    /// What is on its way, each with the time at which it comes out, nanoseconds.
    on_way: VecDeque<(u64, T)>,
}

impl<T: Clone> Cable<T> {
    /// A sound line whose faults are random by that seed.
    pub fn new(seed: u64) -> Self {
        Self { dice: Dice::new(seed), on_way: VecDeque::new() }
    }

    /// Puts something in; `noise` is what becomes of it on a noisy line.
    pub fn put(&mut self, now_ns: u64, one: T, fault: Option<Fault>, noise: impl FnOnce(&mut Dice, T) -> Option<T>) {
        let one = match fault {
            Some(Fault::Unplugged) => None,
            Some(Fault::Loss) => lost(&mut self.dice, one),
            Some(Fault::Noise) => noise(&mut self.dice, one),
            _ => Some(one),
        };
        let Some(one) = one else { return };
        let out_ns = if fault == Some(Fault::Delayed) { now_ns + DELAY_NS } else { now_ns };
        if fault == Some(Fault::Duplicated) {
            self.on_way.push_back((out_ns, one.clone()));
        }
        self.on_way.push_back((out_ns, one));
    }

    /// The next that has come through.
    pub fn take(&mut self, now_ns: u64) -> Option<T> {
        let is_out = self.on_way.front().is_some_and(|(out_ns, _)| *out_ns <= now_ns);
        is_out.then(|| self.on_way.pop_front()).flatten().map(|(_, one)| one)
    }
}

/// A datagram on a noisy line.
pub(crate) fn garbled(dice: &mut Dice, mut datagram: Vec<u8>) -> Option<Vec<u8>> {
    flip(dice, &mut datagram);
    Some(datagram)
}

/// A message on a noisy line, whose datagrams the network's own checksums take away.
pub(crate) fn lost<T>(dice: &mut Dice, message: T) -> Option<T> {
    (dice.between((0, LOSS_OF)) >= 3).then_some(message)
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
    use super::{Cable, garbled};
    use messages::Fault;

    const MS: u64 = 1_000_000;

    /// Of 1,000 datagrams: how many came out by then, and how many of them damaged.
    fn through(fault: Option<Fault>, at_ns: u64) -> (usize, usize) {
        let mut cable = Cable::new(1);
        (0..1000).for_each(|_| cable.put(0, vec![0x55; 113], fault, garbled));
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
