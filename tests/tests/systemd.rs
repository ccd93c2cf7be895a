//! What systemd hears of a run that it started.

use std::os::unix::net::UnixDatagram;

use guidedog_tests::{Place, WATCHDOG, signal};

/// The next words until one of them is that.
fn hear_until(socket: &UnixDatagram, wanted: &str) {
    let mut bytes = [0; 512];
    loop {
        let count = socket.recv(&mut bytes).unwrap_or_else(|error| panic!("{wanted} never came: {error}"));
        let text = String::from_utf8_lossy(&bytes[..count]);
        assert!(["READY=1", "WATCHDOG=1", "STOPPING=1"].contains(&text.trim()), "{text}");
        if text.trim() == wanted {
            return;
        }
    }
}

#[test]
fn systemd_hears_that_a_run_is_up_that_it_lives_and_that_it_ends() {
    let place = Place::new();
    let path = place.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("bound");
    socket.set_read_timeout(Some(WATCHDOG)).expect("set");
    let mut command = place.command(&["up", "--name", "sd", "--scenario", "corridor"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000").env_remove("WATCHDOG_PID");
    let mut run = command.spawn().expect("guidedog starts");
    hear_until(&socket, "READY=1");
    for _ in 0..3 {
        hear_until(&socket, "WATCHDOG=1");
    }
    signal(run.id(), "TERM");
    hear_until(&socket, "STOPPING=1");
    assert!(run.wait().expect("it ends").success());
    drop(socket);
    std::fs::remove_file(&path).expect("ours");
    place.assert_empty();
}
