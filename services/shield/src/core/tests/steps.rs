//! The robot waits before a low step, and takes it on the handler's word.

use super::{MS, action, depth_header, header, mode, odometry, open_scan, ready, scan_header};
use crate::core::Core;
use messages::{
    Attitude, Cue, CueInForce, CueKind, Formation, Mode, ModeClass, Odometry, Outcome, Permit, PolicyAction,
    UnsafeCause,
};

/// A frame of floor that falls by so much 0.75 m ahead, metres; in millimetres.
fn step_mm(drop_m: f64) -> Vec<u16> {
    let header = depth_header(0);
    let depth_m = |v: u32| {
        let down = (f64::from(v) - header.cy_px) / header.fy_px;
        let to_m = |low_m: f64| (header.robot_from_camera.z_m + low_m) / down;
        if to_m(0.0) < 0.75 { to_m(0.0) } else { to_m(drop_m).max(0.75) }
    };
    let row_mm = |v: u32| (1000.0 * depth_m(v)).clamp(0.0, 5000.0) as u16;
    let of = |v: u32| if f64::from(v) > header.cy_px { row_mm(v) } else { 5000 };
    (0..header.height).flat_map(|v| vec![of(v); header.width as usize]).collect()
}

/// The permits of these decisions before a step of that depth, metres, with that cue in force. It was given at the
/// first of them.
fn decides(core: &mut Core, decisions: std::ops::Range<u64>, cue: (CueKind, u64), drop_m: f64) -> Vec<Permit> {
    decides_in(Formation::Beside, core, decisions, cue, drop_m)
}

/// The same of a policy that wants the handler there.
fn decides_in(
    formation: Formation,
    core: &mut Core,
    decisions: std::ops::Range<u64>,
    (kind, seq): (CueKind, u64),
    drop_m: f64,
) -> Vec<Permit> {
    let given_ms = 500 * decisions.start - 10;
    let decide = |decision: u64| {
        let ms = 500 * decision;
        let cue = CueInForce { valid: true, cue: Cue { header: header(given_ms, seq), kind, ..Cue::default() } };
        core.take_mode(&Mode { cue, ..mode(ModeClass::Run, ms - 10) });
        let attitude = Attitude::at_height((ms - 10) * MS, 0.0, 0.0, 0.3);
        core.take_odometry(&Odometry { attitude, ..odometry(ms - 10, 0.0) });
        core.take_depth(&depth_header(ms - 10), &step_mm(drop_m));
        core.on_scan(ms * MS, &scan_header(ms - 10), &open_scan());
        let forward = PolicyAction { cue_seq: seq, formation, ..action(decision, 1) };
        core.on_action(ms * MS, &forward).expect("the active policy's")
    };
    decisions.map(decide).collect()
}

fn last(permits: &[Permit]) -> (Outcome, UnsafeCause) {
    permits.last().map(|permit| (permit.outcome, permit.unsafe_cause)).expect("some")
}

const WAITS: (Outcome, UnsafeCause) = (Outcome::AllUnsafe, UnsafeCause::LowStepDown);

#[test]
fn a_low_step_is_taken_on_a_new_cue_forward_and_on_no_other() {
    let mut core = ready();
    let waits = decides(&mut core, 2..8, (CueKind::Forward, 7), 0.09);
    assert_eq!(last(&waits), WAITS);
    let told = waits.last().expect("some");
    assert!((told.step_m + 0.09).abs() < 0.01 && (0.6..0.85).contains(&told.place_x_m), "{told:?}");
    assert_eq!(last(&decides(&mut core, 8..30, (CueKind::Forward, 7), 0.09)), WAITS, "the same cue");
    decides(&mut core, 30..32, (CueKind::Stop, 8), 0.09);
    assert_eq!(
        last(&decides(&mut core, 32..34, (CueKind::Forward, 9), 0.09)),
        WAITS,
        "a cue after a stop brings it there"
    );
    assert_eq!(
        last(&decides(&mut core, 34..40, (CueKind::Forward, 10), 0.09)),
        WAITS,
        "it had waited for half a second"
    );
    let taken = decides(&mut core, 40..41, (CueKind::Forward, 11), 0.09);
    assert_eq!(last(&taken), (Outcome::Granted, UnsafeCause::None));
}

/// Decisions up to one that is granted over the step.
fn over_the_step() -> Core {
    let mut core = ready();
    assert_eq!(last(&decides(&mut core, 2..8, (CueKind::Forward, 7), 0.09)), WAITS);
    let over = decides(&mut core, 8..9, (CueKind::Forward, 8), 0.09);
    assert_eq!(last(&over), (Outcome::Granted, UnsafeCause::None));
    core
}

#[test]
fn any_other_cue_a_fault_and_a_lock_end_what_the_handler_allowed() {
    let left = CueInForce { valid: true, cue: Cue { header: header(4_600, 9), kind: CueKind::Left, ..Cue::default() } };
    let forward = CueInForce { cue: Cue { kind: CueKind::Forward, ..left.cue }, ..left };
    // A stop leaves no cue in force.
    let stop = CueInForce::default();
    for (cue, class) in [
        (stop, ModeClass::Run),
        (left, ModeClass::Run),
        (forward, ModeClass::Lock),
        (stop, ModeClass::Lock),
        (stop, ModeClass::Fault),
    ] {
        let mut core = over_the_step();
        core.take_mode(&Mode { cue, ..mode(class, 4_600) });
        assert_eq!(last(&decides(&mut core, 10..11, (CueKind::Forward, 10), 0.09)), WAITS, "{cue:?}, {class:?}");
    }
    let mut core = over_the_step();
    assert_eq!(last(&decides(&mut core, 9..10, (CueKind::Forward, 8), 0.09)), (Outcome::Granted, UnsafeCause::None));
}

/// The robot waits at the step, and then asks the handler to come behind it.
#[test]
fn a_forward_that_answers_another_question_takes_no_step() {
    let mut core = ready();
    assert_eq!(last(&decides(&mut core, 2..8, (CueKind::Forward, 7), 0.09)), WAITS);
    let asked = decides_in(Formation::Behind, &mut core, 8..12, (CueKind::Forward, 7), 0.09);
    assert_eq!(last(&asked).0, Outcome::Narrow);
    assert_eq!(last(&decides(&mut core, 12..13, (CueKind::Forward, 8), 0.09)), WAITS);
}

#[test]
fn a_wait_of_which_no_decision_tells_is_not_told_to_the_handler() {
    let mut core = ready();
    let waits = decides(&mut core, 2..8, (CueKind::Forward, 7), 0.09);
    let begun = 2 + waits.iter().position(|permit| permit.outcome == Outcome::AllUnsafe).expect("it waits") as u64;
    let mut core = ready();
    decides(&mut core, 2..begun + 1, (CueKind::Forward, 7), 0.09);
    // No decision comes for two seconds.
    assert_eq!(last(&decides(&mut core, begun + 5..begun + 6, (CueKind::Forward, 8), 0.09)), WAITS);
}

#[test]
fn a_cue_that_comes_before_the_handler_was_told_takes_no_step() {
    let mut core = ready();
    let first = decides(&mut core, 2..5, (CueKind::Forward, 7), 0.09);
    let begun = first.iter().position(|permit| permit.outcome == Outcome::AllUnsafe).expect("it waits");
    assert!(begun > 0, "two frames have to show it");
    let soon = decides(&mut core, 5..6, (CueKind::Forward, 8), 0.09);
    assert_eq!(last(&soon), WAITS);
}

#[test]
fn a_cue_that_was_spoken_before_the_handler_was_told_takes_no_step_however_late_it_comes() {
    let mut core = ready();
    decides(&mut core, 2..5, (CueKind::Forward, 7), 0.09);
    let spoken = Cue { header: header(1_600, 8), kind: CueKind::Forward, ..Cue::default() };
    core.take_mode(&Mode { cue: CueInForce { valid: true, cue: spoken }, ..mode(ModeClass::Run, 5_490) });
    assert_eq!(last(&decides(&mut core, 11..12, (CueKind::Forward, 8), 0.09)), WAITS);
}

#[test]
fn a_deep_step_is_taken_on_no_cue() {
    let mut core = ready();
    for seq in 7..12 {
        let from = 2 + 5 * (seq - 7);
        let permits = decides(&mut core, from..from + 5, (CueKind::Forward, seq), 0.3);
        assert_eq!(last(&permits), (Outcome::AllUnsafe, UnsafeCause::DropOff));
    }
}
