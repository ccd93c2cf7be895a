//! Typed ends of topics. Stamps, seqs, incarnations, steps and counters are kept here, for every service alike.

mod frames;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::*;
use messages::fault::Fault;
use messages::topic::TopicSpec;
use messages::{Header, MAX_PORTS, Message, PortCounters, PortRole, ServiceId, TopicId};

use crate::checked::{Mapped, Wire};
use crate::domain::{Domain, spec_of};
use crate::fault::{Faults, Filter, Passage, StreamFault, falsify, garble};
use crate::{Clock, Identity, TransportError};

pub use frames::{FrameLoan, FramePublisher, FrameSample, FrameSubscriber};

/// What all ports of a process share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub identity: Identity,
    /// Whether the process is a tool, which may open every topic.
    pub is_tool: bool,
    pub clock: Rc<Clock>,
    pub counters: RefCell<Vec<PortCounters>>,
    pub faults: Faults,
}

impl Shared {
    /// The row of a topic whose end this process asks for.
    fn row(&self, topic: TopicId, role: PortRole) -> Result<&'static TopicSpec, TransportError> {
        let spec = spec_of(topic)?;
        let (listed, end) = match role {
            PortRole::Publisher => (spec.publishers, "publishers"),
            PortRole::Subscriber => (spec.subscribers, "subscribers"),
        };
        let service = self.identity.service;
        if self.is_tool || listed.contains(&service) {
            Ok(spec)
        } else {
            Err(TransportError::NotListed { topic, service, end })
        }
    }

    fn register(&self, topic: TopicId, role: PortRole, of: ServiceId) -> usize {
        let mut counters = self.counters.borrow_mut();
        // No service has that many ports; the last slot would then be shared rather than memory overrun.
        if counters.len() < MAX_PORTS {
            counters.push(PortCounters { topic, role, of, ..PortCounters::default() });
        }
        counters.len() - 1
    }

    fn count(&self, slot: usize, header: &Header, lost: u64) {
        let mut counters = self.counters.borrow_mut();
        let port = &mut counters[slot];
        port.count += 1;
        port.lost = port.lost.saturating_add(lost);
        port.last_seq = header.seq;
        port.last_stamp_ns = header.stamp_ns;
    }

    /// What was read is no message.
    fn count_invalid(&self, slot: usize) {
        self.counters.borrow_mut()[slot].invalid += 1;
    }
}

/// What a message is beside those before it.
#[derive(Debug, PartialEq, Eq)]
enum News {
    /// It goes on; so many were lost before it.
    Next(u64),
    /// Its seq does not go on: of a writer that is stuck, or late.
    Old,
    /// Its seq is far ahead, and nothing confirms it: taken for true, it would make every one that follows old.
    Leap,
}

/// A seq that is further ahead is believed only once the next goes on from it.
const LEAP: u64 = 1 << 16;

/// The seqs of one publisher's life.
#[derive(Debug, Default, Clone, Copy)]
struct Life {
    incarnation: u32,
    last: u64,
    /// Whether one went on from another: before that, the first may have been false.
    is_confirmed: bool,
}

/// Notices gaps in the seqs of each publisher incarnation.
#[derive(Debug, Default)]
struct GapCounter {
    /// The lives seen last: two policies may publish in turn.
    lives: [Life; 4],
    /// The last leap.
    leap: (u32, u64),
}

impl GapCounter {
    fn take(&mut self, header: &Header) -> News {
        let Header { incarnation, seq, .. } = *header;
        let Some(life) = self.lives.iter_mut().find(|life| life.incarnation == incarnation) else {
            self.lives.rotate_right(1);
            self.lives[0] = Life { incarnation, last: seq, is_confirmed: false };
            return News::Next(0);
        };
        if seq == life.last || (seq < life.last && life.is_confirmed) {
            return News::Old;
        }
        if seq < life.last {
            life.last = seq;
            return News::Next(0);
        }
        let goes_on_from = |from: u64| seq > from && seq - from <= LEAP;
        let goes_on_from_leap = self.leap.0 == incarnation && goes_on_from(self.leap.1);
        if !goes_on_from(life.last) && !goes_on_from_leap {
            self.leap = (incarnation, seq);
            return News::Leap;
        }
        let lost = seq - life.last - 1;
        *life = Life { last: seq, is_confirmed: true, ..*life };
        News::Next(lost)
    }
}

fn publish_error(topic: TopicId, reason: impl std::fmt::Debug) -> TransportError {
    TransportError::Publish { topic, reason: format!("{reason:?}") }
}

fn receive_error(topic: TopicId, reason: impl std::fmt::Debug) -> TransportError {
    TransportError::Receive { topic, reason: format!("{reason:?}") }
}

/// Wakes the readers of a topic, where it wakes.
#[derive(Debug)]
struct Waker(Option<Notifier<ipc::Service>>);

impl Waker {
    fn open(domain: &Domain, topic: TopicId) -> Result<Self, TransportError> {
        let is_clock = matches!(topic, TopicId::ClockStep | TopicId::ClockAck);
        // In stepped time the master wakes everybody.
        if !spec_of(topic)?.wakes || (domain.clock.is_stepped() && !is_clock) {
            return Ok(Self(None));
        }
        let notifier = domain.event(topic, false)?.notifier_builder().create();
        notifier
            .map(|n| Self(Some(n)))
            .map_err(|e| TransportError::Open { topic: topic.name().to_owned(), reason: format!("{e:?}") })
    }

    fn wake(&self) {
        if let Some(notifier) = &self.0 {
            // A reader that is gone or full of wake-ups has nothing to be told; the message itself is sent.
            let _ = notifier.notify();
        }
    }
}

/// The event of a topic, for the wait loop.
pub(crate) fn listener(domain: &Domain, topic: TopicId) -> Result<Listener<ipc::Service>, TransportError> {
    domain
        .event(topic, false)?
        .listener_builder()
        .create()
        .map_err(|e| TransportError::Open { topic: topic.name().to_owned(), reason: format!("{e:?}") })
}

/// The far side of a writer: what is sent here is on its way.
#[derive(Debug)]
struct Outlet<P> {
    port: P,
    waker: Waker,
    shared: Rc<Shared>,
    slot: usize,
}

impl<M: Message + ZeroCopySend> Outlet<IoxPublisher<ipc::Service, Wire<M>, ()>> {
    fn send(&self, message: M) -> Result<(), TransportError> {
        self.send_uncounted(message)?;
        self.shared.count(self.slot, message.header(), 0);
        Ok(())
    }

    fn send_uncounted(&self, message: M) -> Result<(), TransportError> {
        self.port.send_copy(Wire::new(message)).map_err(|e| publish_error(M::TOPIC, e))?;
        self.waker.wake();
        Ok(())
    }
}

/// Writes messages of fixed size.
#[derive(Debug)]
pub struct Publisher<M: Message + ZeroCopySend> {
    outlet: Rc<Outlet<IoxPublisher<ipc::Service, Wire<M>, ()>>>,
    of: ServiceId,
    seq: u64,
    filter: Filter<M>,
}

impl<M: Message + ZeroCopySend> Publisher<M> {
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>, of: ServiceId) -> Result<Self, TransportError> {
        let spec = shared.row(M::TOPIC, PortRole::Publisher)?;
        let port = domain
            .messages::<M>(of, false)?
            .publisher_builder()
            .max_loaned_samples(spec.loans)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        let slot = shared.register(M::TOPIC, PortRole::Publisher, of);
        let outlet = Outlet { port, waker: Waker::open(domain, M::TOPIC)?, shared: Rc::clone(shared), slot };
        Ok(Self { outlet: Rc::new(outlet), of, seq: 0, filter: Filter::default() })
    }

    /// Publishes a message measured at `stamp_ns` of run time, wakes its readers, and gives it back as sent.
    ///
    /// # Errors
    /// Where no memory of the pool is free, or a connection is broken.
    pub fn publish(&mut self, stamp_ns: u64, message: M) -> Result<M, TransportError> {
        self.seq += 1;
        let header = next_header(&self.outlet.shared, stamp_ns, self.seq);
        self.send(header, message)
    }

    /// Publishes a recorded message again: stamp, seq and incarnation are those in its header, step and time of
    /// publication those of now.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn republish(&mut self, message: M) -> Result<M, TransportError> {
        self.send(recorded_header(&self.outlet.shared, message.header()), message)
    }

    fn send(&mut self, header: Header, mut message: M) -> Result<M, TransportError> {
        *message.header_mut() = header;
        if let Some(fault) = self.outlet.shared.faults.of(M::TOPIC, self.of, header.published_ns) {
            return self.publish_at_fault(&fault, message);
        }
        self.filter.before = Some(header);
        self.outlet.send(message)?;
        Ok(message)
    }

    fn publish_at_fault(&mut self, fault: &StreamFault, mut message: M) -> Result<M, TransportError> {
        let shared = &self.outlet.shared;
        match self.filter.passage(fault, message.header().published_ns) {
            Passage::Now => {}
            Passage::Never => return Ok(message),
            Passage::At(due_ns) => {
                let outlet = Rc::clone(&self.outlet);
                let send = move || {
                    message.header_mut().step = outlet.shared.clock.step();
                    outlet.send_uncounted(message)
                };
                // It is late on its way: the process has done its part.
                shared.count(self.outlet.slot, message.header(), 0);
                shared.faults.later(fault, due_ns, Box::new(send));
                return Ok(message);
            }
        }
        let (header, first) = (*message.header(), *self.filter.first.get_or_insert(message));
        match fault.fault {
            Fault::StuckBytes => message = first,
            Fault::Garbage => garble(&mut message, &mut self.filter.dice),
            Fault::Wrong => falsify(&mut message, &first),
            _ => {}
        }
        if fault.fault != Fault::Garbage {
            *message.header_mut() = self.filter.header(fault.fault, header);
        }
        self.outlet.send(message)?;
        Ok(message)
    }
}

fn next_header(shared: &Shared, stamp_ns: u64, seq: u64) -> Header {
    Header {
        stamp_ns,
        seq,
        step: shared.clock.step(),
        published_ns: shared.clock.now_ns(),
        incarnation: shared.identity.incarnation,
        reserved: 0,
    }
}

fn recorded_header(shared: &Shared, recorded: &Header) -> Header {
    Header { step: shared.clock.step(), published_ns: shared.clock.now_ns(), ..*recorded }
}

/// The near side of a reader: what has come is counted here, and let in where it is a message and news.
#[derive(Debug)]
struct Inlet {
    shared: Rc<Shared>,
    slot: usize,
    gaps: GapCounter,
    mapped: Mapped,
    /// So many messages may wait at once; who finds more that are none comes back later.
    buffer: usize,
}

impl Inlet {
    fn open(shared: &Rc<Shared>, spec: &TopicSpec, of: ServiceId) -> Self {
        let slot = shared.register(spec.id, PortRole::Subscriber, of);
        let (gaps, mapped) = (GapCounter::default(), Mapped::default());
        Self { shared: Rc::clone(shared), slot, gaps, mapped, buffer: spec.buffer }
    }

    /// Whether what was read is a message that can have been sent by now; counts what is not.
    fn admits(&self, header: Option<&Header>) -> bool {
        let is_one = header.is_some_and(|header| self.shared.clock.may_come(header));
        if !is_one {
            self.shared.count_invalid(self.slot);
        }
        is_one
    }

    /// Whether a message is news; counts it, and what was lost before it.
    fn is_news(&mut self, header: &Header) -> bool {
        match self.gaps.take(header) {
            News::Next(lost) => self.shared.count(self.slot, header, lost),
            News::Old => return false,
            News::Leap => {
                self.shared.count_invalid(self.slot);
                return false;
            }
        }
        true
    }
}

/// Reads messages of fixed size.
#[derive(Debug)]
pub struct Subscriber<M: Message + ZeroCopySend> {
    port: IoxSubscriber<ipc::Service, Wire<M>, ()>,
    inlet: Inlet,
    /// In stepped time: what came but may not be seen yet, sorted by (step, stamp, seq, incarnation).
    pending: VecDeque<M>,
}

impl<M: Message + ZeroCopySend> Subscriber<M> {
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>, of: ServiceId) -> Result<Self, TransportError> {
        let spec = shared.row(M::TOPIC, PortRole::Subscriber)?;
        let port = domain
            .messages::<M>(of, false)?
            .subscriber_builder()
            .buffer_size(spec.buffer)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        Ok(Self { port, inlet: Inlet::open(shared, spec, of), pending: VecDeque::new() })
    }

    /// The next message that may be seen. What is no message is dropped and counted; one whose seq does not go on is
    /// no news, and is let go.
    ///
    /// # Errors
    /// Where a connection is broken.
    pub fn take(&mut self) -> Result<Option<M>, TransportError> {
        while let Some(message) = self.next_visible()? {
            let old = self.inlet.shared.clock.is_before_joining(message.header().step);
            if !old && self.inlet.is_news(message.header()) {
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    fn next_visible(&mut self) -> Result<Option<M>, TransportError> {
        if !self.inlet.shared.clock.is_stepped() {
            return self.receive();
        }
        self.refill()?;
        match self.pending.front() {
            Some(first) if self.inlet.shared.clock.may_see(first.header().step) => Ok(self.pending.pop_front()),
            _ => Ok(None),
        }
    }

    /// The newest message that may be seen; those before it are taken and let go.
    ///
    /// # Errors
    /// As [`Subscriber::take`].
    pub fn take_newest(&mut self) -> Result<Option<M>, TransportError> {
        let mut newest = None;
        while let Some(message) = self.take()? {
            newest = Some(message);
        }
        Ok(newest)
    }

    /// The next message whatever the step: for the last figures of a run whose time stands still.
    ///
    /// # Errors
    /// Where a connection is broken.
    pub fn take_at_once(&mut self) -> Result<Option<M>, TransportError> {
        if let Some(message) = self.pending.pop_front() {
            return Ok(Some(message));
        }
        self.receive()
    }

    /// The next message whatever the step, for the clock itself.
    pub(crate) fn receive(&mut self) -> Result<Option<M>, TransportError> {
        for _ in 0..self.inlet.buffer {
            let sample = self.port.receive().map_err(|e| receive_error(M::TOPIC, e))?;
            let Some(sample) = sample else { return Ok(None) };
            let message = sample.payload().read(&mut self.inlet.mapped, sample.origin().value());
            if self.inlet.admits(message.as_ref().map(Message::header)) {
                return Ok(message);
            }
        }
        Ok(None)
    }

    fn refill(&mut self) -> Result<(), TransportError> {
        let before = self.pending.len();
        while let Some(message) = self.receive()? {
            self.pending.push_back(message);
        }
        if self.pending.len() > before {
            self.pending.make_contiguous().sort_by_key(|message| sort_key(message.header()));
        }
        Ok(())
    }
}

fn sort_key(header: &Header) -> (u64, u64, u64, u32) {
    (header.step, header.stamp_ns, header.seq, header.incarnation)
}

#[cfg(test)]
mod tests {
    use super::{GapCounter, LEAP, News};
    use messages::Header;

    #[test]
    fn gaps_are_counted_and_a_leap_is_believed_only_once_it_goes_on() {
        let mut gaps = GapCounter::default();
        let mut take = |incarnation, seq| gaps.take(&Header { incarnation, seq, ..Header::default() });
        assert_eq!(take(1, 7), News::Next(0), "who comes late has lost nothing");
        assert_eq!(take(1, 10), News::Next(2));
        assert_eq!(take(1, 10), News::Old);
        assert_eq!(take(2, 3), News::Next(0), "each life counts for itself");
        // Random numbers make nobody deaf.
        assert_eq!(take(1, u64::MAX), News::Leap);
        assert_eq!(take(1, u64::MAX / 3), News::Leap);
        assert_eq!(take(1, 11), News::Next(0));
        // A reader that slept for very long hears again.
        assert_eq!(take(1, 12 + LEAP), News::Leap);
        assert_eq!(take(1, 13 + LEAP), News::Next(LEAP + 1));
        assert_eq!(take(1, 14 + LEAP), News::Next(0));
        // Nor does a false first one.
        assert_eq!(take(3, u64::MAX), News::Next(0));
        assert_eq!(take(3, u64::MAX), News::Old);
        assert_eq!((take(3, 5), take(3, 6), take(3, 5)), (News::Next(0), News::Next(0), News::Old));
    }
}
