//! The operator's protocol: what a client may ask the supervisor of a run, and what the supervisor answers.
//!
//! Client and supervisor exchange lines of JSON over the Unix socket in the run directory: one line for each request,
//! one line for its answer, in the order of the requests. An answer is either what was asked for or a [`Refusal`],
//! which alone has the member `error`.
//!
//! Versions may differ, for a supervisor outlives an upgrade. A request denies members that it does not know, but for a
//! stop, which is always obeyed ([`Request`]). An answer does not: a program reads the members that it knows. Names of
//! services, topics and kinds of stops are texts here, because a later supervisor has more of them. A phase of a
//! service or a state of a swap that this program does not know is read as `Unknown`.
//!
//! Closed are the types of `messages` that an answer holds: `ModeClass`, `CueKind`, `CueSource`, `SpeechPhase`,
//! `Urgency`, `MicrophoneState` and, in a report, `ClockKind`. They are types of the shared memory as well, in which
//! every byte is checked, so they have no variant for what is not known. An answer with another value of one of them is
//! [`AskError::Unreadable`], which names the value; [`Client::ask`] passes it on as it comes.
//!
//! Members of an answer are in the order of their names, as `serde_json::Value` sorts them ([`framing::line`]).
//!
//! Architecture invariant: this crate knows neither shared memory nor settings. A client needs the socket alone.

mod answer;
mod client;
pub mod framing;
mod number;
mod policies;
mod refusal;
mod report;
mod request;
mod status;
mod why;

pub use answer::{Answer, Done, Query};
pub use client::{ANSWER_WITHIN, AskError, Client};
pub use policies::{Policies, PolicyLife, PolicySpec, SwapRecord, SwapState};
pub use refusal::Refusal;
pub use report::{Compared, ComparedCount, LatencyRow, ReplayFigures, Report, RunFigures, SimulatorFigures};
pub use request::{Request, Right};
pub use status::{
    Collisions, CueStatus, Falls, LocomotionStatus, MicrophoneStatus, ModeStatus, Note, SaidStatus, ServicePhase,
    ServiceStatus, Status, WorldStatus,
};
pub use why::{Stop, Why};
