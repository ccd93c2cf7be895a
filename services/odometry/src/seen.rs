//! Attitudes from the camera, for robots that do not measure theirs: see [`Stance`].

use guidance::Stance;
use messages::{Attitude, DepthFrame, NS_PER_S, Odometry, age_ns};
use settings::Settings;
use transport::{FrameSubscriber, FromChild, Io, TransportError};

/// What every operator has to know of such a run.
const NOTE: &str = "roll, pitch and height come from depth images alone: a ramp or a low step counts as a tilt of the \
                    body, and falls are not detected";

/// Poses in a row whose roll and pitch are exactly 0, after which the operator is told.
const LEVEL_TELL: u32 = 100;
/// The most that the operator is told.
const TOLD_MAX: usize = 16;
const LEVEL_NOTE: &str = "the source of the poses tells a roll and a pitch of exactly 0: if it does not measure them, \
                          set odometry.attitude = \"depth\"";

/// Notices a source that fills in an attitude that it does not know, as odometry in the plane does.
#[derive(Debug, Default)]
pub struct AlwaysLevel {
    in_a_row: u32,
}

impl AlwaysLevel {
    /// Takes what the source tells. Returns what the operator is to be told, once.
    pub fn note(&mut self, told: &Attitude) -> Option<&'static str> {
        let is_level = told.is_known() && told.roll_rad == 0.0 && told.pitch_rad == 0.0;
        self.in_a_row = if is_level { self.in_a_row.saturating_add(1) } else { 0 };
        (self.in_a_row == LEVEL_TELL).then_some(LEVEL_NOTE)
    }
}

/// Without floor in view for longer, a body counts as level: it stands before something. One that stumbles and leans
/// further than the camera can tell is up again by then, nanoseconds.
const LEVEL_AFTER_NS: u64 = NS_PER_S;
const NO_FLOOR_NOTE: &str = "the camera has seen no floor for a second: until it does, the body counts as level";
const MEASURED_NOTE: &str = "the source of the poses measures roll and pitch, and odometry.attitude = \"depth\" puts \
                             those of depth images in their place: remove it";

/// How the body is held, as the newest depth frame shows it.
#[derive(Debug)]
pub struct SeenAttitude {
    frames: FrameSubscriber<DepthFrame>,
    stance: Stance,
    standing_m: f64,
    /// Stale before the first frame, which is not the same as unknown: an unknown attitude counts as level.
    newest: Attitude,
    /// Stamp of the last frame that showed the floor, nanoseconds.
    found_ns: u64,
    /// Whether the source is a real one, which may know better.
    is_real: bool,
    /// What the operator was told already.
    told: Vec<String>,
}

impl SeenAttitude {
    /// Listens to the camera from now on, and tells the operator what that means.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        io.tell(&FromChild::Note { text: NOTE.to_owned() });
        let standing_m = settings.robot.body_height_m.get();
        Ok(Self {
            frames: io.frame_subscriber()?,
            stance: Stance::default(),
            standing_m,
            newest: Attitude::at_height(1, 0.0, 0.0, standing_m),
            found_ns: 0,
            is_real: settings.has_real_odometry(),
            told: Vec::new(),
        })
    }

    /// Looks at the frames that have come.
    ///
    /// # Errors
    /// Where the topic is broken.
    pub fn look(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(frame) = self.frames.take()? {
            let stamp_ns = frame.meta().header.stamp_ns;
            match self.stance.attitude(frame.meta(), frame.data(), self.standing_m) {
                Ok(Some(attitude)) => (self.newest, self.found_ns) = (attitude, stamp_ns),
                // Until then the last one grows old, and nothing is judged on.
                Ok(None) if age_ns(stamp_ns, self.found_ns) <= LEVEL_AFTER_NS => {}
                Ok(None) => {
                    self.newest = Attitude::at_height(stamp_ns, 0.0, 0.0, self.standing_m);
                    self.tell(io, NO_FLOOR_NOTE.to_owned());
                }
                Err(error) => self.tell(io, format!("no attitude from the camera: {error}")),
            }
        }
        Ok(())
    }

    /// The pose with the newest attitude in place of what its source tells.
    pub fn hold(&mut self, io: &Io, pose: Odometry) -> Odometry {
        if self.is_real && pose.attitude.is_known() && [pose.attitude.roll_rad, pose.attitude.pitch_rad] != [0.0; 2] {
            self.tell(io, MEASURED_NOTE.to_owned());
        }
        Odometry { attitude: self.newest, ..pose }
    }

    fn tell(&mut self, io: &Io, text: String) {
        if !self.told.contains(&text) && self.told.len() < TOLD_MAX {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told.push(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{AlwaysLevel, LEVEL_TELL};
    use messages::Attitude;

    #[test]
    fn a_source_that_is_always_level_is_told_of_once() {
        let (mut watch, level) = (AlwaysLevel::default(), Attitude::at_height(1, 0.0, 0.0, 0.3));
        let told = |watch: &mut AlwaysLevel| (0..10 * LEVEL_TELL).filter(|_| watch.note(&level).is_some()).count();
        assert_eq!(told(&mut watch), 1);
        let mut sways = AlwaysLevel::default();
        let swaying = Attitude { pitch_rad: 1e-4, ..level };
        assert!((0..LEVEL_TELL).all(|i| sways.note(if i % 50 == 0 { &swaying } else { &level }).is_none()));
        let mut unknown = AlwaysLevel::default();
        assert_eq!((0..LEVEL_TELL).find_map(|_| unknown.note(&Attitude::default())), None, "nothing is told at all");
    }
}
