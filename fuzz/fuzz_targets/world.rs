//! World files, scenarios and routes.
#![no_main]

use guidedog_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let path = file("w.toml", input);
    let _ = world::World::load(&path);
    let _ = world::Route::load(&path);
    let _ = world::Scenario::load(&path);
});
