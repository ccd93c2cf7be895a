//! Typed ends of topics. Stamps, seqs, incarnations, steps and counters are kept here, for every service alike.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::header::payload_header::PayloadHeader;
use messages::fault::Fault;
use messages::{Frame, Header, MAX_PORTS, Message, PortCounters, PortRole, ServiceId, TopicId};

use crate::checked::{Mapped, Wire};
use crate::domain::{Domain, spec_of};
use crate::fault::{Faults, Filter, Passage, StreamFault};
use crate::{Clock, Identity, TransportError};

/// What all ports of a process share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub identity: Identity,
    pub clock: Rc<Clock>,
    pub counters: RefCell<Vec<PortCounters>>,
    pub faults: Faults,
}

impl Shared {
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

/// Notices gaps in the seqs of each publisher incarnation.
#[derive(Debug, Default)]
struct GapCounter {
    /// The last seq of the incarnations seen last: two policies may publish in turn.
    last: [(u32, u64); 4],
}

impl GapCounter {
    /// Whether the seq goes on. One that does not is of a writer that is stuck, or came late: news it is not.
    fn goes_on(&self, header: &Header) -> bool {
        !self.last.iter().any(|(incarnation, last)| *incarnation == header.incarnation && header.seq <= *last)
    }

    fn lost(&mut self, header: &Header) -> u64 {
        if let Some((_, last)) = self.last.iter_mut().find(|(incarnation, _)| *incarnation == header.incarnation) {
            let lost = header.seq.saturating_sub(last.saturating_add(1));
            *last = header.seq.max(*last);
            return lost;
        }
        self.last.rotate_right(1);
        self.last[0] = (header.incarnation, header.seq);
        0
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
        let spec = spec_of(M::TOPIC)?;
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
            Fault::Garbage => message.garble(&mut self.filter.dice),
            Fault::Wrong => message.falsify(&first),
            _ => {}
        }
        if fault.fault != Fault::Garbage {
            *message.header_mut() = Filter::<M>::header(fault.fault, header, first.header());
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

/// Reads messages of fixed size.
#[derive(Debug)]
pub struct Subscriber<M: Message + ZeroCopySend> {
    port: IoxSubscriber<ipc::Service, Wire<M>, ()>,
    shared: Rc<Shared>,
    slot: usize,
    gaps: GapCounter,
    mapped: Mapped,
    /// So many messages may wait at once; who finds more that are none comes back later.
    buffer: usize,
    /// In stepped time: what came but may not be seen yet, sorted by (step, stamp, seq, incarnation).
    pending: VecDeque<M>,
}

impl<M: Message + ZeroCopySend> Subscriber<M> {
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>, of: ServiceId) -> Result<Self, TransportError> {
        let spec = spec_of(M::TOPIC)?;
        let port = domain
            .messages::<M>(of, false)?
            .subscriber_builder()
            .buffer_size(spec.buffer)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        let slot = shared.register(M::TOPIC, PortRole::Subscriber, of);
        Ok(Self {
            port,
            shared: Rc::clone(shared),
            slot,
            gaps: GapCounter::default(),
            mapped: Mapped::default(),
            buffer: spec.buffer,
            pending: VecDeque::new(),
        })
    }

    /// The next message that may be seen. What is no message is dropped and counted; one whose seq does not go on is
    /// no news, and is let go.
    ///
    /// # Errors
    /// Where a connection is broken.
    pub fn take(&mut self) -> Result<Option<M>, TransportError> {
        while let Some(message) = self.next_visible()? {
            if self.gaps.goes_on(message.header()) {
                let lost = self.gaps.lost(message.header());
                self.shared.count(self.slot, message.header(), lost);
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    fn next_visible(&mut self) -> Result<Option<M>, TransportError> {
        if !self.shared.clock.is_stepped() {
            return self.receive();
        }
        self.refill()?;
        match self.pending.front() {
            Some(first) if self.shared.clock.may_see(first.header().step) => Ok(self.pending.pop_front()),
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
        for _ in 0..self.buffer {
            let sample = self.port.receive().map_err(|e| receive_error(M::TOPIC, e))?;
            let Some(sample) = sample else { return Ok(None) };
            match sample.payload().read(&mut self.mapped, sample.origin().value()) {
                Some(message) if self.shared.clock.may_come(message.header()) => return Ok(Some(message)),
                _ => self.shared.count_invalid(self.slot),
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

/// The far side of a writer of frames.
#[derive(Debug)]
struct FrameOutlet<F: Frame>(Outlet<FramePort<F>>)
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend;

impl<F: Frame> FrameOutlet<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    fn loan(&self, len: usize) -> Result<FrameLoan<F>, TransportError> {
        let mut loan = self.0.port.loan_slice_uninit(len).map_err(|e| publish_error(F::Meta::TOPIC, e))?;
        *loan.user_header_mut() = F::Meta::default();
        // SAFETY: the slice lies in a mapped file, whose bytes always hold a value (zero or what was written before),
        // and any value is a valid `F::Element` (`FromBytes`).
        Ok(FrameLoan(unsafe { loan.assume_init() }))
    }

    fn send(&self, loan: FrameLoan<F>) -> Result<(), TransportError> {
        let header = *loan.0.user_header().header();
        self.send_uncounted(loan)?;
        self.0.shared.count(self.0.slot, &header, 0);
        Ok(())
    }

    fn send_uncounted(&self, loan: FrameLoan<F>) -> Result<(), TransportError> {
        loan.0.send().map_err(|e| publish_error(F::Meta::TOPIC, e))?;
        self.0.waker.wake();
        Ok(())
    }
}

type FramePort<F> = IoxPublisher<ipc::Service, [<F as Frame>::Element], <F as Frame>::Meta>;
/// A frame as it was before a fault touched it.
type Copied<F> = (<F as Frame>::Meta, Vec<<F as Frame>::Element>);

/// Writes frames in place.
#[derive(Debug)]
pub struct FramePublisher<F: Frame>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    outlet: Rc<FrameOutlet<F>>,
    seq: u64,
    filter: Filter<Copied<F>>,
}

/// A frame being written, in shared memory.
#[derive(Debug)]
pub struct FrameLoan<F: Frame>(SampleMut<ipc::Service, [F::Element], F::Meta>)
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend;

impl<F: Frame> FrameLoan<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    /// What stands beside the slice; its header is filled in when it is published.
    pub fn meta_mut(&mut self) -> &mut F::Meta {
        self.0.user_header_mut()
    }

    /// The slice, holding whatever the frame before left there.
    pub fn data_mut(&mut self) -> &mut [F::Element] {
        self.0.payload_mut()
    }
}

impl<F: Frame> FramePublisher<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>, max_len: usize) -> Result<Self, TransportError> {
        let spec = spec_of(F::Meta::TOPIC)?;
        let port = domain
            .frames::<F>(false)?
            .publisher_builder()
            .max_loaned_samples(spec.loans)
            .initial_max_slice_len(max_len)
            .allocation_strategy(AllocationStrategy::Static)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        let slot = shared.register(F::Meta::TOPIC, PortRole::Publisher, ServiceId::None);
        let outlet = Outlet { port, waker: Waker::open(domain, F::Meta::TOPIC)?, shared: Rc::clone(shared), slot };
        Ok(Self { outlet: Rc::new(FrameOutlet(outlet)), seq: 0, filter: Filter::default() })
    }

    /// Loans a frame of `len` elements, to be written in place.
    ///
    /// # Errors
    /// Where `len` is over the length that the port was opened for, or no memory of the pool is free.
    pub fn loan(&mut self, len: usize) -> Result<FrameLoan<F>, TransportError> {
        self.outlet.loan(len)
    }

    /// Publishes a frame measured at `stamp_ns` of run time and wakes its readers.
    ///
    /// # Errors
    /// Where a connection is broken.
    pub fn publish(&mut self, stamp_ns: u64, loan: FrameLoan<F>) -> Result<Header, TransportError> {
        self.seq += 1;
        let header = next_header(&self.outlet.0.shared, stamp_ns, self.seq);
        self.send(header, loan)
    }

    /// Publishes a recorded frame again, as [`Publisher::republish`] does.
    ///
    /// # Errors
    /// Where a connection is broken.
    pub fn republish(&mut self, mut loan: FrameLoan<F>) -> Result<Header, TransportError> {
        let header = recorded_header(&self.outlet.0.shared, loan.meta_mut().header());
        self.send(header, loan)
    }

    fn send(&mut self, header: Header, mut loan: FrameLoan<F>) -> Result<Header, TransportError> {
        *loan.meta_mut().header_mut() = header;
        if let Some(fault) = self.outlet.0.shared.faults.of(F::Meta::TOPIC, ServiceId::None, header.published_ns) {
            return self.publish_at_fault(&fault, loan).map(|()| header);
        }
        self.outlet.send(loan)?;
        Ok(header)
    }

    fn publish_at_fault(&mut self, fault: &StreamFault, mut loan: FrameLoan<F>) -> Result<(), TransportError> {
        let header = *loan.meta_mut().header();
        match self.filter.passage(fault, header.published_ns) {
            Passage::Now => {}
            Passage::Never => return Ok(()),
            Passage::At(due_ns) => {
                let outlet = Rc::clone(&self.outlet);
                let (mut meta, data) = (*loan.meta_mut(), loan.data_mut().to_vec());
                let send = move || {
                    let mut loan = outlet.loan(data.len())?;
                    meta.header_mut().step = outlet.0.shared.clock.step();
                    *loan.meta_mut() = meta;
                    loan.data_mut().copy_from_slice(&data);
                    outlet.send_uncounted(loan)
                };
                // It is late on its way: the process has done its part.
                self.outlet.0.shared.count(self.outlet.0.slot, &header, 0);
                self.outlet.0.shared.faults.later(fault, due_ns, Box::new(send));
                return Ok(());
            }
        }
        let first = self.filter.first.get_or_insert_with(|| (*loan.meta_mut(), loan.data_mut().to_vec()));
        let (meta, data) = (loan.0.user_header().to_owned(), &first.1);
        match fault.fault {
            Fault::StuckBytes if data.len() == loan.data_mut().len() => loan.data_mut().copy_from_slice(data),
            Fault::Wrong => F::falsify(loan.data_mut()),
            Fault::Garbage => {
                let mut garbled = meta;
                F::garble(&mut garbled, loan.data_mut(), &mut self.filter.dice);
                *loan.meta_mut() = garbled;
            }
            _ => {}
        }
        if fault.fault != Fault::Garbage {
            *loan.meta_mut().header_mut() = Filter::<Copied<F>>::header(fault.fault, header, first.0.header());
        }
        self.outlet.send(loan)
    }
}

/// A frame in shared memory, held until it is dropped.
#[derive(Debug)]
pub struct FrameSample<F: Frame>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    /// A copy: what was checked stays as it was.
    meta: F::Meta,
    /// Elements, as checked.
    len: usize,
    data: *const F::Element,
    /// Keeps the slice from being written again by its publisher.
    _held: Sample<ipc::Service, [F::Element], F::Meta>,
}

impl<F: Frame> FrameSample<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    /// What stands beside the slice.
    #[must_use]
    pub fn meta(&self) -> &F::Meta {
        &self.meta
    }

    /// The slice. A publisher that breaks its word can still write to it: any bytes are an element, but two looks at
    /// the same one may differ.
    #[must_use]
    pub fn data(&self) -> &[F::Element] {
        // SAFETY: so many elements were seen to be mapped and aligned, and stay so for as long as the sample is held.
        unsafe { std::slice::from_raw_parts(self.data, self.len) }
    }

    /// The frame that a sample is, if it is one.
    fn of(sample: Sample<ipc::Service, [F::Element], F::Meta>, mapped: &mut Mapped) -> Option<Self> {
        let publisher = sample.origin().value();
        // Nothing is read before it is known to be there; a reference to what is not read yet reads nothing.
        let meta: F::Meta = mapped.copy(publisher, std::ptr::from_ref(sample.user_header()).cast())?;
        let header = std::ptr::from_ref(sample.header()).cast();
        let len = mapped.holds(publisher, header, size_of_val(sample.header())).then(|| sample.header())?;
        let len = usize::try_from(len.number_of_elements()).ok()?;
        if !F::fits(&meta, len) {
            return None;
        }
        let data = sample.payload().as_ptr();
        let is_there = mapped.holds(publisher, data.cast(), len.checked_mul(size_of::<F::Element>())?);
        (is_there && data.is_aligned()).then_some(Self { meta, len, data, _held: sample })
    }
}

/// Reads frames without copying them.
#[derive(Debug)]
pub struct FrameSubscriber<F: Frame>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    port: IoxSubscriber<ipc::Service, [F::Element], F::Meta>,
    shared: Rc<Shared>,
    slot: usize,
    gaps: GapCounter,
    mapped: Mapped,
    buffer: usize,
    pending: VecDeque<FrameSample<F>>,
}

impl<F: Frame> FrameSubscriber<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>) -> Result<Self, TransportError> {
        let spec = spec_of(F::Meta::TOPIC)?;
        let port = domain
            .frames::<F>(false)?
            .subscriber_builder()
            .buffer_size(spec.buffer)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        let slot = shared.register(F::Meta::TOPIC, PortRole::Subscriber, ServiceId::None);
        Ok(Self {
            port,
            shared: Rc::clone(shared),
            slot,
            gaps: GapCounter::default(),
            mapped: Mapped::default(),
            buffer: spec.buffer,
            pending: VecDeque::new(),
        })
    }

    /// The next frame whatever the step: for the last frames of a run whose time stands still.
    ///
    /// # Errors
    /// As [`FrameSubscriber::take`].
    pub fn take_at_once(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        match self.pending.pop_front() {
            Some(sample) => Ok(Some(sample)),
            None => self.receive(),
        }
    }

    /// The next frame that may be seen. What is no frame is dropped and counted; one whose seq does not go on is no
    /// news, and is let go.
    ///
    /// # Errors
    /// Where a connection is broken, or the caller holds more frames than the topic table lets it.
    pub fn take(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        while let Some(sample) = self.next_visible()? {
            if self.gaps.goes_on(sample.meta().header()) {
                let lost = self.gaps.lost(sample.meta().header());
                self.shared.count(self.slot, sample.meta().header(), lost);
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    fn next_visible(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        if !self.shared.clock.is_stepped() {
            return self.receive();
        }
        // One frame a step is the most that a driver sends: one that may be seen, and an early one.
        if self.pending.len() < 2
            && let Some(sample) = self.receive()?
        {
            self.pending.push_back(sample);
            self.pending.make_contiguous().sort_by_key(|sample| sort_key(sample.meta().header()));
        }
        match self.pending.front() {
            Some(first) if self.shared.clock.may_see(first.meta().header().step) => Ok(self.pending.pop_front()),
            _ => Ok(None),
        }
    }

    fn receive(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        for _ in 0..self.buffer {
            let sample = self.port.receive().map_err(|e| receive_error(F::Meta::TOPIC, e))?;
            let Some(sample) = sample else { return Ok(None) };
            match FrameSample::<F>::of(sample, &mut self.mapped) {
                Some(frame) if self.shared.clock.may_come(frame.meta().header()) => return Ok(Some(frame)),
                _ => self.shared.count_invalid(self.slot),
            }
        }
        Ok(None)
    }
}
