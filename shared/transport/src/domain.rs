//! A run's shared memory: made whole by the supervisor, only opened by everybody else.

use std::any::Any;
use std::rc::Rc;

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use messages::topic::{TOPICS, TopicSpec};
use messages::{Frame, Message, ServiceId, TopicId, for_each_topic};

use crate::checked::Wire;
use crate::run_dir::{RunDir, RunInfo};
use crate::{Clock, TransportError};

/// Nodes that may hold a topic: every service, the policy's shadow, the command line, and as many dead ones.
const MAX_NODES: usize = 40;
/// Ends of an event: no more than nodes.
const MAX_EVENT_ENDS: usize = 32;

/// The topic of a frame, as iceoryx2 has it.
type FrameTopic<F> = publish_subscribe::PortFactory<ipc::Service, [<F as Frame>::Element], <F as Frame>::Meta>;

/// One process's access to a run's shared memory.
#[derive(Debug)]
pub struct Domain {
    /// The run directory.
    pub dir: RunDir,
    /// What every process of the run knows.
    pub info: RunInfo,
    /// The run's clock.
    pub clock: Rc<Clock>,
    pub(crate) node: Node<ipc::Service>,
}

/// Holds every topic of a run open, so that no child ever creates one: a kill during a first creation would leave the
/// topic unusable for good.
pub struct Holder {
    _topics: Vec<Box<dyn Any>>,
}

impl std::fmt::Debug for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Holder").field("topics", &self._topics.len()).finish()
    }
}

fn open_error(topic: &str, reason: impl std::fmt::Debug) -> TransportError {
    TransportError::Open { topic: topic.to_owned(), reason: format!("{reason:?}") }
}

fn config_of(dir: &RunDir) -> Result<Config, TransportError> {
    let mut config = Config::default();
    let root = dir.iceoryx2_root();
    let bytes = root.as_os_str().as_encoded_bytes();
    config.global.prefix = FileName::new(dir.prefix().as_bytes()).map_err(|e| open_error("prefix", e))?;
    config.global.set_root_path(&Path::new(bytes).map_err(|e| open_error("root path", e))?);
    // The supervisor cleans up, off the stop path; children that did so at start would do it at once and together.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    Ok(config)
}

/// The name of a topic; health topics have one for each service.
pub(crate) fn topic_name(spec: &TopicSpec, of: ServiceId) -> String {
    if spec.id == TopicId::Health { format!("{}/{}", spec.name, of) } else { spec.name.to_owned() }
}

/// The row of a topic that has one.
pub(crate) fn spec_of(topic: TopicId) -> Result<&'static TopicSpec, TransportError> {
    topic.spec().ok_or_else(|| open_error("none", "the topic table has no such row"))
}

impl Domain {
    /// Opens the run in `dir` for the process `name`.
    ///
    /// # Errors
    /// Where the directory is not a run's, or its shared memory cannot be used.
    pub fn open(dir: RunDir, name: &str) -> Result<Self, TransportError> {
        set_log_level(LogLevel::Fatal);
        let info = dir.read_info()?;
        let config = config_of(&dir)?;
        let node_name = NodeName::new(name).map_err(|e| open_error("node", e))?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            // Stopping is ours: iceoryx2's handlers would take SIGINT and SIGTERM from the service.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| open_error("node", e))?;
        let clock = Rc::new(Clock::new(info.clock, info.started_monotonic_ns));
        Ok(Self { dir, info, clock, node })
    }

    /// Creates every topic of the table. Only the supervisor does.
    ///
    /// # Errors
    /// Where shared memory is full or not ours.
    pub fn create_all(&self) -> Result<Holder, TransportError> {
        let mut topics: Vec<Box<dyn Any>> = Vec::new();
        /// Creates every topic of the table.
        macro_rules! create {
            ($($kind:ident $id:ident $type:ident;)+) => {$(
                for of in TopicId::$id.owners() {
                    topics.push(create!($kind $type, *of));
                }
                if spec_of(TopicId::$id)?.wakes {
                    topics.push(Box::new(self.event(TopicId::$id, true)?));
                }
            )+};
            (message $type:ident, $of:expr) => { Box::new(self.messages::<messages::$type>($of, true)?) };
            (frame $type:ident, $of:expr) => {{
                let _ = $of;
                Box::new(self.frames::<messages::$type>(true)?)
            }};
        }
        for_each_topic!(create);
        self.dir.close_shared_memory();
        Ok(Holder { _topics: topics })
    }

    /// The topic of a message of fixed size.
    pub(crate) fn messages<M: Message + ZeroCopySend>(
        &self,
        of: ServiceId,
        create: bool,
    ) -> Result<publish_subscribe::PortFactory<ipc::Service, Wire<M>, ()>, TransportError> {
        let spec = spec_of(M::TOPIC)?;
        let name = topic_name(spec, of);
        let service = ServiceName::new(&name).map_err(|e| open_error(&name, e))?;
        let builder = self
            .node
            .service_builder(&service)
            .publish_subscribe::<Wire<M>>()
            .history_size(0)
            .subscriber_max_buffer_size(spec.buffer)
            .subscriber_max_borrowed_samples(spec.borrowed)
            .enable_safe_overflow(true)
            .max_publishers(spec.max_publishers())
            .max_subscribers(spec.max_subscribers())
            .max_nodes(MAX_NODES);
        if create {
            builder.create().map_err(|e| open_error(&name, e))
        } else {
            builder.open().map_err(|e| open_error(&name, e))
        }
    }

    /// The topic of a frame.
    pub(crate) fn frames<F: Frame>(&self, create: bool) -> Result<FrameTopic<F>, TransportError>
    where
        F::Element: ZeroCopySend,
        F::Meta: ZeroCopySend,
    {
        let spec = spec_of(F::Meta::TOPIC)?;
        let service = ServiceName::new(spec.name).map_err(|e| open_error(spec.name, e))?;
        let builder = self
            .node
            .service_builder(&service)
            .publish_subscribe::<[F::Element]>()
            .user_header::<F::Meta>()
            .history_size(0)
            .subscriber_max_buffer_size(spec.buffer)
            .subscriber_max_borrowed_samples(spec.borrowed)
            .enable_safe_overflow(true)
            .max_publishers(spec.max_publishers())
            .max_subscribers(spec.max_subscribers())
            .max_nodes(MAX_NODES);
        if create {
            builder.create().map_err(|e| open_error(spec.name, e))
        } else {
            builder.open().map_err(|e| open_error(spec.name, e))
        }
    }

    /// The event beside a topic.
    pub(crate) fn event(
        &self,
        topic: TopicId,
        create: bool,
    ) -> Result<event::PortFactory<ipc::Service>, TransportError> {
        let name = spec_of(topic)?.name;
        let service = ServiceName::new(name).map_err(|e| open_error(name, e))?;
        let builder = self
            .node
            .service_builder(&service)
            .event()
            .max_notifiers(MAX_EVENT_ENDS)
            .max_listeners(MAX_EVENT_ENDS)
            .max_nodes(MAX_NODES);
        if create {
            builder.create().map_err(|e| open_error(name, e))
        } else {
            builder.open().map_err(|e| open_error(name, e))
        }
    }

    /// How iceoryx2 is set up for this run.
    pub(crate) fn config(&self) -> Result<Config, TransportError> {
        config_of(&self.dir)
    }
}

/// Shared memory that one writer of a topic maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PoolSize {
    /// The topic.
    pub topic: TopicId,
    /// Messages in the pool.
    pub messages: usize,
    /// Bytes of one message at its largest, header included.
    pub message_bytes: usize,
}

impl PoolSize {
    /// Bytes of the pool.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.messages * self.message_bytes
    }
}

/// The pools of all topics for a depth frame of that many pixels, computed from the topic table.
#[must_use]
pub fn pool_sizes(depth_pixels: usize) -> Vec<PoolSize> {
    let size = |spec: &TopicSpec| PoolSize {
        topic: spec.id,
        messages: spec.pool_len(),
        message_bytes: spec.message_bytes(depth_pixels),
    };
    let mut sizes: Vec<PoolSize> = TOPICS.iter().map(size).collect();
    sizes.sort_by_key(|size| size.topic);
    sizes
}
