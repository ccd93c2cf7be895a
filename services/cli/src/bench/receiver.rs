//! The receiving process of `bench transport`: says `ready`, then at the end how long each message was on the way.

use messages::{DepthFrame, Message};
use rustix::process::Signal;
use transport::{Domain, FrameSubscriber, Io, RunDir, Service, TransportError, run_tool};

use super::plain::PlainReceiver;
use crate::args::{Program, ReceiverArgs};
use crate::exit::Failure;
use crate::out;

/// Stamp of the message that ends the bench: no other is so old. One from the future would be dropped.
pub(crate) const END_NS: u64 = 0;

/// The hidden verb `bench-receiver`.
///
/// # Errors
/// Where the bench's run directory is none, or shared memory fails.
pub fn receive(args: &ReceiverArgs) -> Result<(), Failure> {
    // Should the bench be killed, nothing of it stays.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(Failure::of_run)?;
    let taken = match args.program {
        Program::Ours => ours(args)?,
        Program::Plain => plain(args)?,
    };
    out::raw(&serde_json::to_string(&taken).map_err(Failure::of_run)?)
}

fn plain(args: &ReceiverArgs) -> Result<Vec<(u64, u64)>, Failure> {
    let receiver = PlainReceiver::open(&args.dir)?;
    out::raw("ready")?;
    let mut taken = Vec::new();
    receiver.run(END_NS, |seq, ns| taken.push((seq, ns)))?;
    Ok(taken)
}

fn ours(args: &ReceiverArgs) -> Result<Vec<(u64, u64)>, Failure> {
    let domain = Domain::open(RunDir::open(&args.dir), "bench.receiver").map_err(Failure::of_run)?;
    run_tool(domain, OurReceiver::open).map(|receiver| receiver.taken).map_err(Failure::of_run)
}

/// A service like every other, with the transport's own wait loop.
struct OurReceiver {
    frames: FrameSubscriber<DepthFrame>,
    taken: Vec<(u64, u64)>,
    done: bool,
}

impl OurReceiver {
    fn open(io: &mut Io) -> Result<Self, TransportError> {
        let frames = io.frame_subscriber()?;
        out::raw("ready").map_err(|failure| TransportError::Service(failure.message))?;
        Ok(Self { frames, taken: Vec::new(), done: false })
    }
}

impl Service for OurReceiver {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        while let Some(frame) = self.frames.take()? {
            let now_ns = io.now_ns();
            let header = frame.meta().header();
            if header.stamp_ns == END_NS {
                self.done = true;
            } else {
                self.taken.push((header.seq, now_ns.saturating_sub(header.stamp_ns)));
            }
        }
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.done
    }
}
