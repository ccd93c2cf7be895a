//! The configuration: an operator's file on top of the defaults. One that is taken can be written and read again.
#![no_main]

use guidedog_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let path = file("c.toml", input);
    for profile in [settings::Profile::Walk, settings::Profile::Carmen] {
        match settings::load(profile, Some(&path)) {
            Ok(taken) => {
                let _ = taken.interaction();
                let resolved = file("r.toml", supervisor_text(&taken).as_bytes());
                assert_eq!(settings::load_resolved(&resolved).expect("what was resolved is read"), taken);
            }
            Err(error) => assert!(error.to_string().contains("c.toml"), "{error} names the file"),
        }
    }
});

fn supervisor_text(taken: &settings::Settings) -> String {
    toml::to_string(taken).expect("what was read can be written")
}
