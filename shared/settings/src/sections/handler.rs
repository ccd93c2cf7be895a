//! The handler, and how they follow.

use messages::Pose2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::{Positive, Share};

/// Which interaction model predicts the handler.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HandlerModel {
    /// A fixed offset.
    Rigid,
    /// A rod that turns about the robot's grip.
    Rod,
    /// The delayed harness.
    Delayed,
}

/// The handler, as fitted (Kim et al. 2023, section 4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Handler {
    /// How they follow.
    pub model: HandlerModel,
    /// Radius of the disc that stands for the handler, metres.
    pub radius_m: Positive,
    /// Radius of what the lidar's plane meets of them, metres.
    pub seen_radius_m: Positive,
    /// Default offset: where the handler walks, in the robot frame.
    #[schemars(with = "crate::schema::Pose2")]
    pub robot_from_handler: Pose2,
    /// In single file the handler's middle is so far behind the robot's, metres.
    pub behind_m: Positive,
    /// In single file the robot makes its motions at this share of their speed. A handler right behind it walks on for
    /// some 0.6 s when it stops.
    pub behind_speed: Share,
    /// Delayed harness: remembered share of the offset per decision; 0 = rigid.
    pub alpha: Share,
    /// Rod: where the robot holds it, x and y in the robot frame, metres.
    pub rod_grip_m: [f64; 2],
    /// Rod: from the grip to the handler's middle, metres.
    pub rod_length_m: Positive,
    /// How long they walk on at the robot's speed when it stops, before they come to rest, seconds. The hull holds it
    /// where it goes on to their rest (`shield.until_rest`).
    pub walks_on_s: f64,
}

impl Default for Handler {
    fn default() -> Self {
        Self {
            model: HandlerModel::Delayed,
            radius_m: Positive::of(0.25),
            seen_radius_m: Positive::of(0.20),
            robot_from_handler: Pose2::new(-0.75, -0.35, 0.0),
            behind_m: Positive::of(1.2),
            behind_speed: Share::of(0.5),
            alpha: Share::of(0.4),
            rod_grip_m: [-0.3, 0.0],
            rod_length_m: Positive::of(0.8),
            walks_on_s: 0.0,
        }
    }
}
