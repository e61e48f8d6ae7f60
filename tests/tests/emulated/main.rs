//! The firmware as it goes onto boards, on emulated ones.
//!
//! `cargo xtask test` builds it and says where it is. Without that these tests are ignored, as the harness shows.
#![allow(clippy::unwrap_used)]

mod host;
mod settings;
mod stack;
mod vendor;

use libtest_mimic::{Arguments, Failed, Trial};
use nova_emulator::{BoardConfig, ResetReason};
use nova_hal_sim::{ChannelConfig, Motion, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::{BoardLog, EmulatedNetwork, Firmware, Network, Scenario};
use nova_wire::{Record, ResetCause};
use std::collections::BTreeMap;
use std::process::ExitCode;

fn main() -> ExitCode {
    if let Some(code) = host::instead() {
        return code;
    }
    let arguments = Arguments::from_args();
    let firmware = match Firmware::from_environment() {
        Some(Ok(firmware)) => Some(firmware),
        Some(Err(error)) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
        None => None,
    };
    type Test = fn(&Firmware) -> Result<(), Failed>;
    let tests: [(&str, Test); 10] = [
        (
            "both_binaries_boot_and_range_at_3_10_and_98_5_m_with_crystals_20_ppm_off",
            both_boot_and_range,
        ),
        (
            "the_binaries_range_as_the_same_code_does_on_the_simulator",
            as_on_the_simulator,
        ),
        (
            "a_pair_at_full_speed_meets_its_scenario_and_leaves_most_of_the_stack_untouched",
            at_full_speed,
        ),
        (
            "settings_given_through_the_serial_port_survive_a_restart",
            settings::settings_survive,
        ),
        (
            "power_lost_at_any_write_of_an_update_leaves_the_old_settings_or_the_new",
            settings::power_lost_anywhere,
        ),
        (
            "a_radio_that_is_dead_ends_in_a_reset_by_the_watchdog_and_ranging_goes_on",
            dead_radio,
        ),
        (
            "what_boards_say_does_not_depend_on_the_order_they_are_given_in",
            any_order,
        ),
        (
            "nova_config_and_nova_listen_talk_to_an_emulated_board",
            host::config_and_listen,
        ),
        (
            "a_board_runs_the_file_that_it_is_given",
            host::a_file_of_its_own,
        ),
        (
            "a_stack_that_grows_out_of_ram_ends_in_a_reset",
            stack::overflow_resets,
        ),
    ];
    let trials = tests.into_iter().map(|(name, test)| {
        let firmware = firmware.clone();
        let missing = firmware.is_none();
        Trial::test(name, move || match &firmware {
            Some(firmware) => test(firmware),
            None => Err("NOVA_FIRMWARE is not set: `cargo xtask test` does that".into()),
        })
        .with_ignored_flag(missing)
    });
    let vendors = Trial::test(
        "the_vendors_compiled_examples_range_with_each_other",
        vendor::a_pair_prints_its_distance,
    )
    .with_ignored_flag(std::env::var_os(vendor::VARIABLE).is_none());
    let trials = trials.chain([vendors]).collect();
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// Standard deviation of receive time stamps where noise is wanted.
const NOISE_PS: f64 = 100.0;

/// 6.8 Mbit/s does not reach 100 m through this much air: the air is made clearer.
const CLEAR_AIR_DB: f64 = 12.0;

const TICK_M: f64 = 299_702_547.0 / 63_897_600_000.0;

/// A range is there so soon after the start, and so late in the first second, by the board's clock.
const FIRST_RANGE_US: u64 = 200_000;
const LAST_RANGE_US: u64 = 950_000;

/// Two crystals that are 20 ppm off one from the other read the antenna delays wrong by this much (docs/found-by-trying.md).
const MODEL_ERROR_M: f64 = 0.005;

fn pair(distance_m: f64, noise_ps: f64, seed: u64, firmware: &Firmware) -> EmulatedNetwork {
    let mut anchor = BoardConfig::new("anchor", [0x1234, 0xA]);
    let mut tag = BoardConfig::new("tag", [0x5678, 0xB]);
    anchor.chip.clock.ppm = 20.0;
    tag.chip.clock.ppm = -20.0;
    tag.chip.motion = Motion::fixed([distance_m, 0.0, 0.0]);
    for board in [&mut anchor, &mut tag] {
        board.chip.rx_noise_ps = noise_ps;
    }
    let boards = vec![
        (anchor, firmware.anchor.clone()),
        (tag, firmware.tag.clone()),
    ];
    EmulatedNetwork::new(seed, channel(), boards).unwrap()
}

fn channel() -> ChannelConfig {
    let channel = ChannelConfig::default();
    ChannelConfig {
        antenna_gain_db: channel.antenna_gain_db + CLEAR_AIR_DB,
        ..channel
    }
}

fn both_boot_and_range(firmware: &Firmware) -> Result<(), Failed> {
    for distance_m in [3.0, 10.0, 98.5] {
        let mut network = pair(distance_m, NOISE_PS, 7, firmware);
        network.run_until_s(1.0)?;
        for board in ["anchor", "tag"] {
            let log = network.log(board).ok_or("no log")?;
            let noise_m = check_ranges(log, distance_m)?;
            println!(
                "{board} at {distance_m} m: {} ranges, sigma {noise_m:.4} m",
                log.ranges.len()
            );
            let lines = network.lines(board).ok_or("no lines")?;
            if !lines
                .iter()
                .any(|line| line.text.contains("settings: Defaults"))
            {
                return Err(format!("{board} did not log its start: {lines:?}").into());
            }
        }
    }
    Ok(())
}

/// The mean is right to 5 mm and what the noise leaves of it; returns the standard deviation.
fn check_ranges(log: &BoardLog, distance_m: f64) -> Result<f64, Failed> {
    let errors: Vec<f64> = log
        .ranges
        .iter()
        .map(|range| f64::from(range.raw_m) - distance_m)
        .collect();
    let n = errors.len() as f64;
    // It is chance in which slot a tag first answers, so the rate counts from there.
    let (Some(first), Some(last)) = (log.ranges.first(), log.ranges.last()) else {
        return Err(format!("no ranges; {:?}", log.counters).into());
    };
    let rate_hz = (n - 1.0) / ((last.t_us - first.t_us) as f64 * 1e-6);
    if first.t_us > FIRST_RANGE_US || last.t_us < LAST_RANGE_US || rate_hz < 97.0 {
        let (first_us, last_us) = (first.t_us, last.t_us);
        return Err(format!(
            "{n} ranges from {first_us} to {last_us} us; {:?}",
            log.counters
        )
        .into());
    }
    let mean = errors.iter().sum::<f64>() / n;
    let sigma = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt();
    // A range sees the noise of four stamps, each with half or a quarter of its weight: no more than one stamp's.
    let noise_m = NOISE_PS * 1e-12 * 299_702_547.0;
    if mean.abs() > MODEL_ERROR_M + 3.0 * sigma / n.sqrt() || sigma > noise_m {
        return Err(format!("mean error {mean:.4} m, sigma {sigma:.4} m").into());
    }
    if log.wire.lost + log.wire.corrupt > 0 {
        return Err(format!("the serial port lost something: {:?}", log.wire).into());
    }
    Ok(sigma)
}

fn as_on_the_simulator(firmware: &Firmware) -> Result<(), Failed> {
    const SECONDS: f64 = 2.0;
    for distance_m in [3.0, 10.0, 98.5] {
        let mut emulated = pair(distance_m, 0.0, 7, firmware);
        emulated.run_until_s(SECONDS)?;
        let mut simulated = Network::new(SimConfig {
            seed: 7,
            channel: channel(),
        });
        let boards = [
            (20.0, 0.0, NodeConfig::anchor(Address(0xA))),
            (-20.0, distance_m, NodeConfig::tag(Address(0xB))),
        ];
        for (ppm, x, node) in boards {
            let mut board = nova_hal_sim::BoardConfig {
                motion: Motion::fixed([x, 0.0, 0.0]),
                ..nova_hal_sim::BoardConfig::default()
            };
            board.clock.ppm = ppm;
            simulated
                .add(board, node)
                .map_err(|error| error.to_string())?;
        }
        simulated.run_until_s(SECONDS).map_err(|e| e.to_string())?;
        let emulated = emulated.log("anchor").ok_or("no log")?;
        let simulated = simulated.log(0).ok_or("no log")?;
        let [here, there] = [emulated, simulated].map(|log| {
            let n = log.ranges.len() as f64;
            let sum: f64 = log.ranges.iter().map(|range| f64::from(range.raw_m)).sum();
            (n / SECONDS, sum / n)
        });
        println!("{distance_m} m: emulated {here:?}, simulated {there:?} (rate in Hz, mean in m)");
        if (here.1 - there.1).abs() > TICK_M {
            return Err(format!("{} m emulated, {} m simulated", here.1, there.1).into());
        }
        if (here.0 / there.0 - 1.0).abs() > 0.15 {
            return Err(format!("{} Hz emulated, {} Hz simulated", here.0, there.0).into());
        }
        if let Some(range) = emulated
            .ranges
            .iter()
            .find(|range| (f64::from(range.raw_m) - there.1).abs() > TICK_M)
        {
            return Err(format!("{} m among ranges of {} m", range.raw_m, there.1).into());
        }
    }
    Ok(())
}

/// The most of the stack that ranging may take, in bytes: the node, a listener's records among it, passes over it when it is made.
const STACK_BUDGET: u32 = 10 * 1024;

fn at_full_speed(firmware: &Firmware) -> Result<(), Failed> {
    let scenario = Scenario::parse(include_str!("../../scenarios/a-pair-at-full-speed.toml"))?;
    let mut network = scenario.emulate(firmware, &BTreeMap::new())?;
    network.run_until_s(scenario.duration_s)?;
    for board in network.emulation().boards() {
        let stack = board.stack_use().ok_or("no stack")?;
        let stats = board.stats();
        let load = stats.busy_cycles as f64 / stats.cycles as f64;
        println!(
            "{}: {stack:?}, load {load:.3}, {:?}",
            board.name(),
            stats.replies
        );
        if stack.high_water > STACK_BUDGET {
            return Err(format!("{}: {stack:?}", board.name()).into());
        }
    }
    Ok(scenario.check_emulated(&network)?)
}

/// From the moment a radio dies until ranges come again.
const RECOVERED_S: f64 = 2.0;

fn dead_radio(firmware: &Firmware) -> Result<(), Failed> {
    let mut network = pair(10.0, NOISE_PS, 3, firmware);
    network.run_until_s(1.2)?;
    let died_s = 1.2;
    let before = network.log("anchor").ok_or("no log")?.ranges.len();
    let resets = network.stats("tag").ok_or("no tag")?.resets.len();
    network.emulation().hold_radio("tag", true);
    let mut t_s = died_s;
    while network.stats("tag").ok_or("no tag")?.resets.len() == resets {
        t_s += 0.01;
        network.run_until_s(t_s)?;
        if t_s > died_s + RECOVERED_S {
            return Err("no reset".into());
        }
    }
    let stats = network.stats("tag").ok_or("no tag")?;
    if stats.resets.last().map(|&(_, why)| why) != Some(ResetReason::Watchdog) {
        return Err(format!("{:?}", stats.resets).into());
    }
    network.emulation().hold_radio("tag", false);
    let reset_s = t_s;
    let during = network.log("anchor").ok_or("no log")?.ranges.len();
    while network.log("anchor").ok_or("no log")?.ranges.len() == during {
        t_s += 0.01;
        network.run_until_s(t_s)?;
        if t_s > died_s + RECOVERED_S {
            return Err("no range after the reset".into());
        }
    }
    println!(
        "{before} ranges, then dead; reset after {:.2} s, a range {:.2} s later",
        reset_s - died_s,
        t_s - reset_s
    );
    let others = &network.log("tag").ok_or("no log")?.others;
    let told = others.iter().any(
        |record| matches!(record, Record::Boot(boot) if boot.reset_cause == ResetCause::Watchdog),
    );
    if told {
        Ok(())
    } else {
        Err("the board did not tell its host why it started".into())
    }
}

fn any_order(firmware: &Firmware) -> Result<(), Failed> {
    let run = |reversed: bool| -> Result<Vec<Vec<u8>>, Failed> {
        let mut boards = Vec::new();
        for (name, x, ppm, image) in [
            ("a", 0.0, 3.0, &firmware.anchor),
            ("b", 9.0, -4.0, &firmware.tag),
            ("c", 4.0, 0.0, &firmware.tag),
        ] {
            let mut board = BoardConfig::new(name, [x as u32, 77]);
            board.chip.clock.ppm = ppm;
            board.chip.rx_noise_ps = NOISE_PS;
            board.chip.motion = Motion::fixed([x, 0.0, 0.0]);
            boards.push((board, image.clone()));
        }
        if reversed {
            boards.reverse();
        }
        let mut network = EmulatedNetwork::new(11, ChannelConfig::default(), boards)?;
        network.run_until_s(1.5)?;
        let bytes = ["a", "b", "c"].map(|name| network.log(name).map(|log| log.bytes.clone()));
        Ok(bytes.into_iter().flatten().collect())
    };
    let (one, other) = (run(false)?, run(true)?);
    if one.len() != 3 || one.iter().any(|bytes| bytes.len() < 500) {
        return Err("they said next to nothing".into());
    }
    if one != other {
        return Err("they said something else".into());
    }
    Ok(())
}
