//! What the boards did, for people and as JSON.

use nova_emulator::{BoardStats, CPU_HZ};
use nova_tests::{BoardLog, EmulatedNetwork};
use serde_json::{Value, json};
use std::io::Write;

/// What is printed at the end.
pub(crate) struct Report {
    pub(crate) emulated_s: f64,
    pub(crate) wall_s: f64,
}

/// Ranges a second from the first to the last.
fn rate_hz(log: &BoardLog) -> f64 {
    match (log.ranges.first(), log.ranges.last()) {
        (Some(first), Some(last)) if last.t_us > first.t_us => {
            (log.ranges.len() - 1) as f64 / ((last.t_us - first.t_us) as f64 * 1e-6)
        }
        _ => 0.0,
    }
}

fn us(cycles: u64, count: u64) -> f64 {
    cycles as f64 / count.max(1) as f64 * 1e6 / CPU_HZ as f64
}

impl Report {
    pub(crate) fn print(
        &self,
        network: &mut EmulatedNetwork,
        log_lines: bool,
        out: &mut impl Write,
    ) -> std::io::Result<()> {
        writeln!(
            out,
            "{} s emulated in {:.2} s: {:.2} times as fast as real",
            self.emulated_s,
            self.wall_s,
            self.emulated_s / self.wall_s
        )?;
        for name in names(network) {
            let (Some(stats), Some(log)) = (network.stats(&name), network.log(&name)) else {
                continue;
            };
            let BoardStats { replies, .. } = stats;
            let asleep = 1.0 - stats.busy_cycles as f64 / stats.cycles.max(1) as f64;
            writeln!(out, "\n{name}")?;
            writeln!(
                out,
                "  ranges        {} ({:.1} a second)",
                log.ranges.len(),
                rate_hz(log)
            )?;
            writeln!(out, "  instructions  {}", stats.instructions)?;
            writeln!(out, "  asleep        {:.1} %", 100.0 * asleep)?;
            writeln!(
                out,
                "  interrupts    {:?} (number: times)",
                stats.interrupts
            )?;
            writeln!(
                out,
                "  SPI           {} bytes in {} transfers",
                stats.spi_bytes, stats.transfers
            )?;
            writeln!(
                out,
                "  answers       {}: latency {:.1} us, SPI {:.1} us, processor {:.1} us, radio {:.1} us",
                replies.count,
                us(replies.latency, replies.count),
                us(replies.spi, replies.count),
                us(replies.processor, replies.count),
                us(replies.radio, replies.count),
            )?;
            writeln!(
                out,
                "  resets        {:?}",
                stats.resets.iter().map(|(_, why)| why).collect::<Vec<_>>()
            )?;
            writeln!(out, "  counters      {}", nonzero(log))?;
            if let Some(radio) = network.emulation().chip_stats(&name) {
                writeln!(
                    out,
                    "  frames        {} sent, {} received, {} late",
                    radio.frames_sent, radio.frames_good, radio.late_commands
                )?;
            }
            if let Some(board) = network.emulation().board(&name) {
                writeln!(out, "  stands at     {:#010x}", board.program_counter())?;
            }
            if let Some(stack) = stack(network, &name) {
                writeln!(
                    out,
                    "  stack         {} of {} bytes",
                    stack.high_water, stack.size
                )?;
            }
            let lines = network.lines(&name).unwrap_or_default();
            writeln!(out, "  log           {} lines", lines.len())?;
            for line in lines.iter().filter(|_| log_lines) {
                writeln!(out, "    {} {:5} {}", line.time, line.level, line.text)?;
            }
        }
        Ok(())
    }

    pub(crate) fn to_json(&self, network: &mut EmulatedNetwork) -> Value {
        let mut boards = serde_json::Map::new();
        for name in names(network) {
            let (Some(stats), Some(log)) = (network.stats(&name), network.log(&name)) else {
                continue;
            };
            let replies = stats.replies;
            let interrupts: serde_json::Map<String, Value> = stats
                .interrupts
                .iter()
                .map(|(number, count)| (number.to_string(), json!(count)))
                .collect();
            let resets: Vec<String> = stats
                .resets
                .iter()
                .map(|(_, why)| format!("{why:?}").to_lowercase())
                .collect();
            let lines = network.lines(&name).unwrap_or_default();
            let mut board = json!({
                "ranges": log.ranges.len(),
                "range_rate_hz": rate_hz(log),
                "instructions": stats.instructions,
                "cycles": stats.cycles,
                "busy_cycles": stats.busy_cycles,
                "interrupts": interrupts,
                "spi_transfers": stats.transfers,
                "spi_bytes": stats.spi_bytes,
                "resets": resets,
                "answers": {
                    "count": replies.count,
                    "latency_us": us(replies.latency, replies.count),
                    "spi_us": us(replies.spi, replies.count),
                    "processor_us": us(replies.processor, replies.count),
                    "radio_us": us(replies.radio, replies.count),
                },
                "counters": serde_json::to_value(log.counters).unwrap_or_default(),
                "log": lines.iter().map(|line| json!({
                    "time": line.time, "level": line.level, "text": line.text,
                })).collect::<Vec<_>>(),
            });
            if let Some(stack) = stack(network, &name) {
                board["stack"] = json!({ "size": stack.size, "high_water": stack.high_water });
            }
            boards.insert(name, board);
        }
        json!({ "emulated_s": self.emulated_s, "wall_s": self.wall_s, "boards": boards })
    }
}

/// The counters that have counted anything.
fn nonzero(log: &BoardLog) -> String {
    let counters = serde_json::to_value(log.counters).unwrap_or_default();
    let all = counters.as_object().into_iter().flatten();
    let counted: Vec<String> = all
        .filter(|(_, count)| count.as_u64() != Some(0))
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    if counted.is_empty() {
        "all zero, or not reported yet".to_owned()
    } else {
        counted.join(", ")
    }
}

fn names(network: &mut EmulatedNetwork) -> Vec<String> {
    let boards = network.emulation().boards().iter();
    boards.map(|board| board.name().to_owned()).collect()
}

fn stack(network: &mut EmulatedNetwork, name: &str) -> Option<nova_emulator::StackUse> {
    network.emulation().board(name)?.stack_use()
}
