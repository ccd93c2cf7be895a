//! Detects a fall from the attitude. Pure: times come in with the inputs.

use messages::{Attitude, NS_PER_S, Odometry};

/// No robot that leans so far comes back onto its legs by itself, radians.
const LEANS_RAD: f64 = 0.70;
/// It must lean for this long, so that a single wrong reading does not count.
const LEANS_NS: u64 = NS_PER_S / 10;

/// Watches how far the robot leans.
#[derive(Debug, Default)]
pub struct Fall {
    /// Stamp since which every attitude leans.
    leans_since_ns: Option<u64>,
}

impl Fall {
    /// Takes the newest attitude. Returns whether the robot has fallen.
    pub fn has_fallen(&mut self, odometry: &Odometry) -> bool {
        let Attitude { stamp_ns, roll_rad, pitch_rad, .. } = odometry.attitude;
        let is_angle = |rad: f64| rad.abs() <= std::f64::consts::PI;
        let leans = odometry.attitude.is_known()
            && is_angle(roll_rad)
            && is_angle(pitch_rad)
            && roll_rad.abs().max(pitch_rad.abs()) > LEANS_RAD;
        let since_ns = *self.leans_since_ns.get_or_insert(stamp_ns);
        if !leans {
            self.leans_since_ns = None;
        }
        leans && stamp_ns.saturating_sub(since_ns) >= LEANS_NS
    }
}

#[cfg(test)]
mod tests {
    use super::Fall;
    use messages::{Attitude, Odometry};

    fn at(ms: u64, roll_rad: f64, pitch_rad: f64) -> Odometry {
        let attitude = Attitude { stamp_ns: ms * 1_000_000, roll_rad, pitch_rad, height_m: 0.1, standing_m: 0.3 };
        Odometry { attitude, ..Odometry::default() }
    }

    #[test]
    fn who_leans_for_a_tenth_of_a_second_has_fallen() {
        let mut fall = Fall::default();
        let lies = |fall: &mut Fall, ms: u64| fall.has_fallen(&at(ms, -1.5, 0.1));
        assert!(!lies(&mut fall, 1000) && !lies(&mut fall, 1080) && lies(&mut fall, 1100) && lies(&mut fall, 1120));
        assert!(!fall.has_fallen(&at(1140, 0.1, 0.1)), "it stands again");
        assert!(!lies(&mut fall, 1160), "and would have to fall again");
    }

    #[test]
    fn who_sways_or_tells_no_attitude_has_not() {
        let mut fall = Fall::default();
        for ms in (1000..3000).step_by(20) {
            assert!(!fall.has_fallen(&at(ms, 0.2 * (ms as f64).sin(), -0.2)), "{ms}");
            assert!(!fall.has_fallen(&at(0, -1.5, 0.0)), "no source reports it");
            assert!(!fall.has_fallen(&at(ms, f64::NAN, 1e9)), "these are not angles");
        }
    }
}
