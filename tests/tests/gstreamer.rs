//! The depth driver and GStreamer: its own elements in a camera's place.

use std::path::Path;

use camera::Trust;
use control::Note;
use guidedog_tests::{Live, Place, data, service, told};
use messages::DepthHeader;
use recording::{Reader, Record};

const RANGE_M: [f64; 2] = [0.3, 10.0];

/// Whether there is GStreamer.
fn has_gstreamer() -> bool {
    let there = std::env::var_os("GUIDEDOG_GSTREAMER").is_some();
    test_data::has(there, "GUIDEDOG_GSTREAMER is not set: scripts/test installs GStreamer, and sets it")
}

/// A configuration whose depth comes of that pipeline, of frames of that size.
fn configure(place: &Place, pipeline: &str, [width, height]: [usize; 2]) -> String {
    let path = place.path().join("camera.toml");
    let text = format!(
        "[depth]\nsource = \"device\"\ndevice = \"gstreamer\"\nwidth = {width}\nheight = {height}\n\
         range_m = {RANGE_M:?}\n[depth.gstreamer]\npipeline = '{pipeline}'\n\
         [depth.intrinsics]\nfx_px = 50.0\nfy_px = 51.0\ncx_px = 31.5\ncy_px = 23.5\n[record]\npath = \"it.mcap\"\n"
    );
    std::fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

fn up<'a>(place: &'a Place, config: &str) -> Live<'a> {
    Live::up(place, "camera", &["--scenario", "corridor", "--config", config])
}

/// Frames in a file, as `rawvideoparse` takes them, whose rows begin at multiples of four bytes: its pipeline.
fn raw_file(path: &Path, frames: &[Vec<u16>], [width, height]: [usize; 2]) -> String {
    let mut bytes = Vec::new();
    for row in frames.iter().flat_map(|frame| frame.chunks_exact(width)) {
        bytes.extend(row.iter().flat_map(|pixel| pixel.to_le_bytes()));
        bytes.resize(bytes.len().next_multiple_of(4), 0xee);
    }
    std::fs::write(path, bytes).expect("written");
    let path = path.display();
    format!("filesrc location={path} ! rawvideoparse format=gray16-le width={width} height={height} framerate=15/1")
}

fn finds(doctor: &serde_json::Value, text: &str) -> bool {
    let checks = doctor["checks"].as_array().into_iter().flatten();
    checks.into_iter().any(|check| check["found"].as_str().is_some_and(|found| found.contains(text)))
}

/// Plays the frames through the driver twice at least: what was recorded, the number of each in the file first.
fn play(frames: &[Vec<u16>], size: [usize; 2]) -> Vec<(usize, DepthHeader)> {
    let place = Place::new();
    let config = configure(&place, &raw_file(&place.path().join("raw"), frames, size), size);
    let mut run = up(&place, &config);
    let status = run.wait("it ends twice", |status| {
        let ends = |note: &&Note| note.text.contains("the pipeline has ended; it is opened anew");
        status.notes.iter().filter(ends).count() >= 2
    });
    assert_eq!(service(&status, "depth").restarts, 0, "the driver needed no restart");
    let _ = run.end();
    let trusted: Vec<Vec<u16>> = frames
        .iter()
        .cloned()
        .map(|mut frame| {
            Trust::of_m(RANGE_M).apply(&mut frame);
            frame
        })
        .collect();
    let records =
        Reader::open(&place.path().join("it.mcap")).expect("a recording").map(|record| record.expect("whole"));
    let depth = records.filter_map(|record| match record {
        Record::DepthFrame(frame) => Some((frame.header, frame.data)),
        _ => None,
    });
    let number =
        |pixels_mm: &Vec<u16>| trusted.iter().position(|frame| frame == pixels_mm).expect("a frame of the file");
    let played = depth.map(|(header, pixels_mm)| (number(&pixels_mm), header)).collect();
    place.assert_empty();
    played
}

#[test]
fn pixels_arrive_as_they_were_and_a_pipeline_that_ends_is_opened_anew() {
    if !has_gstreamer() {
        return;
    }
    // An odd width, for which GStreamer pads the rows; near, trusted and far all come.
    let ([width, height], count) = ([63, 48], 30);
    let pixel = |i: usize| ((i * 40_503) >> 3) as u16;
    let frame = |k: usize| (0..width * height).map(|i| pixel(k * width * height + i)).collect();
    let frames: Vec<Vec<u16>> = (0..count).map(frame).collect();
    let played = play(&frames, [width, height]);
    assert!(played.len() > count, "{} frames of {count}, twice", played.len());
    let header = played[0].1;
    assert_eq!((header.width, header.height, header.fx_px, header.fy_px), (63, 48, 50.0, 51.0));
    assert_eq!((header.cx_px, header.cy_px), (31.5, 23.5));
    // A frame's time is the pipeline's own, not that of the loop that took it.
    let mut apart_ms: Vec<f64> = played
        .windows(2)
        .filter(|two| two[1].0 == two[0].0 + 1)
        .map(|two| (two[1].1.header.stamp_ns - two[0].1.header.stamp_ns) as f64 / 1e6)
        .collect();
    assert!(apart_ms.len() > count, "most frames come after the one before: {}", apart_ms.len());
    apart_ms.sort_by(f64::total_cmp);
    let median_ms = apart_ms[apart_ms.len() / 2];
    assert!((median_ms - 1000.0 / 15.0).abs() < 1.0, "{median_ms}");
}

#[test]
fn real_frames_arrive_as_they_were() {
    let Some(folder) = has_gstreamer().then(|| data("depth/rgbd")).flatten() else { return };
    let frame = |n: usize| {
        let bytes = std::fs::read(folder.join(format!("{n}.pgm"))).expect("a frame");
        let pixels = &bytes[bytes.len() - 2 * 640 * 480..];
        pixels.chunks_exact(2).map(|two| u16::from_be_bytes([two[0], two[1]])).collect::<Vec<u16>>()
    };
    let frames: Vec<Vec<u16>> = (1..=5).map(frame).collect();
    // Each for a third of a second.
    let file: Vec<Vec<u16>> = frames.iter().flat_map(|frame| vec![frame.clone(); 5]).collect();
    let played = play(&file, [640, 480]);
    for n in 0..5 {
        assert!(played.iter().any(|(number, _)| *number == 5 * n), "frame {} arrived", n + 1);
    }
}

#[test]
fn a_live_pipeline_is_what_the_robot_sees_by() {
    if !has_gstreamer() {
        return;
    }
    let place = Place::new();
    let pipeline = "videotestsrc is-live=true ! video/x-raw,format=GRAY16_LE,width=320,height=240,framerate=30/1";
    let config = configure(&place, pipeline, [320, 240]);
    let (doctor, _) = place.json(&["doctor", "--json", "--config", &config]);
    assert!(finds(&doctor, "the pipeline and its elements are there"), "{doctor:#}");
    let mut run = up(&place, &config);
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn a_wrong_pipeline_is_told_with_what_to_do() {
    if !has_gstreamer() {
        return;
    }
    for (pipeline, found, fix) in [
        ("nosuchsrc", "no element \"nosuchsrc\"", "apt-get install gstreamer1.0-plugins-base"),
        ("videotestsrc ! !", "no pipeline: syntax error", "as gst-launch-1.0 takes it"),
        ("v4l2src device=/dev/video77", "/dev/video77", "opened anew"),
        (
            "videotestsrc is-live=true ! video/x-raw,format=GRAY8",
            "gives video/x-raw GRAY8",
            "format=GRAY16_LE,width=64",
        ),
        (
            "videotestsrc is-live=true ! video/x-raw,format=GRAY16_LE,width=32,height=24",
            "GRAY16_LE of 32 x 24",
            "width=64,height=48",
        ),
    ] {
        let place = Place::new();
        let config = configure(&place, pipeline, [64, 48]);
        let mut run = up(&place, &config);
        let status = run.wait(found, |status| told(status, found));
        assert!(told(&status, fix), "{fix}: {status:#?}");
        assert!(!status.mode.ready_for_cue, "{pipeline}");
        assert_eq!(service(&status, "depth").restarts, 0, "the driver goes on");
        let _ = run.end();
        if found.contains("nosuchsrc") {
            let (doctor, code) = place.json(&["doctor", "--json", "--config", &config]);
            assert!(finds(&doctor, found) && code != 0, "{doctor:#}");
        }
    }
}
