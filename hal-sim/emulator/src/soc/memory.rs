//! Flash and UICR behind NVMC (product specification, chapter 11).
//!
//! The rules of flash (erase before write, whole words, so many writes a block, power lost in the middle) are those of
//! [`nova_hal_sim::flash`]. The processor reads from a copy in its own address space. It stands still while the flash
//! is busy, for the longest time that the specification gives.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use nova_hal_sim::flash::{ERASE_US, PAGE_BYTES, WORD_BYTES, WRITE_US};
use nova_hal_sim::{Flash, FlashError};

use super::block::{Block, Layout, ro, rw, wo};
use super::{CPU_HZ, FLASH_BYTES, Lines, Outward, Peripheral};
use crate::board::ChipMemory;
use crate::error::Refusal;

/// NVMC's number.
pub(super) const ID: u8 = 30;

/// Where UICR begins; it is a page long.
pub(crate) const UICR_START: u32 = 0x1000_1000;

const READY: u16 = 0x400;
const CONFIG: u16 = 0x504;
const ERASEPAGE: u16 = 0x508;
const ERASEALL: u16 = 0x50C;
const ERASEUICR: u16 = 0x514;

const LAYOUT: Layout = Layout {
    name: "NVMC",
    tasks: &[],
    events: &[],
    shorts: 0,
    interrupts: false,
    registers: &[
        // The processor waits for the flash, and so never sees it busy.
        ro(READY, 1),
        rw(CONFIG, 3),
        wo(ERASEPAGE, !0),
        wo(ERASEALL, 1),
        // ERASEPCR0, another name of ERASEPAGE.
        wo(0x510, !0),
        wo(ERASEUICR, 1),
        // ICACHECNF, IHIT, IMISS: the cache costs and saves nothing here.
        rw(0x540, 0x101),
        rw(0x548, !0),
        rw(0x54C, !0),
    ],
};

const WRITE_ENABLED: u32 = 1;
const ERASE_ENABLED: u32 = 2;

/// Flash, UICR and NVMC.
pub(crate) struct Memory {
    block: Block,
    flash: Flash,
    uicr: Flash,
    /// What the processor reads.
    copy: Vec<u8>,
    /// The copy is not what it was.
    changed: bool,
}

impl Memory {
    /// Erased.
    pub(crate) fn new() -> Self {
        Memory::of(Flash::new(FLASH_BYTES as usize / PAGE_BYTES), Flash::new(1))
    }

    /// Flash and UICR that have been in use.
    pub(crate) fn of(flash: Flash, uicr: Flash) -> Self {
        let mut memory = Memory {
            block: Block::new(ID, &LAYOUT),
            flash,
            uicr,
            copy: vec![0; FLASH_BYTES as usize],
            changed: true,
        };
        memory.copy_from_flash(0, FLASH_BYTES);
        memory
    }

    /// NVMC as after a reset; flash and UICR stay.
    pub(super) fn reset(&mut self) {
        self.block = Block::new(ID, &LAYOUT);
    }

    /// What the processor reads from flash.
    #[inline]
    pub(crate) fn contents(&self) -> &[u8] {
        &self.copy
    }

    /// Whether that has changed since this was asked last.
    pub(crate) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// The flash itself, to plan power cuts and to look at wear.
    pub(crate) fn flash(&self) -> &Flash {
        &self.flash
    }

    /// Flash and UICR.
    pub(crate) fn parts(&self) -> ChipMemory {
        ChipMemory {
            flash: self.flash.clone(),
            uicr: self.uicr.clone(),
        }
    }

    /// A programmer puts bytes there; false where there is no such memory.
    pub(crate) fn preload(&mut self, address: u32, bytes: &[u8]) -> bool {
        let end = u64::from(address) + bytes.len() as u64;
        if end <= FLASH_BYTES.into() {
            self.flash.preload(address as usize, bytes);
            self.copy_from_flash(address, bytes.len() as u32);
            true
        } else if address >= UICR_START && end <= u64::from(UICR_START) + PAGE_BYTES as u64 {
            self.uicr.preload((address - UICR_START) as usize, bytes);
            true
        } else {
            false
        }
    }

    /// The supply is back: what a write that was cut short has left is what the processor reads.
    pub(crate) fn restore_power(&mut self) {
        self.flash.restore_power();
        self.uicr.restore_power();
        self.copy_from_flash(0, FLASH_BYTES);
    }

    /// Any part of UICR.
    pub(crate) fn read_uicr(&self, offset: u32) -> u32 {
        let mut word = [0xFF; 4];
        let _ = self.uicr.clone().read(offset & !3, &mut word);
        u32::from_le_bytes(word)
    }

    /// The processor writes.
    pub(super) fn write(
        &mut self,
        address: u32,
        bytes: &[u8],
        lines: &mut Lines<'_>,
    ) -> Result<(), Refusal> {
        if self.block.get(CONFIG) != WRITE_ENABLED {
            return Err(Refusal::misuse(
                "write while NVMC.CONFIG does not enable it",
            ));
        }
        if bytes.len() != WORD_BYTES {
            return Err(Refusal::misuse("flash takes whole words only"));
        }
        let (flash, offset) = match address.checked_sub(UICR_START) {
            Some(offset) => (&mut self.uicr, offset),
            None => (&mut self.flash, address),
        };
        let done = flash.write(offset, bytes);
        self.copy_from_flash(address, WORD_BYTES as u32);
        lines.tell(Outward::Stall(WRITE_US * CPU_HZ / 1_000_000));
        outcome(done, lines)
    }

    fn erase(&mut self, from: u32, to: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let done = self.flash.erase(from, to);
        self.copy_from_flash(from, to.saturating_sub(from));
        let pages = u64::from(to.saturating_sub(from)) / PAGE_BYTES as u64;
        lines.tell(Outward::Stall(pages * ERASE_US * CPU_HZ / 1_000_000));
        outcome(done, lines)
    }

    /// Leaves the copy as it is where the flash cannot be read: without power, or out of its bounds.
    fn copy_from_flash(&mut self, from: u32, count: u32) {
        let place = from as usize..from as usize + count as usize;
        let mut bytes = vec![0; count as usize];
        if self.flash.read(from, &mut bytes).is_ok()
            && let Some(place) = self.copy.get_mut(place)
        {
            place.copy_from_slice(&bytes);
            self.changed = true;
        }
    }
}

fn outcome(done: Result<(), FlashError>, lines: &mut Lines<'_>) -> Result<(), Refusal> {
    match done {
        Ok(()) => Ok(()),
        Err(FlashError::PowerLost) => {
            lines.tell(Outward::PowerLost);
            Ok(())
        }
        Err(error) => Err(Refusal::misuse(error.to_string())),
    }
}

impl Peripheral for Memory {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, _: u16, _: &mut Lines<'_>) -> Result<(), Refusal> {
        Ok(())
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let erases = matches!(offset, ERASEPAGE | ERASEALL | 0x510 | ERASEUICR);
        if erases && self.block.get(CONFIG) != ERASE_ENABLED {
            return Err(Refusal::misuse(
                "erase while NVMC.CONFIG does not enable it",
            ));
        }
        match offset {
            ERASEPAGE | 0x510 => self.erase(value, value.saturating_add(PAGE_BYTES as u32), lines),
            ERASEALL if value == 1 => {
                self.erase(0, FLASH_BYTES, lines)?;
                outcome(self.uicr.erase(0, PAGE_BYTES as u32), lines)
            }
            ERASEUICR if value == 1 => outcome(self.uicr.erase(0, PAGE_BYTES as u32), lines),
            _ => Ok(()),
        }
    }
}
