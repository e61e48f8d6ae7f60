//! An image of settings from flash.
#![no_main]

#[path = "../../tests/src/fuzz.rs"]
#[allow(dead_code)] // Each target uses one.
mod fuzz;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::settings_image(bytes));
