//! Robot and handler stay within the hull that was judged.

#![allow(clippy::print_stdout, reason = "the figures are worth reading")]

use std::convert::Infallible;
use std::sync::Arc;

use guidedog_episodes::{Excess, OpenFloor};
use messages::Pose2;
use settings::{Profile, Settings, SimulatedNoise};
use world::{Physics, PhysicsConfig, World};

fn measure(settings: &Settings, decisions: usize) -> Excess {
    let world = Arc::new(World::new(2.6, Vec::new()));
    let mut physics = Physics::new(world, PhysicsConfig::from(settings), Pose2::default()).expect("a free start");
    let mut floor = OpenFloor::new(settings).expect("settings");
    let step = |command| {
        physics.step(command);
        Ok::<_, Infallible>(physics.truth())
    };
    let Ok(excess) = floor.measure(decisions, 1, step);
    println!("{excess}");
    excess
}

#[test]
fn a_robot_on_legs_and_its_handler_stay_within_the_hull() {
    let mut settings = settings::load(Profile::Go2, None).expect("it is built in");
    settings.simulation.noise = SimulatedNoise::Legged;
    let excess = measure(&settings, 5_000);
    assert_eq!(excess.beyond(), 0);
    assert!(Excess::quantile_m(&excess.wider_m, 0.5) <= 0.05);
}
