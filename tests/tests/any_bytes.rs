//! Bytes from anywhere, a bounded number of them: the same promises that
//! `fuzz/` looks for exceptions to for as long as one lets it.
#![allow(clippy::unwrap_used)]

use nova_tests::fuzz;
use nova_wire::settings::{COUNT, MAX_ADDRESSES};
use nova_wire::{Change, Changes, Command, Value};
use proptest::prelude::*;

/// Mostly small bytes: numbers of records, settings, choices and lengths.
fn any_bytes(most: usize) -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![3 => 0_u8..10, 1 => any::<u8>()];
    prop::collection::vec(byte, 0..most)
}

fn any_value() -> impl Strategy<Value = Value> {
    let number = prop_oneof![0_u32..3, 150_u32..40_000, any::<u32>()];
    prop_oneof![
        4 => number.prop_map(Value::Number),
        1 => prop::collection::vec(any::<u16>(), 0..=MAX_ADDRESSES)
            .prop_map(|list| Value::Addresses(nova_wire::settings::Addresses::new(&list).unwrap())),
    ]
}

fn any_changes() -> impl Strategy<Value = Changes> {
    let change = (0..COUNT as u8 + 2, prop::option::weighted(0.9, any_value()));
    prop::collection::vec(change, 0..6).prop_map(|changes| {
        (changes.into_iter())
            .map(|(setting, value)| Change { setting, value })
            .collect()
    })
}

fn content(sequence: u16, command: &Command) -> Vec<u8> {
    postcard::to_stdvec(&(sequence, command)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_stream_from_a_board_may_hold_anything(bytes in any_bytes(300)) {
        fuzz::wire_decoder(&bytes);
    }

    #[test]
    fn a_frame_from_the_air_may_hold_anything(bytes in any_bytes(130)) {
        fuzz::air_frame(&bytes);
    }

    #[test]
    fn a_stream_from_a_host_may_hold_anything(bytes in any_bytes(160)) {
        fuzz::command_handler(&bytes);
    }

    #[test]
    fn a_command_may_hold_anything(sequence: u16, changes in any_changes(), reset: bool) {
        let command = if reset { Command::Reset } else { Command::Set(changes) };
        fuzz::command_handler(&content(sequence, &command));
    }

    #[test]
    fn an_image_may_hold_anything(bytes in any_bytes(200), changes in any_changes()) {
        fuzz::settings_image(&bytes);
        let version = nova_node::store::IMAGE_VERSION;
        fuzz::settings_image(&postcard::to_stdvec(&(version, changes)).unwrap());
    }
}
