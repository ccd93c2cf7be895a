//! Devices as their makers' own libraries find them: what this project says on a device's line, held against the
//! library of who makes the device. Each test is a script of `tests/peers`, in Python.

use std::path::Path;
use std::process::Command;

use guidedog_tests::{programs, project};

/// The Python of the scripts, where a script's library is there. `None`: the test is to be skipped.
fn python(peer: &str) -> Option<String> {
    let names = |variable: &str| std::env::var(variable).is_ok_and(|names| names.split(' ').any(|name| name == peer));
    let not_here = "its maker has no library for this Python and machine, or no network of one's own can be had";
    let missing = "GUIDEDOG_PEERS does not name it: scripts/peers installs makers' libraries, and says what went wrong";
    let there =
        test_data::may(!names("GUIDEDOG_NO_PEERS"), not_here) && test_data::has(names("GUIDEDOG_PEERS"), missing);
    there.then(|| std::env::var("GUIDEDOG_PYTHON").expect("set with GUIDEDOG_PEERS"))
}

/// Runs a script by a command that ends with its Python.
fn hold(peer: &str, mut command: Command) {
    let script = project().join("tests/peers").join(peer).with_extension("py");
    let output =
        command.current_dir(project()).arg(script).arg(programs().join("guidedog")).output().expect("it starts");
    let told = [output.stdout, output.stderr].map(|told| String::from_utf8_lossy(&told).into_owned());
    assert!(output.status.success(), "{}: {}{}", output.status, told[0], told[1]);
    eprint!("{}", told[0]);
}

#[test]
fn slamtecs_library_reads_every_lidar() {
    let Some(python) = python("rplidar") else { return };
    hold("rplidar", Command::new(python));
}

#[test]
fn unitrees_library_commands_a_go1() {
    let Some(python) = python("unitree") else { return };
    hold("unitree", Command::new(python));
}

#[test]
fn intels_library_and_the_depth_driver_see_the_same_frames() {
    let Some(python) = python("realsense") else { return };
    hold("realsense", Command::new(python));
}

/// Its newer libraries know no tracking camera any more, so an older one lies in a folder of its own.
#[test]
fn intels_library_and_the_odometry_driver_see_the_same_poses() {
    let Some(python) = python("t265") else { return };
    let folder = std::env::var_os("GUIDEDOG_TRACKING").expect("set with GUIDEDOG_PEERS");
    assert!(Path::new(&folder).is_dir(), "{}", folder.display());
    let mut command = Command::new(python);
    command.env("PYTHONPATH", folder);
    hold("t265", command);
}

/// Cyclone DDS wants multicast, which the loopback of a network namespace of one's own has.
#[test]
fn unitrees_client_and_cyclone_dds_command_a_go2_and_a_ros_2_robot() {
    let Some(python) = python("dds") else { return };
    let network = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec \"$@\"";
    let mut command = Command::new("unshare");
    command.args(["-rn", "bash", "-c", network, "own-network", &python]);
    hold("dds", command);
}
