//! What does little: FICR, TEMP, registers of errata, and the part's identity in the ROM table.

use super::block::{Block, Layout, ro, rw};
use super::{CPU_HZ, ChipIdentity, Cycles, FLASH_BYTES, Lines, Peripheral, RAM_BYTES};
use crate::error::Refusal;

const START: u16 = 0x000;
const DATARDY: u16 = 0x100;

/// TEMP (product specification, chapter 28): always 25 degrees, in quarters. Its calibration, which erratum 66 wants
/// copied from FICR, is only held.
const TEMP: Layout = Layout {
    name: "TEMP",
    tasks: &[START, 0x004],
    events: &[DATARDY],
    shorts: 0,
    interrupts: true,
    registers: &[
        ro(0x508, 100),
        rw(0x520, 0xFFF).times(6),
        rw(0x540, 0x3FFF).times(6),
        rw(0x560, 0xFF).times(5),
    ],
};

/// A measurement (28.4: 36 us).
const MEASUREMENT: Cycles = 36 * CPU_HZ / 1_000_000;

/// A peripheral whose registers only hold what is written, or that answers a task with an event.
pub(super) struct Plain {
    block: Block,
    ready: Option<Cycles>,
}

/// All of them.
pub(super) fn all() -> Vec<Plain> {
    vec![Plain {
        block: Block::new(12, &TEMP),
        ready: None,
    }]
}

impl Peripheral for Plain {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        self.ready = (task == START).then_some(lines.now + MEASUREMENT);
        Ok(())
    }

    fn due(&self) -> Option<Cycles> {
        self.ready
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        self.ready = None;
        lines.raise(&mut self.block, DATARDY);
        Ok(())
    }
}

/// Registers that start-up code touches because of an erratum and that do nothing here: the address, and the erratum of
/// the nRF52832 that asks for it.
const ERRATA: [(u32, u8); 8] = [
    (0x4000_053C, 31),
    (0x4000_05A0, 37),
    (0x4000_0EE4, 108),
    (0x4000_173C, 182),
    (0x4000_1774, 102),
    (0x4001_3540, 12),
    (0x4007_AC84, 183),
    (0x4007_C074, 16),
];

/// What such a register reads as; `None` for all others.
pub(super) fn erratum(address: u32) -> Option<u32> {
    let mut errata = ERRATA.iter();
    errata.any(|&(at, _)| at == address).then_some(0)
}

/// Factory information (product specification, chapter 13). The part is an nRF52832-QFAA, build code E0, as on the
/// DWM1001. `None`: not modelled.
pub(super) fn ficr(identity: &ChipIdentity, offset: u32) -> Option<u32> {
    let [low, high] = identity.device_id;
    Some(match offset {
        0x010 => 4096,
        0x014 => FLASH_BYTES / 4096,
        0x060 => low,
        0x064 => high,
        // ER and IR: keys of Bluetooth.
        0x080..0x0A0 => low.rotate_left(offset) ^ high,
        // DEVICEADDRTYPE: random; DEVICEADDR.
        0x0A0 => 1,
        0x0A4 => low,
        0x0A8 => high & 0xFFFF | 0xC000,
        0x100 => 0x5_2832,
        0x104 => u32::from_be_bytes(*b"AAE0"),
        // QFN48.
        0x108 => 0x2000,
        0x10C => RAM_BYTES / 1024,
        0x110 => FLASH_BYTES / 1024,
        // Undocumented: by these the vendor's start-up code tells parts and revisions.
        0x130 => 6,
        0x134 => 6,
        // Undocumented: trim that errata 31, 108 and 12 want copied.
        0x244 | 0x258 | 0x324 => 0,
        0x404..=0x444 => 0,
        // NFC.TAGHEADER.
        0x450..=0x45C => 0xFFFF_FF5F,
        _ => return None,
    })
}

/// The ROM table's peripheral identification at 0xF0000FE0, by which start-up code of the nRF5 SDK tells revisions:
/// nRF52832, revision 2. `None`: not modelled.
pub(crate) fn rom_table(offset: u32) -> Option<u32> {
    match offset {
        0xFE0 => Some(0x06),
        0xFE4 => Some(0x00),
        0xFE8 => Some(0x50),
        0xFEC => Some(0x00),
        _ => None,
    }
}

/// What the nRF52832 has at that number and the emulator has not (product specification, table 10, "Instantiation
/// table").
pub(super) fn name(id: u8) -> &'static str {
    match id {
        1 => "RADIO",
        5 => "NFCT",
        7 => "SAADC",
        14 => "ECB",
        15 => "AAR/CCM",
        18 => "QDEC",
        19 => "COMP/LPCOMP",
        20..=25 => "EGU/SWI",
        28 => "PWM0",
        29 => "PDM",
        32 => "MWU",
        33 => "PWM1",
        34 => "PWM2",
        37 => "I2S",
        38 => "FPU",
        _ => "no peripheral",
    }
}
