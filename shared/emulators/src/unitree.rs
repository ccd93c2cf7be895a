//! A Unitree robot at a UDP port.

use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

use messages::fault::LOW_CHARGE_PERCENT;
use messages::{Fault, Twist2};
use unitree::{Button, EmulatedRobot, Mode, Profile, Remote, Silence, State};

use crate::cable::Cable;

/// From one state to the next, nanoseconds: as the robots send them.
const STATE_NS: u64 = 2_000_000;
/// No message of any profile is longer.
const MESSAGE_MAX: usize = 1200;

/// A robot whose port is open. Where it is, whoever moves it knows.
#[derive(Debug)]
pub struct EmulatedUnitree {
    socket: UdpSocket,
    profile: Profile,
    robot: EmulatedRobot,
    /// Whom it answers: who spoke last.
    peer: Option<SocketAddr>,
    told_ns: u64,
    refused: u64,
    fault: Option<Fault>,
    heard: Cable,
    said: Cable,
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
            told_ns: 0,
            refused: 0,
            fault: None,
            heard: Cable::new(1),
            said: Cable::new(2),
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

    /// From now on that goes wrong with it or its line; by that seed, where it is random.
    pub fn suffer(&mut self, fault: Option<(Fault, u64)>) {
        let fault = match fault {
            Some((fault, seed)) if self.fault != Some(fault) => {
                (self.heard, self.said) = (Cable::new(seed), Cable::new(!seed));
                Some(fault)
            }
            other => other.map(|(fault, _)| fault),
        };
        let stops = |fault| fault == Some(Fault::RemoteStop);
        if stops(fault) != stops(self.fault) {
            self.press_stop(stops(fault));
        }
        self.fault = fault;
    }

    /// Somebody stops it by its hand remote; or lets go, and makes it stand again.
    fn press_stop(&mut self, pressed: bool) {
        let buttons = 1 << Button::L2 as u16 | 1 << Button::B as u16;
        self.robot.press(if pressed { Remote { buttons, ..Remote::default() } } else { Remote::default() });
        if !pressed {
            self.robot.recover();
        }
    }

    /// Listens, obeys, and says how it is: `measured` is what its sensors know.
    ///
    /// # Errors
    /// Where the socket fails.
    pub fn serve(&mut self, now_ns: u64, measured: State) -> std::io::Result<()> {
        self.hear(now_ns)?;
        if now_ns.saturating_sub(self.told_ns) >= STATE_NS {
            self.told_ns = now_ns;
            self.tell(now_ns, measured);
        }
        Ok(())
    }

    /// Takes what has come.
    ///
    /// # Errors
    /// Where the socket fails.
    pub fn hear(&mut self, now_ns: u64) -> std::io::Result<()> {
        let mut bytes = [0; MESSAGE_MAX];
        loop {
            match self.socket.recv_from(&mut bytes) {
                Ok((count, peer)) => {
                    self.peer = Some(peer);
                    self.heard.put(now_ns, &bytes[..count], self.fault);
                }
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                // Nobody listens where the last state was sent: the next one goes out all the same.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(error),
            }
        }
        while let Some(bytes) = self.heard.take(now_ns) {
            self.refused += u64::from(self.robot.received(&bytes, now_ns).is_err());
        }
        Ok(())
    }

    fn tell(&mut self, now_ns: u64, measured: State) {
        let Some(peer) = self.peer else { return };
        let mut bytes = [0; MESSAGE_MAX];
        let bytes = &mut bytes[..self.profile.state_len()];
        let low = self.fault == Some(Fault::LowBattery);
        let charge_percent = if low { Some(LOW_CHARGE_PERCENT) } else { measured.charge_percent };
        self.robot.state(State { charge_percent, ..measured }).encode(self.profile, bytes);
        if self.fault != Some(Fault::Silent) {
            self.said.put(now_ns, bytes, self.fault);
        }
        while let Some(bytes) = self.said.take(now_ns) {
            // A robot does not wait for who listens.
            let _ = self.socket.send_to(&bytes, peer);
        }
    }
}

impl AsFd for EmulatedUnitree {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}
