//! `nova listen` on recordings, servers, serial ports and a terminal; and `nova simulate`, which
//! serves it.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use nova_hal_sim::{BoardConfig, Motion, SimConfig, SimTime, Simulation};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_wire::{
    CommandDecoder, CommandEvent, Encoder, MAX_FRAME_LEN, Record, Setting, SettingValue,
};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};

const DISTANCE_M: f64 = 5.0;

/// What a simulated anchor beside a tag sends within two seconds.
fn stream() -> Vec<u8> {
    let mut sim = Simulation::new(SimConfig::default());
    let board = |x| BoardConfig {
        motion: Motion::fixed([x, 0.0, 0.0]),
        ..BoardConfig::default()
    };
    let tag = NodeConfig::tag(Address(2));
    nova_cli::sim_node::add(&mut sim, board(DISTANCE_M), tag).unwrap();
    let anchor = NodeConfig::anchor(Address(1));
    let anchor = nova_cli::sim_node::add(&mut sim, board(0.0), anchor).unwrap();
    sim.run_until(SimTime::from_s_f64(2.5)).unwrap();
    let chunks = sim.uart(anchor);
    chunks.into_iter().flat_map(|chunk| chunk.bytes).collect()
}

/// Damage: garbage before, a frame overwritten in the middle, the last frame cut.
fn damaged(stream: &[u8]) -> Vec<u8> {
    let mut bytes = b"no frame at all \xFF\xFE\0".to_vec();
    bytes.extend(stream);
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    bytes.truncate(bytes.len() - 3);
    bytes
}

fn ranges(lines: &[Value]) -> Vec<f64> {
    (lines.iter())
        .filter_map(|line| line["range"]["raw_m"].as_f64())
        .collect()
}

fn check_ranges(ranges_m: &[f64]) {
    assert!(ranges_m.len() > 100, "{}", ranges_m.len());
    for range_m in ranges_m {
        assert!((range_m - DISTANCE_M).abs() < 0.2, "{range_m}");
    }
}

#[test]
fn a_recording_gives_a_line_a_record_the_node_and_the_counts() {
    let nova = Nova::new();
    nova.file("anchor.bin", stream());
    let said = nova.run(&["listen", "anchor.bin", "--json"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let lines = said.json();
    check_ranges(&ranges(&lines));
    assert!(
        lines
            .iter()
            .all(|line| line["node"] == 1 && line["arrival_s"].is_null())
    );
    let end = &lines.last().unwrap()["end"];
    assert_eq!(end["records"], lines.len() - 1);
    assert_eq!((&end["lost"], &end["corrupt"]), (&0.into(), &0.into()));
    // But for the node it is what the decoder prints.
    let decoded = nova.run(&["decode", "anchor.bin"]).json();
    assert_eq!(decoded.len(), lines.len());
    assert_eq!(decoded[1]["range"], lines[1]["range"]);
}

#[test]
fn csv_has_a_column_for_everything_and_a_line_for_each_range() {
    let nova = Nova::new();
    nova.file("anchor.bin", stream());
    let said = nova.run(&["listen", "anchor.bin", "--csv"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let mut reader = csv::Reader::from_reader(said.out.as_bytes());
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let number = |row: &csv::StringRecord, name: &str| row[column(name)].parse::<f64>().unwrap();
    check_ranges(
        &rows
            .iter()
            .map(|row| number(row, "raw_m"))
            .collect::<Vec<_>>(),
    );
    for row in &rows {
        assert_eq!(number(row, "node"), 1.0);
        assert_eq!(number(row, "peer"), 2.0);
        assert!(number(row, "t_s") < 2.5);
    }
}

#[test]
fn damage_is_counted_and_the_rest_is_read() {
    let nova = Nova::new();
    nova.file("anchor.bin", damaged(&stream()));
    let whole = nova.run(&["listen", "anchor.bin", "--json"]);
    assert_eq!(whole.code, 0, "{}", whole.err);
    let lines = whole.json();
    check_ranges(&ranges(&lines));
    let end = &lines.last().unwrap()["end"];
    // The garbage, the damaged frame, and the one that was cut off.
    assert_eq!(end["corrupt"], 3);
    assert_eq!(end["lost"], 1);
    let text = nova.run(&["listen", "anchor.bin"]);
    assert!(text.out.contains("a damaged frame"), "{}", text.out);
    assert!(text.out.contains("0x0001 started in network 0xDECA"));
    assert!(text.out.ends_with("bytes\n"), "{}", text.out);
}

#[test]
fn what_is_no_boards_stream_is_refused() {
    let nova = Nova::new();
    nova.file("text", "just some text\n");
    let said = nova.run(&["listen", "text"]);
    assert_eq!(said.code, 2);
    assert!(
        said.err.contains("text: no frame in 15 bytes"),
        "{}",
        said.err
    );
    for (arguments, mention) in [
        (vec!["listen", "nowhere"], "nowhere: cannot be read"),
        (vec!["listen", "/dev/ttyNOVA9"], "cannot be opened"),
        (vec!["listen", "text", "text", "--record", "x"], "--record"),
        (vec!["listen", "text", "--record", "text"], "exists already"),
        (vec!["listen", "text", "--duration", "0"], "--duration"),
        (vec!["listen", "text", "--json", "--csv"], "--csv"),
    ] {
        let said = nova.run(&arguments);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        assert!(said.err.contains(mention), "{}", said.err);
    }
    assert_eq!(nova.files(), ["text"]);
}

/// Runs `nova` with standard input and output held by the test.
fn start(nova: &Nova, arguments: &[&str]) -> std::process::Child {
    Command::new(env!("CARGO_BIN_EXE_nova"))
        .args(arguments)
        .current_dir(nova.folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn standard_input_is_heard_to_its_end_and_recorded() {
    let nova = Nova::new();
    let stream = damaged(&stream());
    let mut child = start(&nova, &["listen", "-", "--json", "--record", "kept.bin"]);
    child.stdin.take().unwrap().write_all(&stream).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<Value> = (text.lines())
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    check_ranges(&ranges(&lines));
    // It is live: the host's clock is told.
    assert!(lines[1]["arrival_s"].as_f64().unwrap() > 1.7e9);
    let kept = std::fs::read(nova.folder.path().join("kept.bin")).unwrap();
    assert!(kept == stream, "{} bytes of {}", kept.len(), stream.len());
}

/// Reads until a board at this end has been asked for its settings.
fn asked_for_settings(host: &mut impl Read) {
    let mut decoder = CommandDecoder::new();
    let mut byte = [0; 1];
    loop {
        host.read_exact(&mut byte).unwrap();
        if let Some(CommandEvent::Record { record, .. }) = decoder.push(byte[0])
            && record == nova_wire::Command::Get
        {
            return;
        }
    }
}

#[test]
fn a_board_is_asked_for_its_settings_so_that_the_recording_holds_what_it_answers() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = format!("tcp://{}", listener.local_addr().unwrap());
    let nova = Nova::new();
    let mut sent = stream();
    let server = std::thread::spawn(move || {
        let (mut board, _) = listener.accept().unwrap();
        asked_for_settings(&mut board);
        let told = Record::Setting(SettingValue {
            setting: Setting::TxAntennaDelay.number(),
            value: nova_wire::Value::Number(16_400),
            set: false,
        });
        let mut frame = [0; MAX_FRAME_LEN];
        sent.extend(Encoder::new().encode(&told, &mut frame).unwrap());
        board.write_all(&sent).unwrap();
        sent
    });
    nova.run(&["listen", &place, "--no-reconnect", "--record", "kept.bin"]);
    let sent = server.join().unwrap();
    let kept = std::fs::read(nova.folder.path().join("kept.bin")).unwrap();
    assert!(kept == sent, "{} bytes of {}", kept.len(), sent.len());
}

#[test]
fn a_server_that_comes_back_is_heard_again_and_every_byte_is_recorded() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = format!("tcp://{}", listener.local_addr().unwrap());
    let nova = Nova::new();
    let stream = stream();
    let (first, second) = stream.split_at(stream.len() / 2);
    nova.file("whole.bin", &stream);
    let whole = nova.run(&["listen", "whole.bin"]).out;
    // Behind it stands the summary.
    let last_record = whole.lines().rev().nth(1).unwrap();
    let mut child = start(&nova, &["listen", &place, "--record", "kept.bin"]);
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut wait_for = |mention: &str| {
        let found = lines
            .by_ref()
            .map(Result::unwrap)
            .find(|line| line.contains(mention));
        assert!(found.is_some(), "the end came before '{mention}'");
    };
    {
        let (mut board, _) = listener.accept().unwrap();
        // What is left unread when it goes would take the last bytes with it.
        asked_for_settings(&mut board);
        board.write_all(first).unwrap();
        wait_for("m to 0x0002");
    }
    wait_for("lost, trying again");
    let (mut board, _) = listener.accept().unwrap();
    wait_for("heard again");
    // It may be another board now, or set up in another way.
    asked_for_settings(&mut board);
    board.write_all(second).unwrap();
    wait_for(last_record);
    drop(board);
    wait_for("lost, trying again");
    child.kill().unwrap();
    child.wait().unwrap();
    let kept = std::fs::read(nova.folder.path().join("kept.bin")).unwrap();
    assert!(kept == stream, "{} bytes of {}", kept.len(), stream.len());
}

#[cfg(unix)]
#[test]
fn a_serial_port_is_heard() {
    use serialport::SerialPort;
    let (mut board, host) = serialport::TTYPort::pair().unwrap();
    let name = host.name().unwrap();
    drop(host);
    let nova = Nova::new();
    let mut child = start(
        &nova,
        &[
            "listen",
            &name,
            "--json",
            "--no-reconnect",
            "--record",
            "kept",
        ],
    );
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let stream = stream();
    // Until the port is open on the other side its echo would come back; its end of the line is
    // taken up by the first frame that is heard.
    let mut written = 0;
    let mut heard = 0;
    std::thread::scope(|scope| {
        let feeder = scope.spawn(|| {
            for chunk in stream.chunks(256) {
                board.write_all(chunk).unwrap();
                written += chunk.len();
            }
        });
        for line in lines.by_ref() {
            let line: Value = serde_json::from_str(&line.unwrap()).unwrap();
            assert!(line.get("trouble").is_none(), "{line}");
            heard += usize::from(line.get("range").is_some());
            if line["status"]["t_us"]
                .as_u64()
                .is_some_and(|t| t >= 2_000_000)
            {
                break;
            }
        }
        feeder.join().unwrap();
    });
    assert!(heard > 100, "{heard}");
    assert_eq!(written, stream.len());
    child.kill().unwrap();
    child.wait().unwrap();
}

/// A terminal of its own for the command: what it draws, and what it leaves behind.
#[cfg(unix)]
mod terminal {
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{Winsize, tcgetattr, tcsetwinsize};
    use std::fs::File;

    /// Reads from the terminal until the text has been drawn.
    fn wait_for(screen: &mut impl Read, text: &str) -> String {
        let mut drawn = Vec::new();
        let mut chunk = [0; 4096];
        loop {
            let count = screen.read(&mut chunk).unwrap();
            drawn.extend(&chunk[..count]);
            let so_far = String::from_utf8_lossy(&drawn);
            if so_far.contains(text) {
                return so_far.into_owned();
            }
        }
    }

    #[test]
    fn the_table_is_drawn_and_q_leaves_the_terminal_as_it_was() {
        for key in [&b"q"[..], &b"\x03"[..]] {
            let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
            grantpt(&master).unwrap();
            unlockpt(&master).unwrap();
            let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
            let slave = File::options().read(true).write(true).open(&name).unwrap();
            tcsetwinsize(
                &slave,
                Winsize {
                    ws_row: 24,
                    ws_col: 100,
                    ws_xpixel: 0,
                    ws_ypixel: 0,
                },
            )
            .unwrap();
            let before = format!("{:?}", tcgetattr(&slave).unwrap());

            let nova = Nova::new();
            nova.file("anchor.bin", stream());
            let mut child = Command::new(env!("CARGO_BIN_EXE_nova"))
                .args(["listen", "anchor.bin"])
                .current_dir(nova.folder.path())
                .env("TERM", "xterm-256color")
                .stdin(slave.try_clone().unwrap())
                .stdout(slave.try_clone().unwrap())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut screen = File::from(master);
            let drawn = wait_for(&mut screen, "ended");
            // The other screen, and on it the table.
            assert!(drawn.contains("\x1b[?1049h"), "{drawn:?}");
            assert!(drawn.contains("0x0002"), "{drawn:?}");
            let during = format!("{:?}", tcgetattr(&slave).unwrap());
            assert_ne!(during, before, "keys would wait for a line's end");
            screen.write_all(key).unwrap();
            let rest = wait_for(&mut screen, "bytes");
            assert!(
                rest.contains("\x1b[?1049l") && rest.contains("\x1b[?25h"),
                "{rest:?}"
            );
            assert!(child.wait().unwrap().success());
            let after = format!("{:?}", tcgetattr(&slave).unwrap());
            assert_eq!(after, before);
        }
    }
}

#[test]
fn simulated_boards_can_be_listened_to() {
    let nova = Nova::new();
    let mut boards = start(
        &nova,
        &["simulate", "--serve", "tcp://127.0.0.1:0", "--json"],
    );
    let mut lines = BufReader::new(boards.stdout.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    assert_eq!(
        (&first["address"], &first["role"]),
        (&1.into(), &"anchor".into())
    );
    let place = first["found_at"][0].as_str().unwrap();
    let mut anchor = TcpStream::connect(place.strip_prefix("tcp://").unwrap()).unwrap();
    let mut decoder = nova_wire::Decoder::new();
    let mut chunk = [0; 4096];
    let mut peers = std::collections::BTreeSet::new();
    // Until all three tags were found, in real time.
    while peers.len() < 3 {
        let count = anchor.read(&mut chunk).unwrap();
        assert!(count > 0);
        for event in chunk[..count].iter().filter_map(|&b| decoder.push(b)) {
            if let nova_wire::Event::Record {
                record: nova_wire::Record::Range(range),
                ..
            } = event
            {
                peers.insert(range.peer);
            }
        }
    }
    boards.kill().unwrap();
    boards.wait().unwrap();
}

#[cfg(unix)]
#[test]
fn simulated_boards_have_serial_ports() {
    let nova = Nova::new();
    let mut boards = start(
        &nova,
        &[
            "simulate",
            "--pty",
            "--json",
            "--board",
            "anchor@0,0,0",
            "--board",
            "tag@3,0,0",
        ],
    );
    let mut lines = BufReader::new(boards.stdout.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    let port = first["found_at"][0].as_str().unwrap();
    let mut listening = start(&nova, &["listen", port, "--csv", "--no-reconnect"]);
    let mut heard = BufReader::new(listening.stdout.take().unwrap()).lines();
    assert!(heard.next().unwrap().unwrap().starts_with("t_s,node,peer"));
    let range = heard.next().unwrap().unwrap();
    let raw_m: f64 = range.split(',').nth(4).unwrap().parse().unwrap();
    assert!((raw_m - 3.0).abs() < 0.2, "{range}");
    for child in [&mut listening, &mut boards] {
        child.kill().unwrap();
        child.wait().unwrap();
    }
}

#[test]
fn simulated_boards_are_recorded_without_waiting_and_the_same_each_time() {
    let nova = Nova::new();
    let simulate = |folder: &str| {
        let said = nova.run(&[
            "simulate",
            "--capture",
            folder,
            "--duration",
            "2",
            "--seed",
            "3",
        ]);
        assert_eq!(said.code, 0, "{}", said.err);
        assert_eq!(said.out.lines().count(), 4);
        std::fs::read(nova.folder.path().join(folder).join("0x0001.bin")).unwrap()
    };
    let once = simulate("once");
    assert!(once.len() > 1_000);
    assert!(once == simulate("twice"));
    let said = nova.run(&["listen", "once/0x0001.bin", "--json"]);
    assert_eq!(said.code, 0, "{}", said.err);
}

#[test]
fn simulations_that_nobody_could_hear_are_refused() {
    let nova = Nova::new();
    for (arguments, mention) in [
        (vec!["simulate"], "--serve"),
        (vec!["simulate", "--capture", "x"], "--duration"),
        (
            vec!["simulate", "--pty", "--board", "cat@0,0,0"],
            "neither anchor nor tag",
        ),
        (
            vec!["simulate", "--pty", "--board", "tag@0,0"],
            "ROLE@X,Y,Z",
        ),
        (vec!["simulate", "--serve", "127.0.0.1:1"], "tcp://"),
        (
            vec!["simulate", "--pty", "--antenna-sigma", "-1"],
            "--antenna-sigma",
        ),
    ] {
        let said = nova.run(&arguments);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        assert!(said.err.contains(mention), "{}", said.err);
    }
    assert!(nova.files().is_empty());
}
