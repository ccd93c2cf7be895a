//! An RPLIDAR at a pseudo-terminal.

use std::path::{Path, PathBuf};

use messages::Fault;
use messages::ScanHeader;
use messages::fault::Dice;
use rplidar::{Beams, Emulated, Model};
use serial::PseudoTerminal;
use world::{ConfigError, LidarConfig, LidarSensor, Scene};

use crate::cable::flip;

/// Beams of one look at the world: a tenth of a degree apart, finer than any of these lidars samples.
const LOOK_BEAMS: usize = 3600;
/// The most that is read at once, bytes: many requests.
const READ_BYTES: usize = 512;
/// What a wrong speed makes of a byte; any other value that is no byte's own would do as well.
const GARBLED: u8 = 0x6b;

/// A lidar whose port is at a path.
#[derive(Debug)]
pub struct EmulatedRplidar {
    /// None while it is unplugged.
    terminal: Option<PseudoTerminal>,
    port: PathBuf,
    model: Model,
    fault: Option<Fault>,
    dice: Dice,
    lidar: Emulated,
    sensor: LidarSensor,
    /// The last look: how its beams lie, and their ranges, metres.
    beams: Beams,
    ranges_m: Vec<f32>,
    out: Vec<u8>,
}

impl EmulatedRplidar {
    /// Plugs a lidar in: its port is found at `port`. Where it is on the robot and what its noise is, is the
    /// configuration's; it looks all round, and sees as far as its model does.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(terminal: PseudoTerminal, model: Model, config: LidarConfig, seed: u64) -> Result<Self, ConfigError> {
        let sensor = LidarSensor::new(config.all_round(LOOK_BEAMS), seed, 1)?;
        let (beams, ranges_m) = (beams(&sensor.scan_header(), LOOK_BEAMS), vec![f32::NAN; LOOK_BEAMS]);
        let (port, lidar) = (terminal.path().to_owned(), Emulated::new(model));
        let (fault, dice, terminal) = (None, Dice::default(), Some(terminal));
        Ok(Self { terminal, port, model, fault, dice, lidar, sensor, beams, ranges_m, out: Vec::new() })
    }

    /// Where its port is found.
    #[must_use]
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// From now on that goes wrong with it or its line; by that seed, where it is random.
    ///
    /// # Errors
    /// Where it is to be plugged in again, and its port cannot be made.
    pub fn suffer(&mut self, fault: Option<(Fault, u64)>) -> std::io::Result<()> {
        let (fault, seed) = fault.map_or((None, 0), |(fault, seed)| (Some(fault), seed));
        if fault == self.fault {
            return Ok(());
        }
        (self.fault, self.dice) = (fault, Dice::new(seed));
        if fault == Some(Fault::Unplugged) {
            self.terminal = None;
            // It has its power from the line.
            self.lidar = Emulated::new(self.model);
        } else if self.terminal.is_none() {
            self.terminal = Some(PseudoTerminal::open(&self.port)?);
        }
        Ok(())
    }

    /// Whether somebody has made it scan.
    #[must_use]
    pub fn scans(&self) -> bool {
        self.lidar.scans()
    }

    /// From now on the world looks like this. `frame` numbers the looks: each has noise of its own.
    pub fn look(&mut self, scene: &Scene<'_>, frame: u64) {
        self.beams = beams(&self.sensor.scan_header(), LOOK_BEAMS);
        self.ranges_m.resize(LOOK_BEAMS, f32::NAN);
        self.sensor.scan(scene, frame, &mut self.ranges_m);
    }

    /// From now on the world looks as that scan saw it: ranges in metres, noise included.
    pub fn take_look(&mut self, header: &ScanHeader, ranges_m: &[f32]) {
        self.beams = beams(header, ranges_m.len());
        self.ranges_m.clear();
        self.ranges_m.extend_from_slice(ranges_m);
    }

    /// When there is something to send, nanoseconds.
    #[must_use]
    pub fn next_frame_ns(&self) -> Option<u64> {
        self.lidar.next_frame_ns()
    }

    /// Listens, answers, and sends what was measured until `now_ns`.
    ///
    /// # Errors
    /// Where the pseudo-terminal fails.
    pub fn serve(&mut self, now_ns: u64) -> std::io::Result<()> {
        let Some(terminal) = &self.terminal else { return Ok(()) };
        let mut heard = [0; READ_BYTES];
        let count = terminal.read(&mut heard)?;
        let right_speed = self.fault != Some(Fault::WrongBaud) && terminal.baud() == Some(self.model.baud());
        self.out.clear();
        // At a wrong speed neither understands the other.
        if right_speed {
            self.lidar.received(now_ns, &heard[..count], &mut self.out);
        }
        let (beams, ranges_m) = (self.beams, &self.ranges_m);
        // What gave no reading, or is infinitely far, does not come back.
        let measure = |clockwise_deg: f64, _| {
            beams.at(clockwise_deg).map(|beam| ranges_m[beam]).filter(|range_m| range_m.is_finite())
        };
        self.lidar.advance(now_ns, measure, &mut self.out);
        if !right_speed {
            self.out.iter_mut().for_each(|byte| *byte ^= GARBLED);
        }
        match self.fault {
            Some(Fault::Noise) => flip(&mut self.dice, &mut self.out),
            Some(Fault::Silent) => self.out.clear(),
            _ => {}
        }
        // What nobody reads is lost, as on any serial line.
        let mut rest = &self.out[..];
        while !rest.is_empty() {
            match terminal.write(rest)? {
                0 => break,
                sent => rest = &rest[sent..],
            }
        }
        Ok(())
    }
}

fn beams(header: &ScanHeader, count: usize) -> Beams {
    Beams { count, angle_min_rad: header.angle_min_rad, angle_increment_rad: header.angle_increment_rad }
}
