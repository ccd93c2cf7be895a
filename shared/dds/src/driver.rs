//! What is said to a robot, and when: pure, for the process that has it on its network.
//!
//! A robot may keep its last velocity when nothing more comes, for a second or for ever: each wish says for how long it
//! holds, and what follows on it is a stop, which is said until it is answered.

use messages::Twist2;

use crate::Posture;

/// From one word to the next, nanoseconds.
pub const PERIOD_NS: u64 = 20_000_000;
/// A stop that is not answered for so long is said less often, nanoseconds: nobody may be there.
const INSISTS_NS: u64 = 1_000_000_000;
/// From then on, nanoseconds.
const SELDOM_NS: u64 = 500_000_000;
/// Between two words to unlock its joints, nanoseconds: it takes its time.
const BALANCE_NS: u64 = 500_000_000;

/// How a stop is taken note of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stops {
    /// The robot answers it.
    Answered,
    /// Nobody answers: it is said for a second.
    Unanswered,
}

/// What is to be said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Say {
    /// Walk so; not zero.
    Move(Twist2),
    /// Stand.
    Stop,
    /// Unlock the joints.
    Balance,
}

/// What the robot was told last, as far as it matters.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Told {
    /// To walk.
    Move(Twist2),
    /// To stand, since then, nanoseconds; not answered.
    Stop(u64),
    /// It stands, or is somebody else's to move.
    Nothing,
}

/// Wishes in, words out.
#[derive(Debug, Clone)]
pub struct Driver {
    stops: Stops,
    wish: Twist2,
    until_ns: u64,
    insists: bool,
    told: Told,
    /// When the last word was said, nanoseconds.
    said_ns: Option<u64>,
    posture: Posture,
    remote_stop: bool,
}

impl Driver {
    /// A driver that wishes for nothing. Whoever moved the robot before may have left it walking: it begins with a
    /// stop.
    #[must_use]
    pub fn new(stops: Stops, now_ns: u64) -> Self {
        Self { told: Told::Stop(now_ns), ..Self::silent(stops) }
    }

    /// A driver that says nothing until it is asked to.
    #[must_use]
    pub fn silent(stops: Stops) -> Self {
        Self {
            stops,
            wish: Twist2::ZERO,
            until_ns: 0,
            insists: false,
            told: Told::Nothing,
            said_ns: None,
            posture: Posture::Ready,
            remote_stop: false,
        }
    }

    /// Wishes for a velocity until then. Who stops it by the remote, or lets it lie, has the robot.
    pub fn wish(&mut self, velocity: Twist2, until_ns: u64) {
        (self.wish, self.until_ns) = (velocity, until_ns);
    }

    /// From now on, or no longer, a stop is said at every period, answered or not: somebody else may say the contrary.
    pub fn insist(&mut self, insists: bool) {
        if self.insists && !insists && matches!(self.told, Told::Stop(_)) {
            // Whoever walks the robot now is not interrupted, were the stop never answered.
            self.told = Told::Nothing;
        }
        self.insists = insists;
    }

    /// The robot is back: nobody knows what it has heard.
    pub fn begin_again(&mut self, now_ns: u64) {
        (self.told, self.said_ns) = (Told::Stop(now_ns), None);
    }

    /// For how long a stop has not been answered, nanoseconds, by a robot that answers them.
    #[must_use]
    pub fn unanswered_ns(&self, now_ns: u64) -> u64 {
        match self.told {
            Told::Stop(since_ns) if self.stops == Stops::Answered => now_ns.saturating_sub(since_ns),
            _ => 0,
        }
    }

    /// How the robot stands, as it told last.
    pub fn stands(&mut self, posture: Posture) {
        self.posture = posture;
    }

    /// Somebody stops the robot by its hand remote. It holds until [`Driver::forget_remote_stop`].
    pub fn stopped_by_remote(&mut self) {
        self.remote_stop = true;
    }

    /// Whether somebody has.
    #[must_use]
    pub fn remote_stop(&self) -> bool {
        self.remote_stop
    }

    /// The operator has taken note of the stop on the hand remote.
    pub fn forget_remote_stop(&mut self) {
        self.remote_stop = false;
    }

    /// The robot has answered a stop: it stands.
    pub fn stop_answered(&mut self) {
        if matches!(self.told, Told::Stop(_)) {
            self.told = Told::Nothing;
        }
    }

    /// What to say now, if anything.
    pub fn say(&mut self, now_ns: u64) -> Option<Say> {
        let allowed = now_ns < self.until_ns && !self.insists && !self.remote_stop && self.wish.is_finite();
        match self.posture {
            Posture::Ready if allowed && !self.wish.is_zero() => self.walk(now_ns),
            Posture::Locked if allowed && !self.wish.is_zero() => {
                let due = self.is_due(now_ns, BALANCE_NS);
                due.then(|| self.said(Say::Balance, now_ns))
            }
            _ => self.stop(now_ns),
        }
    }

    fn walk(&mut self, now_ns: u64) -> Option<Say> {
        let again = self.told == Told::Move(self.wish);
        if again && !self.is_due(now_ns, PERIOD_NS) {
            return None;
        }
        self.told = Told::Move(self.wish);
        Some(self.said(Say::Move(self.wish), now_ns))
    }

    fn stop(&mut self, now_ns: u64) -> Option<Say> {
        let since_ns = match self.told {
            Told::Stop(since_ns) => since_ns,
            // Who lies is left as it is.
            Told::Nothing if self.posture == Posture::Down => return None,
            // At once, whatever was said a moment ago.
            Told::Move(_) => {
                (self.told, self.said_ns) = (Told::Stop(now_ns), None);
                now_ns
            }
            Told::Nothing if self.insists => now_ns,
            Told::Nothing => return None,
        };
        let is_old = now_ns.saturating_sub(since_ns) > INSISTS_NS;
        let is_over = self.stops == Stops::Unanswered || self.posture == Posture::Down;
        if is_old && is_over && !self.insists {
            self.told = Told::Nothing;
            return None;
        }
        let period_ns = if is_old && !self.insists { SELDOM_NS } else { PERIOD_NS };
        self.is_due(now_ns, period_ns).then(|| self.said(Say::Stop, now_ns))
    }

    fn is_due(&self, now_ns: u64, period_ns: u64) -> bool {
        self.said_ns.is_none_or(|said_ns| now_ns.saturating_sub(said_ns) >= period_ns)
    }

    fn said(&mut self, say: Say, now_ns: u64) -> Say {
        self.said_ns = Some(now_ns);
        say
    }
}

#[cfg(test)]
mod tests {
    use messages::Twist2;

    use super::{Driver, Say, Stops};
    use crate::Posture;

    const MS: u64 = 1_000_000;
    const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.25 };

    /// What is said from one time to the next, asked every 5 ms.
    fn said(driver: &mut Driver, from_ms: u64, to_ms: u64) -> Vec<Say> {
        (from_ms..to_ms).step_by(5).filter_map(|ms| driver.say(ms * MS)).collect()
    }

    fn quiet() -> Driver {
        Driver::silent(Stops::Answered)
    }

    #[test]
    fn a_driver_begins_with_a_stop_until_it_is_answered() {
        let mut driver = Driver::new(Stops::Answered, 0);
        assert_eq!(said(&mut driver, 0, 100), [Say::Stop; 5]);
        driver.stop_answered();
        assert_eq!(said(&mut driver, 100, 5000), []);
    }

    #[test]
    fn a_wish_is_said_every_period_and_a_stop_at_its_end() {
        let mut driver = quiet();
        driver.wish(AHEAD, 100 * MS);
        assert_eq!(said(&mut driver, 0, 100), [Say::Move(AHEAD); 5]);
        assert_eq!(driver.say(100 * MS), Some(Say::Stop), "it has expired");
        assert_eq!(driver.say(105 * MS), None);
        driver.wish(AHEAD, 300 * MS);
        assert_eq!(driver.say(106 * MS), Some(Say::Move(AHEAD)), "another word does not wait");
        driver.wish(Twist2::ZERO, 300 * MS);
        assert_eq!(driver.say(107 * MS), Some(Say::Stop), "a stop least of all");
        for wrong in [Twist2 { vx_mps: f64::NAN, ..AHEAD }, Twist2::ZERO] {
            driver.wish(wrong, 300 * MS);
            assert!(!matches!(driver.say(200 * MS), Some(Say::Move(_))));
        }
    }

    #[test]
    fn a_stop_that_nobody_answers_is_said_less_often_or_no_more() {
        let mut driver = Driver::new(Stops::Answered, 0);
        said(&mut driver, 0, 1005);
        assert_eq!(said(&mut driver, 1005, 3005).len(), 4);
        let mut driver = Driver::new(Stops::Unanswered, 0);
        assert_eq!(said(&mut driver, 0, 1005).len(), 51);
        assert_eq!(said(&mut driver, 1005, 9000), []);
    }

    #[test]
    fn who_insists_says_stop_whatever_is_answered_or_wished() {
        let mut driver = quiet();
        driver.insist(true);
        driver.wish(AHEAD, u64::MAX);
        assert_eq!(said(&mut driver, 0, 100), [Say::Stop; 5]);
        driver.stop_answered();
        assert_eq!(said(&mut driver, 2000, 2100), [Say::Stop; 5]);
        driver.insist(false);
        driver.wish(Twist2::ZERO, 0);
        assert_eq!(said(&mut driver, 2100, 5000), []);
        driver.begin_again(5000 * MS);
        assert_eq!(said(&mut driver, 5000, 5100), [Say::Stop; 5], "it is back");
        assert_eq!((driver.unanswered_ns(5100 * MS), quiet().unanswered_ns(5100 * MS)), (100 * MS, 0));
    }

    #[test]
    fn a_robot_that_lies_is_left_alone_and_a_locked_one_is_told_to_balance_first() {
        let mut driver = quiet();
        driver.wish(AHEAD, u64::MAX);
        driver.stands(Posture::Down);
        assert_eq!(said(&mut driver, 0, 1000), []);
        driver.stands(Posture::Locked);
        assert_eq!(said(&mut driver, 1000, 2000), [Say::Balance; 2]);
        driver.stands(Posture::Ready);
        assert_eq!(driver.say(2000 * MS), Some(Say::Move(AHEAD)));
        driver.stands(Posture::Down);
        assert_eq!(driver.say(2001 * MS), Some(Say::Stop), "it fell");
        assert_eq!(said(&mut driver, 2001, 9001).len(), 50, "for a second");
        driver.insist(true);
        assert_eq!(said(&mut driver, 9001, 9500), []);
    }

    #[test]
    fn a_stop_by_the_remote_holds_until_it_is_forgotten() {
        let mut driver = quiet();
        driver.wish(AHEAD, u64::MAX);
        driver.say(0);
        driver.stopped_by_remote();
        assert_eq!(driver.say(MS), Some(Say::Stop));
        driver.stop_answered();
        assert_eq!(said(&mut driver, 2, 1000), []);
        driver.forget_remote_stop();
        assert_eq!(driver.say(1000 * MS), Some(Say::Move(AHEAD)));
    }
}
