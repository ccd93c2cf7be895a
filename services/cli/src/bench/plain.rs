//! The program that `bench transport` is measured against: iceoryx2 alone, publish/subscribe with an event and a
//! WaitSet, with the quality of service of the topic `depth/frame`.

use std::path::Path;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use messages::TopicId;
use transport::monotonic_ns;

use crate::exit::Failure;

/// As in `transport`: nodes and event ends of a topic.
const MAX_NODES: usize = 40;
const MAX_EVENT_ENDS: usize = 32;
/// Ours wakes at 50 Hz for its beat; so does this, so that neither finds its caches colder than the other.
const LOOK_AGAIN: Duration = Duration::from_millis(20);
const NAME: &str = "bench/plain";

/// What stands beside the payload.
#[derive(Debug, Default, Clone, Copy, ZeroCopySend)]
#[type_name("guidedog/bench/PlainHeader/1")]
#[repr(C)]
struct PlainHeader {
    stamp_ns: u64,
    seq: u64,
}

type Frames = publish_subscribe::PortFactory<ipc::Service, [u16], PlainHeader>;
type Events = event::PortFactory<ipc::Service>;

fn failed(what: &'static str) -> impl FnOnce(&dyn std::fmt::Debug) -> Failure {
    move |error| Failure::run(format!("plain iceoryx2: {what}: {error:?}"))
}

/// A node in the bench's run directory, beside our own transport's files and with a prefix of its own.
fn node(dir: &Path, name: &str) -> Result<Node<ipc::Service>, Failure> {
    set_log_level(LogLevel::Fatal);
    let mut config = Config::default();
    let prefix = format!("{}p_", transport::RunDir::open(dir).prefix());
    let root = dir.join("plain");
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| failed("prefix")(&e))?;
    let root = iceoryx2::prelude::Path::new(root.as_os_str().as_encoded_bytes()).map_err(|e| failed("root")(&e))?;
    config.global.set_root_path(&root);
    let name = NodeName::new(name).map_err(|e| failed("node name")(&e))?;
    NodeBuilder::new()
        .name(&name)
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| failed("node")(&e))
}

fn services(node: &Node<ipc::Service>) -> Result<(Frames, Events), Failure> {
    let spec = TopicId::DepthFrame.spec().ok_or_else(|| Failure::run("depth/frame is in no topic table"))?;
    let name = ServiceName::new(NAME).map_err(|e| failed("service name")(&e))?;
    let frames = node
        .service_builder(&name)
        .publish_subscribe::<[u16]>()
        .user_header::<PlainHeader>()
        .history_size(0)
        .subscriber_max_buffer_size(spec.buffer)
        .subscriber_max_borrowed_samples(spec.borrowed)
        .enable_safe_overflow(true)
        .max_publishers(spec.max_publishers())
        .max_subscribers(spec.max_subscribers())
        .max_nodes(MAX_NODES)
        .open_or_create()
        .map_err(|e| failed("publish/subscribe")(&e))?;
    let events = node
        .service_builder(&name)
        .event()
        .max_notifiers(MAX_EVENT_ENDS)
        .max_listeners(MAX_EVENT_ENDS)
        .max_nodes(MAX_NODES)
        .open_or_create()
        .map_err(|e| failed("event")(&e))?;
    Ok((frames, events))
}

/// The writing end.
pub(crate) struct PlainPublisher {
    publisher: Publisher<ipc::Service, [u16], PlainHeader>,
    notifier: Notifier<ipc::Service>,
    _node: Node<ipc::Service>,
    _services: (Frames, Events),
    seq: u64,
}

impl PlainPublisher {
    /// Creates the services and the writing end, for slices of at most `max_len`.
    pub(crate) fn open(dir: &Path, max_len: usize) -> Result<Self, Failure> {
        let node = node(dir, "plain.publisher")?;
        let services = services(&node)?;
        let loans = TopicId::DepthFrame.spec().map_or(2, |spec| spec.loans);
        let publisher = services
            .0
            .publisher_builder()
            .max_loaned_samples(loans)
            .initial_max_slice_len(max_len)
            .allocation_strategy(AllocationStrategy::Static)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed("publisher")(&e))?;
        let notifier = services.1.notifier_builder().create().map_err(|e| failed("notifier")(&e))?;
        Ok(Self { publisher, notifier, _node: node, _services: services, seq: 0 })
    }

    /// Writes a slice in place, then stamps and sends it; a stamp may be given in place of the time. Its seq.
    pub(crate) fn send(&mut self, len: usize, value: u16, stamp_ns: Option<u64>) -> Result<u64, Failure> {
        let loan = self.publisher.loan_slice_uninit(len).map_err(|e| failed("loan")(&e))?;
        let mut sample = loan.write_from_fn(|_| value);
        self.seq += 1;
        let stamp_ns = stamp_ns.unwrap_or_else(monotonic_ns);
        *sample.user_header_mut() = PlainHeader { stamp_ns, seq: self.seq };
        sample.send().map_err(|e| failed("send")(&e))?;
        self.notifier.notify().map_err(|e| failed("notify")(&e))?;
        Ok(self.seq)
    }
}

/// The reading end.
pub(crate) struct PlainReceiver {
    subscriber: Subscriber<ipc::Service, [u16], PlainHeader>,
    listener: Listener<ipc::Service>,
    _node: Node<ipc::Service>,
    _services: (Frames, Events),
}

impl PlainReceiver {
    /// Opens the reading end of the bench in `dir`.
    pub(crate) fn open(dir: &Path) -> Result<Self, Failure> {
        let node = node(dir, "plain.receiver")?;
        let services = services(&node)?;
        let buffer = TopicId::DepthFrame.spec().map_or(2, |spec| spec.buffer);
        let subscriber =
            services.0.subscriber_builder().buffer_size(buffer).create().map_err(|e| failed("subscriber")(&e))?;
        let listener = services.1.listener_builder().create().map_err(|e| failed("listener")(&e))?;
        Ok(Self { subscriber, listener, _node: node, _services: services })
    }

    /// Waits for messages until one has the stamp `end_ns`; each is told as (seq, nanoseconds on the way).
    pub(crate) fn run(&self, end_ns: u64, mut took: impl FnMut(u64, u64)) -> Result<(), Failure> {
        let waits = WaitSetBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| failed("waitset")(&e))?;
        let _guard = waits.attach_notification(&self.listener).map_err(|e| failed("attach")(&e))?;
        loop {
            waits
                .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, LOOK_AGAIN)
                .map_err(|e| failed("wait")(&e))?;
            self.listener.try_wait(|_| {}).map_err(|e| failed("drain")(&e))?;
            while let Some(sample) = self.subscriber.receive().map_err(|e| failed("receive")(&e))? {
                let now = monotonic_ns();
                let header = *sample.user_header();
                if header.stamp_ns == end_ns {
                    return Ok(());
                }
                took(header.seq, now.saturating_sub(header.stamp_ns));
            }
        }
    }
}
