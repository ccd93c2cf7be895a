//! A world: floor, ceiling, prisms, a floor plan where there is one, doors that open, and walking people.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use guidance::se2::Point;
use messages::MAX_DOORS;
use nalgebra::Vector2;

use crate::door::{Door, Leaf};
use crate::floor::{self, DarkFloor, Hole};
use crate::grid_map::GridMap;
use crate::index::SideIndex;
use crate::people::{Agent, Person};
use crate::prism::{Prism, SeenBy};
use crate::ramp::{self, Ramp};
use crate::sweep::{free_share, is_blocked, to_segment, ways_apart};
use crate::{WorldError, text_file, world_file};

/// Number of points on a disc's rim whose floor is compared with that under its middle.
const RIM: usize = 32;
/// Height of the ceiling where nothing else is said, metres.
pub const DEFAULT_CEILING_M: f64 = 2.6;

/// Everything that stands still, doors as they are at one moment, and who walks where. Walls of prisms and cells of a
/// floor plan are asked together, so that sensors and collisions work on either or on both. A door's leaf is a prism
/// like others.
#[derive(Debug, Clone)]
pub struct World {
    ceiling_m: f64,
    prisms: Vec<Prism>,
    /// Doors, and the number of each one's prism.
    leaves: Vec<(Leaf, usize)>,
    index: SideIndex,
    map: Option<Arc<GridMap>>,
    people: Vec<Person>,
    ramps: Vec<Ramp>,
    holes: Vec<Hole>,
    dark: Vec<DarkFloor>,
}

impl World {
    /// A world of these prisms.
    #[must_use]
    pub fn new(ceiling_m: f64, prisms: Vec<Prism>) -> Self {
        let index = SideIndex::new(&prisms);
        Self {
            ceiling_m,
            prisms,
            leaves: Vec::new(),
            index,
            map: None,
            people: Vec::new(),
            ramps: Vec::new(),
            holes: Vec::new(),
            dark: Vec::new(),
        }
    }

    /// The same world on a floor plan.
    #[must_use]
    pub fn with_map(mut self, map: GridMap) -> Self {
        self.map = Some(Arc::new(map));
        self
    }

    /// The same world on a floor plan that others are on as well.
    #[must_use]
    pub fn with_shared_map(mut self, map: Arc<GridMap>) -> Self {
        self.map = Some(map);
        self
    }

    /// The same world with these walking people, of whom at most [`messages::MAX_WALKERS`] fit into a truth.
    #[must_use]
    pub fn with_people(mut self, people: Vec<Person>) -> Self {
        self.people = people;
        self
    }

    /// The same world with these ramps, which only MuJoCo knows.
    #[must_use]
    pub fn with_ramps(mut self, ramps: Vec<Ramp>) -> Self {
        self.ramps = ramps;
        self
    }

    /// The same world with these holes in its floor.
    #[must_use]
    pub fn with_holes(mut self, holes: Vec<Hole>) -> Self {
        self.holes = holes;
        self
    }

    /// The same world with floor of which a camera sees little.
    #[must_use]
    pub fn with_dark_floor(mut self, dark: Vec<DarkFloor>) -> Self {
        self.dark = dark;
        self
    }

    /// Takes its ramps away.
    pub fn flatten(&mut self) {
        self.ramps.clear();
    }

    /// The same world with more in it.
    #[must_use]
    pub fn with_prisms(mut self, more: impl IntoIterator<Item = Prism>) -> Self {
        self.prisms.extend(more);
        self.index = SideIndex::new(&self.prisms);
        self
    }

    /// The same world with these doors, which are shut.
    ///
    /// # Panics
    /// With more than [`messages::MAX_DOORS`] doors: no more of them fit into a truth.
    #[must_use]
    pub fn with_doors(mut self, doors: impl IntoIterator<Item = Door>) -> Self {
        for door in doors {
            let leaf = Leaf::new(door);
            self.leaves.push((leaf.clone(), self.prisms.len()));
            self.prisms.push(leaf.door.leaf(leaf.at_rad));
        }
        assert!(self.leaves.len() <= messages::MAX_DOORS, "{} doors", self.leaves.len());
        self.index = SideIndex::new(&self.prisms);
        self
    }

    /// Its doors, and the number of the prism that is each one's leaf.
    pub fn doors(&self) -> impl ExactSizeIterator<Item = (&Door, usize)> + '_ {
        self.leaves.iter().map(|(leaf, prism)| (&leaf.door, *prism))
    }

    /// Lets the doors swing for `dt_s` from run time `time_s` on, seconds; whether one of them has moved. They stop for
    /// all agents, of whom the first is the robot.
    pub fn swing(&mut self, time_s: f64, dt_s: f64, agents: &[Agent]) -> bool {
        let mut has_moved = false;
        for (leaf, _) in &mut self.leaves {
            has_moved |= leaf.swing(time_s, dt_s, agents);
        }
        if has_moved {
            self.place_leaves();
        }
        has_moved
    }

    /// How its doors are turned (world frame), radians: as [`Self::turn_doors`] takes it.
    #[must_use]
    pub fn doors_rad(&self) -> [f64; MAX_DOORS] {
        let mut doors_rad = [0.0; MAX_DOORS];
        doors_rad.iter_mut().zip(&self.leaves).for_each(|(at_rad, (leaf, _))| *at_rad = leaf.at_rad);
        doors_rad
    }

    /// Turns its doors (world frame), radians.
    pub fn turn_doors(&mut self, doors_rad: &[f64; MAX_DOORS]) {
        if self.leaves.is_empty() || *doors_rad == self.doors_rad() {
            return;
        }
        self.leaves.iter_mut().zip(doors_rad).for_each(|((leaf, _), at_rad)| leaf.at_rad = *at_rad);
        self.place_leaves();
    }

    fn place_leaves(&mut self) {
        for (leaf, prism) in &self.leaves {
            self.prisms[*prism] = leaf.door.leaf(leaf.at_rad);
        }
        self.index = SideIndex::new(&self.prisms);
    }

    /// Reads a world file (TOML), or a ROS map (`.yaml`, `.yml`).
    ///
    /// # Errors
    /// Where the file, or the map or image that it names, cannot be read or used; the error names file, line and key.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        if matches!(extension, "yaml" | "yml") {
            return Ok(Self::new(DEFAULT_CEILING_M, Vec::new()).with_map(GridMap::load(path)?));
        }
        let text = text_file::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        world_file::parse(&path.display().to_string(), &text, folder)
    }

    /// A world from the text of a world file. `file` names it in errors; a map that it names is read from `folder`.
    ///
    /// # Errors
    /// As [`World::load`].
    pub fn from_toml(file: &str, text: &str, folder: &Path) -> Result<Self, WorldError> {
        world_file::parse(file, text, folder)
    }

    /// Height of the ceiling, metres.
    #[must_use]
    pub fn ceiling_m(&self) -> f64 {
        self.ceiling_m
    }

    /// What the world is built of, the floor plan aside; doors as they are now.
    #[must_use]
    pub fn prisms(&self) -> &[Prism] {
        &self.prisms
    }

    /// The floor plan, if there is one.
    #[must_use]
    pub fn map(&self) -> Option<&GridMap> {
        self.map.as_deref()
    }

    /// Its ramps and plateaus.
    #[must_use]
    pub fn ramps(&self) -> &[Ramp] {
        &self.ramps
    }

    /// The holes in its floor.
    #[must_use]
    pub fn holes(&self) -> &[Hole] {
        &self.holes
    }

    /// Floor of which a camera sees little.
    #[must_use]
    pub fn dark_floor(&self) -> &[DarkFloor] {
        &self.dark
    }

    /// Distance from a place to the nearest hole that is a fall, metres. Infinite in a world without one.
    #[must_use]
    pub fn to_edge_m(&self, at: Point) -> f64 {
        floor::to_edge_m(&self.holes, at)
    }

    /// Distance from a place to the nearest low step, metres. Infinite in a world without one.
    #[must_use]
    pub fn to_low_step_m(&self, at: Point) -> f64 {
        floor::to_low_step_m(&self.holes, at)
    }

    /// Height of the floor at a place, metres.
    #[must_use]
    pub fn floor_m(&self, at: Point) -> f64 {
        let hole = self.holes.iter().find(|hole| hole.distance_m(at) == 0.0);
        hole.map_or_else(|| ramp::floor_m(&self.ramps, at), |hole| -hole.depth_m)
    }

    /// Whether a disc reaches over floor that lies lower than that under its middle, so that one falls.
    #[must_use]
    pub fn is_over_edge(&self, at: Point, radius_m: f64) -> bool {
        let here_m = ramp::floor_m(&self.ramps, at);
        let drops = |i: usize| {
            let (sin, cos) = (TAU * i as f64 / RIM as f64).sin_cos();
            here_m - ramp::floor_m(&self.ramps, at + Vector2::new(cos, sin) * radius_m) > floor::FALL_M
        };
        self.to_edge_m(at) < radius_m || here_m > 0.0 && (0..RIM).any(drops)
    }

    /// Who walks in it, and how.
    #[must_use]
    pub fn people(&self) -> &[Person] {
        &self.people
    }

    /// Way from `origin` along the unit vector `direction`, at height `z_m`, to the first thing that a lidar sees,
    /// metres; `None` where there is none within `max_m`. Upper and lower edges of a face belong to it. Walking people
    /// are not asked.
    #[must_use]
    pub fn cast(&self, origin: Point, direction: Vector2<f64>, z_m: f64, max_m: f64) -> Option<f64> {
        let in_map = self.map.as_ref().and_then(|map| map.cast(origin, direction, max_m));
        let max_m = in_map.unwrap_or(max_m);
        let seen = |id: u32| {
            let prism = &self.prisms[id as usize];
            prism.seen_by == SeenBy::Both && (prism.z0_m..=prism.z1_m).contains(&z_m)
        };
        self.index.cast(origin, direction, max_m, seen).or(in_map)
    }

    /// Calls `f` with every face that a lidar at `origin` and height `z_m` may see within `max_m`.
    pub(crate) fn faces_in_sight(
        &self,
        origin: Point,
        [low_m, high_m]: [f64; 2],
        max_m: f64,
        mut f: impl FnMut(Point, Point, [f64; 2]),
    ) {
        for side in self.index.sides() {
            let prism = &self.prisms[side.prism as usize];
            let (to_a, along) = (side.a - origin, side.b - side.a);
            // Twice the way to the face's middle, against twice the reach and the face's length.
            let reach_m = 2.0 * max_m + along.x.abs() + along.y.abs();
            let near = (to_a * 2.0 + along).norm_squared() <= reach_m * reach_m;
            // A solid's outline is counter-clockwise: its far sides are hidden by its near ones.
            let faces = !prism.solid || along.perp(&to_a) > 0.0;
            let in_reach = prism.z0_m <= high_m && low_m <= prism.z1_m;
            if near && faces && prism.seen_by == SeenBy::Both && in_reach {
                f(side.a, side.b, [prism.z0_m, prism.z1_m]);
            }
        }
    }

    /// Distance from a place to the nearest thing between two heights, metres, at most `up_to_m`; 0 inside something.
    #[must_use]
    pub fn clearance(&self, at: Point, z: [f64; 2], up_to_m: f64) -> f64 {
        if self.prisms.iter().any(|prism| prism.reaches(z) && prism.contains(at)) {
            return 0.0;
        }
        let mut nearest = self.map.as_ref().map_or(up_to_m, |map| map.clearance(at, up_to_m));
        let reach = Vector2::repeat(up_to_m);
        self.index.near(at - reach, at + reach, |side| {
            if self.prisms[side.prism as usize].reaches(z) {
                nearest = nearest.min(to_segment(at, side.a, side.b));
            }
        });
        nearest
    }

    /// The share of the straight way `from`..`to`, in [0, 1], that a disc between two heights can go before it touches
    /// something; `None` where all of it is free. What the disc is already inside of blocks only ways that lead closer.
    #[must_use]
    pub fn free_share(&self, from: Point, to: Point, radius_m: f64, z: [f64; 2]) -> Option<f64> {
        let mut share = self.map.as_ref().and_then(|map| map.free_share(from, to, radius_m));
        let reach = Vector2::repeat(radius_m);
        self.index.near(from.inf(&to) - reach, from.sup(&to) + reach, |side| {
            if !self.prisms[side.prism as usize].reaches(z) {
                return;
            }
            if ways_apart(from, to, side.a, side.b) >= radius_m {
                return;
            }
            if let Some(found) = free_share(from, to, radius_m, |p| to_segment(p, side.a, side.b)) {
                share = Some(share.map_or(found, |share| share.min(found)));
            }
        });
        share
    }

    /// Whether [`Self::free_share`] is less than all of the way, which is known sooner.
    #[must_use]
    pub fn is_blocked(&self, from: Point, to: Point, radius_m: f64, z: [f64; 2]) -> bool {
        let mut blocked = self.map.as_ref().is_some_and(|map| map.free_share(from, to, radius_m).is_some());
        let reach = Vector2::repeat(radius_m);
        self.index.near(from.inf(&to) - reach, from.sup(&to) + reach, |side| {
            let is_past = || ways_apart(from, to, side.a, side.b) >= radius_m;
            blocked = blocked
                || self.prisms[side.prism as usize].reaches(z)
                    && !is_past()
                    && is_blocked(from, to, radius_m, |p| to_segment(p, side.a, side.b));
        });
        blocked
    }
}
