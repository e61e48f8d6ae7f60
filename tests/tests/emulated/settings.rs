//! Settings in the flash of emulated boards.

use libtest_mimic::Failed;
use nova_emulator::{BoardConfig, ChipMemory, Image};
use nova_hal_sim::ChannelConfig;
use nova_hal_sim::flash::{PowerCut, Torn};
use nova_tests::{EmulatedNetwork, Firmware};
use nova_wire::{
    Change, Command, Outcome, Record, ResetCause, Setting, SettingValue, SettingsSource, Value,
};

/// One board, alone, that has started.
fn alone(image: &Image, memory: Option<ChipMemory>) -> EmulatedNetwork {
    let board = BoardConfig {
        memory,
        ..BoardConfig::new("board", [0x1234, 0xA])
    };
    let boards = vec![(board, image.clone())];
    let mut network = EmulatedNetwork::new(1, ChannelConfig::default(), boards).unwrap();
    network.run_until_s(0.05).unwrap();
    network
}

/// Gives a command and returns what the board says in the next 0.3 s, ranges and statuses left out.
fn ask(network: &mut EmulatedNetwork, command: &Command) -> Vec<Record> {
    let said = |network: &EmulatedNetwork| network.log("board").unwrap().others.clone();
    let before = said(network).len();
    network.command("board", command).unwrap();
    let now_s = network.emulation().now().as_s_f64();
    network.run_until_s(now_s + 0.3).unwrap();
    said(network).split_off(before)
}

fn period(us: u32) -> Command {
    let change = Change {
        setting: Setting::PeriodUs.number(),
        value: Some(Value::Number(us)),
    };
    Command::Set([change].into_iter().collect())
}

/// The period that the board says it has, and whether its settings came from flash when it started.
fn period_of(network: &mut EmulatedNetwork) -> Option<u32> {
    ask(network, &Command::Get)
        .iter()
        .find_map(|record| match record {
            Record::Setting(SettingValue {
                setting,
                value: Value::Number(us),
                ..
            }) if *setting == Setting::PeriodUs.number() => Some(*us),
            _ => None,
        })
}

fn is_done(said: &[Record]) -> bool {
    said.iter()
        .any(|record| matches!(record, Record::Answer(answer) if answer.outcome == Outcome::Done))
}

fn last_start(network: &EmulatedNetwork) -> Option<(ResetCause, SettingsSource)> {
    let others = &network.log("board")?.others;
    others.iter().rev().find_map(|record| match record {
        Record::Boot(boot) => Some((boot.reset_cause, boot.settings)),
        _ => None,
    })
}

pub(super) fn settings_survive(firmware: &Firmware) -> Result<(), Failed> {
    for image in [&firmware.anchor, &firmware.tag] {
        let mut network = alone(image, None);
        if !is_done(&ask(&mut network, &period(23_456))) {
            return Err("the setting was not taken".into());
        }
        ask(&mut network, &Command::Reboot);
        let start = last_start(&network);
        if start != Some((ResetCause::Software, SettingsSource::Stored)) {
            return Err(format!("after the restart: {start:?}").into());
        }
        let period = period_of(&mut network);
        if period != Some(23_456) {
            return Err(format!("period {period:?}").into());
        }
    }
    Ok(())
}

pub(super) fn power_lost_anywhere(firmware: &Firmware) -> Result<(), Failed> {
    const OLD: u32 = 20_000;
    const NEW: u32 = 30_000;
    let mut network = alone(&firmware.tag, None);
    if !is_done(&ask(&mut network, &period(OLD))) {
        return Err("the setting was not taken".into());
    }
    let before = network.emulation().boards()[0].memory();
    let (mut cuts, mut old, mut new) = (0, 0, 0);
    for torn in [Torn::Untouched, Torn::Some(5), Torn::Finished] {
        for after in 0.. {
            let mut network = alone(&firmware.tag, Some(before.duplicate()));
            let cut = PowerCut { after, torn };
            network.emulation().boards()[0].flash().cut_power(cut);
            let said = ask(&mut network, &period(NEW));
            if !network.emulation().boards()[0].is_off() {
                if !is_done(&said) {
                    return Err(format!("neither cut nor done: {said:?}").into());
                }
                break;
            }
            cuts += 1;
            network.emulation().power_cycle("board");
            let now_s = network.emulation().now().as_s_f64();
            network.run_until_s(now_s + 0.05)?;
            let start = last_start(&network);
            let period = period_of(&mut network);
            match (start, period) {
                (Some((_, SettingsSource::Stored)), Some(OLD)) => old += 1,
                (Some((_, SettingsSource::Stored)), Some(NEW)) => new += 1,
                _ => {
                    return Err(format!("{torn:?} after {after}: {start:?}, {period:?}").into());
                }
            }
        }
    }
    println!("power lost at {cuts} places: {old} old, {new} new");
    if old == 0 || new == 0 {
        return Err("not all outcomes were seen".into());
    }
    Ok(())
}
