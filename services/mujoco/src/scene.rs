//! A world of the project's own, built of MuJoCo's geoms around a legged robot.

use std::path::Path;

use guidance::se2::{Point, Se2};
use messages::{MAX_WALKERS, Pose2};
use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::mj_editing::{MjsBody, MjsGeom};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use world::{Door, GridMap, HANDLER_SEEN_RADIUS_M, Hole, PERSON_HEIGHT_M, Prism, Ramp, SeenBy, World};

use crate::person::{BODY, JOINTS, PersonConfig};
use crate::walls::{Block, blocks};

/// A step of the physics, seconds: four make a quantum of stepped time.
pub const STEP_S: f64 = 0.0025;
/// The walls of the project's worlds are thin; a geom is as thick as this, metres.
const WALL_M: f64 = 0.02;
/// The handler's body begins as high above the floor, metres.
const CLEAR_M: f64 = 0.02;

/// A ramp is so thick, metres: it reaches below the floor.
const RAMP_M: f64 = 0.5;
/// A floor with holes is so thick below the deepest of them, metres,
const FLOOR_M: f64 = 0.5;
/// is in convex pieces so far around them, metres,
const NEAR_HOLES_M: f64 = 5.0;
/// and reaches so far, metres.
const FLOOR_WIDE_M: f64 = 500.0;
/// Bits by which MuJoCo tells what meets (`contype`). Anything else has the first, and meets all that has it. A ramp,
/// a floor with holes, and the handler, who slides over the floor on a plane, have one of their own and do not meet.
pub(crate) const FLOOR_BIT: i32 = 2;
const HANDLER_BIT: i32 = 4;

/// Group of the geoms that stand still, and of doors, that lidar and camera see. The Go2's own are in groups 2 and 3.
pub const SEEN: i32 = 1;
/// Group of the handler's body, which moves.
pub const PERSON: i32 = 0;
/// Group of what only the camera sees: dirty glass.
pub const SEEN_BY_CAMERA: i32 = 4;
/// Group of what no sensor sees: clean glass, and the room that the handler needs.
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

/// What a scene is built of.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// An MJCF file of a robot with a free body named `base`.
    pub robot: &'a Path,
    /// What stands around it.
    pub world: &'a World,
    /// Where the robot stands (world frame).
    pub start: Pose2,
    /// Height of its body above the floor there, metres.
    pub body_m: f64,
    /// Who holds the harness, if anybody.
    pub person: Option<PersonConfig>,
}

impl Scene<'_> {
    /// MuJoCo's model of it.
    ///
    /// # Errors
    /// Where the robot's file cannot be read or holds no such body, or MuJoCo refuses the scene.
    pub fn build(&self) -> Result<MjModel, SceneError> {
        let wrong = |what: String| SceneError { file: self.robot.display().to_string(), what };
        let mut spec = MjSpec::from_xml(self.robot).map_err(|error| wrong(error.to_string()))?;
        spec.option_mut().timestep = STEP_S;
        let base = spec.body_mut("base").ok_or_else(|| wrong("it has no body named base".to_owned()))?;
        let floor_m = self.world.floor_m(Point::new(self.start.x_m, self.start.y_m));
        *base.pos_mut() = [self.start.x_m, self.start.y_m, floor_m + self.body_m];
        *base.quat_mut() = turned(self.start.yaw_rad);
        add_floor(&mut spec, self.world.holes());
        let still = spec.world_body_mut();
        add_plane(still, self.world.ceiling_m());
        if let Some(map) = self.world.map() {
            add_map(still, map, self.world.ceiling_m());
        }
        let is_leaf = |number: usize| self.world.doors().any(|(_, leaf)| leaf == number);
        let prisms = self.world.prisms().iter().enumerate().filter(|(number, _)| !is_leaf(*number));
        prisms.for_each(|(_, prism)| add_prism(still, prism));
        self.world.ramps().iter().for_each(|ramp| add_ramp(still, ramp));
        if let Some(person) = self.person {
            add_person(still, person);
        }
        let people = self.world.people().iter().take(MAX_WALKERS);
        people.enumerate().for_each(|(number, person)| add_passer(still, number, person.radius_m));
        // Behind the people, among the bodies that are placed.
        self.world.doors().enumerate().for_each(|(number, (door, _))| add_leaf(still, number, door));
        let model = spec.compile().map_err(|error| wrong(error.to_string()))?;
        let is_free = model.jnt_type().first() == Some(&MjtJoint::mjJNT_FREE);
        let is_base =
            model.name_to_id(MjtObjBase::mjOBJ_BODY, "base") == model.jnt_bodyid().first().map(|b| *b as usize);
        if is_free && is_base {
            Ok(model)
        } else {
            Err(wrong("its body base is not its first, or not free".to_owned()))
        }
    }
}

/// Scales the mass and inertia of the robot: of all bodies except the world and the handler.
pub fn scale_mass(model: &mut MjModel, scale: f64) {
    let handler = model.name_to_id(MjtObjBase::mjOBJ_BODY, BODY);
    for body in (1..model.body_mass().len()).filter(|body| Some(*body) != handler) {
        model.body_mass_mut()[body] *= scale;
        model.body_inertia_mut()[body].iter_mut().for_each(|inertia| *inertia *= scale);
    }
}

/// Sets the sliding friction of everything: MuJoCo takes the greater of two geoms'.
pub fn set_friction(model: &mut MjModel, sliding: f64) {
    model.geom_friction_mut().iter_mut().for_each(|friction| friction[0] = sliding);
}

/// Lets a step of time pass.
///
/// # Errors
/// Where the physics has diverged: MuJoCo would go on from the start as if nothing had been.
pub fn step(data: &mut MjData<Box<MjModel>>) -> Result<(), Diverged> {
    data.step();
    let diverged = [
        MjtWarning::mjWARN_BADQPOS,
        MjtWarning::mjWARN_BADQVEL,
        MjtWarning::mjWARN_BADQACC,
        MjtWarning::mjWARN_BADCTRL,
    ];
    if diverged.into_iter().any(|warning| data.warning()[warning as usize].number > 0) {
        return Err(Diverged { time_s: data.time() });
    }
    Ok(())
}

/// The physics holds what is no number, or is far too great.
#[derive(Debug, thiserror::Error)]
#[error("the physics diverged {time_s:.3} s after the start")]
pub struct Diverged {
    /// Time of the physics, seconds.
    pub time_s: f64,
}

/// The level floor, with holes where there are any.
fn add_floor(spec: &mut MjSpec, holes: &[Hole]) {
    let Some(deepest_m) = holes.iter().map(|hole| hole.depth_m).max_by(f64::total_cmp) else {
        return add_plane(spec.world_body_mut(), 0.0);
    };
    let bottom_m = -deepest_m - FLOOR_M;
    let corners = || holes.iter().flat_map(|hole| &hole.outline);
    let low = corners().fold(Point::new(f64::INFINITY, f64::INFINITY), |low, corner| low.inf(corner));
    let high = corners().fold(Point::new(f64::NEG_INFINITY, f64::NEG_INFINITY), |high, corner| high.sup(corner));
    let (near, wide) = (Vector2::repeat(NEAR_HOLES_M), Vector2::repeat(FLOOR_WIDE_M));
    let (inner, outer) = ([low - near, high + near], [low - wide, high + wide]);
    // Four boxes lie around what is near the holes, that in convex pieces.
    for [from, to] in [
        [outer[0], Point::new(inner[0].x, outer[1].y)],
        [Point::new(inner[1].x, outer[0].y), outer[1]],
        [Point::new(inner[0].x, outer[0].y), Point::new(inner[1].x, inner[0].y)],
        [Point::new(inner[0].x, inner[1].y), Point::new(inner[1].x, outer[1].y)],
    ] {
        let at = Se2::new(nalgebra::center(&from, &to).coords, 0.0);
        let size = to - from;
        let geom = add_box(spec.world_body_mut(), at, [size.x, size.y], [bottom_m, 0.0]);
        geom.set_group(UNSEEN);
        geom.set_contype(FLOOR_BIT);
    }
    let square = [inner[0], Point::new(inner[1].x, inner[0].y), inner[1], Point::new(inner[0].x, inner[1].y)];
    let around = world::ground::around(holes, &square);
    for (number, outline) in around.iter().enumerate() {
        add_piece(spec, &format!("floor_{number}"), outline, [bottom_m, 0.0]);
    }
    for (number, hole) in holes.iter().enumerate() {
        add_piece(spec, &format!("hole_{number}"), &hole.outline, [bottom_m, -hole.depth_m]);
    }
}

/// A piece of the floor: a convex outline, from its bottom to its top. Rays have the floor of the world itself.
fn add_piece(spec: &mut MjSpec, name: &str, outline: &[Point], z_m: [f64; 2]) {
    let corners = z_m.iter().flat_map(|z_m| outline.iter().flat_map(|corner| [corner.x, corner.y, *z_m]));
    let corners: Vec<f32> = corners.map(|metres| metres as f32).collect();
    spec.add_mesh().with_name(name).set_uservert(&corners);
    let geom = spec.world_body_mut().add_geom().with_type(MjtGeomBase::mjGEOM_MESH).with_group(UNSEEN);
    geom.set_meshname(name);
    geom.set_contype(FLOOR_BIT);
}

/// The floor, which looks up, or the ceiling, which looks down.
fn add_plane(still: &mut MjsBody, height_m: f64) {
    let plane = still.add_geom().with_type(MjtGeomBase::mjGEOM_PLANE).with_group(SEEN);
    *plane.pos_mut() = [0.0, 0.0, height_m];
    *plane.size_mut() = [0.0, 0.0, 1.0];
    if height_m > 0.0 {
        *plane.quat_mut() = [0.0, 1.0, 0.0, 0.0];
    }
}

/// A body that slides over the floor and turns about its own axis; its place is that of its joints.
fn add_person(still: &mut MjsBody, person: PersonConfig) {
    let body = still.add_body().with_name(BODY);
    for (axis, name) in JOINTS.into_iter().enumerate() {
        let kind = if axis == 2 { MjtJoint::mjJNT_HINGE } else { MjtJoint::mjJNT_SLIDE };
        let joint = body.add_joint().with_name(name).with_type(kind);
        *joint.axis_mut() = [0, 1, 2].map(|i| f64::from(i == axis));
    }
    // It does not rub on the floor: what moves it is its own walking.
    let (middle_m, half_m) = (f64::midpoint(CLEAR_M, person.height_m), (person.height_m - CLEAR_M) / 2.0);
    // The disc that may touch nothing has room for arms and a bag, which a lidar's plane does not meet.
    let touching = body.add_geom().with_type(MjtGeomBase::mjGEOM_CYLINDER).with_group(UNSEEN);
    *touching.pos_mut() = [0.0, 0.0, middle_m];
    *touching.size_mut() = [person.radius_m, half_m, 0.0];
    touching.set_mass(person.mass_kg);
    touching.set_contype(HANDLER_BIT);
    let seen = body.add_geom().with_type(MjtGeomBase::mjGEOM_CYLINDER).with_group(PERSON);
    *seen.pos_mut() = [0.0, 0.0, middle_m];
    *seen.size_mut() = [person.radius_m.min(HANDLER_SEEN_RADIUS_M), half_m, 0.0];
    seen.set_mass(0.0);
    seen.set_contype(0);
    seen.set_conaffinity(0);
}

/// Name of a pedestrian's body in the model.
pub(crate) fn passer(number: usize) -> String {
    format!("passer_{number}")
}

/// Adds a pedestrian. It follows its path; contacts do not move it.
fn add_passer(still: &mut MjsBody, number: usize, radius_m: f64) {
    let body = still.add_body().with_name(&passer(number));
    body.set_mocap(true);
    let geom = body.add_geom().with_type(MjtGeomBase::mjGEOM_CYLINDER).with_group(PERSON);
    *geom.pos_mut() = [0.0, 0.0, PERSON_HEIGHT_M / 2.0];
    *geom.size_mut() = [radius_m, PERSON_HEIGHT_M / 2.0, 0.0];
}

/// Name of a door's leaf in the model.
pub(crate) fn leaf(number: usize) -> String {
    format!("leaf_{number}")
}

/// Adds a door's leaf, which turns about its hinge; contacts do not move it.
fn add_leaf(still: &mut MjsBody, number: usize, door: &Door) {
    let body = still.add_body().with_name(&leaf(number));
    body.set_mocap(true);
    *body.pos_mut() = [door.hinge.x, door.hinge.y, 0.0];
    *body.quat_mut() = turned(door.swing_rad[0]);
    let [length_m, thickness_m] = door.size_m;
    let middle = Se2::translation(length_m / 2.0, 0.0);
    add_box(body, middle, [length_m, thickness_m], door.z).set_group(group(door.seen_by));
}

pub(crate) fn turned(yaw_rad: f64) -> [f64; 4] {
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    [turned.w, turned.i, turned.j, turned.k]
}

/// A floor plan, and a border around it: what is off the map is not free.
fn add_map(still: &mut MjsBody, map: &GridMap, ceiling_m: f64) {
    let (width, height) = map.size();
    if width == 0 || height == 0 {
        return;
    }
    let (first, column) = (map.middle(0, 0), map.middle(1, 0) - map.middle(0, 0));
    let row = Vector2::new(-column.y, column.x);
    let yaw_rad = column.y.atan2(column.x);
    // From one border of cells to another, on either axis.
    let mut add = |columns: [f64; 2], rows: [f64; 2]| {
        let middle = |[from, to]: [f64; 2]| (from + to - 1.0) / 2.0;
        let size = [columns, rows].map(|[from, to]| (to - from) * map.resolution_m());
        let at = first + column * middle(columns) + row * middle(rows);
        add_box(still, Se2::new(at.coords, yaw_rad), size, [0.0, ceiling_m]);
    };
    for Block { columns, rows } in blocks(map) {
        add([columns.0 as f64, columns.1 as f64], [rows.0 as f64, rows.1 as f64]);
    }
    let (width, height) = (width as f64, height as f64);
    add([-1.0, width + 1.0], [-1.0, 0.0]);
    add([-1.0, width + 1.0], [height, height + 1.0]);
    add([-1.0, 0.0], [0.0, height]);
    add([width, width + 1.0], [0.0, height]);
}

fn group(seen_by: SeenBy) -> i32 {
    match seen_by {
        SeenBy::Both => SEEN,
        SeenBy::Camera => SEEN_BY_CAMERA,
        SeenBy::Nobody => UNSEEN,
    }
}

fn add_prism(still: &mut MjsBody, prism: &Prism) {
    let (z, outline) = ([prism.z0_m, prism.z1_m], &prism.outline);
    let group = group(prism.seen_by);
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

/// A ramp: its upper face is the floor there.
fn add_ramp(still: &mut MjsBody, ramp: &Ramp) {
    let slope_rad = ramp.rise_m.atan2(ramp.length_m);
    // The nose of a body on it is up.
    let turned = UnitQuaternion::from_euler_angles(0.0, -slope_rad, ramp.foot.yaw_rad);
    let over_foot = Vector3::new(ramp.length_m.hypot(ramp.rise_m) / 2.0, 0.0, -RAMP_M / 2.0);
    let middle = Vector3::new(ramp.foot.x_m, ramp.foot.y_m, ramp.from_m) + turned * over_foot;
    let geom = still.add_geom().with_type(MjtGeomBase::mjGEOM_BOX).with_group(SEEN);
    *geom.pos_mut() = middle.into();
    *geom.quat_mut() = [turned.w, turned.i, turned.j, turned.k];
    *geom.size_mut() = [over_foot.x, ramp.width_m / 2.0, RAMP_M / 2.0];
    geom.set_contype(FLOOR_BIT);
}

/// A box, `size` along its own x and y axes.
fn add_box(still: &mut MjsBody, at: Se2, size: [f64; 2], [z0_m, z1_m]: [f64; 2]) -> &mut MjsGeom {
    let geom = still.add_geom().with_type(MjtGeomBase::mjGEOM_BOX).with_group(SEEN);
    *geom.pos_mut() = [at.translation.x, at.translation.y, f64::midpoint(z0_m, z1_m)];
    *geom.quat_mut() = turned(at.rotation.angle());
    *geom.size_mut() = [size[0] / 2.0, size[1] / 2.0, (z1_m - z0_m) / 2.0];
    geom
}
