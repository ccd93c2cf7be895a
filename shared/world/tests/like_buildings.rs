//! Walls of generated worlds against walls of real floors, measured in the same way.

use guidance::se2::Point;
use guidedog_world::{FloorPlan, GeneratorConfig, Site, generate};
use nalgebra::Vector2;

/// Walls are looked at every so far along a course, metres, at this height, and no farther than this.
const STEP_M: f64 = 0.05;
const HEIGHT_M: f64 = 0.4;
const FAR_M: f64 = 6.0;
/// The wall is where half of the looks within this of a place end, metres.
const AROUND_M: f64 = 3.0;
/// A gap or a thing at a wall is at least so deep, metres.
const DEEP_M: f64 = 0.15;
const OUT_M: f64 = 0.06;

/// What is measured of walls.
#[derive(Debug, Default)]
struct Walls {
    length_m: f64,
    widths_m: Vec<f64>,
    /// Width along the wall and depth.
    gaps_m: Vec<[f64; 2]>,
    things_m: Vec<[f64; 2]>,
    residuals_m: Vec<f64>,
    slopes: Vec<f64>,
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

impl Walls {
    fn add(&mut self, site: &Site) {
        let line = &site.course.line;
        let count = (line.length_m() / STEP_M) as usize;
        self.length_m += line.length_m();
        let looks = [1.0, -1.0].map(|side| {
            let look = |i: usize| {
                let at = line.at(i as f64 * STEP_M);
                let direction = at.rotation * Vector2::new(0.0, side);
                site.world.cast(Point::from(at.translation.vector), direction, HEIGHT_M, FAR_M).unwrap_or(FAR_M)
            };
            (0..count).map(look).collect::<Vec<f64>>()
        });
        let reach = (AROUND_M / STEP_M) as usize;
        let walls = looks.each_ref().map(|looks| {
            let around = |i: usize| median(&mut looks[i.saturating_sub(reach)..(i + reach).min(count)].to_vec());
            (0..count).map(around).collect::<Vec<f64>>()
        });
        self.widths_m.extend(walls[0].iter().zip(&walls[1]).map(|(left_m, right_m)| left_m + right_m));
        for (looks, walls) in looks.iter().zip(&walls) {
            let off = |i: usize| looks[i] - walls[i];
            let kind = |i: usize| {
                if off(i) > DEEP_M {
                    1
                } else if off(i) < -OUT_M {
                    -1
                } else {
                    0
                }
            };
            let numbers: Vec<usize> = (0..count).collect();
            for run in numbers.chunk_by(|a, b| kind(*a) == kind(*b)) {
                let length_m = run.len() as f64 * STEP_M;
                let mut offs: Vec<f64> = run.iter().map(|i| off(*i)).collect();
                match kind(run[0]) {
                    1 => self.gaps_m.push([length_m, median(&mut offs)]),
                    -1 => self.things_m.push([length_m, -median(&mut offs)]),
                    _ => self.residuals_m.extend(offs),
                }
            }
            let slope = |i: usize| (walls[i + 20] - walls[i]).abs();
            self.slopes.extend((0..count.saturating_sub(20)).map(slope).filter(|slope| *slope < 0.3));
        }
    }

    /// What is told of them, by name.
    fn told(&mut self) -> Vec<(&'static str, f64)> {
        let of = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values[((values.len() - 1) as f64 * share) as usize]
        };
        let per_10_m = |count: usize| 10.0 * count as f64 / self.length_m;
        let gaps = |wide: [f64; 2], deep: [f64; 2]| {
            let is_one = |gap: &&[f64; 2]| (wide[0]..wide[1]).contains(&gap[0]) && (deep[0]..deep[1]).contains(&gap[1]);
            per_10_m(self.gaps_m.iter().filter(is_one).count())
        };
        let things = |deep: [f64; 2]| {
            let is_one = |thing: &&[f64; 2]| thing[0] < 2.5 && (deep[0]..deep[1]).contains(&thing[1]);
            per_10_m(self.things_m.iter().filter(is_one).count())
        };
        let counts = [
            ("niches 0.15-0.35 m deep", gaps([0.3, 9.0], [0.15, 0.35])),
            ("alcoves 0.35-1 m deep", gaps([0.3, 9.0], [0.35, 1.0])),
            ("alcoves 1-4 m deep", gaps([0.3, 9.0], [1.0, 4.0])),
            ("openings 0.3-0.95 m wide", gaps([0.3, 0.95], [1.0, 9.0])),
            ("openings 0.95-1.5 m wide", gaps([0.95, 1.5], [1.0, 9.0])),
            ("openings 1.5-2.8 m wide", gaps([1.5, 2.8], [1.0, 9.0])),
            ("openings wider", gaps([2.8, 99.0], [1.0, 9.0])),
            ("out by 0.06-0.15 m", things([0.06, 0.15])),
            ("out by 0.15-0.4 m", things([0.15, 0.4])),
            ("out by more", things([0.4, 9.0])),
        ];
        let ragged_m = (self.residuals_m.iter().map(|m| m * m).sum::<f64>() / self.residuals_m.len() as f64).sqrt();
        let widths = [("width p10", 0.1), ("width p50", 0.5), ("width p90", 0.9)];
        let widths = widths.map(|(name, share)| (name, of(&mut self.widths_m, share)));
        let slopes = [("slope p50", 0.5), ("slope p90", 0.9)].map(|(name, share)| (name, of(&mut self.slopes, share)));
        widths.into_iter().chain(counts).chain([("ragged rms", ragged_m)]).chain(slopes).collect()
    }
}

/// The maps, those that tests and statistics are of.
fn maps() -> Option<Vec<(String, FloorPlan)>> {
    let folder = test_data::data("maps")?;
    let files =
        ["cob/ipa-apartment", "cob/ipa-production-plant", "jsk/eng2-2f-0.05", "jsk/eng2-3f-0.05", "jsk/eng2-7f-0.05"];
    let more = [
        "jsk/eng2-8f-0.05",
        "mit/building_31",
        "utexas_gdc/1n",
        "utexas_gdc/2",
        "utexas_gdc/3",
        "willow/willow-full-0.05",
    ];
    let plan = |name: &&str| {
        let plan = FloorPlan::load(&folder.join(format!("{name}.yaml"))).expect("a map");
        ((*name).to_owned(), plan)
    };
    Some(files.iter().chain(&more).map(plan).collect())
}

#[test]
fn walls_of_generated_buildings_are_within_those_of_real_floors() {
    let Some(maps) = maps() else { return };
    let bare = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..GeneratorConfig::default() };
    let measured = |sites: &mut dyn Iterator<Item = Site>| {
        let mut walls = Walls::default();
        sites.for_each(|site| walls.add(&site));
        walls.told()
    };
    let seeds = 0..8;
    let real: Vec<(String, Vec<(&str, f64)>)> = maps
        .iter()
        .map(|(name, plan)| (name.clone(), measured(&mut seeds.clone().filter_map(|seed| plan.site(&bare, seed)))))
        .collect();
    // Things are in the walls of a floor plan that a lidar drew.
    let built = GeneratorConfig { people: 0.0, ..GeneratorConfig::of_buildings() };
    let built = measured(&mut (0..80).map(|seed| generate(&built, seed)));
    let mut outside = Vec::new();
    for (row, (what, value)) in built.iter().enumerate() {
        let of_real = real.iter().map(|(_, told)| told[row].1);
        let [least, most] = [of_real.clone().fold(f64::INFINITY, f64::min), of_real.fold(0.0, f64::max)];
        println!("{what:28} {value:8.3}, real floors {least:.3} to {most:.3}");
        if !(least..=most).contains(value) {
            outside.push(*what);
        }
    }
    assert!(outside.is_empty(), "not as on any real floor: {outside:?}");
}
