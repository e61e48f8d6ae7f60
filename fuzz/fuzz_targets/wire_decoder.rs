//! A stream of bytes from a board.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| nova_tests::fuzz::wire_decoder(bytes));
