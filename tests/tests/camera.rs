//! The depth driver and programs that hand it frames.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use camera::Head;
use guidedog_tests::{Live, Place, project, service, told, until};
use transport::monotonic_ns;

/// A run in the simulated corridor whose depth comes from the socket.
fn run(place: &Place) -> (Live<'_>, PathBuf) {
    let (socket, config) = (place.path().join("depth.sock"), place.path().join("camera.toml"));
    // A relative path starts at the configuration's folder.
    let text = "[depth]\nsource = \"device\"\ndevice = \"socket\"\n[depth.socket]\npath = \"depth.sock\"\n";
    std::fs::write(&config, text).expect("written");
    let run = Live::up(place, "camera", &["--scenario", "corridor", "--config", &config.to_string_lossy()]);
    (run, socket)
}

/// The example of the documentation, without a camera.
fn example(socket: &Path) -> Child {
    until("a socket comes", || socket.exists());
    let script = project().join("scripts/depth_socket.py");
    let mut command = Command::new("python3");
    command.arg(script).arg(socket).arg("wall").stderr(Stdio::null()).spawn().expect("python starts")
}

#[test]
fn a_program_with_a_camera_is_what_the_robot_sees_by_and_its_end_stops() {
    let place = Place::new();
    let (mut run, socket) = run(&place);
    for _ in 0..2 {
        let mut program = example(&socket);
        run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
        program.kill().and_then(|()| program.wait()).expect("it ends");
        run.wait("it is ready no more", |status| !status.mode.ready_for_cue);
        run.wait("the end is told of", |status| told(status, "the program at the depth socket has gone"));
    }
    assert_eq!(service(&run.status(), "depth").restarts, 0, "the driver needed no restart");
    let _ = run.end();
    assert!(!socket.exists(), "the socket goes with the driver");
    place.assert_empty();
}

#[test]
fn who_sends_what_is_no_frame_is_cut_off_and_told() {
    let place = Place::new();
    let (mut run, socket) = run(&place);
    // Until somebody listens.
    let mut first = example(&socket);
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    let connect = || UnixStream::connect(&socket).expect("the driver listens");
    let second = connect();
    run.wait("one at a time", |status| told(status, "a second program connected"));
    drop(second);
    first.kill().and_then(|()| first.wait()).expect("it ends");
    run.wait("it has gone", |status| told(status, "has gone"));
    let sound = Head { taken_ns: monotonic_ns(), width: 4, height: 2, focal_px: [9.0; 2], axis_px: [1.5, 0.5] };
    let frame = |head: Head| [&head.bytes()[..], &vec![0; 2 * head.pixels()]].concat();
    for (bytes, text) in [
        (vec![b'x'; 4096], "does not begin with GDDEPTH1"),
        (Head { width: 5000, ..sound }.bytes().to_vec(), "a frame of 5000 x 2 pixels"),
        (Head { width: 1280, height: 720, ..sound }.bytes().to_vec(), "is over depth.width x depth.height"),
        (Head { focal_px: [f32::NAN; 2], ..sound }.bytes().to_vec(), "no camera is like that"),
        (frame(Head { taken_ns: u64::MAX, ..sound }), "is it that of CLOCK_MONOTONIC?"),
        // A repeated frame is dropped, and its sender stays connected.
        (
            [frame(sound), frame(sound), Head { width: 5001, ..sound }.bytes().to_vec()].concat(),
            "a frame of 5001 x 2 pixels",
        ),
    ] {
        let mut program = connect();
        // It may be cut off before it has said all.
        let _ = program.write_all(&bytes);
        run.wait(text, |status| told(status, text));
    }
    assert_eq!(service(&run.status(), "depth").restarts, 0, "none of it reached the driver");
    let _ = run.end();
}
