//! Scenarios: TOML files that say who is where, what goes wrong, and what must
//! come of it. tests/scenarios/README.md explains every key.

use crate::network::{BoardLog, Network};
use nova_hal_sim::chip::{ChipTiming, Consumption};
use nova_hal_sim::{
    BoardConfig, ChannelConfig, ClockConfig, Fault, FaultAction, LinkEffect, Motion, SimConfig,
    SimDuration, SpiTiming,
};
use nova_node::ranging::{Address, PanId};
use nova_node::{NodeConfig, Part};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A scenario as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What the scenario is about, for people.
    pub about: String,
    /// Everything random follows from this number.
    pub seed: u64,
    /// Simulated time.
    pub duration_s: f64,
    /// Probability that a receiver misses a frame.
    #[serde(default)]
    pub loss_probability: f64,
    /// The boards.
    pub board: Vec<Board>,
    /// What stands between two boards.
    #[serde(default)]
    pub link: Vec<Link>,
    /// Frames that are dropped or damaged.
    #[serde(default)]
    pub fault: Vec<FrameFault>,
    /// What must come of it.
    pub expect: Vec<Expectation>,
}

/// A board and its node.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// For the other tables.
    pub name: String,
    /// Short address.
    pub address: u16,
    /// `tag`, `anchor`, `listener` or `sleeper`, which sets the part.
    pub role: BoardRole,
    /// Where, in metres.
    pub position_m: [f64; 3],
    /// Where to, in m/s.
    #[serde(default)]
    pub velocity_m_per_s: [f64; 3],
    /// Network; the default one if absent.
    pub pan: Option<u16>,
    /// Frequency error of the crystal.
    #[serde(default)]
    pub clock_ppm: f64,
    /// Change of the frequency error.
    #[serde(default)]
    pub clock_drift_ppm_per_s: f64,
    /// The clock's reading at the start, in ticks.
    #[serde(default)]
    pub clock_offset_ticks: u64,
    /// Standard deviation of each receive time stamp.
    #[serde(default)]
    pub rx_noise_ps: f64,
    /// Anchors: from one round to the next.
    pub period_us: Option<u32>,
    /// Anchors: most peers in one round.
    pub per_round: Option<u8>,
    /// Anchors: addresses to poll; whoever is there if empty.
    #[serde(default)]
    pub peers: Vec<u16>,
    /// From a frame received to the answer sent; the firmware's if absent.
    pub reply_us: Option<u32>,
    /// Work of the processor for each SPI transaction, on top of the transfer.
    pub cpu_per_transaction_us: Option<u64>,
    /// From power-on until the board's code begins.
    pub boot_delay_ms: Option<u64>,
    /// From the order to wake until a radio that sleeps answers.
    pub wake_up_us: Option<u64>,
}

/// What a board is for.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoardRole {
    /// Answers.
    Tag,
    /// Polls.
    Anchor,
    /// Listens.
    Listener,
    /// A tag that polls, and sleeps in between.
    Sleeper,
}

/// What stands between two boards.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// The two boards' names.
    pub between: [String; 2],
    /// The detour of the first path that arrives, in metres.
    #[serde(default)]
    pub detour_m: f64,
    /// Power lost on top of the distance.
    #[serde(default)]
    pub loss_db: f64,
    /// How much the first path is below all paths together.
    #[serde(default)]
    pub first_path_loss_db: f64,
}

/// Frames that are dropped or damaged.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameFault {
    /// The sender's name.
    pub from: String,
    /// The sender's frames with these numbers, first and one past the last, from 0.
    pub frames: [u64; 2],
    /// What happens to them.
    pub action: Action,
}

/// What happens to a frame.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Action {
    /// Nobody hears it.
    Drop,
    /// It arrives with wrong bits.
    Corrupt,
}

/// What one board must say.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// The board's name.
    pub board: String,
    /// Whom its ranges are to, by name; all ranges if absent.
    pub to: Option<String>,
    /// Only ranges from this time on, in seconds of the board's own time.
    #[serde(default)]
    pub from_s: f64,
    /// Least and most ranges.
    pub ranges: [usize; 2],
    /// Most that the mean error may be, in metres.
    pub mean_error_below_m: Option<f64>,
    /// Most that any error may be, in metres.
    pub worst_error_below_m: Option<f64>,
    /// Added to the true distance before errors are taken, in metres.
    #[serde(default)]
    pub offset_m: f64,
    /// Least and most of counters, by name.
    #[serde(default)]
    pub counters: BTreeMap<String, [u32; 2]>,
    /// Flags that all these ranges must have, as a number.
    pub flags: Option<u8>,
    /// Least part of the time that the board's radio sleeps.
    pub asleep_at_least: Option<f64>,
    /// Most that the board's radio may draw on average, in microamperes.
    pub current_below_ua: Option<f64>,
}

impl Scenario {
    /// Reads a scenario.
    ///
    /// # Errors
    /// Says what is wrong and on which line.
    pub fn parse(toml: &str) -> Result<Self, String> {
        let scenario: Self = toml::from_str(toml).map_err(|error| error.to_string())?;
        scenario.check_sense()?;
        Ok(scenario)
    }

    /// Refuses what would make a scenario pass without testing anything.
    fn check_sense(&self) -> Result<(), String> {
        if !(self.duration_s > 0.0 && self.duration_s.is_finite()) {
            return Err(format!("duration_s = {} is not a time", self.duration_s));
        }
        if !(0.0..=1.0).contains(&self.loss_probability) {
            return Err(format!(
                "loss_probability = {} is not between 0 and 1",
                self.loss_probability
            ));
        }
        for (index, board) in self.board.iter().enumerate() {
            if self.index(&board.name)? != index {
                return Err(format!("two boards are called {}", board.name));
            }
            if !(board.rx_noise_ps >= 0.0 && board.rx_noise_ps.is_finite()) {
                return Err(format!(
                    "rx_noise_ps = {} of {}",
                    board.rx_noise_ps, board.name
                ));
            }
        }
        for fault in &self.fault {
            let [first, end] = fault.frames;
            if first >= end {
                return Err(format!("frames = [{first}, {end}] are no frames"));
            }
        }
        if self.expect.is_empty() {
            return Err("nothing is expected".to_owned());
        }
        Ok(())
    }

    /// Plays it through.
    ///
    /// # Errors
    /// All expectations that were not met, one a line.
    pub fn run(&self) -> Result<(), String> {
        let mut network = Network::new(SimConfig {
            seed: self.seed,
            channel: ChannelConfig {
                loss_probability: self.loss_probability,
                ..ChannelConfig::default()
            },
        });
        for board in &self.board {
            network
                .add(board.hardware(), board.node())
                .map_err(|error| format!("{}: {error}", board.name))?;
        }
        for link in &self.link {
            let [a, b] = [
                self.id(&network, &link.between[0])?,
                self.id(&network, &link.between[1])?,
            ];
            network.sim().set_link_effect(a, b, link.effect());
        }
        for fault in &self.fault {
            let from = self.id(&network, &fault.from)?;
            network.sim().add_fault(Fault {
                from,
                to: None,
                frames: fault.frames[0]..fault.frames[1],
                action: match fault.action {
                    Action::Drop => FaultAction::Drop,
                    Action::Corrupt => FaultAction::Corrupt,
                },
            });
        }
        network
            .run_until_s(self.duration_s)
            .map_err(|error| error.to_string())?;

        let ids: Vec<_> = (0..self.board.len()).map(|i| network.id(i)).collect();
        let drawn: Vec<_> = (ids.into_iter())
            .map(|id| network.sim().consumption(id?))
            .collect();
        self.check_all(
            |name| network.log(self.index(name).ok()?),
            |name| drawn.get(self.index(name).ok()?).cloned().flatten(),
        )
    }

    /// Compares what boards have said, and what their radios have drawn where that is known, with what is
    /// expected.
    ///
    /// # Errors
    /// All expectations that were not met, one a line.
    pub(crate) fn check_all<'l>(
        &self,
        log: impl Fn(&str) -> Option<&'l BoardLog>,
        drawn: impl Fn(&str) -> Option<Consumption>,
    ) -> Result<(), String> {
        let mut unmet = String::new();
        for expectation in &self.expect {
            let log = log(&expectation.board).ok_or("no log")?;
            self.check(expectation, log, &mut unmet)?;
            if let Some(drawn) = drawn(&expectation.board) {
                self.check_supply(expectation, &drawn, &mut unmet);
            }
        }
        if unmet.is_empty() { Ok(()) } else { Err(unmet) }
    }

    fn check(&self, e: &Expectation, log: &BoardLog, unmet: &mut String) -> Result<(), String> {
        let mut miss = |what: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(unmet, "{}: {what}", e.board);
        };
        let board = &self.board[self.index(&e.board)?];
        let to = match &e.to {
            Some(name) => Some(&self.board[self.index(name)?]),
            None => None,
        };
        let ranges: Vec<_> = log
            .ranges
            .iter()
            .filter(|range| to.is_none_or(|to| range.peer == to.address))
            .filter(|range| range.t_us as f64 * 1e-6 >= e.from_s)
            .collect();
        if !(e.ranges[0]..=e.ranges[1]).contains(&ranges.len()) {
            miss(format!(
                "{} ranges, not {} to {}; {:?}",
                ranges.len(),
                e.ranges[0],
                e.ranges[1],
                log.counters
            ));
        }
        if log.wire.lost + log.wire.corrupt > 0 {
            miss(format!("its serial port lost something: {:?}", log.wire));
        }
        if let Some(to) = to {
            let errors: Vec<f64> = ranges
                .iter()
                .map(|range| {
                    let t_s = board.boot_s() + range.t_us as f64 * 1e-6;
                    let distance_m = distance_m(board.at(t_s), to.at(t_s));
                    f64::from(range.raw_m) - distance_m - e.offset_m
                })
                .collect();
            let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
            if e.mean_error_below_m.is_some_and(|limit| mean.abs() > limit) {
                miss(format!("mean error {mean:.4} m"));
            }
            let worst = errors
                .iter()
                .fold(0.0_f64, |worst, error| worst.max(error.abs()));
            if e.worst_error_below_m.is_some_and(|limit| worst > limit) {
                miss(format!("worst error {worst:.4} m"));
            }
        }
        if let Some(flags) = e.flags
            && let Some(range) = ranges.iter().find(|r| r.flags.0 & flags != flags)
        {
            miss(format!("flags {:#b} instead of {flags:#b}", range.flags.0));
        }
        let counters = toml::Table::try_from(log.counters).map_err(|error| error.to_string())?;
        for (name, [least, most]) in &e.counters {
            let count = counters
                .get(name)
                .and_then(toml::Value::as_integer)
                .ok_or_else(|| format!("there is no counter called {name}"))?;
            if !(i64::from(*least)..=i64::from(*most)).contains(&count) {
                miss(format!("{name} is {count}, not {least} to {most}"));
            }
        }
        Ok(())
    }

    fn check_supply(&self, e: &Expectation, drawn: &Consumption, unmet: &mut String) {
        let asleep = drawn.asleep.as_s_f64() / self.duration_s;
        let current_ua = drawn.charge_ua_s / self.duration_s;
        if e.asleep_at_least.is_some_and(|least| asleep < least)
            || e.current_below_ua.is_some_and(|most| current_ua > most)
        {
            let _ = writeln!(
                unmet,
                "{}: its radio slept {:.2} % of the time and drew {current_ua:.1} uA",
                e.board,
                100.0 * asleep
            );
        }
    }

    fn index(&self, name: &str) -> Result<usize, String> {
        self.board
            .iter()
            .position(|board| board.name == name)
            .ok_or_else(|| format!("there is no board called {name}"))
    }

    fn id(&self, network: &Network, name: &str) -> Result<nova_hal_sim::BoardId, String> {
        network
            .id(self.index(name)?)
            .ok_or_else(|| format!("there is no board called {name}"))
    }
}

impl Board {
    fn at(&self, t_s: f64) -> [f64; 3] {
        let [x, y, z] = self.position_m;
        let [vx, vy, vz] = self.velocity_m_per_s;
        [x + vx * t_s, y + vy * t_s, z + vz * t_s]
    }

    /// When the board's own time begins.
    fn boot_s(&self) -> f64 {
        self.hardware().boot_delay.as_s_f64()
    }

    pub(crate) fn hardware(&self) -> BoardConfig {
        let (position, velocity) = (self.position_m, self.velocity_m_per_s);
        let motion = Motion::path(move |t_s| {
            let [x, y, z] = position;
            let [vx, vy, vz] = velocity;
            [x + vx * t_s, y + vy * t_s, z + vz * t_s]
        });
        let default = BoardConfig::default();
        BoardConfig {
            name: self.name.clone(),
            clock: ClockConfig {
                offset_ticks: self.clock_offset_ticks,
                ppm: self.clock_ppm,
                drift_ppm_per_s: self.clock_drift_ppm_per_s,
            },
            motion,
            rx_noise_ps: self.rx_noise_ps,
            chip_timing: ChipTiming {
                wake_up: (self.wake_up_us)
                    .map_or(default.chip_timing.wake_up, SimDuration::from_us),
                ..default.chip_timing
            },
            boot_delay: self
                .boot_delay_ms
                .map_or(default.boot_delay, SimDuration::from_ms),
            spi: SpiTiming {
                before: default.spi.before
                    + SimDuration::from_us(self.cpu_per_transaction_us.unwrap_or(0)),
                ..default.spi
            },
            ..default
        }
    }

    fn node(&self) -> NodeConfig {
        let address = Address(self.address);
        let mut config = match self.role {
            BoardRole::Tag => NodeConfig::tag(address),
            BoardRole::Anchor => NodeConfig::anchor(address),
            BoardRole::Listener => NodeConfig::listener(address),
            BoardRole::Sleeper => NodeConfig::sleeper(address),
        };
        config.reply_us = self.reply_us;
        if let Some(pan) = self.pan {
            config.identity.pan = PanId(pan);
        }
        if let Part::Initiator {
            period_us,
            per_round,
            peers,
            ..
        } = &mut config.part
        {
            *period_us = self.period_us.unwrap_or(*period_us);
            *per_round = self.per_round.unwrap_or(*per_round);
            peers.extend(self.peers.iter().map(|&peer| Address(peer)));
        }
        config
    }
}

impl Link {
    pub(crate) fn effect(&self) -> LinkEffect {
        LinkEffect {
            extra_delay_ps: self.detour_m / ChannelConfig::default().speed_m_per_s * 1e12,
            loss_db: self.loss_db,
            first_path_loss_db: self.first_path_loss_db,
        }
    }
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}
