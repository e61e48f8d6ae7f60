//! `nova deliver --record` and `nova replay`.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::Nova;

const SHORT: &str = "height_m = 12.0\nradius_m = 2.0\ndistance_m = 20.0\nreturn_trip = false\n";

#[test]
fn a_recorded_delivery_is_replayed_to_the_bytes_that_it_recorded() {
    let nova = Nova::new();
    nova.file("short.toml", SHORT);
    let fly = ["deliver", "--scenario", "short.toml"];
    let plain = nova.run(&fly);
    let told = nova.run(&[&fly[..], &["--record", "flight.mcap"]].concat());
    assert_eq!(told.code, 0, "{}", told.err);
    assert_eq!(told.out, plain.out, "recording changes nothing");
    let file = std::fs::read(nova.folder.path().join("flight.mcap")).unwrap();
    let mut recorded = Vec::new();
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        if message.channel.topic == "/estimate" {
            recorded.extend_from_slice(&message.data);
            recorded.push(b'\n');
        }
    }
    assert!(!recorded.is_empty());
    let said = nova.run(&["replay", "flight.mcap"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(said.out.as_bytes() == recorded);
}

#[test]
fn what_cannot_be_replayed_is_the_inputs_fault_and_says_where() {
    let nova = Nova::new();
    let missing = nova.run(&["replay", "none.mcap"]);
    assert_eq!((missing.code, missing.out.as_str()), (2, ""));
    assert!(missing.err.contains("none.mcap"), "{}", missing.err);
    nova.file("text.mcap", "no recording");
    let text = nova.run(&["replay", "text.mcap"]);
    assert_eq!((text.code, text.out.as_str()), (2, ""));
    assert!(text.err.contains("text.mcap"), "{}", text.err);
}

#[test]
fn a_recording_that_cannot_be_written_leaves_nothing() {
    let nova = Nova::new();
    nova.file("short.toml", SHORT);
    let said = nova.run(&[
        "deliver",
        "--scenario",
        "short.toml",
        "--record",
        "no/such/folder.mcap",
    ]);
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(said.err.contains("cannot be written"), "{}", said.err);
    assert!(!nova.folder.path().join("no").exists());
}
