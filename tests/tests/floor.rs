//! `guidedog floor`: what a depth frame from outside shows of the floor.

use std::fs;

use guidedog_tests::Place;

const HEIGHT_M: f64 = 0.45;

/// A depth frame, as a PGM file, of a level camera: at `edge_m` ahead the floor drops by `drop_m`, metres. It has 64 by
/// 48 pixels and a focal length of 32 pixels, all of them multiplied by `times`.
fn pgm(edge_m: f64, drop_m: f64, times: u32) -> Vec<u8> {
    let size = [64 * times, 48 * times];
    let depth_mm = |row: u32| {
        let down = (f64::from(row) - 0.5 * f64::from(size[1] - 1)) / (32.0 * f64::from(times));
        let to_m = |lower_m: f64| (HEIGHT_M + lower_m) / down;
        let depth_m = if to_m(0.0) < edge_m { to_m(0.0) } else { to_m(drop_m) };
        if down > 0.0 && depth_m < 10.0 { (depth_m * 1000.0) as u16 } else { 0 }
    };
    let pixels = (0..size[1]).flat_map(|row| vec![depth_mm(row); size[0] as usize]).flat_map(u16::to_be_bytes);
    format!("P5\n{} {}\n65535\n", size[0], size[1]).into_bytes().into_iter().chain(pixels).collect()
}

#[test]
fn a_frame_from_outside_shows_where_the_floor_is_and_where_it_drops() {
    let place = Place::new();
    let file = place.path().join("frame.pgm").display().to_string();
    let asked = |more: &[&str]| {
        let args = ["floor", &file, "--json", "--lens", "32,32,31.5,23.5", "--height-m", "0.45", "--pitch-deg", "0"];
        place.json(&[&args, more].concat())
    };
    fs::write(&file, pgm(9.0, 0.5, 1)).expect("written");
    for more in [&[][..], &["--find"]] {
        let (report, code) = asked(more);
        let figure = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
        assert_eq!((code, &report["edges"]), (0, &serde_json::json!([])), "{report:#}");
        assert!(figure("/floor/from_m") < 1.0 && figure("/floor/to_m") > 2.5, "{report:#}");
        assert!(figure("/attitude/pitch_deg").abs() < 0.5, "{report:#}");
    }
    fs::write(&file, pgm(1.5, 0.5, 1)).expect("written");
    let (report, _) = asked(&[]);
    let edges = report["edges"].as_array().expect("edges");
    assert!(edges.len() > 20, "{report:#}");
    // 0.25 m ahead of the robot's middle is the camera.
    let far_m: Vec<f64> = edges.iter().filter_map(|edge| edge[0].as_f64()).collect();
    assert!(far_m.iter().all(|x_m| (1.5..1.8).contains(x_m)), "{far_m:?}");
    let output = place.guidedog(&["floor", &file, "--height-m", "0.45"]);
    let drawn = String::from_utf8(output.stdout).expect("text");
    assert!(drawn.contains("EEE") && drawn.contains("..."), "{drawn}");
}

#[test]
fn a_frame_from_outside_shows_a_low_step_and_whether_it_can_be_taken() {
    let place = Place::new();
    let file = place.path().join("frame.pgm").display().to_string();
    let lens = ["--lens", "128,128,127.5,95.5", "--height-m", "0.45", "--pitch-deg", "0"];
    fs::write(&file, pgm(1.2, 0.08, 4)).expect("written");
    let (report, _) = place.json(&[&["floor", &file, "--json"], &lens[..]].concat());
    let steps = report["steps"].as_array().expect("steps");
    assert!(steps.len() > 4, "{report:#}");
    for step in steps {
        let rise_m = step["rise_m"].as_f64().expect("a number");
        assert!((-0.09..-0.07).contains(&rise_m) && step["can_be_taken"] == true, "{step:#}");
    }
    let output = place.guidedog(&[&["floor", &file], &lens[..]].concat());
    let drawn = String::from_utf8(output.stdout).expect("text");
    assert!(drawn.contains("ss") && drawn.contains("places step down by"), "{drawn}");
}

#[test]
fn what_is_no_depth_frame_is_refused_by_name() {
    let place = Place::new();
    let file = place.path().join("frame.pgm").display().to_string();
    for (bytes, why) in [
        (&b"P5\n2 2\n255\n1234"[..], "not grey of 16 bits"),
        (b"P5\n64 48\n65535\n12", "frame.pgm"),
        (b"no image", "frame.pgm"),
    ] {
        fs::write(&file, bytes).expect("written");
        let (report, code) = place.json(&["floor", &file, "--json"]);
        assert!(code == 2 && report["error"].to_string().contains(why), "{report:#}");
    }
    let (report, code) = place.json(&["floor", &file, "--json", "--lens", "1,2,3"]);
    assert!(code == 2, "{report:#}");
}
