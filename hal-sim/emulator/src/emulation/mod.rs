//! Several boards in one air.
//!
//! ```text
//!   board ──SPI, reset──► World (chips and air of hal-sim) ──interrupt line──► board
//! ```
//! Boards run ahead of one another, but never so far that one could miss what another's radio does to its own: a
//! radio that is told to send needs some microseconds before anybody can notice. What boards want from their radios is
//! served in the order of true time, and the air never passes a board that may still want something earlier. So every
//! result is the same whatever the order of the boards.

mod running;

use nova_hal_sim::chip::{ChipConfig, ChipStats};
use nova_hal_sim::world::{AirStats, ChipId};
use nova_hal_sim::{ChannelConfig, Fault, LinkEffect, SimTime, World};

use crate::board::{Board, BoardConfig};
use crate::error::EmulatorError;
use crate::image::Image;
use crate::peer::{Peer, PeerRadio};

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
}
