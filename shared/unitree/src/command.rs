//! What a robot is told to do.

use messages::Twist2;

use crate::field::{get_f32, get_f32s, put_f32, put_f32s};
use crate::{Profile, WireError, crc};

/// What the robot is to do with its legs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// Stands; a trotting robot comes to rest.
    #[default]
    Idle = 0,
    /// Stands, whatever it did.
    Stand = 1,
    /// Walks at the commanded velocity.
    Walk = 2,
    /// Lies down.
    LieDown = 5,
    /// Stands up.
    StandUp = 6,
    /// Goes limp.
    Damping = 7,
    /// Rights itself; only after [`Mode::Damping`].
    Recovery = 8,
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Idle, Self::Stand, Self::Walk, Self::LieDown, Self::StandUp, Self::Damping, Self::Recovery];

    fn of(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| *mode as u8 == number)
    }
}

/// How it walks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Gait {
    /// As the profile's robot does without being told.
    #[default]
    Untold = 0,
    /// Trot of a Go1 and of an older AlienGo; a run of a newer one.
    One = 1,
    /// Run of a Go1 and of an older AlienGo; the stairs of a newer one.
    Two = 2,
}

/// A command.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Command {
    /// Takes the robot into sport mode: sent some 45 times at first.
    pub trigger: bool,
    /// What to do.
    pub mode: Mode,
    /// How to walk.
    pub gait: Gait,
    /// Forward, left, counter-clockwise; m/s and rad/s.
    pub velocity: Twist2,
    /// How much higher the feet are raised, metres; of an older AlienGo: how high.
    pub foot_raise_m: f32,
    /// How much higher the body is, metres; of an older AlienGo: how high.
    pub body_height_m: f32,
}

/// Level flag of a trigger.
const TRIGGER: u8 = 0xf0;

impl Command {
    /// Writes the command; `bytes` are [`Profile::command_len`] long.
    pub fn encode(&self, profile: Profile, bytes: &mut [u8]) {
        let layout = profile.command();
        let (head, level_flag) = profile.head();
        let bytes = &mut bytes[..layout.len];
        bytes.fill(0);
        bytes[..head.len()].copy_from_slice(head);
        bytes[layout.level_flag] = if self.trigger { TRIGGER } else { level_flag };
        bytes[layout.mode] = self.mode as u8;
        bytes[layout.gait] = self.gait as u8;
        put_f32(bytes, layout.foot_raise, self.foot_raise_m);
        put_f32(bytes, layout.body_height, self.body_height_m);
        put_f32s(bytes, layout.velocity, &[self.velocity.vx_mps as f32, self.velocity.vy_mps as f32]);
        put_f32(bytes, layout.yaw_speed, self.velocity.wz_radps as f32);
        crc::seal(bytes);
    }

    /// Reads a command: the robot's side.
    ///
    /// # Errors
    /// Where the bytes are none of this profile.
    pub fn decode(profile: Profile, bytes: &[u8]) -> Result<Self, WireError> {
        let layout = profile.command();
        profile.check(bytes, layout.len)?;
        let [forward, left] = get_f32s(bytes, layout.velocity);
        let yaw = get_f32(bytes, layout.yaw_speed);
        if ![forward, left, yaw].iter().all(|value| value.is_finite()) {
            return Err(WireError::NotFinite);
        }
        Ok(Self {
            trigger: bytes[layout.level_flag] == TRIGGER,
            // What is not known is not done.
            mode: Mode::of(bytes[layout.mode]).unwrap_or_default(),
            gait: [Gait::Untold, Gait::One, Gait::Two]
                .into_iter()
                .find(|gait| *gait as u8 == bytes[layout.gait])
                .unwrap_or_default(),
            velocity: Twist2 { vx_mps: forward.into(), vy_mps: left.into(), wz_radps: yaw.into() },
            foot_raise_m: get_f32(bytes, layout.foot_raise),
            body_height_m: get_f32(bytes, layout.body_height),
        })
    }
}

impl Profile {
    /// Whether bytes are a message of this profile.
    pub(crate) fn check(self, bytes: &[u8], expected: usize) -> Result<(), WireError> {
        if bytes.len() != expected {
            return Err(WireError::Length { len: bytes.len(), expected });
        }
        if !bytes.starts_with(self.head().0) {
            return Err(WireError::Head);
        }
        if crc::is_sealed(bytes) { Ok(()) } else { Err(WireError::Checksum) }
    }
}

#[cfg(test)]
mod tests {
    use messages::Twist2;

    use super::{Command, Gait, Mode};
    use crate::{Profile, WireError};

    fn walk(vx_mps: f64, vy_mps: f64, wz_radps: f64) -> Command {
        Command { mode: Mode::Walk, velocity: Twist2 { vx_mps, vy_mps, wz_radps }, ..Command::default() }
    }

    /// A command, the bytes that are not zero, and the checksum.
    type Case = (Command, &'static [(usize, &'static str)], &'static str);

    /// Bytes of a message that is zero but for these.
    fn bytes(len: usize, set: &[(usize, &str)], crc: &str) -> Vec<u8> {
        let mut bytes = vec![0; len];
        for (at, hex) in set.iter().chain([&(len - 4, crc)]) {
            for i in 0..hex.len() / 2 {
                bytes[at + i] = u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hex");
            }
        }
        bytes
    }

    /// What the makers' libraries sent.
    #[test]
    fn commands_are_those_of_the_makers_libraries() {
        let mode = |mode| Command { mode, ..Command::default() };
        let two = Command { gait: Gait::Two, foot_raise_m: 0.1, body_height_m: -0.05, ..walk(0.1, 0.0, 0.0) };
        let aliengo: [Case; 9] = [
            (mode(Mode::Idle), &[], "0fc14030"),
            (Command { trigger: true, ..Command::default() }, &[(0, "f0")], "e398ef9d"),
            (mode(Mode::Stand), &[(10, "01")], "149ad2e1"),
            (walk(0.5, 0.0, 0.0), &[(10, "02"), (41, "0000003f")], "34db73e0"),
            (walk(0.0, 0.25, -0.75), &[(10, "02"), (45, "0000803e"), (49, "000040bf")], "91092fc9"),
            (walk(0.3, -0.1, 0.5), &[(10, "02"), (41, "9a99993e"), (45, "cdccccbd"), (49, "0000003f")], "56694d7d"),
            (two, &[(10, "0202"), (13, "cdcccc3d"), (17, "cdcc4cbd"), (41, "cdcccc3d")], "4cde4a85"),
            (mode(Mode::LieDown), &[(10, "05")], "a1d0d8aa"),
            (mode(Mode::Damping), &[(10, "07")], "207b3d0d"),
        ];
        for (command, set, crc) in aliengo {
            let mut found = vec![0xaa; 113];
            command.encode(Profile::AlienGo384, &mut found);
            assert_eq!(found, bytes(113, set, crc), "{command:?}");
            assert_eq!(Command::decode(Profile::AlienGo384, &found), Ok(rounded(command)));
        }
        let go1 = Command { gait: Gait::One, ..walk(0.3, -0.1, 0.5) };
        let mut found = vec![0; 129];
        go1.encode(Profile::Go138, &mut found);
        let set: &[(usize, &str)] =
            &[(0, "feefee"), (22, "0201"), (53, "9a99993e"), (57, "cdccccbd"), (61, "0000003f")];
        assert_eq!(found, bytes(129, set, "36f64d89"));
    }

    /// As it comes over the wire: single precision.
    fn rounded(command: Command) -> Command {
        let single = |value: f64| f64::from(value as f32);
        let Twist2 { vx_mps, vy_mps, wz_radps } = command.velocity;
        let velocity = Twist2 { vx_mps: single(vx_mps), vy_mps: single(vy_mps), wz_radps: single(wz_radps) };
        Command { velocity, ..command }
    }

    #[test]
    fn what_is_no_command_is_refused() {
        for profile in Profile::ALL {
            let mut found = vec![0; profile.command_len()];
            walk(0.5, 0.0, 0.0).encode(profile, &mut found);
            let covered = (found.len() / 4 - 1) * 4;
            for bit in 0..covered * 8 {
                let mut damaged = found.clone();
                damaged[bit / 8] ^= 1 << (bit % 8);
                assert!(Command::decode(profile, &damaged).is_err(), "{profile:?}: bit {bit}");
            }
            let expected = profile.command_len();
            let short = &found[..expected - 1];
            assert_eq!(Command::decode(profile, short), Err(WireError::Length { len: expected - 1, expected }));
            walk(f64::NAN, 0.0, 0.0).encode(profile, &mut found);
            assert_eq!(Command::decode(profile, &found), Err(WireError::NotFinite));
        }
    }
}
