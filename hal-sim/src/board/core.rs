//! What the boards share with the scheduler: the world, and what each board waits for.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;

use crate::clock::McuClock;
use crate::coroutine::PausePoint;
use crate::flash::Flash;
use crate::time::{SimDuration, SimTime};
use crate::world::{ChipId, World};

use super::config::{BoardConfig, SpiTiming};
use super::mishaps::{Befalls, Luck, MishapStats};
use super::uart::UartState;

/// Shared by the scheduler and all HAL handles. Borrowed for single steps only, never across a pause.
#[derive(Debug)]
pub(crate) struct Core {
    pub(crate) world: World,
    pub(crate) boards: Vec<BoardState>,
    /// The board whose code is running.
    pub(crate) running: Option<ChipId>,
}

#[derive(Debug)]
pub(crate) struct BoardState {
    pub(crate) name: String,
    pub(crate) wait: Wait,
    pub(crate) finished: bool,
    pub(crate) uart: UartState,
    pub(crate) flash: Flash,
    pub(super) mcu: McuClock,
    irq_latency: SimDuration,
    spi: SpiTiming,
    spi_hz: u32,
    luck: Luck,
    /// Time that the code has used up but that has not passed yet.
    debt: SimDuration,
}

/// What a paused board waits for.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Wait {
    Until(SimTime),
    /// The IRQ pin high, but no longer than this.
    IrqUntil(SimTime),
    /// The same, or bytes from the host.
    EventUntil(SimTime),
}

/// Every HAL call takes at least this long, so that a polling loop lets time pass.
const CALL_COST: SimDuration = SimDuration::from_ns(100);

impl BoardState {
    pub(crate) fn new(config: &BoardConfig, seed: u64, index: u64) -> Self {
        let boot = SimTime::ZERO + config.boot_delay;
        BoardState {
            name: config.name.clone(),
            wait: Wait::Until(boot),
            finished: false,
            uart: UartState::new(config.uart),
            flash: config.flash.clone(),
            mcu: McuClock::new(boot, config.mcu_ppm),
            irq_latency: config.irq_latency,
            spi: config.spi,
            spi_hz: config.spi.initial_hz,
            luck: Luck::new(config.mishaps, seed, index),
            debt: SimDuration::ZERO,
        }
    }

    /// Nothing goes wrong from now on.
    pub(crate) fn end_mishaps(&mut self) {
        self.luck.end();
    }

    /// What went wrong so far.
    pub(crate) fn mishaps(&self) -> MishapStats {
        self.luck.stats
    }
}

impl Core {
    /// When `board` is to run next, given the present state of the world.
    pub(crate) fn due(&self, board: ChipId) -> Option<SimTime> {
        let state = self.boards.get(board.0).filter(|state| !state.finished)?;
        Some(match state.wait {
            Wait::Until(t) => t,
            Wait::IrqUntil(_) | Wait::EventUntil(_) if self.world.irq_level(board) => {
                self.world.now()
            }
            Wait::IrqUntil(t) => t,
            Wait::EventUntil(t) => match state.uart.idle_after_bytes() {
                Some(idle) => t.min(idle.max(self.world.now())),
                None => t,
            },
        })
    }
}

/// One board's access to the core. All of it does nothing unless the board's own code is running: handles that
/// escaped to another board, or destructors run when the simulation is dropped, must not move time.
#[derive(Clone)]
pub(crate) struct Port {
    board: ChipId,
    core: Rc<RefCell<Core>>,
    pause: PausePoint,
}

impl Port {
    pub(crate) fn new(board: ChipId, core: Rc<RefCell<Core>>, pause: PausePoint) -> Self {
        Port { board, core, pause }
    }

    /// The core, if this board's code is running and not unwinding.
    fn core(&self) -> Option<RefMut<'_, Core>> {
        let core = self.core.try_borrow_mut().ok()?;
        (core.running == Some(self.board) && !std::thread::panicking()).then_some(core)
    }

    /// Acts on this board's state; `None` when its code is not running.
    pub(crate) fn with_board<R>(
        &self,
        act: impl FnOnce(&mut BoardState, SimTime) -> R,
    ) -> Option<R> {
        let mut core = self.core()?;
        let now = core.world.now();
        core.boards
            .get_mut(self.board.0)
            .map(|state| act(state, now))
    }

    fn with_world<R>(&self, act: impl FnOnce(&mut World, SimTime) -> R) -> Option<R> {
        let mut core = self.core()?;
        let now = core.world.now();
        Some(act(&mut core.world, now))
    }

    /// Adds to the time that the code has used.
    pub(crate) fn charge(&self, cost: SimDuration) {
        self.with_board(|board, _| board.debt += cost);
    }

    /// Lets pass what the code has used and `more`.
    pub(crate) fn pass(&self, more: SimDuration) {
        let pausing = self.with_board(|board, now| {
            let until = now + std::mem::take(&mut board.debt) + more;
            board.wait = Wait::Until(until);
            until > now
        });
        if pausing == Some(true) {
            self.pause.pause();
        }
    }

    /// A scheduling point with the least cost.
    pub(crate) fn call(&self) {
        self.pass(CALL_COST);
    }

    /// Sleeps until the processor's clock shows `us`.
    pub(crate) fn sleep_until_us(&self, us: u64) {
        self.call();
        let pausing = self.with_board(|board, now| {
            let until = board.mcu.time_of(us);
            board.wait = Wait::Until(until);
            until > now
        });
        if pausing == Some(true) {
            self.pause.pause();
        }
    }

    /// Waits for the IRQ pin; whether it is high in the end.
    pub(crate) fn wait_irq_until_us(&self, us: u64) -> bool {
        self.wait(us, Wait::IrqUntil)
    }

    /// Waits for the IRQ pin or bytes from the host; whether the pin is high in the end.
    pub(crate) fn wait_event_until_us(&self, us: u64) -> bool {
        self.wait(us, Wait::EventUntil)
    }

    fn wait(&self, us: u64, how: fn(SimTime) -> Wait) -> bool {
        self.call();
        let already_high = self.irq();
        let pausing = self.with_board(|board, now| {
            let until = board.mcu.time_of(us);
            board.wait = how(until);
            !already_high && until > now
        });
        if pausing != Some(true) {
            return already_high;
        }
        self.pause.pause();
        let high = self.irq();
        if high {
            self.with_board(|board, _| board.debt += board.irq_latency + board.luck.lateness());
            self.pass(SimDuration::ZERO);
        }
        high
    }

    pub(crate) fn now_us(&self) -> u64 {
        self.call();
        self.with_board(|board, now| board.mcu.us_at(now))
            .unwrap_or(0)
    }

    pub(crate) fn irq(&self) -> bool {
        self.with_world(|world, _| world.irq_level(self.board))
            .unwrap_or(false)
    }

    pub(crate) fn set_reset(&self, low: bool) {
        self.call();
        self.with_world(|world, now| world.set_reset(self.board, now, low));
    }

    pub(crate) fn set_spi_hz(&self, hz: u32) {
        self.with_board(|board, _| board.spi_hz = hz);
    }

    pub(crate) fn select(&self) {
        let before = self.with_board(|board, _| board.spi.before);
        self.pass(before.unwrap_or_default());
        match self
            .with_board(|board, now| board.luck.befalls(now))
            .flatten()
        {
            Some(Befalls::BrownOut) => {
                self.with_world(|world, now| world.brown_out(self.board, now));
            }
            Some(Befalls::StuckReceiver) => {
                self.with_world(|world, now| world.stick_receiver(self.board, now));
            }
            None => {}
        }
        self.with_world(|world, now| world.spi_select(self.board, now));
    }

    pub(crate) fn transfer(&self, mosi: &[u8], miso: &mut [u8]) {
        self.pass(SimDuration::ZERO);
        let hz = self.with_board(|board, _| board.spi_hz).unwrap_or(1);
        let mut sent = mosi.to_vec();
        self.with_board(|board, _| board.luck.damage(&mut sent));
        self.with_world(|world, now| world.spi_transfer(self.board, now, hz, &sent, miso));
        self.with_board(|board, _| board.luck.damage(miso));
        self.charge(SimDuration::of_bits(8 * mosi.len() as u64, hz));
    }

    pub(crate) fn deselect(&self) {
        self.pass(SimDuration::ZERO);
        self.with_world(|world, now| world.spi_deselect(self.board, now));
        self.with_board(|board, _| board.debt += board.spi.after);
    }
}
