//! Worlds whose floor ends: stairs, holes and cliffs across a corridor, behind a turn, beside a platform, and beside a
//! way past them. And worlds whose floor only looks as if it did: dark, with mats.

use guidance::TravelLine;
use guidance::se2::{Point, Se2, pose2};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::layout::{FULL, Plan, Stretch};
use super::{GENERATED, GeneratorConfig, between, furnish, populate_course};
use crate::World;
use crate::floor::{DarkFloor, Hole, Stairs, overlap, rectangle};
use crate::prism::Prism;
use crate::site::{Course, DropKind, Site};
use crate::world::DEFAULT_CEILING_M;

/// Depths of what one falls into: kerbs, steps, platforms, pits, metres.
const DEPTHS_M: [[f64; 2]; 4] = [[0.12, 0.2], [0.2, 0.5], [0.5, 1.2], [1.2, 3.0]];
/// An edge across a corridor is askew by up to this, radians.
const ASKEW_RAD: f64 = 0.7;
/// Before an edge across lies so much straight corridor, metres.
const BEFORE_M: f64 = 4.0;
/// An edge and a branch's mouth are so far apart, metres.
const MOUTH_M: f64 = 0.5;
/// A hole that one walks past leaves so much floor beside it, metres.
const PASSAGE_M: [f64; 2] = [1.9, 2.4];
/// A platform is at least so wide, metres.
const PLATFORM_M: [f64; 2] = [2.1, 3.4];
/// Beside a platform the floor lies lower for so far, metres.
const TRACK_M: [f64; 2] = [1.0, 5.0];
/// A low step leads down by so much; one that leads up again by less, metres. Of deeper ones, up to what robot and
/// handler take at most, the camera may say either that they can be taken or that they cannot.
const LOW_DOWN_M: [f64; 2] = [0.05, 0.1];
const LOW_UP_M: [f64; 2] = [0.05, 0.058];
/// Between a step down and one up lies so much floor, metres.
const SUNK_M: [f64; 2] = [1.5, 4.0];
/// Draws until a world has room for its edge.
const TRIES: usize = 40;
/// A step of stairs, metres.
const STEP_M: [f64; 2] = [0.14, 0.19];
const TREAD_M: [f64; 2] = [0.25, 0.33];
/// A mat is so thick, metres.
const MAT_M: f64 = 0.01;

/// The world of a seed: one in six has neither edge nor step, and one in six has low steps alone.
#[must_use]
pub fn generate_drops(config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Site {
    loop {
        let kind = match random.random_range(0..12) {
            0..=2 => DropKind::Across,
            3 | 4 => DropKind::Turn,
            5 | 6 => DropKind::Beside,
            7 => DropKind::Past,
            8 | 9 => DropKind::Step,
            _ => DropKind::None,
        };
        // A world whose draws have no room for an edge of that kind gives way to another one.
        if let Some(site) = (0..TRIES).find_map(|_| site(config, kind, random)) {
            return site;
        }
    }
}

fn site(config: &GeneratorConfig, kind: DropKind, random: &mut ChaCha8Rng) -> Option<Site> {
    let mut made = match kind {
        DropKind::Beside => platform(config, random),
        _ => corridor(config, kind, random)?,
    };
    let free_m = |_| [made.course.width_m / 2.0; 2];
    made.prisms.extend(match &made.plan {
        Some(plan) => furnish::things(config, plan, random),
        None => furnish::furnish_course(config, &made.course, free_m, furnish::Kinds::Usual, random),
    });
    // Things stand on floor.
    let over_hole = |prism: &Prism| made.holes.iter().any(|hole| overlap(&hole.outline, &prism.outline));
    made.prisms.retain(|prism| !prism.solid || !over_hole(prism));
    made.prisms.extend(mats(&made, random));
    let dark = dark_floor(&made.course, random);
    let world = World::new(DEFAULT_CEILING_M, made.prisms).with_holes(made.holes).with_dark_floor(dark);
    let people = populate_course(config, &made.course, &world, random);
    Some(Site { place: GENERATED.into(), world: world.with_people(people), course: made.course, drop: kind })
}

/// A world on its way.
struct Made {
    prisms: Vec<Prism>,
    holes: Vec<Hole>,
    course: Course,
    plan: Option<Plan>,
}

fn depth_m(random: &mut ChaCha8Rng) -> f64 {
    let depths_m = DEPTHS_M[random.random_range(0..DEPTHS_M.len())];
    between(random, depths_m)
}

/// What lies beyond an edge at a pose that looks over it, so long and wide, askew at its near side, metres and radians.
fn beyond(near: &Se2, size: [f64; 2], askew_rad: f64, random: &mut ChaCha8Rng) -> Vec<Hole> {
    let [length_m, width_m] = size;
    let depth_m = depth_m(random);
    if askew_rad == 0.0 && random.random_bool(0.5) && length_m > 1.0 {
        let tread_m = between(random, TREAD_M);
        let steps = ((length_m / tread_m) as usize).clamp(1, 12);
        let landing_m = (length_m - steps as f64 * tread_m).max(0.0);
        let rise_m = -between(random, STEP_M);
        let stairs = Stairs { foot: pose2(near), steps, tread_m, width_m, rise_m, landing_m, open: false };
        return stairs.holes().collect();
    }
    let mut outline = rectangle(pose2(near), length_m, width_m);
    let shift_m = (width_m / 2.0 * askew_rad.tan()).clamp(-0.9 * length_m, 0.9 * length_m);
    let ahead = near.rotation * Vector2::x();
    // Its middle stays where it is.
    outline[0] -= ahead * shift_m;
    outline[3] += ahead * shift_m;
    vec![Hole { outline, depth_m }]
}

/// A corridor of the generator's with an edge across it, in one of its branches, or a hole that one walks past.
fn corridor(config: &GeneratorConfig, kind: DropKind, random: &mut ChaCha8Rng) -> Option<Made> {
    let plan = Plan::draw(config, random);
    let (mut prisms, mut course) = (plan.walls(config, random), plan.course());
    let holes = match kind {
        DropKind::Across => {
            let (way_m, length_m) = across(&plan, random)?;
            let askew_rad = if random.random_bool(0.5) { between(random, [-ASKEW_RAD, ASKEW_RAD]) } else { 0.0 };
            let near = plan.line.at(way_m);
            let edge = course.line.foot(Point::from(near.translation.vector)).way_m;
            course.edge_m = Some(edge);
            course.openings.retain(|opening| opening.far_edge_m() < edge);
            if askew_rad == 0.0 && random.random_bool(0.25) {
                prisms.extend(door(&near, plan.width_m, random));
            }
            beyond(&near, [length_m, plan.width_m], askew_rad, random)
        }
        DropKind::Turn => {
            let ways: Vec<_> = plan.branches.iter().filter(|branch| branch.is_way()).collect();
            let line = plan.branch_line(ways.get(random.random_range(0..ways.len().max(1)))?);
            let opening = course.openings.iter_mut().find(|opening| opening.line == line)?;
            let from_m = plan.width_m / 2.0 + between(random, [0.5, 2.0]);
            opening.edge_m = Some(from_m);
            beyond(&line.at(from_m), [line.length_m() - from_m, opening.width_m], 0.0, random)
        }
        DropKind::Past => {
            let free_m = between(random, PASSAGE_M);
            let (wide_m, length_m) = (plan.width_m - free_m, between(random, [0.5, 2.0]));
            let way_m = plan.place(length_m, random)?;
            if wide_m < 0.3 {
                return None;
            }
            let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
            let near = plan.line.at(way_m) * Se2::translation(0.0, side * free_m / 2.0);
            beyond(&near, [length_m, wide_m], 0.0, random)
        }
        DropKind::Step => vec![sunk(&plan, random)?],
        DropKind::None | DropKind::Beside => Vec::new(),
    };
    Some(Made { prisms, holes, course, plan: Some(plan) })
}

/// Where an edge crosses the corridor, and how far the floor beyond it lies lower, metres.
fn across(plan: &Plan, random: &mut ChaCha8Rng) -> Option<(f64, f64)> {
    let stretch = plan.stretches[random.random_range(0..plan.stretches.len())];
    let room_m = stretch.to_m - stretch.from_m - BEFORE_M - 0.6;
    if room_m < 0.0 {
        return None;
    }
    let way_m = stretch.from_m + BEFORE_M + between(random, [0.0, room_m]);
    let is_apart = |branch: &super::layout::Branch| {
        let reach_m = branch.width_m / 2.0 + MOUTH_M + plan.width_m / 2.0 * ASKEW_RAD.tan();
        (branch.way_m - way_m).abs() > reach_m
    };
    plan.branches.iter().all(is_apart).then_some(())?;
    let longest_m = stretch.to_m - way_m;
    let length_m = if random.random_bool(0.5) { longest_m } else { between(random, [0.5, longest_m.min(3.0)]) };
    Some((way_m, length_m.max(0.5)))
}

/// Floor of the corridor that lies a low step lower: a stretch of it, or all the rest.
fn sunk(plan: &Plan, random: &mut ChaCha8Rng) -> Option<Hole> {
    let (way_m, _) = across(plan, random)?;
    let near = plan.line.at(way_m);
    let stretch = plan.stretches.iter().find(|stretch| (stretch.from_m..stretch.to_m).contains(&way_m))?;
    let rest_m = stretch.to_m - way_m;
    let leads_off = |length_m: f64| {
        let reach_m = |branch: &super::layout::Branch| branch.width_m / 2.0 + MOUTH_M;
        plan.branches.iter().any(|b| (way_m - reach_m(b)..way_m + length_m + reach_m(b)).contains(&b.way_m))
    };
    let is_last = stretch.to_m >= plan.line.length_m() - 1e-6;
    let (length_m, depth_m) = if is_last && random.random_bool(0.7) {
        // Up to the wall at the end.
        (rest_m + 0.2, between(random, LOW_DOWN_M))
    } else {
        (between(random, SUNK_M), between(random, LOW_UP_M))
    };
    let fits = (length_m <= rest_m || is_last) && !leads_off(length_m);
    fits.then(|| Hole { outline: rectangle(pose2(&near), length_m, plan.width_m), depth_m })
}

/// A doorway at an edge, and the door that opens over it.
fn door(near: &Se2, width_m: f64, random: &mut ChaCha8Rng) -> Vec<Prism> {
    let (half_m, open_m) = (width_m / 2.0, between(random, [0.9, 1.3]));
    let middle_m = between(random, [-0.5, 0.5]) * (width_m - open_m).max(0.0);
    let jambs = [middle_m - open_m / 2.0, middle_m + open_m / 2.0];
    let wall =
        |from_m: f64, to_m: f64| Prism::wall(vec![near * Point::new(0.0, from_m), near * Point::new(0.0, to_m)], FULL);
    let turned_rad = between(random, [0.3, 1.5]);
    let leaf = near * Point::new(open_m * turned_rad.sin(), jambs[0] + open_m * turned_rad.cos());
    let leaf = Prism::wall(vec![near * Point::new(0.0, jambs[0]), leaf], [0.01, 2.05]);
    vec![wall(-half_m, jambs[0]), wall(jambs[1], half_m), leaf]
}

/// A straight platform: a wall on one side, lower floor on the other.
fn platform(config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Made {
    let (width_m, length_m) = (between(random, PLATFORM_M), between(random, config.length_m));
    let frame = Se2::new(Vector2::zeros(), between(random, [-3.1, 3.1]));
    let ends = [Point::origin(), Point::new(length_m, 0.0)].map(|p| frame * p);
    let line = TravelLine::new(&ends).unwrap_or_else(|| unreachable!("two ends of a platform differ"));
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let track_m = between(random, TRACK_M);
    let wall = |from: (f64, f64), to: (f64, f64)| {
        let at = |(x_m, y_m): (f64, f64)| frame * Point::new(x_m, side * y_m);
        Prism::wall(vec![at(from), at(to)], FULL)
    };
    let (near_m, far_m) = (-width_m / 2.0, width_m / 2.0 + track_m);
    let prisms = vec![
        wall((0.0, near_m), (length_m, near_m)),
        wall((0.0, far_m), (length_m, far_m)),
        wall((0.0, near_m), (0.0, far_m)),
        wall((length_m, near_m), (length_m, far_m)),
    ];
    let edge = frame * Se2::new(Vector2::new(length_m / 2.0, side * width_m / 2.0), side * std::f64::consts::FRAC_PI_2);
    let depth_m = depth_m(random);
    let holes = vec![Hole { outline: rectangle(pose2(&edge), track_m, length_m), depth_m }];
    Made { prisms, holes, course: Course::new(line, width_m, Vec::new()), plan: None }
}

/// Mats that lie in the way.
fn mats(made: &Made, random: &mut ChaCha8Rng) -> Vec<Prism> {
    let count = random.random_range(0..3);
    let mat = |random: &mut ChaCha8Rng| {
        let at = made.course.line.at(between(random, [1.0, made.course.line.length_m() - 1.0]));
        let size = [between(random, [0.4, 1.5]), between(random, [0.4, made.course.width_m])];
        Prism::solid(rectangle(pose2(&at), size[0], size[1]), [0.0, MAT_M])
    };
    let mats: Vec<Prism> = (0..count).map(|_| mat(random)).collect();
    let on_floor = |mat: &Prism| !made.holes.iter().any(|hole| overlap(&hole.outline, &mat.outline));
    mats.into_iter().filter(on_floor).collect()
}

/// A carpet, or sun on the floor, in every third world.
fn dark_floor(course: &Course, random: &mut ChaCha8Rng) -> Vec<DarkFloor> {
    if !random.random_bool(0.33) {
        return Vec::new();
    }
    let at = course.line.at(between(random, [0.0, course.line.length_m() - 1.0]));
    let outline = rectangle(pose2(&at), between(random, [1.0, 5.0]), course.width_m);
    vec![DarkFloor { outline, silent: 0.3 }]
}

impl Plan {
    /// Where something so long fits in a straight stretch, away from mouths, metres of way.
    fn place(&self, length_m: f64, random: &mut ChaCha8Rng) -> Option<f64> {
        let Stretch { from_m, to_m } = self.stretches[random.random_range(0..self.stretches.len())];
        let last_m = to_m - length_m - 2.5;
        (last_m > from_m + 3.0).then_some(())?;
        let way_m = between(random, [from_m + 3.0, last_m]);
        let is_apart = |branch: &super::layout::Branch| {
            (branch.way_m - way_m - length_m / 2.0).abs() > (branch.width_m + length_m) / 2.0 + MOUTH_M
        };
        self.branches.iter().all(is_apart).then_some(way_m)
    }
}

#[cfg(test)]
mod tests {
    use super::generate_drops;
    use crate::GeneratorConfig;
    use crate::floor::overlap;
    use crate::site::DropKind;
    use guidance::se2::Point;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn every_kind_of_edge_is_where_the_site_says() {
        let mut seen = std::collections::BTreeMap::new();
        for seed in 0..300 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let site = generate_drops(&GeneratorConfig::default(), &mut random);
            *seen.entry(format!("{:?}", site.drop)).or_insert(0) += 1;
            let holes = site.world.holes();
            assert_eq!(holes.is_empty(), site.drop == DropKind::None, "seed {seed}");
            let pairs = holes.iter().enumerate().flat_map(|(i, a)| holes[..i].iter().map(move |b| (a, b)));
            assert!(pairs.into_iter().all(|(a, b)| !overlap(&a.outline, &b.outline)), "seed {seed}");
            let at = |line: &guidance::TravelLine, way_m: f64| Point::from(line.at(way_m).translation.vector);
            if site.drop == DropKind::Step {
                let lowest_m = holes.iter().map(|hole| hole.depth_m).fold(0.0, f64::max);
                assert!((super::LOW_DOWN_M[0]..=super::LOW_DOWN_M[1]).contains(&lowest_m), "seed {seed}");
            }
            let turns = site.course.openings.iter().filter_map(|o| Some((&o.line, o.edge_m?)));
            let edges = site.course.edge_m.map(|edge_m| (&site.course.line, edge_m)).into_iter().chain(turns);
            for (line, edge_m) in edges {
                assert!(site.world.to_edge_m(at(line, edge_m)) < 0.05, "seed {seed}");
                assert_eq!(site.world.to_edge_m(at(line, edge_m + 0.1)), 0.0, "seed {seed}");
                assert!(site.world.to_edge_m(at(line, edge_m - 0.5)) > 0.2, "seed {seed}");
            }
        }
        assert!(seen.len() == 6 && seen.values().all(|count| *count >= 15), "{seen:?}");
    }
}
