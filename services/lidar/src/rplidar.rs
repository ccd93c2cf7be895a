//! An RPLIDAR at a serial line: opens the port, has the conversation, and opens it anew whenever it is lost.
//!
//! A lidar that is not there is no reason to end: without scans nothing moves, and the operator is told once what is
//! missing and what to do.

use std::path::PathBuf;

use guidance::se2::se2;
use messages::{NS_PER_S, Odometry, ScanHeader};
use rplidar::{Beams, Do, Fan, Found, Sample, Session, Turns, Wanted};
use serial::{SerialError, SerialPort};
use settings::LidarSettings;
use transport::{FromChild, Io, Subscriber, TransportError};
use world::LidarConfig;

use crate::deskew::{Deskew, Motion};
use crate::{ScanPort, ScanSource};

/// Between two tries to open a port: short, since fresh scans are to come within a second of replugging.
const REOPEN_NS: u64 = 200_000_000;
/// The speeds of all series, the most common first.
const BAUDS: [u32; 4] = [115_200, 256_000, 460_800, 1_000_000];
/// What a line of 1,000,000 baud brings in 40 ms, bytes.
const READ_BYTES: usize = 4096;
/// The most reads at one waking: the loop has beats to give as well.
const READS_MAX: usize = 8;
/// Of [`Io::watch`].
const PORT_TOKEN: u64 = 0;
/// A lidar that measures and gives no whole turn for so long turns too slowly, or not at all, nanoseconds.
const NO_TURN_NS: u64 = 3 * NS_PER_S;
/// What a line loses is judged by so much time, nanoseconds; now and then a byte is lost on any.
const LOSS_SPAN_NS: u64 = 10 * NS_PER_S;
const LOSSES_MAX: u64 = 20;

/// Scans of an RPLIDAR.
#[derive(Debug)]
pub struct RplidarSource {
    settings: LidarSettings,
    header: ScanHeader,
    line: Option<Line>,
    samples: Vec<Sample>,
    turns: Turns,
    odometry: Subscriber<Odometry>,
    deskew: Deskew,
    fan: Fan,
    /// Angle and range of what the last turn measured.
    before: Vec<(f64, Option<f32>)>,
    reopen_ns: u64,
    /// Ports opened so far without a scan: which speed is tried next.
    tries: usize,
    /// The speed at which the lidar was found, and where that is kept: after a death of this process, and after
    /// replugging, it is tried first.
    known_baud: Option<u32>,
    speed_file: PathBuf,
    health: Health,
    /// The last thing told, which is not told again.
    told: String,
}

/// An open port and the conversation on it.
#[derive(Debug)]
struct Line {
    port: SerialPort,
    session: Session,
    baud: u32,
    /// What there was no room for in the port.
    unsent: Vec<u8>,
    scans: bool,
}

/// How it goes with the lidar that scans.
#[derive(Debug, Default)]
struct Health {
    /// Since the last turn, or since it began, nanoseconds.
    turn_ns: u64,
    /// Losses until the span began, and when it did.
    losses: u64,
    since_ns: u64,
}

impl RplidarSource {
    /// A source that opens its port when it is first asked.
    ///
    /// # Errors
    /// Where the topic `odometry` cannot be opened.
    pub fn open(settings: &LidarSettings, io: &mut Io) -> Result<Self, TransportError> {
        let header = LidarConfig::from(settings).scan_header();
        let beams = Beams {
            count: settings.beams as usize,
            angle_min_rad: header.angle_min_rad,
            angle_increment_rad: header.angle_increment_rad,
        };
        let speed_file = io.domain.dir.kept(io.identity().service);
        Ok(Self {
            settings: settings.clone(),
            header,
            line: None,
            samples: Vec::new(),
            turns: Turns::default(),
            odometry: io.quiet_subscriber()?,
            deskew: Deskew::new(se2(header.robot_from_lidar)),
            fan: Fan::new(beams, settings.sigma_m),
            before: Vec::new(),
            reopen_ns: 0,
            tries: 0,
            known_baud: std::fs::read_to_string(&speed_file).ok().and_then(|text| text.trim().parse().ok()),
            speed_file,
            health: Health::default(),
            told: String::new(),
        })
    }

    /// The speed to try: that of the configuration, else the one that worked before, else one after another.
    fn baud(&self) -> u32 {
        let known = self.settings.rplidar.baud.or(self.known_baud.filter(|_| self.tries == 0));
        known.unwrap_or(BAUDS[self.tries.saturating_sub(usize::from(self.known_baud.is_some())) % BAUDS.len()])
    }

    /// Keeps the speed at which the lidar answers.
    fn keep_baud(&mut self, baud: u32) {
        if self.known_baud.replace(baud) != Some(baud) {
            // Where it cannot be kept, the next process looks for it.
            let _ = std::fs::write(&self.speed_file, baud.to_string());
        }
    }

    fn plug(&mut self, io: &Io) -> Result<(), TransportError> {
        let (wished, baud) = (&self.settings.rplidar, self.baud());
        match SerialPort::open(&wished.port, baud) {
            Ok(port) => {
                io.watch(&port, PORT_TOKEN)?;
                let searches = wished.baud.is_none();
                let wanted = Wanted { baud, mode: wished.mode.clone(), motor_rpm: wished.motor_rpm, searches };
                let session = Session::new(wanted, io.now_ns());
                self.line = Some(Line { port, session, baud, unsent: Vec::new(), scans: false });
            }
            Err(error) => self.lose(io, &error),
        }
        Ok(())
    }

    /// Tells why there are no scans, and tries again soon.
    fn lose(&mut self, io: &Io, why: &dyn std::fmt::Display) {
        if let Some(line) = self.line.take() {
            io.unwatch(&line.port);
        }
        self.reopen_ns = io.now_ns() + REOPEN_NS;
        self.tell(io, why.to_string());
    }

    fn tell(&mut self, io: &Io, text: String) {
        if self.told != text {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told = text;
        }
    }

    /// Publishes the turns that are complete, each as from where the lidar was at its end.
    fn publish(&mut self, scans: &mut ScanPort) -> Result<(), TransportError> {
        while let Some(odometry) = self.odometry.take()? {
            self.deskew.take(&odometry);
        }
        for sample in self.samples.drain(..) {
            let Some(turn @ [first, .., last]) = self.turns.push(&sample) else { continue };
            let measured = turn.iter().map(|sample| (sample.angle_deg, sample.range_m));
            // A lidar that says the same again is stuck. Whoever judges that has to see the same again, too.
            let motion = if measured.clone().eq(self.before.iter().copied()) {
                Motion::NONE
            } else {
                self.deskew.motion(first.stamp_ns, last.stamp_ns)
            };
            self.before.clear();
            self.before.extend(measured);
            let fan = &mut self.fan;
            turn.iter().for_each(|sample| fan.enter(&motion.at_end(sample)));
            let ranges_m = fan.ranges_m();
            scans.publish(last.stamp_ns, ranges_m.len(), self.header, |to| to.copy_from_slice(ranges_m))?;
            self.health.turn_ns = last.stamp_ns;
        }
        Ok(())
    }

    /// Tells who the lidar is, once it scans.
    fn greet(&mut self, io: &Io) {
        let Some(line) = &mut self.line else { return };
        let Some(found) = line.session.running().filter(|_| !line.scans) else { return };
        line.scans = true;
        let (text, baud) = (about(found, line.port.path().display()), line.baud);
        self.tries = 0;
        self.keep_baud(baud);
        (self.health.turn_ns, self.health.since_ns) = (io.now_ns(), io.now_ns());
        self.tell(io, text);
    }

    /// Tells what is wrong with a lidar that scans.
    fn look_after(&mut self, io: &Io) {
        let Some(line) = self.line.as_ref().filter(|line| line.scans && line.session.running().is_some()) else {
            return;
        };
        let (now_ns, losses) = (io.now_ns(), line.session.counters().losses);
        if now_ns.saturating_sub(self.health.turn_ns) > NO_TURN_NS {
            self.health.turn_ns = now_ns;
            self.tell(
                io,
                "the lidar measures, but gives no whole turn: does it turn, five times a second or more?".to_owned(),
            );
        }
        if now_ns.saturating_sub(self.health.since_ns) > LOSS_SPAN_NS {
            let lost = losses.saturating_sub(self.health.losses);
            (self.health.losses, self.health.since_ns) = (losses, now_ns);
            if lost > LOSSES_MAX {
                let seconds = LOSS_SPAN_NS / NS_PER_S;
                let why = "its cable is bad, or this computer too busy";
                self.tell(io, format!("the lidar's line lost bytes {lost} times in {seconds} s: {why}"));
            }
        }
    }
}

fn about(found: &Found, port: std::path::Display<'_>) -> String {
    let rate = NS_PER_S / found.sample_ns.max(1);
    let (model, firmware) = (found.info.model, found.info.firmware_text());
    format!("model {model:#04x}, firmware {firmware}, at {port}: mode {}, {rate} samples a second", found.mode)
}

impl Line {
    /// Reads, answers and writes what there is.
    fn serve(&mut self, now_ns: u64, samples: &mut Vec<Sample>) -> Result<(), SerialError> {
        let mut buffer = [0; READ_BYTES];
        for _ in 0..READS_MAX {
            let count = self.port.read(&mut buffer)?;
            self.session.received(now_ns, &buffer[..count], samples);
            if count < buffer.len() {
                break;
            }
        }
        self.session.tick(now_ns);
        while let Some(to_do) = self.session.next_to_do() {
            self.carry_out(&to_do);
        }
        let sent = self.port.write(&self.unsent)?;
        self.unsent.drain(..sent);
        Ok(())
    }

    fn carry_out(&mut self, to_do: &Do) {
        match to_do {
            Do::Write(bytes) => self.unsent.extend_from_slice(bytes),
            // Where the port has no such line, the motor turns by itself.
            Do::Motor(turns) => drop(self.port.set_dtr(!turns)),
        }
    }
}

impl ScanSource for RplidarSource {
    fn beams_max(&self) -> usize {
        self.settings.beams as usize
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.line.as_ref().map_or(self.reopen_ns, |line| line.session.next_timer_ns()))
    }

    fn poll(&mut self, io: &mut Io, scans: &mut ScanPort) -> Result<(), TransportError> {
        let now_ns = io.now_ns();
        if self.line.is_none() && now_ns >= self.reopen_ns {
            self.plug(io)?;
        }
        let Some(line) = &mut self.line else { return Ok(()) };
        if let Err(error) = line.serve(now_ns, &mut self.samples) {
            self.lose(io, &error);
        } else if let Some(error) = line.session.error().cloned() {
            self.tries += 1;
            self.lose(io, &error);
        }
        self.greet(io);
        self.publish(scans)?;
        self.look_after(io);
        Ok(())
    }

    fn leave(&mut self) {
        let Some(line) = &mut self.line else { return };
        for to_do in line.session.farewell() {
            line.carry_out(&to_do);
        }
        // The last word: there is nobody to tell that it was not heard.
        let _ = line.port.write(&line.unsent);
    }
}
