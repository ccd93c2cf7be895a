//! Generated worlds: what is in them, and that there is a way through.

use guidance::TravelLine;
use guidance::se2::Point;
use guidedog_world::{Agent, Door, GeneratorConfig, Opening, SeenBy, Side, Site, World, generate};
use nalgebra::Vector2;

/// Robot and handler touch nothing between these heights, metres.
const TALL: [f64; 2] = [0.02, 1.8];

fn sites(config: &GeneratorConfig) -> Vec<Site> {
    (0..300).map(|seed| generate(config, seed)).collect()
}

fn empty() -> GeneratorConfig {
    GeneratorConfig { clutter_per_m: 0.0, people: 0.0, glass: 0.0, ..GeneratorConfig::default() }
}

/// The first place along a line at which a disc touches something.
fn blocked(world: &World, line: &TravelLine, radius_m: f64, [from_m, to_m]: [f64; 2]) -> Option<f64> {
    let steps = ((to_m - from_m) / 0.1) as usize;
    let way_m = |i: usize| from_m + 0.1 * i as f64;
    let place = |way_m: f64| Point::from(line.at(way_m).translation.vector);
    (0..steps).map(way_m).find(|way_m| world.clearance(place(*way_m), TALL, radius_m) < radius_m)
}

#[test]
fn the_same_seed_gives_the_same_world() {
    let config = GeneratorConfig::default();
    for seed in 0..20 {
        let (one, other) = (generate(&config, seed), generate(&config, seed));
        assert_eq!((one.world.prisms(), &one.course), (other.world.prisms(), &other.course));
        assert_eq!(one.world.people(), other.world.people());
        assert_ne!(one.course.line, generate(&config, seed + 1000).course.line);
    }
}

#[test]
fn without_things_the_ways_are_free_from_wall_to_wall() {
    for (seed, site) in sites(&empty()).iter().enumerate() {
        let (course, world) = (&site.course, &site.world);
        let radius_m = course.width_m / 2.0 - 0.15;
        let to_m = course.line.length_m() - radius_m - 0.1;
        assert_eq!(blocked(world, &course.line, radius_m, [radius_m + 0.1, to_m]), None, "corridor of seed {seed}");
        for opening in &course.openings {
            let radius_m = opening.width_m.min(course.width_m) / 2.0 - 0.25;
            let line = course.line_into(opening).expect("a way in");
            let from_m = (opening.way_m - 2.0).max(radius_m + 0.1);
            let to_m = line.length_m() - radius_m - 0.1;
            let found = blocked(world, &line, radius_m.min(0.6), [from_m, to_m]);
            assert_eq!(found, None, "opening at {} m of seed {seed}", opening.way_m);
        }
    }
}

#[test]
fn everything_that_makes_buildings_hard_is_there() {
    let sites = sites(&GeneratorConfig::default());
    let worlds_with = |has: &dyn Fn(&Site) -> bool| sites.iter().filter(|site| has(site)).count();
    let prism = |has: fn(&guidedog_world::Prism) -> bool| worlds_with(&|site| site.world.prisms().iter().any(has));
    let opens = |side: Side| worlds_with(&|site| site.course.openings.iter().any(|opening| opening.side == side));
    let dead_end = |site: &Site| {
        let end_m = site.course.line.length_m() - 0.3;
        site.course.openings.iter().all(|opening| opening.far_edge_m() < end_m)
    };
    let counts = [
        ("boxes under the lidar's plane", prism(|p| p.solid && p.z0_m == 0.0 && p.z1_m < 0.35)),
        ("things that hang over it", prism(|p| p.solid && p.z0_m > 0.4)),
        ("curtains", prism(|p| p.solid && p.z1_m == 2.2)),
        ("pillars", prism(|p| p.solid && p.outline.len() >= 8)),
        ("glass that the lidar looks through", prism(|p| p.seen_by == SeenBy::Camera)),
        ("people", worlds_with(&|site| !site.world.people().is_empty())),
        ("bends", worlds_with(&|site| site.course.line.corners().len() > 2)),
        ("dead ends", worlds_with(&dead_end)),
        ("ways to the left", opens(Side::Left)),
        ("ways to the right", opens(Side::Right)),
    ];
    for (what, count) in counts {
        assert!(count >= 20, "{what}: in {count} of {} worlds", sites.len());
    }
}

/// Whether a corridor's own corner has its walls straight to the corner: then it is free where the middles before and
/// after it would meet.
fn is_square(site: &Site, corner: &Opening) -> bool {
    let (line, width_m) = (&site.course.line, site.course.width_m);
    let (before, after) = (line.at(corner.way_m - width_m), line.at(corner.way_m + width_m));
    let (a, b) = (before.rotation * Vector2::x(), after.rotation * Vector2::x());
    if a.perp(&b).abs() < 0.9 {
        return false;
    }
    let between = after.translation.vector - before.translation.vector;
    let meet = Point::from(before.translation.vector + a * (between.perp(&b) / a.perp(&b)));
    site.world.clearance(meet, TALL, 0.45 * width_m) >= 0.45 * width_m
}

/// A corridor's own corners go on to its end.
fn is_branch(site: &Site, opening: &Opening) -> bool {
    let end = |line: &TravelLine| line.at(line.length_m()).translation.vector;
    (end(&opening.line) - end(&site.course.line)).norm() > 1e-6
}

#[test]
fn some_corridors_turn_at_one_square_corner() {
    let sites = sites(&empty());
    let has_square = |site: &&Site| site.course.openings.iter().any(|o| !is_branch(site, o) && is_square(site, o));
    let square = sites.iter().filter(has_square).count();
    assert!(square > 20, "{square} of 300");
    // Nobody can tell a corner from a corridor that ends on one to a side: none does.
    for site in &sites {
        let at_end = |side: Side| {
            let end_m = site.course.line.length_m();
            let mut branches = site.course.openings.iter().filter(|o| is_branch(site, o));
            branches.any(|o| o.side == side && o.far_edge_m() > end_m - 1.4)
        };
        assert_eq!(at_end(Side::Left), at_end(Side::Right));
    }
}

#[test]
fn an_opening_is_asked_for_until_its_far_edge_is_passed() {
    let site = (0..200).map(|seed| generate(&empty(), seed)).find(|site| site.course.openings.len() > 2).expect("one");
    let course = &site.course;
    for opening in &course.openings {
        let asked = |from_m: f64| course.next(opening.side, from_m, 15.0);
        assert_eq!(asked(opening.far_edge_m() - 0.01), Some(opening));
        assert_ne!(asked(opening.far_edge_m() + 0.01), Some(opening));
        assert!(asked(opening.way_m - 15.1).is_none_or(|found| found.way_m < opening.way_m));
    }
}

/// Side of a cell, metres.
const CELL_M: f64 = 0.05;

fn middle_of((i, j): (i32, i32)) -> Point {
    Point::new(CELL_M * f64::from(i), CELL_M * f64::from(j))
}

/// The cells that a disc of that radius comes to from a place.
fn reached(world: &World, from: Point, radius_m: f64) -> std::collections::HashSet<(i32, i32)> {
    let start = ((from.x / CELL_M).round() as i32, (from.y / CELL_M).round() as i32);
    let (mut reached, mut open) = (std::collections::HashSet::from([start]), vec![start]);
    while let Some((i, j)) = open.pop() {
        for next in [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)] {
            let is_free = || world.clearance(middle_of(next), TALL, radius_m) >= radius_m;
            // Who comes so far has come out of the world.
            assert!(reached.len() < 80_000, "there is a gap in the walls");
            if !reached.contains(&next) && is_free() {
                reached.insert(next);
                open.push(next);
            }
        }
    }
    reached
}

#[test]
fn two_side_by_side_come_everywhere_in_a_corridor_like_those_of_buildings() {
    // Half of what robot and handler need side by side, and half a cell.
    let radius_m = 0.49 + CELL_M / 2.0;
    let (mut ways, mut shut) = (0, Vec::new());
    for seed in 0..300 {
        let site = generate(&GeneratorConfig::of_buildings(), seed);
        let (course, world) = (&site.course, &site.world);
        let length_m = course.line.length_m();
        let at = |line: &TravelLine, way_m: f64| Point::from(line.at(way_m).translation.vector);
        let is_free = |way_m: &f64| world.clearance(at(&course.line, *way_m), TALL, 0.65) >= 0.65;
        let Some(from_m) = (0..40).map(|i| 0.7 + 0.1 * f64::from(i)).find(is_free) else {
            panic!("seed {seed}: nowhere to begin");
        };
        let reached = reached(world, at(&course.line, from_m), radius_m);
        let comes_to = |place: Point| {
            let away_m = |cell: &(i32, i32)| (middle_of(*cell) - place).norm();
            reached.iter().map(away_m).fold(f64::INFINITY, f64::min) < 0.8
        };
        if !comes_to(at(&course.line, length_m - 0.8)) {
            shut.push(format!("seed {seed}: not to the end, {:.2} m wide", course.width_m));
        }
        for opening in course.openings.iter().filter(|opening| opening.line.length_m() > 2.5) {
            let inside_m = (course.width_m / 2.0 + 2.0).min(opening.line.length_m() - 0.7);
            if !comes_to(at(&opening.line, inside_m)) {
                let is_room = opening.behind.is_some();
                shut.push(format!(
                    "seed {seed}: {:.2} m wide at {:.1} of {length_m:.1} m, room: {is_room} {:?} {:.1}",
                    opening.width_m,
                    opening.way_m,
                    opening.side,
                    opening.line.length_m()
                ));
            }
            ways += 1;
        }
    }
    assert!(ways > 300 && shut.is_empty(), "of {ways}: {shut:#?}");
}

#[test]
fn what_makes_real_floors_hard_is_in_generated_buildings() {
    let sites = sites(&GeneratorConfig::of_buildings());
    let openings: Vec<&Opening> = sites.iter().flat_map(|site| &site.course.openings).collect();
    let count = |has: &dyn Fn(&Opening) -> bool| openings.iter().filter(|opening| has(opening)).count();
    let is_clear = |opening: &Opening| opening.line.length_m() > 1.0;
    let prisms = |has: &dyn Fn(&guidedog_world::Prism) -> bool| {
        sites.iter().filter(|site| site.world.prisms().iter().any(has)).count()
    };
    let high = |p: &guidedog_world::Prism, z0: [f64; 2], z1: [f64; 2]| {
        p.solid && (z0[0]..=z0[1]).contains(&p.z0_m) && (z1[0]..=z1[1]).contains(&p.z1_m)
    };
    for (what, count) in [
        ("rooms", count(&|o| o.behind.is_some())),
        ("openings 1.2 to 1.5 m wide", count(&|o| is_clear(o) && o.width_m < 1.5)),
        ("places that are not clear", count(&|o| !is_clear(o))),
        ("doors open inwards", prisms(&|p| p.solid && p.z1_m == 2.05)),
        ("radiators", prisms(&|p| high(p, [0.1, 0.1], [0.5, 0.9]))),
        ("benches", prisms(&|p| high(p, [0.0, 0.38], [0.45, 0.45]))),
        ("fire extinguishers", prisms(&|p| p.outline.len() >= 8 && high(p, [0.01, 0.5], [0.6, 1.1]))),
    ] {
        assert!(count >= 20, "{what}: {count} in {} worlds", sites.len());
    }
}

/// A door is shut at first, and shuts again. While it is open it may block the way.
#[test]
fn in_some_corridors_like_those_of_buildings_a_door_opens() {
    let bare = GeneratorConfig { people: 0.0, ..GeneratorConfig::of_buildings() };
    let sites: Vec<Site> = (0..1200).map(|seed| generate(&bare, seed)).collect();
    let (mut inwards, mut blocking, mut outwards) = (0, 0, 0);
    for site in &sites {
        let (line, half_m) = (&site.course.line, site.course.width_m / 2.0);
        for (door, leaf) in site.world.doors() {
            assert_eq!(site.world.prisms()[leaf], door.leaf(door.swing_rad[0]), "it is shut");
            assert!((3.0..8.0).contains(&door.stays_s));
            let open = &door.leaf(door.swing_rad[1]).outline;
            let nearest_m = open.iter().map(|corner| line.foot(*corner).left_m.abs()).fold(f64::INFINITY, f64::min);
            inwards += u32::from(nearest_m > half_m - 0.1);
            outwards += u32::from(nearest_m <= half_m - 0.1);
            blocking += u32::from(half_m + nearest_m < bare.passage_m);
            assert!(opens_and_shuts(site.world.clone(), door));
        }
    }
    let with = sites.iter().filter(|site| site.world.doors().len() > 0).count();
    println!("{with} of {}: {inwards} inwards, {outwards} into the corridor, {blocking} block it", sites.len());
    assert!((80..120).contains(&with) && inwards > 15 && outwards > 40 && blocking > 10);
}

/// Whether a door opens for who comes near, and shuts when they are gone.
fn opens_and_shuts(mut world: World, door: &Door) -> bool {
    let agent = |x_m: f64| Agent { at: door.hinge + Vector2::new(x_m, 0.0), radius_m: 0.0 };
    world.swing(0.0, 0.01, &[agent(1.9)]);
    world.swing(0.01, 10.0, &[agent(99.0)]);
    let open_rad = world.doors_rad()[0];
    world.swing(10.0, 0.01, &[agent(99.0)]);
    world.swing(30.0, 10.0, &[agent(99.0)]);
    open_rad == door.swing_rad[1] && world.doors_rad()[0] == door.swing_rad[0]
}

/// It is wider than the corridor, has a wall to either side, and something stands in most of them.
#[test]
fn some_corridors_like_those_of_buildings_widen_into_a_hall() {
    let bare = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..GeneratorConfig::of_buildings() };
    let (mut halls, mut furnished, mut widths_m) = (0, 0, Vec::new());
    for site in sites(&bare) {
        let Some([from_m, to_m]) = site.course.mapped.and_then(|mapped| mapped.hall_m) else { continue };
        halls += 1;
        assert!((4.9..12.1).contains(&(to_m - from_m)) && from_m > 4.0 && to_m < site.course.line.length_m() - 4.0);
        let at = site.course.line.at(from_m + 0.6);
        let to_wall_m = |side: f64| {
            let direction = at.rotation * Vector2::new(0.0, side);
            site.world.cast(Point::from(at.translation.vector), direction, 2.3, 20.0).expect("a wall")
        };
        widths_m.push(to_wall_m(1.0) + to_wall_m(-1.0));
        let stands = |prism: &guidedog_world::Prism| {
            let foot = site.course.line.foot(prism.outline[0]);
            prism.solid && (from_m + 1.0..to_m - 1.0).contains(&foot.way_m)
        };
        furnished += usize::from(site.world.prisms().iter().any(stands));
    }
    println!("{halls} halls, {furnished} with things in them, {widths_m:?}");
    assert!((12..30).contains(&halls) && 2 * furnished > halls);
    assert!(widths_m.iter().all(|width_m| (3.99..9.01).contains(width_m)), "{widths_m:?}");
}

/// The way forward goes round it.
#[test]
fn some_corridors_like_those_of_buildings_end_behind_a_square_corner() {
    let bare = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..GeneratorConfig::of_buildings() };
    let sites = sites(&bare);
    let ends_round_corner = |site: &&Site| {
        let mut corners = site.course.openings.iter().filter(|o| !is_branch(site, o) && is_square(site, o));
        corners.next_back().is_some_and(|corner| corner.line.length_m() < 15.0)
    };
    let count = sites.iter().filter(ends_round_corner).count();
    println!("{count} of {} corridors end behind a square corner", sites.len());
    assert!(count >= 15, "{count}");
}
