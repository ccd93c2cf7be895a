//! How long the robot got nowhere although it was asked to walk: it stood, or turned to and fro.

use guidance::se2::{Se2, exp};
use messages::{LocomotionState, Mode, ModeClass, NS_PER_S, Twist2, s_from_ns};

/// A robot that has come as far as this, metres, has got somewhere.
const SOMEWHERE_M: f64 = 0.25;
/// States that are farther apart tell nothing of the time between them, nanoseconds.
const APART_NS: u64 = NS_PER_S / 4;

/// See the module. Time in a fault does not count, and does not begin anew: after it the robot is as far as before. A
/// stop by the handler and a lock do begin anew.
#[derive(Debug, Default)]
pub struct Freeze {
    /// Where the robot is by the velocities that were commanded, from where it was when it last got somewhere.
    place: Se2,
    last: Option<(u64, Twist2)>,
    asked_ns: u64,
    longest_ns: u64,
}

impl Freeze {
    /// The longest so far, nanoseconds.
    #[must_use]
    pub fn longest_ns(&self) -> u64 {
        self.longest_ns
    }

    /// What locomotion does now.
    pub fn take(&mut self, mode: &Mode, state: &LocomotionState, now_ns: u64) {
        let last = self.last.replace((now_ns, state.applied));
        match mode.class {
            ModeClass::Run if mode.cue.valid => {}
            ModeClass::Fault => return,
            ModeClass::Run | ModeClass::Lock => {
                (self.place, self.asked_ns) = (Se2::identity(), 0);
                return;
            }
        }
        let Some((before_ns, applied)) = last else { return };
        let passed_ns = now_ns.saturating_sub(before_ns).min(APART_NS);
        self.place *= exp(applied, s_from_ns(passed_ns));
        self.asked_ns += passed_ns;
        self.longest_ns = self.longest_ns.max(self.asked_ns);
        if self.place.translation.vector.norm() >= SOMEWHERE_M {
            (self.place, self.asked_ns) = (Se2::identity(), 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Freeze, LocomotionState, Mode, ModeClass, NS_PER_S, Twist2};
    use messages::{CueInForce, s_from_ns};

    const EVERY_NS: u64 = NS_PER_S / 50;

    /// The longest freeze of a run, seconds. Each phase has a mode's class, whether a cue is in force, a velocity, and
    /// how long it lasts, seconds.
    fn longest_s(phases: &[(ModeClass, bool, [f64; 3], u64)]) -> f64 {
        let (mut freeze, mut now_ns) = (Freeze::default(), 0);
        for (class, is_asked, [vx_mps, vy_mps, wz_radps], for_s) in phases {
            let cue = CueInForce { valid: *is_asked, ..CueInForce::default() };
            let mode = Mode { class: *class, cue, ..Mode::default() };
            let applied = Twist2 { vx_mps: *vx_mps, vy_mps: *vy_mps, wz_radps: *wz_radps };
            for _ in 0..for_s * 50 {
                now_ns += EVERY_NS;
                freeze.take(&mode, &LocomotionState { applied, ..LocomotionState::default() }, now_ns);
            }
        }
        s_from_ns(freeze.longest_ns())
    }

    #[test]
    fn standing_and_turning_to_and_fro_are_a_freeze_and_walking_is_none() {
        use ModeClass::{Fault, Lock, Run};
        let (walks, stands) = ((Run, true, [0.5, 0.0, 0.0], 10), (Run, true, [0.0; 3], 10));
        let turns = |radps: f64| (Run, true, [0.0, 0.0, radps], 5);
        for (phases, wanted_s) in [
            (vec![walks], 0.5),
            (vec![walks, stands, walks], 10.5),
            (vec![walks, turns(0.35), turns(-0.35), turns(0.35), walks], 15.5),
            (vec![walks, stands, (Fault, false, [0.0; 3], 60), stands, walks], 20.5),
            (vec![walks, stands, (Lock, false, [0.0; 3], 60), stands, walks], 10.5),
            (vec![walks, stands, (Run, false, [0.0; 3], 60), stands, walks], 10.5),
        ] {
            let told_s = longest_s(&phases);
            assert!((told_s - wanted_s).abs() < 0.3, "{phases:?}: {told_s}");
        }
    }
}
