//! A world of the project's own, built of MuJoCo's geoms around a legged robot.

use std::path::Path;

use guidance::se2::{Point, Se2};
use messages::Pose2;
use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::mj_editing::{MjsBody, MjsGeom};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use world::{GridMap, Prism, SeenBy, World};

use crate::walls::{Block, blocks};

/// A step of the physics, seconds: four make a quantum of stepped time.
pub const STEP_S: f64 = 0.0025;
/// The walls of the project's worlds are thin; a geom is as thick as this, metres.
const WALL_M: f64 = 0.02;

/// Group of the geoms that stand still and that lidar and camera see. The robot's own are in groups 2 and 3.
pub const SEEN: i32 = 1;
/// Of those that the camera alone sees: glass that is dirty.
pub const SEEN_BY_CAMERA: i32 = 4;
/// Of those that no sensor sees: clean glass.
pub const UNSEEN: i32 = 5;

/// What keeps a scene from being built.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {what}")]
pub struct SceneError {
    /// The robot's model.
    pub file: String,
    /// What is wrong with it, or with what was built around it.
    pub what: String,
}

/// A model of a robot with a free body named `base`, from an MJCF file, in a world: its body stands over `start` (world
/// frame), `body_m` above the floor.
///
/// # Errors
/// Where the file cannot be read or holds no such body, or MuJoCo refuses the scene.
pub fn build(robot: &Path, world: &World, start: Pose2, body_m: f64) -> Result<MjModel, SceneError> {
    let wrong = |what: String| SceneError { file: robot.display().to_string(), what };
    let mut spec = MjSpec::from_xml(robot).map_err(|error| wrong(error.to_string()))?;
    spec.option_mut().timestep = STEP_S;
    let base = spec.body_mut("base").ok_or_else(|| wrong("it has no body named base".to_owned()))?;
    *base.pos_mut() = [start.x_m, start.y_m, body_m];
    *base.quat_mut() = turned(start.yaw_rad);
    let still = spec.world_body_mut();
    still.add_geom().with_type(MjtGeomBase::mjGEOM_PLANE).with_size([0.0, 0.0, 1.0]).with_group(SEEN);
    if let Some(map) = world.map() {
        add_map(still, map, world.ceiling_m());
    }
    world.prisms().iter().for_each(|prism| add_prism(still, prism));
    spec.compile().map_err(|error| wrong(error.to_string()))
}

fn turned(yaw_rad: f64) -> [f64; 4] {
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    [turned.w, turned.i, turned.j, turned.k]
}

fn add_map(still: &mut MjsBody, map: &GridMap, ceiling_m: f64) {
    let (first, column) = (map.middle(0, 0), map.middle(1, 0) - map.middle(0, 0));
    let row = Vector2::new(-column.y, column.x);
    let yaw_rad = column.y.atan2(column.x);
    for Block { columns, rows } in blocks(map) {
        let middle = |(from, to): (usize, usize)| (from + to - 1) as f64 / 2.0;
        let size = [columns, rows].map(|(from, to)| (to - from) as f64 * map.resolution_m());
        let at = first + column * middle(columns) + row * middle(rows);
        add_box(still, Se2::new(at.coords, yaw_rad), size, [0.0, ceiling_m]);
    }
}

fn add_prism(still: &mut MjsBody, prism: &Prism) {
    let (z, outline) = ([prism.z0_m, prism.z1_m], &prism.outline);
    let group = match prism.seen_by {
        SeenBy::Both => SEEN,
        SeenBy::Camera => SEEN_BY_CAMERA,
        SeenBy::Nobody => UNSEEN,
    };
    let along = |a: Point, b: Point| Se2::new(nalgebra::center(&a, &b).coords, (b - a).y.atan2((b - a).x));
    match outline.len() {
        // A box; any other solid is a round pillar.
        4 if prism.solid => {
            let middle = nalgebra::center(&outline[0], &outline[2]);
            let pose = Se2::new(middle.coords, along(outline[0], outline[1]).rotation.angle());
            let size = [(outline[1] - outline[0]).norm(), (outline[2] - outline[1]).norm()];
            add_box(still, pose, size, z).set_group(group);
        }
        count if prism.solid => {
            let middle = outline.iter().fold(Vector2::zeros(), |sum, corner| sum + corner.coords) / count as f64;
            let radius_m = (outline[0].coords - middle).norm();
            let geom = still.add_geom().with_type(MjtGeomBase::mjGEOM_CYLINDER).with_group(group);
            *geom.pos_mut() = [middle.x, middle.y, f64::midpoint(z[0], z[1])];
            *geom.size_mut() = [radius_m, (z[1] - z[0]) / 2.0, 0.0];
        }
        _ => {
            for (a, b) in prism.sides().filter(|(a, b)| a != b) {
                add_box(still, along(a, b), [(b - a).norm(), WALL_M], z).set_group(group);
            }
        }
    }
}

/// A box, `size` along its own x and y axes.
fn add_box(still: &mut MjsBody, at: Se2, size: [f64; 2], [z0_m, z1_m]: [f64; 2]) -> &mut MjsGeom {
    let geom = still.add_geom().with_type(MjtGeomBase::mjGEOM_BOX).with_group(SEEN);
    *geom.pos_mut() = [at.translation.x, at.translation.y, f64::midpoint(z0_m, z1_m)];
    *geom.quat_mut() = turned(at.rotation.angle());
    *geom.size_mut() = [size[0] / 2.0, size[1] / 2.0, (z1_m - z0_m) / 2.0];
    geom
}
