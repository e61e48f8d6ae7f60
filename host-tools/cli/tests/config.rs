//! `nova config` and `nova status` with a simulated board that runs the firmware's node.
#![allow(clippy::unwrap_used)]

mod common;
#[path = "common/served.rs"]
mod served;

use common::{Nova, Said};
use nova_hal_sim::Flash;
use nova_wire::{Decoder, Event, Record};
use served::Served;
use std::io::Read;
use std::net::{TcpListener, TcpStream};

fn board() -> Served {
    Served::tcp(&Flash::new(4))
}

fn ok(said: Said) -> Said {
    assert_eq!((said.code, said.err.as_str()), (0, ""), "{}", said.out);
    said
}

fn refused(said: &Said, parts: &[&str]) {
    assert_eq!(said.code, 2, "{}", said.err);
    for part in parts {
        assert!(said.err.contains(part), "{part}: {}", said.err);
    }
    assert_eq!(said.out, "");
}

#[test]
fn settings_are_read_changed_and_taken_back() {
    let (nova, board) = (Nova::new(), board());
    let get = |names: &[&str]| {
        let arguments = [&["config", "get", &board.place], names].concat();
        ok(nova.run(&arguments)).out
    };
    let all = get(&[]);
    assert!(all.contains("address = 0x0202  # default\n"), "{all}");
    assert!(all.contains("part = \"initiator\"  # default\n"), "{all}");
    assert_eq!(all.lines().count(), nova_wire::settings::COUNT);

    let set = [
        "config",
        "set",
        &board.place,
        "pan=0x1234",
        "peers=0x0101,7",
    ];
    assert_eq!(ok(nova.run(&set)).out, "");
    assert_eq!(
        get(&["pan", "peers"]),
        "pan = 0x1234\npeers = [0x0101, 0x0007]\n"
    );
    ok(nova.run(&["config", "set", &board.place, "pan=default"]));
    assert_eq!(get(&["pan"]), "pan = 0xDECA  # default\n");
    ok(nova.run(&["config", "reset", &board.place]));
    assert_eq!(get(&[]), all);
}

#[test]
fn json_has_numbers_and_words() {
    let (nova, board) = (Nova::new(), board());
    let set = ["config", "set", &board.place, "period_us=20000"];
    ok(nova.run(&set));
    let json = ok(nova.run(&["config", "get", &board.place, "--json"])).json();
    let settings = &json[0];
    assert_eq!(settings["period_us"]["value"], 20_000);
    assert_eq!(settings["period_us"]["set"], true);
    assert_eq!(settings["part"]["value"], "initiator");
    assert_eq!(settings["part"]["set"], false);
    assert_eq!(settings["peers"]["value"], serde_json::json!([]));
}

#[test]
fn a_file_takes_settings_to_another_board_and_leaves_its_own_alone() {
    let (nova, one, other) = (Nova::new(), board(), board());
    let set = [
        "config",
        "set",
        &one.place,
        "pan=0x1234",
        "address=0x0303",
        "antenna_delay.tx_ticks=16400",
    ];
    ok(nova.run(&set));
    ok(nova.run(&["config", "export", &one.place, "-o", "node.toml"]));
    let shown = ok(nova.run(&["config", "export", &one.place])).out;
    let written = std::fs::read_to_string(nova.folder.path().join("node.toml")).unwrap();
    assert_eq!(written, shown);
    ok(nova.run(&["config", "set", &other.place, "period_us=50000"]));
    ok(nova.run(&["config", "import", &other.place, "node.toml"]));
    let names = ["pan", "antenna_delay.tx_ticks", "period_us", "address"];
    let arguments = [&["config", "get", &other.place], &names[..]].concat();
    assert_eq!(
        ok(nova.run(&arguments)).out,
        "address = 0x0202  # default\npan = 0x1234\nperiod_us = 50000\nantenna_delay.tx_ticks = 16456  # default\n"
    );

    // All of it is for the same board again, and comes whole.
    ok(nova.run(&["config", "export", &one.place, "--all", "-o", "all.toml"]));
    let import = |place: &str| nova.run(&["config", "import", place, "all.toml"]);
    refused(&import(&other.place), &["node 0x0303", "node 0x0202"]);
    let before = ok(nova.run(&["config", "get", &one.place])).out;
    ok(nova.run(&["config", "reset", &one.place]));
    ok(nova.run(&["config", "set", &one.place, "address=0x0303"]));
    ok(import(&one.place));
    assert_eq!(ok(nova.run(&["config", "get", &one.place])).out, before);
}

/// Mean of the next ranges that the board reports.
fn mean_range_m(board: &Served) -> f64 {
    const RANGES: usize = 300;
    let mut line = TcpStream::connect(board.place.trim_start_matches("tcp://")).unwrap();
    let (mut decoder, mut ranges, mut bytes) = (Decoder::new(), Vec::new(), [0; 4096]);
    while ranges.len() < RANGES {
        let count = line.read(&mut bytes).unwrap();
        assert_ne!(count, 0, "the board is gone");
        let events = bytes[..count].iter().filter_map(|&byte| decoder.push(byte));
        ranges.extend(events.filter_map(|event| match event {
            Event::Record {
                record: Record::Range(range),
                ..
            } => Some(f64::from(range.raw_m)),
            _ => None,
        }));
    }
    ranges.iter().sum::<f64>() / ranges.len() as f64
}

/// From a board whose antenna delays nobody knows to one that ranges right, with nothing but the commands.
#[test]
fn what_calibration_found_makes_the_board_range_right_once_imported() {
    // 40.1 and 12.4 ticks more than the firmware takes for granted: 12 cm of range.
    let (nova, board) = (Nova::new(), Served::tcp_off(&Flash::new(4), [40.1, 12.4]));
    let wrong_m = mean_range_m(&board) - served::DISTANCE_M;
    assert!((0.11..0.14).contains(&wrong_m), "{wrong_m}");
    let calibrate = [
        "calibrate",
        &board.place,
        "--ranges",
        "500",
        "--distance",
        "0x0101-0x0202=5",
        "--known",
        "0x0101",
        "--delays",
        "0x0101=16456,16456",
        "--out",
        "delays",
    ];
    let said = nova.run(&calibrate);
    assert_eq!(said.code, 0, "{}", said.err);
    let import = ["config", "import", &board.place, "delays/0x0202.toml"];
    ok(nova.run(&import));
    let off_m = mean_range_m(&board) - served::DISTANCE_M;
    println!("{wrong_m:.4} m off before, {off_m:.4} m after");
    assert!(off_m.abs() < 0.005, "{off_m}");
}

#[test]
fn a_file_for_another_node_is_not_taken_by_mistake() {
    let (nova, board) = (Nova::new(), board());
    nova.file(
        "calibrated.toml",
        "address = 0x0303\n[antenna_delay]\ntx_ticks = 1\nrx_ticks = 2\n",
    );
    let import = ["config", "import", &board.place, "calibrated.toml"];
    refused(
        &nova.run(&import),
        &["node 0x0303", "node 0x0202", "--readdress"],
    );
    ok(nova.run(&[&import[..], &["--readdress"]].concat()));
    let get = [
        "config",
        "get",
        &board.place,
        "address",
        "antenna_delay.rx_ticks",
    ];
    assert_eq!(
        ok(nova.run(&get)).out,
        "address = 0x0303\nantenna_delay.rx_ticks = 2\n"
    );
    // Now it is for this one.
    ok(nova.run(&import));
}

#[test]
fn bad_values_are_told_before_anything_is_changed() {
    let (nova, board) = (Nova::new(), board());
    let set = |changes: &[&str]| nova.run(&[&["config", "set", &board.place], changes].concat());
    refused(
        &set(&["pan=7", "period_us=3"]),
        &["period_us", "between 1000 and 60000000 us"],
    );
    refused(&set(&["pam=7"]), &["pam", "is pan meant?"]);
    refused(&set(&["pan=7", "pan=8"]), &["pan", "twice"]);
    refused(&set(&["pan"]), &["NAME=VALUE"]);
    nova.file("bad.toml", "pan = 7\nbaudrate = 3\n");
    let import = ["config", "import", &board.place, "bad.toml"];
    refused(&nova.run(&import), &["bad.toml", "baudrate"]);
    let get = ["config", "get", &board.place, "pan"];
    assert_eq!(ok(nova.run(&get)).out, "pan = 0xDECA  # default\n");
}

#[test]
fn settings_outlive_the_board_that_was_switched_off() {
    let nova = Nova::new();
    let flash = Flash::new(4);
    {
        let board = Served::tcp(&flash);
        ok(nova.run(&["config", "set", &board.place, "pan=0x4321"]));
    }
    let board = Served::tcp(&flash);
    let get = ["config", "get", &board.place, "pan"];
    assert_eq!(ok(nova.run(&get)).out, "pan = 0x4321\n");
    let status = ok(nova.run(&["status", &board.place])).out;
    assert!(status.contains("settings: from flash\n"), "{status}");
}

#[test]
fn status_says_what_the_board_is_and_counts_what_failed() {
    let nova = Nova::new();
    let flash = Flash::new(4);
    flash.preload(0, &[0xA5; 3000]);
    let board = Served::tcp(&flash);
    let said = ok(nova.run(&["status", &board.place])).out;
    assert!(
        said.starts_with("node 0x0202, anchor, network 0xDECA, firmware 0.1.0\nruns for "),
        "{said}"
    );
    assert!(said.contains("started by: power on\n"), "{said}");
    assert!(
        said.contains("settings: DEFAULTS, because those in flash are damaged"),
        "{said}"
    );
    for counter in ["ranges", "no_response", "send_too_late", "flash_errors"] {
        assert!(said.lines().any(|line| line.starts_with(counter)), "{said}");
    }
    let json = ok(nova.run(&["status", &board.place, "--json"])).json();
    assert_eq!(json[0]["about"]["settings"], "damaged");
    assert_eq!(json[0]["status"]["counters"]["settings_discarded"], 1);
    assert!(json[0]["status"]["counters"]["ranges"].as_u64().unwrap() > 0);
}

#[test]
fn a_board_starts_anew_on_command() {
    let (nova, board) = (Nova::new(), board());
    ok(nova.run(&["config", "reboot", &board.place]));
    let json = ok(nova.run(&["status", &board.place, "--json"])).json();
    assert_eq!(json[0]["about"]["reset_cause"], "software");
}

#[cfg(unix)]
#[test]
fn a_serial_port_does_as_well() {
    let nova = Nova::new();
    let board = Served::terminal(&Flash::new(4));
    ok(nova.run(&["config", "set", &board.place, "pan=0x1111"]));
    let get = ["config", "get", &board.place, "pan"];
    assert_eq!(ok(nova.run(&get)).out, "pan = 0x1111\n");
}

#[test]
fn nothing_is_asked_where_nothing_can_answer() {
    let nova = Nova::new();
    nova.file("capture.bin", [0]);
    refused(
        &nova.run(&["config", "get", "capture.bin"]),
        &["no board can be asked"],
    );
    refused(
        &nova.run(&["status", "-"]),
        &["standard input", "no board can be asked"],
    );
    refused(&nova.run(&["status", "tcp://nowhere"]), &["HOST:PORT"]);
    // A server that says nothing.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = format!("tcp://{}", silent.local_addr().unwrap());
    let said = nova.run(&["status", &place]);
    assert_eq!(said.code, 1);
    assert!(said.err.contains("no board answers"), "{}", said.err);
}

#[test]
fn the_help_lists_every_setting_with_what_is_allowed() {
    let help = ok(Nova::new().run(&["config", "--help"])).out;
    for description in &nova_wire::settings::SETTINGS {
        assert!(help.contains(description.name), "{}", description.name);
    }
    assert!(
        help.contains("1000 to 60000000 us; default: 10000"),
        "{help}"
    );
}
