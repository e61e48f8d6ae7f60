//! The processor's address space: RAM and flash at full speed, everything else through [`Soc`].

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rsemu::core::error::BusError;
use rsemu::core::space::{
    AddressSpace, Mapping, MemAttrs, MemOps, MemResult, Perms, RamStore, Region, UnassignedPolicy,
};

use crate::error::{EmulatorError, Refusal};
use crate::soc::{Cycles, FLASH_BYTES, RAM_BYTES, RAM_START, Soc};

/// Another place at which RAM can be reached, for code (product specification, chapter 8).
const CODE_RAM: u64 = 0x0080_0000;
const FICR: u32 = 0x1000_0000;
const UICR: u32 = crate::soc::UICR_START;
const PERIPHERALS: u32 = 0x4000_0000;
const PORT: u32 = 0x5000_0000;
const ROM_TABLE: u32 = 0xF000_0000;

/// What the processor and its address space share.
pub(crate) struct Shared {
    soc: Mutex<Soc>,
    /// The cycle at which the instruction under way began.
    now: AtomicU64,
    /// The instruction has touched something other than RAM.
    touched: AtomicBool,
}

impl Shared {
    pub(crate) fn new(soc: Soc) -> Arc<Self> {
        Arc::new(Shared {
            soc: Mutex::new(soc),
            now: AtomicU64::new(0),
            touched: AtomicBool::new(false),
        })
    }

    pub(crate) fn soc(&self) -> MutexGuard<'_, Soc> {
        self.soc.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn set_now(&self, now: Cycles) {
        self.now.store(now, Ordering::Relaxed);
    }

    /// Whether anything was touched since this was asked last.
    pub(crate) fn take_touched(&self) -> bool {
        self.touched.load(Ordering::Relaxed) && self.touched.swap(false, Ordering::Relaxed)
    }
}

/// A range of addresses that leads to the [`Soc`].
struct Window {
    base: u32,
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Window({:#010x})", self.base)
    }
}

impl MemOps for Window {
    fn read(&self, offset: u64, bytes: &mut [u8], _: MemAttrs) -> MemResult {
        let offset = offset as u32;
        let now = self.shared.now.load(Ordering::Relaxed);
        let mut soc = self.shared.soc();
        let aligned = offset & !3;
        if self.base == PERIPHERALS
            && bytes.len() == 4
            && let Some(word) = soc.peek(self.base + aligned)
        {
            bytes.copy_from_slice(&word.to_le_bytes());
            return Ok(());
        }
        self.shared.touched.store(true, Ordering::Relaxed);
        let word = match self.base {
            FICR => soc.read_ficr(aligned),
            UICR => Some(soc.memory.read_uicr(aligned)),
            PERIPHERALS => soc.read(self.base + aligned, now),
            PORT => soc.read_port(aligned as u16),
            _ => soc.read_rom_table(aligned),
        };
        let word = word.ok_or(BusError::Unassigned)?.to_le_bytes();
        let within = word.iter().skip((offset & 3) as usize);
        bytes
            .iter_mut()
            .zip(within)
            .for_each(|(to, &from)| *to = from);
        Ok(())
    }

    fn write(&self, offset: u64, bytes: &[u8], _: MemAttrs) -> MemResult {
        let offset = offset as u32;
        let now = self.shared.now.load(Ordering::Relaxed);
        self.shared.touched.store(true, Ordering::Relaxed);
        let mut soc = self.shared.soc();
        let mut word = [0; 4];
        word.iter_mut()
            .zip(bytes)
            .for_each(|(to, &from)| *to = from);
        let value = u32::from_le_bytes(word);
        let done = match self.base {
            0 | UICR => soc.write_memory(self.base + offset, bytes, now),
            PERIPHERALS | PORT if bytes.len() != 4 || offset & 3 != 0 => {
                let what = format!("a write of {} bytes: registers take words", bytes.len());
                soc.refuse_at("peripheral".to_owned(), offset, Refusal::misuse(what));
                None
            }
            PERIPHERALS => soc.write(self.base + offset, value, now),
            PORT => soc.write_port(offset as u16, value, now),
            _ => {
                soc.refuse_at(
                    "read-only memory".to_owned(),
                    offset,
                    Refusal::misuse("a write"),
                );
                None
            }
        };
        done.ok_or(BusError::Unassigned)
    }
}

/// Puts everything where the product specification's memory map has it (chapter 8).
pub(crate) fn address_space(
    ram: &Arc<RamStore>,
    flash: &Arc<RamStore>,
    shared: &Arc<Shared>,
) -> Result<Arc<AddressSpace>, EmulatorError> {
    let space = AddressSpace::new("nRF52832", 32).with_unassigned(UnassignedPolicy::FAULT);
    let window = |name: &str, base: u32, length: u64| {
        let shared = shared.clone();
        let window = Arc::new(Window { base, shared });
        Mapping::new(Region::io(name, length, window), base.into())
    };
    let flash_bytes = u64::from(FLASH_BYTES);
    let mappings = [
        // Two mappings at one place: the processor reads the copy, and its writes go through NVMC.
        Mapping::new(Region::ram("flash", flash.clone()), 0).with_perms(Perms::RX),
        window("flash, writing", 0, flash_bytes).with_perms(Perms::WRITE),
        Mapping::new(Region::ram("RAM", ram.clone()), RAM_START.into()),
        Mapping::new(Region::ram("code RAM", ram.clone()), CODE_RAM),
        window("FICR", FICR, 0x1000),
        window("UICR", UICR, 0x1000),
        window("peripherals", PERIPHERALS, 0x8_0000),
        window("P0", PORT, 0x1000),
        window("ROM table", ROM_TABLE, 0x1000),
    ];
    debug_assert_eq!(ram.len(), u64::from(RAM_BYTES));
    let mut topology = space.topology();
    for mapping in mappings {
        topology
            .map_with(mapping)
            .map_err(|error| EmulatorError::Image(format!("the memory map: {error:?}")))?;
    }
    drop(topology);
    Ok(Arc::new(space))
}
