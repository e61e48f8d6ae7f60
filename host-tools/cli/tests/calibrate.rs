//! `nova calibrate` on simulated boards whose antenna delays are not what their firmware takes them
//! for: from the radio's registers to the file that sets them right.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, Said};
use nova_hal_sim::{BoardConfig, BoardId, ClockConfig, Motion, SimConfig, SimTime, Simulation};
use nova_node::ranging::Address;
use nova_node::{AntennaDelay, NodeConfig};
use nova_wire::{
    Command, CommandDecoder, CommandEvent, Decoder, Encoder, Event, MAX_FRAME_LEN, Record, Setting,
    SettingValue, Value,
};
use serde_json::Value as Json;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpListener;

/// Metres of range for one tick of error in the sum of a board's delays.
const TICK_M: f64 = 299_702_547.0 / 63_897_600_000.0 / 2.0;

/// A board: where it is, and its true antenna delays.
#[derive(Clone, Copy)]
struct Board {
    address: u16,
    place_m: [f64; 3],
    true_ticks: [f64; 2],
    clock_ppm: f64,
    told: AntennaDelay,
}

/// Three boards 20 to 50 ticks off, 5 to 12 cm of range each.
fn boards() -> [Board; 3] {
    let board = |address, place_m, off: [f64; 2], clock_ppm| Board {
        address,
        place_m,
        true_ticks: off.map(|off| 16_456.0 + off),
        clock_ppm,
        told: AntennaDelay::UNCALIBRATED,
    };
    [
        board(1, [0.0, 0.0, 1.5], [30.3, 15.9], 1.8),
        board(2, [5.0, 0.0, 1.5], [-4.2, -18.5], -2.4),
        board(3, [2.0, 4.5, 1.2], [25.0, 25.7], 0.7),
    ]
}

fn distance_m(a: &Board, b: &Board) -> f64 {
    let squares = (0..3).map(|k| (a.place_m[k] - b.place_m[k]).powi(2));
    squares.sum::<f64>().sqrt()
}

/// What the boards send within 22 s while the one at `anchor` polls the others.
fn streams(boards: &[Board], anchor: usize, seed: u64) -> Vec<Vec<u8>> {
    let mut sim = Simulation::new(SimConfig {
        seed,
        ..SimConfig::default()
    });
    let ids: Vec<BoardId> = (boards.iter().enumerate())
        .map(|(index, board)| {
            let address = Address(board.address);
            let mut node = if index == anchor {
                NodeConfig::anchor(address)
            } else {
                NodeConfig::tag(address)
            };
            node.antenna_delay = board.told.into();
            let [tx, rx] = board.true_ticks;
            let config = BoardConfig {
                motion: Motion::fixed(board.place_m),
                clock: ClockConfig {
                    offset_ticks: 1_000_000_007 * u64::from(board.address),
                    ppm: board.clock_ppm,
                    drift_ppm_per_s: 0.01,
                },
                tx_antenna_delay_ticks: tx,
                rx_antenna_delay_ticks: rx,
                rx_noise_ps: 100.0,
                ..BoardConfig::default()
            };
            nova_cli::sim_node::add(&mut sim, config, node).unwrap()
        })
        .collect();
    let mut sent = vec![Vec::new(); boards.len()];
    for second in 1..=22 {
        sim.run_until(SimTime::from_s_f64(f64::from(second)))
            .unwrap();
        for (sent, id) in sent.iter_mut().zip(&ids) {
            sent.extend(sim.uart(*id).into_iter().flat_map(|chunk| chunk.bytes));
        }
    }
    sent
}

/// Mean of the ranges in a stream, by peer.
fn means(stream: &[u8]) -> BTreeMap<u16, f64> {
    let mut decoder = Decoder::new();
    let mut sums: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
    for event in stream.iter().filter_map(|&b| decoder.push(b)) {
        if let Event::Record {
            record: Record::Range(range),
            ..
        } = event
        {
            let (sum, count) = sums.entry(range.peer).or_default();
            (*sum, *count) = (*sum + f64::from(range.raw_m), *count + 1.0);
        }
    }
    (sums.into_iter())
        .map(|(peer, (sum, count))| (peer, sum / count))
        .collect()
}

/// Recordings of three boards: board 1 polls the others, then board 2 does.
fn recorded(nova: &Nova, boards: &[Board]) {
    for (anchor, name) in [(0, "first"), (1, "second")] {
        let streams = streams(boards, anchor, 7 + anchor as u64);
        for (board, stream) in boards.iter().zip(streams) {
            nova.file(&format!("{name}-{}.bin", board.address), stream);
        }
    }
}

fn places(boards: &[Board]) -> Vec<String> {
    (boards.iter())
        .flat_map(|board| {
            let [x, y, z] = board.place_m;
            ["--at".to_owned(), format!("{}={x},{y},{z}", board.address)]
        })
        .collect()
}

fn calibrate(nova: &Nova, arguments: &[&str], more: &[String]) -> Said {
    let mut all = vec!["calibrate"];
    all.extend(arguments);
    all.extend(more.iter().map(String::as_str));
    nova.run(&all)
}

fn result(said: &Said) -> Json {
    assert_eq!(said.code, 0, "{}", said.err);
    said.json().remove(0)
}

#[test]
fn three_boards_wrong_antenna_delays_are_found_and_corrected() {
    let nova = Nova::new();
    let mut boards = boards();
    recorded(&nova, &boards);
    let said = calibrate(
        &nova,
        &[
            "first-1.bin",
            "second-2.bin",
            "--json",
            "--out",
            "delays",
            // Survey and air are exact here; what is left is what must be.
            "--distance-sigma",
            "0",
            "--systematic-sigma",
            "0.001",
            "--delays",
            "1=16456,16456",
            "--delays",
            "2=16456,16456",
            "--delays",
            "3=16456,16456",
        ],
        &places(&boards),
    );
    let found = result(&said);
    assert_eq!(found["pairs"].as_array().unwrap().len(), 3);
    for (board, node) in boards.iter().zip(found["nodes"].as_array().unwrap()) {
        assert_eq!(
            (&node["address"], &node["determined"]),
            (&board.address.into(), &"each".into())
        );
        let truth = board.true_ticks.iter().sum::<f64>() - 2.0 * 16_456.0;
        let change = node["sum_change_ticks"].as_f64().unwrap();
        let sigma = node["sum_sigma_ticks"].as_f64().unwrap();
        println!(
            "{}: {change:.2} +- {sigma:.2} ticks, in truth {truth:.2}",
            board.address
        );
        assert!(sigma < 1.0, "{sigma}");
        assert!(
            (change - truth).abs() < 3.0 * sigma,
            "{change} {truth} {sigma}"
        );
    }

    // The files set the firmware right; what is still wrong after that is seen from another run.
    let uncorrected = largest_error_m(&boards);
    for board in &mut boards {
        let file = format!("delays/0x{:04X}.toml", board.address);
        let text = std::fs::read_to_string(nova.folder.path().join(file)).unwrap();
        let file: toml::Table = text.parse().unwrap();
        assert_eq!(file["address"].as_integer(), Some(board.address.into()));
        let ticks = |name: &str| file["antenna_delay"][name].as_integer().unwrap();
        board.told = AntennaDelay {
            tx_ticks: ticks("tx_ticks").try_into().unwrap(),
            rx_ticks: ticks("rx_ticks").try_into().unwrap(),
        };
    }
    let corrected = largest_error_m(&boards);
    println!(
        "largest error of a pair's mean range: {:.1} mm before, {:.1} mm after",
        1e3 * uncorrected,
        1e3 * corrected
    );
    assert!(uncorrected > 0.1, "{uncorrected}");
    assert!(corrected < 0.005, "{corrected}");
}

/// Of all pairs' mean ranges, in a run with other noise.
fn largest_error_m(boards: &[Board]) -> f64 {
    let mut largest: f64 = 0.0;
    for anchor in [0, 1] {
        let stream = &streams(boards, anchor, 99)[anchor];
        let means = means(stream);
        assert_eq!(means.len(), 2);
        for (peer, mean_m) in means {
            let peer = boards.iter().find(|board| board.address == peer).unwrap();
            largest = largest.max((mean_m - distance_m(&boards[anchor], peer)).abs());
        }
    }
    largest
}

#[test]
fn two_boards_get_half_each_and_are_told_what_that_means() {
    let nova = Nova::new();
    let boards = boards();
    let stream = streams(&boards[..2], 0, 3).remove(0);
    nova.file("anchor.bin", stream);
    let distance = ["--distance".to_owned(), "0x0001-0x0002=5".to_owned()];
    let found = result(&calibrate(&nova, &["anchor.bin", "--json"], &distance));
    let truth_m = TICK_M * (30.3 + 15.9 - 4.2 - 18.5);
    for node in found["nodes"].as_array().unwrap() {
        assert_eq!(node["determined"], "pair_sum");
        assert!((node["offset_m"].as_f64().unwrap() - truth_m / 2.0).abs() < 0.002);
        assert!(node["sigma_m"].as_f64().unwrap() > 0.2);
    }
    assert!(found["pairs"][0]["calibrated_sigma_m"].as_f64().unwrap() < 0.025);
    let text = calibrate(&nova, &["anchor.bin"], &distance);
    assert_eq!(text.code, 0, "{}", text.err);
    assert!(text.out.contains("only the sum"), "{}", text.out);

    // With one of them known the other is.
    let known = result(&calibrate(
        &nova,
        &["anchor.bin", "--json", "--known", "1"],
        &distance,
    ));
    assert_eq!(known["nodes"][1]["determined"], "each");
    assert!(known["nodes"][1]["sigma_m"].as_f64().unwrap() < 0.03);
}

#[test]
fn delays_in_force_are_those_that_the_board_tells_unless_the_user_knows_better() {
    let nova = Nova::new();
    let boards = boards();
    let told = AntennaDelay {
        tx_ticks: 16_500,
        rx_ticks: 16_400,
    };
    let stream = telling(streams(&boards[..2], 0, 3).remove(0), told);
    nova.file("anchor.bin", &stream);
    let was = |more: &[&str]| {
        let arguments = [&["anchor.bin", "--json", "--distance", "1-2=5"], more].concat();
        let found = result(&calibrate(&nova, &arguments, &[]));
        let node = &found["nodes"][0];
        let ticks = |of: &str, name: &str| node[of][name].as_f64().unwrap();
        let sum = |of| ticks(of, "tx_ticks") + ticks(of, "rx_ticks");
        let change = node["sum_change_ticks"].as_f64().unwrap();
        assert!((sum("antenna_delay") - sum("was") - change).abs() <= 0.5);
        ["tx_ticks", "rx_ticks"].map(|name| ticks("was", name))
    };
    assert_eq!(was(&[]), [16_500.0, 16_400.0]);
    assert_eq!(was(&["--delays", "1=16000,17000"]), [16_000.0, 17_000.0]);
}

/// A stream that holds the board's delays, as those have that were recorded with `nova listen`.
fn telling(mut stream: Vec<u8>, told: AntennaDelay) -> Vec<u8> {
    let mut encoder = Encoder::new();
    for (setting, ticks) in [
        (Setting::TxAntennaDelay, told.tx_ticks),
        (Setting::RxAntennaDelay, told.rx_ticks),
    ] {
        let record = Record::Setting(SettingValue {
            setting: setting.number(),
            value: Value::Number(ticks.into()),
            set: false,
        });
        stream.extend(encoder.encode(&record, &mut [0; MAX_FRAME_LEN]).unwrap());
    }
    stream
}

#[test]
fn files_start_from_the_delays_that_boards_worked_by_and_not_from_a_guess() {
    let nova = Nova::new();
    let mut boards = boards();
    let told = AntennaDelay {
        tx_ticks: 16_400,
        rx_ticks: 16_400,
    };
    boards.iter_mut().for_each(|board| board.told = told);
    let streams = streams(&boards[..2], 0, 3);
    let names = ["0x0001", "0x0002"];
    for (name, stream) in names.iter().zip(streams) {
        nova.file(&format!("{name}-silent.bin"), &stream)
            .file(&format!("{name}.bin"), telling(stream, told));
    }
    let run = |files: [&str; 2], more: &[&str]| {
        let arguments = [&files[..], &["--json", "--distance", "1-2=5"], more].concat();
        calibrate(&nova, &arguments, &[])
    };
    for (files, node) in [
        (["0x0001-silent.bin", "0x0002.bin"], "0x0001"),
        (["0x0001.bin", "0x0002-silent.bin"], "0x0002"),
    ] {
        let said = run(files, &["--out", "guessed"]);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{}", said.err);
        assert!(
            said.err.contains(node) && said.err.contains("--delays"),
            "{}",
            said.err
        );
        assert!(!nova.folder.path().join("guessed").exists());
    }
    let silent = ["0x0001-silent.bin", "0x0002-silent.bin"];
    let by_hand = ["--delays", "1=16400,16400", "--delays", "2=16400,16400"];
    let by_hand = [&by_hand[..], &["--out", "given"]].concat();
    result(&run(["0x0001.bin", "0x0002.bin"], &["--out", "told"]));
    result(&run(silent, &by_hand));
    // Two boards: the sum of all four delays is what is found.
    let truth: f64 = boards[..2].iter().flat_map(|board| board.true_ticks).sum();
    for folder in ["told", "given"] {
        let mut sum = 0.0;
        for name in names {
            let file = nova.folder.path().join(folder).join(format!("{name}.toml"));
            let file: toml::Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
            for name in ["tx_ticks", "rx_ticks"] {
                sum += file["antenna_delay"][name].as_integer().unwrap() as f64;
            }
        }
        assert!(
            (sum - truth).abs() < 4.0,
            "{folder}: {sum}, in truth {truth}"
        );
    }
}

#[test]
fn a_table_of_range_bias_takes_the_place_of_the_boards_own() {
    let nova = Nova::new();
    let stream = streams(&boards()[..2], 0, 3).remove(0);
    nova.file("anchor.bin", stream)
        .file("none.csv", "rx_power_dbm,bias_m\n-100,0\n-50,0\n")
        .file("flat.csv", "rx_power_dbm,bias_m\n-100,0.07\n-50,0.07\n")
        .file("twice.csv", "rx_power_dbm,bias_m\n-80,0.1\n-80,0.2\n")
        .file("bad.csv", "rx_power_dbm,bias_mm\n-80,100\n");
    let offset_m = |more: &[&str]| {
        let arguments = [&["anchor.bin", "--json", "--distance", "1-2=5"], more].concat();
        let found = result(&calibrate(&nova, &arguments, &[]));
        found["nodes"][0]["offset_m"].as_f64().unwrap()
    };
    let none_m = offset_m(&["--range-bias", "none.csv"]);
    let difference_m = none_m - offset_m(&["--range-bias", "flat.csv"]);
    // Half of it each; the prior holds back one part in a few hundred.
    assert!((difference_m - 0.035).abs() < 0.001, "{difference_m}");
    // At 5 m, -72 dBm, ranges read 61 mm short (APS011).
    let difference_m = offset_m(&[]) - none_m;
    assert!((difference_m - 0.0305).abs() < 0.002, "{difference_m}");
    for (file, mention) in [("twice.csv", "twice"), ("bad.csv", "'bias_m'")] {
        let arguments = ["anchor.bin", "--distance", "1-2=5", "--range-bias", file];
        let said = calibrate(&nova, &arguments, &[]);
        assert_eq!((said.code, said.out.as_str()), (2, ""));
        assert!(
            said.err.contains(file) && said.err.contains(mention),
            "{}",
            said.err
        );
    }
}

#[test]
fn live_boards_are_asked_and_heard_until_there_is_enough() {
    let nova = Nova::new();
    let stream = streams(&boards()[..2], 0, 3).remove(0);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = format!("tcp://{}", listener.local_addr().unwrap());
    let board = std::thread::spawn(move || {
        let (mut host, _) = listener.accept().unwrap();
        // It is asked for its settings, before anything else.
        let mut decoder = CommandDecoder::new();
        let mut byte = [0; 1];
        loop {
            host.read_exact(&mut byte).unwrap();
            if let Some(CommandEvent::Record { record, .. }) = decoder.push(byte[0])
                && record == Command::Get
            {
                break;
            }
        }
        // The host leaves when it has enough, before all of this is sent.
        for _ in 0..1_000 {
            if host.write_all(&stream).is_err() {
                break;
            }
        }
    });
    let found = result(&calibrate(
        &nova,
        &[&place, "--json", "--ranges", "3000", "--distance", "1-2=5"],
        &[],
    ));
    board.join().unwrap();
    let pair = &found["pairs"][0];
    assert!(pair["used"].as_u64().unwrap() + pair["rejected"].as_u64().unwrap() >= 3_000);
}

#[test]
fn both_ends_of_a_pair_tell_the_same_and_count_once() {
    let nova = Nova::new();
    let boards = boards();
    recorded(&nova, &boards);
    let places = places(&boards);
    let streams = ["first-1.bin", "first-2.bin", "second-2.bin", "second-3.bin"];
    let all = result(&calibrate(
        &nova,
        &[&streams[..], &["--json"]].concat(),
        &places,
    ));
    let one = result(&calibrate(
        &nova,
        &["first-1.bin", "second-2.bin", "--json"],
        &places,
    ));
    for (all, one) in
        (all["nodes"].as_array().unwrap().iter()).zip(one["nodes"].as_array().unwrap())
    {
        let of = |node: &Json, name: &str| node[name].as_f64().unwrap();
        assert!((of(all, "offset_m") - of(one, "offset_m")).abs() < 0.002);
        assert!((of(all, "sigma_m") / of(one, "sigma_m") - 1.0).abs() < 0.2);
    }
}

#[test]
fn placements_of_a_survey_are_solved_together_and_a_wrong_distance_shows() {
    let nova = Nova::new();
    let near = boards();
    let mut far = near;
    far[2].place_m = [-3.0, 8.0, 1.0];
    for (name, boards) in [("near", near), ("far", far)] {
        for anchor in [0, 1] {
            let stream = streams(&boards, anchor, 11 + anchor as u64).remove(anchor);
            nova.file(&format!("{name}-{}.bin", anchor + 1), stream);
        }
    }
    let survey = |wrong_m: f64| {
        let placement = |name: &str, boards: &[Board; 3], wrong_m: f64| {
            let [a, b, c] = boards;
            format!(
                "[[placement]]\nsources = [\"{name}-1.bin\", \"{name}-2.bin\"]\n\
                 distances = {{ \"1-2\" = {}, \"1-3\" = {}, \"2-3\" = {} }}\n",
                distance_m(a, b),
                distance_m(a, c),
                distance_m(b, c) + wrong_m
            )
        };
        placement("near", &near, 0.0) + &placement("far", &far, wrong_m)
    };
    nova.file("right.toml", survey(0.0))
        .file("wrong.toml", survey(0.5));
    let right = result(&nova.run(&["calibrate", "--survey", "right.toml", "--json"]));
    assert_eq!(
        (&right["freedom"], right["pairs"].as_array().unwrap().len()),
        (&3.into(), 6)
    );
    assert!(right["reduced_chi_square"].as_f64().unwrap() < 1.0);
    let wrong = nova.run(&["calibrate", "--survey", "wrong.toml"]);
    assert_eq!(wrong.code, 0, "{}", wrong.err);
    assert!(wrong.out.contains("0x0002 0x0003: "), "{}", wrong.out);
    assert!(
        wrong.out.contains("do not fit the other pairs"),
        "{}",
        wrong.out
    );
}

#[test]
fn what_does_not_give_a_calibration_is_refused_with_the_reason() {
    let nova = Nova::new();
    let stream = streams(&boards()[..2], 0, 3).remove(0);
    nova.file("anchor.bin", &stream)
        .file("short.bin", &stream[..400])
        .file("text", "just some text\n");
    for (arguments, mention) in [
        (&[][..], "--survey"),
        (&["anchor.bin"], "--distance"),
        (
            &["text", "--distance", "1-2=5"],
            "text: no record in 15 bytes",
        ),
        (&["anchor.bin", "--distance", "1-7=5"], "no two nodes"),
        (
            &["anchor.bin", "--distance", "1-2=5000"],
            "are the distances right",
        ),
        (&["anchor.bin", "--distance", "1-2=0"], "not a distance"),
        (
            &["anchor.bin", "--distance", "1-2=5", "--distance", "2-1=5"],
            "twice",
        ),
        (
            &["anchor.bin", "--distance", "1-2=5", "--known", "9"],
            "--known 0x0009",
        ),
        (
            &["anchor.bin", "--distance", "1-2=5", "--known", "1=0"],
            "NODE=SIGMA_M",
        ),
        (
            &["anchor.bin", "--distance", "1-2=5", "--delays", "1=70000,1"],
            "65535",
        ),
        (
            &["anchor.bin", "--distance", "1-2=5", "--tx-share", "2"],
            "--tx-share",
        ),
        (
            &["anchor.bin", "--distance", "1-2=5", "--prior-sigma", "0"],
            "--prior-sigma",
        ),
        (
            &["--survey", "nowhere.toml"],
            "nowhere.toml: cannot be read",
        ),
        (&["--survey", "text"], "text: "),
    ] {
        let said = calibrate(&nova, arguments, &[]);
        assert_eq!(
            (said.code, said.out.as_str()),
            (2, ""),
            "{arguments:?}: {}",
            said.err
        );
        assert!(said.err.contains(mention), "{arguments:?}: {}", said.err);
    }
}
