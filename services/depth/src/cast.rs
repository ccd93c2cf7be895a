//! A depth camera in a simulated world whose simulator casts the rays.

use messages::{DepthFrame, WorldFrame};
use settings::Settings;
use transport::{FramePublisher, FrameSubscriber, Io, TransportError};

use crate::FrameSource;

/// Publishes the simulator's frames.
#[derive(Debug)]
pub struct CastDepth {
    pixels: usize,
    cast: FrameSubscriber<WorldFrame>,
}

impl CastDepth {
    /// Listens to the simulator.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let pixels = (settings.depth.width * settings.depth.height) as usize;
        Ok(Self { pixels, cast: io.frame_subscriber()? })
    }
}

impl FrameSource for CastDepth {
    fn pixels_max(&self) -> usize {
        self.pixels
    }

    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    fn poll(&mut self, _io: &mut Io, frames: &mut FramePublisher<DepthFrame>) -> Result<(), TransportError> {
        while let Some(cast) = self.cast.take()? {
            let (meta, data) = (cast.meta(), cast.data());
            let mut loan = frames.loan(data.len())?;
            *loan.meta_mut() = meta.depth;
            loan.data_mut().copy_from_slice(data);
            frames.publish(meta.header.stamp_ns, loan)?;
        }
        Ok(())
    }
}
