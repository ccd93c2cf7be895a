//! The emergency stop's section.

use serde::{Deserialize, Serialize};

use crate::path::ConfigPath;

/// What the emergency stop is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EstopSource {
    /// There is none.
    #[default]
    Absent,
    /// A Linux input device: a button, a gamepad, the harness's dead man's switch.
    Input,
    /// A box at a serial line, with a heartbeat.
    Serial,
}

/// The emergency stop.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Estop {
    /// What it is.
    pub source: EstopSource,
    /// The input device.
    pub input: EstopInput,
    /// The serial box.
    pub serial: EstopSerial,
}

/// A Linux input device, by cable: a radio's silence would look like a button that nobody presses.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstopInput {
    /// Its file.
    pub device: ConfigPath,
    /// The number of the key or button (`evtest` tells it); where none is told, any of them stops.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<u16>,
    /// Whether it is a dead man's switch: the robot moves only while it is held.
    pub held: bool,
}

impl Default for EstopInput {
    fn default() -> Self {
        Self { device: ConfigPath::from("/dev/input/by-id/estop"), key: None, held: false }
    }
}

/// A box at a serial line: it sends `r` while it is released and `p` while it is pressed, twenty times a second or
/// more.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstopSerial {
    /// Its port.
    pub port: ConfigPath,
    /// Bits a second.
    pub baud: u32,
}

impl Default for EstopSerial {
    fn default() -> Self {
        Self { port: ConfigPath::from("/dev/guidedog-estop"), baud: 9600 }
    }
}
