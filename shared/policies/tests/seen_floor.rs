//! The geometric policy asks the shield where floor was seen, and leaves the ways over unseen floor to the last.

use guidance::se2::{Point, Se2};
use guidance::{
    ActionTable, Beams, DelayedHarness, DepthView, Evidence, HandlerBody, Interaction, Judgement, Memory, Motion,
    Shield, ShieldConfig, Tilt,
};
use guidedog_policies::geometric::{GeometricConfig, GeometricEngine, Observation};
use messages::{Attitude, CueKind, Pose2, Pose3, ScanHeader, UnsafeCause};
use settings::Settings;
use std::f64::consts::{PI, TAU};
use world::{DepthConfig, DepthSensor, Scene, World};

const HANDLER: Point = Point::new(-0.75, -0.35);
const STANDING_M: f64 = 0.30;

fn shield() -> ShieldConfig {
    Settings::default().shield_config()
}

fn body() -> HandlerBody {
    HandlerBody { center: HANDLER, radius_m: 0.25, mask_radius_m: Some(0.4), seen: None }
}

/// A lidar that sees a wall ahead with an opening to the right, and a camera that sees floor straight ahead alone.
struct Senses {
    header: ScanHeader,
    ranges: Vec<f32>,
    beams: Beams,
    view: DepthView,
    memory: Memory,
}

impl Senses {
    fn new() -> Self {
        let header = ScanHeader {
            angle_min_rad: -PI,
            angle_increment_rad: TAU / 360.0,
            range_max_m: 10.0,
            ..ScanHeader::default()
        };
        let range_m = |i: u32| {
            let bearing = header.angle_min_rad + header.angle_increment_rad * f64::from(i);
            let hit_m = if bearing.cos() > 0.0 { 0.8 / bearing.cos() } else { 10.0 };
            if hit_m * bearing.sin() > -0.35 { hit_m.min(2.5) } else { 3.0 }
        };
        let ranges: Vec<f32> = (0..360).map(|i| range_m(i) as f32).collect();
        let mut beams = Beams::default();
        beams.fill(&header, &ranges).expect("a scan");
        let mut senses = Self { header, ranges, beams, view: DepthView::default(), memory: memory() };
        senses.look();
        senses
    }

    fn look(&mut self) {
        let robot_from_camera = Pose3 { x_m: 0.28, z_m: 0.40, ..Pose3::default() };
        let config = DepthConfig { width: 128, height: 64, redwood: 0.0, robot_from_camera, ..DepthConfig::default() };
        let mut camera = DepthSensor::new(config, 1, 1).expect("a camera");
        let tilt = Tilt::of(&Attitude::at_height(1, 0.0, 0.0, STANDING_M)).expect("level");
        let world = World::new(2.6, Vec::new());
        let scene = Scene::without_people(&world, Pose2::default(), Some(tilt));
        let mut pixels_mm = vec![0; camera.pixels()];
        for frame in 1..=5 {
            camera.render(&scene, frame, &mut pixels_mm);
            self.view.fill_tilted(&camera.depth_header(), &pixels_mm, Some(&tilt)).expect("a frame");
            self.memory.update(frame * 100_000_000, &Se2::identity(), &self.beams, Some(&self.view), &body());
        }
    }

    fn evidence(&self) -> Evidence<'_> {
        Evidence { depth: Some(&self.view), memory: Some(&self.memory), ..Evidence::scan(&self.beams) }
    }

    /// What the policy makes of it, asking the shield or not.
    fn shares(&self, asks: bool) -> Vec<f32> {
        let config = GeometricConfig { shield: asks.then(shield), ..GeometricConfig::default() };
        let observation = Observation {
            scan: &self.header,
            ranges: &self.ranges,
            obstacles: &[],
            shield: asks.then(|| (self.evidence(), body())),
            handler: Some(HANDLER),
            odom_from_robot: Pose2::default(),
            odometry_incarnation: 1,
            start_from_robot: Pose2::default(),
            cue: CueKind::Forward,
            cue_is_new: true,
            formation: messages::Formation::Beside,
        };
        GeometricEngine::new(config, ActionTable::eight()).decide(&observation).to_vec()
    }

    fn judgements(&self) -> Vec<Judgement> {
        let (table, harness) = (ActionTable::eight(), DelayedHarness::default());
        let handler = Se2::translation(HANDLER.x, HANDLER.y);
        let motions = table.actions().iter().map(|action| {
            let end = action.start_from_end();
            Motion::new(end, end * harness.step(&handler, &end))
        });
        let mut judgements = Vec::new();
        Shield::new(shield()).judge_motions(motions, self.evidence(), body(), &mut judgements);
        judgements
    }
}

fn memory() -> Memory {
    let settings = Settings::default();
    Memory::new(settings.shield.memory.config(settings.footing()))
}

#[test]
fn ways_over_floor_that_was_not_seen_come_last() {
    let senses = Senses::new();
    let judgements = senses.judgements();
    let is_unseen = |action: usize| judgements[action].cause == UnsafeCause::FloorUnseen;
    let best = |shares: &[f32]| (0..shares.len()).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).expect("actions");
    let (asked, unasked) = (senses.shares(true), senses.shares(false));
    assert!(is_unseen(best(&unasked)), "the scene tempts to no unseen floor: {unasked:?}");
    let count = judgements.len();
    let moves_over_seen_floor = (0..count).any(|i| i != ActionTable::STOP && !is_unseen(i) && asked[i] > 0.0);
    assert!(moves_over_seen_floor && asked[..count].iter().all(|share| *share > 0.0), "it stands: {asked:?}");
    let least_seen = (0..count).filter(|i| !is_unseen(*i)).map(|i| asked[i]).fold(f32::INFINITY, f32::min);
    let most_unseen = (0..count).filter(|i| is_unseen(*i)).map(|i| asked[i]).fold(0.0, f32::max);
    assert!(least_seen > most_unseen, "{asked:?}");
}
