//! One recorded message.

use messages::{Frame, Header, Message, TopicId};

/// A frame as it was recorded: what stands beside the slice, and the slice.
///
/// Of `lidar/scan`: metres, in the order of their angles; at or over `range_max_m` nothing was hit; NaN, negative or
/// under `range_min_m` is unknown. Of `depth/frame`: millimetres, 0 = none, row by row from the top left.
pub struct Slice<F: Frame> {
    /// What stands beside the slice.
    pub header: F::Meta,
    /// The slice.
    pub data: Vec<F::Element>,
}

impl<F: Frame> std::fmt::Debug for Slice<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Slice").field("header", &self.header).field("data", &self.data).finish()
    }
}

// By hand: a derive would ask the same of the marker `F`.
impl<F: Frame> Clone for Slice<F> {
    fn clone(&self) -> Self {
        Self { header: self.header, data: self.data.clone() }
    }
}

impl<F: Frame> PartialEq for Slice<F> {
    fn eq(&self, other: &Self) -> bool {
        self.header == other.header && self.data == other.data
    }
}

/// The type in which a record keeps what a topic carries.
macro_rules! kept {
    (message $type:ident) => { messages::$type };
    (frame $type:ident) => { $crate::record::Slice<messages::$type> };
}
pub(crate) use kept;

macro_rules! record {
    ($($kind:ident $id:ident $type:ident in $part:ident as $form:ident;)+) => {
        /// One recorded message: a variant for each recorded topic.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Record {
            $(#[doc = concat!("Of [`TopicId::", stringify!($id), "`].")] $id(Box<kept!($kind $type)>),)+
        }

        $(impl From<kept!($kind $type)> for Record {
            fn from(message: kept!($kind $type)) -> Self {
                Self::$id(Box::new(message))
            }
        })+

        impl Record {
            /// The topic that it was published on.
            #[must_use]
            pub const fn topic(&self) -> TopicId {
                match self {
                    $(Self::$id(_) => TopicId::$id,)+
                }
            }

            /// Stamp, seq, incarnation.
            #[must_use]
            pub fn header(&self) -> &Header {
                match self {
                    $(Self::$id(message) => header!($kind message),)+
                }
            }

            /// Stamp, seq, incarnation, to be changed.
            pub fn header_mut(&mut self) -> &mut Header {
                match self {
                    $(Self::$id(message) => header_mut!($kind message),)+
                }
            }
        }
    };
}

macro_rules! header {
    (message $message:ident) => {
        $message.header()
    };
    (frame $message:ident) => {
        $message.header.header()
    };
}

macro_rules! header_mut {
    (message $message:ident) => {
        $message.header_mut()
    };
    (frame $message:ident) => {
        $message.header.header_mut()
    };
}

messages::for_each_recorded_topic!(record);

/// What [`Record::order`] sorts by.
pub type Order = (u64, TopicId, u64);

impl Record {
    /// Run time of the measurement, nanoseconds.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        self.header().stamp_ns
    }

    /// Run time at which it was published, nanoseconds; of an import, which does not know, that of the measurement.
    #[must_use]
    pub fn time_ns(&self) -> u64 {
        let header = self.header();
        if header.published_ns > 0 { header.published_ns } else { header.stamp_ns }
    }

    /// Whether two records are the same to the byte, as they would be recorded; a NaN is a NaN.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        let bytes = |record: &Self| {
            let mut bytes = Vec::new();
            crate::channel::encode(record, &mut bytes).map(|()| bytes)
        };
        matches!((bytes(self), bytes(other)), (Ok(one), Ok(another)) if one == another)
    }

    /// What records are ordered by: time of publication, topic, seq.
    #[must_use]
    pub fn order(&self) -> Order {
        (self.time_ns(), self.topic(), self.header().seq)
    }
}
