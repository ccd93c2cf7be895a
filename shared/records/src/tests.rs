use std::io::Write;
use std::path::Path;
use std::time::Duration;

use control::Report;
use serde_json::json;

use crate::{About, End, Keep, Record, past, wall_time};

const KEEP: Keep = Keep { runs: 3, bytes: 1 << 20 };

fn begin(root: &Path, second: u32) -> Record {
    let started = format!("2026-11-29T10:00:{second:02}Z");
    let about = About { started, ..About::now("demo", "1.0") };
    Record::begin(root, &about, "[lidar]\n", KEEP).expect("begun")
}

#[test]
fn a_record_is_live_then_ended_or_died() {
    let root = tempfile::tempdir().expect("a folder");
    let record = begin(root.path(), 1);
    let only = || past::in_root(root.path()).pop().expect("there is one");
    assert!(only().is_live());
    let mut events = record.events().expect("made");
    let died = json!({ "event": "stop", "number": 0, "why": "lidar died", "class": "fault" });
    let over = json!({ "event": "stop_over", "number": 0, "lasted_s": 1.0 });
    let tilted = json!({ "event": "stop", "number": 1, "why": "tilted", "class": "lock" });
    for (run_s, more) in [(2.0, died), (3.0, over), (4.0, tilted), (6.5, json!({ "event": "note" }))] {
        let mut line = json!({ "timestamp": "t", "level": "INFO", "message": "m", "run_s": run_s });
        line.as_object_mut().expect("one").extend(more.as_object().expect("one").clone());
        writeln!(events, "{line}").expect("written");
    }
    drop(record);
    let run = only();
    assert!(matches!(run.end, End::Died { rebooted: false, .. }), "{run:?}");
    assert!(run.ended().expect("ended").starts_with("supervisor killed, last heard 2"));
    let stops = run.stops().expect("read");
    let told: Vec<_> = stops.iter().map(|stop| (stop.why.as_str(), stop.at_s, stop.lasted_s, stop.ended)).collect();
    assert_eq!(told, [("lidar died", 2.0, 1.0, true), ("tilted", 4.0, 2.5, false)]);
    assert_eq!(run.notes().expect("read").len(), 1);

    let record = begin(root.path(), 2);
    record
        .end(&Report { duration_s: 7.0, failure: Some("the disk is full".to_owned()), ..Report::default() })
        .expect("ended");
    drop(record);
    let run = past::in_root(root.path()).swap_remove(0);
    assert_eq!((run.ended().as_deref(), run.lasted_s()), (Some("the disk is full"), 7.0));
}

#[test]
fn the_newest_records_are_kept_and_live_ones_always() {
    let root = tempfile::tempdir().expect("a folder");
    let live = begin(root.path(), 0);
    for second in 1..6 {
        drop(begin(root.path(), second));
    }
    let ids: Vec<String> = past::in_root(root.path()).into_iter().map(|run| run.id).collect();
    let kept = |second: u32| format!("{:06}-20261129T1000{second:02}Z-demo", second + 1);
    // The live one is beyond the number and stays.
    assert_eq!(ids, [kept(5), kept(4), kept(3), kept(0)]);
    // A clock that goes back changes no order.
    drop(begin(root.path(), 0));
    assert_eq!(past::in_root(root.path())[0].id, "000007-20261129T100000Z-demo");
    // The newest that ended stays however large it is, and takes the room of those before it.
    std::fs::write(past::in_root(root.path())[0].folder.join("logs/lidar.1.log"), vec![0; 2 << 20]).expect("written");
    drop(begin(root.path(), 7));
    let ids: Vec<String> = past::in_root(root.path()).into_iter().map(|run| run.id).collect();
    assert_eq!(ids, [kept(7), "000007-20261129T100000Z-demo".to_owned(), kept(0)]);
    drop(live);
}

#[test]
fn what_a_supervisor_left_that_died_too_early_is_removed_and_what_is_in_the_making_stays() {
    let root = tempfile::tempdir().expect("a folder");
    let runs = root.path().join("runs");
    for (name, age_s) in [("000001-old", 120), ("000002-new", 0)] {
        let folder = runs.join(name);
        std::fs::create_dir_all(&folder).expect("made");
        std::fs::write(folder.join("lock"), "").expect("written");
        let opened = std::fs::File::open(&folder).expect("it is there");
        opened.set_modified(wall_time() - Duration::from_secs(age_s)).expect("ours");
    }
    let _live = begin(root.path(), 0);
    assert!(!runs.join("000001-old").exists() && runs.join("000002-new").exists());
}
