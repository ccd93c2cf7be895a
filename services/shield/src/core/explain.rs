//! What a permit tells of the judgement that it rests on.

use guidance::Judgement;
use messages::{NO_BEAM, Permit};

/// What the verdict rests on.
pub(super) fn explain(judgement: &Judgement, permit: &mut Permit) {
    permit.margin_m = judgement.margin_m;
    permit.beam = judgement.beam.map_or(NO_BEAM, |beam| beam as u32);
    (permit.reading_m, permit.threshold_m) = (judgement.reading_m, judgement.threshold_m);
    permit.unsafe_cause = judgement.cause;
    let place = judgement.place.unwrap_or_default();
    (permit.place_x_m, permit.place_y_m) = (place.x, place.y);
    permit.step_m = judgement.step_m;
    permit.assumes_floor = judgement.assumes_floor;
    permit.unseen_area_m2 = judgement.unseen_area_m2;
}
