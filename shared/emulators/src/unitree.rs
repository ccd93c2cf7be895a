//! A Unitree robot at a UDP port, on a floor without walls.

use std::net::{SocketAddr, UdpSocket};

use messages::{Twist2, s_from_ns};
use unitree::{EmulatedRobot, Mode, Profile, Silence, State};

/// From one state to the next, nanoseconds: as the robots send them.
const STATE_NS: u64 = 2_000_000;
/// No message of any profile is longer.
const MESSAGE_MAX: usize = 1200;
/// Of those that tell it.
const CHARGE_PERCENT: u8 = 80;

/// A robot whose port is open.
#[derive(Debug)]
pub struct EmulatedUnitree {
    socket: UdpSocket,
    profile: Profile,
    robot: EmulatedRobot,
    /// Whom it answers: who spoke last.
    peer: Option<SocketAddr>,
    /// Forward and left, metres, and heading, radians, since it was switched on.
    pose: [f64; 3],
    moved_ns: Option<u64>,
    told_ns: u64,
    refused: u64,
}

impl EmulatedUnitree {
    /// Switches a robot on, which listens at that socket.
    ///
    /// # Errors
    /// Where the socket cannot be set up.
    pub fn new(socket: UdpSocket, profile: Profile, silence: Silence) -> std::io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            profile,
            robot: EmulatedRobot::new(profile, silence),
            peer: None,
            pose: [0.0; 3],
            moved_ns: None,
            told_ns: 0,
            refused: 0,
        })
    }

    /// What it does with its legs, and how fast it goes.
    #[must_use]
    pub fn motion(&self, now_ns: u64) -> (Mode, Twist2) {
        (self.robot.mode(), self.robot.velocity(now_ns))
    }

    /// Datagrams that were no command of its profile.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Listens, moves, and says how it is.
    ///
    /// # Errors
    /// Where the socket fails.
    pub fn serve(&mut self, now_ns: u64) -> std::io::Result<()> {
        self.go_on(now_ns);
        let mut bytes = [0; MESSAGE_MAX];
        loop {
            match self.socket.recv_from(&mut bytes) {
                Ok((count, peer)) => match self.robot.received(&bytes[..count], now_ns) {
                    Ok(()) => self.peer = Some(peer),
                    Err(_) => self.refused += 1,
                },
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                // Nobody listens where the last state was sent: the next one goes out all the same.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(error),
            }
        }
        if let Some(peer) = self.peer.filter(|_| now_ns.saturating_sub(self.told_ns) >= STATE_NS) {
            self.told_ns = now_ns;
            self.robot.state(self.measured(now_ns)).encode(self.profile, &mut bytes);
            // A robot does not wait for who listens.
            let _ = self.socket.send_to(&bytes[..self.profile.state_len()], peer);
        }
        Ok(())
    }

    /// Moves on to now.
    fn go_on(&mut self, now_ns: u64) {
        let since_s = self.moved_ns.map_or(0.0, |moved_ns| s_from_ns(now_ns.saturating_sub(moved_ns)));
        self.moved_ns = Some(now_ns);
        let velocity = self.robot.velocity(now_ns);
        let [x_m, y_m, yaw_rad] = self.pose;
        let (sin, cos) = (yaw_rad + velocity.wz_radps * since_s / 2.0).sin_cos();
        self.pose = [
            x_m + (velocity.vx_mps * cos - velocity.vy_mps * sin) * since_s,
            y_m + (velocity.vx_mps * sin + velocity.vy_mps * cos) * since_s,
            yaw_rad + velocity.wz_radps * since_s,
        ];
    }

    fn measured(&self, now_ns: u64) -> State {
        let [x_m, y_m, yaw_rad] = self.pose;
        let (sin, cos) = (yaw_rad / 2.0).sin_cos();
        State {
            quaternion: [cos as f32, 0.0, 0.0, sin as f32],
            position_m: [x_m as f32, y_m as f32, 0.3],
            velocity: self.robot.velocity(now_ns),
            charge_percent: Some(CHARGE_PERCENT),
            ..State::default()
        }
    }
}
