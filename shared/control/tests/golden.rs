//! Answers as supervisors gave them before there were types for them: the types hold every member, and write the same
//! bytes.

use guidedog_control::{
    Collisions, CueStatus, Done, Falls, LocomotionStatus, MicrophoneStatus, ModeStatus, Note, Policies, PolicyLife,
    Report, RunFigures, SaidStatus, ServicePhase, ServiceStatus, Status, Stop, SwapRecord, SwapState, Why, WorldStatus,
    framing,
};
use messages::{CueKind, CueSource, MicrophoneState, ModeClass, ServiceId, SpeechPhase, TopicId, Urgency};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// Reads a line and writes it again.
fn read<T: DeserializeOwned + Serialize>(line: &str) -> T {
    let read: T = serde_json::from_str(line).expect("it is of its type");
    assert_eq!(framing::line(&read).expect("JSON"), line);
    read
}

#[test]
fn a_status_is_as_it_was() {
    let run: Status = read(include_str!("golden/status-run.json"));
    assert_eq!((run.mode.class, run.mode.cue.map(|cue| cue.kind)), (ModeClass::Run, Some(CueKind::Forward)));
    let fault: Status = read(include_str!("golden/status-fault.json"));
    assert_eq!(fault.service(ServiceId::Shield).and_then(|s| s.starved_of.as_deref()), Some("lidar/scan"));
    assert_eq!(fault.service(ServiceId::Recorder).map(|s| s.state), Some(ServicePhase::Off));
    assert_eq!((fault.service(ServiceId::Speak), fault.published(TopicId::LidarScan)), (None, 26));
    let lock: Status = read(include_str!("golden/status-lock.json"));
    assert_eq!(lock.mode.class, ModeClass::Lock);
}

#[test]
fn why_and_the_policies_are_as_they_were() {
    let why: Why = read(include_str!("golden/why.json"));
    assert_eq!(why.stops[2].service.as_deref(), Some("lidar"));
    let policies: Policies = read(include_str!("golden/policies.json"));
    assert_eq!((policies.active.says("engine"), policies.active.says("not_trained_with")), (Some("learnt"), None));
    let swap: SwapRecord = read(include_str!("golden/swap.json"));
    assert_eq!(policies.swap(1), Some(&swap));
    assert!(swap.state == SwapState::Done && swap.state.is_over());
}

#[test]
fn a_report_is_as_it_was() {
    let run: Report = read(include_str!("golden/report-run.json"));
    assert!(run.replayed().is_none() && run.world.is_some_and(|world| world.simulated.is_some()));
    let replay: Report = read(include_str!("golden/report-replay.json"));
    assert_eq!(replay.replayed().and_then(|r| r.compared.as_ref()).map(|c| c.permits.equal), Some(178));
    assert!(replay.reached() && replay.world.is_some_and(|world| world.simulated.is_none()));
}

/// A report of a run whose world died, and of one without any.
#[test]
fn a_report_tells_of_the_world_what_is_known() {
    let mut report: Value = serde_json::from_str(include_str!("golden/report-run.json")).expect("JSON");
    for known_to_the_simulator in ["end_pose", "skipped_ticks"] {
        report.as_object_mut().expect("an object").remove(known_to_the_simulator);
    }
    let died: Report = read(&format!("{report}\n"));
    let collisions = Collisions::default();
    let figures = RunFigures { distance_m: 7.405404774199868, collisions, ..RunFigures::default() };
    assert_eq!(died.world, Some(figures));
    for known_to_a_world in ["reached", "distance_m", "collisions", "falls"] {
        report.as_object_mut().expect("an object").remove(known_to_a_world);
    }
    assert_eq!(read::<Report>(&format!("{report}\n")).world, None);
}

/// One wrong member must not pass for a run without a world, or for a replay that was not compared.
#[test]
fn a_wrong_member_of_a_report_is_an_error() {
    let (run, replay) = (include_str!("golden/report-run.json"), include_str!("golden/report-replay.json"));
    let with = |line: &str, member: &str, value: Value| {
        let mut report: Value = serde_json::from_str(line).expect("JSON");
        report[member] = value;
        serde_json::from_value::<Report>(report)
    };
    for (line, member, wrong, what) in [
        (run, "reached", json!("yes"), "a boolean"),
        (run, "collisions", json!(null), "struct Collisions"),
        (run, "skipped_ticks", json!(-1), "u64"),
        (replay, "scans", json!("many"), "u64"),
        (replay, "recording", json!(null), "a string"),
        (replay, "compared", json!({ "exact": true }), "missing field `permits`"),
    ] {
        let error = with(line, member, wrong).expect_err(member).to_string();
        assert!(error.contains(what), "{member}: {error}");
    }
    let unknown = with(replay, "recorded_s", json!(null)).expect("null is read as NaN");
    assert!(unknown.replayed().is_some_and(|replayed| replayed.recorded_s.is_nan() && replayed.compared.is_some()));
}

#[test]
fn what_is_done_is_told_as_it_was() {
    for (done, line) in [
        (Done::default(), r#"{"ok":true}"#),
        (Done { at_ns: Some(71), ..Done::default() }, r#"{"at_ns":71,"ok":true}"#),
        (Done { swap: Some(2), ..Done::default() }, r#"{"ok":true,"swap":2}"#),
        (Done { note: Some("locked".to_owned()), ..Done::default() }, r#"{"note":"locked","ok":true}"#),
    ] {
        assert_eq!(read::<Done>(&format!("{line}\n")), done);
    }
}

/// Every member of a status that may be there, which no one run has.
#[test]
fn a_whole_status_is_told_to_the_byte() {
    let status = Status {
        run: "walk".to_owned(),
        supervisor_pid: 7,
        now_s: 61.0,
        mode: ModeStatus {
            class: ModeClass::Fault,
            reason: Some("boot".to_owned()),
            epoch: 2,
            ready_for_cue: true,
            cue: Some(CueStatus { kind: CueKind::Left, source: CueSource::TurnDone, since_s: 60.5 }),
            active_policy: 1,
        },
        services: vec![ServiceStatus {
            name: "lidar".to_owned(),
            pid: 9,
            state: ServicePhase::Starting,
            incarnation: 2,
            restarts: 1,
            critical: true,
            shadow: false,
            starved_of: Some("world/truth".to_owned()),
        }],
        stream_age_ms: [("lidar/scan".to_owned(), 20.0)].into(),
        published: [("lidar/scan".to_owned(), 3)].into(),
        floor: None,
        no_start_by_voice: None,
        world: Some(WorldStatus {
            robot: [1.0, -2.5, f64::NAN],
            handler: [0.25, 0.0],
            walkers: vec![[4.0, 5.0]],
            distance_m: 12.0,
            collisions: Collisions { robot: 1, handler: 2, hit_by_others: 3 },
            falls: Falls { robot: 0, handler: 1 },
        }),
        attitude: Some("depth".to_owned()),
        locomotion: Some(LocomotionStatus { velocity: [0.5, 0.0, -0.1], limited_by: "none".to_owned(), decision: 11 }),
        said: Some(SaidStatus {
            text: "Ready.".to_owned(),
            at_s: 1.5,
            phase: SpeechPhase::Unheard,
            urgency: Urgency::News,
        }),
        microphone: Some(MicrophoneStatus {
            state: MicrophoneState::WarmingUp,
            level_dbfs: -31.1,
            above_floor_db: 12.5,
            clipped: 0.001,
        }),
        invalid_messages: [("estop".to_owned(), [("supervisor".to_owned(), 4)].into())].into(),
        notes: vec![Note { at_s: 0.0, text: "hello".to_owned() }],
    };
    let line = concat!(
        r#"{"attitude":"depth","invalid_messages":{"estop":{"supervisor":4}},"#,
        r#""locomotion":{"decision":11,"limited_by":"none","velocity":[0.5,0.0,-0.1]},"#,
        r#""microphone":{"above_floor_db":12.5,"clipped":0.0010000000474974513,"level_dbfs":-31.100000381469727,"#,
        r#""state":"warming_up"},"#,
        r#""mode":{"active_policy":1,"class":"fault","cue":{"kind":"left","since_s":60.5,"source":"turn_done"},"#,
        r#""epoch":2,"ready_for_cue":true,"reason":"boot"},"#,
        r#""notes":[{"at_s":0.0,"text":"hello"}],"now_s":61.0,"published":{"lidar/scan":3},"run":"walk","#,
        r#""said":{"at_s":1.5,"phase":"unheard","text":"Ready.","urgency":"news"},"#,
        r#""services":[{"critical":true,"incarnation":2,"name":"lidar","pid":9,"restarts":1,"shadow":false,"#,
        r#""starved_of":"world/truth","state":"starting"}],"#,
        r#""stream_age_ms":{"lidar/scan":20.0},"supervisor_pid":7,"#,
        r#""world":{"collisions":{"handler":2,"hit_by_others":3,"robot":1},"distance_m":12.0,"#,
        r#""falls":{"handler":1,"robot":0},"handler":[0.25,0.0],"#,
        r#""robot":[1.0,-2.5,null],"walkers":[[4.0,5.0]]}}"#,
        "\n"
    );
    assert_eq!(framing::line(&status).expect("JSON"), line);
    // A pose that is not a number does not hide the rest.
    let told = read::<Status>(line);
    assert!(told.world.is_some_and(|world| world.robot[2].is_nan()) && told.microphone == status.microphone);
}

/// And what a later supervisor says in the place of a name that is known.
#[test]
fn names_of_a_later_supervisor_are_unknown_or_told() {
    let with = |line: &str, place: &str| {
        let mut later: Value = serde_json::from_str(line).expect("JSON");
        *later.pointer_mut(place).expect("it is there") = json!("of_tomorrow");
        later
    };
    let run = include_str!("golden/status-run.json");
    let status: Status = serde_json::from_value(with(run, "/services/0/state")).expect("a status");
    assert_eq!((status.services[0].state, status.services[0].state.name()), (ServicePhase::Unknown, "unknown"));
    let policies = with(include_str!("golden/policies.json"), "/swaps/0/state");
    let policies: Policies = serde_json::from_value(policies).expect("policies");
    assert_eq!(policies.swaps[0].state, SwapState::Unknown);
    for closed in ["/mode/class", "/mode/cue/kind", "/mode/cue/source"] {
        let error = serde_json::from_value::<Status>(with(run, closed)).expect_err(closed).to_string();
        assert!(error.contains("unknown variant `of_tomorrow`"), "{closed}: {error}");
    }
}

/// A supervisor outlives an upgrade of the programs that ask it, and may itself be the newer one.
#[test]
fn members_of_a_later_supervisor_are_passed_over() {
    fn with_more<T: DeserializeOwned + PartialEq + std::fmt::Debug>(line: &str) {
        let mut more: Value = serde_json::from_str(line).expect("JSON");
        let plain: T = serde_json::from_value(more.clone()).expect("it is of its type");
        add_members(&mut more);
        assert_eq!(serde_json::from_value::<T>(more).expect("it still is"), plain);
    }
    /// To the object, and to each one in it that has members of fixed names.
    fn add_members(value: &mut Value) {
        if let Value::Object(map) = value {
            let inner = ["mode", "cue", "world", "collisions", "locomotion", "active", "in_force", "clock"];
            inner.into_iter().for_each(|name| map.get_mut(name).into_iter().for_each(add_members));
            let lists = ["services", "stops", "notes", "swaps"];
            let elements = |list: &mut Value| list.as_array_mut().into_iter().flatten().for_each(add_members);
            lists.into_iter().for_each(|name| map.get_mut(name).into_iter().for_each(elements));
            map.insert("of_tomorrow".to_owned(), json!({ "n": [1] }));
        }
    }
    with_more::<Status>(include_str!("golden/status-run.json"));
    with_more::<Why>(include_str!("golden/why.json"));
    with_more::<Policies>(include_str!("golden/policies.json"));
    with_more::<Report>(include_str!("golden/report-run.json"));
    with_more::<Report>(include_str!("golden/report-replay.json"));
    with_more::<Done>(r#"{"ok":true,"swap":1}"#);
    with_more::<Stop>(concat!(
        r#"{"at_s":0.0,"class":"latched","ended":true,"lasted_s":1.0,"reason":"x","#,
        r#""service":null,"stream":null,"why":"x"}"#
    ));
    assert_eq!(PolicyLife::default().says("engine"), None);
}
