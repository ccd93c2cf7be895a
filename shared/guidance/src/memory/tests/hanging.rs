//! What hangs above the camera's image.

use super::{HANDLER, MS, frame_header, handler, memory, scan};
use crate::depth::DepthView;
use crate::memory::Memory;
use crate::se2::Se2;

/// Near by the camera looks beneath what hangs, and sees the floor there.
#[test]
fn what_hangs_is_not_gone_where_the_camera_looks_beneath_it() {
    let (open, header) = (scan(&[HANDLER]), frame_header());
    let frame = |bar_at_m: Option<f64>| {
        let ray_mm = |i: usize| {
            let up = -((i / 64) as f64 - 23.5) / 32.0;
            let behind_m = if up < 0.0 { (-0.45 / up).min(9.0) } else { 9.0 };
            let bar_m = bar_at_m.filter(|at| (0.65..0.85).contains(&(at * up)));
            (bar_m.unwrap_or(behind_m) * 1000.0) as u16
        };
        let (mut view, pixels) = (DepthView::default(), (0..64 * 48).map(ray_mm).collect::<Vec<_>>());
        view.fill(&header, &pixels).expect("usable");
        view
    };
    // Seen 1.6 m before the camera, in frames of their own.
    let mut memory = memory();
    for i in 0..12 {
        memory.update(i, &Se2::identity(), &open, Some(&frame(Some(1.6))), &handler());
    }
    let ahead = |memory: &Memory| memory.hidden().iter().any(|spot| spot.place.y.abs() < 0.1);
    // One metre on, the highest ray is 0.44 m over the camera where the bar is at 0.65.
    memory.update(1000 * MS, &Se2::translation(1.0, 0.0), &open, Some(&frame(Some(0.6))), &handler());
    assert!(ahead(&memory), "{:?}", memory.hidden());
    // From farther back the camera sees as high, and sees it gone.
    memory.update(1100 * MS, &Se2::translation(0.1, 0.0), &open, Some(&frame(None)), &handler());
    memory.update(1200 * MS, &Se2::translation(1.0, 0.0), &open, Some(&frame(None)), &handler());
    assert!(!ahead(&memory), "{:?}", memory.hidden());
}
