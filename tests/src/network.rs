//! A network of simulated boards.

use nova_cli::sim_node;
use nova_hal_sim::{
    BoardConfig, BoardId, ClockConfig, Motion, SimConfig, SimError, SimTime, Simulation,
};
use nova_node::ranging::Address;
use nova_node::{ConfigError, NodeConfig, Part, Sharing};
use nova_wire::{
    Counters, Decoder, Event, Overheard, OverheardInterval, Range, Record, Statistics,
};

/// Boards in one air, each running the firmware's node.
pub struct Network {
    sim: Simulation,
    boards: Vec<(BoardId, Decoder, BoardLog)>,
}

/// What one board's serial port has said so far.
#[derive(Clone, Debug, Default)]
pub struct BoardLog {
    /// Every byte.
    pub bytes: Vec<u8>,
    /// Every range.
    pub ranges: Vec<Range>,
    /// Every frame overheard.
    pub overheard: Vec<Overheard>,
    /// Every interval overheard.
    pub intervals: Vec<OverheardInterval>,
    /// Everything else that is no status: starts, answers.
    pub others: Vec<Record>,
    /// The counters of the last status record.
    pub counters: Counters,
    /// What the decoder counted.
    pub wire: Statistics,
}

/// A board at rest `x_m` along the first axis, its crystal so many ppm fast.
pub fn board_at(name: &str, x_m: f64, ppm: f64) -> BoardConfig {
    BoardConfig {
        name: name.to_owned(),
        clock: ClockConfig {
            ppm,
            ..ClockConfig::default()
        },
        motion: Motion::fixed([x_m, 0.0, 0.0]),
        ..BoardConfig::default()
    }
}

/// An anchor with address 1 that polls `tag` alone every `period_us`.
pub fn anchor_polling(tag: Address, period_us: u32) -> NodeConfig {
    NodeConfig {
        part: Part::Initiator {
            period_us,
            per_round: 1,
            peers: [tag].into_iter().collect(),
            sharing: Sharing::Elect,
            sleep: false,
        },
        ..NodeConfig::anchor(Address(1))
    }
}

/// A simulated board's code stopped.
pub type NetworkError = SimError;

impl Network {
    /// A network without boards.
    pub fn new(config: SimConfig) -> Self {
        Self {
            sim: Simulation::new(config),
            boards: Vec::new(),
        }
    }

    /// Adds a board that runs a node; returns its index.
    ///
    /// # Errors
    /// A setting of the node that cannot work.
    pub fn add(&mut self, board: BoardConfig, node: NodeConfig) -> Result<usize, ConfigError> {
        let id = sim_node::add(&mut self.sim, board, node)?;
        self.boards.push((id, Decoder::new(), BoardLog::default()));
        Ok(self.boards.len() - 1)
    }

    /// The simulation underneath, for faults and links.
    pub fn sim(&mut self) -> &mut Simulation {
        &mut self.sim
    }

    /// The simulated board of this index.
    pub fn id(&self, board: usize) -> Option<BoardId> {
        self.boards.get(board).map(|(id, _, _)| *id)
    }

    /// Runs until `t_s` seconds after the start.
    ///
    /// # Errors
    /// [`NetworkError`] if a board's code panics.
    pub fn run_until_s(&mut self, t_s: f64) -> Result<(), NetworkError> {
        // In steps, so that serial ports are read before they fill memory.
        let mut now_s = self.sim.now().as_s_f64();
        while now_s < t_s {
            now_s = (now_s + 1.0).min(t_s);
            self.sim.run_until(SimTime::from_s_f64(now_s))?;
            for (id, decoder, log) in &mut self.boards {
                for chunk in self.sim.uart(*id) {
                    log.take(&chunk.bytes, decoder);
                }
            }
        }
        Ok(())
    }

    /// What the board of this index has said.
    pub fn log(&self, board: usize) -> Option<&BoardLog> {
        self.boards.get(board).map(|(_, _, log)| log)
    }
}

impl BoardLog {
    pub(crate) fn take(&mut self, bytes: &[u8], decoder: &mut Decoder) {
        self.bytes.extend_from_slice(bytes);
        for event in bytes.iter().filter_map(|&b| decoder.push(b)) {
            match event {
                Event::Record {
                    record: Record::Range(range),
                    ..
                } => self.ranges.push(range),
                Event::Record {
                    record: Record::Status(status),
                    ..
                } => self.counters = status.counters,
                Event::Record {
                    record: Record::Overheard(overheard),
                    ..
                } => self.overheard.push(overheard),
                Event::Record {
                    record: Record::OverheardInterval(interval),
                    ..
                } => self.intervals.push(interval),
                Event::Record { record, .. } => self.others.push(record),
                Event::Trouble(_) => {}
            }
        }
        self.wire = *decoder.statistics();
    }
}
