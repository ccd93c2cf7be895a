//! The importer of RPLIDAR captures; what it writes must be read back.
#![no_main]

use guidedog_fuzz::{file, out};
use libfuzzer_sys::fuzz_target;
use recording::rplidar::{ImportOptions, import};

fuzz_target!(|input: &[u8]| {
    let capture = file("c.bin", input);
    let (out, existing) = (out(), recording::Existing::Refuse);
    let options = ImportOptions { existing, field_of_view_rad: 3.5 };
    if import(&[capture.clone(), capture], &out, options).is_ok() {
        for record in recording::Reader::open(&out).expect("what was written opens") {
            record.expect("what was written is read back");
        }
    }
});
