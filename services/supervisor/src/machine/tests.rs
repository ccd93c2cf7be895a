use super::{Action, Event, Machine, Now, Phase};
use crate::plan::Plan;
use messages::{
    Cue, CueKind, CueSource, EmergencyStop, Header, Health, LocomotionState, Member, ModeClass, PortCounters, PortRole,
    ServiceId, StopInput, StopKind, StopReason, TopicId,
};
use settings::Settings;
use transport::ClockKind;

use bench::{Bench, MS, STEPPED};

mod answers;
mod beats;
mod bench;
mod formation;

#[test]
fn what_stops_the_robot_starts_first_and_the_rest_waits_for_it() {
    let mut machine = Machine::new(Plan::of(&Settings::default(), ClockKind::Real));
    let now = Now { run_ns: 0, wall_ns: 1 };
    machine.tick_starts(now);
    let first = machine.take_actions();
    assert_eq!(first, [Action::Spawn(ServiceId::Locomotion, 1), Action::Spawn(ServiceId::Brake, 1)]);
    machine.tick_starts(now);
    assert!(machine.take_actions().is_empty(), "nothing else before they are ready");
    machine.handle(Event::Ready(ServiceId::Locomotion, 1), now);
    machine.handle(Event::Ready(ServiceId::Brake, 1), now);
    machine.tick_starts(now);
    assert_eq!(machine.take_actions(), [Action::Spawn(ServiceId::Simulator, 1)]);
}

#[test]
fn a_run_boots_in_fault_and_only_a_cue_starts_it() {
    let mut bench = Bench::up(ClockKind::Real);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, StopKind::Boot));
    assert!(bench.machine.mode().ready_for_cue);
    bench.pass(5000);
    assert_eq!(bench.class(), ModeClass::Fault);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
    assert!(bench.machine.mode().cue.valid);
}

#[test]
fn a_cue_that_comes_too_early_or_too_late_is_refused_and_not_queued() {
    let mut bench = Bench::new(ClockKind::Real);
    bench.cue(CueKind::Forward, 0);
    assert!(bench.noted("not ready"), "{:?}", bench.actions);
    bench.pass(400);
    assert_eq!(bench.class(), ModeClass::Fault, "it was not queued");
    bench.pass(1600);
    bench.cue(CueKind::Forward, 1500);
    assert!(bench.noted("1500 ms old"), "{:?}", bench.actions);
    assert_eq!(bench.class(), ModeClass::Fault);
}

#[test]
fn a_stream_that_never_came_is_not_fresh() {
    let mut bench = Bench::up(ClockKind::Real);
    bench.die(ServiceId::Lidar);
    bench.pass(100);
    bench.silence(ServiceId::Lidar);
    let incarnation = bench.alive.iter().find(|(s, ..)| *s == ServiceId::Lidar).map_or(0, |(_, i, _)| *i);
    bench.beat(ServiceId::Lidar, incarnation, 0);
    bench.machine.tick_judge(bench.now());
    assert!(!bench.machine.mode().ready_for_cue);
}

#[test]
fn a_death_is_a_fault_and_the_service_comes_back() {
    for victim in [ServiceId::Lidar, ServiceId::Shield, ServiceId::Locomotion, ServiceId::Cue] {
        let mut bench = Bench::running();
        let epoch = bench.machine.mode().epoch;
        bench.die(victim);
        assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, StopKind::ServiceDied));
        assert_eq!(bench.machine.mode().epoch, epoch + 1);
        assert!(!bench.machine.mode().cue.valid, "the cue in force is void");
        bench.pass(1000);
        assert!(bench.actions.contains(&Action::Spawn(victim, 2)));
        assert!(bench.machine.mode().ready_for_cue && bench.class() == ModeClass::Fault);
    }
}

#[test]
fn a_second_fault_within_a_fault_raises_the_epoch_again() {
    let mut bench = Bench::running();
    bench.die(ServiceId::Lidar);
    let epoch = bench.machine.mode().epoch;
    bench.die(ServiceId::Shield);
    assert_eq!(bench.machine.mode().epoch, epoch + 1);
}

#[test]
fn silence_is_a_fault_that_ends_the_process_and_its_death_is_no_second_one() {
    let mut bench = Bench::running();
    let epoch = bench.machine.mode().epoch;
    bench.silence(ServiceId::Shield);
    bench.pass(200);
    assert_eq!(bench.reason(), StopKind::BeatsMissed);
    assert!(bench.actions.contains(&Action::Kill(ServiceId::Shield, 1)));
    assert_eq!(bench.machine.mode().epoch, epoch + 1);
    bench.pass(600);
    assert!(bench.actions.contains(&Action::Spawn(ServiceId::Shield, 2)));
}

#[test]
fn input_without_output_is_hung_and_no_input_is_nobodys_fault() {
    for (fed, expected) in [(true, true), (false, false)] {
        let mut bench = Bench::running();
        bench.silence(ServiceId::Shield);
        let stuck_since = bench.now_ms;
        for _ in 0..60 {
            bench.pass(20);
            let mut health = Health {
                header: Header { stamp_ns: bench.now_ms * MS, incarnation: 1, ..Header::default() },
                service: ServiceId::Shield,
                port_count: 2,
                ..Health::default()
            };
            let port = |topic, role, count| PortCounters { topic, role, count, ..PortCounters::default() };
            health.ports[0] = port(TopicId::ShieldPermit, PortRole::Publisher, stuck_since);
            let input = if fed { bench.now_ms } else { stuck_since };
            health.ports[1] = port(TopicId::LidarScan, PortRole::Subscriber, input);
            bench.handle(Event::Beat(&health));
        }
        assert_eq!(bench.actions.contains(&Action::Kill(ServiceId::Shield, 1)), expected, "fed: {fed}");
    }
}

#[test]
fn a_supervisor_that_overslept_condemns_nobody() {
    let mut bench = Bench::running();
    bench.now_ms += 500;
    bench.handle(Event::Overslept(150 * MS));
    bench.machine.tick_judge(bench.now());
    bench.act();
    assert!(!bench.actions.iter().any(|action| matches!(action, Action::Kill(..))));
    bench.pass(400);
    assert_eq!(bench.class(), ModeClass::Run);
    // However long it slept: the limit of who is judged late counts from the wake-up as well.
    bench.now_ms += 5000;
    bench.handle(Event::Overslept(150 * MS));
    bench.now_ms += 200;
    for (service, incarnation, _) in bench.alive.clone() {
        if service != ServiceId::Simulator {
            bench.beat(service, incarnation, bench.now_ms);
        }
    }
    bench.machine.tick_judge(bench.now());
    bench.act();
    assert_eq!(bench.class(), ModeClass::Run);
    assert!(!bench.actions.iter().any(|action| matches!(action, Action::Kill(..) | Action::EndRun(_))));
}

#[test]
fn a_run_whose_service_cannot_start_ends_and_says_why() {
    let mut bench = Bench::new(STEPPED);
    for _ in 0..40 {
        bench.die(ServiceId::Odometry);
        bench.now_ms += 2100;
        bench.machine.tick_starts(bench.now());
        for action in bench.machine.take_actions() {
            if let Action::Spawn(service, incarnation) = action {
                bench.alive.push((service, incarnation, true));
                let ready = Event::Ready(service, incarnation);
                if service != ServiceId::Odometry {
                    bench.machine.handle(ready, bench.now());
                }
            } else {
                bench.actions.push(action);
            }
        }
    }
    let ended = bench.actions.iter().any(|a| matches!(a, Action::EndRun(why) if why.contains("odometry could not")));
    assert!(ended, "{:?}", bench.actions);
}

#[test]
fn a_spent_budget_locks_and_resume_restores_it() {
    let mut bench = Bench::running();
    for _ in 0..=10 {
        bench.die(ServiceId::Lidar);
        bench.pass(2500);
    }
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::RestartBudgetSpent));
    let lidar = bench.machine.status(0).into_iter().find(|s| s.service == ServiceId::Lidar).map(|s| s.phase);
    assert_eq!(lidar, Some(Phase::Spent));
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Lock);
    bench.handle(Event::OperatorResume);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, StopKind::Resumed));
    bench.pass(500);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
}

#[test]
fn a_lock_is_not_left_by_a_fault_nor_by_a_cue() {
    let mut bench = Bench::running();
    bench.handle(Event::OperatorStop);
    let epoch = bench.machine.mode().epoch;
    let told = |action: &Action| matches!(action, Action::StopLine { epoch: of, .. } if *of == epoch);
    assert!(bench.actions.iter().any(told));
    bench.die(ServiceId::Lidar);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::OperatorStop));
    assert!(bench.machine.mode().epoch > epoch);
    bench.pass(1000);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Lock);
}

#[test]
fn a_stop_cue_voids_the_cue_in_force_and_run_goes_on() {
    let mut bench = Bench::running();
    bench.cue(CueKind::Stop, 0);
    assert_eq!(bench.class(), ModeClass::Run);
    assert!(!bench.machine.mode().cue.valid);
    bench.cue(CueKind::Left, 0);
    assert_eq!(bench.machine.mode().cue.cue.kind, CueKind::Left);
}

#[test]
fn a_turn_that_is_done_goes_on_only_while_it_is_in_force() {
    let mut bench = Bench::running();
    bench.cue(CueKind::Left, 0);
    let turn = bench.cue_seq;
    let done = |bench: &mut Bench, turn: u64| {
        bench.cue_seq += 1;
        let header = Header { stamp_ns: bench.now_ms * MS, seq: bench.cue_seq, incarnation: 1, ..Header::default() };
        let (kind, source) = (CueKind::Forward, CueSource::TurnDone);
        let cue = Cue { header, kind, source, request_seq: turn, odometry_incarnation: 1, ..Cue::default() };
        bench.handle(Event::Cue(&cue));
    };
    bench.cue(CueKind::Stop, 0);
    done(&mut bench, turn);
    assert!(!bench.machine.mode().cue.valid, "the handler has said stop since");
    bench.cue(CueKind::Left, 0);
    done(&mut bench, turn);
    assert_eq!(bench.machine.mode().cue.cue.kind, CueKind::Left, "it was another turn");
    let turn = bench.cue_seq - 1;
    done(&mut bench, turn);
    assert_eq!(bench.machine.mode().cue.cue.kind, CueKind::Forward);
}

#[test]
fn a_cue_given_before_a_fault_does_not_end_it() {
    let mut bench = Bench::running();
    let health = Health {
        header: Header { stamp_ns: bench.now_ms * MS, incarnation: 1, ..Header::default() },
        service: ServiceId::Shield,
        pose_jumps: 1,
        ..Health::default()
    };
    bench.handle(Event::Beat(&health));
    assert!(bench.machine.mode().ready_for_cue, "everybody is up");
    bench.cue(CueKind::Forward, 5);
    assert_eq!(bench.class(), ModeClass::Fault);
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
}

#[test]
fn the_brake_and_a_latched_locomotion_are_faults() {
    let mut bench = Bench::running();
    bench.handle(Event::BrakeEngaged(1));
    assert_eq!(bench.reason(), StopKind::BrakeEngaged);
    let mut bench = Bench::running();
    let epoch = bench.machine.mode().epoch;
    let state = LocomotionState {
        epoch,
        limited_by: StopReason::stream(StopKind::ModeStale, TopicId::Mode, 250 * MS, 200 * MS),
        ..LocomotionState::default()
    };
    for _ in 0..3 {
        bench.handle(Event::Locomotion(&state));
    }
    assert_eq!(bench.reason(), StopKind::ModeStale);
    assert_eq!(bench.machine.mode().epoch, epoch + 1);
}

#[test]
fn a_new_locomotion_watches_nobody_yet_and_a_new_brake_not_locomotion() {
    for (watcher, watched) in [(ServiceId::Locomotion, ServiceId::Lidar), (ServiceId::Brake, ServiceId::Locomotion)] {
        let mut bench = Bench::running();
        bench.die(watcher);
        // It starts, but has not acknowledged a line.
        let now = Now { wall_ns: bench.now().wall_ns + 1000 * MS, ..bench.now() };
        bench.machine.tick_starts(now);
        assert!(bench.machine.take_actions().contains(&Action::Spawn(watcher, 2)));
        bench.machine.handle(Event::Ready(watcher, 2), now);
        let why = bench.machine.not_ready(now);
        assert!(why.as_ref().is_some_and(|why| why.to_string().contains("is not armed")), "{why:?}");
        // What the dead one acknowledged is not heard.
        bench.machine.handle(Event::Armed { service: watched, incarnation: 1, by: 1 }, now);
        assert_eq!(bench.machine.not_ready(now), why);
        bench.alive.push((watcher, 2, true));
        bench.arm(now);
        assert!(
            bench.machine.not_ready(now).is_some_and(|why| why.to_string().contains("is silent")),
            "it has not beaten yet"
        );
        bench.beat(watcher, 2, bench.now_ms);
        assert_eq!(bench.machine.not_ready(now), None);
    }
}

#[test]
fn in_stepped_time_only_who_keeps_it_waiting_is_condemned() {
    let mut bench = Bench::new(STEPPED);
    bench.pass(200);
    bench.handle(Event::TimeStands(&[Member { service: ServiceId::Policy, incarnation: 1 }]));
    let killed = |bench: &Bench| {
        let kills = bench.actions.iter().filter_map(|action| match action {
            Action::Kill(service, _) => Some(*service),
            _ => None,
        });
        kills.collect::<Vec<_>>()
    };
    assert_eq!(killed(&bench), [ServiceId::Policy]);
    assert!(!bench.actions.iter().any(|action| matches!(action, Action::EndRun(_))));
    bench.handle(Event::TimeStands(&[]));
    assert_eq!(killed(&bench), [ServiceId::Policy, ServiceId::Simulator], "nobody is late but the master");
}

#[test]
fn a_pose_that_jumped_is_a_fault_that_names_the_stream() {
    let mut bench = Bench::running();
    let mut health = Health {
        header: Header { stamp_ns: bench.now_ms * MS, incarnation: 1, ..Header::default() },
        service: ServiceId::Shield,
        pose_jumps: 1,
        ..Health::default()
    };
    bench.handle(Event::Beat(&health));
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, StopKind::PoseJump));
    assert_eq!(bench.machine.mode().reason.topic, TopicId::Odometry);
    let epoch = bench.machine.mode().epoch;
    health.header.seq += 1;
    bench.handle(Event::Beat(&health));
    assert_eq!(bench.machine.mode().epoch, epoch, "the same jump is told once");
}

#[test]
fn a_camera_that_motion_does_not_need_stops_nothing() {
    let mut settings = Settings::default();
    settings.depth.needed = false;
    let mut bench =
        Bench { machine: Machine::new(Plan::of(&settings, ClockKind::Real)), ..Bench::new(ClockKind::Real) };
    assert!(!bench.machine.has_line(ServiceId::Depth));
    bench.pass(400);
    bench.cue(CueKind::Forward, 0);
    bench.die(ServiceId::Depth);
    assert_eq!(bench.class(), ModeClass::Run);
}

#[test]
fn the_worlds_end_ends_the_run() {
    let mut bench = Bench::running();
    bench.die(ServiceId::Simulator);
    assert!(bench.actions.iter().any(|action| matches!(action, Action::EndRun(why) if why.contains("simulator"))));
}

#[test]
fn in_stepped_time_everybody_joins_at_once_the_dead_leave_and_time_waits_for_the_new() {
    let mut bench = Bench::new(STEPPED);
    assert_eq!(bench.machine.roster().0, 0);
    bench.pass(100);
    let (version, members) = bench.machine.roster();
    assert!(version > 0 && members.len() == 9, "{members:?}");
    assert!(members.iter().all(|member| member.service != ServiceId::Simulator), "the master acknowledges nothing");
    let died_at_ms = bench.now_ms;
    bench.die(ServiceId::Lidar);
    assert!(bench.machine.roster().1.iter().all(|member| member.service != ServiceId::Lidar));
    assert!(!bench.machine.holds_time((died_at_ms + 490) * MS) && bench.machine.holds_time((died_at_ms + 510) * MS));
    bench.pass(400);
    // It has long said that it is ready; when it did is wall time's business, and changes nothing yet.
    assert!(!bench.machine.is_ready(ServiceId::Lidar));
    bench.pass(120);
    assert!(bench.machine.is_ready(ServiceId::Lidar));
    let lidar = bench.machine.roster().1.iter().find(|member| member.service == ServiceId::Lidar);
    assert_eq!(lidar.map(|member| member.incarnation), Some(2));
    assert!(!bench.machine.holds_time(bench.now_ms * MS));
}

#[test]
fn a_service_on_demand_comes_and_goes_without_touching_the_walk() {
    let mut bench = Bench::running();
    let phase =
        |bench: &Bench| bench.machine.status(0).iter().find(|s| s.service == ServiceId::Recorder).map(|s| s.phase);
    assert_eq!(phase(&bench), Some(Phase::Off));
    let epoch = bench.machine.mode().epoch;
    bench.handle(Event::Demand(ServiceId::Recorder));
    bench.pass(100);
    assert_eq!(phase(&bench), Some(Phase::Ready));
    bench.handle(Event::Died(ServiceId::Recorder, 1, "killed".to_owned()));
    bench.alive.retain(|(service, ..)| *service != ServiceId::Recorder);
    bench.pass(200);
    assert_eq!(phase(&bench), Some(Phase::Ready), "it is restarted as long as it is wanted");
    bench.handle(Event::Release(ServiceId::Recorder));
    assert!(bench.actions.contains(&Action::Release(ServiceId::Recorder, 2)));
    bench.handle(Event::Left(ServiceId::Recorder, 2));
    bench.alive.retain(|(service, ..)| *service != ServiceId::Recorder);
    bench.pass(200);
    assert_eq!((phase(&bench), bench.class()), (Some(Phase::Off), ModeClass::Run));
    assert_eq!(bench.machine.mode().epoch, epoch, "nothing stopped");
}

#[test]
fn a_service_that_is_let_go_while_it_is_dying_stays_off() {
    let mut bench = Bench::running();
    bench.handle(Event::Demand(ServiceId::Recorder));
    bench.pass(100);
    let now = bench.now();
    bench.machine.condemn(StopReason::service(StopKind::ServiceHung, ServiceId::Recorder, 1), now);
    bench.machine.handle(Event::Release(ServiceId::Recorder), now);
    bench.machine.handle(Event::Died(ServiceId::Recorder, 1, "killed".to_owned()), now);
    bench.alive.retain(|(service, ..)| *service != ServiceId::Recorder);
    bench.pass(1000);
    let recorder = bench.machine.status(0).into_iter().find(|s| s.service == ServiceId::Recorder);
    assert_eq!(recorder.map(|s| s.phase), Some(Phase::Off));
}

#[test]
fn a_service_that_does_not_leave_in_time_is_killed() {
    let mut bench = Bench::running();
    bench.handle(Event::Demand(ServiceId::Recorder));
    bench.pass(100);
    bench.handle(Event::Release(ServiceId::Recorder));
    bench.pass(6000);
    assert!(bench.actions.contains(&Action::Kill(ServiceId::Recorder, 1)));
    let recorder = bench.machine.status(0).into_iter().find(|s| s.service == ServiceId::Recorder);
    assert_eq!(recorder.map(|s| s.phase), Some(Phase::Off));
}

#[test]
fn a_stop_by_the_robots_hand_remote_locks_until_resume() {
    let mut bench = Bench::running();
    let state = |bench: &Bench, remote_stop| LocomotionState {
        epoch: bench.machine.mode().epoch,
        remote_stop,
        ..LocomotionState::default()
    };
    let stopped = state(&bench, true);
    bench.handle(Event::Locomotion(&stopped));
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::RemoteStop));
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Lock);
    bench.handle(Event::OperatorResume);
    // What was on its way before locomotion read of it.
    bench.handle(Event::Locomotion(&stopped));
    assert_eq!(bench.class(), ModeClass::Fault);
    let still = state(&bench, true);
    bench.handle(Event::Locomotion(&still));
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::RemoteStop));
    bench.handle(Event::OperatorResume);
    let over = state(&bench, false);
    bench.handle(Event::Locomotion(&over));
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
}

#[test]
fn a_battery_that_is_nearly_empty_warns_stops_and_starts_nothing() {
    let mut bench = Bench::running();
    let tell = |bench: &mut Bench, charge_percent| {
        let epoch = bench.machine.mode().epoch;
        for _ in 0..25 {
            let state = LocomotionState { epoch, charge_percent, ..LocomotionState::default() };
            bench.handle(Event::Locomotion(&state));
        }
    };
    for (charge_percent, warned) in [(0, false), (21, false), (20, true), (9, true)] {
        tell(&mut bench, charge_percent);
        assert_eq!((bench.class(), bench.noted("battery is at")), (ModeClass::Run, warned), "{charge_percent} %");
    }
    tell(&mut bench, 8);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, StopKind::BatteryLow));
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert!(bench.class() == ModeClass::Fault && bench.noted("not ready: battery_low"));
    tell(&mut bench, 9);
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
}

#[test]
fn an_emergency_stop_locks_until_it_is_released_and_resumed() {
    let mut bench = Bench::running();
    bench.machine.limits.estop = true;
    let word = |bench: &mut Bench, input| {
        bench.handle(Event::Estop(&EmergencyStop { input, ..EmergencyStop::default() }));
    };
    word(&mut bench, StopInput::Released);
    assert_eq!(bench.class(), ModeClass::Run);
    word(&mut bench, StopInput::Pressed);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::EmergencyStop));
    bench.handle(Event::OperatorResume);
    assert!(bench.class() == ModeClass::Lock && bench.noted("resume refused: the emergency stop is pressed"));
    word(&mut bench, StopInput::Released);
    assert_eq!(bench.class(), ModeClass::Lock, "it is latched");
    bench.handle(Event::OperatorResume);
    word(&mut bench, StopInput::Unknown);
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert!(bench.class() == ModeClass::Fault && bench.noted("not ready: the emergency stop is unknown"));
    word(&mut bench, StopInput::Released);
    bench.pass(20);
    bench.cue(CueKind::Forward, 0);
    assert_eq!(bench.class(), ModeClass::Run);
    word(&mut bench, StopInput::Lost);
    assert_eq!((bench.class(), bench.reason()), (ModeClass::Lock, StopKind::EmergencyStop));
}
