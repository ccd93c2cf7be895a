//! A door of a world file.

use serde::Deserialize;
use toml::Spanned;

use super::{MIN_SIZE_M, Reader};
use crate::door::{Door, Opens};
use crate::{SeenBy, WorldError};

/// The longest leaf, metres.
const LEAF_MAX_M: f64 = 5.0;
/// The slowest and the fastest swing, degrees per second.
const SPEED_DEGPS: (f64, f64) = (1.0, 180.0);
/// The latest time and the longest stay, seconds.
const TIME_MAX_S: f64 = 1e6;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Swinging {
    hinge: [f64; 2],
    length_m: f64,
    #[serde(default = "usual_thickness_m")]
    thickness_m: f64,
    #[serde(default = "usual_z")]
    z: [f64; 2],
    shut_deg: f64,
    open_deg: f64,
    #[serde(default = "usual_speed_degps")]
    speed_degps: f64,
    opens_s: Option<f64>,
    opens_near_m: Option<f64>,
    #[serde(default = "usual_stay_s")]
    stays_s: f64,
    #[serde(default)]
    seen_by: SeenBy,
}

fn usual_thickness_m() -> f64 {
    0.04
}

fn usual_z() -> [f64; 2] {
    [0.0, 2.05]
}

fn usual_speed_degps() -> f64 {
    60.0
}

fn usual_stay_s() -> f64 {
    5.0
}

impl Reader<'_> {
    pub(super) fn door(&self, entry: &Spanned<Swinging>) -> Result<Door, WorldError> {
        let (span, door) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "length_m", door.length_m, (MIN_SIZE_M, LEAF_MAX_M))?;
        self.toml.check(&span, "thickness_m", door.thickness_m, (MIN_SIZE_M, door.length_m))?;
        self.toml.check(&span, "shut_deg", door.shut_deg, (-720.0, 720.0))?;
        self.toml.check(&span, "open_deg", door.open_deg, (door.shut_deg - 360.0, door.shut_deg + 360.0))?;
        self.toml.check(&span, "speed_degps", door.speed_degps, SPEED_DEGPS)?;
        self.toml.check(&span, "stays_s", door.stays_s, (0.0, TIME_MAX_S))?;
        let opens = match (door.opens_s, door.opens_near_m) {
            (Some(at_s), None) => {
                self.toml.check(&span, "opens_s", at_s, (0.0, TIME_MAX_S))?;
                Opens::At(at_s)
            }
            (None, Some(near_m)) => {
                self.toml.check(&span, "opens_near_m", near_m, (MIN_SIZE_M, super::MAX_SIZE_M))?;
                Opens::Near(near_m)
            }
            _ => return Err(self.toml.refuse(&span, "door", "needs either opens_s or opens_near_m".into())),
        };
        Ok(Door {
            hinge: self.point(&span, "hinge", door.hinge)?,
            size_m: [door.length_m, door.thickness_m],
            z: self.heights(&span, Some(door.z))?,
            swing_rad: [door.shut_deg, door.open_deg].map(f64::to_radians),
            speed_radps: door.speed_degps.to_radians(),
            opens,
            stays_s: door.stays_s,
            seen_by: door.seen_by,
        })
    }
}
