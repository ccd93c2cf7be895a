//! What is said to a robot, tick by tick: pure, for the thread that talks to it.
//!
//! A robot may keep its last command for ever when nothing more comes, so something always comes: zero where nobody
//! has wished for anything lately, and then that it stand. A robot that nobody has moved yet, or that somebody has
//! stopped by its hand remote, is told nothing of its legs: it may lie, and is not to stand up by itself.

use messages::Twist2;

use crate::{Command, Mode, Profile, State};

/// No wish holds for longer, nanoseconds.
pub const DEAD_MAN_NS: u64 = 200_000_000;
/// After zero for so long the robot is told to stand, nanoseconds: its gait has come to rest by then.
const STAND_AFTER_NS: u64 = 500_000_000;
/// Triggers that take an AlienGo into sport mode, one a tick, as its maker's example sends them.
const TRIGGERS: u32 = 45;
/// A robot that said nothing for so long may have been switched off and on since, nanoseconds.
const AWAY_NS: u64 = 1_000_000_000;
/// A state that is older says nothing about now, nanoseconds.
pub const STATE_MAX_AGE_NS: u64 = 100_000_000;

/// Wishes in, commands out.
#[derive(Debug, Clone)]
pub struct Driver {
    profile: Profile,
    triggers: u32,
    wish: Twist2,
    until_ns: u64,
    /// When the robot was last commanded to move, nanoseconds.
    moved_ns: Option<u64>,
    state: Option<(State, u64)>,
    remote_stop: bool,
}

impl Driver {
    /// A driver that wishes for nothing.
    #[must_use]
    pub fn new(profile: Profile) -> Self {
        Self { profile, triggers: 0, wish: Twist2::ZERO, until_ns: 0, moved_ns: None, state: None, remote_stop: false }
    }

    /// Wishes for a velocity until then.
    pub fn wish(&mut self, velocity: Twist2, until_ns: u64) {
        (self.wish, self.until_ns) = (velocity, until_ns);
    }

    /// A state has come. A robot that was not there before is taken into sport mode first. A stop on the hand remote
    /// holds until [`Driver::forget_remote_stop`].
    pub fn received(&mut self, state: State, now_ns: u64) {
        let there = self.state.is_some_and(|(_, came_ns)| now_ns.saturating_sub(came_ns) <= AWAY_NS);
        if !there && self.profile == Profile::AlienGo384 {
            self.triggers = TRIGGERS;
        }
        if state.remote.says_stop() {
            (self.remote_stop, self.moved_ns) = (true, None);
        }
        self.state = Some((state, now_ns));
    }

    /// The newest state and when it came, while it is young enough.
    #[must_use]
    pub fn state(&self, now_ns: u64) -> Option<(State, u64)> {
        self.state.filter(|(_, came_ns)| now_ns.saturating_sub(*came_ns) <= STATE_MAX_AGE_NS)
    }

    /// Whether somebody has stopped the robot by its hand remote.
    #[must_use]
    pub fn remote_stop(&self) -> bool {
        self.remote_stop
    }

    /// The operator has taken note of the stop on the hand remote.
    pub fn forget_remote_stop(&mut self) {
        self.remote_stop = false;
    }

    /// What to send now.
    pub fn command(&mut self, now_ns: u64) -> Command {
        if self.triggers > 0 {
            self.triggers -= 1;
            return Command { trigger: true, ..Command::default() };
        }
        let allowed = now_ns <= self.until_ns && !self.remote_stop && self.wish.is_finite();
        let velocity = if allowed { self.wish } else { Twist2::ZERO };
        if !velocity.is_zero() {
            self.moved_ns = Some(now_ns);
        }
        let mode = match self.moved_ns {
            Some(moved_ns) if now_ns.saturating_sub(moved_ns) <= STAND_AFTER_NS => Mode::Walk,
            Some(_) => Mode::Stand,
            // Whoever moved it before may have left it walking.
            None if !self.remote_stop && self.state(now_ns).is_some_and(|(state, _)| state.walks()) => Mode::Walk,
            None => Mode::Idle,
        };
        Command { mode, velocity, ..Command::default() }
    }

    /// The profile.
    #[must_use]
    pub fn profile(&self) -> Profile {
        self.profile
    }
}

#[cfg(test)]
mod tests {
    use messages::Twist2;

    use super::{DEAD_MAN_NS, Driver, TRIGGERS};
    use crate::{Button, EmulatedRobot, Mode, Profile, Remote, Silence, State};

    const MS: u64 = 1_000_000;
    const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.25 };

    /// Driver and robot over a line, a tick of 2 ms at a time.
    struct Rig {
        now_ns: u64,
        driver: Driver,
        robot: EmulatedRobot,
    }

    impl Rig {
        fn new(profile: Profile) -> Self {
            let robot = EmulatedRobot::new(profile, Silence::HoldsLast);
            Self { now_ns: 0, driver: Driver::new(profile), robot }
        }

        fn run(&mut self, for_ms: u64, wish: Option<Twist2>) -> Twist2 {
            let mut velocity = Twist2::ZERO;
            for _ in 0..for_ms / 2 {
                self.now_ns += 2 * MS;
                if let Some(wish) = wish {
                    self.driver.wish(wish, self.now_ns + DEAD_MAN_NS);
                }
                let profile = self.driver.profile();
                let mut command = vec![0; profile.command_len()];
                self.driver.command(self.now_ns).encode(profile, &mut command);
                self.robot.received(&command, self.now_ns).expect("a command");
                velocity = self.robot.velocity(self.now_ns);
                let mut state = vec![0; profile.state_len()];
                self.robot.state(State { velocity, ..State::default() }).encode(profile, &mut state);
                self.driver.received(State::decode(profile, &state).expect("a state"), self.now_ns);
            }
            velocity
        }
    }

    #[test]
    fn a_robot_walks_as_long_as_it_is_wished_and_then_stands() {
        for profile in Profile::ALL {
            let mut rig = Rig::new(profile);
            assert_eq!(rig.run(200, None), Twist2::ZERO);
            assert_eq!(rig.run(400, Some(AHEAD)), AHEAD, "{profile:?}");
            assert_eq!(rig.driver.state(rig.now_ns).map(|(state, _)| state.velocity), Some(AHEAD));
            assert_eq!(rig.run(2, Some(Twist2::ZERO)), Twist2::ZERO, "{profile:?}: zero is at once");
            assert_eq!(rig.robot.mode(), Mode::Walk, "{profile:?}: its gait comes to rest");
            rig.run(600, Some(Twist2::ZERO));
            assert_eq!(rig.robot.mode(), Mode::Stand, "{profile:?}");
            assert_eq!(rig.run(2, Some(AHEAD)), AHEAD, "{profile:?}: it walks again");
        }
    }

    #[test]
    fn who_wishes_for_nothing_any_more_lets_the_robot_stand() {
        let mut rig = Rig::new(Profile::AlienGo384);
        rig.run(400, Some(AHEAD));
        assert_eq!(rig.run(198, None), AHEAD);
        assert_eq!(rig.run(4, None), Twist2::ZERO);
        assert_eq!(rig.run(2, Some(Twist2 { vx_mps: f64::NAN, ..AHEAD })), Twist2::ZERO, "no velocity at all");
    }

    #[test]
    fn an_aliengo_that_is_switched_on_is_triggered_first() {
        let triggers = |driver: &mut Driver, now_ns| (0..100).filter(|_| driver.command(now_ns).trigger).count();
        let mut driver = Driver::new(Profile::AlienGo384);
        driver.wish(AHEAD, 0);
        assert_eq!(triggers(&mut driver, 0), 0, "nobody hears them yet");
        for (came_ms, expected) in [(500, TRIGGERS), (600, 0), (1600, 0), (2601, TRIGGERS)] {
            driver.received(State::default(), came_ms * MS);
            assert_eq!(triggers(&mut driver, came_ms * MS), expected as usize, "at {came_ms} ms");
        }
        let mut other = Driver::new(Profile::Go138);
        other.received(State::default(), 0);
        assert_eq!(triggers(&mut other, 0), 0);
    }

    #[test]
    fn a_robot_that_nobody_moved_is_left_as_it_is() {
        let mut driver = Driver::new(Profile::Go138);
        driver.wish(Twist2::ZERO, 0);
        assert_eq!(driver.command(0).mode, Mode::Idle, "it may lie");
        driver.received(State { mode: Mode::Walk as u8, ..State::default() }, 0);
        let command = driver.command(0);
        assert_eq!((command.mode, command.velocity), (Mode::Walk, Twist2::ZERO), "the link before left it walking");
    }

    #[test]
    fn a_stop_on_the_hand_remote_holds() {
        let mut rig = Rig::new(Profile::Go138);
        rig.run(200, Some(AHEAD));
        rig.robot.press(Remote { buttons: 1 << Button::L2 as u16 | 1 << Button::B as u16, ..Remote::default() });
        assert_eq!(rig.run(10, Some(AHEAD)), Twist2::ZERO);
        rig.robot.press(Remote::default());
        assert_eq!(rig.run(1000, Some(AHEAD)), Twist2::ZERO);
        assert!(rig.driver.remote_stop());
        assert_eq!(rig.driver.command(rig.now_ns).mode, Mode::Idle);
        rig.run(10, Some(Twist2::ZERO));
        rig.driver.forget_remote_stop();
        assert_eq!(rig.driver.command(rig.now_ns).mode, Mode::Idle, "it stands up only to walk");
        assert_eq!(rig.run(10, Some(AHEAD)), Twist2::ZERO, "the robot itself lies limp");
    }

    #[test]
    fn a_state_that_is_old_says_nothing() {
        let mut rig = Rig::new(Profile::AlienGo331);
        rig.run(100, None);
        assert!(rig.driver.state(rig.now_ns + 100 * MS).is_some());
        assert!(rig.driver.state(rig.now_ns + 101 * MS).is_none());
    }
}
