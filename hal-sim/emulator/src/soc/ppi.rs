//! PPI: events that trigger tasks without the processor (product specification, chapter 22). The twenty programmable
//! channels with their forks; the fixed ones belong to the radio of the nRF52832 and timers that go with it.

use super::block::{Block, Layout, rw};
use super::{Cycles, Lines, Peripheral};
use crate::error::Refusal;

const CHANNELS: u16 = 20;
const GROUPS: u16 = 6;
const CHEN: u16 = 0x500;
const CHENSET: u16 = 0x504;
const CHENCLR: u16 = 0x508;
const EEP: u16 = 0x510;
const TEP: u16 = 0x514;
const GROUP: u16 = 0x800;
const FORK: u16 = 0x910;

const LAYOUT: Layout = Layout {
    name: "PPI",
    tasks: &[
        0x000, 0x004, 0x008, 0x00C, 0x010, 0x014, 0x018, 0x01C, 0x020, 0x024, 0x028, 0x02C,
    ],
    events: &[],
    shorts: 0,
    interrupts: false,
    registers: &[
        rw(CHEN, !0),
        rw(CHENSET, !0),
        rw(CHENCLR, !0),
        rw(EEP, !0).times(CHANNELS).every(8),
        rw(TEP, !0).times(CHANNELS).every(8),
        rw(GROUP, !0).times(GROUPS),
        rw(FORK, !0).times(CHANNELS),
    ],
};

const PERIPHERALS: u32 = 0x4000_0000;

/// PPI.
pub(super) struct Ppi {
    block: Block,
    enabled: u32,
}

impl Ppi {
    pub(super) fn new() -> Self {
        Ppi {
            block: Block::new(31, &LAYOUT),
            enabled: 0,
        }
    }

    /// The tasks that an event triggers: peripheral and offset.
    pub(super) fn tasks_of(&self, id: u8, event: u16) -> Vec<(u8, u16)> {
        if self.enabled == 0 {
            return Vec::new();
        }
        let address = PERIPHERALS | u32::from(id) << 12 | u32::from(event);
        let channels = (0..CHANNELS)
            .filter(|n| self.enabled >> n & 1 == 1 && self.block.get(EEP + 8 * n) == address);
        let ends =
            channels.flat_map(|n| [self.block.get(TEP + 8 * n), self.block.get(FORK + 4 * n)]);
        ends.filter(|&end| end != 0)
            .map(super::access::place)
            .collect()
    }

    fn enable(&mut self, channels: u32) -> Result<(), Refusal> {
        if channels >> CHANNELS != 0 {
            return Err(Refusal::misuse(
                "the fixed channels, 20 to 31, are not modelled",
            ));
        }
        self.enabled = channels;
        Ok(())
    }
}

impl Peripheral for Ppi {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, _: &mut Lines<'_>) -> Result<(), Refusal> {
        let group = self.block.get(GROUP + task / 8 * 4);
        let channels = if task.is_multiple_of(8) {
            self.enabled | group
        } else {
            self.enabled & !group
        };
        self.enable(channels)
    }

    fn read(&mut self, offset: u16, _: &mut Lines<'_>) -> Option<u32> {
        matches!(offset, CHEN | CHENSET | CHENCLR).then_some(self.enabled)
    }

    fn written(&mut self, offset: u16, value: u32, _: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            CHEN => self.enable(value),
            CHENSET => self.enable(self.enabled | value),
            CHENCLR => self.enable(self.enabled & !value),
            _ => Ok(()),
        }
    }

    fn due(&self) -> Option<Cycles> {
        None
    }
}
