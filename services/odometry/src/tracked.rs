//! Poses of a tracking camera: where it looks is no matter of the floor's plane, so it is laid onto it here.

mod planar;

use grabber::realsense::{Tracked, TrackingCamera};
use grabber::{Grabbed, Grabber};
use messages::{Attitude, NS_PER_S, Odometry, Pose2, Pose3, s_from_ns};
use settings::Settings;
use transport::{FromChild, Io, TransportError};

use crate::PoseSource;
use planar::{Planar, planar};

/// Of [`Io::watch`].
const TOKEN_GRABBER: u64 = 0;
/// A camera that said nothing for so long may have been switched off and on, and counts anew then, nanoseconds.
const AWAY_NS: u64 = NS_PER_S;
/// Nobody walks or turns faster, metres and radians per second: a camera that recognises where it is jumps there.
const PACE_MAX: [f64; 2] = [3.0, 4.0];
/// Within that a pose may stand off by its noise, metres and radians.
const NOISE_MAX: [f64; 2] = [0.05, 0.05];
/// Its maker's word: one standard deviation of the place after 1 m of way, metres; of the heading likewise, radians.
const SIGMA: [f64; 2] = [0.01, 0.005];
/// Where it is less sure, by its confidence from 1 to 3; not measured.
const LESS_SURE: [f64; 3] = [4.0, 2.0, 1.0];

/// Poses of a T265.
pub struct TrackedOdometry {
    grabber: Grabber<Tracked>,
    robot_from_camera: Pose3,
    body_height_m: f64,
    /// The last pose and when it was, nanoseconds of run time.
    last: Option<(u64, Pose2)>,
    way_m: f64,
    /// The last thing told, which is not told again.
    told: String,
}

impl TrackedOdometry {
    /// Starts the thread, which opens the camera. One that is not there is no reason to end: without poses nothing
    /// moves, and the operator is told what is missing.
    ///
    /// # Errors
    /// Where there can be no thread.
    pub fn open(settings: &Settings, io: &Io) -> Result<Self, TransportError> {
        let odometry = &settings.odometry;
        let wanted = odometry.t265.clone();
        let grabber = Grabber::start(move || TrackingCamera::open(&wanted)).map_err(TransportError::service)?;
        io.watch(&grabber, TOKEN_GRABBER)?;
        let (robot_from_camera, body_height_m) = (odometry.robot_from_camera, settings.robot.body_height_m.get());
        Ok(Self { grabber, robot_from_camera, body_height_m, last: None, way_m: 0.0, told: String::new() })
    }

    fn tell(&mut self, io: &Io, text: String) {
        if self.told != text {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told = text;
        }
    }

    /// What it says, laid onto the floor; nothing where it is lost.
    fn pose(&mut self, io: &Io, tracked: &Tracked) -> Result<Option<(u64, Odometry)>, TransportError> {
        let stamp_ns = io.domain.clock.of_monotonic_ns(tracked.taken_ns);
        if tracked.confidence == 0 {
            self.tell(io, "the tracking camera is lost: is it covered, or in the dark?".to_owned());
            return Ok(None);
        }
        let Some(Planar { pose, twist, roll_rad, pitch_rad }) = planar(tracked, self.robot_from_camera) else {
            self.tell(io, "the tracking camera tells no numbers, or looks to the floor or the sky".to_owned());
            return Ok(None);
        };
        if let Some((last_ns, last)) = self.last {
            if stamp_ns <= last_ns {
                return Ok(None);
            }
            self.way_m += goes_on(&last, &pose, stamp_ns - last_ns)?;
        }
        self.last = Some((stamp_ns, pose));
        let less_sure = LESS_SURE[(tracked.confidence as usize - 1).min(2)];
        let place = less_sure * SIGMA[0] * self.way_m;
        let sigma = [place, place, less_sure * SIGMA[1] * self.way_m.sqrt()];
        let attitude = Attitude::at_height(stamp_ns, roll_rad, pitch_rad, self.body_height_m);
        Ok(Some((stamp_ns, Odometry { odom_from_robot: pose, twist, sigma, attitude, ..Odometry::default() })))
    }
}

/// The way from one pose to the next, metres.
///
/// # Errors
/// Where nobody can have walked it: it is another frame then, and so a life of its own, which everybody notices.
fn goes_on(last: &Pose2, pose: &Pose2, for_ns: u64) -> Result<f64, TransportError> {
    let seconds = s_from_ns(for_ns);
    let way_m = (pose.x_m - last.x_m).hypot(pose.y_m - last.y_m);
    let turn_rad = (pose.yaw_rad - last.yaw_rad).rem_euclid(std::f64::consts::TAU);
    let turn_rad = turn_rad.min(std::f64::consts::TAU - turn_rad);
    if for_ns > AWAY_NS {
        let text = format!("the tracking camera was silent for {seconds:.1} s, and may count anew: so does odometry");
        return Err(TransportError::Service(text));
    }
    let most = [0, 1].map(|i| NOISE_MAX[i] + PACE_MAX[i] * seconds);
    if way_m > most[0] || turn_rad > most[1] {
        let text = format!("the tracking camera jumped by {way_m:.2} m and {turn_rad:.2} rad: odometry begins anew");
        return Err(TransportError::Service(text));
    }
    Ok(way_m)
}

impl PoseSource for TrackedOdometry {
    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    fn poll(&mut self, io: &Io) -> Result<Option<(u64, Odometry)>, TransportError> {
        while let Some(grabbed) = self.grabber.take() {
            match grabbed {
                Grabbed::Opened(about) if self.last.is_none() => self.tell(io, about),
                Grabbed::Opened(_) => {
                    let text = "the tracking camera was opened anew, and counts anew: so does odometry".to_owned();
                    return Err(TransportError::Service(text));
                }
                Grabbed::Item(tracked) => {
                    if let Some(pose) = self.pose(io, &tracked)? {
                        return Ok(Some(pose));
                    }
                }
                Grabbed::Lost(trouble) => self.tell(io, format!("no poses: {trouble}")),
            }
        }
        if self.grabber.is_stuck() {
            // Only a new process is rid of it.
            return Err(TransportError::Service("the camera's library hangs".to_owned()));
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::{AWAY_NS, goes_on};
    use messages::Pose2;

    #[test]
    fn who_walks_goes_on_and_who_jumps_or_was_away_begins_anew() {
        let at = Pose2::new(1.0, 2.0, 3.1);
        // Over half a turn the heading goes on from the other side.
        let on = goes_on(&at, &Pose2::new(1.02, 2.0, -3.1), 20_000_000).expect("a step");
        assert!((on - 0.02).abs() < 1e-9);
        for (pose, for_ns, told) in [
            (Pose2::new(1.3, 2.0, 3.1), 20_000_000, "jumped by 0.30 m"),
            (Pose2::new(1.0, 2.0, 2.5), 20_000_000, "and 0.60 rad"),
            (at, AWAY_NS + 1, "silent for 1.0 s"),
        ] {
            let why = goes_on(&at, &pose, for_ns).expect_err(told).to_string();
            assert!(why.contains(told), "{why}");
        }
    }
}
