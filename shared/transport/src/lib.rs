//! Typed topics over shared memory, the wait loop of every service, the clock and the lifelines.
//!
//! The only crate that talks to iceoryx2. A service is a [`Service`] run by [`run`]: it opens its ports from the topic
//! table through [`Io`], and is woken with the run time when an input came or its timer is due. It is the same code in
//! real and in stepped time; what differs is who decides when it is woken and which messages it may see yet.

mod checked;
mod clock;
mod domain;
mod end_signals;
mod error;
mod fault;
mod helper;
mod io;
mod janitor;
mod line;
mod master;
mod oversleep;
mod port;
mod recording_order;
mod rhythm;
mod room;
mod run_dir;
mod service;
mod short_path;
mod urgent;
mod usage;
mod wait_loop;

pub use clock::{Clock, monotonic_ns, unix_time_s};
pub use domain::{Domain, Holder, PoolSize, pool_sizes};
pub use end_signals::on_end_signals;
pub use error::TransportError;
pub use helper::Helper;
/// What may lie in shared memory.
pub use iceoryx2::prelude::ZeroCopySend;
pub use io::Io;
pub use janitor::Janitor;
pub use line::{FromChild, Line, LineListener, Received, ToChild, inherited_fd};
pub use messages::ClockKind;
pub use oversleep::Oversleep;
pub use port::{FrameLoan, FramePublisher, FrameSample, FrameSubscriber, Publisher, Subscriber};
pub use recording_order::RecordingOrder;
pub use rhythm::Rhythm;
pub use room::{SHM, shared_memory_bytes};
pub use run_dir::{
    FoundRuns, LiveRun, RunDir, RunInfo, check_run_name, check_runs_root, find_runs, keep_others_out, live_runs,
    runs_root, sweep,
};
pub use service::{ChildArgs, EXIT_BAD_ARGUMENTS, EXIT_FAILED, Identity, Service, SupervisorArgs};
pub use service::{run, run_supervisor, run_tool, service_main};
pub use short_path::{short_folder, short_socket};
pub use urgent::{hurry_network_thread, hurry_robot_thread, hurry_this_thread, may_hurry};
