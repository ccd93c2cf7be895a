//! GStreamer itself, where there is one.

use camera::Head;
use guidedog_grabber::Grab;
use guidedog_grabber::gstreamer::GstCamera;
use settings::{DepthIntrinsics, DepthSettings, Millis};
use transport::monotonic_ns;

/// Whether there is GStreamer.
fn has_gstreamer() -> bool {
    let there = std::env::var_os("GUIDEDOG_GSTREAMER").is_some();
    test_data::has(there, "GUIDEDOG_GSTREAMER is not set: scripts/test installs GStreamer, and sets it")
}

fn settings(source: &str, latency: Option<&str>) -> DepthSettings {
    let lens = DepthIntrinsics { fx_px: 50.0, fy_px: 50.0, cx_px: 32.0, cy_px: 24.0 };
    let mut depth = DepthSettings { width: 64, height: 48, intrinsics: Some(lens), ..DepthSettings::default() };
    depth.gstreamer.pipeline = format!("{source} ! video/x-raw,format=GRAY16_LE,width=64,height=48,framerate=30/1");
    depth.gstreamer.latency = latency.map(|text| Millis::try_from(text.to_owned()).expect("a duration"));
    depth
}

/// The heads of so many frames, each with the time before which it was taken.
fn heads(depth: &DepthSettings, count: usize) -> Vec<(Head, u64)> {
    let mut camera = GstCamera::open(depth, false).expect("it opens");
    let mut heads = Vec::new();
    while heads.len() < count {
        if let Some(frame) = camera.grab().expect("it goes on") {
            heads.push((frame.head(), monotonic_ns()));
        }
    }
    heads
}

#[test]
fn a_frame_is_as_old_as_its_source_says_and_its_latency_more() {
    if !has_gstreamer() {
        return;
    }
    for source in ["videotestsrc", "videotestsrc is-live=true"] {
        let began_ns = monotonic_ns();
        let heads = heads(&settings(source, None), 10);
        assert!(heads.iter().all(|(head, now_ns)| (began_ns..=*now_ns).contains(&head.taken_ns)), "{heads:?}");
        assert!(heads.windows(2).all(|two| two[0].0.taken_ns < two[1].0.taken_ns), "{heads:?}");
        let [first, last] = [heads[0].0.taken_ns, heads[9].0.taken_ns];
        assert!(last - first > 200_000_000, "paced as a camera: {first}..{last}");
    }
    let late = heads(&settings("videotestsrc is-live=true", Some("500ms")), 3);
    assert!(late.iter().all(|(head, now_ns)| now_ns - head.taken_ns >= 500_000_000), "{late:?}");
}

#[test]
fn a_real_robot_takes_a_live_pipeline_alone() {
    if !has_gstreamer() {
        return;
    }
    let trouble = GstCamera::open(&settings("videotestsrc", None), true).expect_err("it is a file, by all one knows");
    assert!(trouble.found.contains("is not live"), "{trouble}");
    GstCamera::open(&settings("videotestsrc is-live=true", None), true).expect("it is live");
}
