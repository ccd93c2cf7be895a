//! What a service has to do with the world.

use std::cell::RefCell;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::*;
use messages::fault::Device;
use messages::{Fault, Frame, Health, Injection, Message, PortCounters, ServiceId, TopicId};
use nix::sys::signalfd::SignalFd;
use rustix::event::{Timespec, epoll};

use crate::TransportError;
use crate::domain::{Domain, spec_of};
use crate::fault::Faults;
use crate::line::{FromChild, Line, Received, ToChild};
use crate::port::{FramePublisher, FrameSubscriber, Publisher, Shared, Subscriber, listener};
use crate::service::Identity;
use crate::urgent;

/// The control line has something to read.
pub(crate) const TOKEN_CONTROL: u64 = 0;
const TOKEN_CLOCK: u64 = 1;
const TOKEN_TOPIC: u64 = 2;
pub(crate) const TOKEN_ORPHANED: u64 = 3;
/// Tokens from here on are the service's own.
pub(crate) const TOKEN_OWN: u64 = 1 << 32;

/// What a service has to do with the world: its ports, its clock, its lines.
pub struct Io {
    /// The run.
    pub domain: Domain,
    shared: Rc<Shared>,
    epoll: OwnedFd,
    listeners: Vec<Listener<ipc::Service>>,
    control: Option<Line>,
    /// Readable when the supervisor has died, before its lines close: for who stops the robot.
    orphaned: Option<SignalFd>,
    /// Held open for as long as the process lives: its closing is the process's death notice.
    _lifeline: Option<OwnedFd>,
}

impl std::fmt::Debug for Io {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Io").field("identity", &self.shared.identity).finish_non_exhaustive()
    }
}

fn watch_fd(epoll_fd: &OwnedFd, fd: impl AsFd, token: u64) -> Result<(), TransportError> {
    epoll::add(epoll_fd, fd, epoll::EventData::new_u64(token), epoll::EventFlags::IN)
        .map_err(TransportError::system("epoll_ctl"))
}

impl Io {
    pub(crate) fn new(
        domain: Domain,
        identity: Identity,
        is_tool: bool,
        control: Option<Line>,
        lifeline: Option<OwnedFd>,
    ) -> Result<Self, TransportError> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(TransportError::system("epoll_create"))?;
        if let Some(line) = &control {
            watch_fd(&epoll, line, TOKEN_CONTROL)?;
        }
        let orphaned = if identity.service.stops_robot() { Some(urgent::hangup()?) } else { None };
        if let Some(signal) = &orphaned {
            watch_fd(&epoll, signal, TOKEN_ORPHANED)?;
        }
        let shared = Rc::new(Shared {
            identity,
            is_tool,
            clock: Rc::clone(&domain.clock),
            counters: RefCell::new(Vec::new()),
            faults: Faults::default(),
        });
        Ok(Self { domain, shared, epoll, listeners: Vec::new(), control, orphaned, _lifeline: lifeline })
    }

    /// Which service this is, and which life of it.
    #[must_use]
    pub fn identity(&self) -> Identity {
        self.shared.identity
    }

    /// Run time, nanoseconds.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.domain.clock.now_ns()
    }

    /// A writer of a topic with messages of fixed size.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn publisher<M: Message + ZeroCopySend>(&mut self) -> Result<Publisher<M>, TransportError> {
        let of = if M::TOPIC == TopicId::Health { self.shared.identity.service } else { ServiceId::None };
        Publisher::open(&self.domain, &self.shared, of)
    }

    /// A reader of a topic with messages of fixed size; a message wakes the service where the topic wakes.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn subscriber<M: Message + ZeroCopySend>(&mut self) -> Result<Subscriber<M>, TransportError> {
        let subscriber = Subscriber::open(&self.domain, &self.shared, ServiceId::None)?;
        self.listen(M::TOPIC)?;
        Ok(subscriber)
    }

    /// A reader whose messages do not wake the service: for who looks at its own times, at the latest at every beat.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn quiet_subscriber<M: Message + ZeroCopySend>(&mut self) -> Result<Subscriber<M>, TransportError> {
        Subscriber::open(&self.domain, &self.shared, ServiceId::None)
    }

    /// A reader of one service's beats.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn health_of(&mut self, service: ServiceId) -> Result<Subscriber<Health>, TransportError> {
        Subscriber::open(&self.domain, &self.shared, service)
    }

    /// A writer of frames of at most `max_len` elements.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn frame_publisher<F: Frame>(&mut self, max_len: usize) -> Result<FramePublisher<F>, TransportError>
    where
        F::Element: ZeroCopySend,
        F::Meta: ZeroCopySend,
    {
        FramePublisher::open(&self.domain, &self.shared, max_len)
    }

    /// A reader of frames.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or its row does not list this service.
    pub fn frame_subscriber<F: Frame>(&mut self) -> Result<FrameSubscriber<F>, TransportError>
    where
        F::Element: ZeroCopySend,
        F::Meta: ZeroCopySend,
    {
        let subscriber = FrameSubscriber::open(&self.domain, &self.shared)?;
        self.listen(F::Meta::TOPIC)?;
        Ok(subscriber)
    }

    /// Applies an injected fault to what this process publishes, or mends it; `false` in a run without faults.
    pub fn inject(&self, injection: &Injection) -> bool {
        if self.domain.info.faults {
            self.shared.faults.take(injection);
        }
        self.domain.info.faults
    }

    /// Whether whoever writes files in this process finds the disk full: an injected fault.
    #[must_use]
    pub fn disk_is_full(&self) -> bool {
        self.shared.faults.disk_is_full()
    }

    /// What an emulated device suffers now, and the seed of what is random about it: an injected fault.
    #[must_use]
    pub fn line_fault(&self, device: Device) -> Option<(Fault, u64)> {
        self.shared.faults.of_line(device, self.now_ns())
    }

    /// What this process suffers.
    pub(crate) fn faults(&self) -> &Faults {
        &self.shared.faults
    }

    fn listen(&mut self, topic: TopicId) -> Result<(), TransportError> {
        let is_clock = matches!(topic, TopicId::ClockStep | TopicId::ClockAck);
        if !spec_of(topic)?.wakes || (self.domain.clock.is_stepped() && !is_clock) {
            return Ok(());
        }
        let listener = listener(&self.domain, topic)?;
        let token = if is_clock { TOKEN_CLOCK } else { TOKEN_TOPIC };
        // SAFETY: the listener is kept in `self.listeners` for as long as the epoll lives, so the descriptor stays
        // open.
        let fd = unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) };
        watch_fd(&self.epoll, fd, token)?;
        self.listeners.push(listener);
        Ok(())
    }

    /// Wakes the service through [`Service::on_fd`](crate::Service::on_fd) when `fd` has something to read, or its
    /// other end is gone.
    ///
    /// # Errors
    /// Where the kernel refuses.
    pub fn watch(&self, fd: impl AsFd, token: u64) -> Result<(), TransportError> {
        watch_fd(&self.epoll, fd, TOKEN_OWN + token)
    }

    /// No longer wakes for `fd`.
    pub fn unwatch(&self, fd: impl AsFd) {
        // A descriptor that was not watched needs no unwatching.
        let _ = epoll::delete(&self.epoll, fd);
    }

    /// Tells the supervisor something, cut to what the line takes; `false` where it is gone.
    pub fn tell(&self, message: &FromChild) -> bool {
        self.control.as_ref().is_some_and(|line| line.send(&message.clone().bounded(), None))
    }

    /// The next word of the supervisor; once it is gone, its line is let go.
    pub(crate) fn receive_control(&mut self) -> Received<ToChild> {
        let received = self.control.as_ref().map_or(Received::Nothing, Line::receive::<ToChild>);
        if matches!(received, Received::Closed) {
            self.let_go_of_supervisor();
        }
        received
    }

    /// Lets the supervisor go, which has died.
    pub(crate) fn let_go_of_supervisor(&mut self) {
        if let Some(signal) = self.orphaned.take() {
            self.unwatch(signal);
        }
        if let Some(line) = self.control.take() {
            self.unwatch(line);
        }
    }

    /// What the ports of this process have done, as its beats tell.
    #[must_use]
    pub fn port_counters(&self) -> Vec<PortCounters> {
        self.counters().clone()
    }

    /// What the ports have done.
    pub(crate) fn counters(&self) -> std::cell::Ref<'_, Vec<PortCounters>> {
        self.shared.counters.borrow()
    }

    pub(crate) fn drain_listeners(&self) {
        for listener in &self.listeners {
            // An event says only "look"; what it was about is read from the topics.
            // All of them at every wake-up: a notifier sends no datagram for an event that is noted already, so an
            // event whose datagram was taken without it would be the last one.
            let _ = listener.try_wait(|_| {});
        }
    }

    pub(crate) fn wait(&self, timeout_ns: Option<u64>, tokens: &mut Vec<u64>) -> Result<(), TransportError> {
        let timeout =
            timeout_ns.map(|ns| Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as _ });
        let blank = epoll::Event { flags: epoll::EventFlags::empty(), data: epoll::EventData::new_u64(0) };
        let mut events = [blank; 32];
        tokens.clear();
        match epoll::wait(&self.epoll, &mut events, timeout.as_ref()) {
            Ok(n) => tokens.extend(events[..n].iter().map(|event| event.data.u64())),
            Err(rustix::io::Errno::INTR) => {}
            Err(errno) => return Err(TransportError::System { call: "epoll_wait", errno }),
        }
        Ok(())
    }
}
