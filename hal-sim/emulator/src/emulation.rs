//! Several boards in one air.
//!
//! ```text
//!   board ──SPI, reset──► World (chips and air of hal-sim) ──interrupt line──► board
//! ```
//! Boards run ahead of one another, but never so far that one could miss what another's radio does to its own: a
//! radio that is told to send needs [`LOOK_AHEAD`] before anybody can notice. What boards want from their radios is
//! served in the order of true time, and the air never passes a board that may still want something earlier. So every
//! result is the same whatever the order of the boards.

use nova_hal_sim::chip::{ChipConfig, ChipStats};
use nova_hal_sim::world::{AirStats, ChipId};
use nova_hal_sim::{ChannelConfig, Fault, LinkEffect, SimDuration, SimTime, World};

use crate::board::{Board, BoardConfig, RadioRequest};
use crate::error::EmulatorError;
use crate::image::Image;
use crate::peer::{Peer, PeerRadio};

/// From an access to a radio until another board's radio can interrupt because of it: the sender starts up (10 us)
/// and the receiver needs some preamble (16 us and more).
const LOOK_AHEAD: SimDuration = SimDuration::from_us(20);

/// Boards and the air between them.
pub struct Emulation {
    world: World,
    /// By name, so that the order in which they were given does not count.
    boards: Vec<Board>,
    chips: Vec<ChipId>,
    interrupts: Vec<bool>,
    /// Frames that each radio had begun when last looked at.
    begun: Vec<u64>,
    /// Whether somebody holds this radio in reset.
    held: Vec<bool>,
    peers: Vec<PeerState>,
}

struct PeerState {
    chip: ChipId,
    peer: Box<dyn Peer>,
    wakes: Option<SimTime>,
    interrupts: bool,
}

/// A radio has started by then.
const RADIO_STARTED: SimTime = SimTime::from_ms(5);

impl PeerState {
    fn serve(&mut self, world: &mut World) {
        let mut radio = PeerRadio::new(world, self.chip);
        let wait = self.peer.serve(&mut radio);
        self.wakes = wait.map(|wait| world.now() + wait);
    }
}

impl Emulation {
    /// Boards that are switched on at time zero, each with its firmware.
    ///
    /// # Errors
    /// Two boards with one name; an image that does not fit the chip.
    pub fn new(
        seed: u64,
        channel: ChannelConfig,
        boards: Vec<(BoardConfig, Image)>,
    ) -> Result<Self, EmulatorError> {
        let mut sorted = boards;
        sorted.sort_by(|(a, _), (b, _)| a.name.cmp(&b.name));
        let mut emulation = Emulation {
            world: World::new(seed, channel),
            boards: Vec::new(),
            chips: Vec::new(),
            interrupts: Vec::new(),
            begun: Vec::new(),
            held: Vec::new(),
            peers: Vec::new(),
        };
        for (config, image) in sorted {
            if emulation.board(&config.name).is_some() {
                return Err(EmulatorError::SameName(config.name));
            }
            let BoardConfig {
                name,
                identity,
                chip,
                mcu_ppm,
                boot_delay,
                memory,
            } = config;
            emulation.chips.push(emulation.world.add_chip(chip));
            let board = Board::new(name, identity, mcu_ppm, boot_delay, memory, image)?;
            emulation.boards.push(board);
            emulation.interrupts.push(false);
            emulation.begun.push(0);
            emulation.held.push(false);
        }
        Ok(emulation)
    }

    /// Adds a radio without a board. To be called before time moves.
    pub fn add_peer(&mut self, chip: ChipConfig, peer: Box<dyn Peer>) {
        self.peers.push(PeerState {
            chip: self.world.add_chip(chip),
            peer,
            wakes: Some(RADIO_STARTED),
            interrupts: false,
        });
    }

    /// The board of this name.
    pub fn board(&self, name: &str) -> Option<&Board> {
        self.boards.iter().find(|board| board.name() == name)
    }

    /// The board of this name, to talk to.
    pub fn board_mut(&mut self, name: &str) -> Option<&mut Board> {
        self.boards.iter_mut().find(|board| board.name() == name)
    }

    /// All boards, by name.
    pub fn boards(&self) -> &[Board] {
        &self.boards
    }

    /// All boards, by name.
    pub fn boards_mut(&mut self) -> &mut [Board] {
        &mut self.boards
    }

    fn chip(&self, name: &str) -> Option<ChipId> {
        let index = self.boards.iter().position(|board| board.name() == name)?;
        self.chips.get(index).copied()
    }

    /// What happened inside a board's DW1000.
    pub fn chip_stats(&self, name: &str) -> Option<ChipStats> {
        Some(self.world.chip_stats(self.chip(name)?))
    }

    /// What happened on the air.
    pub fn air_stats(&self) -> AirStats {
        self.world.air_stats()
    }

    /// True distance of two boards at `t`, in metres.
    pub fn true_distance_m(&self, a: &str, b: &str, t: SimTime) -> Option<f64> {
        Some(self.world.true_distance_m(self.chip(a)?, self.chip(b)?, t))
    }

    /// Puts something between two boards; false if there is no such board.
    pub fn set_link_effect(&mut self, a: &str, b: &str, effect: LinkEffect) -> bool {
        let (Some(a), Some(b)) = (self.chip(a), self.chip(b)) else {
            return false;
        };
        self.world.set_link_effect(a, b, effect);
        true
    }

    /// Damages or drops frames that this board sends, by number, to all others.
    pub fn add_fault(
        &mut self,
        from: &str,
        frames: core::ops::Range<u64>,
        action: nova_hal_sim::FaultAction,
    ) -> bool {
        let Some(from) = self.chip(from) else {
            return false;
        };
        self.world.add_fault(Fault {
            from,
            to: None,
            frames,
            action,
        });
        true
    }

    /// A board's receiver hears nothing any more until its chip is reset.
    pub fn stick_receiver(&mut self, name: &str) -> bool {
        let Some(chip) = self.chip(name) else {
            return false;
        };
        self.world.stick_receiver(chip, self.world.now());
        true
    }

    /// Holds a board's radio in reset, whatever its firmware does about it, or lets go of it.
    pub fn hold_radio(&mut self, name: &str, hold: bool) -> bool {
        let Some(index) = self.boards.iter().position(|board| board.name() == name) else {
            return false;
        };
        if let (Some(held), Some(&chip)) = (self.held.get_mut(index), self.chips.get(index)) {
            *held = hold;
            self.world.set_reset(chip, self.world.now(), hold);
            self.pass_interrupts();
        }
        true
    }

    /// Switches a board off and on: RAM is lost, flash stays, and the radio starts anew.
    pub fn power_cycle(&mut self, name: &str) -> bool {
        let Some(index) = self.boards.iter().position(|board| board.name() == name) else {
            return false;
        };
        if let (Some(board), Some(&chip)) = (self.boards.get_mut(index), self.chips.get(index)) {
            board.switch_on();
            self.world.brown_out(chip, self.world.now());
        }
        true
    }

    /// True time now: all boards have got here.
    pub fn now(&self) -> SimTime {
        self.world.now()
    }

    /// Lets time pass until `end`.
    ///
    /// # Errors
    /// [`EmulatorError::Stopped`] when a board did something that is not modelled.
    pub fn run_until(&mut self, end: SimTime) -> Result<(), EmulatorError> {
        loop {
            self.run_boards(end)?;
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
    fn pass_interrupts(&mut self) {
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
