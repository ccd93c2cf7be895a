//! Injected faults, applied where messages leave a process and in its wait loop. Nothing here is reached in a run that
//! was not started with faults allowed.

mod corrupt;

use std::cell::{Cell, RefCell};

use messages::fault::{
    DELAY_NS, Device, Dice, Fault, Injection, LEAK_BYTES, LEAK_MAX_BYTES, SENDING_NS, SILENT_NS, SLOW_EVERY,
    SLOW_TURN_NS, Target,
};
use messages::{Header, ServiceId, TopicId};
use rustix::event::{Timespec, poll};

use crate::TransportError;

pub(crate) use corrupt::{falsify, falsify_frame, garble, garble_frame, spoil_frame};

/// A message that waits for its time.
type Send = Box<dyn FnOnce() -> Result<(), TransportError>>;

/// A fault of one stream of this process.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StreamFault {
    topic: TopicId,
    of: ServiceId,
    pub fault: Fault,
    seed: u64,
    since_ns: u64,
    until_ns: u64,
    /// Which injection it is: a port begins anew with each.
    number: u64,
}

struct Late {
    number: u64,
    due_ns: u64,
    send: Send,
}

/// The faults of a process.
#[derive(Default)]
pub(crate) struct Faults {
    streams: RefCell<Vec<StreamFault>>,
    lines: RefCell<Vec<Injection>>,
    late: RefCell<Vec<Late>>,
    slow_until_ns: Cell<u64>,
    leak_until_ns: Cell<u64>,
    leaked: RefCell<Vec<Vec<u8>>>,
    injections: Cell<u64>,
    disk_full: Cell<bool>,
}

impl std::fmt::Debug for Faults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Faults").field("streams", &self.streams).finish_non_exhaustive()
    }
}

impl Faults {
    /// Takes an injection: a later one into the same target replaces the one before.
    pub fn take(&self, injection: &Injection) {
        let until_ns = injection.until_ns();
        match (injection.target, injection.fault) {
            (Target::Stream(topic, of), fault) => {
                self.streams.borrow_mut().retain(|one| (one.topic, one.of) != (topic, of));
                self.injections.set(self.injections.get() + 1);
                let number = self.injections.get();
                let (seed, since_ns) = (injection.seed, injection.since_ns);
                let active = fault.map(|fault| StreamFault { topic, of, fault, seed, since_ns, until_ns, number });
                self.streams.borrow_mut().extend(active);
            }
            (Target::Line(_), _) => {
                let mut lines = self.lines.borrow_mut();
                lines.retain(|one| one.target != injection.target);
                lines.extend(injection.fault.is_some().then_some(*injection));
            }
            (Target::Service(_), Some(Fault::Slow)) => self.slow_until_ns.set(until_ns),
            (Target::Service(_), Some(Fault::Leak)) => self.leak_until_ns.set(until_ns),
            (Target::Service(_), None) => {
                self.slow_until_ns.set(0);
                self.leak_until_ns.set(0);
                self.leaked.borrow_mut().clear();
            }
            (Target::Host, fault) => self.disk_full.set(fault == Some(Fault::FullDisk)),
            // Signals and starts are the supervisor's to do.
            (Target::Service(_), _) => {}
        }
    }

    /// The fault of a stream now, if it has one.
    pub fn of(&self, topic: TopicId, of: ServiceId, now_ns: u64) -> Option<StreamFault> {
        let streams = self.streams.borrow();
        streams.iter().find(|one| (one.topic, one.of) == (topic, of) && now_ns < one.until_ns).copied()
    }

    /// Sends later.
    pub fn later(&self, fault: &StreamFault, due_ns: u64, send: Send) {
        self.late.borrow_mut().push(Late { number: fault.number, due_ns, send });
    }

    /// When the next late message is due.
    pub fn next_late_ns(&self) -> Option<u64> {
        self.late.borrow().iter().map(|late| late.due_ns).min()
    }

    /// Sends the late messages that are due; those of a fault that is over are lost.
    ///
    /// # Errors
    /// Where one cannot be sent.
    pub fn send_late(&self, now_ns: u64) -> Result<(), TransportError> {
        if self.late.borrow().is_empty() {
            return Ok(());
        }
        let lasts = |number: u64| self.streams.borrow().iter().any(|s| s.number == number && now_ns < s.until_ns);
        let waiting = std::mem::take(&mut *self.late.borrow_mut());
        for late in waiting.into_iter().filter(|late| lasts(late.number)) {
            if late.due_ns <= now_ns {
                (late.send)()?;
            } else {
                self.late.borrow_mut().push(late);
            }
        }
        Ok(())
    }

    /// The fault of an emulated device's line now, if it has one.
    pub fn of_line(&self, device: Device, now_ns: u64) -> Option<(Fault, u64)> {
        let lines = self.lines.borrow();
        let line = lines.iter().find(|one| one.target == Target::Line(device) && now_ns < one.until_ns())?;
        Some((line.fault?, line.seed))
    }

    /// Whether the disk counts as full.
    pub fn disk_is_full(&self) -> bool {
        self.disk_full.get()
    }

    /// A turn of a slow process's loop.
    pub fn drag(&self, now_ns: u64) {
        if now_ns < self.slow_until_ns.get() {
            // Work that takes too long, as far as anybody can tell from outside.
            let span = Timespec { tv_sec: 0, tv_nsec: SLOW_TURN_NS as _ };
            let _ = poll(&mut [], Some(&span));
        }
    }

    /// A beat of a leaking process.
    pub fn leak(&self, now_ns: u64) {
        let mut leaked = self.leaked.borrow_mut();
        if now_ns < self.leak_until_ns.get() && leaked.len() * LEAK_BYTES < LEAK_MAX_BYTES {
            // Written, so that it is resident.
            leaked.push(vec![0xA5; LEAK_BYTES]);
        }
    }
}

/// What becomes of a message at a fault.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Passage {
    /// It is sent, as the fault leaves it.
    Now,
    /// It is sent at that run time.
    At(u64),
    /// It is lost.
    Never,
}

/// What a port remembers of the fault that it has.
#[derive(Debug)]
pub(crate) struct Filter<P> {
    number: u64,
    /// The header of the last message before the fault.
    pub before: Option<Header>,
    /// The first message under the fault, as it was meant.
    pub first: Option<P>,
    pub dice: Dice,
    count: u64,
    sending: bool,
    turns_at_ns: u64,
}

impl<P> Default for Filter<P> {
    fn default() -> Self {
        Self { number: 0, before: None, first: None, dice: Dice::default(), count: 0, sending: true, turns_at_ns: 0 }
    }
}

impl<P> Filter<P> {
    /// What becomes of the message that is to be published now.
    pub fn passage(&mut self, fault: &StreamFault, now_ns: u64) -> Passage {
        if self.number != fault.number {
            *self = Self {
                number: fault.number,
                before: self.before,
                dice: Dice::new(fault.seed),
                turns_at_ns: fault.since_ns,
                ..Self::default()
            };
        }
        self.count += 1;
        match fault.fault {
            Fault::Off => Passage::Never,
            Fault::Slow if !self.count.is_multiple_of(SLOW_EVERY) => Passage::Never,
            Fault::Delayed => Passage::At(now_ns + DELAY_NS),
            Fault::Intermittent if !self.is_sending(now_ns) => Passage::Never,
            _ => Passage::Now,
        }
    }

    fn is_sending(&mut self, now_ns: u64) -> bool {
        while now_ns >= self.turns_at_ns {
            self.sending = !self.sending;
            self.turns_at_ns += self.dice.between(if self.sending { SENDING_NS } else { SILENT_NS });
        }
        self.sending
    }

    /// The header as the fault leaves it, where it touches the header alone.
    pub fn header(&self, fault: Fault, header: Header) -> Header {
        let before = self.before.unwrap_or(header);
        match fault {
            Fault::StuckSeq => Header { seq: before.seq, ..header },
            Fault::StuckStamp => Header { stamp_ns: before.stamp_ns, ..header },
            _ => header,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Faults, Filter, Passage};
    use messages::fault::{DELAY_NS, Fault, Injection, SILENT_NS, Target};
    use messages::{ServiceId, TopicId};

    const MS: u64 = 1_000_000;
    const SCAN: Target = Target::Stream(TopicId::LidarScan, ServiceId::None);

    fn passages(fault: Fault, at_ns: impl Iterator<Item = u64>) -> Vec<Passage> {
        let faults = Faults::default();
        faults.take(&Injection { target: SCAN, fault: Some(fault), seed: 3, since_ns: 0, for_ns: None });
        let mut filter = Filter::<()>::default();
        let active = faults.of(TopicId::LidarScan, ServiceId::None, 0).expect("it was injected");
        at_ns.map(|now| filter.passage(&active, now)).collect()
    }

    #[test]
    fn each_fault_lets_through_what_its_row_says() {
        let every_100_ms = || (0..40).map(|i| i * 100 * MS);
        assert!(passages(Fault::Off, every_100_ms()).iter().all(|p| *p == Passage::Never));
        let slow = passages(Fault::Slow, every_100_ms());
        assert_eq!(slow.iter().filter(|p| **p == Passage::Now).count(), 4);
        assert_eq!(slow[9], Passage::Now);
        assert_eq!(passages(Fault::Delayed, [5].into_iter()), [Passage::At(5 + DELAY_NS)]);
        let bursts = passages(Fault::Intermittent, every_100_ms());
        let silent = SILENT_NS.0 / (100 * MS);
        assert!(bursts[..silent as usize].iter().all(|p| *p == Passage::Never), "{bursts:?}");
        assert!(bursts.contains(&Passage::Now));
        assert_eq!(bursts, passages(Fault::Intermittent, every_100_ms()), "the same seed, the same bursts");
    }

    #[test]
    fn a_fault_ends_with_its_time_and_with_none_and_takes_its_late_messages_along() {
        let faults = Faults::default();
        let of = |faults: &Faults, now| faults.of(TopicId::LidarScan, ServiceId::None, now).map(|f| f.fault);
        let late =
            Injection { target: SCAN, fault: Some(Fault::Delayed), seed: 1, since_ns: 0, for_ns: Some(500 * MS) };
        faults.take(&late);
        assert_eq!(of(&faults, 499 * MS), Some(Fault::Delayed));
        assert_eq!(of(&faults, 500 * MS), None);
        let sent = std::rc::Rc::new(std::cell::Cell::new(0));
        for due_ns in [200 * MS, 300 * MS] {
            let (sent, active) = (std::rc::Rc::clone(&sent), faults.of(TopicId::LidarScan, ServiceId::None, 100 * MS));
            let count = Box::new(move || {
                sent.set(sent.get() + 1);
                Ok(())
            });
            faults.later(&active.expect("it lasts"), due_ns, count);
        }
        assert_eq!(faults.next_late_ns(), Some(200 * MS));
        faults.send_late(250 * MS).expect("it is sent");
        assert_eq!((sent.get(), faults.next_late_ns()), (1, Some(300 * MS)));
        faults.take(&Injection { fault: None, ..late });
        faults.send_late(400 * MS).expect("nothing is to be sent");
        assert_eq!((sent.get(), faults.next_late_ns(), of(&faults, 260 * MS)), (1, None, None));
    }
}
