//! Cues are answered, and nobody waits for the robot's voice.

use super::{Bench, MS};
use crate::machine::{Action, Event, Machine, Phase};
use crate::plan::Plan;
use messages::{Cue, CueAnswer, CueKind, CueRefusal, Header, ModeClass, ServiceId, StopKind, TopicId};
use settings::Settings;
use transport::ClockKind;

/// The answers so far, and what lacks for each.
fn answers(bench: &Bench) -> Vec<CueAnswer> {
    let answer = |action: &Action| if let Action::Answer(answer) = action { Some(*answer) } else { None };
    bench.actions.iter().filter_map(answer).collect()
}

#[test]
fn every_cue_is_answered_and_a_refusal_names_what_lacks() {
    let mut bench = Bench::up(ClockKind::Real);
    bench.pass(2000);
    let asked = |bench: &mut Bench, kind: CueKind, age_ms: u64| {
        bench.cue(kind, age_ms);
        *answers(bench).last().expect("it is answered")
    };
    assert_eq!(asked(&mut bench, CueKind::Forward, 1500).refusal, CueRefusal::TooOld);
    let accepted = asked(&mut bench, CueKind::Forward, 0);
    assert_eq!((accepted.refusal, accepted.kind, accepted.cue_seq), (CueRefusal::None, CueKind::Forward, 2));
    bench.now_ms += 1;
    assert_eq!(asked(&mut bench, CueKind::Stop, 0).refusal, CueRefusal::None);
    bench.die(ServiceId::Lidar);
    bench.now_ms += 1;
    let refused = asked(&mut bench, CueKind::Left, 0);
    assert_eq!((refused.refusal, refused.reason.service), (CueRefusal::ServiceNotUp, ServiceId::Lidar));
    bench.pass(1000);
    bench.silence(ServiceId::Shield);
    bench.now_ms += 125;
    let refused = asked(&mut bench, CueKind::Left, 0);
    assert_eq!(refused.refusal, CueRefusal::ServiceSilent, "{refused:?}");
    bench.handle(Event::OperatorStop);
    bench.now_ms += 1;
    let refused = asked(&mut bench, CueKind::Left, 0);
    assert_eq!((refused.refusal, refused.reason.kind), (CueRefusal::Locked, StopKind::OperatorStop));
    assert_eq!(refused.reason.topic, TopicId::None);
}

#[test]
fn a_stop_counts_though_it_is_older_than_the_cue_in_force_and_a_direction_is_too_old() {
    let mut bench = Bench::running();
    bench.pass(100);
    bench.cue(CueKind::Left, 0);
    bench.cue(CueKind::Right, 50);
    assert_eq!(bench.machine.mode().cue.cue.kind, CueKind::Left);
    let newest = |bench: &Bench| answers(bench).last().map(|answer| (answer.kind, answer.refusal));
    assert_eq!(newest(&bench), Some((CueKind::Right, CueRefusal::TooOld)));
    bench.cue(CueKind::Stop, 50);
    assert!(!bench.machine.mode().cue.valid);
    assert_eq!(newest(&bench), Some((CueKind::Stop, CueRefusal::None)));
    // The stop makes none younger that was too old.
    bench.cue(CueKind::Right, 20);
    assert!(!bench.machine.mode().cue.valid);
}

#[test]
fn a_cue_from_nobody_knows_where_is_refused() {
    let mut bench = Bench::up(ClockKind::Real);
    let header = Header { stamp_ns: bench.now_ms * MS, seq: 1, incarnation: 1, ..Header::default() };
    bench.handle(Event::Cue(&Cue { header, kind: CueKind::Forward, ..Cue::default() }));
    assert_eq!(bench.class(), ModeClass::Fault);
    assert_eq!(answers(&bench).last().map(|answer| answer.refusal), Some(CueRefusal::Unusable));
}

fn speaking(clock: ClockKind) -> Bench {
    let mut settings = Settings::default();
    settings.speak.on = true;
    Bench { machine: Machine::new(Plan::of(&settings, clock)), ..Bench::new(clock) }
}

fn speak(bench: &Bench) -> Option<(Phase, u32)> {
    let services = bench.machine.status(bench.now_ms * MS);
    services.iter().find(|s| s.service == ServiceId::Speak).map(|s| (s.phase, s.restarts))
}

#[test]
fn a_voice_that_dies_again_and_again_neither_keeps_the_run_from_beginning_nor_stops_it() {
    let mut bench = speaking(ClockKind::Real);
    for _ in 0..40 {
        bench.pass(400);
        bench.die(ServiceId::Speak);
    }
    assert!(bench.machine.has_begun(), "{:?}", bench.machine.not_ready(bench.now()));
    bench.cue(CueKind::Forward, 0);
    assert_eq!((bench.class(), bench.noted("speak died too often")), (ModeClass::Run, true));
    assert!(!bench.actions.iter().any(|action| matches!(action, Action::EndRun(_))));
    assert!(speak(&bench).is_some_and(|(phase, _)| phase == Phase::Spent));
    // The operator's resume gives it another chance.
    bench.handle(Event::OperatorStop);
    bench.handle(Event::OperatorResume);
    bench.pass(400);
    assert!(speak(&bench).is_some_and(|(phase, _)| phase == Phase::Ready));
}

#[test]
fn a_voice_comes_back_while_others_are_down_and_a_silent_one_is_replaced() {
    let mut bench = speaking(ClockKind::Real);
    bench.pass(400);
    bench.die(ServiceId::Locomotion);
    bench.die(ServiceId::Speak);
    let now = bench.now();
    bench.machine.tick_starts(crate::machine::Now { wall_ns: now.wall_ns + 25 * MS, ..now });
    bench.act();
    assert!(bench.actions.contains(&Action::Spawn(ServiceId::Speak, 2)), "{:?}", bench.actions);
    bench.pass(1000);
    bench.silence(ServiceId::Speak);
    bench.pass(2500);
    assert!(bench.actions.contains(&Action::Kill(ServiceId::Speak, 2)));
    assert_ne!(bench.reason(), StopKind::BeatsMissed, "that stops nobody");
}

#[test]
fn in_stepped_time_there_is_no_voice() {
    assert_eq!(speak(&speaking(super::STEPPED)), None);
}
