//! What every message begins with.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, IntoBytes, TryFromBytes};

/// The first field of every message.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, FromBytes)]
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

impl Header {
    /// The place of a message among those of its topic. The stamp leads: what is stamped a second ahead is no message,
    /// so that a false stamp is soon outlived, as a false incarnation or seq would not be.
    #[must_use]
    pub const fn order(&self) -> (u64, u32, u64) {
        (self.stamp_ns, self.incarnation, self.seq)
    }
}

/// A stamp may be ahead of the clock by so much: a device's clock is mapped to ours, and rounded.
pub const AHEAD_NS: u64 = 5_000_000;

/// Age of what was stamped at `stamp_ns`; the greatest there is for a stamp from the future, so that nothing which a
/// broken clock stamped ever counts as fresh.
#[must_use]
pub const fn age_ns(now_ns: u64, stamp_ns: u64) -> u64 {
    if stamp_ns > now_ns.saturating_add(AHEAD_NS) { u64::MAX } else { now_ns.saturating_sub(stamp_ns) }
}

/// A message of fixed size. What lies in shared memory becomes one only where its bytes are a value of it.
pub trait Message: Copy + core::fmt::Debug + Send + Sync + TryFromBytes + 'static {
    /// The one topic that the type travels on (for a header: beside its frame).
    const TOPIC: crate::TopicId;
    /// Whether every count in it is within the room that it counts; readers drop a message where one is not.
    fn counts_fit(&self) -> bool {
        true
    }
    /// The message's header.
    fn header(&self) -> &Header;
    /// The message's header, to be filled in by the publisher.
    fn header_mut(&mut self) -> &mut Header;
}

/// A message whose payload is a slice in shared memory, written in place.
pub trait Frame: 'static {
    /// One element of the slice. Any bytes are one: it is read as other processes left it.
    type Element: Copy + PartialEq + core::fmt::Debug + Default + Send + Sync + FromBytes + IntoBytes + 'static;
    /// What stands beside the slice; any bytes are one.
    type Meta: Message + PartialEq + Default + FromBytes;
    /// The most elements of the slice; `None` where the configuration says how many.
    const LEN_MAX: Option<usize>;
    /// Whether a slice of `len` elements is what `meta` says it is.
    fn fits(meta: &Self::Meta, len: usize) -> bool;
}

#[cfg(test)]
mod tests {
    use super::{AHEAD_NS, age_ns};

    #[test]
    fn a_stamp_from_the_future_is_never_fresh() {
        assert_eq!(age_ns(100, 40), 60);
        assert_eq!(age_ns(100, 100 + AHEAD_NS), 0);
        assert_eq!(age_ns(100, 101 + AHEAD_NS), u64::MAX);
    }
}
