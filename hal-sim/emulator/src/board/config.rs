//! What a board is made of, and what it has done.

use std::collections::BTreeMap;

use nova_hal_sim::chip::ChipConfig;
use nova_hal_sim::{Flash, SimDuration};

use crate::reply::Replies;
use crate::soc::{ChipIdentity, Cycles, ResetReason};

/// A board to be emulated.
#[derive(Debug)]
pub struct BoardConfig {
    /// Its name; no two may have the same.
    pub name: String,
    /// What is burnt into its processor.
    pub identity: ChipIdentity,
    /// Its DW1000, crystal and place.
    pub chip: ChipConfig,
    /// Frequency error of the processor's crystal, in ppm.
    pub mcu_ppm: f64,
    /// From power-on (time zero) until the processor's first instruction.
    pub boot_delay: SimDuration,
    /// Flash and UICR of a board that has been in use; new ones if absent. The image is written into it.
    pub memory: Option<ChipMemory>,
}

/// Flash and UICR of a board, to give to the same board when it is emulated again.
#[derive(Debug, Clone)]
pub struct ChipMemory {
    pub(crate) flash: Flash,
    pub(crate) uicr: Flash,
}

impl ChipMemory {
    /// Another chip with the same contents and wear.
    pub fn duplicate(&self) -> Self {
        ChipMemory {
            flash: self.flash.duplicate(),
            uicr: self.uicr.duplicate(),
        }
    }
}

impl BoardConfig {
    /// A board with this name and this number burnt in; all else as hal-sim's boards.
    pub fn new(name: impl Into<String>, device_id: [u32; 2]) -> Self {
        let [low, high] = device_id;
        BoardConfig {
            name: name.into(),
            identity: ChipIdentity {
                device_id,
                random_seed: u64::from(high) << 32 | u64::from(low),
            },
            chip: ChipConfig::default(),
            mcu_ppm: 0.0,
            boot_delay: SimDuration::from_ms(5),
            memory: None,
        }
    }
}

/// What a board has done.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BoardStats {
    /// Instructions, and entries into exceptions.
    pub instructions: u64,
    /// Cycles in which the processor did not sleep; those in which it stood still for the flash included.
    pub busy_cycles: Cycles,
    /// Cycles altogether.
    pub cycles: Cycles,
    /// Interrupts that were served, by number.
    pub interrupts: BTreeMap<u16, u64>,
    /// Resets, by reason, the first start included.
    pub resets: Vec<(Cycles, ResetReason)>,
    /// SPI transfers to the radio.
    pub transfers: u64,
    /// Bytes of those.
    pub spi_bytes: u64,
    /// Cycles that the SPI was busy with them.
    pub spi_cycles: Cycles,
    /// Where the time of answers went.
    pub replies: Replies,
}
