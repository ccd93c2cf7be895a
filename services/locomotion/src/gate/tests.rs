use super::{Gate, GateLimits};
use messages::{
    Attitude, Cue, CueInForce, CueKind, EmergencyStop, Formation, Header, Mode, ModeClass, Odometry, Outcome, Permit,
    ServiceId, StopInput, StopKind, StopReason, Twist2, UnsafeCause,
};
use settings::Settings;

const MS: u64 = 1_000_000;

fn header(stamp_ms: u64, seq: u64, incarnation: u32) -> Header {
    Header { stamp_ns: stamp_ms * MS, seq, incarnation, ..Header::default() }
}

fn mode(class: ModeClass, epoch: u64, stamp_ms: u64) -> Mode {
    let cue = Cue { header: header(0, 4, 1), kind: CueKind::Forward, ..Cue::default() };
    Mode {
        header: header(stamp_ms, 1, 1),
        class,
        epoch,
        active_policy: 1,
        active_shield: 1,
        cue: CueInForce { valid: true, cue },
        ..Mode::default()
    }
}

fn permit(stamp_ms: u64, expiry_ms: u64) -> Permit {
    Permit {
        header: header(stamp_ms, 9, 1),
        outcome: Outcome::Granted,
        epoch: 2,
        policy_incarnation: 1,
        odometry_incarnation: 1,
        cue_incarnation: 1,
        cue_seq: 4,
        action: 1,
        velocity: GateLimits::of(&Settings::default()).actions[0][1],
        expiry_ns: expiry_ms * MS,
        ..Permit::default()
    }
}

/// A gate that lets the robot move at 1000 ms.
fn moving() -> Gate {
    let mut gate = Gate::new(GateLimits::of(&Settings::default()));
    gate.line_armed(ServiceId::Lidar, 1);
    gate.line_armed(ServiceId::Policy, 1);
    gate.line_armed(ServiceId::Shield, 1);
    gate.take_mode(&mode(ModeClass::Fault, 2, 900));
    gate.take_mode(&mode(ModeClass::Run, 2, 950));
    gate.take_odometry(&Odometry { header: header(990, 5, 1), ..Odometry::default() });
    gate.take_permit(&permit(980, 1100));
    gate
}

fn kind(gate: &mut Gate, now_ms: u64) -> StopKind {
    let verdict = gate.judge(now_ms * MS);
    assert_eq!(verdict.velocity.is_zero(), verdict.reason.kind != StopKind::None);
    verdict.reason.kind
}

#[test]
fn a_fresh_permit_moves_the_robot_and_its_expiry_stops_it() {
    let mut gate = moving();
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
    gate.take_odometry(&Odometry { header: header(1100, 6, 1), ..Odometry::default() });
    assert_eq!(kind(&mut gate, 1100), StopKind::None);
    assert_eq!(kind(&mut gate, 1101), StopKind::PermitExpired);
}

#[test]
fn a_verdict_that_rests_on_an_edge_of_the_floor_says_so() {
    for (outcome, otherwise) in
        [(Outcome::AllUnsafe, StopKind::AllUnsafe), (Outcome::RemainderUnsafe, StopKind::RemainderUnsafe)]
    {
        for (unsafe_cause, expected) in [
            (UnsafeCause::Beam, otherwise),
            (UnsafeCause::Memory, otherwise),
            (UnsafeCause::DropOff, StopKind::DropOff),
            (UnsafeCause::FloorUnseen, StopKind::FloorUnseen),
            (UnsafeCause::StepUp, StopKind::StepUp),
            (UnsafeCause::LowStepDown, StopKind::LowStepDown),
            (UnsafeCause::LowStepUp, StopKind::LowStepUp),
        ] {
            let mut gate = moving();
            gate.take_permit(&Permit { outcome, unsafe_cause, ..permit(990, 1100) });
            assert_eq!(kind(&mut gate, 1000), expected, "{outcome:?}, {unsafe_cause:?}");
        }
    }
}

#[test]
fn where_only_stop_is_left_and_is_free_the_stop_is_gentle() {
    for (unsafe_mask, is_planned) in [(0b1111_1110, true), (0b1111_1111, false)] {
        let mut gate = moving();
        gate.take_permit(&Permit { outcome: Outcome::AllUnsafe, unsafe_mask, ..permit(990, 1100) });
        assert_eq!(gate.judge(1000 * MS).planned, is_planned, "{unsafe_mask:b}");
    }
}

#[test]
fn a_permit_needs_its_shields_open_line_here() {
    let mut gate = moving();
    gate.lines.retain(|line| line.service != ServiceId::Shield);
    assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit, "no line of a shield is watched");
    gate.line_armed(ServiceId::Shield, 2);
    assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit, "it is another shield's");
}

#[test]
fn a_stop_that_was_overtaken_by_resume_and_cue_stops_nothing_and_a_lost_supervisor_for_good() {
    let mut gate = moving();
    gate.stop_by(StopReason::of(StopKind::OperatorStop), 1);
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
    gate.stop_by(StopReason::of(StopKind::SupervisorLost), u64::MAX);
    gate.take_mode(&mode(ModeClass::Run, 9, 1000));
    gate.take_permit(&Permit { epoch: 9, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1000), StopKind::SupervisorLost);
}

#[test]
fn what_was_stamped_in_the_future_moves_nothing() {
    let mut gate = moving();
    gate.take_mode(&mode(ModeClass::Run, 2, 5000));
    assert_eq!(kind(&mut gate, 1000), StopKind::ModeStale);
    let mut gate = moving();
    gate.take_odometry(&Odometry { header: header(5000, 6, 1), ..Odometry::default() });
    assert_eq!(kind(&mut gate, 1000), StopKind::OdometryStale);
}

#[test]
fn a_permit_of_another_life_epoch_cue_or_policy_moves_nothing() {
    for spoil in [
        |p: &mut Permit| p.header.incarnation = 2,
        |p: &mut Permit| p.epoch = 1,
        |p: &mut Permit| p.policy_incarnation = 2,
        |p: &mut Permit| p.cue_seq = 3,
    ] {
        let mut gate = moving();
        gate.permit = None;
        let mut spoiled = permit(980, 1100);
        spoil(&mut spoiled);
        gate.take_permit(&spoiled);
        assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit);
    }
}

#[test]
fn a_permit_out_of_bounds_is_refused() {
    for spoil in [
        |p: &mut Permit| p.action = 4,
        |p: &mut Permit| p.action = u32::MAX,
        |p: &mut Permit| p.velocity.vx_mps += 0.01,
        |p: &mut Permit| p.velocity.vx_mps = f64::NAN,
        |p: &mut Permit| p.velocity.vy_mps = 0.9,
        |p: &mut Permit| p.velocity.wz_radps = -2.0,
        |p: &mut Permit| p.expiry_ns = 1300 * MS,
        |p: &mut Permit| p.header.stamp_ns = 1050 * MS,
    ] {
        let mut gate = moving();
        let mut spoiled = permit(980, 1100);
        spoil(&mut spoiled);
        gate.take_permit(&spoiled);
        assert_eq!(kind(&mut gate, 1000), StopKind::PermitInvalid);
    }
}

#[test]
fn a_closed_lifeline_stops_until_a_greater_epoch_and_a_new_line() {
    let mut gate = moving();
    assert!(gate.line_closed(ServiceId::Lidar, 1));
    assert_eq!(kind(&mut gate, 1000), StopKind::LifelineClosed);
    gate.take_permit(&permit(990, 1100));
    assert_eq!(kind(&mut gate, 1000), StopKind::LifelineClosed, "the same epoch does not do");
    gate.take_mode(&mode(ModeClass::Run, 3, 1000));
    assert_eq!(kind(&mut gate, 1000), StopKind::LifelineClosed, "the service is not back");
    gate.line_armed(ServiceId::Lidar, 2);
    let mut fresh = permit(1000, 1100);
    fresh.epoch = 3;
    gate.take_permit(&fresh);
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn a_line_that_closes_after_its_fault_was_read_does_not_latch_the_next_run() {
    let mut gate = moving();
    gate.take_mode(&mode(ModeClass::Fault, 3, 1000));
    gate.line_closed(ServiceId::Lidar, 1);
    gate.line_armed(ServiceId::Lidar, 2);
    gate.take_mode(&mode(ModeClass::Run, 3, 1000));
    let mut fresh = permit(1000, 1100);
    fresh.epoch = 3;
    gate.take_permit(&fresh);
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn a_retired_policy_stops_nothing() {
    let mut gate = moving();
    gate.line_armed(ServiceId::Policy, 7);
    assert!(!gate.line_closed(ServiceId::Policy, 7));
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

/// The mode of a swap: policy 2 is named, and 1 was before.
fn swapped(epoch: u64, stamp_ms: u64) -> Mode {
    Mode { active_policy: 2, previous_policy: 1, ..mode(ModeClass::Run, epoch, stamp_ms) }
}

#[test]
fn a_swap_stops_nothing_and_the_running_action_goes_on() {
    let mut gate = moving();
    gate.line_armed(ServiceId::Policy, 2);
    gate.take_mode(&swapped(2, 1000));
    assert_eq!(kind(&mut gate, 1000), StopKind::None, "the running action is of the policy before");
    gate.take_permit(&Permit { policy_incarnation: 2, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
    assert!(!gate.line_closed(ServiceId::Policy, 1), "the one before may go");
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn the_death_of_the_policy_named_stops_once_and_the_one_before_goes_on_in_the_next_epoch() {
    let mut gate = moving();
    gate.line_armed(ServiceId::Policy, 2);
    gate.take_mode(&swapped(2, 1000));
    assert!(gate.line_closed(ServiceId::Policy, 2));
    assert_eq!(kind(&mut gate, 1000), StopKind::LifelineClosed);
    gate.take_mode(&mode(ModeClass::Run, 3, 1000));
    gate.take_permit(&Permit { epoch: 3, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn a_policy_whose_line_is_not_watched_here_moves_nothing() {
    let mut gate = moving();
    gate.take_mode(&swapped(2, 1000));
    assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit);
    gate.take_permit(&Permit { policy_incarnation: 2, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit);
}

#[test]
fn a_stop_cue_holds_until_a_later_cue_is_in_force() {
    let mut gate = moving();
    gate.take_cue(&Cue { header: header(1000, 5, 1), kind: CueKind::Stop, ..Cue::default() });
    assert_eq!(kind(&mut gate, 1000), StopKind::StopCue);
    gate.take_mode(&mode(ModeClass::Run, 2, 1000));
    assert_eq!(kind(&mut gate, 1000), StopKind::StopCue, "the cue in force is older than the stop");
    let mut later = mode(ModeClass::Run, 2, 1000);
    later.cue.cue.header.seq = 6;
    later.cue.cue.header.stamp_ns = 1000 * MS;
    gate.take_mode(&later);
    let mut fresh = permit(1000, 1100);
    fresh.cue_seq = 6;
    gate.take_permit(&fresh);
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn a_stop_cue_with_false_numbers_is_outlived() {
    let mut gate = moving();
    gate.take_cue(&Cue { header: header(1000, u64::MAX, u32::MAX), kind: CueKind::Stop, ..Cue::default() });
    assert_eq!(kind(&mut gate, 1000), StopKind::StopCue);
    let mut later = mode(ModeClass::Run, 2, 1000);
    later.cue.cue.header = header(1001, 6, 1);
    gate.take_mode(&later);
    gate.take_permit(&Permit { cue_seq: 6, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1001), StopKind::None);
}

#[test]
fn a_stale_mode_needs_a_greater_epoch() {
    let mut gate = moving();
    assert_eq!(kind(&mut gate, 1200), StopKind::ModeStale);
    gate.take_mode(&mode(ModeClass::Run, 2, 1200));
    assert_ne!(kind(&mut gate, 1200), StopKind::None);
}

#[test]
fn a_gate_that_begins_within_a_run_stands() {
    let mut gate = Gate::new(GateLimits::of(&Settings::default()));
    gate.take_mode(&mode(ModeClass::Run, 2, 950));
    gate.take_odometry(&Odometry { header: header(990, 5, 1), ..Odometry::default() });
    gate.take_permit(&permit(980, 1100));
    assert_eq!(kind(&mut gate, 1000), StopKind::Boot);
}

#[test]
fn old_odometry_or_another_frame_stops() {
    let mut gate = moving();
    gate.take_odometry(&Odometry { header: header(990, 5, 2), ..Odometry::default() });
    assert_eq!(kind(&mut gate, 1000), StopKind::OdometryStale);
    let mut gate = moving();
    gate.take_permit(&permit(1090, 1200));
    gate.take_mode(&mode(ModeClass::Run, 2, 1090));
    assert_eq!(kind(&mut gate, 1091), StopKind::OdometryStale);
}

#[test]
fn a_planned_change_is_ramped() {
    let gate = moving();
    let to = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
    let after = gate.ramp(Twist2::ZERO, to, 0.02);
    assert!((after.vx_mps - 0.08).abs() < 1e-12);
    assert_eq!(gate.ramp(to, to, 0.02), to);
}

#[test]
fn a_stop_down_the_line_ends_with_the_run_that_comes_after_it() {
    let mut gate = moving();
    gate.stop_by(StopReason::of(StopKind::OperatorStop), 3);
    gate.take_mode(&mode(ModeClass::Run, 2, 1000));
    gate.take_permit(&permit(990, 1100));
    assert_eq!(kind(&mut gate, 1000), StopKind::OperatorStop);
    gate.take_mode(&mode(ModeClass::Run, 3, 1000));
    let mut fresh = permit(1000, 1100);
    fresh.epoch = 3;
    gate.take_permit(&fresh);
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn a_robot_that_has_fallen_is_commanded_nothing_any_more() {
    let mut gate = moving();
    for ms in (1000..=1100).step_by(20) {
        let attitude = Attitude::at_height(ms * MS, 1.5, 0.0, 0.3);
        gate.take_odometry(&Odometry { header: header(ms, ms, 1), attitude, ..Odometry::default() });
        gate.take_mode(&mode(ModeClass::Run, 2, ms));
        gate.take_permit(&permit(ms, ms + 100));
    }
    assert_eq!(kind(&mut gate, 1100), StopKind::RobotFell);
}

#[test]
fn odometry_that_contradicts_the_commands_stops_until_a_greater_epoch() {
    let mut gate = moving();
    let frozen = |ms: u64| Odometry { header: header(ms, ms, 1), ..Odometry::default() };
    let mut stopped_ms = None;
    for ms in (1000..2000).step_by(20) {
        gate.commanded(ms * MS, permit(0, 0).velocity);
        gate.take_odometry(&frozen(ms));
        gate.take_mode(&mode(ModeClass::Run, 2, ms));
        gate.take_permit(&permit(ms, ms + 100));
        if kind(&mut gate, ms) != StopKind::None {
            assert_eq!(kind(&mut gate, ms), StopKind::OdometryContradicts);
            stopped_ms.get_or_insert(ms);
        } else {
            assert!(stopped_ms.is_none(), "the same epoch does not do");
        }
    }
    assert!(stopped_ms.is_some_and(|ms| ms <= 1700), "{stopped_ms:?}");
    gate.take_mode(&mode(ModeClass::Run, 3, 2000));
    gate.take_permit(&Permit { epoch: 3, ..permit(2000, 2100) });
    assert_eq!(kind(&mut gate, 2000), StopKind::None);
}

#[test]
fn a_recorded_robot_need_not_obey() {
    let settings = Settings::default();
    let mut gate = moving();
    gate.limits = GateLimits { obeyed: false, ..GateLimits::of(&settings) };
    for ms in (1000..2000).step_by(20) {
        gate.commanded(ms * MS, permit(0, 0).velocity);
        gate.take_odometry(&Odometry { header: header(ms, ms, 1), ..Odometry::default() });
    }
    gate.take_mode(&mode(ModeClass::Run, 2, 1980));
    gate.take_permit(&permit(1980, 2100));
    assert_eq!(kind(&mut gate, 1980), StopKind::None);
}

#[test]
fn a_mode_whose_epoch_leaps_is_no_supervisors() {
    let mut gate = moving();
    gate.take_mode(&mode(ModeClass::Run, u64::MAX, 1000));
    assert_eq!(gate.epoch(), 2);
    gate.take_mode(&mode(ModeClass::Fault, 3, 1010));
    assert_eq!(gate.epoch(), 3, "the supervisor's own is still heard");
}

#[test]
fn an_epoch_that_falls_unmasks_the_one_before_and_motion_needs_a_greater_one() {
    let mut gate = moving();
    let seq = |seq: u64, mode: Mode| Mode { header: Header { seq, ..mode.header }, ..mode };
    gate.take_mode(&seq(2, mode(ModeClass::Run, 40, 1000)));
    assert_eq!(kind(&mut gate, 1000), StopKind::NoPermit, "the permit is of another epoch");
    gate.take_mode(&seq(3, mode(ModeClass::Run, 2, 1010)));
    gate.take_permit(&permit(1000, 1100));
    assert_eq!((gate.epoch(), kind(&mut gate, 1010)), (2, StopKind::ModeStale));
    gate.take_mode(&seq(4, mode(ModeClass::Run, 3, 1020)));
    gate.take_permit(&Permit { epoch: 3, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1020), StopKind::None);
    gate.stop_by(StopReason::of(StopKind::SupervisorLost), u64::MAX);
    gate.take_mode(&seq(5, mode(ModeClass::Run, 50, 1030)));
    gate.take_mode(&seq(6, mode(ModeClass::Run, 4, 1030)));
    gate.take_permit(&Permit { epoch: 4, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1030), StopKind::SupervisorLost, "a stop for good is for good");
}

#[test]
fn a_stop_by_the_hand_remote_holds_until_the_operator_resumes_and_a_cue_comes() {
    let mut gate = moving();
    assert!(!gate.may_forget_remote_stop(), "there is none");
    gate.stopped_by_remote();
    assert_eq!(kind(&mut gate, 1000), StopKind::RemoteStop);
    let resumed = |epoch| mode(ModeClass::Fault, epoch, 1000);
    gate.take_mode(&resumed(3));
    assert!(!gate.may_forget_remote_stop(), "that is a fault of something else");
    gate.take_mode(&mode(ModeClass::Lock, 3, 1000));
    assert!(!gate.may_forget_remote_stop(), "the run is locked");
    gate.take_mode(&resumed(4));
    assert!(gate.may_forget_remote_stop());
    assert!(!gate.may_forget_remote_stop(), "once");
    // Pressed again, or still: it is forgotten by the next resume only.
    gate.stopped_by_remote();
    gate.take_mode(&mode(ModeClass::Lock, 5, 1000));
    assert!(!gate.may_forget_remote_stop(), "the run is locked again");
    gate.take_mode(&resumed(6));
    assert!(gate.may_forget_remote_stop());
    gate.take_mode(&mode(ModeClass::Run, 6, 1000));
    gate.take_permit(&Permit { epoch: 6, ..permit(1000, 1100) });
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
}

#[test]
fn where_there_is_an_emergency_stop_its_fresh_word_is_needed_and_a_press_latches() {
    let word = |ms, input| EmergencyStop { header: header(ms, 1, 1), input };
    let mut gate = moving();
    assert!(!gate.take_estop(&word(1000, StopInput::Pressed)), "this run has none");
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
    gate.limits.estop_max_age_ns = Some(100 * MS);
    gate.take_estop(&word(950, StopInput::Unknown));
    assert_eq!(kind(&mut gate, 1000), StopKind::InputUnusable);
    gate.take_estop(&word(950, StopInput::Released));
    assert_eq!(kind(&mut gate, 1000), StopKind::None);
    gate.take_odometry(&Odometry { header: header(1040, 6, 1), ..Odometry::default() });
    assert_eq!((kind(&mut gate, 1050), kind(&mut gate, 1051)), (StopKind::None, StopKind::InputUnusable));
    for input in [StopInput::Pressed, StopInput::Lost] {
        let mut gate = moving();
        gate.limits.estop_max_age_ns = Some(100 * MS);
        assert!(gate.take_estop(&word(1000, input)));
        gate.take_estop(&word(1000, StopInput::Released));
        assert_eq!(kind(&mut gate, 1000), StopKind::EmergencyStop, "{input:?}: a tap is as good");
        gate.take_mode(&mode(ModeClass::Run, 3, 1000));
        gate.take_permit(&Permit { epoch: 3, ..permit(1000, 1100) });
        assert_eq!(kind(&mut gate, 1000), StopKind::None);
    }
}

#[test]
fn in_single_file_the_actions_are_slower_and_no_others_are_permitted() {
    let mut gate = moving();
    let [fast, slow] = [0, 1].map(|formation| gate.limits.actions[formation][1]);
    assert_eq!((fast.vx_mps, slow.vx_mps), (0.5, 0.25));
    for (formation, allowed) in [(Formation::Beside, fast), (Formation::Behind, slow)] {
        gate.take_mode(&Mode { formation, ..mode(ModeClass::Run, 2, 960) });
        for velocity in [fast, slow] {
            gate.take_permit(&Permit { velocity, ..permit(980, 1100) });
            let wanted = if velocity == allowed { StopKind::None } else { StopKind::PermitInvalid };
            assert_eq!(kind(&mut gate, 1000), wanted, "{formation:?}, {velocity:?}");
        }
    }
}
