//! The map reader: a map_server YAML, and the image `m` beside it.
#![no_main]

use guidedog_fuzz::{BORDER, file};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let border = input.iter().position(|byte| *byte == BORDER).unwrap_or(input.len());
    let yaml = file("m.yaml", &input[..border]);
    let _ = file("m", input.get(border + 1..).unwrap_or_default());
    if let Ok(map) = world::GridMap::load(&yaml) {
        let (columns, rows) = map.size();
        let _ = map.cell(columns as i64, rows as i64);
        let _ = map.clearance(map.middle(0, 0), 1.0);
    }
});
