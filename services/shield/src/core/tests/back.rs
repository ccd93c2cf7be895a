//! The robot steps back once the handler has been told.

use super::{MS, action, depth_header, header, mode, odometry, open_scan, scan_header, wall_mm};
use crate::core::{Core, CoreConfig};
use guidance::ActionTable;
use messages::{Attitude, Cue, CueInForce, CueKind, Mode, ModeClass, Odometry, Outcome, Permit, PolicyAction};
use settings::Settings;

/// What a policy wants with the table that has a step back.
fn wants(decision: u64, name: &str) -> PolicyAction {
    let table = ActionTable::nine();
    let index = table.index_of(name).expect("an action");
    let mut action = PolicyAction {
        header: header(decision * 500, decision),
        action_table_id: table.id(),
        action_count: table.len() as u32,
        ..action(decision, 0)
    };
    action.probabilities = Default::default();
    action.probabilities[index] = 1.0;
    action
}

/// A core of a robot that speaks and has come 2 m over floor that its camera saw.
fn walked() -> Core {
    let mut settings = Settings::default();
    settings.speak.on = true;
    walked_with(&settings)
}

fn walked_with(settings: &Settings) -> Core {
    let mut core = Core::new(CoreConfig::of(settings, ActionTable::nine()).expect("a harness"));
    for decision in 2..10 {
        decides(&mut core, decision, 0.25 * (decision - 1) as f64, "forward");
    }
    core
}

fn decides(core: &mut Core, decision: u64, x_m: f64, name: &str) -> Permit {
    comes(core, decision, x_m, name);
    core.on_action(500 * decision * MS, &wants(decision, name)).expect("the active policy's")
}

/// The robot comes to where that decision is made.
fn comes(core: &mut Core, decision: u64, x_m: f64, name: &str) {
    let ms = 500 * decision;
    // A scan and a frame each tenth of a second, on the way there.
    for before_ms in [410, 310, 210, 110, 10] {
        let stamp = ms - before_ms;
        let attitude = Attitude::at_height(stamp * MS, 0.0, 0.0, 0.3);
        let step_m = if name == "forward" { 0.5e-3 * before_ms as f64 } else { 0.0 };
        core.take_mode(&mode(ModeClass::Run, stamp));
        core.take_odometry(&Odometry { attitude, ..odometry(stamp, x_m - step_m) });
        core.take_depth(&depth_header(stamp), &wall_mm(5000 - (stamp / 100 % 7) as u16));
        // No two scans and frames are the same.
        let ranges: Vec<f32> = open_scan().iter().map(|range_m| range_m * (1.0 + stamp as f32 * 1e-7)).collect();
        core.on_scan((stamp + 10) * MS, &scan_header(stamp), &ranges);
    }
}

#[test]
fn a_robot_that_does_not_speak_makes_none() {
    let mut core = walked_with(&Settings::default());
    let permits = (10..60).map(|decision| decides(&mut core, decision, 2.0, "step_back").outcome);
    assert!(permits.collect::<Vec<_>>().iter().all(|outcome| *outcome == Outcome::StepsBack));
}

/// The decision of a new cue comes before the next scan.
#[test]
fn a_new_cue_begins_the_wait_anew() {
    let outcome = |seq: u64| {
        let mut core = walked();
        let mut decision = 10;
        while decides(&mut core, decision, 2.0, "step_back").outcome == Outcome::StepsBack {
            decision += 1;
        }
        // Once more, up to the decision that steps back.
        let mut core = walked();
        (10..decision).for_each(|decision| {
            decides(&mut core, decision, 2.0, "step_back");
        });
        comes(&mut core, decision, 2.0, "step_back");
        let ms = 500 * decision;
        let cue = Cue { header: header(ms - 5, seq), kind: CueKind::Forward, ..Cue::default() };
        core.take_mode(&Mode { cue: CueInForce { valid: true, cue }, ..mode(ModeClass::Run, ms - 5) });
        let wanted = PolicyAction { cue_seq: seq, ..wants(decision, "step_back") };
        core.on_action(ms * MS, &wanted).expect("the active policy's").outcome
    };
    assert_eq!((outcome(7), outcome(8)), (Outcome::Granted, Outcome::StepsBack));
}

#[test]
fn each_step_back_waits_until_the_handler_has_been_told() {
    let mut core = walked();
    let outcomes = |core: &mut Core, decisions: std::ops::Range<u64>| {
        let permits = decisions.map(|decision| decides(core, decision, 2.0, "step_back"));
        permits.map(|permit| (permit.outcome, permit.velocity.vx_mps < 0.0)).collect::<Vec<_>>()
    };
    let (waits, steps) = ((Outcome::StepsBack, false), (Outcome::Granted, true));
    let told = outcomes(&mut core, 10..20);
    let waited = told.iter().position(|told| *told == steps).unwrap_or_else(|| panic!("{told:?}"));
    assert!(told[..waited].iter().all(|told| *told == waits) && waited >= 2, "{told:?}");
    // The next one is told anew, and so is one after something else.
    assert_eq!(told[waited + 1], waits, "{told:?}");
    let mut core = walked();
    outcomes(&mut core, 10..10 + waited as u64);
    decides(&mut core, 10 + waited as u64, 2.0, "turn_left");
    assert_eq!(outcomes(&mut core, 11 + waited as u64..12 + waited as u64), [waits]);
    // The handler is told of a lock meanwhile.
    let mut core = walked();
    outcomes(&mut core, 10..10 + waited as u64);
    let ms = 500 * (9 + waited as u64);
    core.take_mode(&mode(ModeClass::Lock, ms + 20));
    core.on_scan((ms + 20) * MS, &scan_header(ms + 15), &open_scan());
    assert_eq!(outcomes(&mut core, 10 + waited as u64..11 + waited as u64), [waits]);
}
