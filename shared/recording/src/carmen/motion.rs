//! The odometry stream of a log.

use messages::{Attitude, Header, Odometry, Pose2, Twist2, s_from_ns};

use super::line::wrapped;
use super::survey::Entry;

/// An ODOM line nearer to a scan is left out.
const NEAR_NS: u64 = 50_000_000;

/// A velocity from poses is over so long, at least: logs repeat a pose and then make up for it.
const BASELINE_NS: u64 = 300_000_000;

/// A velocity reported is worth nothing any more after so long.
const REPORT_NS: u64 = 1_000_000_000;

/// A pose at a time.
#[derive(Clone, Copy)]
struct Fix {
    stamp_ns: u64,
    pose: Pose2,
    twist: Twist2,
}

/// The odometry records in the order of their stamps, which are those of `entries`, and how many ODOM lines were left
/// out.
pub fn odometry(entries: &[Entry], stamps_ns: &[u64]) -> (Vec<Odometry>, u64) {
    let fixes = |laser: bool| -> Vec<Fix> {
        let of_kind = entries.iter().zip(stamps_ns).filter(|(entry, _)| entry.laser == laser);
        of_kind.map(|(entry, &stamp_ns)| Fix { stamp_ns, pose: entry.pose, twist: entry.twist }).collect()
    };
    let (mut odom, mut scans) = (fixes(false), fixes(true));
    if odom.iter().all(|fix| fix.twist.is_zero()) {
        add_twists(&mut odom);
    }
    add_twists(&mut scans);
    take_twists(&mut scans, &odom);
    let before = odom.len();
    odom.retain(|fix| !is_near(&scans, fix.stamp_ns));
    let left_out = before - odom.len();
    odom.append(&mut scans);
    odom.sort_by_key(|fix| fix.stamp_ns);
    let record = |(fix, seq): (Fix, u64)| Odometry {
        header: Header { stamp_ns: fix.stamp_ns, seq, step: 0, published_ns: 0, incarnation: 1, reserved: 0 },
        odom_from_robot: fix.pose,
        twist: fix.twist,
        sigma: [0.0; 3],
        attitude: Attitude::default(),
    };
    (odom.into_iter().zip(1..).map(record).collect(), left_out as u64)
}

fn is_near(scans: &[Fix], stamp_ns: u64) -> bool {
    let after = scans.partition_point(|scan| scan.stamp_ns < stamp_ns);
    let near = |scan: Option<&Fix>| scan.is_some_and(|scan| scan.stamp_ns.abs_diff(stamp_ns) < NEAR_NS);
    near(scans.get(after)) || near(after.checked_sub(1).and_then(|before| scans.get(before)))
}

/// Velocities from the poses: to each from the newest that is old enough, or the first.
fn add_twists(fixes: &mut [Fix]) {
    let mut from = 0;
    for to in 1..fixes.len() {
        while from + 1 < to && fixes[to].stamp_ns - fixes[from + 1].stamp_ns >= BASELINE_NS {
            from += 1;
        }
        fixes[to].twist = twist_between(&fixes[from], &fixes[to]);
    }
}

/// The mean velocity from one pose to a later one, in the robot's frame half-way; zero where there is hardly any time
/// between them.
fn twist_between(from: &Fix, to: &Fix) -> Twist2 {
    let seconds = s_from_ns(to.stamp_ns.saturating_sub(from.stamp_ns));
    if seconds < 0.01 {
        return Twist2::ZERO;
    }
    let turned_rad = wrapped(to.pose.yaw_rad - from.pose.yaw_rad);
    let (sin, cos) = (from.pose.yaw_rad + 0.5 * turned_rad).sin_cos();
    let (x_m, y_m) = (to.pose.x_m - from.pose.x_m, to.pose.y_m - from.pose.y_m);
    Twist2 {
        vx_mps: (cos * x_m + sin * y_m) / seconds,
        vy_mps: (cos * y_m - sin * x_m) / seconds,
        wz_radps: turned_rad / seconds,
    }
}

/// Gives the scans the velocity of the newest ODOM line, where one is new enough.
fn take_twists(scans: &mut [Fix], odom: &[Fix]) {
    for scan in scans {
        let after = odom.partition_point(|fix| fix.stamp_ns <= scan.stamp_ns);
        let newest = after.checked_sub(1).and_then(|newest| odom.get(newest));
        if let Some(newest) = newest.filter(|newest| scan.stamp_ns - newest.stamp_ns <= REPORT_NS) {
            scan.twist = newest.twist;
        }
    }
}
