//! A digest over all actions taken and permits given: two runs that did the same have the same.

use messages::{Header, Permit, PolicyAction, Twist2};
use sha2::{Digest as _, Sha256};

/// SHA-256 over the fields that mean something, in the order in which they came.
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

    fn velocity(&mut self, velocity: &Twist2) {
        self.numbers(&[velocity.vx_mps.to_bits(), velocity.vy_mps.to_bits(), velocity.wz_radps.to_bits()]);
    }

    /// Takes in an action.
    pub fn action(&mut self, action: &PolicyAction) {
        self.header(&action.header);
        self.numbers(&[action.decision, action.action_table_id, action.cue_seq, action.scan_seq, action.depth_seq]);
        for probability in &action.probabilities {
            self.0.update(probability.to_le_bytes());
        }
    }

    /// Takes in a permit.
    pub fn permit(&mut self, permit: &Permit) {
        self.header(&permit.header);
        self.numbers(&[
            permit.outcome as u64,
            permit.cause as u64,
            permit.decision,
            u64::from(permit.action),
            u64::from(permit.unsafe_mask),
            permit.action_end_ns,
            permit.expiry_ns,
            permit.epoch,
            permit.cue_seq,
            permit.scan_seq,
            permit.odometry_seq,
            permit.depth_seq,
            permit.margin_m.to_bits(),
            permit.unseen_area_m2.to_bits(),
        ]);
        self.velocity(&permit.velocity);
    }

    /// The digest so far.
    #[must_use]
    pub fn value(&self) -> [u8; 32] {
        self.0.clone().finalize().into()
    }
}
