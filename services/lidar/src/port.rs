//! Where a driver's scans go: to the first lidar's topic, or to the second's.

use messages::{LidarScan, ScanHeader, SecondScan, SecondScanHeader};
use transport::{FramePublisher, Io, TransportError};

/// The topic of a lidar.
#[derive(Debug)]
pub enum ScanPort {
    /// `lidar/scan`.
    First(FramePublisher<LidarScan>),
    /// `lidar/second`, and how far that lidar looks down, radians.
    Second(FramePublisher<SecondScan>, f64),
}

impl ScanPort {
    /// The first lidar's port, for scans of at most `beams_max` beams.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn first(io: &mut Io, beams_max: usize) -> Result<Self, TransportError> {
        io.frame_publisher(beams_max).map(Self::First)
    }

    /// The same for the second lidar, which looks down by `pitch_rad`, radians.
    ///
    /// # Errors
    /// As [`Self::first`].
    pub fn second(io: &mut Io, beams_max: usize, pitch_rad: f64) -> Result<Self, TransportError> {
        Ok(Self::Second(io.frame_publisher(beams_max)?, pitch_rad))
    }

    /// Publishes a scan. `write` writes its `beams` ranges in place, metres.
    ///
    /// # Errors
    /// Where it cannot be published.
    pub fn publish(
        &mut self,
        stamp_ns: u64,
        beams: usize,
        header: ScanHeader,
        write: impl FnOnce(&mut [f32]),
    ) -> Result<(), TransportError> {
        match self {
            Self::First(scans) => {
                let mut loan = scans.loan(beams)?;
                *loan.meta_mut() = header;
                write(loan.data_mut());
                scans.publish(stamp_ns, loan).map(drop)
            }
            Self::Second(scans, pitch_rad) => {
                let mut loan = scans.loan(beams)?;
                *loan.meta_mut() =
                    SecondScanHeader { scan: header, pitch_rad: *pitch_rad, ..SecondScanHeader::default() };
                write(loan.data_mut());
                scans.publish(stamp_ns, loan).map(drop)
            }
        }
    }
}
