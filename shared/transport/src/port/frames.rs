//! Topics whose messages are slices, written and read where they lie in shared memory.

use std::collections::VecDeque;
use std::rc::Rc;

use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::header::payload_header::PayloadHeader;
use messages::fault::Fault;
use messages::{Frame, Header, Message, PortRole, ServiceId};

use super::{Inlet, Outlet, Shared, Waker, next_header, publish_error, receive_error, recorded_header, sort_key};
use crate::TransportError;
use crate::checked::Mapped;
use crate::domain::Domain;
use crate::fault::{Filter, Passage, StreamFault, falsify_frame, garble_frame, spoil_frame};

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
        let spec = shared.row(F::Meta::TOPIC, PortRole::Publisher)?;
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

    /// Publishes a recorded frame again, as [`Publisher::republish`](super::Publisher::republish) does.
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
        self.filter.before = Some(header);
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
            Fault::Wrong => falsify_frame::<F>(loan.data_mut()),
            Fault::NoFloor | Fault::Tilted => {
                let mut spoiled = meta;
                spoil_frame::<F>(&mut spoiled, loan.data_mut(), fault.fault);
                *loan.meta_mut() = spoiled;
            }
            Fault::Garbage => {
                let mut garbled = meta;
                garble_frame::<F>(&mut garbled, loan.data_mut(), &mut self.filter.dice);
                *loan.meta_mut() = garbled;
            }
            _ => {}
        }
        if fault.fault != Fault::Garbage {
            *loan.meta_mut().header_mut() = self.filter.header(fault.fault, header);
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
    inlet: Inlet,
    pending: VecDeque<FrameSample<F>>,
}

impl<F: Frame> FrameSubscriber<F>
where
    F::Element: ZeroCopySend,
    F::Meta: ZeroCopySend,
{
    pub(crate) fn open(domain: &Domain, shared: &Rc<Shared>) -> Result<Self, TransportError> {
        let spec = shared.row(F::Meta::TOPIC, PortRole::Subscriber)?;
        let port = domain
            .frames::<F>(false)?
            .subscriber_builder()
            .buffer_size(spec.buffer)
            .create()
            .map_err(|e| TransportError::Open { topic: spec.name.to_owned(), reason: format!("{e:?}") })?;
        Ok(Self { port, inlet: Inlet::open(shared, spec, ServiceId::None), pending: VecDeque::new() })
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
            let header = sample.meta().header();
            if !self.inlet.shared.clock.is_before_joining(header.step) && self.inlet.is_news(header) {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    fn next_visible(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        if !self.inlet.shared.clock.is_stepped() {
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
            Some(first) if self.inlet.shared.clock.may_see(first.meta().header().step) => Ok(self.pending.pop_front()),
            _ => Ok(None),
        }
    }

    fn receive(&mut self) -> Result<Option<FrameSample<F>>, TransportError> {
        for _ in 0..self.inlet.buffer {
            let sample = self.port.receive().map_err(|e| receive_error(F::Meta::TOPIC, e))?;
            let Some(sample) = sample else { return Ok(None) };
            let frame = FrameSample::<F>::of(sample, &mut self.inlet.mapped);
            if self.inlet.admits(frame.as_ref().map(|frame| frame.meta().header())) {
                return Ok(frame);
            }
        }
        Ok(None)
    }
}
