//! The newest scan and depth frame, each brought from where the robot was then to where it is now, and the memory of
//! what was before.

use messages::{DepthHeader, Header, NS_PER_S, Outcome, ScanHeader, SecondScanHeader, Twist2, age_ns};

use super::plausible::{Repeats, Succession};
use crate::depth::{DepthError, DepthView};
use crate::handler::HandlerBody;
use crate::memory::{Memory, MemoryConfig};
use crate::scan::Beams;
use crate::se2::{Point, Se2};
use crate::second::SecondView;
use crate::shield::Evidence;
use crate::track::{Held, PoseTrack};

/// A frame waits for the attitude after its stamp up to this age, nanoseconds. Without it the sway is extrapolated.
const WAIT_MAX_NS: u64 = NS_PER_S / 20;

/// A depth frame that waits for the attitude after its stamp.
#[derive(Debug, Clone, Default)]
struct Waiting {
    header: Option<DepthHeader>,
    pixels_mm: Vec<u16>,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Surroundings {
    /// The newest scan in the robot frame of its stamp, and the same seen from where the robot is now, if it has moved
    /// since.
    stamped_beams: Beams,
    moved_beams: Beams,
    has_moved: bool,
    /// Its ranges over the level floor, in the lidar's order, metres; empty where the body was level.
    level_ranges_m: Vec<f32>,
    scan: Option<Header>,
    scan_usable: bool,
    /// The source of attitudes has none for the time of the newest scan.
    attitude_missing: bool,
    waiting: Waiting,
    /// Frames that could not be used.
    refused_frames: u64,
    depth: DepthView,
    depth_header: Option<DepthHeader>,
    depth_usable: bool,
    /// Next to no pixel of the newest frame says anything.
    depth_blind: bool,
    /// The least depth that the camera sees, metres.
    depth_min_m: f64,
    depth_max_age_ns: u64,
    second: SecondView,
    second_header: Option<Header>,
    second_usable: bool,
    second_repeats: Repeats,
    memory: Option<Memory>,
    scan_repeats: Repeats,
    depth_repeats: Repeats,
    succession: Succession,
    /// The newest scan contradicts what was seen before.
    contradicts: bool,
}

impl Surroundings {
    /// Nothing seen yet; without a memory one scan and one frame decide alone.
    pub fn new(memory: Option<MemoryConfig>, depth_max_age_ns: u64, depth_min_m: f64) -> Self {
        Self {
            stamped_beams: Beams::default(),
            moved_beams: Beams::default(),
            has_moved: false,
            level_ranges_m: Vec::new(),
            scan: None,
            scan_usable: false,
            attitude_missing: false,
            waiting: Waiting::default(),
            refused_frames: 0,
            depth: memory
                .as_ref()
                .and_then(|memory| memory.footing)
                .map_or_else(DepthView::default, |footing| DepthView::with_steps(footing.step_max)),
            depth_header: None,
            depth_usable: false,
            depth_blind: false,
            depth_min_m,
            depth_max_age_ns,
            second: SecondView::default(),
            second_header: None,
            second_usable: false,
            second_repeats: Repeats::default(),
            memory: memory.map(Memory::new),
            scan_repeats: Repeats::default(),
            depth_repeats: Repeats::default(),
            succession: Succession::default(),
            contradicts: false,
        }
    }

    /// Takes in a scan: whether it can be used. The robot was on that track.
    pub fn take_scan(&mut self, header: &ScanHeader, ranges_m: &[f32], track: &PoseTrack) -> bool {
        let held = track.held_at(header.header.stamp_ns);
        self.attitude_missing = held.is_none();
        self.scan_usable = self.stamped_beams.fill(header, ranges_m).is_ok() && held.is_some();
        self.level_ranges_m.clear();
        if let Some(tilt) = held.as_ref().and_then(Held::tilt) {
            self.stamped_beams.level(tilt, header.height_m);
            self.stamped_beams.ranges_m(&mut self.level_ranges_m);
        }
        if self.scan.is_none_or(|last| last.incarnation != header.header.incarnation) {
            self.succession.lose_place();
        }
        if let Some(odom_from_robot) = track.at(header.header.stamp_ns) {
            self.scan_repeats.take_scan(ranges_m, &odom_from_robot);
            self.contradicts = self.scan_usable && self.succession.contradicts(&self.stamped_beams, &odom_from_robot);
        }
        self.scan = Some(header.header);
        self.scan_usable
    }

    /// Takes in a depth frame, or lets it wait until the attitude after its stamp is on the track, where the frame
    /// before is young enough to be judged on meanwhile. One that waits already is looked at first.
    pub fn take_depth(&mut self, header: &DepthHeader, pixels_mm: &[u16], track: &PoseTrack) {
        self.look_at_once(track);
        let stamp_ns = header.header.stamp_ns;
        let before = self.depth_header.filter(|_| self.depth_usable).map_or(0, |before| before.header.stamp_ns);
        let is_young = age_ns(stamp_ns.saturating_add(WAIT_MAX_NS), before) <= self.depth_max_age_ns;
        if is_young && track.awaits_attitude(stamp_ns) {
            self.waiting.header = Some(*header);
            self.waiting.pixels_mm.clear();
            self.waiting.pixels_mm.extend_from_slice(pixels_mm);
        } else {
            self.look(header, pixels_mm, track);
        }
    }

    /// Looks at the frame that waits, where its attitude has come or it has waited for long enough.
    pub fn look_late(&mut self, now_ns: u64, track: &PoseTrack) {
        let due = |stamp_ns| !track.awaits_attitude(stamp_ns) || age_ns(now_ns, stamp_ns) > WAIT_MAX_NS;
        if self.waiting.header.is_some_and(|header| due(header.header.stamp_ns)) {
            self.look_at_once(track);
        }
    }

    /// Looks at the frame that waits, if one does.
    pub fn look_at_once(&mut self, track: &PoseTrack) {
        if let Some(header) = self.waiting.header.take() {
            let pixels_mm = std::mem::take(&mut self.waiting.pixels_mm);
            self.look(&header, &pixels_mm, track);
            self.waiting.pixels_mm = pixels_mm;
        }
    }

    fn look(&mut self, header: &DepthHeader, pixels_mm: &[u16], track: &PoseTrack) {
        if let Some(odom_from_robot) = track.at(header.header.stamp_ns) {
            self.depth_repeats.take_depth(pixels_mm, &odom_from_robot);
        }
        let placed = self.memory.as_ref().zip(track.at(header.header.stamp_ns));
        let known = placed.as_ref().map(|(memory, odom_from_robot)| memory.low_steps_from(odom_from_robot));
        self.depth.expect_steps(known.into_iter().flatten());
        // Without the attitude, floor cannot be told from obstacles.
        let held = track.held_at(header.header.stamp_ns);
        let tilt = held.as_ref().and_then(Held::tilt);
        let was_floor =
            |place: Point| placed.as_ref().is_some_and(|(memory, odom)| memory.has_seen_floor_at(odom * place));
        let filled = self.depth.fill_remembering(header, pixels_mm, tilt, was_floor);
        self.depth_usable = filled.is_ok() && held.is_some();
        self.depth_blind = matches!(filled, Err(DepthError::Blind { .. }));
        self.depth_header = Some(*header);
        self.refused_frames += u64::from(!self.depth_usable);
    }

    /// Takes in a scan of the second lidar.
    pub fn take_second(
        &mut self,
        header: &SecondScanHeader,
        ranges_m: &[f32],
        track: &PoseTrack,
        handler: Option<&HandlerBody>,
    ) {
        let stamp_ns = header.header.stamp_ns;
        let held = track.held_at(stamp_ns);
        let tilt = held.as_ref().and_then(Held::tilt);
        self.second_usable = self.second.fill(header, ranges_m, tilt).is_ok() && held.is_some();
        if let Some(odom_from_robot) = track.at(stamp_ns) {
            self.second_repeats.take_scan(ranges_m, &odom_from_robot);
            let is_usable = self.second_usable && !self.second_repeats.is_stuck();
            if let Some(memory) = self.memory.as_mut().filter(|_| is_usable) {
                memory.update_second(stamp_ns, &odom_from_robot, &self.second, handler);
            }
        }
        self.second_header = Some(header.header);
    }

    /// The second lidar's newest scan, where it may be judged on.
    pub fn second(&self) -> Option<Header> {
        self.second_header.filter(|_| self.second_usable && !self.second_repeats.is_stuck())
    }

    /// The odometry frame is a new one: what was remembered has no place in it, but for the floor about a robot that
    /// stands there (`standing`).
    pub fn lose_place(&mut self, standing: Option<&Se2>) {
        self.waiting.header = None;
        self.scan_repeats.lose_place();
        self.depth_repeats.lose_place();
        self.second_repeats.lose_place();
        self.succession.lose_place();
        self.contradicts = false;
        match (&mut self.memory, standing) {
            (Some(memory), Some(odom_from_robot)) => memory.anchor(odom_from_robot),
            (Some(memory), None) => memory.clear(),
            (None, _) => {}
        }
    }

    /// Scan and frame were taken a while ago, and the robot has moved on. Where its place of then is unknown, they say
    /// nothing about now.
    pub fn move_to(&mut self, now_ns: u64, odom_from_robot: &Se2, track: &PoseTrack) {
        let then_in_now = |header: Header| {
            let then = track.at(header.stamp_ns)?;
            // Without rounding where it has not moved: what is judged on stays in the lidar's own layout.
            Some(if then == *odom_from_robot { Se2::identity() } else { odom_from_robot.inverse() * then })
        };
        if let Some(header) = self.scan {
            match then_in_now(header) {
                Some(shift) => {
                    self.has_moved = shift != Se2::identity();
                    if self.has_moved {
                        self.stamped_beams.seen_from(&shift, &mut self.moved_beams);
                    }
                }
                None => self.scan_usable = false,
            }
        }
        if let Some(header) = self.depth_header {
            match then_in_now(header.header) {
                Some(shift) => self.depth.move_to(&shift),
                None => self.depth_usable = false,
            }
        }
        if let Some(header) = self.second_header {
            match then_in_now(header) {
                Some(shift) => self.second.move_to(&shift),
                None => self.second_usable = false,
            }
        }
        if let Some(memory) = &mut self.memory {
            memory.move_to(now_ns, odom_from_robot);
        }
    }

    /// Remembers the newest scan, of that stamp, and frame.
    pub fn remember(&mut self, now_ns: u64, stamp_ns: u64, odom_from_robot: &Se2, handler: Option<&HandlerBody>) {
        let depth = self.depth_is_fresh(now_ns).then_some(&self.depth);
        let beams = if self.has_moved { &self.moved_beams } else { &self.stamped_beams };
        if let Some(memory) = &mut self.memory {
            memory.update(stamp_ns, odom_from_robot, beams, depth, handler);
        }
    }

    /// The handler allows the low step at a place (odometry frame).
    pub fn allow_step(&mut self, place: Point) {
        if let Some(memory) = &mut self.memory {
            memory.allow_step(place);
        }
    }

    /// The handler allows no low step any more.
    pub fn allow_no_step(&mut self) {
        if let Some(memory) = &mut self.memory {
            memory.allow_no_step();
        }
    }

    /// The robot was to move by `begin_from_end` from where it was, and did not get there.
    pub fn feel(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2) {
        if let Some(memory) = &mut self.memory {
            memory.feel(odom_from_begin, begin_from_end);
        }
    }

    /// What is judged on now, of a robot that moves so.
    pub fn evidence(&self, now_ns: u64, moves: Twist2) -> Evidence<'_> {
        let depth = self.depth_is_fresh(now_ns).then_some(&self.depth);
        let second = self.second().map(|_| &self.second);
        Evidence { beams: self.beams(), depth, second, memory: self.memory.as_ref(), moves }
    }

    /// The ranges of the newest scan over the level floor, metres, where the body was tilted.
    pub fn level_ranges_m(&self) -> Option<&[f32]> {
        (!self.level_ranges_m.is_empty()).then_some(&self.level_ranges_m[..])
    }

    /// The newest scan, from where the robot is now.
    pub fn beams(&self) -> &Beams {
        if self.has_moved { &self.moved_beams } else { &self.stamped_beams }
    }

    /// The newest scan's header, usable or not.
    pub fn scan(&self) -> Option<Header> {
        self.scan
    }

    /// The newest scan's header, where it can be used.
    pub fn usable_scan(&self) -> Option<Header> {
        self.scan.filter(|_| self.scan_usable)
    }

    /// Whether the newest scan cannot be used because the attitude at its time is unknown.
    pub fn attitude_is_missing(&self) -> bool {
        self.attitude_missing
    }

    /// The newest depth frame's header.
    pub fn depth(&self) -> Option<Header> {
        self.depth_header.map(|header| header.header)
    }

    /// What is implausible about the newest scan, if anything.
    pub fn implausible_scan(&self) -> Option<Outcome> {
        match (self.scan_repeats.is_stuck(), self.contradicts) {
            (true, _) => Some(Outcome::StuckScan),
            (_, true) => Some(Outcome::ScanContradicts),
            _ => None,
        }
    }

    /// Depth frames so far that could not be used.
    pub fn refused_frames(&self) -> u64 {
        self.refused_frames
    }

    /// Whether depth frames are the same again and again.
    pub fn depth_is_stuck(&self) -> bool {
        self.depth_repeats.is_stuck()
    }

    /// Whether the newest depth frame may be judged on: an old one neither excuses nor forbids anything. One that
    /// sees nothing may where the lidar tells why, and adds nothing; otherwise something covers the camera.
    pub fn depth_is_fresh(&self, now_ns: u64) -> bool {
        let Some(header) = self.depth_header else { return false };
        let is_young = age_ns(now_ns, header.header.stamp_ns) <= self.depth_max_age_ns;
        let before = || self.depth_blind && self.scan_usable && self.stands_before_something(&header);
        is_young && !self.depth_is_stuck() && (self.depth_usable || before())
    }

    fn stands_before_something(&self, header: &DepthHeader) -> bool {
        DepthView::stands_before_something(header, self.depth_min_m, self.beams())
    }
}

#[cfg(test)]
mod tests {
    use super::Surroundings;
    use crate::track::PoseTrack;
    use messages::{Attitude, DepthHeader, Header, Odometry, Pose3};

    const MS: u64 = 1_000_000;

    fn told(track: &mut PoseTrack, ms: u64) {
        let header = Header { stamp_ns: ms * MS, ..Header::default() };
        let attitude = Attitude::at_height(ms * MS, 0.0, 0.0, 0.3);
        track.push(&Odometry { header, attitude, ..Odometry::default() });
    }

    fn take(surroundings: &mut Surroundings, ms: u64, track: &PoseTrack) {
        let header = DepthHeader {
            header: Header { stamp_ns: ms * MS, seq: ms, ..Header::default() },
            width: 8,
            height: 6,
            fx_px: 8.0,
            fy_px: 8.0,
            robot_from_camera: Pose3 { z_m: 0.4, ..Pose3::default() },
            ..DepthHeader::default()
        };
        // The floor, under a wall 3 m ahead.
        let pixels_mm: Vec<u16> = (0..48).map(|i| (3200 / (i / 8).max(1)).min(3000)).collect();
        surroundings.take_depth(&header, &pixels_mm, track);
    }

    #[test]
    fn a_frame_waits_for_the_attitude_after_its_stamp_and_no_longer_than_that_may_take() {
        let (mut surroundings, mut track) = (Surroundings::new(None, 200 * MS, 0.2), PoseTrack::default());
        let seen_ms = |surroundings: &Surroundings| surroundings.depth().map(|header| header.stamp_ns / MS);
        take(&mut surroundings, 1000, &track);
        assert_eq!(seen_ms(&surroundings), Some(1000), "no source tells any");
        told(&mut track, 1020);
        take(&mut surroundings, 1030, &track);
        surroundings.look_late(1040 * MS, &track);
        assert_eq!(seen_ms(&surroundings), Some(1000));
        told(&mut track, 1040);
        surroundings.look_late(1045 * MS, &track);
        assert_eq!(seen_ms(&surroundings), Some(1030));
        // The source is late, or silent.
        take(&mut surroundings, 1060, &track);
        surroundings.look_late(1110 * MS, &track);
        assert_eq!(seen_ms(&surroundings), Some(1030));
        surroundings.look_late(1111 * MS, &track);
        assert_eq!(seen_ms(&surroundings), Some(1060));
        // The next frame does not push one out that nothing has looked at.
        take(&mut surroundings, 1090, &track);
        take(&mut surroundings, 1120, &track);
        assert_eq!(seen_ms(&surroundings), Some(1090));
        surroundings.look_at_once(&track);
        assert_eq!(seen_ms(&surroundings), Some(1120));
        // Nothing else can be judged on.
        take(&mut surroundings, 1290, &track);
        assert_eq!(seen_ms(&surroundings), Some(1290));
        // A new odometry frame has no place for it.
        told(&mut track, 1290);
        take(&mut surroundings, 1300, &track);
        take(&mut surroundings, 1310, &track);
        surroundings.lose_place(None);
        surroundings.look_at_once(&track);
        assert_eq!(seen_ms(&surroundings), Some(1300));
    }
}
