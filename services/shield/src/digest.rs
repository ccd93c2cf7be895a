//! A digest over all actions taken and permits given: two runs that did the same have the same.

use messages::{Header, Permit, PolicyAction};
use sha2::{Digest as _, Sha256};

/// SHA-256 over all fields but the time of publication, in the order in which they came.
#[derive(Debug, Clone, Default)]
pub struct Digest(Sha256);

impl Digest {
    fn header(&mut self, header: &Header) {
        self.numbers(&[header.stamp_ns, header.seq, u64::from(header.incarnation)]);
    }

    fn numbers(&mut self, numbers: &[u64]) {
        for number in numbers {
            self.0.update(number.to_le_bytes());
        }
    }

    fn reals(&mut self, reals: &[f64]) {
        for real in reals {
            self.0.update(real.to_bits().to_le_bytes());
        }
    }

    /// Takes in an action. It is taken apart whole, so that no field is forgotten.
    pub fn action(&mut self, action: &PolicyAction) {
        let PolicyAction {
            header,
            decision,
            action_table_id,
            action_count,
            probabilities,
            cue_incarnation,
            cue_seq,
            formation,
            scan_stamp_ns,
            scan_seq,
            depth_stamp_ns,
            depth_seq,
            odometry_stamp_ns,
            odometry_seq,
        } = *action;
        self.header(&header);
        self.numbers(&[decision, action_table_id, action_count.into(), cue_incarnation.into(), cue_seq]);
        self.numbers(&[formation as u64]);
        self.numbers(&[scan_stamp_ns, scan_seq, depth_stamp_ns, depth_seq, odometry_stamp_ns, odometry_seq]);
        for probability in probabilities {
            self.0.update(probability.to_le_bytes());
        }
    }

    /// Takes in a permit, likewise.
    pub fn permit(&mut self, permit: &Permit) {
        let Permit {
            header,
            outcome,
            cause,
            all_unsafe,
            absent_streams,
            decision,
            action,
            unsafe_mask,
            velocity,
            action_end_ns,
            expiry_ns,
            epoch,
            policy_incarnation,
            odometry_incarnation,
            lidar_incarnation,
            cue_incarnation,
            cue_seq,
            unseen_area_m2,
            margin_m,
            beam,
            unsafe_cause,
            reading_m,
            threshold_m,
            place_x_m,
            place_y_m,
            step_m,
            assumes_floor,
            scan_seq,
            scan_stamp_ns,
            depth_seq,
            depth_stamp_ns,
            odometry_seq,
            odometry_stamp_ns,
            robot_from_handler: handler,
        } = *permit;
        self.header(&header);
        self.numbers(&[outcome as u64, cause as u64, unsafe_cause as u64, all_unsafe.into(), absent_streams.into()]);
        self.numbers(&[decision, action.into(), unsafe_mask.into(), beam.into(), action_end_ns, expiry_ns, epoch]);
        self.numbers(&[policy_incarnation, odometry_incarnation, lidar_incarnation, cue_incarnation].map(u64::from));
        self.numbers(&[cue_seq, scan_seq, scan_stamp_ns, depth_seq, depth_stamp_ns, odometry_seq, odometry_stamp_ns]);
        self.reals(&[velocity.vx_mps, velocity.vy_mps, velocity.wz_radps]);
        self.numbers(&[assumes_floor.into()]);
        self.reals(&[place_x_m, place_y_m, step_m]);
        self.reals(&[unseen_area_m2, margin_m, reading_m, threshold_m, handler.x_m, handler.y_m, handler.yaw_rad]);
    }

    /// The digest so far.
    #[must_use]
    pub fn value(&self) -> [u8; 32] {
        self.0.clone().finalize().into()
    }
}
