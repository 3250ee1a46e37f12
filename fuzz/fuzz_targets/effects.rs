#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| { gaware_fuzz::targets::files::effects(data); });
