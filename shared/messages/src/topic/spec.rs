//! What a row of the topic table says, and the room in shared memory that follows from it.

use super::TopicId;
use crate::ServiceId;

/// How old the newest message of a topic may be for motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AgeLimit {
    /// Motion does not ask for its age: an event, or what is only looked at.
    Unlimited,
    /// A key of `[max_age]`, with its default, milliseconds.
    Configured {
        /// The key.
        key: &'static str,
        /// Its default, milliseconds.
        default_ms: u64,
        /// The most that the configuration may say, milliseconds; more would give the stop away.
        most_ms: u64,
    },
    /// One and a half decision periods.
    Decision,
    /// The message names its own end.
    Expiry,
    /// `supervision.beat_limit`, or a limit of the service's own (see the table of services).
    Beat,
}

/// What a topic carries, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Payload {
    /// A message of fixed size.
    Message {
        /// Its size.
        bytes: usize,
    },
    /// A slice with a header beside it.
    Frame {
        /// The header's size.
        header_bytes: usize,
        /// The size of one element.
        element_bytes: usize,
        /// The most elements; `None` where the configuration says how many.
        elements_max: Option<usize>,
    },
}

/// A row of the table: how a topic is laid out in shared memory, and who takes part.
#[derive(Debug, Clone, Copy)]
pub struct TopicSpec {
    /// Which topic.
    pub id: TopicId,
    /// What it carries, in a sentence.
    pub doc: &'static str,
    /// Its name; a health topic's is followed by `/<service>`.
    pub name: &'static str,
    /// The type that it carries.
    pub type_name: &'static str,
    /// What it carries, in bytes.
    pub payload: Payload,
    /// Services that may write. One is *the* writer at a time, told by its incarnation.
    pub publishers: &'static [ServiceId],
    /// Writers that may be alive at once in one run: drivers and replay exclude each other, a policy has one shadow.
    pub live_publishers: usize,
    /// Services that may read.
    pub subscribers: &'static [ServiceId],
    /// Messages that wait for a reader; the oldest gives way.
    pub buffer: usize,
    /// Messages that a reader may hold at once.
    pub borrowed: usize,
    /// Messages that a writer may be filling at once.
    pub loans: usize,
    /// Whether a message wakes its readers.
    pub wakes: bool,
    /// How old the newest message may be for motion.
    pub max_age: AgeLimit,
    /// Whether faults can be injected into it by its name.
    pub injectable: bool,
    /// Whether it is recorded.
    pub recorded: bool,
    /// The reason for the numbers.
    pub why: &'static str,
}

/// Dead writers and readers keep their slot until they are cleaned up; a crash loop must not use up the room first.
pub const DEAD_SLOTS: usize = 2;

impl TopicSpec {
    /// Writers that may be alive at once in one run, and room for dead ones.
    #[must_use]
    pub const fn max_publishers(&self) -> usize {
        self.live_publishers + DEAD_SLOTS
    }

    /// Readers that may be alive at once, and room for dead ones.
    #[must_use]
    pub fn max_subscribers(&self) -> usize {
        let policies = usize::from(self.subscribers.contains(&ServiceId::Policy));
        self.subscribers.len() + policies + DEAD_SLOTS
    }

    /// Messages of the pool of one writer: all that readers may hold or have waiting, and the loans.
    #[must_use]
    pub fn pool_len(&self) -> usize {
        self.max_subscribers() * (self.buffer + self.borrowed) + self.loans
    }

    /// Bytes of one message at its largest, header included, where a configured frame has that many elements.
    #[must_use]
    pub const fn message_bytes(&self, configured_elements: usize) -> usize {
        match self.payload {
            Payload::Message { bytes } => bytes,
            Payload::Frame { header_bytes, element_bytes, elements_max } => {
                let elements = match elements_max {
                    Some(most) => most,
                    None => configured_elements,
                };
                header_bytes + element_bytes * elements
            }
        }
    }
}
