//! A short way through the fault matrix, on the real processes; `guidedog bench faults` goes the whole of it.

use guidedog_tests::Place;

/// Every death, every way to hang, every fault of the two streams that nothing moves without, and of each other stream
/// the fault that only a check of its own can see; and of the lines to emulated devices what is worst.
const CELLS: &str = "*:kill,lidar:hang,policy:hang,locomotion:hang,supervisor:hang,lidar:exit_on_start,lidar/scan:*,\
                     lidar/second:off,odometry:*,depth/frame:stuck_bytes,shield/permit:wrong,\
                     shield/permit:stuck_bytes,mode:garbage,\
                     policy/action:garbage,health/shield:off,locomotion/state:garbage,line/lidar:unplugged,\
                     line/robot:silent,line/robot:loss,line/robot:remote_stop,line/estop:*,line/camera:*";

/// The limits are a quiet machine's; on a shared one only their order of magnitude is tested.
const SLACK: &str = "20";

#[test]
fn what_the_matrix_wants_comes_of_every_fault() {
    let place = Place::new();
    let (report, code) = place.json(&["bench", "faults", "--cells", CELLS, "--slack", SLACK, "--json"]);
    let cells = report["cells"].as_array().unwrap_or_else(|| panic!("no cells: {report:#}"));
    assert!(cells.len() >= 50, "{}", cells.len());
    for cell in cells {
        assert_eq!((cell["n"].as_u64(), &cell["met"]), (Some(1), &true.into()), "{cell:#}");
    }
    assert_eq!(code, 0);
    assert_eq!((&report["kills"]["n"], &report["kills_large"]["n"]), (&10.into(), &2.into()));
    place.assert_empty();
}
