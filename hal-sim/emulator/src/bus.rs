//! What the processor reads and writes: RAM and flash at once, everything else through [`Soc`].

use rsemu_executor::Bus;

use crate::error::Refusal;
use crate::soc::{Cycles, FLASH_BYTES, RAM_BYTES, RAM_START, Soc, UICR_START};

/// Another place at which RAM can be reached, for code (product specification, chapter 8).
const CODE_RAM: u32 = 0x0080_0000;
const FICR: u32 = 0x1000_0000;
const PERIPHERALS: u32 = 0x4000_0000;
const PERIPHERALS_END: u32 = PERIPHERALS + 0x8_0000;
const PORT: u32 = 0x5000_0000;
const ROM_TABLE: u32 = 0xF000_0000;
/// Length of a peripheral, and of each of the small windows.
const PAGE: u32 = 0x1000;

/// The chip without its processor core.
pub(crate) struct Chip {
    pub(crate) soc: Soc,
    /// The cycle at which the instruction under way began.
    now: Cycles,
    /// The instruction has touched something other than RAM and the contents of flash.
    touched: bool,
}

impl Chip {
    pub(crate) fn new(soc: Soc) -> Self {
        Chip {
            soc,
            now: 0,
            touched: false,
        }
    }

    /// An instruction begins.
    #[inline]
    pub(crate) fn begin(&mut self, now: Cycles) {
        self.now = now;
    }

    /// Whether anything was touched since this was asked last.
    #[inline]
    pub(crate) fn take_touched(&mut self) -> bool {
        std::mem::take(&mut self.touched)
    }

    /// A word of RAM or flash.
    pub(crate) fn word(&self, address: u32) -> Option<u32> {
        let (memory, offset) = self.memory(address & !3)?;
        load(memory, offset, 4)
    }

    /// What of RAM and flash lies there, and where in it.
    #[inline]
    fn memory(&self, address: u32) -> Option<(&[u8], u32)> {
        if address < FLASH_BYTES {
            return Some((self.soc.memory.contents(), address));
        }
        Some((&self.soc.ram, ram_offset(address)?))
    }

    fn read_register(&mut self, address: u32, bytes: u32) -> Option<u32> {
        let aligned = address & !3;
        if bytes == 4
            && (PERIPHERALS..PERIPHERALS_END).contains(&address)
            && let Some(word) = self.soc.peek(address)
        {
            return Some(word);
        }
        self.touched = true;
        let offset = aligned & (PAGE - 1);
        let word = match address {
            PERIPHERALS..PERIPHERALS_END => self.soc.read(aligned, self.now),
            _ => match address & !(PAGE - 1) {
                FICR => self.soc.read_ficr(offset),
                UICR_START => Some(self.soc.memory.read_uicr(offset)),
                PORT => self.soc.read_port(offset as u16),
                ROM_TABLE => self.soc.read_rom_table(offset),
                _ => None,
            },
        };
        let word = word?.to_le_bytes();
        load(&word, address & 3, bytes)
    }

    fn write_register(&mut self, address: u32, bytes: u32, value: u32) -> Option<()> {
        self.touched = true;
        let page = address & !(PAGE - 1);
        let is_register = (PERIPHERALS..PERIPHERALS_END).contains(&address) || page == PORT;
        if address < FLASH_BYTES || page == UICR_START {
            let value = value.to_le_bytes();
            let value = value.get(..bytes as usize)?;
            return self.soc.write_memory(address, value, self.now);
        }
        if is_register && bytes != 4 {
            let what = format!("a write of {bytes} bytes: registers take words");
            let place = "peripheral".to_owned();
            self.soc.refuse_at(place, address, Refusal::misuse(what));
            return None;
        }
        match page {
            PORT => self
                .soc
                .write_port((address & (PAGE - 1)) as u16, value, self.now),
            _ if is_register => self.soc.write(address, value, self.now),
            FICR | ROM_TABLE => {
                let place = "read-only memory".to_owned();
                self.soc
                    .refuse_at(place, address, Refusal::misuse("a write"));
                None
            }
            _ => None,
        }
    }
}

#[inline]
fn ram_offset(address: u32) -> Option<u32> {
    let offset = address.wrapping_sub(RAM_START);
    if offset < RAM_BYTES {
        return Some(offset);
    }
    let offset = address.wrapping_sub(CODE_RAM);
    (offset < RAM_BYTES).then_some(offset)
}

#[inline]
fn load(memory: &[u8], offset: u32, bytes: u32) -> Option<u32> {
    let from = memory.get(offset as usize..)?;
    Some(match bytes {
        4 => u32::from_le_bytes(*from.first_chunk()?),
        2 => u16::from_le_bytes(*from.first_chunk()?).into(),
        _ => u32::from(*from.first()?),
    })
}

#[inline]
fn store(memory: &mut [u8], offset: u32, bytes: u32, value: u32) -> Option<()> {
    let to = memory.get_mut(offset as usize..)?;
    match bytes {
        4 => *to.first_chunk_mut()? = value.to_le_bytes(),
        2 => *to.first_chunk_mut()? = (value as u16).to_le_bytes(),
        _ => *to.first_mut()? = value as u8,
    }
    Some(())
}

/// The product specification's memory map (chapter 8).
impl Bus for Chip {
    #[inline]
    fn read(&mut self, address: u32, bytes: u32) -> Option<u32> {
        match self.memory(address) {
            Some((memory, offset)) => load(memory, offset, bytes),
            None => self.read_register(address, bytes),
        }
    }

    #[inline]
    fn write(&mut self, address: u32, bytes: u32, value: u32) -> Option<()> {
        match ram_offset(address) {
            Some(offset) => store(&mut self.soc.ram, offset, bytes, value),
            None => self.write_register(address, bytes, value),
        }
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Option<u16> {
        let (memory, offset) = self.memory(address)?;
        load(memory, offset, 2).map(|halfword| halfword as u16)
    }

    #[inline]
    fn is_constant(&self, address: u32) -> bool {
        address < FLASH_BYTES
    }
}
