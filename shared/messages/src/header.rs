//! What every message begins with.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

/// The first field of every message.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Header/1"))]
#[repr(C)]
pub struct Header {
    /// Run time of the measurement (for a scan: of its last beam), in nanoseconds.
    pub stamp_ns: u64,
    /// Counts the messages of one publisher incarnation on one topic, from 1.
    pub seq: u64,
    /// The clock step in which the message was published; 0 in real time. A reader in stepped time takes a message
    /// only in a later step, so nothing depends on scheduling.
    pub step: u64,
    /// Run time at which the message was published, in nanoseconds.
    pub published_ns: u64,
    /// Which life of the sending service this is, from 1. Old lives are fenced by it.
    pub incarnation: u32,
    /// Keeps the layout free of implicit padding.
    pub reserved: u32,
}

/// A message of fixed size.
pub trait Message: Copy + core::fmt::Debug + Send + Sync + 'static {
    /// The one topic that the type travels on (for a header: beside its frame).
    const TOPIC: crate::TopicId;
    /// The message's header.
    fn header(&self) -> &Header;
    /// The message's header, to be filled in by the publisher.
    fn header_mut(&mut self) -> &mut Header;
}

/// A message whose payload is a slice in shared memory, written in place.
pub trait Frame: 'static {
    /// One element of the slice. Any bit pattern must be valid: it is read as other processes left it.
    type Element: Copy + core::fmt::Debug + Default + Send + Sync + bytemuck::AnyBitPattern + 'static;
    /// What stands beside the slice.
    type Meta: Message + Default;
}

/// Implements [`Message`] for types with a field `header`, and names the topic of each.
macro_rules! message {
    ($($name:ty => $topic:ident),+ $(,)?) => {$(
        impl $crate::Message for $name {
            const TOPIC: $crate::TopicId = $crate::TopicId::$topic;
            fn header(&self) -> &$crate::Header { &self.header }
            fn header_mut(&mut self) -> &mut $crate::Header { &mut self.header }
        }
    )+};
}
pub(crate) use message;
