//! An image of settings from flash.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| nova_tests::fuzz::settings_image(bytes));
