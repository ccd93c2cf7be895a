//! Quick
use guidedog_episodes::*;
use std::sync::Arc;
use std::time::Instant;
fn main() {
    let arg = std::env::args().nth(1).unwrap_or_default();
    let mut config = Config::default();
    if arg.contains("ideal") {
        config.noise = Noise::Ideal;
    }
    if arg.contains("nomem") {
        config.memory = None;
    }
    if arg.contains("nodepth") {
        config.depth = None;
    }
    if arg.contains("nominal") {
        config.handlers = Handlers::Nominal;
    }
    let config = Arc::new(config);
    let mut e = Episode::new(config.clone()).unwrap();
    let n = 300;
    let (mut t_begin, mut t_step) = (0.0, 0.0);
    let (mut hits, mut safe_hits, mut first_safe, mut eps_hit, mut robot_safe) = (0, 0, 0, 0, 0);
    let mut rng = 12345u64;
    for seed in 0..n {
        let t = Instant::now();
        e.begin(seed);
        t_begin += t.elapsed().as_secs_f64();
        let mut before = 0;
        let mut had = false;
        let mut robot_before = 0;
        for k in 0..100 {
            rng = rng.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let r = (rng >> 33) as usize;
            let want = if r % 10 < 7 { 1 } else { r / 10 % 8 };
            let mask = e.unsafe_mask();
            let order = [want, 1, 6, 7, 2, 3, 4, 5, 0];
            let a = *order.iter().find(|a| mask >> **a & 1 == 0).unwrap_or(&0);
            let safe = mask >> a & 1 == 0;
            let t = Instant::now();
            e.step(a);
            t_step += t.elapsed().as_secs_f64();
            let rep = e.report();
            if rep.collisions > before {
                hits += 1;
                if safe {
                    safe_hits += 1;
                    if rep.robot_collisions > robot_before {
                        robot_safe += 1;
                    }
                    if !had {
                        first_safe += 1;
                        if arg.contains("print") {
                            let w = &e.site().world;
                            let h = e.team().world_from_handler();
                            let r = e.team().world_from_robot();
                            let kind = |p: guidance::se2::Point| {
                                let mut best = (9.0, String::new());
                                for pr in w.prisms() {
                                    for (a, b) in pr.sides() {
                                        let ab = b - a;
                                        let t = ((p - a).dot(&ab) / ab.norm_squared()).clamp(0.0, 1.0);
                                        let d = (p - (a + ab * t)).norm();
                                        if d < best.0 {
                                            best = (
                                                d,
                                                format!(
                                                    "solid {} z {:.2}..{:.2} {:?}",
                                                    pr.solid, pr.z0_m, pr.z1_m, pr.seen_by
                                                ),
                                            );
                                        }
                                    }
                                }
                                best
                            };
                            let est = e.handler_estimate();
                            let truth = r.inverse() * h;
                            println!(
                                "seed {seed} step {k} action {a} robot {} handler {} mask {mask:b} near robot {:?} near handler {:?} walkers {} est ({:.3},{:.3}) truth ({:.3},{:.3})",
                                rep.robot_collisions,
                                rep.handler_collisions,
                                kind(guidance::se2::Point::from(r.translation.vector)),
                                kind(guidance::se2::Point::from(h.translation.vector)),
                                w.people().len(),
                                est.translation.x,
                                est.translation.y,
                                truth.translation.x,
                                truth.translation.y
                            );
                        }
                    }
                }
                had = true;
            }
            before = rep.collisions;
            robot_before = rep.robot_collisions;
        }
        eps_hit += usize::from(had);
    }
    println!(
        "{arg}: begin {:.1} us step {:.1} us; hits {hits} of these safe {safe_hits} (robot {robot_safe}), episodes hit {eps_hit}, first by safe {first_safe} of {n}",
        t_begin * 1e6 / n as f64,
        t_step * 1e6 / (100.0 * n as f64)
    );
}
