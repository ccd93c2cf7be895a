//! Why a camera may see nothing: it stands right before something.

use messages::DepthHeader;
use nalgebra::Vector2;

use super::DepthView;
use crate::scan::{BeamKind, Beams};
use crate::se2::Point;

/// A camera that sees nothing stands before something where at least this many beams end in its view,
const BEFORE_BEAMS: usize = 8;
/// all but one in this many end nearer to it than it can see,
const BEFORE_OF: usize = 20;
/// and that distance is exact to this, metres.
const BEFORE_M: f64 = 0.05;

impl DepthView {
    /// Whether the lidar tells why the camera of that header sees nothing: what stands before it is nearer than
    /// `nearest_m`, the least depth that it can see. Beams and camera are seen from where the robot is.
    #[must_use]
    pub fn stands_before_something(header: &DepthHeader, nearest_m: f64, beams: &Beams) -> bool {
        let mount = header.robot_from_camera;
        let forward = Vector2::new(mount.yaw_rad.cos(), mount.yaw_rad.sin());
        let left = Vector2::new(-forward.y, forward.x);
        let half_width = f64::from(header.width) / 2.0 / header.fx_px;
        let (mut near, mut all) = (0, 0);
        for beam in beams.beams().iter().filter(|beam| beam.kind != BeamKind::Unknown) {
            let to = beam.end - Point::new(mount.x_m, mount.y_m);
            let along_m = to.dot(&forward);
            if along_m > 0.0 && to.dot(&left).abs() <= half_width * along_m {
                all += 1;
                near += usize::from(beam.kind == BeamKind::Hit && along_m <= nearest_m + BEFORE_M);
            }
        }
        near >= BEFORE_BEAMS && (all - near) * BEFORE_OF <= all
    }
}
