//! Whether the devices that a configuration names are there, and this user may use them. None of them is told anything:
//! a lidar does not begin to turn, and a robot does not move.

use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use grabber::Trouble;
use grabber::realsense::{self, Kind};
use hearing::{ModelFiles, RATE_HZ, Recogniser};
use rustix::fs::{Access, OFlags};
use serial::{SerialError, SerialPort};
use settings::{AttitudeSource, DdsSettings, Reach, Settings, VoiceSource};

use super::Check;

/// The number of the kernel's input devices.
const INPUT_MAJOR: u32 = 13;
/// The longest name of a Unix socket, bytes.
const SOCKET_PATH_MAX: usize = 107;
/// A speed that every serial port has.
const ANY_BAUD: u32 = 115_200;

/// A check for each device that the settings name; those that are emulated come with their run.
pub(super) fn checks(settings: &Settings) -> Vec<Check> {
    let mut checks = Vec::new();
    if settings.speak.on {
        checks.push(program("voice", "speak.voice", &settings.speak.voice));
        if settings.speak.file.is_none() {
            checks.push(program("player", "speak.player", &settings.speak.player));
        }
        if let Some(command) = settings.speak.tone_command().filter(|_| settings.speak.tone_player.is_some()) {
            checks.push(program("tone player", "speak.tone_player", command));
        }
    }
    if settings.cue.voice.source == VoiceSource::Microphone {
        checks.push(by_library("microphone", grabber::microphone::check(&settings.cue.voice.microphone, RATE_HZ)));
    }
    if let Err(found) = settings::check_tone(settings) {
        checks.push(Check { name: "tone", ok: false, found, fix: "[speak] on = true".to_owned() });
    }
    let talk = settings.cue.voice.talk.as_ref().filter(|_| settings.cue.voice.source != VoiceSource::Absent);
    checks.extend(talk.map(|talk| input("key to speak", &talk.device)));
    checks.extend(response(settings));
    checks.extend(attitude(settings));
    checks.push(floor(settings));
    checks.push(unseen());
    if settings.simulation.emulated.on {
        return checks;
    }
    checks.extend(settings.devices().into_iter().filter_map(|(name, reach)| look(name, reach)));
    checks
}

/// Whether a real robot's response was measured.
fn response(settings: &Settings) -> Option<Check> {
    let origin = settings.robot.response.origin.name();
    let (ok, found) = match settings::check_origin(settings) {
        Err(found) => (false, found),
        Ok(()) if !settings.commands_robot() => return None,
        Ok(()) if settings.robot.profile_unmeasured => {
            (true, format!("origin = \"{origin}\"; robot.profile_unmeasured = true lets the robot walk by it"))
        }
        Ok(()) => (true, format!("origin = \"{origin}\"")),
    };
    let fix = "record the steps of `--policy steps`, then guidedog fit-robot RECORDING (docs/response.md)".to_owned();
    Some(Check { name: "response", ok, found, fix })
}

/// Looks at what a device is reached by, where there is anything to look at.
fn look(name: &'static str, reach: Reach<'_>) -> Option<Check> {
    Some(match reach {
        Reach::Nothing => return None,
        Reach::SerialPort { path, baud } => port(name, path, baud.unwrap_or(ANY_BAUD)),
        Reach::FrameSocket(path) => frame_socket(name, path),
        Reach::InputDevice(path) => input(name, path),
        Reach::Gstreamer(depth) => by_library(name, grabber::gstreamer::check(depth)),
        Reach::DepthCamera(library) => by_library(name, realsense::check(Kind::Depth, library)),
        Reach::TrackingCamera(library) => by_library(name, realsense::check(Kind::Tracking, library)),
        Reach::Udp { device, local } => udp(name, device, local),
        Reach::Dds(dds) => dds_networks(name, dds),
    })
}

/// Where no source tells roll and pitch, the operator has to know it.
fn attitude(settings: &Settings) -> Option<Check> {
    let found = "roll, pitch and height come from depth images alone (odometry.attitude = \"depth\"): a ramp or a low \
                 step counts as a tilt of the body, and falls are not detected";
    let check = Check { name: "attitude", ok: true, found: found.to_owned(), fix: String::new() };
    (settings.odometry.attitude == AttitudeSource::Depth).then_some(check)
}

/// Which floor the camera sees, and whether it sees an edge early enough.
fn floor(settings: &Settings) -> Check {
    let wanted_m = settings.edge_wanted_m();
    let check = |ok, found, fix: &str| Check { name: "floor", ok, found, fix: fix.to_owned() };
    if let Err(refused) = settings::check_floor(settings) {
        return check(false, refused, "[depth] source = \"device\", or [shield.floor] watched = false");
    }
    if !settings.watches_floor() {
        return check(true, "not watched: the robot would walk over an edge".to_owned(), "");
    }
    let mend = "mount the camera so, and write it into [depth.robot_from_camera]: ";
    let Some(view) = settings.floor_in_view() else {
        let fix = format!("{mend}tilted down, looking ahead");
        return check(false, "the camera sees no floor ahead of the robot within 3 m of it".to_owned(), &fix);
    };
    let found = format!(
        "seen from {:.2} to {:.2} m ahead of the robot's middle; an edge has to be seen at {wanted_m:.2} m or farther",
        view.from_m, view.to_m
    );
    // At its start the robot assumes a metre of floor, and no more; then what lies nearer is remembered.
    let assumed_m = settings.robot.nose_m + settings.robot.radius_m.get() + 1.0;
    let (tilt, ok) = if view.from_m > assumed_m {
        ("down, so that it sees the floor from nearer on", false)
    } else {
        ("up, so that it sees the floor farther off", wanted_m <= view.to_m)
    };
    check(ok, found, &format!("{mend}tilted {tilt}"))
}

/// What no sensor sees, in any configuration.
fn unseen() -> Check {
    let found = "clean glass; water on the floor; gaps narrower than about 0.3 m, as between a platform and a train; \
                 steps of less than 5 cm; the motion of escalators (SECURITY.md)";
    Check { name: "not seen", ok: true, found: found.to_owned(), fix: String::new() }
}

/// A program of others, where the shell would find it.
fn program(name: &'static str, key: &str, words: &[String]) -> Check {
    let program = words.first().map_or("", String::as_str);
    let place = settings::find_program(program);
    let ok = place.as_ref().is_some_and(|place| rustix::fs::access(place, Access::EXEC_OK).is_ok());
    let missing = || if program.contains('/') { program.to_owned() } else { format!("{program} is nowhere in PATH") };
    let found = place.map_or_else(missing, |place| place.display().to_string());
    let fix = match program {
        "espeak-ng" => "sudo apt-get install espeak-ng".to_owned(),
        "aplay" => "sudo apt-get install alsa-utils".to_owned(),
        _ => format!("install it, or name another in {key}"),
    };
    Check { name, ok, found, fix }
}

fn port(name: &'static str, path: &Path, baud: u32) -> Check {
    let opened = SerialPort::open(path, baud);
    let fix = match &opened {
        // The rest say themselves what to do.
        Err(SerialError::Missing { .. } | SerialError::NotSerial { .. }) => {
            "plug it in; config/udev/99-guidedog.rules gives it its name and its group".to_owned()
        }
        _ => String::new(),
    };
    let ok = opened.is_ok();
    let found = opened.map_or_else(|error| error.to_string(), |_| format!("{} can be opened", path.display()));
    Check { name, ok, found, fix }
}

/// The driver makes the socket; the folder has to be there.
fn frame_socket(name: &'static str, path: &Path) -> Check {
    let folder = path.parent().unwrap_or(Path::new("/"));
    let there = path.symlink_metadata();
    let may = rustix::fs::access(folder, Access::WRITE_OK | Access::EXEC_OK);
    let (ok, found) = match may {
        _ if path.file_name().is_none() => (false, "depth.socket.path names no file".to_owned()),
        _ if path.as_os_str().len() > SOCKET_PATH_MAX => {
            (false, format!("{} is longer than {SOCKET_PATH_MAX} bytes", path.display()))
        }
        _ if there.is_ok_and(|there| !there.file_type().is_socket()) => {
            (false, format!("{} is there, and is no socket", path.display()))
        }
        Ok(()) => (true, format!("{} can be made", path.display())),
        Err(errno) => (false, format!("no socket can be made in {}: {errno}", folder.display())),
    };
    let fix = format!("sudo install -d -o $USER {} (systemd: RuntimeDirectory=)", folder.display());
    Check { name, ok, found, fix }
}

/// Whether the networks that hear are there, and belong together.
pub(super) fn hearing(files: &ModelFiles) -> Check {
    let loaded = Recogniser::load(files);
    let fix = match &loaded {
        Ok(_) => String::new(),
        Err(_) => {
            "cue.voice.model and embedding name them; config/cues has what is shipped, and `guidedog cue enrol` fits \
                   a head to a voice"
                .to_owned()
        }
    };
    let ok = loaded.is_ok();
    let found = loaded.map_or_else(|error| error.to_string(), |_| format!("{} can be used", files.manifest.display()));
    Check { name: "hearing", ok, found, fix }
}

/// A device by its library.
fn by_library(name: &'static str, looked: Result<String, Trouble>) -> Check {
    let (ok, (found, fix)) = match looked {
        Ok(found) => (true, (found, String::new())),
        Err(Trouble { found, fix }) => (false, (found, fix)),
    };
    Check { name, ok, found, fix }
}

fn input(name: &'static str, path: &Path) -> Check {
    // A pipe without a writer would keep whoever opens it.
    let opened = OpenOptions::new().read(true).custom_flags(OFlags::NONBLOCK.bits().cast_signed()).open(path);
    // As in the kernel's list of devices.
    let is_device = |file: &File| {
        file.metadata().is_ok_and(|it| it.file_type().is_char_device() && rustix::fs::major(it.rdev()) == INPUT_MAJOR)
    };
    let (ok, found) = match &opened {
        Ok(file) if is_device(file) => (true, format!("{} can be read", path.display())),
        Ok(_) => (false, format!("{} is no input device", path.display())),
        Err(error) => (false, format!("{}: {error}", path.display())),
    };
    let fix = "plug it in (`ls /dev/input/by-id`); add the user to its group: sudo usermod -aG input $USER".to_owned();
    Check { name, ok, found, fix }
}

/// Whether this machine is in the device's own network, and no other program listens to it.
fn udp(name: &'static str, device: SocketAddrV4, local: SocketAddrV4) -> Check {
    let neighbour = |ip: Ipv4Addr| ip.octets()[..3] == device.ip().octets()[..3];
    let address = UdpSocket::bind(local).and_then(|socket| {
        socket.connect(device)?;
        socket.local_addr()
    });
    let (ok, found) = match address.map(|address| address.ip()) {
        Ok(IpAddr::V4(ip)) if neighbour(ip) => (true, format!("{device} is reached from {ip}; it is not spoken to")),
        Ok(ip) => (false, format!("{device} would be reached from {ip}, which is in another network")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => (false, format!("another program listens at {local}")),
        Err(error) => (false, format!("{device} cannot be reached: {error}")),
    };
    let [a, b, c, _] = device.ip().octets();
    let fix = format!("end what speaks to it; sudo ip address add {a}.{b}.{c}.162/24 dev (the card of its cable)");
    Check { name, ok, found, fix }
}

/// Whether this machine has the addresses by which it is to take part in the robot's network.
fn dds_networks(name: &'static str, dds: &DdsSettings) -> Check {
    let missing: Vec<String> = dds
        .networks
        .iter()
        .filter(|network| UdpSocket::bind((**network, 0)).is_err())
        .map(|network| format!("{network} is none of this machine's addresses"))
        .collect();
    let ok = missing.is_empty();
    let by = if dds.networks.is_empty() { "every network".to_owned() } else { format!("{:?}", dds.networks) };
    let found =
        if ok { format!("DDS domain {} by {by}; the robot is not spoken to", dds.domain) } else { missing.join(", ") };
    let fix = "sudo ip address add (one in the robot's network)/24 dev (the card of its cable), or mend \
               locomotion.dds.networks";
    Check { name, ok, found, fix: fix.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::checks;
    use settings::Settings;

    #[test]
    fn what_is_missing_is_told_and_what_is_there_is_well() {
        let place = tempfile::tempdir().expect("a folder");
        let at = |name: &str| place.path().join(name).display().to_string();
        std::fs::write(at("paper"), "").expect("written");
        rustix::fs::mkfifoat(rustix::fs::CWD, at("button"), rustix::fs::Mode::RUSR).expect("made");
        let text = |button: &str, folder: &str, robot: &str| {
            format!(
                "[lidar]\nsource = \"device\"\nrplidar = {{ port = \"{}\" }}\n[depth]\nsource = \"device\"\n\
                 socket = {{ path = \"{}/s\" }}\n[estop]\nsource = \"input\"\ninput = {{ device = \"{}\" }}\n\
                 [locomotion]\nlink = \"unitree\"\nunitree = {{ robot = \"{robot}\", local = \"127.0.0.1:0\" }}\n",
                at("nothing"),
                at(folder),
                at(button)
            )
        };
        let ok = |text: String| {
            let settings: Settings = toml::from_str(&text).expect("right");
            checks(&settings).iter().map(|check| (check.name, check.ok)).collect::<Vec<_>>()
        };
        let names = ["response", "floor", "not seen", "lidar", "depth socket", "emergency stop", "robot"];
        let expected = |oks: [bool; 7]| names.into_iter().zip(oks).collect::<Vec<_>>();
        assert_eq!(ok(text("button", ".", "127.0.0.1:9")), expected([false, true, true, false, true, false, true]));
        // From the loopback no other network is reached, whatever this machine's is.
        assert_eq!(
            ok(text("none", "none", "198.51.100.1:9")),
            expected([false, true, true, false, false, false, false])
        );
        assert_eq!(ok(text("paper", ".", "127.0.0.1:9")), expected([false, true, true, false, true, false, true]));
        assert_eq!(ok(String::new()), [("floor", true), ("not seen", true)]);
        let go2 = |network: &str| format!("[locomotion]\nlink = \"go2\"\ndds = {{ networks = [\"{network}\"] }}\n");
        assert_eq!(ok(go2("127.0.0.1")), [("response", false), ("floor", true), ("not seen", true), ("robot", true)]);
        assert_eq!(
            ok(go2("198.51.100.1")),
            [("response", false), ("floor", true), ("not seen", true), ("robot", false)]
        );
        for robot in ["profile_unmeasured = true", "response = { origin = \"measured\" }"] {
            assert_eq!(
                ok(format!("[robot]\n{robot}\n{}", go2("127.0.0.1"))),
                [("response", true), ("floor", true), ("not seen", true), ("robot", true)]
            );
        }
    }

    #[test]
    fn doctor_says_which_floor_the_camera_sees_and_whether_it_is_enough() {
        let floor = |text: &str| {
            let settings: Settings = toml::from_str(text).expect("right");
            checks(&settings).into_iter().find(|check| check.name == "floor").map(|check| (check.ok, check.found))
        };
        let told = |ok: bool, found: &str| Some((ok, found.to_owned()));
        let seen = "seen from 0.85 to 3.22 m ahead of the robot's middle; an edge has to be seen at 1.01 m or farther";
        assert_eq!(floor(""), told(true, seen));
        // 80 degrees up it sees no floor; 70 degrees down none that is far enough.
        let pitched = |rad: f64| {
            format!("[depth.robot_from_camera]\nx_m = 0.25\ny_m = 0.0\nz_m = 0.45\nyaw_rad = 0.0\npitch_rad = {rad}\n")
        };
        assert_eq!(floor(&pitched(1.2)).map(|(ok, _)| ok), Some(false));
        assert_eq!(floor(&pitched(-0.44)).map(|(ok, _)| ok), Some(false), "too far off for a start");
        let none = "the camera sees no floor ahead of the robot within 3 m of it";
        assert_eq!(floor(&pitched(-1.4)), told(false, none));
        let aside = "[depth.robot_from_camera]\nx_m = 0.25\ny_m = 0.0\nz_m = 0.45\nyaw_rad = 1.05\npitch_rad = 0.0\n";
        assert_eq!(floor(aside), told(false, none));
        let blind = "[depth]\nsource = \"absent\"\nneeded = false\n";
        assert_eq!(floor(blind), told(true, "not watched: the robot would walk over an edge"));
    }
}
