//! What beats tell: of work that was not seen, of what a process uses, of streams that are slow or starved.

use super::{Bench, MS};
use crate::machine::{Action, Event};
use messages::{CueKind, Header, Health, ModeClass, PortCounters, PortRole, ServiceId, StopKind, TopicId};
use transport::ClockKind;

/// What a beat tells beside the figures of [`Bench::beat`].
fn beat_with(bench: &mut Bench, service: ServiceId, change: impl Fn(&mut Health)) {
    let mut health = Health {
        header: Header { stamp_ns: bench.now_ms * MS, incarnation: 1, ..Header::default() },
        service,
        ..Health::default()
    };
    change(&mut health);
    bench.handle(Event::Beat(&health));
    bench.machine.tick_judge(bench.now());
    bench.act();
}

#[test]
fn what_a_service_did_while_the_supervisor_slept_is_not_taken_for_well() {
    let mut bench = Bench::up(ClockKind::Real);
    bench.now_ms += 900;
    bench.handle(Event::Overslept(150 * MS));
    assert!(bench.machine.not_ready(bench.now()).is_some(), "nobody has beaten since");
    bench.cue(CueKind::Forward, 500);
    assert_eq!(bench.class(), ModeClass::Fault, "a cue from then starts nothing");
    bench.pass(200);
    assert_eq!((bench.machine.not_ready(bench.now()), bench.reason()), (None, StopKind::Boot));
}

#[test]
fn a_process_that_leaks_memory_or_descriptors_is_replaced() {
    for (kind, change) in [
        (StopKind::MemoryExhausted, (|health| health.private_bytes = 33 << 20) as fn(&mut Health)),
        (StopKind::FilesExhausted, |health| health.open_files = 257),
    ] {
        let mut bench = Bench::running();
        beat_with(&mut bench, ServiceId::Cue, change);
        assert_eq!((bench.class(), bench.reason()), (ModeClass::Fault, kind));
        assert!(bench.actions.contains(&Action::Kill(ServiceId::Cue, 1)));
        let told = bench.machine.mode().reason.to_string();
        assert!(told.contains("cue") && told.contains("limit"), "{told}");
    }
}

/// Beats of a lidar that gives a scan every `period_ms`, in a world that goes on `fed` times as fast as it should.
fn scans_every(period_ms: u64, fed: f64) -> Bench {
    let mut bench = Bench::running();
    let begun_ms = bench.now_ms;
    while bench.now_ms < begun_ms + 5000 && bench.class() == ModeClass::Run {
        bench.now_ms += 20;
        for (service, incarnation, _) in bench.alive.clone() {
            if service != ServiceId::Lidar {
                bench.beat(service, incarnation, bench.now_ms);
            }
        }
        let since_ms = bench.now_ms - begun_ms;
        let scans = PortCounters {
            topic: TopicId::LidarScan,
            role: PortRole::Publisher,
            count: 1000 + since_ms / period_ms,
            last_stamp_ns: bench.now_ms * MS,
            ..PortCounters::default()
        };
        let inputs = (fed * since_ms as f64 / 10.0) as u64;
        let truths = PortCounters {
            topic: TopicId::WorldTruth,
            role: PortRole::Subscriber,
            count: 1000 + inputs,
            ..PortCounters::default()
        };
        beat_with(&mut bench, ServiceId::Lidar, |health| {
            (health.port_count, health.ports[0], health.ports[1]) = (2, scans, truths);
        });
    }
    bench
}

#[test]
fn a_stream_that_comes_too_seldom_is_a_fault_though_no_age_is_over_its_limit() {
    assert_eq!(scans_every(100, 1.0).class(), ModeClass::Run);
    let slow = scans_every(160, 1.0);
    assert_eq!((slow.class(), slow.reason()), (ModeClass::Fault, StopKind::StreamSlow));
    assert_eq!(slow.machine.mode().reason.topic, TopicId::LidarScan);
    // In a world that is slow itself, nobody is to blame.
    assert_eq!(scans_every(200, 0.5).class(), ModeClass::Run);
}

#[test]
fn who_gets_no_input_is_starved_and_not_hung() {
    let mut bench = Bench::running();
    let (permits, scans) = (TopicId::ShieldPermit, TopicId::LidarScan);
    let as_before = |topic, role| PortCounters { topic, role, count: 400, ..PortCounters::default() };
    for _ in 0..50 {
        bench.now_ms += 20;
        for (service, incarnation, _) in bench.alive.clone() {
            if service != ServiceId::Shield {
                bench.beat(service, incarnation, bench.now_ms);
            }
        }
        beat_with(&mut bench, ServiceId::Shield, |health| {
            (health.ports[0], health.port_count) = (as_before(permits, PortRole::Publisher), 2);
            health.ports[1] = as_before(scans, PortRole::Subscriber);
        });
    }
    let status = bench.machine.status(bench.now_ms * MS);
    let shield = status.iter().find(|s| s.service == ServiceId::Shield).expect("it is there");
    assert_eq!((shield.starved_of, shield.incarnation), (Some(TopicId::LidarScan), 1));
    assert_eq!(bench.class(), ModeClass::Run, "who starves is not restarted");
}
