//! Poses corrected by what the lidar sees: see the crate `matching`.

use matching::{Corrected, Refusal};
use messages::{Header, LidarScan, Odometry};
use settings::Settings;
use transport::{FrameSubscriber, FromChild, Io, TransportError};

/// The source's poses, laid onto the scans.
#[derive(Debug)]
pub struct ScanMatching {
    corrected: Corrected,
    scans: FrameSubscriber<LidarScan>,
    /// Whether the operator was told that the legs are on their own.
    is_told: bool,
}

/// So many scans refused in a row are worth a note: fewer than those after which the matcher begins anew and counts
/// from 0.
const TELL_REFUSED: u32 = 8;

impl ScanMatching {
    /// Listens to the lidar from now on.
    ///
    /// # Errors
    /// Where the topic cannot be opened, or the handler's parameters are no handler's.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let config = settings.matching_config().map_err(TransportError::service)?;
        Ok(Self { corrected: Corrected::new(config), scans: io.frame_subscriber()?, is_told: false })
    }

    /// The pose of this stamp, corrected as far as scans have told by now.
    pub fn correct(&mut self, stamp_ns: u64, pose: Odometry) -> Odometry {
        let header = Header { stamp_ns, ..pose.header };
        self.corrected.take_odometry(&Odometry { header, ..pose })
    }

    /// Matches the scans that have come.
    ///
    /// # Errors
    /// Where the topic is broken.
    pub fn work(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(scan) = self.scans.take()? {
            self.corrected.take_scan(scan.meta(), scan.data());
        }
        let refusal = self.corrected.work().err();
        self.tell(io, refusal);
        Ok(())
    }

    fn tell(&mut self, io: &Io, refusal: Option<Refusal>) {
        let health = self.corrected.health();
        let text = match refusal {
            Some(why) if !self.is_told && health.refused_in_a_row >= TELL_REFUSED => {
                format!("scans are not matched, and odometry is the source's alone: {why}")
            }
            None if self.is_told && health.refused_in_a_row == 0 => {
                format!("scans are matched again: {} of {}", health.accepted, health.accepted + health.refused)
            }
            _ => return,
        };
        self.is_told = !self.is_told;
        io.tell(&FromChild::Note { text });
    }
}
