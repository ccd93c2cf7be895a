mod back;
mod camera;
mod forming;
mod reasons;
mod second;
mod steps;

use super::{Core, CoreConfig};
use guidance::ActionTable;
use messages::{
    Attitude, Cue, CueInForce, CueKind, DepthHeader, Header, Mode, ModeClass, Odometry, Outcome, PermitCause,
    PolicyAction, Pose2, Pose3, ScanHeader, ServiceId, StopKind, StopReason, Twist2, UnsafeCause,
};
use settings::Settings;

const MS: u64 = 1_000_000;
const PIXELS: usize = 64 * 48;

fn header(stamp_ms: u64, seq: u64) -> Header {
    Header { stamp_ns: stamp_ms * MS, seq, incarnation: 1, ..Header::default() }
}

fn scan_header(stamp_ms: u64) -> ScanHeader {
    ScanHeader {
        header: header(stamp_ms, stamp_ms),
        angle_min_rad: -std::f64::consts::PI,
        angle_increment_rad: std::f64::consts::TAU / 360.0,
        range_min_m: 0.1,
        range_max_m: 12.0,
        sigma_m: 0.01,
        ..ScanHeader::default()
    }
}

/// In the open, with the handler where they should be.
fn open_scan() -> Vec<f32> {
    scan_of(handler_place())
}

/// In the open, with the handler there.
fn scan_of(center: (f64, f64)) -> Vec<f32> {
    (0..360)
        .map(|i| {
            let angle = -std::f64::consts::PI + f64::from(i).to_radians();
            let along = center.0 * angle.cos() + center.1 * angle.sin();
            let root = along * along - (center.0.powi(2) + center.1.powi(2) - 0.25f64.powi(2));
            if along > 0.0 && root >= 0.0 { (along - root.sqrt()) as f32 } else { f32::INFINITY }
        })
        .collect()
}

fn handler_place() -> (f64, f64) {
    (-0.75, -0.35)
}

fn odometry(stamp_ms: u64, x_m: f64) -> Odometry {
    Odometry { header: header(stamp_ms, stamp_ms), odom_from_robot: Pose2::new(x_m, 0.0, 0.0), ..Odometry::default() }
}

fn mode(class: ModeClass, stamp_ms: u64) -> Mode {
    let cue = Cue { header: header(0, 7), kind: CueKind::Forward, ..Cue::default() };
    Mode {
        header: header(stamp_ms, 1),
        class,
        epoch: 3,
        active_policy: 1,
        active_shield: 1,
        cue: CueInForce { valid: true, cue },
        ..Mode::default()
    }
}

fn action(decision: u64, index: usize) -> PolicyAction {
    let table = ActionTable::eight();
    let mut action = PolicyAction {
        header: header(decision * 500, decision),
        decision,
        action_table_id: table.id(),
        action_count: table.len() as u32,
        cue_incarnation: 1,
        cue_seq: 7,
        ..PolicyAction::default()
    };
    action.probabilities[index] = 1.0;
    action
}

fn action_at(decision: u64, stamp_ms: u64) -> PolicyAction {
    PolicyAction { decision, header: header(stamp_ms, decision), ..action(2, 1) }
}

fn depth_header(stamp_ms: u64) -> DepthHeader {
    DepthHeader {
        header: header(stamp_ms, stamp_ms),
        width: 64,
        height: 48,
        fx_px: 32.0,
        fy_px: 32.0,
        cx_px: 31.5,
        cy_px: 23.5,
        robot_from_camera: Pose3 { z_m: 0.45, ..Pose3::default() },
    }
}

/// A frame of a wall so far ahead, and of the floor before it, millimetres.
fn wall_mm(mm: u16) -> Vec<u16> {
    let header = depth_header(0);
    let floor_mm = |v: u32| {
        let down = (f64::from(v) - header.cy_px) / header.fy_px;
        if down > 0.0 { 1000.0 * header.robot_from_camera.z_m / down } else { f64::INFINITY }
    };
    (0..header.height).flat_map(|v| vec![floor_mm(v).min(f64::from(mm)) as u16; header.width as usize]).collect()
}

/// A core in run at 1000 ms, all inputs fresh, the robot standing in the open.
fn ready() -> Core {
    ready_with(&Settings::default())
}

fn ready_with(settings: &Settings) -> Core {
    let mut core = Core::new(CoreConfig::of(settings, ActionTable::eight()).expect("a harness"));
    core.take_mode(&mode(ModeClass::Run, 990));
    core.take_odometry(&odometry(990, 0.0));
    core.take_depth(&depth_header(990), &wall_mm(5000));
    core.on_scan(1000 * MS, &scan_header(990), &open_scan());
    core
}

#[test]
fn a_decision_gets_a_permit_that_every_scan_renews_until_the_action_ends() {
    let mut core = ready();
    let permit = core.on_action(1000 * MS, &action(2, 1)).expect("the active policy's");
    assert_eq!((permit.outcome, permit.cause, permit.decision), (Outcome::Granted, PermitCause::Decision, 2));
    assert!((permit.velocity.vx_mps - 0.5).abs() < 1e-9);
    assert_eq!(permit.expiry_ns, 1190 * MS, "the scan's stamp and its max age");
    core.take_odometry(&odometry(1090, 0.0));
    core.take_depth(&depth_header(1090), &wall_mm(5000));
    let renewed = core.on_scan(1100 * MS, &scan_header(1090), &open_scan());
    assert_eq!((renewed.outcome, renewed.cause, renewed.decision), (Outcome::Granted, PermitCause::Scan, 2));
    assert_eq!(renewed.expiry_ns, 1290 * MS);
    core.take_mode(&mode(ModeClass::Run, 1690));
    core.take_odometry(&odometry(1690, 0.25));
    // Who has moved sees something else: no sensor says the same twice.
    core.take_depth(&depth_header(1690), &wall_mm(5001));
    let moved: Vec<f32> = open_scan().iter().map(|range| range + 0.001).collect();
    let ended = core.on_scan(1700 * MS, &scan_header(1690), &moved);
    assert_eq!(ended.outcome, Outcome::ActionEnded);
}

#[test]
fn where_something_held_the_robot_nobody_pushes_again() {
    let mut core = ready();
    let mask = core.on_action(1000 * MS, &action(2, 1)).expect("a verdict").unsafe_mask;
    assert_eq!(mask, 0b1111_0000, "at the start nothing is seen beside them");
    // Locomotion found that the robot did not move, and the handler gives another cue.
    let reason = StopReason::service(StopKind::OdometryContradicts, ServiceId::Odometry, 1);
    core.take_mode(&Mode { epoch: 4, reason, header: header(1300, 2), ..mode(ModeClass::Fault, 0) });
    core.take_mode(&Mode { epoch: 4, header: header(1400, 3), ..mode(ModeClass::Run, 0) });
    core.take_odometry(&odometry(1490, 0.0));
    core.take_depth(&depth_header(1490), &wall_mm(5001));
    core.on_scan(1500 * MS, &scan_header(1490), &open_scan());
    let permit = core.on_action(1500 * MS, &action(3, 1)).expect("a verdict");
    assert_eq!(permit.unsafe_mask, 0b1111_0010, "forward as well");
    assert_eq!(permit.outcome, Outcome::Stop);
}

#[test]
fn a_scan_of_a_time_whose_attitude_nobody_knows_is_judged_by_nobody() {
    let attitude = |ms: u64, roll_rad: f64| Attitude::at_height(ms * MS, roll_rad, 0.0, 0.3);
    let told = |core: &mut Core, ms: u64, attitude: Attitude| {
        core.take_odometry(&Odometry { attitude, ..odometry(ms, 0.0) });
    };
    let outcome = |core: &mut Core| {
        core.take_mode(&mode(ModeClass::Run, 1490));
        core.take_depth(&depth_header(1490), &wall_mm(5001));
        core.on_scan(1500 * MS, &scan_header(1490), &open_scan());
        core.on_action(1500 * MS, &action(3, 1)).expect("a verdict").outcome
    };
    let mut core = ready();
    told(&mut core, 1490, attitude(1490, 0.05));
    assert_eq!(outcome(&mut core), Outcome::Granted, "it is known");
    let mut core = ready();
    told(&mut core, 1300, attitude(1300, 0.05));
    told(&mut core, 1490, Attitude::default());
    assert_eq!(outcome(&mut core), Outcome::StaleOdometry, "told once, and then not any more");
    let mut core = ready();
    told(&mut core, 1490, attitude(1300, 0.05));
    assert_eq!(outcome(&mut core), Outcome::StaleOdometry, "of another time");
    let mut core = ready();
    told(&mut core, 1470, attitude(1470, 0.05));
    told(&mut core, 1490, attitude(1490, 0.9));
    assert_eq!(
        outcome(&mut core),
        Outcome::Granted,
        "one of a robot on its side is not taken, and the last one is young"
    );
    let mut core = ready();
    told(&mut core, 1490, attitude(1490, 0.9));
    let mut health = messages::Health::default();
    core.fill_health(&mut health);
    assert_eq!(health.invalid_inputs, 1);
}

#[test]
fn who_walked_too_far_met_nothing() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1)).expect("a verdict");
    let fast = Odometry { twist: Twist2 { vx_mps: 1.0, ..Twist2::ZERO }, ..odometry(1290, 0.5) };
    core.take_odometry(&fast);
    let reason = StopReason::service(StopKind::OdometryContradicts, ServiceId::Odometry, 1);
    core.take_mode(&Mode { epoch: 4, reason, header: header(1300, 2), ..mode(ModeClass::Fault, 0) });
    core.take_mode(&Mode { epoch: 4, header: header(1400, 3), ..mode(ModeClass::Run, 0) });
    core.take_odometry(&odometry(1490, 0.5));
    core.take_depth(&depth_header(1490), &wall_mm(5001));
    core.on_scan(1500 * MS, &scan_header(1490), &open_scan());
    assert_eq!(core.on_action(1500 * MS, &action(3, 1)).expect("a verdict").unsafe_mask, 0);
}

#[test]
fn each_decision_is_drawn_once_and_only_the_active_policys() {
    let mut core = ready();
    assert!(core.on_action(1000 * MS, &action(2, 1)).is_some());
    assert!(core.on_action(1000 * MS, &action(2, 1)).is_none(), "drawn already");
    let mut shadow = action(3, 1);
    shadow.header.incarnation = 2;
    assert!(core.on_action(1000 * MS, &shadow).is_none(), "not the active policy");
    core.on_action(2500 * MS, &action(5, 1));
    let mut health = messages::Health::default();
    core.fill_health(&mut health);
    assert_eq!((health.decisions, health.missed_decisions), (2, 2), "3 and 4 did not come");
}

/// A decision of policy 2.
fn decision_of_2(decision: u64) -> PolicyAction {
    let mut action = action(decision, 1);
    action.header.incarnation = 2;
    action
}

#[test]
fn while_a_policy_is_swapped_every_decision_is_drawn_once() {
    let mut core = ready();
    assert!(core.on_action(1000 * MS, &action(2, 1)).is_some());
    let swap = |active: u32, previous: u32, stamp_ms: u64| Mode {
        active_policy: active,
        previous_policy: previous,
        ..mode(ModeClass::Run, stamp_ms)
    };
    // Decision 3 of the candidate comes before the mode that names it.
    assert!(core.on_action(1500 * MS, &decision_of_2(3)).is_none());
    assert!(core.draw_standby(1500 * MS).is_none(), "nobody has named it");
    core.take_mode(&swap(2, 1, 1500));
    assert!(core.on_action(1501 * MS, &action(3, 1)).is_none(), "the one before stands by");
    assert_eq!(core.draw_standby(1501 * MS).map(|permit| permit.policy_incarnation), Some(2));
    assert!(core.draw_standby(1600 * MS).is_none(), "drawn already");
    // Decision 4 of the active policy does not come: that of the one before is drawn, a little later.
    assert!(core.on_action(2001 * MS, &action(4, 1)).is_none());
    assert!(core.draw_standby(2001 * MS).is_none(), "the active policy has a moment yet");
    let due_ns = core.standby_due_ns().expect("it is waited for");
    let drawn = core.draw_standby(due_ns).map(|permit| (permit.decision, permit.policy_incarnation));
    assert_eq!(drawn, Some((4, 1)));
    assert_eq!(core.on_action(2100 * MS, &decision_of_2(4)).map(|permit| permit.decision), None, "too late");
    let mut health = messages::Health::default();
    core.fill_health(&mut health);
    assert_eq!((health.decisions, health.missed_decisions), (3, 0));
}

#[test]
fn a_decision_that_stood_by_for_too_long_is_drawn_for_nobody() {
    let mut core = ready();
    assert!(core.on_action(1000 * MS, &action(2, 1)).is_some());
    assert!(core.on_action(1500 * MS, &decision_of_2(3)).is_none());
    core.take_mode(&Mode { active_policy: 2, previous_policy: 1, ..mode(ModeClass::Run, 3000) });
    assert!(core.draw_standby(3000 * MS).is_none());
    assert_eq!(core.standby_due_ns(), None, "and nobody is woken for it");
}

#[test]
fn something_in_the_way_makes_the_rest_of_the_action_unsafe() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1));
    let mut blocked = open_scan();
    blocked[178..=182].fill(0.45);
    core.take_odometry(&odometry(1090, 0.0));
    core.take_depth(&depth_header(1090), &wall_mm(5000));
    let permit = core.on_scan(1100 * MS, &scan_header(1090), &blocked);
    assert_eq!(permit.outcome, Outcome::RemainderUnsafe);
    assert!(permit.velocity.is_zero() && permit.margin_m < 0.0);
    // It says by which beam: 0.45 m are read where the hull of the rest reaches farther.
    assert_eq!((permit.unsafe_cause, permit.reading_m as f32), (UnsafeCause::Beam, 0.45));
    assert!((178..=182).contains(&permit.beam) && permit.threshold_m > 0.45, "{permit:?}");
    // The next scan shows nothing there: the robot does not go on and stop with each scan. The next action may.
    core.take_mode(&mode(ModeClass::Run, 1190));
    core.take_odometry(&odometry(1190, 0.0));
    core.take_depth(&depth_header(1190), &wall_mm(5000));
    let permit = core.on_scan(1200 * MS, &scan_header(1190), &open_scan());
    assert_eq!((permit.outcome, permit.unsafe_cause), (Outcome::RemainderUnsafe, UnsafeCause::Beam));
    core.take_mode(&mode(ModeClass::Run, 1490));
    core.take_odometry(&odometry(1490, 0.0));
    core.take_depth(&depth_header(1490), &wall_mm(5000));
    core.on_scan(1495 * MS, &scan_header(1490), &open_scan());
    let permit = core.on_action(1500 * MS, &action(3, 1)).expect("a permit");
    assert_eq!(permit.outcome, Outcome::Granted);
}

#[test]
fn what_was_measured_then_is_judged_from_where_the_robot_is_now() {
    // A wall that leaves 0.1 m beside the hull of forward where the scan was taken.
    let wall = |x_m: f64| -> Vec<f32> {
        let mut ranges = open_scan();
        for (i, range) in ranges.iter_mut().enumerate() {
            let angle = -std::f64::consts::PI + (i as f64).to_radians();
            let reading = x_m / angle.cos();
            if angle.cos() > 0.3 {
                *range = range.min(reading as f32);
            }
        }
        ranges
    };
    for (moved_m, expected) in [(0.0, Outcome::Granted), (0.15, Outcome::AllUnsafe)] {
        let mut core = ready();
        core.on_scan(1000 * MS, &scan_header(990), &wall(0.65));
        // The robot went on since the scan was taken; the decision is judged later on the same scan.
        core.take_odometry(&odometry(1090, moved_m));
        core.take_depth(&depth_header(1090), &wall_mm(5001));
        let mut late = action(2, 1);
        late.header.stamp_ns = 1095 * MS;
        let permit = core.on_action(1100 * MS, &late).expect("a verdict");
        let forward_is_unsafe = permit.unsafe_mask >> 1 & 1 == 1;
        assert_eq!(forward_is_unsafe, expected != Outcome::Granted, "moved {moved_m} m: {permit:?}");
    }
}

#[test]
fn a_scan_from_before_anything_is_known_of_the_robots_place_is_refused() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1));
    assert_eq!(core.on_scan(1010 * MS, &scan_header(985), &open_scan()).outcome, Outcome::InvalidScan);
}

#[test]
fn what_is_stamped_in_the_future_is_refused() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1));
    assert_eq!(core.on_scan(1010 * MS, &scan_header(1500), &open_scan()).outcome, Outcome::StaleScan);
}

#[test]
fn a_decision_of_another_time_is_refused_and_blocks_none_that_follow() {
    let mut core = ready();
    for wrong in [u64::MAX, 900, 4] {
        assert_eq!(core.on_action(1000 * MS, &action_at(wrong, 1000)).map(|p| p.outcome), Some(Outcome::InvalidAction));
    }
    assert_eq!(core.on_action(1000 * MS, &action(2, 1)).map(|p| p.outcome), Some(Outcome::Granted));
}

#[test]
fn a_pose_that_jumps_is_counted_for_the_supervisor() {
    let mut core = ready();
    core.take_odometry(&odometry(1010, 3.0));
    let mut health = messages::Health::default();
    core.fill_health(&mut health);
    assert_eq!(health.pose_jumps, 1);
}

#[test]
fn what_was_seen_stays_in_the_way_until_it_is_seen_gone_or_the_frame_is_a_new_one() {
    for (incarnation, forbidden) in [(1, true), (2, false)] {
        let mut core = ready();
        let (mut post, mut unknown) = (open_scan(), open_scan());
        post[178..=182].fill(0.5);
        core.on_scan(1000 * MS, &scan_header(995), &post);
        // Five beams alone are no gap that anything is feared in.
        unknown[178..=182].fill(f32::NAN);
        let mut moved = odometry(1090, 0.0);
        moved.header.incarnation = incarnation;
        core.take_odometry(&moved);
        core.take_depth(&depth_header(1095), &wall_mm(5000));
        core.on_scan(1100 * MS, &scan_header(1095), &unknown);
        let permit = core.on_action(1100 * MS, &action_at(2, 1095)).expect("a verdict");
        assert_eq!(permit.unsafe_mask >> 1 & 1 == 1, forbidden, "forward: {permit:?}");
    }
}

#[test]
fn a_permit_ends_with_every_input_that_it_was_judged_on() {
    let mut settings = Settings::default();
    settings.depth.needed = false;
    let mut core = ready_with(&settings);
    let permit = core.on_action(1000 * MS, &action(2, 1)).expect("a verdict");
    assert_eq!(permit.expiry_ns, 1190 * MS);
    core.take_odometry(&odometry(1090, 0.0));
    let permit = core.on_scan(1100 * MS, &scan_header(1095), &open_scan());
    assert_eq!((permit.outcome, permit.expiry_ns), (Outcome::Granted, 1190 * MS), "the frame is of 990 ms");
    let permit = core.on_scan(1150 * MS, &scan_header(1095), &open_scan());
    assert_eq!(permit.expiry_ns, 1190 * MS);
}

#[test]
fn a_scan_that_comes_late_is_not_remembered() {
    let mut core = ready();
    let mut unknown = open_scan();
    unknown[165..=195].fill(f32::NAN);
    // Open, and stamped 1.1 s, but it comes at 2.0 s.
    core.take_mode(&mode(ModeClass::Run, 2000));
    for stamp_ms in (1010..2100).step_by(20) {
        core.take_odometry(&odometry(stamp_ms, 0.0));
    }
    core.take_depth(&depth_header(2000), &floor_ahead());
    assert_eq!(core.on_scan(2000 * MS, &scan_header(1100), &open_scan()).outcome, Outcome::StaleScan);
    core.on_scan(2100 * MS, &scan_header(2090), &unknown);
    let permit = core.on_action(2100 * MS, &action_at(4, 2095)).expect("a verdict");
    assert_eq!(permit.unsafe_mask >> 1 & 1, 1, "nobody has seen the way ahead for a second: {permit:?}");
}

#[test]
fn unknown_beams_are_excused_by_what_a_scan_saw_free_a_moment_ago_and_no_longer() {
    let mut core = ready();
    let mut unknown = open_scan();
    unknown[170..190].fill(f32::NAN);
    let mut verdict = |stamp_ms: u64| {
        core.take_mode(&mode(ModeClass::Run, stamp_ms));
        core.take_odometry(&odometry(stamp_ms, 0.0));
        // The camera looks at the floor just ahead and excuses nothing.
        core.take_depth(&depth_header(stamp_ms), &floor_ahead());
        core.on_scan((stamp_ms + 5) * MS, &scan_header(stamp_ms), &unknown);
        let decision = action_at((stamp_ms + 5) / 500, stamp_ms + 5);
        let permit = core.on_action((stamp_ms + 5) * MS, &decision).expect("a verdict");
        permit.unsafe_mask >> 1 & 1 == 1
    };
    assert!(!verdict(1090), "seen free at 1.0 s");
    assert!(verdict(1590), "and not since");
}

/// A camera at 0.45 m that sees the floor 0.3 m ahead, and nothing else.
fn floor_ahead() -> Vec<u16> {
    let mut pixels = vec![0; PIXELS];
    pixels[64 * 44..].fill(700);
    pixels
}

#[test]
fn unusable_or_old_input_is_refused_with_its_reason() {
    let refused = |spoil: &dyn Fn(&mut Core) -> Outcome, expected: Outcome| {
        let mut core = ready();
        core.on_action(1000 * MS, &action(2, 1));
        assert_eq!(spoil(&mut core), expected);
        assert!(!expected.is_verdict());
    };
    let scan = |core: &mut Core, ranges: &[f32]| core.on_scan(1050 * MS, &scan_header(1040), ranges).outcome;
    refused(&|core| scan(core, &[f32::NAN; 360]), Outcome::InvalidScan);
    refused(&|core| scan(core, &[-1.0; 360]), Outcome::InvalidScan);
    refused(&|core| scan(core, &[]), Outcome::InvalidScan);
    refused(
        &|core| {
            core.take_depth(&depth_header(1040), &[5000; PIXELS - 1]);
            scan(core, &open_scan())
        },
        Outcome::StaleDepth,
    );
    refused(
        &|core| {
            core.take_odometry(&odometry(1040, 3.0));
            scan(core, &open_scan())
        },
        Outcome::StaleOdometry,
    );
    refused(
        &|core| {
            core.take_odometry(&odometry(1040, f64::NAN));
            core.on_scan(1200 * MS, &scan_header(1190), &open_scan()).outcome
        },
        Outcome::StaleOdometry,
    );
    refused(&|core| core.on_scan(1300 * MS, &scan_header(1000), &open_scan()).outcome, Outcome::StaleScan);
    refused(
        &|core| {
            core.take_mode(&mode(ModeClass::Fault, 1040));
            scan(core, &open_scan())
        },
        Outcome::NotInRun,
    );
    refused(
        &|core| {
            let mut other = mode(ModeClass::Run, 1040);
            other.cue.cue.header.seq = 8;
            core.take_mode(&other);
            scan(core, &open_scan())
        },
        Outcome::CueMismatch,
    );
}

#[test]
fn an_action_that_is_no_distribution_over_the_table_is_refused() {
    for spoil in [
        |a: &mut PolicyAction| a.action_table_id = 1,
        |a: &mut PolicyAction| a.action_count = 7,
        |a: &mut PolicyAction| a.probabilities[1] = f32::NAN,
        |a: &mut PolicyAction| a.probabilities[1] = 0.3,
        |a: &mut PolicyAction| (a.probabilities[1], a.probabilities[2]) = (2.0, -1.0),
    ] {
        let mut bad = action(2, 1);
        spoil(&mut bad);
        assert_eq!(ready().on_action(1000 * MS, &bad).map(|p| p.outcome), Some(Outcome::InvalidAction));
    }
}

#[test]
fn nobody_at_the_harness_for_a_second_is_no_permit() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1));
    let nobody = [f32::INFINITY; 360];
    let mut outcome = Outcome::NoAction;
    for stamp in (1090..2300).step_by(100) {
        core.take_odometry(&odometry(stamp, 0.0));
        core.take_depth(&depth_header(stamp), &wall_mm(5000));
        core.take_mode(&mode(ModeClass::Run, stamp));
        outcome = core.on_scan((stamp + 10) * MS, &scan_header(stamp), &nobody).outcome;
    }
    assert_eq!(outcome, Outcome::HandlerNotSeen);
}

#[test]
fn a_sensor_that_sends_the_same_again_while_the_robot_moves_is_not_judged_on() {
    for (scale, pixel, stuck) in
        [(1.0, 5001, Some(Outcome::StuckScan)), (1.001, 5000, Some(Outcome::StuckDepth)), (1.001, 5001, None)]
    {
        let mut core = ready();
        core.on_action(1000 * MS, &action(2, 1));
        core.take_odometry(&odometry(1090, 0.045));
        core.take_depth(&depth_header(1090), &wall_mm(pixel));
        let scan: Vec<f32> = open_scan().iter().map(|range| range * scale).collect();
        let outcome = core.on_scan(1100 * MS, &scan_header(1090), &scan).outcome;
        assert_eq!(stuck.unwrap_or(outcome), outcome);
        assert_eq!(stuck.is_none(), outcome.is_verdict(), "{outcome:?}");
    }
}

#[test]
fn a_mode_whose_epoch_leaps_is_no_supervisors() {
    let mut core = ready();
    core.on_action(1000 * MS, &action(2, 1));
    core.take_mode(&Mode { epoch: u64::MAX, ..mode(ModeClass::Lock, 1000) });
    assert_eq!(core.on_scan(1010 * MS, &scan_header(1000), &open_scan()).outcome, Outcome::Granted);
}
