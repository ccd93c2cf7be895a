//! The emergency stop's section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::devices::{DeviceRow, Reach, check_baud};
use crate::path::ConfigPath;

/// Linux numbers keys under this.
pub(crate) const EVDEV_KEYS: u16 = 0x300;

/// What the emergency stop is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

impl EstopSource {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Absent, Self::Input, Self::Serial];

    /// What is known of it.
    #[must_use]
    pub fn row(self) -> &'static DeviceRow<Estop> {
        match self {
            Self::Absent => &ABSENT,
            Self::Input => &INPUT,
            Self::Serial => &SERIAL,
        }
    }
}

const ABSENT: DeviceRow<Estop> = DeviceRow {
    name: "absent",
    doctor_name: "emergency stop",
    reach: |_| Reach::Nothing,
    check: |_| Ok(()),
    emulated: None,
};

const INPUT: DeviceRow<Estop> = DeviceRow {
    name: "input",
    doctor_name: "emergency stop",
    reach: |estop| Reach::InputDevice(&estop.input.device),
    check: |estop| estop.input.check(),
    emulated: None,
};

const SERIAL: DeviceRow<Estop> = DeviceRow {
    name: "serial",
    doctor_name: "emergency stop",
    reach: |estop| Reach::SerialPort { path: &estop.serial.port, baud: Some(estop.serial.baud) },
    check: |estop| check_baud("estop.serial.baud", estop.serial.baud),
    emulated: Some(|settings, places| settings.estop.serial.port = places.estop_port.clone().into()),
};

/// The emergency stop.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
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
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

impl EstopInput {
    fn check(&self) -> Result<(), String> {
        if self.key.is_some_and(|key| key >= EVDEV_KEYS) {
            return Err(format!(
                "estop.input.key is not under {EVDEV_KEYS}: no key has such a number, and none would stop"
            ));
        }
        if self.held && self.key.is_none() {
            return Err("estop.input.held needs estop.input.key: any key would let the robot move".to_owned());
        }
        Ok(())
    }
}

/// A box at a serial line: it sends `r` while it is released and `p` while it is pressed, twenty times a second or
/// more.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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
