//! The handler comes behind the robot where they are asked to, and agrees by *forward* alone.

use super::{Bench, MS};
use crate::plan::Plan;
use messages::{CueKind, Formation, Header, LocomotionState, ModeClass, ServiceId, StopKind, StopReason, Twist2};
use settings::Settings;
use transport::ClockKind;

use crate::machine::{Event, Machine};

/// A run of a robot that speaks, or does not, under a cue *forward*.
fn running(speaks: bool) -> Bench {
    let mut settings = Settings::default();
    settings.speak.on = speaks;
    let machine = Machine::new(Plan::of(&settings, ClockKind::Real));
    let mut bench = Bench { machine, ..Bench::new(ClockKind::Real) };
    bench.pass(2000);
    bench.cue(CueKind::Forward, 0);
    assert!(bench.machine.mode().cue.valid);
    bench
}

/// Locomotion stands for so long for that reason.
fn stands(bench: &mut Bench, kind: StopKind, ms: u64) {
    tells(bench, LocomotionState { limited_by: StopReason::of(kind), ..LocomotionState::default() }, ms);
}

fn tells(bench: &mut Bench, state: LocomotionState, ms: u64) {
    for _ in 0..ms / 100 {
        bench.pass(100);
        let header = Header { stamp_ns: bench.now_ms * MS, ..Header::default() };
        let state = LocomotionState { header, epoch: bench.machine.mode().epoch, ..state };
        bench.handle(Event::Locomotion(&state));
    }
}

/// The formation in force, and the one that the handler is asked for.
fn formations(bench: &Bench) -> (Formation, Formation) {
    (bench.machine.mode().formation, bench.machine.mode().formation_asked)
}

const BESIDE: (Formation, Formation) = (Formation::Beside, Formation::Beside);
const BEHIND: (Formation, Formation) = (Formation::Behind, Formation::Behind);

#[test]
fn a_handler_who_was_asked_to_come_behind_agrees_by_forward() {
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 1500);
    assert_eq!(formations(&bench), BESIDE, "the voice has not said it yet");
    stands(&mut bench, StopKind::Narrow, 1000);
    assert_eq!(formations(&bench), (Formation::Beside, Formation::Behind));
    // Between two permits another reason may show.
    stands(&mut bench, StopKind::NoPermit, 100);
    assert_eq!(formations(&bench), (Formation::Beside, Formation::Behind));
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BEHIND);
    stands(&mut bench, StopKind::Wide, 2500);
    assert_eq!(formations(&bench), (Formation::Behind, Formation::Beside));
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE);
}

#[test]
fn neither_an_early_forward_nor_another_cue_nor_a_robot_without_a_voice_changes_the_formation() {
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 1500);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE);
    for cue in [CueKind::Left, CueKind::Stop] {
        let mut bench = running(true);
        stands(&mut bench, StopKind::Narrow, 3000);
        bench.cue(cue, 0);
        assert_eq!(formations(&bench), BESIDE, "{cue:?}");
    }
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    let applied = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
    tells(&mut bench, LocomotionState { applied, ..LocomotionState::default() }, 100);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE, "the robot went on");
    let mut bench = running(false);
    stands(&mut bench, StopKind::Narrow, 60_000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE, "nobody was asked");
}

#[test]
fn a_fault_keeps_the_formation_and_a_handler_who_is_missed_behind_says_forward_from_beside() {
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    bench.cue(CueKind::Forward, 0);
    bench.die(ServiceId::Policy);
    assert_eq!(formations(&bench), BEHIND);
    bench.pass(2000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BEHIND);
    stands(&mut bench, StopKind::HandlerNotSeen, 1000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BEHIND, "they may still be on their way");
    stands(&mut bench, StopKind::HandlerNotSeen, 11_000);
    assert_eq!(formations(&bench), BEHIND);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE);
}

#[test]
fn a_forward_that_answers_something_else_changes_no_formation() {
    // After each change the handler is missed for a moment.
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    bench.cue(CueKind::Forward, 0);
    stands(&mut bench, StopKind::HandlerNotSeen, 2000);
    stands(&mut bench, StopKind::AllUnsafe, 20_000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BEHIND);
    // The voice told of something else meanwhile, and tells the question anew.
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 500);
    stands(&mut bench, StopKind::NoFloor, 3000);
    assert_eq!(formations(&bench), BESIDE);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE);
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    stands(&mut bench, StopKind::NoFloor, 1000);
    assert_eq!(formations(&bench), BESIDE, "it is over");
}

#[test]
fn a_state_of_before_a_cue_brings_no_question_back() {
    for cue in [CueKind::Left, CueKind::Stop, CueKind::Forward] {
        let mut bench = running(true);
        stands(&mut bench, StopKind::Narrow, 1500);
        bench.cue(cue, 0);
        let header = Header { stamp_ns: (bench.now_ms + 10) * MS, ..Header::default() };
        let limited_by = StopReason::of(StopKind::Narrow);
        let epoch = bench.machine.mode().epoch;
        bench.handle(Event::Locomotion(&LocomotionState { header, epoch, limited_by, ..LocomotionState::default() }));
        stands(&mut bench, StopKind::AllUnsafe, 5000);
        bench.cue(CueKind::Forward, 0);
        assert_eq!(formations(&bench), BESIDE, "{cue:?}");
    }
}

#[test]
fn a_shield_that_dies_while_the_handler_is_behind_leaves_them_there() {
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    bench.cue(CueKind::Forward, 0);
    bench.die(ServiceId::Shield);
    assert_eq!((bench.class(), formations(&bench)), (ModeClass::Fault, BEHIND));
    bench.pass(2000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!((bench.class(), formations(&bench)), (ModeClass::Run, BEHIND), "its next life finds it so");
    // Until it has seen the handler there it says so, which is no question.
    stands(&mut bench, StopKind::HandlerNotSeen, 1500);
    assert_eq!(formations(&bench), BEHIND);
}

/// A policy swapped in does not know what the one before has asked.
#[test]
fn a_question_lapses_where_the_policy_that_asked_is_swapped_for_one_that_does_not() {
    let mut bench = running(true);
    stands(&mut bench, StopKind::Narrow, 3000);
    assert_eq!(formations(&bench), (Formation::Beside, Formation::Behind));
    stands(&mut bench, StopKind::PolicyStop, 500);
    assert_eq!(formations(&bench), BESIDE);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE, "a forward that comes late answers nothing");
    // The new one finds the place narrow, too, and the handler is asked anew.
    stands(&mut bench, StopKind::Narrow, 1500);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BESIDE, "the voice has not said it yet");
    stands(&mut bench, StopKind::Narrow, 3000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(formations(&bench), BEHIND);
}
