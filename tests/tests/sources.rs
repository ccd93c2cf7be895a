//! What every source has to keep to, whatever is behind it: lidar, depth, odometry and link, simulated, from devices,
//! over every kind of line, and replayed.

use std::collections::BTreeMap;
use std::path::Path;

use guidedog_tests::{Place, project};
use messages::{Header, LocomotionState, Odometry, TopicId, Twist2};
use recording::{Reader, Record};

const MS: u64 = 1_000_000;
/// From measuring to publishing, nanoseconds: twice what is still allowed for motion, for a machine that is shared.
const LATE_NS: u64 = 400 * MS;
/// Once a command has been the same for so long, the robot goes so, nanoseconds.
const SETTLED_NS: u64 = 600 * MS;

/// What is known of a stream so far.
#[derive(Default)]
struct Stream {
    last: Option<Header>,
    count: usize,
}

impl Stream {
    /// Numbers go up by one and stamps go up, within a life; nothing is published before it was measured, or late.
    fn take(&mut self, header: Header, what: &str) {
        self.count += 1;
        if let Some(last) = self.last.filter(|last| last.incarnation == header.incarnation) {
            assert_eq!(header.seq, last.seq + 1, "{what}: a number is missing");
            assert!(header.stamp_ns > last.stamp_ns, "{what}: stamps go back: {last:?}, {header:?}");
        }
        assert!(header.incarnation > 0, "{what}: a life without a number");
        let age_ns = header.published_ns.checked_sub(header.stamp_ns);
        assert!(age_ns.is_some_and(|age_ns| age_ns <= LATE_NS), "{what}: {header:?}");
        self.last = Some(header);
    }
}

/// Everything that a recording tells of its sources.
#[derive(Default)]
struct Sources {
    streams: BTreeMap<TopicId, Stream>,
    scan: Option<(usize, f64)>,
    pose: Option<Odometry>,
    /// The command in force, and since when, nanoseconds.
    command: Option<(Twist2, u64)>,
    settled: usize,
}

impl Sources {
    fn of(recording: &Path, what: &str) -> Self {
        let mut sources = Self::default();
        for record in Reader::open(recording).expect("a recording") {
            sources.take(record.expect("readable"), what);
        }
        sources
    }

    fn take(&mut self, record: Record, what: &str) {
        let stream = |sources: &mut Self, topic, header| {
            sources.streams.entry(topic).or_default().take(header, &format!("{what}, {topic:?}"));
        };
        match record {
            Record::LidarScan(scan) => {
                let (header, ranges_m) = (scan.header, scan.data);
                stream(self, TopicId::LidarScan, header.header);
                let layout = (ranges_m.len(), header.angle_increment_rad);
                assert_eq!(*self.scan.get_or_insert(layout), layout, "{what}: the layout changes");
                assert!(ranges_m.len() as f64 * layout.1.abs() <= std::f64::consts::TAU + 1e-6, "{what}: over a turn");
                assert!(header.sigma_m > 0.0 && header.range_min_m < header.range_max_m, "{what}: {header:?}");
                let known = ranges_m.iter().filter(|range_m| f64::from(**range_m) >= header.range_min_m).count();
                assert!(2 * known > ranges_m.len(), "{what}: most of a corridor is seen: {known}");
            }
            Record::DepthFrame(frame) => {
                let (header, pixels_mm) = (frame.header, frame.data);
                stream(self, TopicId::DepthFrame, header.header);
                assert_eq!(pixels_mm.len(), (header.width * header.height) as usize, "{what}");
                let lens = [header.fx_px, header.fy_px, header.cx_px, header.cy_px];
                assert!(lens.iter().all(|px| px.is_finite() && *px > 0.0), "{what}: {header:?}");
                assert!(pixels_mm.iter().any(|mm| *mm > 0), "{what}: a corridor is seen");
            }
            Record::Odometry(pose) => {
                stream(self, TopicId::Odometry, pose.header);
                self.take_pose(*pose, what);
            }
            Record::LocomotionState(state) => {
                stream(self, TopicId::LocomotionState, state.header);
                self.take_state(&state, what);
            }
            _ => {}
        }
    }

    /// No pose is farther from the one before than the robot walks, and nobody gets surer by walking.
    fn take_pose(&mut self, pose: Odometry, what: &str) {
        assert!(pose.odom_from_robot.is_finite() && pose.twist.is_finite(), "{what}: {pose:?}");
        assert!(pose.sigma.iter().all(|sigma| sigma.is_finite() && *sigma >= 0.0), "{what}: {pose:?}");
        if let Some(last) = self.pose.filter(|last| last.header.incarnation == pose.header.incarnation) {
            let (from, to) = (last.odom_from_robot, pose.odom_from_robot);
            let dt_s = (pose.header.stamp_ns - last.header.stamp_ns) as f64 / 1e9;
            let way_m = (to.x_m - from.x_m).hypot(to.y_m - from.y_m);
            assert!(way_m <= 1.5 * dt_s + 0.1, "{what}: a jump of {way_m} m in {dt_s} s");
        }
        self.pose = Some(pose);
    }

    /// The robot goes as it is commanded, once it had time to.
    fn take_state(&mut self, state: &LocomotionState, what: &str) {
        let now_ns = state.header.stamp_ns;
        let (command, since_ns) = *self.command.get_or_insert((state.applied, now_ns));
        if command != state.applied {
            self.command = Some((state.applied, now_ns));
        } else if now_ns - since_ns > SETTLED_NS && state.measured_valid {
            self.settled += 1;
            let off = [
                state.measured.vx_mps - command.vx_mps,
                state.measured.vy_mps - command.vy_mps,
                state.measured.wz_radps - command.wz_radps,
            ];
            assert!(off.iter().all(|off| off.abs() < 0.15), "{what}: {command:?}, {:?}", state.measured);
        }
    }

    fn count(&self, topic: TopicId) -> usize {
        self.streams.get(&topic).map_or(0, |stream| stream.count)
    }

    /// Every stream came, and the robot walked.
    fn assert_whole(&self, what: &str) {
        for (topic, least) in [(TopicId::LidarScan, 40), (TopicId::DepthFrame, 20), (TopicId::Odometry, 200)] {
            assert!(self.count(topic) >= least, "{what}: {} of {topic:?}", self.count(topic));
        }
    }
}

fn recorded(place: &Place, args: &[&str], name: &str) -> String {
    let path = place.path().join(name).to_string_lossy().into_owned();
    let (report, _) = place.json(&[args, &["--record", &path, "--json"]].concat());
    assert_eq!(report["not_recorded"], 0, "{name}: {report:#}");
    path
}

#[test]
fn every_source_keeps_to_what_is_expected_of_one() {
    let place = Place::new();
    let link = |link: &str| {
        let shipped = std::fs::read_to_string(project().join("config/go2.toml")).expect("readable");
        let path = place.path().join(format!("{link}.toml"));
        std::fs::write(&path, shipped.replace("link = \"go2\"", &format!("link = \"{link}\""))).expect("written");
        path.to_string_lossy().into_owned()
    };
    let (unitree, go2, ros2) = (link("unitree"), link("go2"), link("ros2"));
    let walk = ["walk", "--scenario", "corridor", "--time-limit", "8s"];
    let emulated = |config: &str| [&walk[..], &["--emulated", "--config", config]].concat().join(" ");
    let simulated = walk.join(" ");
    for (what, args) in
        [("simulated", simulated), ("unitree", emulated(&unitree)), ("go2", emulated(&go2)), ("ros2", emulated(&ros2))]
    {
        let args: Vec<&str> = args.split(' ').collect();
        let path = recorded(&place, &args, &format!("{what}.mcap"));
        let sources = Sources::of(Path::new(&path), what);
        sources.assert_whole(what);
        assert!(sources.settled > 20, "{what}: the robot was seen to go as it is commanded: {}", sources.settled);
        let replayed = recorded(&place, &["replay", &path], &format!("{what}-again.mcap"));
        let what = format!("{what}, replayed");
        Sources::of(Path::new(&replayed), &what).assert_whole(&what);
    }
    place.assert_empty();
}
