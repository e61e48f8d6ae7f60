//! A stream of bytes from a host, at a node.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| nova_tests::fuzz::command_handler(bytes));
