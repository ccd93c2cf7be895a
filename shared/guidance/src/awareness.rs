//! What is known of the surroundings when a decision is made: the newest scan and depth frame, what was seen before,
//! and where the handler is. One sequence of steps, for whoever decides: the policy service and episodes. The shield
//! service has one of its own from the same parts, for it judges between decisions as well.

use messages::{DepthHeader, ScanHeader, Twist2};

use crate::contact::comes_about;
use crate::depth::DepthView;
use crate::handler::{HandlerEstimate, HandlerLimits};
use crate::interaction::InteractionModel;
use crate::memory::{Memory, MemoryConfig};
use crate::scan::{Beams, ScanError};
use crate::se2::Se2;
use crate::shield::Evidence;
use crate::tilt::Tilt;

/// A frame of a sensor, and where the robot was when it was taken, in the robot frame of now.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a, Header, Sample> {
    /// Stands beside the samples.
    pub header: &'a Header,
    /// The samples.
    pub data: &'a [Sample],
    /// Where the robot was then.
    pub now_from_then: Se2,
    /// How its body was held then, where that is known.
    pub tilt: Option<Tilt>,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Awareness {
    /// In the robot frame of the scan's stamp, and seen from where the robot is now.
    stamped_beams: Beams,
    beams: Beams,
    /// Of the scan over the level floor, where the body tilted.
    ranges_m: Vec<f32>,
    depth: DepthView,
    depth_seen: bool,
    memory: Option<Memory>,
    handler: HandlerEstimate,
    moves: Twist2,
}

impl Awareness {
    /// Nothing known yet; without a memory one scan and one frame are all that is known.
    #[must_use]
    pub fn new(model: InteractionModel, limits: HandlerLimits, memory: Option<MemoryConfig>) -> Self {
        Self {
            stamped_beams: Beams::default(),
            beams: Beams::default(),
            ranges_m: Vec::new(),
            depth: DepthView::default(),
            depth_seen: false,
            memory: memory.map(Memory::new),
            handler: HandlerEstimate::new(model, limits),
            moves: Twist2::ZERO,
        }
    }

    /// Robot and handler stand at rest there, however they came there.
    pub fn rest(&mut self, odom_from_robot: &Se2) {
        self.moves = Twist2::ZERO;
        self.handler.reset(odom_from_robot);
    }

    /// A new odometry frame: nothing that was placed in the one before holds any more.
    pub fn reset(&mut self, odom_from_robot: &Se2) {
        self.rest(odom_from_robot);
        self.depth_seen = false;
        if let Some(memory) = &mut self.memory {
            memory.clear();
        }
    }

    /// Takes in what was measured; `share` of the running step has passed. With scan and frame stands where the robot
    /// was then, in the robot frame of now. A depth frame that cannot be used says nothing.
    ///
    /// # Errors
    /// Where the scan cannot be used; then nothing was taken in.
    pub fn observe(
        &mut self,
        now_ns: u64,
        odom_from_robot: &Se2,
        share: f64,
        scan: Measured<'_, ScanHeader, f32>,
        depth: Option<Measured<'_, DepthHeader, u16>>,
    ) -> Result<(), ScanError> {
        self.stamped_beams.fill(scan.header, scan.data)?;
        self.ranges_m.clear();
        if let Some(tilt) = &scan.tilt {
            self.stamped_beams.level(tilt, scan.header.height_m);
            self.stamped_beams.ranges_m(&mut self.ranges_m);
        }
        self.stamped_beams.seen_from(&scan.now_from_then, &mut self.beams);
        self.depth_seen = depth.is_some_and(|depth| {
            let usable = self.depth.fill_tilted(depth.header, depth.data, depth.tilt.as_ref()).is_ok();
            self.depth.move_to(&depth.now_from_then);
            usable
        });
        self.handler.predict(odom_from_robot, share);
        let _ = self.handler.correct(&self.beams, now_ns);
        let body = self.handler.body(self.beams.sigma_m());
        let depth = self.depth_seen.then_some(&self.depth);
        if let Some(memory) = &mut self.memory {
            memory.update(now_ns, odom_from_robot, &self.beams, depth, &body);
        }
        Ok(())
    }

    /// The robot was to move by `begin_from_end` from where it was; where it is now shows whether it did.
    pub fn moved(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2, odom_from_robot: &Se2) {
        if let Some(memory) = &mut self.memory
            && !comes_about(begin_from_end, &(odom_from_begin.inverse() * odom_from_robot))
        {
            memory.feel(odom_from_begin, begin_from_end);
        }
    }

    /// From now on the robot moves so, as it is commanded (robot frame).
    pub fn command(&mut self, moves: Twist2) {
        self.moves = moves;
    }

    /// A decision begins.
    pub fn begin_step(&mut self, odom_from_robot: &Se2) {
        self.handler.begin_step(odom_from_robot);
    }

    /// What can be judged on.
    #[must_use]
    pub fn evidence(&self) -> Evidence<'_> {
        let depth = self.depth_seen.then_some(&self.depth);
        Evidence { beams: &self.beams, depth, memory: self.memory.as_ref(), moves: self.moves }
    }

    /// The ranges of the scan as a lidar over the level floor would have told them, metres; those that it told where
    /// the body was level.
    #[must_use]
    pub fn level_ranges<'a>(&'a self, told_m: &'a [f32]) -> &'a [f32] {
        if self.ranges_m.is_empty() { told_m } else { &self.ranges_m }
    }

    /// Where the handler is taken to be.
    #[must_use]
    pub fn handler(&self) -> &HandlerEstimate {
        &self.handler
    }
}
