//! The flash that the firmware itself writes to: the last pages, which memory.x keeps free.

use core::ops::Range;

use embassy_nrf::Peri;
use embassy_nrf::nvmc::{FLASH_SIZE, Nvmc, PAGE_SIZE};
use embassy_nrf::pac::{self, power::vals::Threshold};
use embassy_nrf::peripherals::NVMC;

/// Where settings are kept: four pages, so that each is erased with every fourth that is full.
pub(crate) const SETTINGS: Range<u32> = (FLASH_SIZE - 4 * PAGE_SIZE) as u32..FLASH_SIZE as u32;

/// The flash, safe against a supply that goes.
///
/// While the supply is below the threshold the hardware refuses to write (nRF52832 product specification,
/// 18.1.3); what a write that had begun leaves behind is not taken for settings. 2.7 V is just below the least
/// that the DW1000 works with.
pub(crate) fn open(peripheral: Peri<'static, NVMC>) -> Nvmc<'static> {
    pac::POWER.pofcon().write(|w| {
        w.set_pof(true);
        w.set_threshold(Threshold::V27);
    });
    Nvmc::new(peripheral)
}
