//! What a robot says of itself.

use messages::{Attitude, Pose2, Twist2, quaternion, roll_pitch_yaw_rad};

use crate::field::{get_f32, get_f32s, put_f32, put_f32s};
use crate::{Mode, Profile, Remote, WireError, crc, remote};

/// Of a robot that stands.
const BODY_HEIGHT_M: f32 = 0.3;
/// How far from one the squared length of an attitude's quaternion may be.
const UNIT_TOLERANCE: f32 = 0.05;

/// A state. It has neither a number nor a time: how old it is, only its arrival tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// What the robot does with its legs, by the number of [`crate::Mode`].
    pub mode: u8,
    /// Its attitude: w, x, y, z.
    pub quaternion: [f32; 4],
    /// Where it believes to be since it was switched on, metres: forward, left, up. It drifts.
    pub position_m: [f32; 3],
    /// Forward, left, counter-clockwise; m/s and rad/s.
    pub velocity: Twist2,
    /// Charge of the battery, percent, where the robot tells it.
    pub charge_percent: Option<u8>,
    /// The hand remote.
    pub remote: Remote,
}

impl Default for State {
    /// Of a robot that stands where it was switched on.
    fn default() -> Self {
        Self {
            mode: 0,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            position_m: [0.0; 3],
            velocity: Twist2::ZERO,
            charge_percent: None,
            remote: Remote::default(),
        }
    }
}

impl State {
    /// The state of a robot at a pose since it was switched on, whose body is held so; level and at the height of a
    /// robot that stands where the attitude is not known.
    #[must_use]
    pub fn held(own_from_robot: Pose2, attitude: &Attitude, velocity: Twist2, charge_percent: Option<u8>) -> Self {
        let Pose2 { x_m, y_m, yaw_rad } = own_from_robot;
        let (roll_rad, pitch_rad, height_m) = if attitude.is_known() {
            (attitude.roll_rad, attitude.pitch_rad, attitude.height_m as f32)
        } else {
            (0.0, 0.0, BODY_HEIGHT_M)
        };
        Self {
            quaternion: quaternion([roll_rad, pitch_rad, yaw_rad]).map(|part| part as f32),
            position_m: [x_m as f32, y_m as f32, height_m],
            velocity,
            charge_percent,
            ..Self::default()
        }
    }

    /// Whether it goes as it is commanded, were it only at zero.
    #[must_use]
    pub fn walks(&self) -> bool {
        self.mode == Mode::Walk as u8
    }

    /// Roll, pitch and yaw of the attitude, radians; yaw counter-clockwise from where the robot looked when it was
    /// switched on.
    #[must_use]
    pub fn roll_pitch_yaw_rad(&self) -> [f64; 3] {
        roll_pitch_yaw_rad(self.quaternion.map(f64::from))
    }

    /// Reads a state.
    ///
    /// # Errors
    /// Where the bytes are none of this profile.
    pub fn decode(profile: Profile, bytes: &[u8]) -> Result<Self, WireError> {
        let layout = profile.state();
        profile.check(bytes, layout.len)?;
        let [forward, left] = get_f32s(bytes, layout.velocity);
        let yaw = get_f32(bytes, layout.yaw_speed);
        let (quaternion, position_m) = (get_f32s(bytes, layout.quaternion), get_f32s(bytes, layout.position));
        if !quaternion.iter().chain(&position_m).chain(&[forward, left, yaw]).all(|value| value.is_finite()) {
            return Err(WireError::NotFinite);
        }
        let length: f32 = quaternion.iter().map(|value| value * value).sum();
        if (length - 1.0).abs() > UNIT_TOLERANCE {
            return Err(WireError::NoAttitude);
        }
        Ok(Self {
            mode: bytes[layout.mode],
            quaternion,
            position_m,
            velocity: Twist2 { vx_mps: forward.into(), vy_mps: left.into(), wz_radps: yaw.into() },
            charge_percent: layout.charge.map(|at| bytes[at]),
            remote: Remote::decode(&bytes[layout.remote..layout.remote + remote::LEN]),
        })
    }

    /// Writes a state: the robot's side; `bytes` are [`Profile::state_len`] long.
    pub fn encode(&self, profile: Profile, bytes: &mut [u8]) {
        let layout = profile.state();
        let bytes = &mut bytes[..layout.len];
        bytes.fill(0);
        let head = profile.head().0;
        bytes[..head.len()].copy_from_slice(head);
        bytes[layout.mode] = self.mode;
        put_f32s(bytes, layout.quaternion, &self.quaternion);
        put_f32s(bytes, layout.position, &self.position_m);
        put_f32s(bytes, layout.velocity, &[self.velocity.vx_mps as f32, self.velocity.vy_mps as f32]);
        put_f32(bytes, layout.yaw_speed, self.velocity.wz_radps as f32);
        if let (Some(at), Some(charge)) = (layout.charge, self.charge_percent) {
            bytes[at] = charge;
        }
        self.remote.encode(&mut bytes[layout.remote..layout.remote + remote::LEN]);
        crc::seal(bytes);
    }
}

#[cfg(test)]
mod tests {
    use messages::{Attitude, Pose2, Twist2};

    use super::{BODY_HEIGHT_M, State};
    use crate::{Button, Profile, Remote, WireError};

    fn state(profile: Profile) -> State {
        let half_rad = 0.35_f32;
        State {
            mode: 2,
            quaternion: [half_rad.cos(), 0.0, 0.0, half_rad.sin()],
            position_m: [1.5, -0.25, 0.375],
            velocity: Twist2 { vx_mps: 0.5, vy_mps: -0.125, wz_radps: 0.25 },
            charge_percent: (profile == Profile::Go138).then_some(61),
            remote: Remote { buttons: 1 << Button::L2 as u16 | 1 << Button::B as u16, sticks: [0.5, -1.0, 0.25, 0.0] },
        }
    }

    #[test]
    fn a_state_tells_how_the_body_is_held() {
        let attitude = Attitude { stamp_ns: 1, roll_rad: 0.1, pitch_rad: -0.2, height_m: 0.25, ..Attitude::default() };
        for (attitude, expected, height_m) in
            [(attitude, [0.1, -0.2, 0.7], 0.25), (Attitude::default(), [0.0, 0.0, 0.7], BODY_HEIGHT_M)]
        {
            let held = State::held(Pose2::new(1.0, 2.0, 0.7), &attitude, Twist2::ZERO, None);
            let found = held.roll_pitch_yaw_rad();
            assert!((0..3).all(|i| (found[i] - expected[i]).abs() < 1e-6), "{found:?}");
            assert_eq!(held.position_m, [1.0, 2.0, height_m]);
        }
    }

    #[test]
    fn a_state_is_there_and_back_in_every_profile() {
        for profile in Profile::ALL {
            let mut bytes = vec![0xaa; profile.state_len()];
            state(profile).encode(profile, &mut bytes);
            let found = State::decode(profile, &bytes).expect("a state");
            assert_eq!(found, state(profile), "{profile:?}");
            assert!((found.roll_pitch_yaw_rad()[2] - 0.7).abs() < 1e-6 && found.remote.says_stop());
            for other in Profile::ALL {
                assert_eq!(State::decode(other, &bytes).is_ok(), other == profile, "{profile:?} read as {other:?}");
            }
            bytes[profile.state().velocity] ^= 1;
            assert_eq!(State::decode(profile, &bytes), Err(WireError::Checksum));
            let wild = State { velocity: Twist2 { vx_mps: f64::INFINITY, ..Twist2::default() }, ..state(profile) };
            wild.encode(profile, &mut bytes);
            assert_eq!(State::decode(profile, &bytes), Err(WireError::NotFinite));
            State { quaternion: [0.0; 4], ..state(profile) }.encode(profile, &mut bytes);
            assert_eq!(State::decode(profile, &bytes), Err(WireError::NoAttitude));
        }
    }
}
