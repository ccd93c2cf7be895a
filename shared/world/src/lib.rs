//! The simulated physical world: 2.5-D worlds and real floor plans, the sensors that look at them, and the motion of
//! robot, handler and walking people in them.
//!
//! A world is a floor at z = 0 with [`Hole`]s in it, a ceiling, and [`Prism`]s: vertical faces over an outline, each
//! from one height to another; a [`Door`]'s leaf is one that swings. [`Ramp`]s lie on the floor, for a physics that
//! knows heights. A ROS map ([`GridMap`]) adds cells that reach from floor to ceiling. Everything is in the world frame
//! (metres, x right on a map, y up, z up, yaw counter-clockwise) unless a name says otherwise.
//!
//! Files are read only by [`World::load`], [`GridMap::load`], [`Scenario::load`] and [`Route::load`]. All else is a
//! pure function: nothing reads a clock, and noise depends on (seed, incarnation, frame number) alone, so that a run
//! can be repeated to the bit.

pub mod depth;
pub mod door;
pub mod error;
pub mod floor;
pub mod floor_plan;
pub mod generate;
pub mod grid_map;
mod grid_walk;
pub mod ground;
mod index;
pub mod legs;
pub mod lidar;
mod map_server;
mod noise;
pub mod odometry;
pub mod of_settings;
mod outline;
pub mod people;
pub mod physics;
mod polar;
pub mod prism;
pub mod ramp;
mod raster;
pub mod recorded;
mod redwood;
pub mod scenario;
pub mod scene;
pub mod sdf;
pub mod site;
mod sweep;
pub mod team;
mod text_file;
pub mod tracks;
pub mod world;
mod world_file;

pub use depth::{DepthConfig, DepthSensor};
pub use door::{Door, Opens};
pub use error::{ConfigError, WorldError};
pub use floor::{DarkFloor, Hole, Stairs};
pub use floor_plan::FloorPlan;
pub use generate::{Crowd, GeneratorConfig, generate, generate_drops};
pub use grid_map::{Cell, GridMap};
pub use legs::{Legs, LegsConfig};
pub use lidar::{LidarConfig, LidarSensor};
pub use odometry::{OdometryConfig, OdometryReading, OdometrySensor};
pub use of_settings::scenario_of;
pub use people::{Agent, Manner, Moves, Pause, People, Person, Walk};
pub use physics::{HandlerConfig, Physics, PhysicsConfig, RETURNING_MPS, RobotConfig, TICK_S};
pub use prism::{Prism, SeenBy};
pub use ramp::Ramp;
pub use scenario::{CuePoint, CueSequence, CueTrigger, Disturbance, DisturbanceKind, Goal, Route, Scenario};
pub use scene::{HANDLER_SEEN_RADIUS_M, PERSON_HEIGHT_M, Scene};
pub use site::{Behind, Course, DropKind, Mapped, Opening, Side, Site};
pub use team::{Bodies, HandlerProfile, Stepped, Team};
pub use tracks::Tracks;
pub use world::World;
