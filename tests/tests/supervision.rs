//! The supervision of a run over thousands of seeded courses of events; see `guidedog_tests::supervision`.

use guidedog_tests::supervision::{Course, run};

/// Seeds of `scripts/test`; `GUIDEDOG_SEEDS=100000` tries more, `GUIDEDOG_SEED=17` repeats one.
const SEEDS: u64 = 10_000;

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok().and_then(|text| text.parse().ok())
}

/// Runs all seeds on two threads: what happened in all of them, or the first that went wrong.
fn run_all(seeds: std::ops::Range<u64>) -> Result<Course, String> {
    let half = |odd: u64| {
        let seeds = seeds.clone();
        move || {
            let mut all = Course::default();
            for seed in seeds.filter(|seed| seed % 2 == odd) {
                for (what, count) in run(seed)?.counts {
                    *all.counts.entry(what).or_default() += count;
                }
            }
            Ok::<_, String>(all)
        }
    };
    let other = std::thread::spawn(half(1));
    let mut all = half(0)()?;
    for (what, count) in other.join().expect("it does not panic")?.counts {
        *all.counts.entry(what).or_default() += count;
    }
    Ok(all)
}

#[test]
fn whatever_happens_the_robot_stands_when_it_must_and_the_run_comes_to_rest() {
    let seeds = match number("GUIDEDOG_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("GUIDEDOG_SEEDS").unwrap_or(SEEDS),
    };
    let count = seeds.end - seeds.start;
    match run_all(seeds) {
        Ok(course) => {
            eprintln!("{count} seeds: {:?}", course.counts);
            // A simulation in which nothing happens would find nothing wrong.
            let least = |what: &str| course.counts.get(what).copied().unwrap_or(0);
            if count >= 1000 {
                assert!(least("deaths") > 5 * count && least("stops") > 5 * count, "{:?}", course.counts);
                assert!(least("ticks walking") > 100 * count, "{:?}", course.counts);
            }
        }
        Err(what) => panic!("{what}\nrepeat it: GUIDEDOG_SEED=N cargo test -p guidedog-tests supervision::"),
    }
}

#[test]
fn a_seed_is_the_same_course_every_time() {
    let twice = [run(3), run(3)].map(|course| course.map(|course| course.counts));
    assert_eq!(twice[0], twice[1]);
}
