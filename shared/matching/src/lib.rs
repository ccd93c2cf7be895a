//! Leg odometry corrected by lidar scan matching. Pure: no I/O, no clock, no thread; same input, same output.
//!
//! Legs slip, and a heading that is off by a degree is off by 17 cm after 10 m. Walls do not move: each scan is laid
//! onto what the last scans saw ([`Reference`]) by the point-to-line metric of Censi, *An ICP variant using a
//! point-to-line metric* (ICRA 2008), with what odometry says of the motion since as a prior. Both are weighed by what
//! they know ([`align`]), so that along a bare corridor, of which walls say nothing, leg odometry stays as it is.
//!
//! [`Matcher`] keeps the reference and refuses what cannot be ([`Refusal`]); [`Corrected`] feeds the corrections into
//! the stream of poses, slowly enough that nobody takes them for a jump. Where matching is refused or no scan comes,
//! poses go on by the legs alone, and their standard deviations say so.

mod align;
mod contour;
mod corrected;
mod matcher;
mod reference;
mod uncertainty;

pub use align::{Alignment, align};
pub use contour::{Contour, ContourPoint};
pub use corrected::{Corrected, CorrectedConfig};
pub use matcher::{Health, Matcher, MatcherConfig, Refusal};
pub use reference::Reference;
pub use uncertainty::{Covariance, LegNoise};
