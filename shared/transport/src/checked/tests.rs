//! Every message type against bytes that are none; then the same in real shared memory, scribbled on.

use std::fs::File;
use std::mem::offset_of;
use std::os::unix::fs::FileExt;
use std::rc::Rc;

use messages::{
    ClockAck, ClockStep, Cue, CueAnswer, CueHeard, CueKind, CueRequest, DepthFrame, DepthHeader, EmergencyStop, Health,
    LidarScan, LocomotionState, Member, Message, Mode, Odometry, Permit, PolicyAction, PortCounters, RobotCommand,
    ScanHeader, ServiceId, SpeechSaid, WorldTruth,
};

use crate::domain::{Domain, Holder};
use crate::io::Io;
use crate::run_dir::{RunDir, RunInfo};
use crate::{ClockKind, Identity};

/// The message that these bytes are, as a reader would take them.
fn read<M: Message>(bytes: &[u8]) -> Option<M> {
    M::try_read_from_bytes(bytes).ok().filter(M::counts_fit)
}

/// Zero bytes are a message; with each of `(offset, first wrong value)` they are none, with one less they are.
fn only_values<M: Message>(enums_and_counts: &[(usize, u32)], bools: &[usize]) {
    let name = std::any::type_name::<M>();
    let zeros = vec![0u8; size_of::<M>()];
    assert!(read::<M>(&zeros).is_some(), "{name}: zeros");
    for (offset, wrong) in enums_and_counts {
        for value in [*wrong, wrong + 1, u32::MAX] {
            let mut bytes = zeros.clone();
            bytes[*offset..offset + 4].copy_from_slice(&value.to_ne_bytes());
            assert!(read::<M>(&bytes).is_none(), "{name}: {value} at {offset}");
        }
        let mut bytes = zeros.clone();
        bytes[*offset..offset + 4].copy_from_slice(&(wrong - 1).to_ne_bytes());
        assert!(read::<M>(&bytes).is_some(), "{name}: {} at {offset}", wrong - 1);
    }
    for offset in bools {
        let mut bytes = zeros.clone();
        bytes[*offset] = 2;
        assert!(read::<M>(&bytes).is_none(), "{name}: a bool of 2 at {offset}");
        bytes[*offset] = 1;
        assert!(read::<M>(&bytes).is_some(), "{name}: true at {offset}");
    }
    let garbage = vec![0xffu8; size_of::<M>()];
    assert_eq!(read::<M>(&garbage).is_none(), !enums_and_counts.is_empty() || !bools.is_empty(), "{name}: ones");
}

const SERVICES: u32 = ServiceId::ALL.len() as u32 + 1;
const OUTCOMES: u32 = messages::Outcome::ALL.len() as u32;
const TOPICS: u32 = messages::topic::TOPICS.len() as u32 + 1;
const STOPS: u32 = messages::stops::STOPS.len() as u32 + 1;

fn stop_reason(at: usize) -> [(usize, u32); 3] {
    use messages::StopReason;
    [
        (at + offset_of!(StopReason, kind), STOPS),
        (at + offset_of!(StopReason, service), SERVICES),
        (at + offset_of!(StopReason, topic), TOPICS),
    ]
}

#[test]
fn bytes_that_are_no_message_become_none() {
    let cue = |at: usize| [(at + offset_of!(Cue, kind), 4), (at + offset_of!(Cue, source), 5)];
    only_values::<Cue>(&cue(0), &[]);
    only_values::<CueRequest>(&[(offset_of!(CueRequest, kind), 4)], &[]);
    only_values::<PolicyAction>(&[(offset_of!(PolicyAction, action_count), 17)], &[]);
    let permit = [
        (offset_of!(Permit, outcome), OUTCOMES),
        (offset_of!(Permit, cause), 2),
        (offset_of!(Permit, unsafe_cause), messages::UnsafeCause::Handler as u32 + 1),
    ];
    only_values::<Permit>(&permit, &[offset_of!(Permit, all_unsafe), offset_of!(Permit, assumes_floor)]);
    let in_force = offset_of!(Mode, cue) + offset_of!(messages::CueInForce, cue);
    let mode = [&[(offset_of!(Mode, class), 3)][..], &stop_reason(offset_of!(Mode, reason)), &cue(in_force)].concat();
    let valid = offset_of!(Mode, cue) + offset_of!(messages::CueInForce, valid);
    only_values::<Mode>(&mode, &[offset_of!(Mode, ready_for_cue), valid]);
    let limited = stop_reason(offset_of!(LocomotionState, limited_by));
    let flags = [offset_of!(LocomotionState, measured_valid), offset_of!(LocomotionState, remote_stop)];
    only_values::<LocomotionState>(&limited, &flags);
    only_values::<RobotCommand>(&[(offset_of!(RobotCommand, source), SERVICES)], &[]);
    only_values::<WorldTruth>(&[(offset_of!(WorldTruth, walker_count), 17)], &[]);
    only_values::<EmergencyStop>(&[(offset_of!(EmergencyStop, input), 4)], &[]);
    let answer = [
        &[(offset_of!(CueAnswer, kind), 4), (offset_of!(CueAnswer, source), 5)][..],
        &[(offset_of!(CueAnswer, refusal), messages::CueRefusal::ALL.len() as u32 + 1)],
        &stop_reason(offset_of!(CueAnswer, reason)),
    ];
    only_values::<CueAnswer>(&answer.concat(), &[]);
    let said = [
        &[(offset_of!(SpeechSaid, phase), 4), (offset_of!(SpeechSaid, urgency), 6)][..],
        &stop_reason(offset_of!(SpeechSaid, reason)),
    ];
    only_values::<SpeechSaid>(&said.concat(), &[]);
    only_values::<CueHeard>(&[(offset_of!(CueHeard, kind), 4)], &[]);
    only_values::<Odometry>(&[], &[]);
    only_values::<ScanHeader>(&[], &[]);
    only_values::<DepthHeader>(&[], &[]);
}

#[test]
fn arrays_and_counts_of_messages_are_checked_to_the_last_place() {
    let last_port = offset_of!(Health, ports) + (messages::MAX_PORTS - 1) * size_of::<PortCounters>();
    let last_latency = offset_of!(Health, latencies) + size_of::<messages::LatencyHistogram>();
    let health = [
        (offset_of!(Health, service), SERVICES),
        (offset_of!(Health, state), 2),
        (offset_of!(Health, port_count), messages::MAX_PORTS as u32 + 1),
        (last_port + offset_of!(PortCounters, topic), TOPICS),
        (last_port + offset_of!(PortCounters, role), 2),
        (last_port + offset_of!(PortCounters, of), SERVICES),
        (last_latency, messages::Latency::StopToSpeech as u32 + 1),
        (offset_of!(Health, microphone), messages::MicrophoneState::Clipping as u32 + 1),
    ];
    only_values::<Health>(&health, &[]);
    let last_member = (messages::MAX_MEMBERS - 1) * size_of::<Member>();
    let step = [
        (offset_of!(ClockStep, member_count), messages::MAX_MEMBERS as u32 + 1),
        (offset_of!(ClockStep, members) + last_member, SERVICES),
    ];
    only_values::<ClockStep>(&step, &[]);
    let ack = [
        (offset_of!(ClockAck, member), SERVICES),
        (offset_of!(ClockAck, roster_count), messages::MAX_MEMBERS as u32 + 1),
        (offset_of!(ClockAck, roster) + last_member, SERVICES),
    ];
    only_values::<ClockAck>(&ack, &[]);
}

/// A run's shared memory for a test, gone with it.
struct TestRun {
    io: Io,
    prefix: String,
    _holder: Holder,
    _folder: tempfile::TempDir,
}

impl TestRun {
    /// One in which this process may open every topic.
    fn new(clock: ClockKind) -> Self {
        Self::of(clock, true)
    }

    fn of(clock: ClockKind, is_tool: bool) -> Self {
        let folder = tempfile::Builder::new().prefix("gd").tempdir_in("/tmp").expect("a folder");
        let dir = RunDir::open(folder.path());
        std::fs::create_dir(dir.iceoryx2_root()).expect("made");
        let info = RunInfo {
            name: "test".to_owned(),
            prefix: dir.prefix(),
            supervisor_pid: std::process::id(),
            started_monotonic_ns: 0,
            clock,
            faults: false,
        };
        dir.write_info(&info).expect("written");
        let domain = Domain::open(dir, "test").expect("opens");
        let holder = domain.create_all().expect("created");
        let identity = Identity { service: ServiceId::Cue, incarnation: 1 };
        let io = Io::new(domain, identity, is_tool, None, None).expect("opens");
        Self { io, prefix: info.prefix, _holder: holder, _folder: folder }
    }

    /// Overwrites bytes of the message in shared memory that holds `pattern`, from `at` bytes after its first on.
    fn scribble(&self, pattern: u64, at: isize, bytes: &[u8]) {
        let mut found = 0;
        for entry in std::fs::read_dir(crate::SHM).expect("Linux has it").flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if !name.starts_with(&self.prefix) || !name.ends_with(".data") {
                continue;
            }
            let held = std::fs::read(entry.path()).expect("readable");
            let place = held.windows(8).position(|window| window == pattern.to_ne_bytes());
            let Some(place) = place.and_then(|place| place.checked_add_signed(at)) else { continue };
            File::options().write(true).open(entry.path()).expect("ours").write_all_at(bytes, place as u64).expect("w");
            found += 1;
        }
        assert_eq!(found, 1, "the message lies in one place");
    }

    fn invalid(&self, topic: messages::TopicId) -> u64 {
        let counters = self.io.counters();
        counters.iter().filter(|port| port.topic == topic).map(|port| port.invalid).sum()
    }
}

impl Drop for TestRun {
    fn drop(&mut self) {
        for entry in std::fs::read_dir(crate::SHM).expect("Linux has it").flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

#[test]
fn a_service_opens_only_the_ends_that_the_topic_table_gives_it() {
    let mut run = TestRun::of(ClockKind::Real, false);
    run.io.publisher::<Cue>().expect("listed");
    run.io.subscriber::<CueRequest>().expect("listed");
    run.io.publisher::<Health>().expect("listed");
    let refused = run.io.subscriber::<Cue>().expect_err("it writes them");
    assert_eq!(refused.to_string(), "failed to open cue: the topic table does not list cue among its subscribers");
    let refused = run.io.publisher::<Odometry>().expect_err("it measures nothing");
    assert_eq!(refused.to_string(), "failed to open odometry: the topic table does not list cue among its publishers");
    assert!(run.io.frame_subscriber::<LidarScan>().is_err() && run.io.frame_publisher::<LidarScan>(10).is_err());
    assert!(run.io.health_of(ServiceId::Cue).is_err() && run.io.quiet_subscriber::<CueAnswer>().is_err());
}

/// A stamp of the first seconds of run time that lies nowhere else in memory by chance.
const MAGIC: u64 = 0x0765_4321;

#[test]
fn a_scribbled_message_is_dropped_and_counted_and_the_next_one_comes() {
    let mut run = TestRun::new(ClockKind::Real);
    let mut out = run.io.publisher::<Cue>().expect("opens");
    let mut inbox = run.io.subscriber::<Cue>().expect("opens");
    out.publish(MAGIC, Cue { kind: CueKind::Left, ..Cue::default() }).expect("sent");
    run.scribble(MAGIC, offset_of!(Cue, kind) as isize, &77u32.to_ne_bytes());
    out.publish(1, Cue { kind: CueKind::Right, ..Cue::default() }).expect("sent");
    let taken = inbox.take().expect("taken").expect("the second one");
    assert_eq!((taken.kind, taken.header.stamp_ns), (CueKind::Right, 1));
    assert_eq!(run.invalid(messages::TopicId::Cue), 1);
    assert!(inbox.take().expect("taken").is_none());
}

#[test]
fn a_frame_whose_length_is_a_lie_is_dropped_and_counted() {
    // The header is iceoryx2's: node, publisher, number of elements, payload offset; ours follows.
    let lies = [(u64::MAX / 8, -16), (1 << 20, -16), (81, -16)];
    for (i, (len, at)) in lies.into_iter().enumerate() {
        let mut run = TestRun::new(ClockKind::Real);
        let mut out = run.io.frame_publisher::<DepthFrame>(80).expect("opens");
        let mut inbox = run.io.frame_subscriber::<DepthFrame>().expect("opens");
        let mut send = |stamp_ns| {
            let mut loan = out.loan(80).expect("loaned");
            *loan.meta_mut() = DepthHeader { width: 10, height: 8, ..DepthHeader::default() };
            loan.data_mut().fill(7);
            out.publish(stamp_ns, loan).expect("sent");
        };
        send(MAGIC + i as u64);
        run.scribble(MAGIC + i as u64, at, &len.to_ne_bytes());
        assert!(inbox.take().expect("taken").is_none(), "{len} elements");
        assert_eq!(run.invalid(messages::TopicId::DepthFrame), 1);
        send(1);
        let frame = inbox.take().expect("taken").expect("the second one");
        assert_eq!(frame.data(), [7u16; 80]);
    }
}

#[test]
fn a_frame_that_says_to_be_larger_than_its_memory_is_none() {
    let mut run = TestRun::new(ClockKind::Real);
    // The whole pool is smaller than the longest scan that there may be.
    let mut out = run.io.frame_publisher::<LidarScan>(10).expect("opens");
    let mut inbox = run.io.frame_subscriber::<LidarScan>().expect("opens");
    let loan = out.loan(10).expect("loaned");
    out.publish(MAGIC, loan).expect("sent");
    run.scribble(MAGIC, -16, &4096u64.to_ne_bytes());
    assert!(inbox.take().expect("taken").is_none());
    assert_eq!(run.invalid(messages::TopicId::LidarScan), 1);
}

#[test]
fn in_stepped_time_a_message_from_a_step_that_cannot_be_yet_waits_for_nobody() {
    let mut run = TestRun::new(ClockKind::Stepped { speed: 0.0 });
    let mut out = run.io.publisher::<Odometry>().expect("opens");
    let mut inbox = run.io.subscriber::<Odometry>().expect("opens");
    let clock = Rc::clone(&run.io.domain.clock);
    clock.enter(4, 40_000_000);
    out.publish(MAGIC >> 2, Odometry::default()).expect("sent");
    let step = offset_of!(messages::Header, step) as isize;
    run.scribble(MAGIC >> 2, step, &u64::MAX.to_ne_bytes());
    out.publish(2, Odometry::default()).expect("sent");
    clock.enter(5, 50_000_000);
    assert_eq!(inbox.take().expect("taken").map(|odometry| odometry.header.stamp_ns), Some(2));
    assert_eq!(run.invalid(messages::TopicId::Odometry), 1);
}

#[test]
fn a_stamp_from_far_in_the_future_is_no_message_and_blocks_no_later_one() {
    let mut run = TestRun::new(ClockKind::Real);
    let mut out = run.io.publisher::<Odometry>().expect("opens");
    let mut inbox = run.io.subscriber::<Odometry>().expect("opens");
    out.publish(u64::MAX - 1, Odometry::default()).expect("sent");
    out.publish(MAGIC, Odometry::default()).expect("sent");
    assert_eq!(inbox.take().expect("taken").map(|odometry| odometry.header.stamp_ns), Some(MAGIC));
    assert_eq!(run.invalid(messages::TopicId::Odometry), 1);
}
