//! What robot and handler touch: the physics' own contacts are the truth about collisions and falls.

use messages::{MAX_DOORS, MAX_WALKERS};
use mujoco_rs::prelude::*;

use crate::person::BODY;
use crate::scene::{self, SceneError};

/// A touch ends after this many steps of the physics without contact: half a second.
const RELEASE_STEPS: u32 = 200;

/// Counts one's collisions.
#[derive(Debug, Clone, Copy, Default)]
struct Collisions {
    count: u32,
    /// Steps since something was touched last, where the touch is not over.
    touching: Option<u32>,
}

impl Collisions {
    fn step(&mut self, touches: bool) {
        if touches {
            self.count += u32::from(self.touching.is_none());
            self.touching = Some(0);
            return;
        }
        self.touching = self.touching.map(|steps| steps + 1).filter(|steps| *steps < RELEASE_STEPS);
    }
}

/// Whose geom it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    Robot,
    /// What the robot walks on: bodies that have a foot.
    Leg,
    Handler,
    Floor,
    World,
    /// A pedestrian.
    Passer,
}

/// The touches so far.
#[derive(Debug)]
pub struct Touches {
    owners: Vec<Owner>,
    robot: Collisions,
    handler: Collisions,
    by_others: Collisions,
}

impl Touches {
    /// No touches yet, in a scene with a handler and a robot with those feet (geoms).
    ///
    /// # Errors
    /// Where the scene has none.
    pub fn new(model: &MjModel, feet: &[usize]) -> Result<Self, SceneError> {
        let missing = || SceneError { file: "the scene".to_owned(), what: format!("it has no body {BODY}") };
        let handler = model.name_to_id(MjtObjBase::mjOBJ_BODY, BODY).ok_or_else(missing)?;
        let passer = |number| model.name_to_id(MjtObjBase::mjOBJ_BODY, &scene::passer(number));
        let passers: Vec<usize> = (0..MAX_WALKERS).map_while(passer).collect();
        let leaf = |number| model.name_to_id(MjtObjBase::mjOBJ_BODY, &scene::leaf(number));
        let leaves: Vec<usize> = (0..MAX_DOORS).map_while(leaf).collect();
        let owner = |geom: usize| {
            let body = model.geom_bodyid()[geom] as usize;
            let is_leg = || feet.iter().any(|foot| model.geom_bodyid()[*foot] as usize == body);
            match body {
                0 if model.geom_type()[geom] == MjtGeomBase::mjGEOM_PLANE => Owner::Floor,
                0 if model.geom_contype()[geom] == scene::FLOOR_BIT => Owner::Floor,
                0 => Owner::World,
                body if leaves.contains(&body) => Owner::World,
                body if body == handler => Owner::Handler,
                body if passers.contains(&body) => Owner::Passer,
                _ if is_leg() => Owner::Leg,
                _ => Owner::Robot,
            }
        };
        let owners = (0..model.geom_group().len()).map(owner).collect();
        Ok(Self {
            owners,
            robot: Collisions::default(),
            handler: Collisions::default(),
            by_others: Collisions::default(),
        })
    }

    /// Collisions of the robot, falls among them.
    #[must_use]
    pub fn robot(&self) -> u32 {
        self.robot.count
    }

    /// Collisions of the handler.
    #[must_use]
    pub fn handler(&self) -> u32 {
        self.handler.count
    }

    /// Collisions caused by pedestrians.
    #[must_use]
    pub fn by_others(&self) -> u32 {
        self.by_others.count
    }

    /// Counts the contacts of a step. `is_walked_into`: a pedestrian walks into robot or handler, and causes them.
    pub fn look(&mut self, data: &MjData<Box<MjModel>>, is_walked_into: bool) {
        let (mut robot, mut handler) = (false, false);
        for contact in data.contact() {
            let pair = contact.geom.map(|geom| self.owners.get(geom as usize).copied().unwrap_or(Owner::World));
            for (one, other) in [(pair[0], pair[1]), (pair[1], pair[0])] {
                let meets = other == Owner::World || other == Owner::Passer && !is_walked_into;
                robot |= match one {
                    // Its body on the floor is a fall.
                    Owner::Robot => meets || other == Owner::Floor,
                    Owner::Leg => meets,
                    _ => false,
                };
                handler |= one == Owner::Handler && meets;
            }
        }
        self.robot.step(robot);
        self.handler.step(handler);
        self.by_others.step(is_walked_into);
    }
}
