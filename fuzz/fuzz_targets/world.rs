//! World files, scenarios and routes; worlds of Gazebo, and tracks of pedestrians.
#![no_main]

use guidedog_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let path = file("w.toml", input);
    let _ = world::World::load(&path);
    let _ = world::Route::load(&path);
    let _ = world::Scenario::load(&path);
    if let Ok(text) = std::str::from_utf8(input) {
        let _ = world::sdf::parse("w.world", text);
        let _ = world::Tracks::parse("t.csv", text);
    }
});
