//! What the emulated lidar and camera see: the flat world from where the robot truly is, or what the simulator of
//! another physics casts from the moving body.

use emulators::EmulatedRplidar;
use messages::{WorldFrame, WorldScan, WorldTruth};
use settings::{PhysicsKind, Settings};
use transport::{FrameSubscriber, Io, TransportError};
use world::{Scene, World};

use crate::camera::{CameraThread, Seen};

/// Where looks at the world come from.
pub enum Sight {
    /// The emulators cast them in the flat world.
    Flat(Box<World>),
    /// The simulator casts them.
    Cast(Box<Casts>),
}

/// What the simulator casts.
pub struct Casts {
    scans: FrameSubscriber<WorldScan>,
    frames: FrameSubscriber<WorldFrame>,
}

impl Sight {
    /// As the settings' physics wants it.
    ///
    /// # Errors
    /// Where the world cannot be read or a topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        Ok(match settings.simulation.physics {
            PhysicsKind::Flat => Self::Flat(Box::new(load_world(settings)?)),
            PhysicsKind::Mujoco => {
                Self::Cast(Box::new(Casts { scans: io.frame_subscriber()?, frames: io.frame_subscriber()? }))
            }
        })
    }

    /// The world has gone on; `truth` is the newest.
    pub fn look(&mut self, truth: &WorldTruth, lidar: &mut EmulatedRplidar, camera: Option<&CameraThread>) {
        let Self::Flat(world) = self else { return };
        if let Some(camera) = camera {
            camera.see(Seen::Truth(Box::new(*truth)));
        }
        lidar.look(&Scene::from_truth(world, truth), truth.header.seq);
    }

    /// Takes what the simulator has cast.
    ///
    /// # Errors
    /// Where it cannot be taken.
    pub fn take(&mut self, lidar: &mut EmulatedRplidar, camera: Option<&CameraThread>) -> Result<(), TransportError> {
        let Self::Cast(casts) = self else { return Ok(()) };
        while let Some(scan) = casts.scans.take()? {
            lidar.take_look(&scan.meta().scan, scan.data());
        }
        while let Some(frame) = casts.frames.take()? {
            if let Some(camera) = camera {
                let meta = frame.meta();
                let pixels_mm = frame.data().to_vec();
                camera.see(Seen::Frame { lens: meta.depth, pixels_mm, stamp_ns: meta.header.stamp_ns });
            }
        }
        Ok(())
    }
}

/// The world of the run.
///
/// # Errors
/// Where it cannot be read.
pub fn load_world(settings: &Settings) -> Result<World, TransportError> {
    world::scenario_of(settings).and_then(|scenario| scenario.load_world()).map_err(TransportError::service)
}
