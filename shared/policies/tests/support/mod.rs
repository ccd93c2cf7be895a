//! The team and a plain shield, for the closed loops.

use guidance::se2::{Point, wrap_angle};
use guidance::{ActionTable, Se2};
use messages::ScanHeader;
use nalgebra::Vector2;
use std::f64::consts::TAU;

/// Radius of the robot's disc, metres.
pub const ROBOT_M: f64 = 0.30;
/// Radius of the handler's disc, metres.
pub const HANDLER_M: f64 = 0.25;
const ALPHA: f64 = 0.4;

/// Where the rigid harness holds the handler, robot frame.
pub fn rigid() -> Se2 {
    Se2::new(Vector2::new(-0.75, -0.35), 0.0)
}

/// The delayed harness: the handler after the motion, robot frame.
pub fn follow(motion: &Se2, handler: &Se2) -> Se2 {
    let held = motion.inverse() * handler;
    Se2::new(
        rigid().translation.vector.lerp(&held.translation.vector, ALPHA),
        ALPHA * wrap_angle(held.rotation.angle()),
    )
}

/// Where the beams end that do not end on the handler, robot frame.
pub fn hits(header: &ScanHeader, ranges: &[f32], handler: &Se2) -> Vec<Point> {
    let robot_from_lidar = guidance::se2::se2(header.robot_from_lidar);
    let handler_at = Point::from(handler.translation.vector);
    let mask_m = HANDLER_M + 3.0 * header.sigma_m + 0.01;
    (0..ranges.len())
        .filter(|i| ranges[*i].is_finite())
        .map(|i| {
            let bearing = header.angle_min_rad + header.angle_increment_rad * i as f64;
            let range_m = f64::from(ranges[i]);
            robot_from_lidar * Point::new(range_m * bearing.cos(), range_m * bearing.sin())
        })
        .filter(|hit| hit.coords.norm() < 2.5 && (hit - handler_at).norm() > mask_m)
        .collect()
}

/// The moving actions whose hull (robot and handler, before and after) holds none of the points.
pub fn allowed(hits: &[Point], handler: &Se2, table: &ActionTable) -> Vec<usize> {
    let safe = |action: &usize| {
        let motion = table.actions()[*action].start_from_end();
        let after = motion * follow(&motion, handler);
        let discs = [
            (Point::origin(), ROBOT_M),
            (Point::from(handler.translation.vector), HANDLER_M),
            (Point::from(motion.translation.vector), ROBOT_M),
            (Point::from(after.translation.vector), HANDLER_M),
        ];
        !hits.iter().any(|hit| in_hull(&discs, *hit))
    };
    (1..table.len()).filter(safe).collect()
}

fn in_hull(discs: &[(Point, f64)], hit: Point) -> bool {
    (0..360).all(|i| {
        let (sin, cos) = (f64::from(i) * TAU / 360.0).sin_cos();
        let along = |place: &Point| place.x * cos + place.y * sin;
        let support = discs.iter().map(|(centre, radius)| along(centre) + radius).fold(f64::NEG_INFINITY, f64::max);
        along(&hit) < support
    })
}
