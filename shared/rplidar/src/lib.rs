//! What an RPLIDAR says on its line, and what is said to it: pure, without a port and without a clock.
//!
//! After Slamtec's protocol of the A, S and C series. Both ways of everything are here, because the emulated lidar
//! speaks the same language as the driver; what keeps them honest is not each other but real captures and the maker's
//! own library.

mod decoder;
mod emulated;
mod request;
mod sample;
mod session;
mod turn;

pub use decoder::{Counters, Decoder, Timing};
pub use emulated::{Emulated, Model};
pub use request::{Conf, Descriptor, Health, Heard, Info, Request, Requests, SampleRate};
pub use sample::{FRAME_BYTES_MAX, FRAME_SAMPLES_MAX, FirstOfFrame, Format, Sample, angle_ahead_deg};
pub use session::{Do, Found, SILENCE_NS, Session, SessionError, Wanted};
pub use turn::{Beams, Fan, Turns};
