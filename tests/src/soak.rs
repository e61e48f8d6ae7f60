//! Ranging under faults, for as long as wanted: everything that can go wrong does, and no
//! wrong range may pass for a right one.
//!
//! Two initiators and four responders in one air; every board has bad luck of its own
//! ([`Mishaps`]), the air loses, damages and repeats frames, and hosts stop reading now and
//! then. A run is cut into legs with a seed each, so that any of them can be run again alone.

use crate::network::{Network, NetworkError};
use nova_hal_sim::{
    BoardConfig, ChannelConfig, ClockConfig, MishapStats, Mishaps, Motion, SimConfig, SimDuration,
};
use nova_node::ranging::Address;
use nova_node::{NodeConfig, Part};
use nova_wire::{Counters, Range, RangeFlags, Treatment};
use std::fmt;

/// What is injected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Faults {
    /// Probability of each frame to be lost, damaged or repeated, on each way.
    pub lost: f64,
    /// See [`Faults::lost`].
    pub corrupt: f64,
    /// See [`Faults::lost`].
    pub repeated: f64,
    /// On each board.
    pub mishaps: Mishaps,
    /// One host in a leg stops reading for so long.
    pub uart_stall: SimDuration,
}

impl Faults {
    /// Everything at once.
    pub fn all() -> Self {
        Self {
            lost: 0.01,
            corrupt: 0.005,
            repeated: 0.005,
            mishaps: Mishaps {
                spi_bit_error: 1e-6,
                late_interrupt: 0.002,
                late_by: SimDuration::from_us(2_000),
                brown_outs_per_s: 0.02,
                stuck_receivers_per_s: 0.02,
            },
            // The board holds less than half a second's records.
            uart_stall: SimDuration::from_ms(2_000),
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Simulated time.
    pub simulated_s: f64,
    /// Rounds' exchanges that gave a range or failed, at the initiators.
    pub exchanges: u64,
    /// Ranges at all boards.
    pub ranges: u64,
    /// Ranges off by more than five sigma that carry a flag, or were rejected.
    pub flagged: u64,
    /// Those that do not: there must be none.
    pub silent: Vec<Wrong>,
    /// Boards that gave no range in a leg's last second: they hang. There must be none.
    pub hung: Vec<String>,
    /// Sums over all boards and legs.
    pub counters: Sums,
    /// What was injected, on boards.
    pub mishaps: MishapStats,
    /// Frames lost, damaged and repeated.
    pub air: [u64; 3],
}

/// A wrong range that passes for a right one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrong {
    /// Of the leg.
    pub seed: u64,
    /// The board's index.
    pub board: usize,
    /// What it said.
    pub range: Range,
    /// How far off, in metres.
    pub error_m: f64,
}

/// Counters by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sums(Vec<(String, u64)>);

/// Simulated time of a leg.
const LEG_S: f64 = 20.0;
/// At its end nothing goes wrong any more: who does not range again within this time hangs. A node takes five
/// seconds of silence for a deaf receiver, and starts it again within one.
const FAULT_FREE_S: f64 = 7.0;
/// Noise of each receive time stamp.
const NOISE_PS: f64 = 100.0;
/// What it makes of a range at worst: `c s / sqrt(2)`, when one reply time is much longer than the other.
const SIGMA_M: f64 = 299_702_547.0 * 1e-12 * NOISE_PS * 0.7072;

const INITIATORS: [(u16, [f64; 3], f64); 2] = [
    (0x0A, [0.0, 0.0, 0.0], 12.0),
    (0x0B, [10.0, 1.0, 0.5], -17.0),
];
const RESPONDERS: [(u16, [f64; 3], f64); 4] = [
    (0x01, [4.0, 3.0, 0.0], 20.0),
    (0x02, [6.0, -5.0, 1.0], -20.0),
    (0x03, [1.0, 8.0, 0.0], 3.0),
    (0x04, [9.0, 9.0, 2.0], -8.0),
];

/// Runs legs until so many exchanges were tried.
///
/// # Errors
/// [`NetworkError`] if a board's code panics.
pub fn run(
    exchanges: u64,
    seed: u64,
    faults: &Faults,
    mut progress: impl FnMut(&Report),
) -> Result<Report, NetworkError> {
    let mut report = Report::default();
    let mut leg_seed = seed;
    while report.exchanges < exchanges {
        leg(leg_seed, faults, &mut report)?;
        leg_seed = leg_seed.wrapping_add(1);
        progress(&report);
    }
    Ok(report)
}

fn leg(seed: u64, faults: &Faults, report: &mut Report) -> Result<(), NetworkError> {
    let mut network = Network::new(SimConfig {
        seed,
        channel: ChannelConfig {
            loss_probability: faults.lost,
            corrupt_probability: faults.corrupt,
            repeat_probability: faults.repeated,
            ..ChannelConfig::default()
        },
    });
    let places: Vec<_> = INITIATORS.iter().chain(&RESPONDERS).copied().collect();
    for (index, &(address, position, ppm)) in places.iter().enumerate() {
        let mut node = if index < INITIATORS.len() {
            NodeConfig::anchor(Address(address))
        } else {
            NodeConfig::tag(Address(address))
        };
        if let Part::Initiator { peers, .. } = &mut node.part {
            peers.extend(RESPONDERS.iter().map(|&(address, ..)| Address(address)));
        }
        let board = BoardConfig {
            name: format!("{address:#04x}"),
            clock: ClockConfig {
                offset_ticks: seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 24,
                ppm,
                drift_ppm_per_s: 0.02,
            },
            motion: Motion::fixed(position),
            rx_noise_ps: NOISE_PS,
            mishaps: faults.mishaps,
            ..BoardConfig::default()
        };
        // These settings are known to work; one that did not would show as a hung board.
        let _ = network.add(board, node);
    }
    // A different host each time.
    if let Some(id) = network.id(seed as usize % places.len()) {
        network.run_until_s(LEG_S / 3.0)?;
        let until = network.sim().now() + faults.uart_stall;
        network.sim().stall_uart(id, until);
    }
    network.run_until_s(LEG_S)?;
    network.sim().end_mishaps();
    network.run_until_s(LEG_S + FAULT_FREE_S)?;

    report.simulated_s += LEG_S + FAULT_FREE_S;
    for (index, &(address, position, _)) in places.iter().enumerate() {
        let Some(log) = network.log(index) else {
            continue;
        };
        let last_us = log.ranges.last().map_or(0, |range| range.t_us);
        if (last_us as f64) < (LEG_S + FAULT_FREE_S - 1.0) * 1e6 {
            report.hung.push(format!("{address:#04x} in leg {seed}"));
        }
        report.ranges += log.ranges.len() as u64;
        for range in &log.ranges {
            let peer = places.iter().find(|place| place.0 == range.peer);
            let error_m = peer.map_or(f64::INFINITY, |place| {
                f64::from(range.raw_m) - distance_m(place.1, position)
            });
            if error_m.abs() <= 5.0 * SIGMA_M {
                continue;
            }
            if is_flagged(range) {
                report.flagged += 1;
            } else {
                report.silent.push(Wrong {
                    seed,
                    board: index,
                    range: *range,
                    error_m,
                });
            }
        }
        if index < INITIATORS.len() {
            let c = &log.counters;
            report.exchanges += [
                c.ranges,
                c.no_response,
                c.no_report,
                c.bad_stamps,
                c.implausible,
            ]
            .iter()
            .map(|&count| u64::from(count))
            .sum::<u64>();
        }
        report.counters.add(&log.counters);
    }
    let stats = network.sim().stats();
    for (sum, more) in
        report
            .air
            .iter_mut()
            .zip([stats.air.lost, stats.air.corrupted, stats.air.repeated])
    {
        *sum += more;
    }
    for board in &stats.boards {
        report.mishaps.spi_bits += board.mishaps.spi_bits;
        report.mishaps.late_interrupts += board.mishaps.late_interrupts;
        report.mishaps.brown_outs += board.mishaps.brown_outs;
        report.mishaps.stuck_receivers += board.mishaps.stuck_receivers;
    }
    Ok(())
}

/// Whether the board itself says that the range is not to be trusted.
fn is_flagged(range: &Range) -> bool {
    range.flags.contains(RangeFlags::NLOS)
        || matches!(
            range.treatment,
            Treatment::RejectedOutlier | Treatment::RejectedNlos | Treatment::RejectedInvalid
        )
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

impl Sums {
    fn add(&mut self, counters: &Counters) {
        let Ok(table) = toml::Table::try_from(*counters) else {
            return;
        };
        for (name, value) in table {
            let more = value
                .as_integer()
                .and_then(|v| u64::try_from(v).ok())
                .unwrap_or(0);
            match self.0.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += more,
                None => self.0.push((name, more)),
            }
        }
    }

    /// The sum of this counter; 0 if there is none.
    pub fn get(&self, name: &str) -> u64 {
        self.0
            .iter()
            .find(|(known, _)| known == name)
            .map_or(0, |(_, sum)| *sum)
    }
}

impl Report {
    /// Whether nothing hung and no wrong range passed.
    pub fn passes(&self) -> bool {
        self.hung.is_empty() && self.silent.is_empty()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [lost, corrupted, repeated] = self.air;
        let m = &self.mishaps;
        writeln!(
            f,
            "{} exchanges in {:.0} s of simulated time, {} ranges on all boards",
            self.exchanges, self.simulated_s, self.ranges
        )?;
        writeln!(f, "injected:")?;
        for (what, count) in [
            ("frames lost", lost),
            ("frames damaged", corrupted),
            ("frames repeated", repeated),
            ("bits wrong on the SPI", m.spi_bits),
            ("interrupts served late", m.late_interrupts),
            ("brown-outs of the radio", m.brown_outs),
            ("receivers gone deaf", m.stuck_receivers),
        ] {
            writeln!(f, "  {count:>10} {what}")?;
        }
        writeln!(f, "counted by the boards:")?;
        for (name, sum) in &self.counters.0 {
            writeln!(f, "  {sum:>10} {name}")?;
        }
        writeln!(
            f,
            "ranges off by more than 5 sigma: {} flagged, {} not",
            self.flagged,
            self.silent.len()
        )?;
        for wrong in self.silent.iter().take(10) {
            writeln!(
                f,
                "  leg {}: board {} said {:.3} m to {:#04x}, {:+.3} m off, at {:.6} s",
                wrong.seed,
                wrong.board,
                wrong.range.raw_m,
                wrong.range.peer,
                wrong.error_m,
                wrong.range.t_us as f64 * 1e-6
            )?;
        }
        writeln!(f, "boards that hang: {}", self.hung.len())?;
        for board in self.hung.iter().take(10) {
            writeln!(f, "  {board}")?;
        }
        Ok(())
    }
}
