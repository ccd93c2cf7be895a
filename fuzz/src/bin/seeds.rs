//! Writes the seeds that the targets begin with into `corpus/`: `cargo run --bin seeds`, in this folder.

use std::path::Path;

use guidedog_fuzz::{BORDER, recording};

const SCAN: &str = r#"{"ranges":[1.5,null,3.4028235e38],"guidedog":{"stamp_ns":7,"seq":1,"step":0,"published_ns":0,
"incarnation":1,"angle_min_rad":-1.5,"angle_increment_rad":0.1,"range_min_m":0.1,"range_max_m":12.0,"sigma_m":0.02,
"robot_from_lidar":{"x_m":0.0,"y_m":0.0,"yaw_rad":0.0}}}"#;
const ODOMETRY: &str = r#"{"guidedog":{"stamp_ns":7,"seq":1,"step":0,"published_ns":0,"incarnation":1,
"odom_from_robot":{"x_m":0.0,"y_m":0.0,"yaw_rad":0.0},"twist":{"vx_mps":0.0,"vy_mps":0.0,"wz_radps":0.0},
"sigma":[0.1,0.1,0.1]}}"#;
const YAML: &str = "image: m\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n\
    free_thresh: 0.196\nmode: trinary\n";
const LOG: &str = "# a log\nPARAM robot_name scout\nPARAM laser_frontlaser_offset 0.1\n\
    ODOM 0 0 0 0 0 0 1.0 scout 1.0\nFLASER 3 1.0 2.0 81.9 0.1 0 0 0 0 0 1.1 scout 1.1\n\
    FLASER 3 1.0 2.0 0.0 0.2 0 0.1 0.1 0 0.1 1.3 scout 1.3\n";

const GAZEBO: &str = "<sdf version='1.6'><world name='default'>
<model name='pillar'><pose>1 2 0 0 0 0</pose><link name='link'><pose>1 0 0 0 0 0</pose><collision name='c'><geometry>
<cylinder><radius>0.5</radius><length>1</length></cylinder></geometry></collision></link></model>
<model name='crate'><link name='link'><collision name='c'><geometry><box><size>2 0.2 1</size></box></geometry>
</collision></link></model>
<state world_name='default'><model name='pillar'><pose>-3 2 0 0 0 0</pose><scale>1 1 1</scale></model></state>
</world></sdf>";
const EPISODES: &str = "[episodes_params]\ntests=['t_a']\n\n[t_a]\nmap_name=ETH ; the place\n\
    pedestrian_datasets=[\"eth\"]\ndatasets_start_t = [0]\nped_ranges=[(0, -1)]\nagents_start=[]\n\
    robot_start_goal=[[8, 5, 1.5], [12, 15, 1.5]]\nmax_time=20\n";
const DATASETS: &str = "[dataset_params]\n[eth] ; recommended map: ETH\nfile_name=eth/e.csv\nfps=10\n\
    spawn_delay_s = 0\noffset=[1.5, 14, 0]\nswapxy=True\nflipxn=True\nflipyn=False\n";
const TRACKS: &str = "0,1,2,15\n1,1,2,2\n0,0.1,5,6\n0,0,0.5,0\n";

fn seed(target: &str, name: &str, bytes: &[u8]) {
    let folder = Path::new("corpus").join(target);
    std::fs::create_dir_all(&folder).expect("a folder can be made");
    std::fs::write(folder.join(name), bytes).expect("a file can be written");
}

/// An 8-bit grey PNG of four pixels, and a PGM.
fn images() -> [Vec<u8>; 2] {
    let png = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x02\x00\x00\x00\x02\x08\x00\x00\x00\x00W\xddR\xf8\
        \x00\x00\x00\x0eIDATx\x9cc`hpp`X\x00\x00\x04\x0f\x01\xc1Z\xd3\xf0\xd4\x00\x00\x00\x00IEND\xaeB`\x82";
    [png.to_vec(), b"P5\n2 2\n255\n\x00\xff\x7f\xcd".to_vec()]
}

/// Two revolutions and a bit.
fn capture() -> Vec<u8> {
    let mut bytes = vec![0xa5, 0x5a, 0x05, 0x00, 0x00, 0x40, 0x81];
    for i in 0..90u16 {
        let (start, angle, distance) = (i % 40 == 0, (i % 40) * 9 * 64, 4000 + 100 * i);
        let check = angle << 1 | 1;
        bytes.push(if start { 0x3d } else { 0x3e });
        bytes.extend(check.to_le_bytes());
        bytes.extend(distance.to_le_bytes());
    }
    bytes
}

/// What a lidar answers a driver, from the first question to two turns of a scan.
fn conversation(model: rplidar::Model) -> Vec<u8> {
    let wanted = rplidar::Wanted { baud: model.baud(), mode: None, motor_rpm: 600, searches: false };
    let (mut lidar, mut session) = (rplidar::Emulated::new(model), rplidar::Session::new(wanted, 0));
    let (mut all, mut samples) = (vec![64, 1], Vec::new());
    for ms in 0..600 {
        let (now_ns, mut sent) = (ms * 1_000_000, Vec::new());
        session.tick(now_ns);
        while let Some(to_do) = session.next_to_do() {
            if let rplidar::Do::Write(bytes) = to_do {
                lidar.received(now_ns, &bytes, &mut sent);
            }
        }
        lidar.advance(now_ns, |angle_deg, _| (angle_deg < 300.0).then_some(2.0), &mut sent);
        session.received(now_ns, &sent, &mut samples);
        all.extend(sent);
    }
    all
}

/// A WAV file with a chunk before its samples, and how a head, a manifest, a rehearsal set and a language begin.
fn sounds() {
    let mut wav =
        b"RIFF\x40\0\0\0WAVELIST\x03\0\0\0abc\0fmt \x10\0\0\0\x01\0\x01\0\x80\x3e\0\0\0\x7d\0\0\x02\0\x10\0".to_vec();
    wav.extend(b"data\x40\0\0\0");
    wav.extend((0..32_i16).flat_map(|i| (i * 900).to_le_bytes()));
    seed("hearing", "wav", &[&[7, 0], &wav[..]].concat());
    for (kind, name) in [(1, "cues.toml"), (2, "cues.onnx")] {
        let bytes = std::fs::read(Path::new("../config/cues").join(name)).expect("the project's head");
        seed("hearing", name, &[&[0, kind], &bytes[..]].concat());
    }
    let mut set = b"GDRH\x01\0\0\0\x02\0\0\0\x03\0\0\0\0\0\0\x3f".to_vec();
    set.extend([4, 1, 0, 2, 4, 6, 8, 10]);
    seed("hearing", "rehearsal", &[&[0, 3], &set[..]].concat());
    let language = std::fs::read("../config/languages/en.toml").expect("the project's language");
    seed("hearing", "language", &[&[0, 4], &language[..]].concat());
}

/// A world of BARN with its path, and an episode of SocNavBench with its datasets and tracks.
fn yardsticks() {
    let header = "{'descr': '<i8', 'fortran_order': False, 'shape': (2, 2), }\n";
    let cells = [15i64, 0, 15, 29].into_iter().flat_map(i64::to_le_bytes);
    let mut path = b"\x93NUMPY\x01\x00".to_vec();
    path.extend((header.len() as u16).to_le_bytes());
    path.extend(header.bytes().chain(cells));
    seed("yardsticks", "barn", &[b"b", GAZEBO.as_bytes(), &[BORDER], &path].concat());
    let parts = [EPISODES, DATASETS, TRACKS].map(str::as_bytes);
    seed("yardsticks", "socnavbench", &[b"s", &parts.join(&BORDER)[..]].concat());
}

fn main() {
    sounds();
    yardsticks();
    for model in rplidar::Model::ALL {
        seed("line", &format!("{model:?}"), &conversation(model));
    }
    let mut parts = vec![0, 7, 0];
    parts.extend(SCAN.replace('\n', "").bytes());
    parts.extend([0, 1, 7, 0]);
    parts.extend(ODOMETRY.replace('\n', "").bytes());
    let whole = recording(&parts).expect("a recording can be written");
    seed("recording", "messages", &[&[1], &parts[..]].concat());
    seed("recording", "file", &[&[0], &whole[..]].concat());
    for (name, image) in ["png", "pgm"].into_iter().zip(images()) {
        seed("map", name, &[YAML.as_bytes(), &[0], &image].concat());
    }
    for folder in ["worlds", "scenarios"] {
        for entry in std::fs::read_dir(Path::new("../config").join(folder)).expect("the project's worlds").flatten() {
            let text = std::fs::read(entry.path()).expect("readable");
            seed("world", &format!("{folder}-{}", entry.file_name().to_string_lossy()), &text);
        }
    }
    seed("carmen", "log", LOG.as_bytes());
    seed("rplidar", "capture", &capture());
    for (name, text) in [("stop", "{\"verb\":\"stop\"}\n"), ("cue", "{\"verb\":\"cue\",\"cue\":\"left\"}\n")] {
        seed("control", name, &[&[9], text.as_bytes(), text.as_bytes()].concat());
    }
    for name in ["guidedog.toml", "profiles/carmen.toml"] {
        let text = std::fs::read(Path::new("../config").join(name)).expect("the project's configuration");
        seed("settings", &name.replace('/', "-"), &text);
    }
}
