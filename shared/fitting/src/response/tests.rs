use guidance::accord::{Accord, Response};
use messages::{Attitude, Header, Odometry, Pose2, Twist2};

use super::steps::StepKind;
use super::{Drive, Identified, ResponseError, identify};

const MS: u64 = 1_000_000;
const KINDS: [(f64, f64, f64); 7] = [
    (0.5, 0.0, 0.0),
    (0.0, 0.3, 0.0),
    (0.0, -0.3, 0.0),
    (0.0, 0.0, 0.35),
    (0.0, 0.0, -0.35),
    (0.35, 0.35, 0.0),
    (0.35, -0.35, 0.0),
];

/// A robot whose velocity follows a first-order lag with a delay, and whose body sways as it walks.
#[derive(Clone, Copy)]
struct Robot {
    delay_ms: usize,
    time_constant_s: [f64; 3],
    gain: [f64; 3],
    sway_m: f64,
    roll_rad: f64,
}

const ROBOT: Robot =
    Robot { delay_ms: 120, time_constant_s: [0.15, 0.10, 0.08], gain: [1.0, 0.95, 1.1], sway_m: 0.0, roll_rad: 0.0 };

impl Robot {
    /// Makes each of these motions four times: 2 s, and 3 s of standing.
    fn drive(self, kinds: &[(f64, f64, f64)]) -> Drive {
        let mut drive = Drive { name: "x.mcap".to_owned(), ..Drive::default() };
        let course: Vec<(f64, f64, f64)> = std::iter::repeat_n(kinds, 4).flatten().copied().collect();
        let (mut pose, mut velocity, mut told) = (Pose2::default(), [0.0_f64; 3], Vec::new());
        for ms in 0..2000 + 5000 * course.len() {
            let (i, within) = ((ms.max(2000) - 2000) / 5000, (ms.max(2000) - 2000) % 5000);
            let moves = ms >= 2000 && within < 2000;
            let (x, y, turn) = course.get(i).copied().filter(|_| moves).unwrap_or_default();
            // As locomotion does it, at 50 Hz and by a ramp.
            let last = told.last().copied().unwrap_or([0.0; 3]);
            let ramp = |from: f64, to: f64, most: f64| from + (to - from).clamp(-most, most);
            let next = [ramp(last[0], x, 0.08), ramp(last[1], y, 0.08), ramp(last[2], turn, 0.24)];
            told.push(if ms.is_multiple_of(20) { next } else { last });
            let wanted = ms.checked_sub(self.delay_ms).map_or([0.0; 3], |ms| told[ms]);
            for axis in 0..3 {
                let share = 1.0 - (-0.001 / self.time_constant_s[axis]).exp();
                velocity[axis] += (self.gain[axis] * wanted[axis] - velocity[axis]) * share;
            }
            let (sin, cos) = pose.yaw_rad.sin_cos();
            pose.x_m += (cos * velocity[0] - sin * velocity[1]) * 0.001;
            pose.y_m += (sin * velocity[0] + cos * velocity[1]) * 0.001;
            pose.yaw_rad += velocity[2] * 0.001;
            if ms.is_multiple_of(20) {
                let [vx_mps, vy_mps, wz_radps] = told[ms];
                drive.commands.push((ms as u64 * MS, Twist2 { vx_mps, vy_mps, wz_radps }));
                let walks = if velocity.iter().any(|v| v.abs() > 0.1) { 1.0 } else { 0.0 };
                drive.odometry.push(self.tells(ms as u64, pose, velocity, walks));
            }
        }
        drive
    }

    fn tells(self, ms: u64, pose: Pose2, velocity: [f64; 3], walks: f64) -> Odometry {
        let swing = walks * (ms as f64 / 1e3 * std::f64::consts::TAU * 2.0).sin();
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let side_m = self.sway_m * swing;
        let swayed = Pose2::new(pose.x_m - sin * side_m, pose.y_m + cos * side_m, pose.yaw_rad);
        Odometry {
            header: Header { stamp_ns: ms * MS, incarnation: 1, ..Header::default() },
            odom_from_robot: Pose2 { yaw_rad: guidance::se2::wrap_angle(swayed.yaw_rad), ..swayed },
            twist: Twist2 { vx_mps: velocity[0], vy_mps: velocity[1], wz_radps: velocity[2] },
            attitude: Attitude::at_height(ms * MS + 1, self.roll_rad * swing, 0.0, 0.3),
            ..Odometry::default()
        }
    }
}

fn identified(robot: Robot) -> Identified {
    identify(&[robot.drive(&KINDS)]).expect("it obeys")
}

#[test]
fn delay_time_constants_and_gains_are_those_of_the_robot() {
    let found = identified(ROBOT);
    for (axis, name) in ["forward", "sideways", "turn"].into_iter().enumerate() {
        let response = &found.axes[name];
        let off = |figure: &super::Figure, truth: f64| (figure.value - truth).abs();
        assert!(off(&response.delay_s, 0.12) < 0.02, "{name}: {response:?}");
        assert!(off(&response.time_constant_s, ROBOT.time_constant_s[axis]) < 0.02, "{name}: {response:?}");
        assert!(off(&response.answer_s, 0.12 + ROBOT.time_constant_s[axis]) < 0.015, "{name}: {response:?}");
        assert!(off(&response.gain, ROBOT.gain[axis]) < 0.01, "{name}: {response:?}");
        assert_eq!(response.delay_s.n, if axis == 0 { 4 } else { 8 });
    }
    assert_eq!(found.motions["turn_left"], 4);
}

#[test]
fn overrun_is_what_the_robot_makes_after_zero_by_direction() {
    let found = identified(ROBOT);
    // The velocity at the end, times delay and time constant.
    for (kind, along_m, across_m, turn_rad) in [
        ("forward", 0.5 * 0.27, 0.0, 0.0),
        ("sidestep_left", 0.0, 0.95 * 0.3 * 0.22, 0.0),
        ("sidestep_right", 0.0, 0.95 * 0.3 * 0.22, 0.0),
        ("turn_right", 0.0, 0.0, 1.1 * 0.35 * 0.20),
    ] {
        let overrun = &found.overrun[kind].until_standing;
        for (figure, truth) in [(overrun.along_m, along_m), (overrun.across_m, across_m), (overrun.turn_rad, turn_rad)]
        {
            assert!((figure.value - truth).abs() < 0.012 && figure.max < truth + 0.015, "{kind}: {overrun:?}");
        }
    }
    let profile = found.profile;
    assert!((0.13..=0.17).contains(&profile.overrun_m[0]), "{profile:?}");
    assert!((0.06..=0.10).contains(&profile.overrun_m[1]), "{profile:?}");
    assert!((0.08..=0.10).contains(&profile.overrun_rad), "{profile:?}");
    assert!((200..=400).contains(&profile.lag_ms), "{profile:?}");
}

/// Who holds the harness comes to stand later, and pushes.
#[test]
fn what_moves_a_robot_after_it_stood_is_no_overrun() {
    let mut drive = ROBOT.drive(&KINDS);
    let mut pushed_m = 0.0;
    for (i, odometry) in drive.odometry.iter_mut().enumerate() {
        let within_ms = (20 * i as u64).saturating_sub(2000) % 5000;
        pushed_m += if (3000..3200).contains(&within_ms) { 0.02 } else { 0.0 };
        odometry.odom_from_robot.x_m += pushed_m;
    }
    let found = identify(&[drive]).expect("it obeys").overrun["forward"];
    assert!((found.until_standing.along_m.max - 0.135).abs() < 0.015, "{found:?}");
    assert!((found.farthest.along_m.max - 0.335).abs() < 0.015, "{found:?}");
}

#[test]
fn a_swaying_gait_is_told_and_hides_no_delay() {
    let found = identified(Robot { sway_m: 0.02, roll_rad: 0.05, ..ROBOT });
    let gait = &found.gait["forward"];
    assert!((gait.across_m.value - 0.02 / std::f64::consts::SQRT_2).abs() < 0.003, "{gait:?}");
    assert!((gait.across_m.max - 0.02).abs() < 0.006 && gait.along_m.value < 0.002, "{gait:?}");
    let roll = gait.roll_rad.expect("it is told");
    assert!((roll.value - 0.05 / std::f64::consts::SQRT_2).abs() < 0.005 && (roll.max - 0.05).abs() < 0.01, "{roll:?}");
    let standing = found.standing.expect("it stands");
    assert!(standing.across_m.max < 0.002 && standing.roll_rad.is_some_and(|roll| roll.max < 0.002), "{standing:?}");
    assert!((found.axes["sideways"].answer_s.value - 0.22).abs() < 0.03, "{:?}", found.axes["sideways"]);
    assert!(found.way_off_m.max > identified(ROBOT).way_off_m.max, "its sway is an error of its way");
}

/// What is written is what locomotion lets pass, with room, and no more than it needs to find a frozen odometry.
#[test]
fn locomotion_lets_the_profile_pass_and_nothing_much_tighter() {
    let robot = Robot { sway_m: 0.035, time_constant_s: [0.25; 3], ..ROBOT };
    let (drive, found) = (robot.drive(&KINDS), identified(robot));
    let profile = found.profile;
    let contradicts = |way_off_m: f64, turn_off_rad: f64| {
        let mut accord = Accord::new(Response { lag_ns: profile.lag_ms * MS, way_off_m, turn_off_rad });
        drive.odometry.iter().zip(&drive.commands).any(|(odometry, (at_ns, velocity))| {
            accord.commanded(*at_ns, *velocity);
            accord.off(odometry).is_some_and(|(way_m, turn_rad)| way_m > way_off_m || turn_rad > turn_off_rad)
        })
    };
    assert!(!contradicts(profile.way_off_m, profile.turn_off_rad), "{profile:?}");
    assert!(contradicts(found.way_off_m.max - 0.001, profile.turn_off_rad), "{found:?}");
}

#[test]
fn a_robot_that_does_not_obey_is_refused() {
    let changed = |change: fn(Pose2) -> Pose2| {
        let mut drive = ROBOT.drive(&KINDS);
        drive.odometry.iter_mut().for_each(|it| it.odom_from_robot = change(it.odom_from_robot));
        identify(&[drive]).expect_err("it does not obey").to_string()
    };
    for (what, change, told) in [
        (
            "mirrored",
            (|pose| Pose2 { yaw_rad: -pose.yaw_rad, ..pose }) as fn(Pose2) -> Pose2,
            "to the left came to -1.",
        ),
        ("frozen heading", |pose| Pose2 { yaw_rad: 0.0, ..pose }, "a turn to the left came to 0.00"),
        ("frozen", |_| Pose2::default(), "a motion ahead came to 0.00"),
        ("doubled", |pose| Pose2 { x_m: 2.0 * pose.x_m, y_m: 2.0 * pose.y_m, ..pose }, "a motion ahead came to 2.0"),
    ] {
        let error = changed(change);
        assert!(error.contains(told), "{what}: {error}");
    }
    let slow = Robot { delay_ms: 600, ..ROBOT };
    let error = identify(&[slow.drive(&KINDS)]).expect_err("it is too slow").to_string();
    assert!(error.contains("for 0.50 s nothing happens"), "{error}");
    let sways = Robot { sway_m: 0.4, ..ROBOT };
    let error = identify(&[sways.drive(&KINDS)]).expect_err("it sways too much").to_string();
    assert!(error.contains("off, and 0.25 is the most"), "{error}");
}

#[test]
fn what_is_missing_is_told() {
    let without: Vec<(f64, f64, f64)> = KINDS.into_iter().filter(|(_, _, turn)| *turn <= 0.0).collect();
    let error = identify(&[ROBOT.drive(&without)]).expect_err("a kind is missing").to_string();
    assert_eq!(error, "too few motions: no turn to the left of at least 1 s followed by a zero of at least 1.5 s");
    let mut drive = ROBOT.drive(&KINDS);
    let end_ns = drive.commands[drive.commands.len() / 2].0;
    drive.commands.retain(|(at_ns, _)| *at_ns < end_ns);
    let error = identify(&[drive.clone()]).expect_err("half of it").to_string();
    assert!(error.contains("2 of 3 times a sidestep to the left of at least 1 s"), "{error}");
    assert!(identify(&[drive.clone(), drive]).is_ok(), "two recordings count together");
    for (drive, what) in [
        (Drive { odometry: Vec::new(), ..ROBOT.drive(&KINDS) }, "odometry"),
        (Drive { commands: Vec::new(), ..ROBOT.drive(&KINDS) }, "commands (locomotion/state)"),
    ] {
        let lacks = ResponseError::Lacks { drive: "x.mcap".to_owned(), what };
        assert_eq!(identify(&[drive]), Err(lacks));
    }
}

#[test]
fn a_gap_and_another_frame_are_refused() {
    let mut drive = ROBOT.drive(&KINDS);
    drive.odometry.retain(|it| !(20_000 * MS..20_200 * MS).contains(&it.header.stamp_ns));
    let error = identify(&[drive]).expect_err("a gap").to_string();
    assert_eq!(error, "x.mcap has a gap of 220 ms in its odometry at 19.98 s");
    let mut drive = ROBOT.drive(&KINDS);
    drive.commands.retain(|(at_ns, _)| !(20_000 * MS..20_200 * MS).contains(at_ns));
    assert!(identify(&[drive]).is_err_and(|error| error.to_string().contains("in its commands")));
    let mut drive = ROBOT.drive(&KINDS);
    drive.odometry.iter_mut().skip(1000).for_each(|it| it.header.incarnation = 2);
    assert!(identify(&[drive]).is_err_and(|error| error.to_string().contains("began anew at 20.00 s")));
    let mut drive = ROBOT.drive(&KINDS);
    drive.odometry[1000].odom_from_robot.x_m = f64::NAN;
    assert!(identify(&[drive]).is_err_and(|error| error.to_string().contains("at 20.00 s of x.mcap cannot be used")));
}

#[test]
fn only_single_motions_from_standing_to_standing_count() {
    let at = |ms: u64, vx_mps: f64, wz_radps: f64| (ms * MS, Twist2 { vx_mps, wz_radps, ..Twist2::ZERO });
    let course = |middle: [(f64, f64); 2], stand_ms: u64| {
        let every = |from: u64, to: u64, (v, w): (f64, f64)| (from..to).step_by(20).map(move |ms| at(ms, v, w));
        let commands =
            every(0, 1000, (0.0, 0.0)).chain(every(1000, 2000, middle[0])).chain(every(2000, 3000, middle[1]));
        commands.chain(every(3000, 3000 + stand_ms, (0.0, 0.0))).collect::<Vec<_>>()
    };
    let kinds = |commands: &[_]| super::steps::find(commands).iter().map(|step| step.kind).collect::<Vec<_>>();
    assert_eq!(kinds(&course([(0.5, 0.0), (0.5, 0.0)], 1600)), [StepKind::Forward]);
    assert_eq!(kinds(&course([(0.5, 0.0), (0.5, 0.0)], 1400)), [], "the stop is too short");
    assert_eq!(kinds(&course([(0.5, 0.0), (0.0, 0.3)], 1600)), [], "two motions");
    assert_eq!(kinds(&course([(0.5, 0.3), (0.5, 0.3)], 1600)), [], "an arc");
    assert_eq!(kinds(&course([(-0.5, 0.0), (-0.5, 0.0)], 1600)), [], "backwards");
    assert_eq!(kinds(&[]), []);
}
