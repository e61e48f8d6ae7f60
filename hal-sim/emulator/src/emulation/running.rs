//! How time passes for boards and air together.

use nova_hal_sim::{SimDuration, SimTime};

use super::Emulation;
use crate::board::{Board, RadioRequest};
use crate::error::EmulatorError;

/// From an access to a radio until another board's radio can interrupt because of it: the sender starts up (10 us)
/// and the receiver needs some preamble (16 us and more).
const LOOK_AHEAD: SimDuration = SimDuration::from_us(20);

impl Emulation {
    /// Lets time pass until `end`, or until a board stands still for its debugger.
    ///
    /// # Errors
    /// [`EmulatorError::Stopped`] when a board did something that is not modelled.
    pub fn run_until(&mut self, end: SimTime) -> Result<(), EmulatorError> {
        loop {
            self.run_boards(end)?;
            if self.boards.iter().any(|board| board.halted().is_some()) {
                return Ok(());
            }
            if self.serve_first_request() {
                continue;
            }
            let reached = self.reached();
            if self.wake_peer(reached) {
                continue;
            }
            if reached >= end {
                self.world.advance_to(end);
                self.pass_interrupts();
                return Ok(());
            }
            if self.world.next_event_time().is_some_and(|at| at <= reached) {
                self.world.step();
                self.pass_interrupts();
            }
        }
    }

    /// Lets a peer act that has waited for this moment, if nothing else comes before.
    fn wake_peer(&mut self, reached: SimTime) -> bool {
        let event = self.world.next_event_time().unwrap_or(SimTime::MAX);
        let is_due = |at: SimTime| at <= reached && at <= event;
        let mut peers = self.peers.iter_mut();
        let due = peers.find_map(|peer| Some((peer.wakes.filter(|&at| is_due(at))?, peer)));
        let Some((at, peer)) = due else {
            return false;
        };
        self.world.advance_to(at);
        peer.serve(&mut self.world);
        self.pass_interrupts();
        true
    }

    /// The moment that all boards have reached.
    fn reached(&self) -> SimTime {
        let reached = self.boards.iter().map(|board| match board.request() {
            Some(at) => at,
            None if board.is_off() => SimTime::MAX,
            None => board.time_of(board.now()),
        });
        reached.min().unwrap_or(SimTime::MAX)
    }

    /// Every board runs as far as it may.
    fn run_boards(&mut self, end: SimTime) -> Result<(), EmulatorError> {
        let wakes = self.peers.iter().filter_map(|peer| peer.wakes);
        let next_event = wakes.chain(self.world.next_event_time());
        let next_event = next_event.min().unwrap_or(SimTime::MAX);
        let earliest: Vec<SimTime> = self.boards.iter().map(Board::earliest_request).collect();
        for (index, board) in self.boards.iter_mut().enumerate() {
            let others = earliest.iter().enumerate().filter(|&(i, _)| i != index);
            let others = others.map(|(_, &at)| at + LOOK_AHEAD).min();
            let limit = others.unwrap_or(SimTime::MAX).min(next_event).min(end);
            board.run_until(board.cycle_at(limit))?;
        }
        Ok(())
    }

    /// Does what a board wants from its radio, if no other can want anything earlier and nothing happens before.
    fn serve_first_request(&mut self) -> bool {
        let requests = self.boards.iter().enumerate();
        let requests = requests.filter_map(|(index, board)| Some((board.request()?, index)));
        let Some((at, index)) = requests.min() else {
            return false;
        };
        let others = self.boards.iter().enumerate().filter(|&(i, _)| i != index);
        let behind = others.map(|(_, board)| board.earliest_request()).min();
        let wakes = self.peers.iter().filter_map(|peer| peer.wakes);
        let event = wakes.chain(self.world.next_event_time()).min();
        if behind.is_some_and(|other| other < at) || event.is_some_and(|event| event <= at) {
            return false;
        }
        let (Some(board), Some(&chip)) = (self.boards.get_mut(index), self.chips.get(index)) else {
            return false;
        };
        match board.take_request() {
            Some(RadioRequest::Select(true)) => self.world.spi_select(chip, at),
            Some(RadioRequest::Select(false)) => self.world.spi_deselect(chip, at),
            Some(RadioRequest::Reset(low)) => {
                let held = self.held.get(index).copied().unwrap_or(false);
                self.world.set_reset(chip, at, low || held);
            }
            Some(RadioRequest::Transfer {
                id,
                mosi,
                bits_per_s,
            }) => {
                let mut miso = vec![0; mosi.len()];
                self.world
                    .spi_transfer(chip, at, bits_per_s, &mosi, &mut miso);
                board.answer(id, miso);
            }
            None => return false,
        }
        self.pass_interrupts();
        true
    }

    /// Tells boards whose radio's interrupt line has changed, and notes frames that begin.
    pub(super) fn pass_interrupts(&mut self) {
        let sending = self.boards.iter_mut().zip(&self.chips);
        for ((board, &chip), begun) in sending.zip(&mut self.begun) {
            let now = self.world.frames_begun(chip);
            if now != *begun {
                *begun = now;
                board.sends(self.world.now());
            }
        }
        for peer in &mut self.peers {
            let high = self.world.irq_level(peer.chip);
            if high && !peer.interrupts {
                peer.serve(&mut self.world);
            }
            peer.interrupts = self.world.irq_level(peer.chip);
        }
        let lines = self.boards.iter_mut().zip(&self.chips);
        for ((board, &chip), before) in lines.zip(&mut self.interrupts) {
            let high = self.world.irq_level(chip);
            if high != *before {
                *before = high;
                board.set_radio_interrupt(high);
            }
        }
    }
}
