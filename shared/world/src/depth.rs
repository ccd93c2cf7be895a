//! A depth camera.
//!
//! Exact, at whatever pitch and roll, for everything flat: floor, ceiling, walls, boxes (their tops and undersides too)
//! and the cells of a floor plan; depths are of pixel centres and rounded to a millimetre. People are prisms of a
//! polygon that is at most 2 mm off the circle. A face of a floor plan that is narrower than half a column may be
//! missed.

use std::f64::consts::PI;

use guidance::Tilt;
use guidance::se2::{Point, Se2, se2};
use guidance::seed::mixed;
use messages::{DepthHeader, Header, Pose2, Pose3};
use multiversion::multiversion;
use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::floor::{FALL_M, Hole, contains, sides};
use crate::noise::{Source, generator, normals};
use crate::prism::{Prism, SeenBy};
use crate::raster::{Face, Pinhole};
use crate::redwood::{Redwood, whole};
use crate::scene::PERSON_HEIGHT_M;
use crate::world::World;
use crate::{ConfigError, Scene};

/// The most columns, and the most rows.
pub(crate) const MAX_SIZE: [usize; 2] = [1280, 720];

/// Inverse depths of one place are as near to each other as this, as a share.
const SAME: f32 = 1e-4;
/// A hole's floor is looked for so far beyond its sides, metres.
const BESIDE_M: f64 = 1e-3;

/// What a depth camera is like and where it sits. The default is that of a D400-class camera at the robot's front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthConfig {
    /// Columns, to 1280.
    pub width: usize,
    /// Rows, to 720.
    pub height: usize,
    /// Angle that the columns span, radians.
    pub hfov_rad: f64,
    /// Where it is on the robot, its height above the floor included.
    pub robot_from_camera: Pose3,
    /// Nearer things give no reading, metres.
    pub range_min_m: f64,
    /// Farther things give no reading, metres; along the optical axis, as all depths.
    pub range_max_m: f64,
    /// Noise of a stereo camera: one standard deviation is this times the depth squared, 1/metres. 0 for none.
    pub noise_per_m: f64,
    /// Intensity of the Redwood noise (Choi et al. 2015), 0 to 10. 0 for none.
    pub redwood: f64,
}

impl Default for DepthConfig {
    fn default() -> Self {
        Self {
            width: 640,
            height: 480,
            hfov_rad: 87f64.to_radians(),
            robot_from_camera: Pose3 { x_m: 0.25, y_m: 0.0, z_m: 0.45, yaw_rad: 0.0, pitch_rad: 0.0 },
            range_min_m: 0.3,
            range_max_m: 10.0,
            noise_per_m: 0.001,
            redwood: 0.0,
        }
    }
}

impl DepthConfig {
    /// Refuses what no camera is like.
    ///
    /// # Errors
    /// Names the first key that is out of its bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let (camera, turn) = (&self.robot_from_camera, std::f64::consts::TAU);
        ConfigError::check_count("width", self.width, 1, MAX_SIZE[0])?;
        ConfigError::check_count("height", self.height, 1, MAX_SIZE[1])?;
        ConfigError::check("hfov_rad", self.hfov_rad, 0.1, 2.8)?;
        ConfigError::check("robot_from_camera.x_m", camera.x_m, -2.0, 2.0)?;
        ConfigError::check("robot_from_camera.y_m", camera.y_m, -2.0, 2.0)?;
        ConfigError::check("robot_from_camera.z_m", camera.z_m, 0.01, 3.0)?;
        ConfigError::check("robot_from_camera.yaw_rad", camera.yaw_rad, -turn, turn)?;
        ConfigError::check("robot_from_camera.pitch_rad", camera.pitch_rad, -1.3, 1.3)?;
        ConfigError::check("range_min_m", self.range_min_m, 0.05, 10.0)?;
        ConfigError::check("range_max_m", self.range_max_m, self.range_min_m + 0.1, 65.0)?;
        ConfigError::check("noise_per_m", self.noise_per_m, 0.0, 0.1)?;
        ConfigError::check("redwood", self.redwood, 0.0, 10.0)
    }
}

/// Height of the floor under the robot, metres: after a step down that is no fall it stands lower.
fn stands_m(scene: &Scene<'_>) -> f64 {
    let at = Point::new(scene.world_from_robot.x_m, scene.world_from_robot.y_m);
    Some(scene.world.floor_m(at)).filter(|floor_m| (-FALL_M..0.0).contains(floor_m)).unwrap_or(0.0)
}

/// A simulated depth camera. All pixels of a frame are of one moment.
#[derive(Debug, Clone)]
pub struct DepthSensor {
    config: DepthConfig,
    seed: u64,
    incarnation: u32,
    camera: Pinhole,
    /// One row of inverse depths, 1/metres.
    row: Vec<f32>,
    faces: Vec<Face>,
    patches: Patches,
    redwood: Option<Redwood>,
}

/// The floor's patches in view.
#[derive(Debug, Clone, Default)]
struct Patches {
    /// Where holes open: no floor is at z = 0 there.
    openings: Vec<Face>,
    /// Floor of which some pixels say nothing, and the share of those.
    dark: Vec<(Face, f64)>,
}

impl DepthSensor {
    /// A camera whose noise depends on `seed` and `incarnation`.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(config: DepthConfig, seed: u64, incarnation: u32) -> Result<Self, ConfigError> {
        config.validate()?;
        let (width, height) = (config.width, config.height);
        let camera = Pinhole {
            width,
            height,
            focal_px: 0.5 * width as f64 / (0.5 * config.hfov_rad).tan(),
            cx_px: 0.5 * (width as f64 - 1.0),
            cy_px: 0.5 * (height as f64 - 1.0),
        };
        let redwood = (config.redwood > 0.0).then(|| Redwood::new(config.redwood, width, height, seed));
        Ok(Self {
            config,
            seed,
            incarnation,
            camera,
            row: vec![0.0; width],
            faces: Vec::new(),
            patches: Patches::default(),
            redwood,
        })
    }

    /// Another camera of the same kind: other noise.
    pub fn reseed(&mut self, seed: u64) {
        self.seed = seed;
        if let Some(redwood) = &mut self.redwood {
            redwood.reseed(seed);
        }
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &DepthConfig {
        &self.config
    }

    /// Pixels of a frame.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.config.width * self.config.height
    }

    /// What stands beside the pixels; the header is left for the publisher.
    #[must_use]
    pub fn depth_header(&self) -> DepthHeader {
        DepthHeader {
            header: Header::default(),
            width: self.config.width as u32,
            height: self.config.height as u32,
            fx_px: self.camera.focal_px,
            fy_px: self.camera.focal_px,
            cx_px: self.camera.cx_px,
            cy_px: self.camera.cy_px,
            robot_from_camera: self.config.robot_from_camera,
        }
    }

    /// Writes frame number `frame`: depth along the optical axis in millimetres, 0 = none, row by row from the top
    /// left, as many whole rows as `pixels` has room for.
    pub fn render(&mut self, scene: &Scene<'_>, frame: u64, pixels: &mut [u16]) {
        let (mut faces, mut patches) = (std::mem::take(&mut self.faces), std::mem::take(&mut self.patches));
        faces.clear();
        let mut held = Held::of(&self.config.robot_from_camera, scene.tilt.as_ref());
        held.height_m += stands_m(scene);
        let view = self.view(scene, &held);
        view.collect(scene, &mut faces);
        view.collect_patches(scene, &mut faces, &mut patches);
        faces.sort_unstable_by_key(|face| face.rows().0);
        let (mut active, mut next) = (Vec::with_capacity(faces.len()), 0);
        let (camera, ceiling_m) = (self.camera, scene.world.ceiling_m());
        let silence = self.silence(frame);
        let draw = |row: usize, inverse_depths: &mut [f32]| {
            while next < faces.len() && faces[next].rows().0 <= row {
                active.push(next);
                next += 1;
            }
            active.retain(|&face| faces[face].rows().1 >= row);
            held.draw_background(&camera, ceiling_m, row, inverse_depths);
            patches.open(row, inverse_depths);
            for &face in &active {
                faces[face].fill(row, inverse_depths);
            }
            patches.darken(row, silence, inverse_depths);
        };
        self.measure(draw, frame, pixels);
        (self.faces, self.patches) = (faces, patches);
    }

    fn silence(&self, frame: u64) -> u64 {
        mixed(mixed(self.seed, u64::from(self.incarnation)), frame)
    }

    /// Whether a pixel (row, column) of a frame says nothing of the floor that it sees at a place (world frame).
    #[must_use]
    pub fn is_dark(&self, world: &World, at: Point, frame: u64, pixel: [usize; 2]) -> bool {
        let mut dark = world.dark_floor().iter().filter(|dark| dark.distance_m(at) == 0.0);
        dark.any(|dark| is_silent(self.silence(frame), pixel, dark.silent))
    }

    /// As [`Self::render`], of depths that are told: `draw` writes a row's true inverse depths along the optical axis,
    /// 1/metres, 0 where nothing is seen, for each row from the top.
    pub fn measure(&mut self, mut draw: impl FnMut(usize, &mut [f32]), frame: u64, pixels: &mut [u16]) {
        let mut random = generator(Source::Depth, self.seed, self.incarnation, frame);
        let [nearest, farthest] =
            [self.config.range_min_m, self.config.range_max_m].map(|range_m| 1.0 / range_m as f32);
        for (row, out) in pixels.chunks_exact_mut(self.config.width).take(self.config.height).enumerate() {
            draw(row, &mut self.row);
            if self.config.noise_per_m > 0.0 {
                // A depth's sigma of k d^2 is a sigma of k on its inverse.
                let noise = self.config.noise_per_m as f32;
                for (inverse, normal) in self.row.iter_mut().zip(normals(&mut random, self.config.width)) {
                    *inverse += noise * normal;
                }
            }
            write(&self.row, [nearest, farthest], out);
        }
        if let Some(redwood) = &mut self.redwood {
            redwood.disturb(pixels, || normals(&mut random, 3 * self.config.width));
        }
    }

    fn view(&self, scene: &Scene<'_>, held: &Held) -> View {
        let world_from_camera = se2(scene.world_from_robot) * se2(held.robot_from_eye);
        let (sin, cos) = held.pitch;
        let (half_width, half_height) =
            (self.camera.cx_px / self.camera.focal_px, self.camera.cy_px / self.camera.focal_px);
        // Rolled, the image reaches as far to the sides as its corners.
        let (rolled, upright) = (held.roll.0.abs(), held.roll.1.abs());
        let (half_width, half_height) =
            (upright * half_width + rolled * half_height, upright * half_height + rolled * half_width);
        // Pitched, a row's columns spread wider than at the optical axis; at last all round.
        let half_angle_rad = match cos - sin.abs() * half_height {
            ahead if ahead > 0.0 => half_width.atan2(ahead),
            _ => PI,
        };
        View {
            pinhole: self.camera,
            // The farthest corner of the viewing pyramid, as seen from above.
            reach_m: self.config.range_max_m * (1.0 + half_width.powi(2) + half_height.powi(2)).sqrt(),
            half_angle_rad,
            half_angle: half_angle_rad.sin_cos(),
            camera_from_world: world_from_camera.inverse(),
            eye: Point::from(world_from_camera.translation.vector),
            yaw_rad: world_from_camera.rotation.angle(),
            height_m: held.height_m,
            pitch: (sin, cos),
            roll: held.roll,
        }
    }
}

/// Turns a row's inverse depths into millimetres.
#[multiversion(targets("x86_64+avx2"))]
fn write(row: &[f32], [nearest, farthest]: [f32; 2], out: &mut [u16]) {
    for (pixel, &inverse) in out.iter_mut().zip(row) {
        let seen = inverse <= nearest && inverse >= farthest;
        let depth_mm = if seen { 1000.0 / inverse + 0.5 } else { 0.0 };
        *pixel = whole(depth_mm) as u16;
    }
}

impl Patches {
    /// Takes the floor away where holes open.
    fn open(&self, row: usize, inverse_depths: &mut [f32]) {
        for opening in self.openings.iter().filter(|face| face.is_in(row)) {
            opening.each(row, inverse_depths, |_, _, pixel| *pixel = 0.0);
        }
    }

    /// Silences pixels of dark floor, where nothing stands before it. Which, depends on the frame.
    fn darken(&self, row: usize, silence: u64, inverse_depths: &mut [f32]) {
        for (face, silent) in self.dark.iter().filter(|(face, _)| face.is_in(row)) {
            face.each(row, inverse_depths, |column, here, pixel| {
                if (*pixel - here).abs() <= SAME * here && is_silent(silence, [row, column], *silent) {
                    *pixel = 0.0;
                }
            });
        }
    }
}

/// Whether a pixel (row, column) of floor of which such a share says nothing is silent.
fn is_silent(silence: u64, [row, column]: [usize; 2], share: f64) -> bool {
    let number = mixed(silence, (row * MAX_SIZE[0] + column) as u64);
    ((number >> 11) as f64 / (1u64 << 53) as f64) < share
}

/// How a camera is held over the floor.
#[derive(Debug, Clone, Copy)]
struct Held {
    /// Its place and the direction of its optical axis, as seen from above.
    robot_from_eye: Pose2,
    height_m: f64,
    /// Sine and cosine of its pitch, positive with the axis down, and of its roll, positive with the left side up.
    pitch: (f64, f64),
    roll: (f64, f64),
}

impl Held {
    fn of(mount: &Pose3, tilt: Option<&Tilt>) -> Self {
        let Some(tilt) = tilt else {
            let robot_from_eye = Pose2::new(mount.x_m, mount.y_m, mount.yaw_rad);
            return Self {
                robot_from_eye,
                height_m: mount.z_m,
                pitch: mount.pitch_rad.sin_cos(),
                roll: 0f64.sin_cos(),
            };
        };
        let eye = tilt.place(Point3::new(mount.x_m, mount.y_m, mount.z_m));
        let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
        let [ahead, left, up] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| tilt.direction(mounted * axis));
        Self {
            robot_from_eye: Pose2::new(eye.x, eye.y, ahead.y.atan2(ahead.x)),
            height_m: eye.z,
            pitch: (-ahead.z, ahead.xy().norm()),
            roll: left.z.atan2(up.z).sin_cos(),
        }
    }

    /// Writes the inverse depths of floor and ceiling at a row, 1/metres: linear along it, and constant without roll.
    fn draw_background(&self, pinhole: &Pinhole, ceiling_m: f64, row: usize, inverse_depths: &mut [f32]) {
        let up = (pinhole.cy_px - row as f64) / pinhole.focal_px;
        let above = ceiling_m - self.height_m;
        let inverse = |rise: f64| {
            let to_ceiling = if above > 0.0 { rise / above } else { 0.0 };
            (-rise / self.height_m).max(to_ceiling) as f32
        };
        let ((pitch_sin, pitch_cos), (roll_sin, roll_cos)) = (self.pitch, self.roll);
        let rise = up * roll_cos * pitch_cos - pitch_sin;
        if roll_sin == 0.0 {
            inverse_depths.fill(inverse(rise));
            return;
        }
        let by_left = roll_sin * pitch_cos / pinhole.focal_px;
        for (column, inverse_depth) in inverse_depths.iter_mut().enumerate() {
            *inverse_depth = inverse(rise + by_left * (pinhole.cx_px - column as f64));
        }
    }
}

/// Where a camera stands and what it can reach.
struct View {
    pinhole: Pinhole,
    /// Of the level frame at the camera's place and yaw.
    camera_from_world: Se2,
    eye: Point,
    yaw_rad: f64,
    height_m: f64,
    pitch: (f64, f64),
    roll: (f64, f64),
    /// What is farther is not seen, metres, nor what is farther to a side, radians; as seen from above.
    reach_m: f64,
    half_angle_rad: f64,
    /// Its sine and cosine.
    half_angle: (f64, f64),
}

impl View {
    /// Gathers all faces in view.
    fn collect(&self, scene: &Scene<'_>, faces: &mut Vec<Face>) {
        for prism in scene.world.prisms() {
            if prism.seen_by != SeenBy::Nobody {
                self.add(prism, faces);
            }
        }
        for (center, radius_m) in scene.bodies() {
            let level = self.camera_from_world * center;
            if self.may_see(level, level, radius_m) {
                self.add(&Prism::pillar(center, radius_m.max(0.01), [0.0, PERSON_HEIGHT_M]), faces);
            }
        }
        if let Some(map) = scene.world.map() {
            let sector = (self.yaw_rad - self.half_angle_rad, 2.0 * self.half_angle_rad, 2 * self.pinhole.width);
            for (a, b) in map.visible_faces(self.eye, sector, self.reach_m) {
                self.add_side(a, b, [0.0, scene.world.ceiling_m()], faces);
            }
        }
    }

    /// Adds the sides of a prism, and its top and underside where they can be seen.
    fn add(&self, prism: &Prism, faces: &mut Vec<Face>) {
        for (a, b) in prism.sides() {
            // A solid's outline is counter-clockwise: its far sides turn their back.
            if !prism.solid || (b - a).perp(&(self.eye - a)) < 0.0 {
                self.add_side(a, b, [prism.z0_m, prism.z1_m], faces);
            }
        }
        let lid = if self.height_m > prism.z1_m { prism.z1_m } else { prism.z0_m };
        if prism.solid && !(prism.z0_m..=prism.z1_m).contains(&self.height_m) {
            faces.extend(self.fan(&prism.outline, lid));
        }
    }

    /// Gathers the openings of holes, what is seen through them, and dark floor.
    fn collect_patches(&self, scene: &Scene<'_>, faces: &mut Vec<Face>, patches: &mut Patches) {
        patches.openings.clear();
        patches.dark.clear();
        let holes = scene.world.holes();
        for hole in holes {
            let from = patches.openings.len();
            patches.openings.extend(self.fan(&hole.outline, 0.0));
            if patches.openings.len() > from {
                faces.extend(self.fan(&hole.outline, -hole.depth_m));
                sides(&hole.outline).for_each(|(a, b)| self.add_hole_side(a, b, hole, holes, faces));
            }
        }
        for dark in scene.world.dark_floor() {
            patches.dark.extend(self.fan(&dark.outline, 0.0).map(|face| (face, dark.silent)));
        }
    }

    /// The wall of a hole's side, up to the floor beyond it.
    fn add_hole_side(&self, a: Point, b: Point, hole: &Hole, holes: &[Hole], faces: &mut Vec<Face>) {
        let outward = Vector2::new((b - a).y, (a - b).x).normalize();
        let beyond = nalgebra::center(&a, &b) + outward * BESIDE_M;
        let neighbour = holes.iter().find(|other| contains(&other.outline, beyond));
        let up_to_m = neighbour.map_or(0.0, |other| -other.depth_m);
        // One looks at walls from inside.
        if up_to_m > -hole.depth_m && (b - a).perp(&(self.eye - a)) > 0.0 {
            self.add_side(a, b, [-hole.depth_m, up_to_m], faces);
        }
    }

    /// A convex outline at a height, as triangles; those that are in the image.
    fn fan<'a>(&'a self, outline: &'a [Point], z_m: f64) -> impl Iterator<Item = Face> + 'a {
        let triangles = outline[1..].windows(2).map(move |pair| [outline[0], pair[0], pair[1]]);
        triangles.filter_map(move |corners| self.pinhole.project(&corners.map(|p| self.to_camera(p, z_m))))
    }

    fn add_side(&self, a: Point, b: Point, [z0_m, z1_m]: [f64; 2], faces: &mut Vec<Face>) {
        let (a, b) = (self.camera_from_world * a, self.camera_from_world * b);
        if self.may_see(a, b, 0.0) {
            let quad = [(a, z0_m), (b, z0_m), (b, z1_m), (a, z1_m)].map(|(p, z_m)| self.tilted(p, z_m));
            faces.extend(self.pinhole.project(&quad));
        }
    }

    /// Whether something between two places of the level frame, so wide on all sides, may be in view: where it is not
    /// farther than the camera sees, nor wholly to the left or to the right of what it sees.
    fn may_see(&self, a: Point, b: Point, margin_m: f64) -> bool {
        let (sin, cos) = self.half_angle;
        let aside = |p: Point, y: f64| y * cos - p.x * sin > margin_m;
        let beyond = (aside(a, a.y) && aside(b, b.y)) || (aside(a, -a.y) && aside(b, -b.y));
        let is_near = || nalgebra::center(&a, &b).coords.norm() <= self.reach_m + margin_m + (b - a).norm() / 2.0;
        (self.half_angle_rad == PI || !beyond) && is_near()
    }

    /// A place of the world in the camera frame.
    fn to_camera(&self, world: Point, z_m: f64) -> Point3<f64> {
        self.tilted(self.camera_from_world * world, z_m)
    }

    /// A place of the level frame in the camera frame: x along the optical axis, y left, z up.
    fn tilted(&self, level: Point, z_m: f64) -> Point3<f64> {
        let (above_m, (sin, cos), (roll_sin, roll_cos)) = (z_m - self.height_m, self.pitch, self.roll);
        let up = sin * level.x + cos * above_m;
        Point3::new(
            cos * level.x - sin * above_m,
            roll_cos * level.y + roll_sin * up,
            roll_cos * up - roll_sin * level.y,
        )
    }
}
