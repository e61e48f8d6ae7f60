//! A frame from the air.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| nova_tests::fuzz::air_frame(bytes));
