use messages::{
    Cue, CueAnswer, CueHeard, CueInForce, CueKind, CueRefusal, CueSource, Formation, Header, LocomotionState, Mode,
    ModeClass, Odometry, Outcome, Permit, Pose2, ServiceId, StopKind, StopReason, Twist2, Urgency,
};
use settings::{Settings, Verbosity};

use super::{Speaker, SpeakerConfig};
use crate::Language;

const MS: u64 = 1_000_000;

/// A speaker with a handler who listens; a sentence takes 1.5 s.
struct Bench {
    speaker: Speaker,
    language: Language,
    now_ms: u64,
    mode: Mode,
    /// When the sentence that is being said is over, milliseconds.
    ends_ms: Option<u64>,
    /// What was begun, and when, milliseconds.
    heard: Vec<(u64, String)>,
}

impl Bench {
    fn new(verbosity: Verbosity) -> Self {
        let config = SpeakerConfig { verbosity, ..SpeakerConfig::of(&Settings::default()) };
        Self {
            speaker: Speaker::new(config),
            language: Language::english().expect("built in"),
            now_ms: 1000,
            mode: Mode { epoch: 1, active_policy: 1, reason: StopReason::of(StopKind::Boot), ..Mode::default() },
            ends_ms: None,
            heard: Vec::new(),
        }
    }

    /// In run, with a forward cue in force, and nothing more to say.
    fn running() -> Self {
        let mut bench = Self::new(Verbosity::Normal);
        bench.tell_mode();
        bench.run(CueKind::Forward);
        bench.pass(3000, &[]);
        bench.heard.clear();
        bench
    }

    /// The handler was heard to say what would start the robot.
    fn hears(&mut self) {
        let header = Header { stamp_ns: self.now_ms * MS, ..Header::default() };
        self.speaker.heard(&CueHeard { header, kind: CueKind::Forward, confidence: 0.9 }, self.now_ms * MS);
    }

    fn tell_mode(&mut self) {
        self.mode.header.stamp_ns = self.now_ms * MS;
        self.speaker.mode(&self.mode, self.now_ms * MS);
    }

    fn run(&mut self, kind: CueKind) {
        self.mode.class = ModeClass::Run;
        self.mode.ready_for_cue = true;
        let header = Header { seq: self.now_ms, incarnation: 1, ..Header::default() };
        let cue = Cue { header, kind, odometry_incarnation: 1, ..Cue::default() };
        self.mode.cue = CueInForce { valid: true, cue };
        self.tell_mode();
    }

    fn stop(&mut self, class: ModeClass, reason: StopReason) {
        self.mode = Mode { class, reason, epoch: self.mode.epoch + 1, active_policy: 1, ..Mode::default() };
        self.tell_mode();
    }

    fn dies(&mut self, service: ServiceId) {
        self.stop(ModeClass::Fault, StopReason::service(StopKind::ServiceDied, service, 1));
    }

    /// Time passes in ticks of 50 ms, with the mode and states of locomotion that stands for these reasons in turn (it
    /// goes where there is none).
    fn pass(&mut self, ms: u64, held: &[StopKind]) {
        let end = self.now_ms + ms;
        let mut tick = 0;
        while self.now_ms < end {
            self.now_ms += 50;
            self.tell_mode();
            let kind = if held.is_empty() { StopKind::None } else { held[tick % held.len()] };
            let vx_mps = if kind == StopKind::None { 0.5 } else { 0.0 };
            let state = LocomotionState {
                header: Header { stamp_ns: self.now_ms * MS, ..Header::default() },
                limited_by: StopReason::of(kind),
                applied: Twist2 { vx_mps, ..Twist2::ZERO },
                epoch: self.mode.epoch,
                ..LocomotionState::default()
            };
            self.speaker.state(&state, self.now_ms * MS);
            self.listen();
            tick += 1;
        }
    }

    /// Whether something is begun.
    fn listen(&mut self) -> bool {
        if self.ends_ms.take_if(|ends_ms| self.now_ms >= *ends_ms).is_some() {
            self.speaker.finished();
        }
        let next = self.speaker.next(self.now_ms * MS);
        self.heard.extend(next.map(|utterance| (self.now_ms, self.language.text(&utterance.sentence))));
        if next.is_some() {
            self.ends_ms = Some(self.now_ms + 1500);
        }
        next.is_some()
    }

    fn texts(&self) -> Vec<&str> {
        self.heard.iter().map(|(_, text)| text.as_str()).collect()
    }

    fn refuses(&mut self, refusal: CueRefusal, reason: StopReason) {
        let kind = CueKind::Left;
        self.speaker.answer(&CueAnswer { kind, refusal, reason, ..CueAnswer::default() }, self.now_ms * MS);
    }
}

#[test]
fn a_stop_is_told_at_once_and_cuts_short_whatever_is_said() {
    let mut bench = Bench::running();
    bench.speaker.answer(&CueAnswer { kind: CueKind::Right, ..CueAnswer::default() }, bench.now_ms * MS);
    assert!(bench.listen());
    bench.dies(ServiceId::Lidar);
    assert!(bench.listen(), "the cue's answer is cut short");
    bench.now_ms += 300;
    bench.stop(ModeClass::Lock, StopReason::of(StopKind::EmergencyStop));
    assert!(bench.listen(), "a lock cuts a fault short");
    assert_eq!(bench.texts(), ["Right.", "Stopped: lidar lost, restarting.", "Emergency stop."]);
}

#[test]
fn every_stop_out_of_run_is_told_the_same_reason_too() {
    let mut bench = Bench::running();
    for _ in 0..3 {
        bench.dies(ServiceId::Lidar);
        bench.pass(200, &[StopKind::ServiceDied]);
        bench.run(CueKind::Forward);
        bench.pass(100, &[]);
    }
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting."; 3]);
}

#[test]
fn reasons_within_a_stop_let_each_other_say_what_is_lost_and_the_same_is_told_once() {
    let mut bench = Bench::running();
    for service in [ServiceId::Lidar, ServiceId::Lidar, ServiceId::Policy, ServiceId::Lidar, ServiceId::Shield] {
        bench.dies(service);
        bench.pass(50, &[StopKind::ServiceDied]);
    }
    bench.pass(6000, &[StopKind::ServiceDied]);
    let names = ["lidar", "guide", "shield"].map(|name| format!("Stopped: {name} lost, restarting."));
    assert_eq!(bench.texts(), names);
    let apart: Vec<u64> = bench.heard.windows(2).map(|told| told[1].0 - told[0].0).collect();
    assert!(apart.iter().all(|ms| (800..=850).contains(ms)), "{apart:?}");
    // However many they are, only so many wait.
    bench.heard.clear();
    for service in ServiceId::ALL {
        bench.dies(service);
        bench.listen();
    }
    bench.pass(20_000, &[StopKind::ServiceDied]);
    assert_eq!(bench.heard.len(), 1 + super::STOPS_WAITING, "{:?}", bench.heard);
}

#[test]
fn what_is_over_is_not_told_and_gives_way() {
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    bench.listen();
    bench.dies(ServiceId::Policy);
    bench.run(CueKind::Forward);
    bench.speaker.answer(&CueAnswer { kind: CueKind::Forward, ..CueAnswer::default() }, bench.now_ms * MS);
    assert!(bench.listen(), "the stop's sentence is of the past");
    bench.pass(5000, &[]);
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting.", "Forward."]);
}

#[test]
fn a_lock_is_told_once_whatever_fails_within_it() {
    let mut bench = Bench::running();
    bench.stop(ModeClass::Lock, StopReason::of(StopKind::OperatorStop));
    bench.pass(8000, &[StopKind::OperatorStop]);
    bench.stop(ModeClass::Lock, StopReason::of(StopKind::OperatorStop));
    bench.pass(8000, &[StopKind::OperatorStop]);
    assert_eq!(bench.texts(), ["Stopped by the operator."]);
    bench.stop(ModeClass::Fault, StopReason::of(StopKind::Resumed));
    bench.mode.ready_for_cue = true;
    bench.pass(4000, &[StopKind::Resumed]);
    assert_eq!(bench.texts(), ["Stopped by the operator.", "Unlocked.", "Ready."]);
}

#[test]
fn ready_is_told_once_after_each_stop_and_after_it_was_not_ready() {
    let mut bench = Bench::new(Verbosity::Stops);
    bench.mode.ready_for_cue = true;
    bench.pass(5000, &[StopKind::Boot]);
    bench.mode.ready_for_cue = false;
    bench.pass(100, &[StopKind::Boot]);
    bench.mode.ready_for_cue = true;
    bench.pass(5000, &[StopKind::Boot]);
    assert_eq!(bench.texts(), ["Ready."], "a moment is none");
    bench.mode.ready_for_cue = false;
    bench.pass(1500, &[StopKind::Boot]);
    bench.mode.ready_for_cue = true;
    bench.pass(5000, &[StopKind::Boot]);
    assert_eq!(bench.texts(), ["Ready."; 2]);
}

#[test]
fn ready_that_had_to_wait_for_another_sentence_is_told_after_it() {
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    bench.mode.ready_for_cue = true;
    bench.pass(500, &[StopKind::ServiceDied]);
    bench.mode.ready_for_cue = false;
    bench.pass(100, &[StopKind::ServiceDied]);
    bench.mode.ready_for_cue = true;
    bench.pass(4000, &[StopKind::ServiceDied]);
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting.", "Ready."], "a moment while it waited");
}

#[test]
fn ready_that_could_not_be_heard_is_told_once_more_while_it_is_so() {
    for (stays_ready, times) in [(true, 2), (false, 1)] {
        let mut bench = Bench::new(Verbosity::Normal);
        bench.tell_mode();
        bench.mode.ready_for_cue = true;
        bench.pass(200, &[StopKind::Boot]);
        let mut told = 0;
        for _ in 0..200 {
            bench.now_ms += 50;
            bench.mode.ready_for_cue = stays_ready || told == 0;
            bench.tell_mode();
            if let Some(utterance) = bench.speaker.next(bench.now_ms * MS) {
                told += usize::from(bench.language.text(&utterance.sentence) == "Ready.");
                bench.speaker.unheard(&utterance, bench.now_ms * MS);
            }
        }
        assert_eq!(told, times, "ready all the time: {stays_ready}");
    }
}

#[test]
fn ready_is_told_however_long_other_sentences_take() {
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    bench.mode.ready_for_cue = true;
    assert!(bench.listen());
    bench.ends_ms = Some(bench.now_ms + 8000);
    bench.pass(10_000, &[StopKind::ServiceDied]);
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting.", "Ready."]);
}

#[test]
fn a_hold_is_told_when_it_lasts_and_again_while_it_does() {
    let mut bench = Bench::running();
    bench.pass(500, &[StopKind::AllUnsafe]);
    bench.pass(1000, &[]);
    assert_eq!(bench.texts(), [""; 0], "too short for words");
    let from_ms = bench.now_ms;
    bench.pass(21_000, &[StopKind::AllUnsafe]);
    let at: Vec<u64> = bench.heard.iter().map(|(at, _)| at - from_ms).collect();
    assert_eq!(bench.texts(), ["Waiting: way blocked."; 3]);
    assert!(at[0] <= 700 && at[1] >= 10_000 && at[2] >= 20_000, "{at:?}");
    bench.pass(1000, &[]);
    bench.pass(2000, &[StopKind::AllUnsafe]);
    assert_eq!(bench.heard.len(), 3, "it goes and holds again: no news");
}

#[test]
fn after_a_long_wait_the_handler_is_asked_for_another_way() {
    let mut bench = Bench::running();
    bench.pass(29_000, &[StopKind::AllUnsafe]);
    assert!(bench.texts().iter().all(|text| *text == "Waiting: way blocked."), "{:?}", bench.heard);
    bench.pass(4_000, &[StopKind::AllUnsafe, StopKind::RemainderUnsafe]);
    assert_eq!(bench.texts().last(), Some(&"Still blocked. Left, right, or wait?"), "{:?}", bench.heard);
    bench.pass(60_000, &[StopKind::AllUnsafe]);
    let asked = bench.texts().iter().filter(|text| text.starts_with("Still blocked")).count();
    assert!((5..9).contains(&asked), "{asked} times in a minute");
    // It is over: the next one begins anew.
    bench.pass(1_000, &[]);
    bench.pass(9_000, &[StopKind::AllUnsafe]);
    assert_eq!(bench.texts().last(), Some(&"Waiting: way blocked."), "{:?}", bench.heard);
}

#[test]
fn a_hold_whose_reason_changes_to_and_fro_is_told_seldom() {
    let mut bench = Bench::running();
    bench.pass(9000, &[StopKind::AllUnsafe, StopKind::RemainderUnsafe]);
    assert_eq!(bench.heard.len(), 1, "{:?}", bench.heard);
    bench.pass(1500, &[StopKind::HandlerNotSeen]);
    assert_eq!(bench.texts().last(), Some(&"Waiting: take the handle."));
}

/// The shield waits for 2.1 s before each step back, whatever was told before.
#[test]
fn each_step_back_is_told_before_it_is_made() {
    let mut bench = Bench::running();
    bench.pass(3000, &[StopKind::AllUnsafe]);
    for step in 1..=2 {
        bench.pass(2100, &[StopKind::StepBack]);
        bench.pass(500, &[]);
        let told = bench.texts().iter().filter(|text| **text == "Stepping back.").count();
        assert_eq!(told, step, "{:?}", bench.heard);
    }
    assert!(!bench.texts().contains(&"Going on."), "{:?}", bench.heard);
    // A cue comes in between, and the shield waits anew.
    for (for_ms, kind) in [(2100, StopKind::StepBack), (400, StopKind::NoPermit), (2100, StopKind::StepBack)] {
        bench.pass(for_ms, &[kind]);
    }
    assert_eq!(bench.texts().iter().filter(|text| **text == "Stepping back.").count(), 4, "{:?}", bench.heard);
}

/// The supervisor takes it that the handler knows after 2.1 s.
#[test]
fn a_handler_is_asked_to_come_behind_whatever_was_told_before() {
    let mut bench = Bench::running();
    bench.pass(3000, &[StopKind::AllUnsafe]);
    bench.pass(2100, &[StopKind::Narrow]);
    assert_eq!(bench.texts().last(), Some(&"Narrow. Behind me."), "{:?}", bench.heard);
    bench.pass(3000, &[]);
    bench.pass(2100, &[StopKind::Wide]);
    assert_eq!(bench.texts().last(), Some(&"Wide again. Beside me."), "{:?}", bench.heard);
}

#[test]
fn a_handler_who_is_missed_behind_the_robot_is_told_where_it_looks() {
    let mut bench = Bench::running();
    bench.mode.formation = Formation::Behind;
    bench.tell_mode();
    bench.pass(1500, &[StopKind::HandlerNotSeen]);
    assert_eq!(bench.texts(), ["Waiting: behind me."]);
    // They stand beside it and say forward, which is too early to change anything.
    bench.run(CueKind::Forward);
    bench.pass(21_000, &[StopKind::HandlerNotSeen]);
    let told = bench.texts().iter().filter(|text| **text == "Waiting: behind me.").count();
    assert!(told >= 3, "{:?}", bench.heard);
    // After 10 s it changes the formation.
    bench.mode.formation = Formation::Beside;
    bench.run(CueKind::Forward);
    bench.pass(9000, &[StopKind::HandlerNotSeen]);
    assert_eq!(bench.texts().last(), Some(&"Waiting: take the handle."), "{:?}", bench.heard);
}

#[test]
fn a_hold_that_is_over_leaves_nothing_to_say() {
    let mut bench = Bench::running();
    bench.pass(550, &[StopKind::AllUnsafe]);
    bench.dies(ServiceId::Shield);
    bench.pass(3000, &[StopKind::ServiceDied]);
    assert_eq!(bench.texts(), ["Stopped: shield lost, restarting."]);
}

#[test]
fn a_turn_that_is_not_found_is_told_once_the_way_says_so_and_one_that_is_blocked_by_the_shields_word() {
    let walked = |bench: &mut Bench, x_m: f64| {
        let header = Header { incarnation: 1, ..Header::default() };
        let odometry = Odometry { header, odom_from_robot: Pose2::new(x_m, 0.0, 0.0), ..Odometry::default() };
        bench.speaker.odometry(&odometry);
    };
    let stands = |kind: CueKind, way_m: f64, unsafe_mask: u32| {
        let mut bench = Bench::running();
        bench.run(kind);
        for dm in 0..=(way_m * 10.0) as u32 {
            walked(&mut bench, f64::from(dm) / 10.0);
        }
        bench.speaker.permit(&Permit { unsafe_mask, ..Permit::default() }, 0);
        bench.pass(1000, &[StopKind::PolicyStop]);
        bench.texts().last().map(|text| (*text).to_owned())
    };
    let said = |text: &str| Some(text.to_owned());
    // Of the eight actions 2, 4 and 6 lead to the left.
    assert_eq!(stands(CueKind::Left, 15.5, 0), said("No left turn here."));
    assert_eq!(stands(CueKind::Right, 15.5, 0), said("No right turn here."));
    assert_eq!(stands(CueKind::Left, 5.0, 0b0101_0100), said("Left is blocked."));
    assert_eq!(stands(CueKind::Left, 5.0, 0b0001_0100), said("Waiting: no way on."));
    assert_eq!(stands(CueKind::Right, 5.0, 0b1010_1000), said("Right is blocked."));
    assert_eq!(stands(CueKind::Forward, 20.0, u32::MAX), said("Waiting: no way on."));
}

#[test]
fn a_refusal_names_what_is_lacking_and_is_not_repeated_at_once() {
    let mut bench = Bench::new(Verbosity::Normal);
    bench.tell_mode();
    let lidar = StopReason::service(StopKind::None, ServiceId::Lidar, 0);
    bench.refuses(CueRefusal::ServiceNotUp, lidar);
    bench.listen();
    bench.now_ms += 500;
    bench.refuses(CueRefusal::ServiceNotUp, lidar);
    bench.pass(3000, &[StopKind::Boot]);
    bench.refuses(CueRefusal::ServiceNotUp, lidar);
    bench.pass(500, &[StopKind::Boot]);
    assert_eq!(bench.texts(), ["Not yet: lidar is starting."; 2]);
    let over = CueAnswer { refusal: CueRefusal::TurnOver, source: CueSource::TurnDone, ..CueAnswer::default() };
    bench.speaker.answer(&over, bench.now_ms * MS);
    assert!(!bench.listen(), "nobody said that");
}

#[test]
fn of_several_answers_that_wait_only_the_newest_is_told() {
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    bench.listen();
    for kind in [CueKind::Left, CueKind::Right, CueKind::Forward] {
        let reason = StopReason::default();
        bench
            .speaker
            .answer(&CueAnswer { kind, refusal: CueRefusal::None, reason, ..CueAnswer::default() }, bench.now_ms * MS);
    }
    bench.speaker.finished();
    bench.listen();
    bench.speaker.finished();
    assert!(!bench.listen());
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting.", "Forward."]);
}

#[test]
fn a_low_battery_is_told_now_and_then_and_one_garbled_state_is_not_believed() {
    let mut bench = Bench::running();
    let low = |bench: &Bench, charge_percent: u32| LocomotionState {
        header: Header { stamp_ns: bench.now_ms * MS, ..Header::default() },
        applied: Twist2 { vx_mps: 0.5, ..Twist2::ZERO },
        epoch: bench.mode.epoch,
        charge_percent,
        ..LocomotionState::default()
    };
    bench.speaker.state(&low(&bench, 3), bench.now_ms * MS);
    assert!(!bench.listen());
    for _ in 0..(400 * 50) {
        bench.now_ms += 20;
        bench.speaker.state(&low(&bench, 15), bench.now_ms * MS);
        if bench.listen() {
            bench.speaker.finished();
        }
    }
    assert_eq!(bench.texts(), ["Battery low."; 2]);
}

#[test]
fn each_verbosity_says_more() {
    let heard = |verbosity: Verbosity| {
        let mut bench = Bench::new(verbosity);
        bench.tell_mode();
        bench.pass(1800, &[StopKind::Boot]);
        bench.run(CueKind::Forward);
        bench.speaker.answer(&CueAnswer { kind: CueKind::Forward, ..CueAnswer::default() }, bench.now_ms * MS);
        bench.pass(3000, &[]);
        bench.mode.active_policy = 2;
        bench.pass(3000, &[]);
        bench.pass(2500, &[StopKind::AllUnsafe]);
        bench.pass(2000, &[]);
        bench.heard.into_iter().map(|(_, text)| text).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(heard(Verbosity::Stops), "Waiting: way blocked.");
    assert_eq!(heard(Verbosity::Normal), "Forward. Waiting: way blocked.");
    assert_eq!(heard(Verbosity::All), "Starting. Forward. New policy. Waiting: way blocked. Going on.");
}

#[test]
fn a_stop_is_about_the_modes_own_time_and_a_hold_about_its_beginning() {
    let mut bench = Bench::running();
    let from_ns = (bench.now_ms + 50) * MS;
    let mut told = None;
    for _ in 0..20 {
        bench.now_ms += 50;
        let state = LocomotionState {
            header: Header { stamp_ns: bench.now_ms * MS, ..Header::default() },
            limited_by: StopReason::of(StopKind::AllUnsafe),
            epoch: bench.mode.epoch,
            ..LocomotionState::default()
        };
        bench.speaker.state(&state, bench.now_ms * MS);
        told = told.or_else(|| bench.speaker.next(bench.now_ms * MS));
    }
    assert_eq!(told.map(|told| (told.about_ns, told.urgency)), Some((from_ns, Urgency::Hold)));
    bench.dies(ServiceId::Lidar);
    let stamp_ns = bench.now_ms * MS;
    bench.now_ms += 40;
    let told = bench.speaker.next(bench.now_ms * MS).expect("a stop");
    assert_eq!((told.about_ns, told.urgency), (stamp_ns, Urgency::Stop));
}

/// A robot that loses its mind: whatever comes, at most one sentence begins in 50 ms, and little waits.
#[test]
fn whatever_comes_little_waits() {
    let mut bench = Bench::new(Verbosity::All);
    let mut dice = messages::fault::Dice::new(7);
    for _ in 0..20_000 {
        bench.now_ms += 50;
        let roll = dice.bits();
        let info = &messages::stops::STOPS[(roll >> 8) as usize % messages::stops::STOPS.len()];
        let service = ServiceId::ALL[(roll >> 16) as usize % ServiceId::ALL.len()];
        match roll % 6 {
            0 => bench.dies(service),
            1 => bench.stop(ModeClass::Lock, StopReason::service(info.kind, service, 1)),
            2 => bench.run(CueKind::Left),
            3 => bench.refuses(CueRefusal::ALL[(roll >> 24) as usize % CueRefusal::ALL.len()], StopReason::default()),
            4 => bench.pass(200, &[info.kind]),
            _ => bench.speaker.finished(),
        }
        bench.listen();
        assert!(bench.speaker.waiting.len() <= 10 && bench.speaker.told.len() <= super::REMEMBERED);
    }
    assert!(bench.heard.len() > 1000);
}

#[test]
fn the_tone_before_motion_comes_at_once_or_not_at_all() {
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    bench.pass(50, &[]);
    bench.hears();
    bench.pass(1000, &[]);
    assert_eq!(
        bench.texts(),
        ["Stopped: lidar lost, restarting."],
        "a stop is told to its end, and the tone is too late"
    );
    bench.pass(2000, &[]);
    bench.heard.clear();
    bench.mode.ready_for_cue = true;
    bench.pass(400, &[]);
    bench.hears();
    bench.pass(50, &[]);
    assert_eq!(bench.texts(), ["Ready.", "(tone)"], "what is less urgent is cut short");
}

#[test]
fn a_stop_that_could_not_be_heard_is_told_once_more_while_it_lasts() {
    let fails = |bench: &mut Bench| {
        let utterance = bench.speaker.next(bench.now_ms * MS).expect("it is told");
        bench.speaker.unheard(&utterance, bench.now_ms * MS);
        utterance
    };
    let mut bench = Bench::running();
    bench.dies(ServiceId::Lidar);
    let utterance = fails(&mut bench);
    bench.pass(950, &[]);
    assert_eq!(bench.texts(), [""; 0]);
    bench.pass(50, &[]);
    assert_eq!(bench.texts(), ["Stopped: lidar lost, restarting."]);
    bench.speaker.unheard(&utterance, bench.now_ms * MS);
    bench.pass(5000, &[]);
    assert_eq!(bench.heard.len(), 1, "{:?}", bench.heard);
    // Nobody needs to hear why the robot stood.
    bench.dies(ServiceId::Depth);
    fails(&mut bench);
    bench.run(CueKind::Forward);
    bench.pass(5000, &[]);
    assert_eq!(bench.heard.len(), 1, "{:?}", bench.heard);
}

#[test]
fn what_is_assumed_of_the_floor_is_said_once() {
    let mut bench = Bench::running();
    let permit = |outcome, assumes_floor| Permit { outcome, assumes_floor, ..Permit::default() };
    bench.speaker.permit(&permit(Outcome::Granted, false), bench.now_ms * MS);
    bench.speaker.permit(&permit(Outcome::AllUnsafe, true), bench.now_ms * MS);
    bench.pass(2000, &[]);
    assert_eq!(bench.texts(), [""; 0], "nothing was assumed to walk");
    for _ in 0..3 {
        bench.speaker.permit(&permit(Outcome::Granted, true), bench.now_ms * MS);
        bench.pass(2000, &[]);
    }
    assert_eq!(bench.texts(), ["I cannot see the floor beside you."]);
}

#[test]
fn a_run_in_which_nothing_watches_the_floor_says_so_once() {
    let mut settings = Settings::default();
    settings.shield.floor.watched = false;
    let mut bench = Bench::new(Verbosity::Normal);
    bench.speaker = Speaker::new(SpeakerConfig::of(&settings));
    for epoch in 1..4 {
        bench.mode = Mode { epoch, ready_for_cue: true, reason: StopReason::of(StopKind::Boot), ..bench.mode };
        bench.mode.class = ModeClass::Fault;
        bench.pass(5000, &[]);
        bench.run(CueKind::Forward);
        bench.pass(5000, &[]);
        bench.dies(ServiceId::Lidar);
    }
    let said = bench.texts().into_iter().filter(|text| *text == "I cannot warn of steps or edges.").count();
    assert_eq!(said, 1, "{:?}", bench.heard);
}
