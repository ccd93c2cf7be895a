//! The importer of CARMEN logs, packed ones among them; what it writes must be read back.
#![no_main]

use guidedog_fuzz::{file, out};
use libfuzzer_sys::fuzz_target;
use recording::carmen::{ImportOptions, import};

fuzz_target!(|input: &[u8]| {
    let log = file("l.log", input);
    for allow_truncated in [false, true] {
        let out = out();
        if import(&log, &out, ImportOptions { allow_truncated, ..ImportOptions::default() }).is_ok() {
            let records = recording::Reader::open(&out).expect("what was written opens");
            assert!(records.count() > 0, "an import holds something");
            for record in recording::Reader::open(&out).expect("and again") {
                record.expect("what was written is read back");
            }
        }
    }
});
