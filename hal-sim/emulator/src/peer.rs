//! A radio without a board: somebody for firmware to talk to, written in Rust and as quick as thought.

use nova_hal_sim::world::ChipId;
use nova_hal_sim::{SimDuration, SimTime, World};

/// What drives such a radio.
pub trait Peer: Send {
    /// Called once when the radio has started, then whenever its interrupt line goes high, and after the time that the
    /// last call asked for. Takes no time.
    fn serve(&mut self, radio: &mut PeerRadio<'_>) -> Option<SimDuration>;
}

/// The way to its DW1000. Nothing passes while it is used.
pub struct PeerRadio<'a> {
    world: &'a mut World,
    chip: ChipId,
}

/// Slow enough for a radio that has just started.
const BITS_PER_S: u32 = 2_000_000;

impl<'a> PeerRadio<'a> {
    pub(crate) fn new(world: &'a mut World, chip: ChipId) -> Self {
        PeerRadio { world, chip }
    }

    /// The present moment.
    pub fn now(&self) -> SimTime {
        self.world.now()
    }

    /// Reads `len` bytes of a register file.
    pub fn read(&mut self, file: u8, offset: u16, len: usize) -> Vec<u8> {
        let mut mosi = header(false, file, offset);
        let skip = mosi.len();
        mosi.resize(skip + len, 0);
        self.transact(&mosi).split_off(skip)
    }

    /// Writes to a register file.
    pub fn write(&mut self, file: u8, offset: u16, bytes: &[u8]) {
        let mut mosi = header(true, file, offset);
        mosi.extend_from_slice(bytes);
        self.transact(&mosi);
    }

    fn transact(&mut self, mosi: &[u8]) -> Vec<u8> {
        let mut miso = vec![0; mosi.len()];
        let now = self.world.now();
        self.world.spi_select(self.chip, now);
        self.world
            .spi_transfer(self.chip, now, BITS_PER_S, mosi, &mut miso);
        self.world.spi_deselect(self.chip, now);
        miso
    }
}

/// A transaction's header (DW1000 User Manual 2.2.1).
fn header(write: bool, file: u8, offset: u16) -> Vec<u8> {
    let first = u8::from(write) << 7 | file;
    match offset {
        0 => vec![first],
        1..=0x7F => vec![first | 0x40, offset as u8],
        _ => vec![
            first | 0x40,
            0x80 | (offset & 0x7F) as u8,
            (offset >> 7) as u8,
        ],
    }
}
