//! Boards in a world: the scheduler.
//!
//! Each board's code is a coroutine. The board that is due first runs next (the lower index on a tie), after every
//! chip event up to and including that moment; it runs until its next HAL call that takes time. Time therefore moves
//! only when all boards have said what they wait for, and nothing depends on the speed of the machine.

use std::cell::RefCell;
use std::fmt;
use std::rc::Rc;

use crate::air::{ChannelConfig, Fault, LinkEffect};
use crate::board::{BoardConfig, BoardHal, BoardState, Core, MishapStats, Port, UartChunk};
use crate::chip::{ChipConfig, ChipStats, Consumption};
use crate::coroutine::{BoardCode, Outcome, PausePoint};
use crate::error::SimError;
use crate::time::{SimDuration, SimTime};
use crate::world::{AirStats, ChipId, World};

/// A board is known by its chip.
pub type BoardId = ChipId;

/// What all boards share.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SimConfig {
    /// Equal seeds give identical runs.
    pub seed: u64,
    /// The medium.
    pub channel: ChannelConfig,
}

/// Boards, chips and air in virtual time.
pub struct Simulation {
    core: Rc<RefCell<Core>>,
    codes: Vec<Code>,
    seed: u64,
}

/// A board's code before, while and after it runs.
enum Code {
    Boot {
        main: Box<dyn FnOnce()>,
        pause: PausePoint,
        stack_bytes: usize,
    },
    Running(BoardCode),
    Ended,
}

/// Counts of everything that happened so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SimStats {
    /// On the air.
    pub air: AirStats,
    /// On each board, by index.
    pub boards: Vec<BoardStats>,
}

/// Counts of what happened on one board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoardStats {
    /// The board's name.
    pub name: String,
    /// Its code has returned or panicked.
    pub finished: bool,
    /// Bytes that its UART had no room for.
    pub uart_overflow_bytes: u64,
    /// In its DW1000.
    pub chip: ChipStats,
    /// What went wrong at random.
    pub mishaps: MishapStats,
}

impl Simulation {
    /// A simulation without boards at time zero.
    pub fn new(config: SimConfig) -> Self {
        Simulation {
            core: Rc::new(RefCell::new(Core {
                world: World::new(config.seed, config.channel),
                boards: Vec::new(),
                running: None,
            })),
            codes: Vec::new(),
            seed: config.seed,
        }
    }

    /// Adds a board whose firmware is `main`. Boards are to be added before the simulation runs.
    pub fn add_board(
        &mut self,
        config: BoardConfig,
        main: impl FnOnce(BoardHal) + 'static,
    ) -> BoardId {
        let mut core = self.core.borrow_mut();
        let index = core.boards.len() as u64;
        core.boards.push(BoardState::new(&config, self.seed, index));
        let id = core.world.add_chip(ChipConfig {
            clock: config.clock,
            motion: config.motion,
            tx_antenna_delay_ticks: config.tx_antenna_delay_ticks,
            rx_antenna_delay_ticks: config.rx_antenna_delay_ticks,
            rx_noise_ps: config.rx_noise_ps,
            otp: config.otp,
            timing: config.chip_timing,
            quirks: config.quirks,
            supply_currents: config.supply_currents,
        });
        drop(core);
        let pause = PausePoint::default();
        let hal = BoardHal::new(Port::new(id, Rc::clone(&self.core), pause.clone()));
        self.codes.push(Code::Boot {
            main: Box::new(move || main(hal)),
            pause,
            stack_bytes: config.stack_bytes,
        });
        id
    }

    /// Runs until `end`; events and boards due exactly then are included. Boards whose code has returned are done.
    ///
    /// # Errors
    /// [`SimError`] as soon as a board panics; the simulation can be run on without it.
    pub fn run_until(&mut self, end: SimTime) -> Result<(), SimError> {
        loop {
            let (board, event) = {
                let core = self.core.borrow();
                let due = (0..core.boards.len())
                    .filter_map(|i| Some((core.due(ChipId(i))?, i)))
                    .min();
                (due, core.world.next_event_time())
            };
            match (board, event) {
                (board, Some(at)) if at <= end && board.is_none_or(|(due, _)| at <= due) => {
                    self.core.borrow_mut().world.step();
                }
                (Some((due, index)), _) if due <= end => self.run_board(index, due)?,
                _ => {
                    self.core.borrow_mut().world.advance_to(end);
                    return Ok(());
                }
            }
        }
    }

    /// Runs for a span of time; see [`Simulation::run_until`].
    ///
    /// # Errors
    /// [`SimError`] as soon as a board panics.
    pub fn run_for(&mut self, span: SimDuration) -> Result<(), SimError> {
        self.run_until(self.now() + span)
    }

    fn run_board(&mut self, index: usize, due: SimTime) -> Result<(), SimError> {
        {
            let mut core = self.core.borrow_mut();
            core.world.advance_to(due);
            core.running = Some(ChipId(index));
        }
        let outcome = self.resume(index);
        self.core.borrow_mut().running = None;
        match outcome {
            Ok(Outcome::Paused) => Ok(()),
            Ok(Outcome::Finished) => {
                self.end(index);
                Ok(())
            }
            Ok(Outcome::Panicked(message)) => Err(SimError::BoardPanicked {
                board: self.end(index),
                message,
            }),
            Err(source) => Err(SimError::NoStack {
                board: self.end(index),
                source,
            }),
        }
    }

    fn resume(&mut self, index: usize) -> std::io::Result<Outcome> {
        let Some(code) = self.codes.get_mut(index) else {
            return Ok(Outcome::Finished);
        };
        if let Code::Boot { .. } = code
            && let Code::Boot {
                main,
                pause,
                stack_bytes,
            } = std::mem::replace(code, Code::Ended)
        {
            *code = Code::Running(BoardCode::new(stack_bytes, pause, main)?);
        }
        Ok(match code {
            Code::Running(running) => running.resume(),
            _ => Outcome::Finished,
        })
    }

    /// Marks a board's code as ended and returns the board's name.
    fn end(&mut self, index: usize) -> String {
        if let Some(code) = self.codes.get_mut(index) {
            *code = Code::Ended;
        }
        let mut core = self.core.borrow_mut();
        core.boards
            .get_mut(index)
            .map_or_else(String::new, |board| {
                board.finished = true;
                board.name.clone()
            })
    }

    /// The present moment.
    pub fn now(&self) -> SimTime {
        self.core.borrow().world.now()
    }

    /// Whether all boards' code has returned.
    pub fn all_finished(&self) -> bool {
        self.core.borrow().boards.iter().all(|board| board.finished)
    }

    /// Takes what the host has received from a board since the last call.
    pub fn uart(&mut self, board: BoardId) -> Vec<UartChunk> {
        let mut core = self.core.borrow_mut();
        let now = core.world.now();
        core.boards
            .get_mut(board.0)
            .map(|board| board.uart.drain(now))
            .unwrap_or_default()
    }

    /// Sends bytes from the host to a board, from now on as fast as the line goes.
    pub fn uart_send(&mut self, board: BoardId, bytes: &[u8]) {
        let mut core = self.core.borrow_mut();
        let now = core.world.now();
        if let Some(board) = core.boards.get_mut(board.0) {
            board.uart.send(now, bytes);
        }
    }

    /// True distance between two boards at `t`, in metres.
    pub fn true_distance_m(&self, a: BoardId, b: BoardId, t: SimTime) -> f64 {
        self.core.borrow().world.true_distance_m(a, b, t)
    }

    /// What a board's DW1000 has drawn from its supply so far.
    pub fn consumption(&self, board: BoardId) -> Option<Consumption> {
        self.core.borrow().world.consumption(board)
    }

    /// Adds scripted damage to frames.
    pub fn add_fault(&mut self, fault: Fault) {
        self.core.borrow_mut().world.add_fault(fault);
    }

    /// From now on nothing goes wrong on any board, nor on the air beyond its [`ChannelConfig`]. What has gone
    /// wrong stays so.
    pub fn end_mishaps(&mut self) {
        let mut core = self.core.borrow_mut();
        core.boards.iter_mut().for_each(BoardState::end_mishaps);
    }

    /// The host takes nothing from a board's UART until `until`; what does not fit its buffer is lost.
    pub fn stall_uart(&mut self, board: BoardId, until: SimTime) {
        let mut core = self.core.borrow_mut();
        if let Some(board) = core.boards.get_mut(board.0) {
            board.uart.stall(until);
        }
    }

    /// Drops the next `count` frames that a board sends.
    pub fn drop_next(&mut self, from: BoardId, count: u64) {
        let mut core = self.core.borrow_mut();
        let first = core.world.frames_begun(from);
        core.world.add_fault(Fault {
            frames: first..first.saturating_add(count),
            ..Fault::drop_nth(from, first)
        });
    }

    /// Puts something between two boards from now on, or takes it away with the default.
    pub fn set_link_effect(&mut self, a: BoardId, b: BoardId, effect: LinkEffect) {
        self.core.borrow_mut().world.set_link_effect(a, b, effect);
    }

    /// Counts of everything so far.
    pub fn stats(&self) -> SimStats {
        let core = self.core.borrow();
        let boards = core.boards.iter().enumerate().map(|(i, board)| BoardStats {
            name: board.name.clone(),
            finished: board.finished,
            uart_overflow_bytes: board.uart.overflow_bytes,
            chip: core.world.chip_stats(ChipId(i)),
            mishaps: board.mishaps(),
        });
        SimStats {
            air: core.world.air_stats(),
            boards: boards.collect(),
        }
    }
}

impl fmt::Debug for Simulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Simulation")
            .field("core", &self.core)
            .finish_non_exhaustive()
    }
}
