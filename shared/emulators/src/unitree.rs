//! A Unitree robot at a UDP port.

use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

use messages::{Fault, Twist2};
use settings::UnitreeSettings;
use unitree::{Button, Mode, Profile, Remote, Silence, State};

use crate::EmulatedRobot;
use crate::cable::{Trouble, garbled};

/// From one state to the next, nanoseconds: as the robots send them.
const STATE_NS: u64 = 2_000_000;
/// No message of any profile is longer.
const MESSAGE_MAX: usize = 1200;

/// A robot whose port is open. Where it is, whoever moves it knows.
#[derive(Debug)]
pub struct EmulatedUnitree {
    socket: UdpSocket,
    profile: Profile,
    robot: unitree::EmulatedRobot,
    /// Whom it answers: who spoke last.
    peer: Option<SocketAddr>,
    told_ns: u64,
    refused: u64,
    line: Trouble<Vec<u8>, Vec<u8>>,
}

impl EmulatedUnitree {
    /// Switches a robot on where the settings seek one.
    ///
    /// # Errors
    /// Where it cannot listen there.
    pub fn open(at: &UnitreeSettings, silence: Silence) -> std::io::Result<Self> {
        let address = at.robot();
        let socket = UdpSocket::bind(address).map_err(|error| {
            std::io::Error::new(error.kind(), format!("no emulated robot can listen at {address}: {error}"))
        })?;
        Self::new(socket, at.profile, silence)
    }

    /// Switches a robot on, which listens at that socket.
    ///
    /// # Errors
    /// Where the socket cannot be set up.
    pub fn new(socket: UdpSocket, profile: Profile, silence: Silence) -> std::io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            profile,
            robot: unitree::EmulatedRobot::new(profile, silence),
            peer: None,
            told_ns: 0,
            refused: 0,
            line: Trouble::none(),
        })
    }

    /// What it does with its legs.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.robot.mode()
    }

    /// Datagrams that were no command of its profile.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Somebody stops it by its hand remote; or lets go, and makes it stand again.
    fn press_stop(&mut self, pressed: bool) {
        let buttons = 1 << Button::L2 as u16 | 1 << Button::B as u16;
        self.robot.press(if pressed { Remote { buttons, ..Remote::default() } } else { Remote::default() });
        if !pressed {
            self.robot.recover();
        }
    }

    fn tell(&mut self, now_ns: u64, measured: State) {
        let Some(peer) = self.peer else { return };
        let mut bytes = [0; MESSAGE_MAX];
        let bytes = &mut bytes[..self.profile.state_len()];
        let charge_percent = self.line.charge_percent(measured.charge_percent);
        self.robot.state(State { charge_percent, ..measured }).encode(self.profile, bytes);
        if self.line.fault != Some(Fault::Silent) {
            self.line.said.put(now_ns, bytes.to_vec(), self.line.fault, garbled);
        }
        while let Some(bytes) = self.line.said.take(now_ns) {
            // A robot does not wait for who listens.
            let _ = self.socket.send_to(&bytes, peer);
        }
    }
}

impl EmulatedRobot for EmulatedUnitree {
    fn velocity(&self, now_ns: u64) -> Twist2 {
        self.robot.velocity(now_ns)
    }

    fn posture(&self, _now_ns: u64) -> String {
        format!("{:?}", self.robot.mode())
    }

    fn suffer(&mut self, fault: Option<(Fault, u64)>) {
        if let Some(pressed) = self.line.suffer(fault) {
            self.press_stop(pressed);
        }
    }

    fn hear(&mut self, now_ns: u64) -> std::io::Result<()> {
        let mut bytes = [0; MESSAGE_MAX];
        loop {
            match self.socket.recv_from(&mut bytes) {
                Ok((count, peer)) => {
                    self.peer = Some(peer);
                    self.line.heard.put(now_ns, bytes[..count].to_vec(), self.line.fault, garbled);
                }
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                // Nobody listens where the last state was sent: the next one goes out all the same.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(error),
            }
        }
        while let Some(bytes) = self.line.heard.take(now_ns) {
            self.refused += u64::from(self.robot.received(&bytes, now_ns).is_err());
        }
        Ok(())
    }

    fn serve(&mut self, now_ns: u64, measured: State) -> std::io::Result<()> {
        self.hear(now_ns)?;
        if now_ns.saturating_sub(self.told_ns) >= STATE_NS {
            self.told_ns = now_ns;
            self.tell(now_ns, measured);
        }
        Ok(())
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }
}
