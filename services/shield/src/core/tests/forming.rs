//! Where the handler walks: a policy asks for it, a cue agrees, and the shield waits until they are seen there.

use super::{MS, action, depth_header, header, mode, odometry, ready, scan_header, scan_of, wall_mm};
use crate::core::{Core, CoreConfig};
use guidance::ActionTable;
use messages::{Cue, CueInForce, CueKind, Formation, Header, Mode, ModeClass, Outcome, Permit, PolicyAction};
use settings::Settings;

/// Where the handler walks behind the robot (robot frame).
const BEHIND: (f64, f64) = (-1.2, 0.0);

/// A policy that wants to go ahead with the handler there.
fn wants(decision: u64, formation: Formation) -> PolicyAction {
    PolicyAction { formation, ..action(decision, 1) }
}

/// Half a second passes in that formation, with a handler there; then the policy decides.
fn decides(core: &mut Core, decision: u64, mode: Mode, wanted: Formation, handler: (f64, f64)) -> Outcome {
    permit(core, mode, &wants(decision, wanted), handler).outcome
}

/// The same for a decision that is given: the permit.
fn permit(core: &mut Core, mode: Mode, action: &PolicyAction, handler: (f64, f64)) -> Permit {
    let ms = 500 * action.decision;
    for stamp in [410, 310, 210, 110, 10].map(|before_ms| ms - before_ms) {
        core.take_mode(&Mode { header: header(stamp, 1), ..mode });
        core.take_odometry(&odometry(stamp, 0.0));
        core.take_depth(&depth_header(stamp), &wall_mm(5000 - (stamp / 100 % 7) as u16));
        core.on_scan((stamp + 10) * MS, &scan_header(stamp), &scan_of(handler));
    }
    core.on_action(ms * MS, action).expect("the active policy's")
}

fn in_formation(formation: Formation) -> Mode {
    Mode { formation, ..mode(ModeClass::Run, 0) }
}

#[test]
fn a_robot_that_asks_the_handler_to_come_behind_stands_though_nobody_is_beside_it() {
    let (mut core, beside) = (ready(), super::handler_place());
    let asks =
        |core: &mut Core, decision, at| decides(core, decision, in_formation(Formation::Beside), Formation::Behind, at);
    assert_eq!(asks(&mut core, 3, beside), Outcome::Narrow);
    for decision in 4..12 {
        assert_eq!(asks(&mut core, decision, BEHIND), Outcome::Narrow, "{decision}");
    }
    // They do not come back beside it; the policy goes on as if.
    let goes_on = decides(&mut core, 12, in_formation(Formation::Beside), Formation::Beside, BEHIND);
    assert_eq!(goes_on, Outcome::HandlerNotSeen);
}

#[test]
fn in_single_file_nothing_moves_until_the_handler_is_seen_behind() {
    let (mut core, behind) = (ready(), in_formation(Formation::Behind));
    for decision in 3..9 {
        let outcome = decides(&mut core, decision, behind, Formation::Behind, super::handler_place());
        assert_eq!(outcome, Outcome::HandlerNotSeen, "{decision}");
    }
    let outcomes = (9..15).map(|decision| decides(&mut core, decision, behind, Formation::Behind, BEHIND));
    let outcomes: Vec<_> = outcomes.collect();
    // After a second.
    assert_eq!(outcomes[..2], [Outcome::HandlerNotSeen; 2], "{outcomes:?}");
    assert_eq!(outcomes[3..], [Outcome::Granted; 3], "{outcomes:?}");
    assert_eq!(decides(&mut core, 15, behind, Formation::Beside, BEHIND), Outcome::Wide);
}

#[test]
fn a_turn_asks_for_nothing() {
    let mut core = ready();
    let cue = Cue { header: header(0, 7), kind: CueKind::Left, ..Cue::default() };
    let left = Mode { cue: CueInForce { valid: true, cue }, ..in_formation(Formation::Beside) };
    let outcome = decides(&mut core, 3, left, Formation::Behind, super::handler_place());
    assert_eq!(outcome, Outcome::Granted);
}

#[test]
fn in_single_file_the_robot_walks_slower_and_beside_the_handler_as_before() {
    let mut core = ready();
    for (formation, from, handler, vx_mps) in
        [(Formation::Behind, 3, BEHIND, 0.25), (Formation::Beside, 20, super::handler_place(), 0.5)]
    {
        let permits =
            (from..from + 8).map(|n| permit(&mut core, in_formation(formation), &wants(n, formation), handler));
        let last = permits.last().expect("eight");
        assert_eq!((last.outcome, last.velocity.vx_mps), (Outcome::Granted, vx_mps), "{formation:?}");
    }
}

/// A shield that has just started, and knows nothing.
fn started() -> Core {
    Core::new(CoreConfig::of(&Settings::default(), ActionTable::eight()).expect("a harness"))
}

#[test]
fn a_shield_that_restarts_while_the_handler_is_behind_lets_nothing_move_until_it_has_seen_them_there() {
    let (behind, wanted) = (in_formation(Formation::Behind), Formation::Behind);
    // They are there all the time. Half a second is not enough.
    let mut core = started();
    let outcomes: Vec<_> = (3..8).map(|decision| decides(&mut core, decision, behind, wanted, BEHIND)).collect();
    assert_eq!(outcomes[0], Outcome::HandlerNotSeen, "{outcomes:?}");
    assert_eq!(outcomes[3..], [Outcome::Granted; 2], "{outcomes:?}");
    // They have come beside it meanwhile: that is not where the supervisor says that they walk.
    let mut core = started();
    for decision in 3..12 {
        let outcome = decides(&mut core, decision, behind, wanted, super::handler_place());
        assert_eq!(outcome, Outcome::HandlerNotSeen, "{decision}");
    }
}

#[test]
fn where_the_policy_that_asked_is_swapped_nothing_moves_without_the_handler_in_their_place() {
    let beside = in_formation(Formation::Beside);
    let mut core = ready();
    assert_eq!(decides(&mut core, 3, beside, Formation::Behind, super::handler_place()), Outcome::Narrow);
    // The handler is on the way behind, and the new policy asks for nothing.
    let swapped = Mode { active_policy: 2, ..beside };
    let of_new = |decision: u64| {
        let action = wants(decision, Formation::Beside);
        PolicyAction { header: Header { incarnation: 2, ..action.header }, ..action }
    };
    let outcomes: Vec<_> =
        (4..10).map(|decision| permit(&mut core, swapped, &of_new(decision), BEHIND).outcome).collect();
    assert_eq!(outcomes[3..], [Outcome::HandlerNotSeen; 3], "{outcomes:?}");
    let back = (10..15).map(|decision| permit(&mut core, swapped, &of_new(decision), super::handler_place()).outcome);
    assert_eq!(back.last(), Some(Outcome::Granted));
}
