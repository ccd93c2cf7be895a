//! Whether the camera watches the floor at all.

use messages::{NS_PER_S, age_ns};

use crate::depth::DepthView;

/// Least time between two frames that are looked at, nanoseconds. A camera of 5 Hz has each of its frames looked at.
const EVERY_NS: u64 = NS_PER_S * 9 / 50;
/// Frames in a row without floor after which the camera is said to show none: two seconds.
const SILENT: u32 = 10;
/// Frames that are farther apart do not follow each other, nanoseconds.
const APART_NS: u64 = NS_PER_S * 3 / 2;

/// Counts the frames that show no floor, though nothing stands before the camera.
#[derive(Debug, Clone, Default)]
pub struct FloorWatch {
    last_ns: Option<u64>,
    silent: u32,
}

impl FloorWatch {
    /// A frame of that stamp came, of which the newest view was made. One that cannot be used has none, and says
    /// nothing.
    pub fn take(&mut self, stamp_ns: u64, view: Option<&DepthView>) {
        let Some(view) = view else { return };
        let since_ns = self.last_ns.map_or(u64::MAX, |last_ns| age_ns(stamp_ns, last_ns));
        if since_ns < EVERY_NS {
            return;
        }
        self.last_ns = Some(stamp_ns);
        self.silent = match view.shows_any_floor() {
            Some(false) if since_ns < APART_NS => self.silent + 1,
            Some(false) => 1,
            // What stands before the camera says nothing of the floor.
            Some(true) | None => 0,
        };
    }

    /// Whether the camera has shown no floor for two seconds.
    #[must_use]
    pub fn sees_none(&self) -> bool {
        self.silent >= SILENT
    }

    /// What was seen so far counts no more.
    pub fn begin_anew(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::FloorWatch;
    use crate::depth::DepthView;
    use crate::depth::ramp_tests::seen;
    use crate::depth::tests::{camera_160, held};

    /// Whether the watch reports that no floor is seen, after a number of equal frames.
    fn sees_none(pixels_mm: &[u16], frames: u64, apart_ms: u64) -> bool {
        let (mut watch, mut view) = (FloorWatch::default(), DepthView::default());
        view.fill_tilted(&camera_160(), pixels_mm, Some(&held(2.0, 3.0))).expect("usable");
        (0..frames).for_each(|frame| watch.take((1000 + apart_ms * frame) * 1_000_000, Some(&view)));
        watch.sees_none()
    }

    #[test]
    fn a_camera_that_shows_no_floor_is_told_within_three_seconds_and_a_wall_or_an_edge_is_none() {
        let of = |ground_m: &dyn Fn(f64, f64) -> f64| seen(&camera_160(), &ground_m);
        let far_wall = of(&|x, _| if x > 4.0 { 2.0 } else { 0.0 });
        let without_floor: Vec<u16> = far_wall.iter().map(|mm| if *mm < 3500 { 0 } else { *mm }).collect();
        assert!(!sees_none(&far_wall, 90, 33));
        for (frames, apart_ms) in [(90, 33), (15, 199), (15, 200), (10, 333)] {
            assert!(sees_none(&without_floor, frames, apart_ms), "{apart_ms} ms apart");
        }
        assert!(!sees_none(&without_floor, 40, 1_600), "single looks");
        assert!(!sees_none(&of(&|x, _| if x > 0.9 { 2.0 } else { 0.0 }), 90, 33), "a wall stands before it");
        let cliff = of(&|x, _| if x > 0.6 { -0.5 } else { 0.0 });
        assert!(!sees_none(&cliff, 90, 33), "the floor before an edge may lie below the image");
    }
}
