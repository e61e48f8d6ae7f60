//! Peripherals against the product specification (nRF52832 PS v1.4), one file each, through the registers that firmware
//! sees and at the cycles at which it would.

mod gpiote;
mod nvmc;
mod ppi;
mod rtc;
mod spi;
mod timer;
mod uart;
mod watchdog;

use super::{Cycles, Memory, Outward, RAM_START, Soc};
use crate::ChipIdentity;
use crate::error::Trouble;

/// Registers that all peripherals have.
const INTENSET: u16 = 0x304;

/// A chip without a processor, and the time.
struct Bench {
    soc: Soc,
    now: Cycles,
}

impl Bench {
    fn new() -> Self {
        let identity = ChipIdentity {
            device_id: [1, 2],
            random_seed: 3,
        };
        Bench {
            soc: Soc::new(identity, Memory::new()),
            now: 0,
        }
    }

    /// Lets time pass until `cycle`.
    fn until(&mut self, cycle: Cycles) {
        self.now = cycle;
        self.soc.advance(cycle);
    }

    fn pass(&mut self, cycles: Cycles) {
        self.until(self.now + cycles);
    }

    fn write(&mut self, id: u8, offset: u16, value: u32) {
        self.try_write(id, offset, value).unwrap();
    }

    /// What the chip says against it, if anything.
    fn try_write(&mut self, id: u8, offset: u16, value: u32) -> Result<(), Trouble> {
        let address = 0x4000_0000 | u32::from(id) << 12 | u32::from(offset);
        self.soc.write(address, value, self.now);
        self.soc.trouble.take().map_or(Ok(()), Err)
    }

    fn read(&mut self, id: u8, offset: u16) -> u32 {
        let address = 0x4000_0000 | u32::from(id) << 12 | u32::from(offset);
        self.soc.read(address, self.now).unwrap()
    }

    fn task(&mut self, id: u8, offset: u16) {
        self.write(id, offset, 1);
    }

    /// Whether an event stands; it is cleared.
    fn take_event(&mut self, id: u8, offset: u16) -> bool {
        let stands = self.read(id, offset) == 1;
        self.write(id, offset, 0);
        stands
    }

    fn interrupts(&self, id: u8) -> bool {
        self.soc.interrupts >> id & 1 == 1
    }

    fn told(&mut self) -> Vec<Outward> {
        std::mem::take(&mut self.soc.outward)
    }

    fn put_ram(&mut self, offset: u32, bytes: &[u8]) {
        let offset = offset as usize;
        self.soc.ram[offset..offset + bytes.len()].copy_from_slice(bytes);
    }

    fn ram(&self, offset: u32, count: usize) -> &[u8] {
        &self.soc.ram[offset as usize..offset as usize + count]
    }
}

#[test]
fn what_the_chip_has_and_the_emulator_has_not_is_refused_by_name() {
    let mut bench = Bench::new();
    for (id, name) in [(7, "SAADC"), (28, "PWM0"), (1, "RADIO")] {
        let trouble = bench.try_write(id, 0x500, 1).unwrap_err();
        assert_eq!((trouble.place.as_str(), trouble.offset), (name, 0x500));
    }
    // TWI has SPI's place: ENABLE says which of them is meant.
    let trouble = bench.try_write(3, 0x500, 6).unwrap_err().to_string();
    assert!(trouble.contains("TWIM"), "{trouble}");
    assert_eq!(bench.soc.read(0x4000_7500, 0), None);
}

#[test]
fn easy_dma_reaches_ram_and_nothing_else() {
    // SPIM2 and UARTE: TXD.PTR at 0x544, MAXCNT at 0x548, ENABLE at 0x500, and the task that starts them.
    for (id, mode, start) in [(35, 7, 0x010), (2, 8, 0x008)] {
        for (from, is_ram) in [
            (RAM_START, true),
            (RAM_START + 0xFFFC, true),
            (RAM_START + 0xFFFD, false),
            (0, false),
            (0x0800_0000, false),
            (u32::MAX - 1, false),
        ] {
            let mut bench = Bench::new();
            bench.write(id, 0x500, mode);
            bench.write(id, 0x544, from);
            bench.write(id, 0x548, 4);
            let outcome = bench.try_write(id, start, 1);
            assert_eq!(outcome.is_ok(), is_ram, "{from:#x}: {outcome:?}");
        }
        // No byte is no access.
        let mut bench = Bench::new();
        bench.write(id, 0x500, mode);
        bench.task(id, start);
    }
}
