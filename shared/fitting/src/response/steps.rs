//! Motions in what was commanded: one velocity, from standing, and standing after it.

use std::fmt;

use messages::{NS_PER_S, Twist2};

/// A motion lasts at least this, nanoseconds,
const MOTION_NS: u64 = NS_PER_S;
/// and the stop after it this,
pub(super) const STOP_NS: u64 = NS_PER_S * 3 / 2;
/// and the stop before it this.
pub(super) const BEFORE_NS: u64 = NS_PER_S / 2;
/// What is asked of them, in words.
pub(super) const NEEDED: &str = "at least 1 s followed by a zero of at least 1.5 s";
/// By then it has its velocity, nanoseconds.
const RAMP_NS: u64 = NS_PER_S * 3 / 10;
/// A slower component counts as zero, metres and radians per second.
const NONE_PER_S: f64 = 0.03;
/// A command differs from another where it is off by more, metres and radians per second.
const SAME_PER_S: f64 = 0.01;

/// A kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StepKind {
    /// Straight ahead.
    Forward,
    /// Sideways.
    SidestepLeft,
    /// Sideways.
    SidestepRight,
    /// On the spot.
    TurnLeft,
    /// On the spot.
    TurnRight,
    /// Ahead and sideways.
    DiagonalLeft,
    /// Ahead and sideways.
    DiagonalRight,
}

impl StepKind {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Forward,
        Self::SidestepLeft,
        Self::SidestepRight,
        Self::TurnLeft,
        Self::TurnRight,
        Self::DiagonalLeft,
        Self::DiagonalRight,
    ];

    /// Its name, as actions are called.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Forward => "forward",
            Self::SidestepLeft => "sidestep_left",
            Self::SidestepRight => "sidestep_right",
            Self::TurnLeft => "turn_left",
            Self::TurnRight => "turn_right",
            Self::DiagonalLeft => "diagonal_left",
            Self::DiagonalRight => "diagonal_right",
        }
    }

    /// Whether it moves ahead, sideways and in a turn.
    #[must_use]
    pub const fn axes(self) -> [bool; 3] {
        match self {
            Self::Forward => [true, false, false],
            Self::SidestepLeft | Self::SidestepRight => [false, true, false],
            Self::TurnLeft | Self::TurnRight => [false, false, true],
            Self::DiagonalLeft | Self::DiagonalRight => [true, true, false],
        }
    }

    /// The kind of a velocity; none for one that goes back, or turns as it goes.
    #[must_use]
    pub fn of(velocity: Twist2) -> Option<Self> {
        let sign = |v: f64| if v.abs() < NONE_PER_S { 0 } else { v.signum() as i32 };
        match [velocity.vx_mps, velocity.vy_mps, velocity.wz_radps].map(sign) {
            [1, 0, 0] => Some(Self::Forward),
            [0, 1, 0] => Some(Self::SidestepLeft),
            [0, -1, 0] => Some(Self::SidestepRight),
            [0, 0, 1] => Some(Self::TurnLeft),
            [0, 0, -1] => Some(Self::TurnRight),
            [1, 1, 0] => Some(Self::DiagonalLeft),
            [1, -1, 0] => Some(Self::DiagonalRight),
            _ => None,
        }
    }
}

impl fmt::Display for StepKind {
    /// In words, singular.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Forward => "motion ahead",
            Self::SidestepLeft => "sidestep to the left",
            Self::SidestepRight => "sidestep to the right",
            Self::TurnLeft => "turn to the left",
            Self::TurnRight => "turn to the right",
            Self::DiagonalLeft => "diagonal motion to the left",
            Self::DiagonalRight => "diagonal motion to the right",
        })
    }
}

/// A motion and the stop after it; times in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Which.
    pub kind: StepKind,
    /// When it was commanded.
    pub begin_ns: u64,
    /// Since when the velocity in force is lower, on its way to zero.
    pub ends_ns: u64,
    /// Since when it is zero.
    pub zero_ns: u64,
    /// The next command after that, or the end of all.
    pub end_ns: u64,
    /// The velocity in force.
    pub velocity: Twist2,
}

/// The motions in commands, times rising.
#[must_use]
pub fn find(commands: &[(u64, Twist2)]) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut stands_since_ns = commands.first().map(|(at_ns, _)| *at_ns);
    let last_ns = commands.last().map_or(0, |(at_ns, _)| *at_ns);
    let mut i = 0;
    while i < commands.len() {
        let moving = commands[i..].iter().take_while(|(_, velocity)| !velocity.is_zero()).count();
        if moving == 0 {
            stands_since_ns = stands_since_ns.or(Some(commands[i].0));
            i += 1;
            continue;
        }
        let rest = &commands[i + moving..];
        let zeros = rest.iter().take_while(|(_, velocity)| velocity.is_zero()).count();
        let end_ns = rest.get(zeros).map_or(last_ns, |(at_ns, _)| *at_ns);
        let stood = stands_since_ns.take().is_some_and(|since_ns| commands[i].0 >= since_ns + BEFORE_NS);
        if let Some((zero_ns, _)) = rest.first().filter(|_| stood) {
            steps.extend(step(&commands[i..i + moving], *zero_ns, end_ns));
        }
        i += moving;
    }
    steps
}

fn step(moving: &[(u64, Twist2)], zero_ns: u64, end_ns: u64) -> Option<Step> {
    let begin_ns = moving.first()?.0;
    if zero_ns - begin_ns < MOTION_NS || end_ns - zero_ns < STOP_NS {
        return None;
    }
    let velocity = moving[moving.len() / 2].1;
    let is_same = |other: &Twist2| {
        let off = [velocity.vx_mps - other.vx_mps, velocity.vy_mps - other.vy_mps, velocity.wz_radps - other.wz_radps];
        off.iter().all(|off| off.abs() <= SAME_PER_S)
    };
    let last = moving.iter().rposition(|(_, other)| is_same(other))?;
    let is_one = moving[..=last].iter().filter(|(at_ns, _)| *at_ns >= begin_ns + RAMP_NS).all(|(_, v)| is_same(v));
    let ends_ns = moving.get(last + 1).map_or(zero_ns, |(at_ns, _)| *at_ns);
    let kind = StepKind::of(velocity).filter(|_| is_one)?;
    Some(Step { kind, begin_ns, ends_ns, zero_ns, end_ns, velocity })
}
