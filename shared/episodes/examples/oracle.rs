//! Oracle: follows the travel line.
use guidance::se2::*;
use guidedog_episodes::*;
use std::sync::Arc;
fn main() {
    let arg = std::env::args().nth(1).unwrap_or_default();
    let mut config = Config::default();
    if arg.contains("ideal") {
        config.noise = Noise::Ideal;
    }
    if arg.contains("nominal") {
        config.handlers = Handlers::Nominal;
    }
    if arg.contains("empty") {
        config.places =
            Places::Generated(world::GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..Default::default() });
    }
    config.frames = 0;
    let config = Arc::new(config);
    let mut e = Episode::new(config.clone()).unwrap();
    let n = 500;
    let mut sums = std::collections::BTreeMap::<String, (f64, f64)>::new();
    for seed in 0..n {
        e.begin(part_seed(77, seed));
        let task = e.task().clone();
        for _ in 0..100 {
            let a = e.taught();
            if arg.contains("trace5") && seed == 5 {
                let l = &task.line;
                let rb = e.team().world_from_robot();
                let rf = l.foot(Point::from(rb.translation.vector));
                println!(
                    "way {:.2} left {:.2} err {:.2} action {a} mask {:b} worths {:?}",
                    rf.way_m,
                    rf.left_m,
                    l.heading_error_rad(rf.way_m + 0.5, rb.rotation.angle()),
                    e.unsafe_mask(),
                    e.worths()
                );
            }
            e.step(a);
        }
        let r = e.report();
        if arg.contains("debug") && !r.success && !r.to_stand && seed < 40 {
            let h = e.team().world_from_handler();
            let l = &task.line;
            let f = l.foot(Point::from(h.translation.vector));
            let rb = e.team().world_from_robot();
            let rf = l.foot(Point::from(rb.translation.vector));
            println!(
                "{seed} {:?} line {:.1} handler way {:.1} left {:.2} err {:.2} robot way {:.1} left {:.2} err {:.2} mask {:b} goal {:?}",
                r.cue,
                l.length_m(),
                f.way_m,
                f.left_m,
                l.heading_error_rad(f.way_m, h.rotation.angle()),
                rf.way_m,
                rf.left_m,
                l.heading_error_rad(rf.way_m, rb.rotation.angle()),
                e.unsafe_mask(),
                match &task.goal {
                    Goal::Into(o) =>
                        format!("{:?}", o.iter().map(|o| (o.way_m, o.width_m, o.line.length_m())).collect::<Vec<_>>()),
                    g => format!("{g:?}"),
                }
            );
        }
        let mut add = |key: String, v: f64| {
            let s = sums.entry(key).or_default();
            s.0 += v;
            s.1 += 1.0;
        };
        add(format!("success {:?} stand {}", r.cue, r.to_stand), f64::from(u8::from(r.success)));
        add("cf".into(), f64::from(u8::from(r.collisions == 0)));
        add("coll".into(), f64::from(r.collisions));
        add("distance".into(), r.distance_m);
        add("all_unsafe".into(), f64::from(r.all_unsafe));
        if !r.success && arg.contains("print") {
            println!("{seed} {r:?}");
        }
    }
    for (k, (s, n)) in sums {
        println!("{k}: {:.3} n {n}", s / n);
    }
}
