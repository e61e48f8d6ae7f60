//! `nova bridge` between a board behind TCP and an autopilot behind UDP.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::Nova;
use nova_wire::{Encoder, MAX_FRAME_LEN, Range, Record};
use std::fs::File;
use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::process::{Command, Stdio};
use std::time::Duration;

/// MAVLink numbers of messages.
const HEARTBEAT: u32 = 0;
const DISTANCE_SENSOR: u32 = 132;

/// A MAVLink 2 frame taken apart by hand: message, sender, payload.
fn apart(frame: &[u8]) -> (u32, [u8; 2], &[u8]) {
    assert_eq!(frame[0], 0xFD, "not MAVLink 2: {frame:?}");
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    (
        id,
        [frame[5], frame[6]],
        &frame[10..10 + usize::from(frame[1])],
    )
}

#[test]
fn every_range_of_a_board_becomes_a_distance_and_the_end_is_told() {
    let nova = Nova::new();
    let board = TcpListener::bind("127.0.0.1:0").unwrap();
    let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
    autopilot
        .set_read_timeout(Some(Duration::from_secs(30)))
        .unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_nova"))
        .args(["bridge", "--json", "--system", "9", "--record"])
        .arg(nova.folder.path().join("flight.mcap"))
        .args(["--board", &format!("tcp://{}", board.local_addr().unwrap())])
        .args([
            "--mavlink",
            &format!("udp:{}", autopilot.local_addr().unwrap()),
        ])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut line, _) = board.accept().unwrap();
    let next = |wanted: u32| loop {
        let mut bytes = [0; 300];
        let count = autopilot.recv(&mut bytes).unwrap();
        let (id, sender, payload) = apart(&bytes[..count]);
        assert_eq!(sender, [9, 191]);
        if id == wanted {
            return payload.to_vec();
        }
    };
    assert_eq!(next(HEARTBEAT)[4], 18, "an onboard controller");
    let mut encoder = Encoder::new();
    for k in 0..20u16 {
        let range = Record::Range(Range {
            t_us: 1_000_000 + 100_000 * u64::from(k),
            peer: 7,
            raw_m: 1.0 + f32::from(k),
            ..Range::default()
        });
        let bytes = encoder
            .encode(&range, &mut [0; MAX_FRAME_LEN])
            .unwrap()
            .to_vec();
        line.write_all(&bytes).unwrap();
        let payload = next(DISTANCE_SENSOR);
        // Little-endian centimetres behind time, least and most.
        assert_eq!(u16::from_le_bytes([payload[8], payload[9]]), 100 + 100 * k);
        assert_eq!(
            payload[12], 100,
            "no direction that could be taken for a height"
        );
    }
    // Ctrl-C, as a user would.
    #[cfg(unix)]
    {
        let pid = rustix::process::Pid::from_child(&child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        let said = child.wait_with_output().unwrap();
        let out = String::from_utf8(said.stdout).unwrap();
        let end: serde_json::Value = serde_json::from_str(out.lines().last().unwrap()).unwrap();
        println!("{end}");
        let end = &end["end"];
        assert!(said.status.success());
        assert_eq!(end["sent"]["distance_sensor"]["sent"], 20);
        assert_eq!(end["nodes"][0]["unpaired"], 20);
        assert!(end["autopilot"].is_null());
        assert!(end["latency"]["p99_ms"].as_f64().unwrap() > 0.0);
        assert_eq!(end["lines_dropped"], 0);
        let recording = std::fs::read(nova.folder.path().join("flight.mcap")).unwrap();
        let messages = mcap::MessageStream::new(&recording).unwrap();
        let ranges = messages.filter(|message| message.as_ref().unwrap().channel.topic == "/range");
        assert_eq!(ranges.count(), 20);
        let replayed = nova.run(&["replay", "flight.mcap"]);
        // No place of the vehicle was ever told.
        assert_eq!(
            (replayed.code, replayed.out.as_str()),
            (0, ""),
            "{}",
            replayed.err
        );
    }
}

#[test]
fn what_cannot_be_used_is_told_with_what_would_be() {
    let nova = Nova::new();
    nova.file("anchor.bin", b"x\0");
    for (arguments, mention) in [
        (&["--mavlink", "udp:127.0.0.1"][..], "HOST:PORT"),
        (&["--mavlink", "http://127.0.0.1:1"], "is not known"),
        (
            &["--mavlink", "udp:127.0.0.1:9", "--max-sigma", "0"],
            "--max-sigma must be",
        ),
        (
            &["--mavlink", "udp:127.0.0.1:9", "--rate", "1000"],
            "--rate must be",
        ),
        (
            &["--mavlink", "udp:127.0.0.1:9", "--system", "0"],
            "--system",
        ),
        (&["--mavlink", "udp:127.0.0.1:9", "--readings"], "--json"),
    ] {
        let said = nova.run(&[&["bridge", "--board", "anchor.bin"], arguments].concat());
        assert_eq!(said.code, 2, "{arguments:?}: {}", said.err);
        assert!(said.err.contains(mention), "{arguments:?}: {}", said.err);
    }
}

/// A board's ranges, a thousand a second.
fn capture(ranges: u16) -> Vec<u8> {
    let mut encoder = Encoder::new();
    (0..ranges)
        .flat_map(|k| {
            let range = Record::Range(Range {
                t_us: 1_000_000 + 1_000 * u64::from(k),
                peer: 7,
                raw_m: 5.0,
                ..Range::default()
            });
            let mut frame = [0; MAX_FRAME_LEN];
            encoder.encode(&range, &mut frame).unwrap().to_vec()
        })
        .collect()
}

#[test]
fn a_capture_without_an_autopilot_ends_with_what_was_seen() {
    let nova = Nova::new();
    nova.file("anchor.bin", capture(5));
    let nobody = UdpSocket::bind("127.0.0.1:0").unwrap();
    let place = format!("udp:{}", nobody.local_addr().unwrap());
    let said = nova.run(&["bridge", "--board", "anchor.bin", "--mavlink", &place]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(said.out.contains("none was heard"), "{}", said.out);
    assert!(said.out.contains("5 DISTANCE_SENSOR"), "{}", said.out);
}

#[test]
fn a_recording_that_cannot_be_written_is_told_before_anything_begins() {
    let nova = Nova::new();
    nova.file("anchor.bin", b"x\0");
    let bridge = [
        "bridge",
        "--board",
        "anchor.bin",
        "--mavlink",
        "udp:127.0.0.1:9",
    ];
    let said = nova.run(&[&bridge[..], &["--record", "no/such/folder.mcap"]].concat());
    assert_eq!((said.code, said.out.as_str()), (1, ""), "{}", said.err);
    assert!(
        said.err.contains("no/such/folder.mcap: cannot be written"),
        "{}",
        said.err
    );
}

/// A pipe whose reader has gone, as a disk that is full.
#[test]
#[cfg(unix)]
fn a_recording_that_fails_on_the_way_does_not_end_the_bridge() {
    let nova = Nova::new();
    nova.file("anchor.bin", capture(600));
    let pipe = nova.folder.path().join("flight.mcap");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let reader = std::thread::spawn(move || {
        let mut bytes = vec![0; 20_000];
        File::open(pipe).unwrap().read_exact(&mut bytes).unwrap();
    });
    let nobody = UdpSocket::bind("127.0.0.1:0").unwrap();
    let place = format!("udp:{}", nobody.local_addr().unwrap());
    let bridge = ["bridge", "--board", "anchor.bin", "--mavlink", &place];
    let said = nova.run(&[&bridge[..], &["--record", "flight.mcap"]].concat());
    reader.join().unwrap();
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(said.err.contains("the bridge goes on"), "{}", said.err);
    assert!(said.out.contains("600 DISTANCE_SENSOR"), "{}", said.out);
}
