//! The world file (TOML). Lengths in metres, angles in degrees, heights `z = [lower, upper]` above the floor.
//!
//! ```toml
//! ceiling_m = 2.6                  # default 2.6
//! map = "floor.yaml"               # a ROS map to stand in, from this file's folder; default none
//!
//! [[wall]]                         # thin, along a polyline
//! points = [[0, 1.2], [40, 1.2]]
//! z = [0, 2.6]                     # default: floor to ceiling
//! glass = false                    # default; glass blocks, and neither lidar nor camera sees it
//!
//! [[arc]]                          # thin, along an arc, counter-clockwise where to_deg is the larger
//! center = [0, 12]
//! radius_m = 10.9
//! from_deg = -90
//! to_deg = 30
//!
//! [[box]]
//! at = [8, 1]                      # its centre
//! size = [0.6, 0.4]                # along its own x and y
//! yaw_deg = 0                      # default 0
//! z = [0, 0.8]
//!
//! [[pillar]]
//! at = [6, 1.5]
//! radius_m = 0.3
//! z = [0, 2.6]                     # default: floor to ceiling
//!
//! [[curtain]]                      # thin, hangs
//! points = [[15, 3.5], [15, 0.5]]
//! z = [0.1, 2.2]
//!
//! [[door]]                         # swings open once, and shut again; stops for robot, handler and people
//! hinge = [12, -1.2]
//! length_m = 0.9
//! thickness_m = 0.04               # default 0.04
//! z = [0, 2.05]                    # default
//! shut_deg = 0                     # the way from the hinge along the leaf where it is shut,
//! open_deg = 90                    # and where it is open
//! speed_degps = 60                 # default 60
//! opens_near_m = 3.5               # begins when the robot is so near to the hinge; or `opens_s`: at this run time
//! stays_s = 5                      # default 5: for so long it stays open
//! seen_by = "both"                 # default: lidar and camera. "camera" is dirty glass, "nobody" is clean glass
//!
//! [[ramp]]                         # needs `--physics mujoco`; up, a plateau and down are three of them
//! at = [4, 0]                      # middle of its foot
//! yaw_deg = 0                      # the way up, default 0
//! size = [3, 2.4]                  # its length over the floor, and its width
//! from_m = 0                       # height of its foot, default 0
//! rise_m = 0.25                    # 0: a plateau
//!
//! [[hole]]                         # floor that lies lower: robot and handler fall in. Holes do not overlap
//! at = [12, 0]                     # middle of its near side
//! yaw_deg = 0                      # the way over that side, default 0
//! size = [1, 2.4]                  # its length, and its width
//! depth_m = 0.5
//!
//! [[stairs]]
//! at = [20, 0]                     # middle of the first edge
//! yaw_deg = 0                      # the way over it, default 0
//! steps = 8
//! width_m = 2.4
//! tread_m = 0.28                   # default 0.28
//! rise_m = -0.17                   # less than 0: they lead down
//! landing_m = 1                    # floor beyond the last step, at its height; default 0
//! open = false                     # default; true: treads that one sees through, of stairs that lead up
//!
//! [[dark_floor]]                   # of some of its pixels a depth camera says nothing: dark, or shiny
//! at = [4, 0]                      # middle of its near side
//! yaw_deg = 0                      # default 0
//! size = [2, 2.4]
//! silent = 0.3                     # the share of those pixels, default 0.3
//!
//! [[person]]
//! path = [[28, 0.75], [16, 0.75]]  # one point: stands
//! speed_mps = 0.6                  # default 0.8
//! radius_m = 0.25                  # default 0.25
//! walk = "back_and_forth"          # default; or "loop", "once" (stands still at the end)
//! yields = true                    # default: stops while robot or handler is within 1.2 m ahead
//! start_s = 0                      # default 0: run time at which they set out
//! moves = "path"                   # default; "social": by the social force model, round people, walls and the team
//! group = 1                        # of "social" alone: people of the same number walk together; default none
//! pauses = [[6, 20]]               # of "social" alone: stops 6 m along the path for 20 s; default none
//! ```

mod door;

use std::ops::Range;
use std::path::Path;

use guidance::se2::Point;
use messages::Pose2;
use serde::Deserialize;
use toml::Spanned;

use crate::floor::{DarkFloor, Hole, Stairs, overlap, rectangle};
use crate::people::{Manner, Moves, Pause, Person, Walk};
use crate::prism::{Prism, SeenBy};
use crate::ramp::Ramp;
use crate::text_file::TomlText;
use crate::world::DEFAULT_CEILING_M;
use crate::{GridMap, World, WorldError};

/// No place is farther from the origin, metres: a large airport fits.
const MAX_COORDINATE_M: f64 = 2000.0;
/// No thing is larger, metres.
const MAX_SIZE_M: f64 = 500.0;
/// Things are at least this large: a face of a millimetre is a typing error, metres.
const MIN_SIZE_M: f64 = 0.01;
/// The lowest and the highest that anything is, metres.
const HEIGHTS_M: (f64, f64) = (0.0, 50.0);
/// A ramp is at least so long and wide, metres, at most so steep, and leads at most so high, metres.
const RAMP_MIN_M: f64 = 0.1;
const RAMP_SLOPE_MAX: f64 = 0.5;
const RAMP_HIGH_M: f64 = 5.0;
/// A hole is at most so deep, metres, and a step at least and at most so high, metres.
const HOLE_DEEP_M: f64 = 20.0;
const STEP_M: [f64; 2] = [0.01, 0.5];
/// The most steps of a flight of stairs.
const STEPS_MAX: usize = 100;
/// The longest stop of a person, seconds.
const PAUSE_MAX_S: f64 = 3600.0;
/// The most corners in all, so that a slip of a generator is refused and not built.
const MAX_CORNERS: usize = 200_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    ceiling_m: Option<Spanned<f64>>,
    map: Option<String>,
    #[serde(default)]
    wall: Vec<Spanned<Wall>>,
    #[serde(default)]
    arc: Vec<Spanned<Arc>>,
    #[serde(default, rename = "box")]
    cuboid: Vec<Spanned<Cuboid>>,
    #[serde(default)]
    pillar: Vec<Spanned<Pillar>>,
    #[serde(default)]
    curtain: Vec<Spanned<Curtain>>,
    #[serde(default)]
    door: Vec<Spanned<door::Swinging>>,
    #[serde(default)]
    ramp: Vec<Spanned<Incline>>,
    #[serde(default)]
    hole: Vec<Spanned<Opened>>,
    #[serde(default)]
    stairs: Vec<Spanned<Flight>>,
    #[serde(default)]
    dark_floor: Vec<Spanned<Dark>>,
    #[serde(default)]
    person: Vec<Spanned<Somebody>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Wall {
    points: Vec<[f64; 2]>,
    z: Option<[f64; 2]>,
    #[serde(default)]
    glass: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Arc {
    center: [f64; 2],
    radius_m: f64,
    from_deg: f64,
    to_deg: f64,
    z: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Cuboid {
    at: [f64; 2],
    size: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
    z: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pillar {
    at: [f64; 2],
    radius_m: f64,
    z: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Curtain {
    points: Vec<[f64; 2]>,
    z: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Incline {
    at: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
    size: [f64; 2],
    #[serde(default)]
    from_m: f64,
    rise_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Somebody {
    path: Vec<[f64; 2]>,
    #[serde(default = "walking_mps")]
    speed_mps: f64,
    #[serde(default = "person_radius_m")]
    radius_m: f64,
    #[serde(default)]
    walk: Walk,
    #[serde(default = "yes")]
    yields: bool,
    #[serde(default)]
    start_s: f64,
    #[serde(default)]
    moves: Movement,
    group: Option<u32>,
    #[serde(default)]
    pauses: Vec<[f64; 2]>,
}

#[derive(Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Movement {
    #[default]
    Path,
    Social,
}

/// Walking with some care for a guide robot in the way.
fn walking_mps() -> f64 {
    0.8
}

fn person_radius_m() -> f64 {
    0.25
}

fn yes() -> bool {
    true
}

/// A world from the text of a world file.
pub(crate) fn parse(name: &str, text: &str, folder: &Path) -> Result<World, WorldError> {
    let toml = TomlText { file: name, text };
    let file: File = toml.parse()?;
    let ceiling_m = match &file.ceiling_m {
        Some(ceiling) => {
            toml.check(&ceiling.span(), "ceiling_m", *ceiling.get_ref(), (0.5, HEIGHTS_M.1))?;
            *ceiling.get_ref()
        }
        None => DEFAULT_CEILING_M,
    };
    let reader = Reader { toml, ceiling_m };
    let flights = file.stairs.iter().map(|entry| reader.stairs(entry)).collect::<Result<Vec<_>, _>>()?;
    let mut prisms = reader.prisms(&file)?;
    prisms.extend(flights.iter().flat_map(Stairs::bodies));
    let holes = reader.holes(&file, &flights)?;
    let dark = file.dark_floor.iter().map(|entry| reader.dark_floor(entry)).collect::<Result<Vec<_>, _>>()?;
    let people = file.person.iter().map(|entry| reader.person(entry)).collect::<Result<Vec<_>, _>>()?;
    let doors = file.door.iter().map(|entry| reader.door(entry)).collect::<Result<Vec<_>, _>>()?;
    reader.most("person", "people", &file.person, messages::MAX_WALKERS)?;
    reader.most("door", "doors", &file.door, messages::MAX_DOORS)?;
    let ramps = file.ramp.iter().map(|entry| reader.ramp(entry)).collect::<Result<Vec<_>, _>>()?;
    let world = World::new(ceiling_m, prisms).with_people(people).with_ramps(ramps);
    let world = world.with_doors(doors).with_holes(holes).with_dark_floor(dark);
    Ok(match &file.map {
        Some(map) => world.with_map(GridMap::load(&folder.join(map))?),
        None => world,
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Opened {
    at: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
    size: [f64; 2],
    depth_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Flight {
    at: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
    steps: usize,
    width_m: f64,
    #[serde(default = "usual_tread_m")]
    tread_m: f64,
    rise_m: f64,
    #[serde(default)]
    landing_m: f64,
    #[serde(default)]
    open: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Dark {
    at: [f64; 2],
    #[serde(default)]
    yaw_deg: f64,
    size: [f64; 2],
    #[serde(default = "usual_silence")]
    silent: f64,
}

fn usual_tread_m() -> f64 {
    0.28
}

fn usual_silence() -> f64 {
    0.3
}

/// Checks values and builds from them.
struct Reader<'a> {
    toml: TomlText<'a>,
    ceiling_m: f64,
}

impl Reader<'_> {
    fn prisms(&self, file: &File) -> Result<Vec<Prism>, WorldError> {
        let (mut prisms, mut corners) = (Vec::new(), 0);
        let built = (file.wall.iter().map(|entry| (entry.span(), self.wall(entry))))
            .chain(file.arc.iter().map(|entry| (entry.span(), self.arc(entry))))
            .chain(file.cuboid.iter().map(|entry| (entry.span(), self.cuboid(entry))))
            .chain(file.pillar.iter().map(|entry| (entry.span(), self.pillar(entry))))
            .chain(file.curtain.iter().map(|entry| (entry.span(), self.curtain(entry))));
        for (span, prism) in built {
            let prism = prism?;
            corners += prism.outline.len();
            if corners > MAX_CORNERS {
                return Err(self.toml.refuse(&span, "world", format!("there are over {MAX_CORNERS} corners")));
            }
            prisms.push(prism);
        }
        Ok(prisms)
    }

    fn most<T>(&self, key: &'static str, what: &str, entries: &[Spanned<T>], most: usize) -> Result<(), WorldError> {
        match entries.get(most) {
            Some(surplus) => Err(self.toml.refuse(&surplus.span(), key, format!("there are over {most} {what}"))),
            None => Ok(()),
        }
    }

    fn wall(&self, entry: &Spanned<Wall>) -> Result<Prism, WorldError> {
        let (span, wall) = (entry.span(), entry.get_ref());
        let points = self.points(&span, "points", &wall.points, 2)?;
        let mut prism = Prism::wall(points, self.heights(&span, wall.z)?);
        if wall.glass {
            prism.seen_by = SeenBy::Nobody;
        }
        Ok(prism)
    }

    fn arc(&self, entry: &Spanned<Arc>) -> Result<Prism, WorldError> {
        let (span, arc) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "radius_m", arc.radius_m, (0.05, MAX_SIZE_M))?;
        self.toml.check(&span, "from_deg", arc.from_deg, (-720.0, 720.0))?;
        self.toml.check(&span, "to_deg", arc.to_deg, (arc.from_deg - 360.0, arc.from_deg + 360.0))?;
        let angles = [arc.from_deg.to_radians(), arc.to_deg.to_radians()];
        Ok(Prism::arc(self.point(&span, "center", arc.center)?, arc.radius_m, angles, self.heights(&span, arc.z)?))
    }

    fn cuboid(&self, entry: &Spanned<Cuboid>) -> Result<Prism, WorldError> {
        let (span, cuboid) = (entry.span(), entry.get_ref());
        for length in cuboid.size {
            self.toml.check(&span, "size", length, (MIN_SIZE_M, MAX_SIZE_M))?;
        }
        self.toml.check(&span, "yaw_deg", cuboid.yaw_deg, (-720.0, 720.0))?;
        let (at, z) = (self.point(&span, "at", cuboid.at)?, self.heights(&span, Some(cuboid.z))?);
        Ok(Prism::cuboid(at, cuboid.size, cuboid.yaw_deg.to_radians(), z))
    }

    fn pillar(&self, entry: &Spanned<Pillar>) -> Result<Prism, WorldError> {
        let (span, pillar) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "radius_m", pillar.radius_m, (MIN_SIZE_M, MAX_SIZE_M))?;
        Ok(Prism::pillar(self.point(&span, "at", pillar.at)?, pillar.radius_m, self.heights(&span, pillar.z)?))
    }

    fn curtain(&self, entry: &Spanned<Curtain>) -> Result<Prism, WorldError> {
        let (span, curtain) = (entry.span(), entry.get_ref());
        let points = self.points(&span, "points", &curtain.points, 2)?;
        Ok(Prism::wall(points, self.heights(&span, Some(curtain.z))?))
    }

    fn ramp(&self, entry: &Spanned<Incline>) -> Result<Ramp, WorldError> {
        let (span, ramp) = (entry.span(), entry.get_ref());
        let [length_m, width_m] = ramp.size;
        for length in ramp.size {
            self.toml.check(&span, "size", length, (RAMP_MIN_M, MAX_SIZE_M))?;
        }
        self.toml.check(&span, "yaw_deg", ramp.yaw_deg, (-720.0, 720.0))?;
        self.toml.check(&span, "rise_m", ramp.rise_m, (0.0, (length_m * RAMP_SLOPE_MAX).min(RAMP_HIGH_M)))?;
        self.toml.check(&span, "from_m", ramp.from_m, (0.0, RAMP_HIGH_M - ramp.rise_m))?;
        let at = self.point(&span, "at", ramp.at)?;
        let foot = Pose2::new(at.x, at.y, ramp.yaw_deg.to_radians());
        Ok(Ramp { foot, from_m: ramp.from_m, length_m, width_m, rise_m: ramp.rise_m })
    }

    /// All holes, those of stairs that lead down among them.
    fn holes(&self, file: &File, flights: &[Stairs]) -> Result<Vec<Hole>, WorldError> {
        let mut found = Vec::new();
        for entry in &file.hole {
            found.push((entry.span(), vec![self.hole(entry)?]));
        }
        found.extend(file.stairs.iter().zip(flights).map(|(entry, flight)| (entry.span(), flight.holes().collect())));
        let mut holes: Vec<Hole> = Vec::new();
        for (span, more) in found {
            let overlaps = |hole: &Hole| holes.iter().any(|other| overlap(&hole.outline, &other.outline));
            if more.iter().any(overlaps) {
                let what = "it overlaps another hole, or stairs that lead down";
                return Err(self.toml.refuse(&span, "hole", what.to_owned()));
            }
            holes.extend(more);
        }
        Ok(holes)
    }

    fn hole(&self, entry: &Spanned<Opened>) -> Result<Hole, WorldError> {
        let (span, hole) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "depth_m", hole.depth_m, (MIN_SIZE_M, HOLE_DEEP_M))?;
        Ok(Hole { outline: self.patch(&span, hole.at, hole.yaw_deg, hole.size)?, depth_m: hole.depth_m })
    }

    fn dark_floor(&self, entry: &Spanned<Dark>) -> Result<DarkFloor, WorldError> {
        let (span, dark) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "silent", dark.silent, (0.0, 1.0))?;
        Ok(DarkFloor { outline: self.patch(&span, dark.at, dark.yaw_deg, dark.size)?, silent: dark.silent })
    }

    fn stairs(&self, entry: &Spanned<Flight>) -> Result<Stairs, WorldError> {
        let (span, flight) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "yaw_deg", flight.yaw_deg, (-720.0, 720.0))?;
        self.toml.check(&span, "width_m", flight.width_m, (RAMP_MIN_M, MAX_SIZE_M))?;
        self.toml.check(&span, "tread_m", flight.tread_m, (RAMP_MIN_M, MAX_SIZE_M))?;
        self.toml.check(&span, "landing_m", flight.landing_m, (0.0, MAX_SIZE_M))?;
        self.toml.check(&span, "rise_m", flight.rise_m, (-STEP_M[1], STEP_M[1]))?;
        let refuse = |key, what: String| Err(self.toml.refuse(&span, key, what));
        if flight.rise_m.abs() < STEP_M[0] {
            return refuse("rise_m", format!("{} is no step: at least {} up or down", flight.rise_m, STEP_M[0]));
        }
        if !(1..=STEPS_MAX).contains(&flight.steps) {
            return refuse("steps", format!("{} is not in 1..{STEPS_MAX}", flight.steps));
        }
        if flight.open && flight.rise_m < 0.0 {
            return refuse("open", "only stairs that lead up can have open treads".into());
        }
        let at = self.point(&span, "at", flight.at)?;
        Ok(Stairs {
            foot: Pose2::new(at.x, at.y, flight.yaw_deg.to_radians()),
            steps: flight.steps,
            tread_m: flight.tread_m,
            width_m: flight.width_m,
            rise_m: flight.rise_m,
            landing_m: flight.landing_m,
            open: flight.open,
        })
    }

    /// A rectangle of floor from the middle of its near side.
    fn patch(
        &self,
        span: &Range<usize>,
        at: [f64; 2],
        yaw_deg: f64,
        [length_m, width_m]: [f64; 2],
    ) -> Result<Vec<Point>, WorldError> {
        for length in [length_m, width_m] {
            self.toml.check(span, "size", length, (MIN_SIZE_M, MAX_SIZE_M))?;
        }
        self.toml.check(span, "yaw_deg", yaw_deg, (-720.0, 720.0))?;
        let at = self.point(span, "at", at)?;
        Ok(rectangle(Pose2::new(at.x, at.y, yaw_deg.to_radians()), length_m, width_m))
    }

    fn person(&self, entry: &Spanned<Somebody>) -> Result<Person, WorldError> {
        let (span, person) = (entry.span(), entry.get_ref());
        self.toml.check(&span, "speed_mps", person.speed_mps, (0.0, 3.0))?;
        self.toml.check(&span, "radius_m", person.radius_m, (0.05, 1.0))?;
        self.toml.check(&span, "start_s", person.start_s, (0.0, 1e6))?;
        Ok(Person {
            path: self.points(&span, "path", &person.path, 1)?,
            speed_mps: person.speed_mps,
            radius_m: person.radius_m,
            walk: person.walk,
            yields: person.yields,
            start_s: person.start_s,
            moves: self.moves(&span, person)?,
        })
    }

    fn moves(&self, span: &Range<usize>, person: &Somebody) -> Result<Moves, WorldError> {
        if person.moves == Movement::Path {
            let alone = [("group", person.group.is_some()), ("pauses", !person.pauses.is_empty())];
            return match alone.into_iter().find(|(_, is_given)| *is_given) {
                Some((key, _)) => Err(self.toml.refuse(span, key, "it needs moves = \"social\"".into())),
                None => Ok(Moves::Path),
            };
        }
        let places: Vec<Point> = person.path.iter().map(|[x, y]| Point::new(*x, *y)).collect();
        let (mut from_m, length_m) = (0.0, places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum());
        let pause = |&[way_m, for_s]: &[f64; 2]| {
            self.toml.check(span, "pauses", way_m, (from_m, length_m))?;
            self.toml.check(span, "pauses", for_s, (0.0, PAUSE_MAX_S))?;
            from_m = way_m;
            Ok(Pause { way_m, for_s })
        };
        let pauses = person.pauses.iter().map(pause).collect::<Result<_, WorldError>>()?;
        Ok(Moves::Social(Manner { group: person.group, pauses }))
    }

    fn point(&self, span: &Range<usize>, key: &'static str, [x, y]: [f64; 2]) -> Result<Point, WorldError> {
        for value in [x, y] {
            self.toml.check(span, key, value, (-MAX_COORDINATE_M, MAX_COORDINATE_M))?;
        }
        Ok(Point::new(x, y))
    }

    fn points(
        &self,
        span: &Range<usize>,
        key: &'static str,
        points: &[[f64; 2]],
        least: usize,
    ) -> Result<Vec<Point>, WorldError> {
        if points.len() < least {
            return Err(self.toml.refuse(span, key, format!("{} points are too few, {least} needed", points.len())));
        }
        points.iter().map(|&point| self.point(span, key, point)).collect()
    }

    /// Lower and upper edge; floor to ceiling where nothing is said.
    fn heights(&self, span: &Range<usize>, z: Option<[f64; 2]>) -> Result<[f64; 2], WorldError> {
        let [z0_m, z1_m] = z.unwrap_or([0.0, self.ceiling_m]);
        self.toml.check(span, "z", z0_m, HEIGHTS_M)?;
        self.toml.check(span, "z", z1_m, HEIGHTS_M)?;
        if z0_m >= z1_m {
            return Err(self.toml.refuse(span, "z", format!("lower edge {z0_m} is not under upper edge {z1_m}")));
        }
        Ok([z0_m, z1_m])
    }
}
