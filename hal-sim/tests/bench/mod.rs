//! Chips on a bench: a world without boards, its registers reached by hand.
#![allow(dead_code, unreachable_pub)] // each test file uses its own part

use nova_hal_sim::chip::{ChipConfig, LevelReport, Quirks};
use nova_hal_sim::world::ChipId;
use nova_hal_sim::{ChannelConfig, ClockConfig, Motion, SimDuration, SimTime, World};

pub const SYS_CFG: u8 = 0x04;
pub const SYS_TIME: u8 = 0x06;
pub const TX_FCTRL: u8 = 0x08;
pub const TX_BUFFER: u8 = 0x09;
pub const DX_TIME: u8 = 0x0A;
pub const RX_FWTO: u8 = 0x0C;
pub const SYS_CTRL: u8 = 0x0D;
pub const SYS_MASK: u8 = 0x0E;
pub const SYS_STATUS: u8 = 0x0F;
pub const RX_FINFO: u8 = 0x10;
pub const RX_BUFFER: u8 = 0x11;
pub const RX_TIME: u8 = 0x15;
pub const TX_TIME: u8 = 0x17;
pub const CHAN_CTRL: u8 = 0x1F;
pub const DRX: u8 = 0x27;
pub const EVC: u8 = 0x2F;
pub const PMSC: u8 = 0x36;

pub const SFCST: u32 = 1 << 0;
pub const TXSTRT: u32 = 1 << 1;
pub const TXDLYS: u32 = 1 << 2;
pub const CANSFCS: u32 = 1 << 3;
pub const TRXOFF: u32 = 1 << 6;
pub const WAIT4RESP: u32 = 1 << 7;
pub const RXENAB: u32 = 1 << 8;
pub const RXDLYE: u32 = 1 << 9;
pub const HRBPT: u32 = 1 << 24;

pub const CPLOCK: u64 = 1 << 1;
pub const TXFRB: u64 = 1 << 4;
pub const TXFRS: u64 = 1 << 7;
pub const RXPRD: u64 = 1 << 8;
pub const RXSFDD: u64 = 1 << 9;
pub const LDEDONE: u64 = 1 << 10;
pub const RXPHE: u64 = 1 << 12;
pub const RXDFR: u64 = 1 << 13;
pub const RXFCG: u64 = 1 << 14;
pub const RXFCE: u64 = 1 << 15;
pub const RXRFSL: u64 = 1 << 16;
pub const RXRFTO: u64 = 1 << 17;
pub const LDEERR: u64 = 1 << 18;
pub const RXOVRR: u64 = 1 << 20;
pub const RXPTO: u64 = 1 << 21;
pub const RXSFDTO: u64 = 1 << 26;
pub const HPDWARN: u64 = 1 << 27;
pub const AFFREJ: u64 = 1 << 29;
pub const TXPUTE: u64 = 1 << 34;

pub const HZ: u32 = 2_000_000;

pub struct Bench {
    pub world: World,
}

/// A chip `x_m` along the x axis with a perfect clock that no trim changes, so that all chips share one time base; its
/// time stamps and power figures do not depend on the level.
pub fn at(x_m: f64) -> ChipConfig {
    ChipConfig {
        motion: Motion::fixed([x_m, 0.0, 0.0]),
        quirks: Quirks {
            xtal_trim_ppm_per_step: 0.0,
            range_bias: false,
            level_report: LevelReport::Linear,
            ..Quirks::default()
        },
        ..ChipConfig::default()
    }
}

pub fn with_ppm(config: ChipConfig, ppm: f64) -> ChipConfig {
    ChipConfig {
        clock: ClockConfig {
            ppm,
            ..ClockConfig::default()
        },
        ..config
    }
}

impl Bench {
    /// Chips as they come out of start-up.
    pub fn cold<const N: usize>(chips: [ChipConfig; N]) -> (Self, [ChipId; N]) {
        Self::with_channel(ChannelConfig::default(), chips)
    }

    pub fn with_channel<const N: usize>(
        channel: ChannelConfig,
        chips: [ChipConfig; N],
    ) -> (Self, [ChipId; N]) {
        let mut world = World::new(1, channel);
        let ids = chips.map(|config| world.add_chip(config));
        world.advance_to(SimTime::from_ms(5));
        (Bench { world }, ids)
    }

    /// Chips with the LDE microcode loaded, otherwise at reset values: channel 5, PRF 16 MHz, code 4, 6.8 Mbit/s, 128
    /// symbols.
    pub fn ready<const N: usize>(chips: [ChipConfig; N]) -> (Self, [ChipId; N]) {
        let (mut bench, ids) = Self::cold(chips);
        ids.iter().for_each(|id| bench.load_lde(*id));
        (bench, ids)
    }

    pub fn load_lde(&mut self, chip: ChipId) {
        self.write(chip, PMSC, 0, &[0x01, 0x03]);
        self.write(chip, 0x2D, 6, &[0x00, 0x80]);
        self.wait_us(160);
        self.write(chip, PMSC, 0, &[0x00, 0x02]);
    }

    pub fn wait_us(&mut self, us: u64) {
        let t = self.world.now() + SimDuration::from_us(us);
        self.world.advance_to(t);
    }

    pub fn read(&mut self, chip: ChipId, file: u8, offset: usize, len: usize) -> Vec<u8> {
        let mut mosi = header(false, file, offset);
        let skip = mosi.len();
        mosi.resize(skip + len, 0);
        let mut miso = vec![0; mosi.len()];
        let now = self.world.now();
        self.world.spi_transaction(chip, now, HZ, &mosi, &mut miso);
        miso.split_off(skip)
    }

    pub fn number(&mut self, chip: ChipId, file: u8, offset: usize, len: usize) -> u64 {
        let bytes = self.read(chip, file, offset, len);
        bytes.iter().rev().fold(0, |v, b| v << 8 | u64::from(*b))
    }

    pub fn write(&mut self, chip: ChipId, file: u8, offset: usize, data: &[u8]) {
        let mut mosi = header(true, file, offset);
        mosi.extend_from_slice(data);
        let mut miso = vec![0; mosi.len()];
        let now = self.world.now();
        self.world.spi_transaction(chip, now, HZ, &mosi, &mut miso);
    }

    pub fn command(&mut self, chip: ChipId, bits: u32) {
        self.write(chip, SYS_CTRL, 0, &bits.to_le_bytes());
    }

    pub fn status(&mut self, chip: ChipId) -> u64 {
        self.number(chip, SYS_STATUS, 0, 5)
    }

    pub fn clear_status(&mut self, chip: ChipId) {
        self.write(chip, SYS_STATUS, 0, &[0xFF; 5]);
    }

    /// Resets the receiver alone (SOFTRESET in PMSC_CTRL0).
    pub fn reset_receiver(&mut self, chip: ChipId) {
        self.write(chip, PMSC, 3, &[0xE0]);
        self.write(chip, PMSC, 3, &[0xF0]);
    }

    pub fn system_time(&mut self, chip: ChipId) -> u64 {
        self.number(chip, SYS_TIME, 0, 5)
    }

    pub fn tx_time(&mut self, chip: ChipId) -> u64 {
        self.number(chip, TX_TIME, 0, 5)
    }

    pub fn rx_time(&mut self, chip: ChipId) -> u64 {
        self.number(chip, RX_TIME, 0, 5)
    }

    /// Writes a frame of `body` and two bytes of FCS, and its length.
    pub fn load_frame(&mut self, chip: ChipId, body: &[u8]) {
        self.write(chip, TX_BUFFER, 0, body);
        let fctrl = self.number(chip, TX_FCTRL, 0, 4) as u32 & !0x3FF;
        let fctrl = fctrl | (body.len() as u32 + 2);
        self.write(chip, TX_FCTRL, 0, &fctrl.to_le_bytes());
    }

    pub fn set_sys_cfg(&mut self, chip: ChipId, bits: u32) {
        let cfg = self.number(chip, SYS_CFG, 0, 4) as u32 | bits;
        self.write(chip, SYS_CFG, 0, &cfg.to_le_bytes());
    }

    /// Frame from `from` to `to` with everything at its best; status of the receiver a while later.
    pub fn exchange(&mut self, from: ChipId, to: ChipId, body: &[u8]) -> u64 {
        self.load_frame(from, body);
        self.command(to, RXENAB);
        self.wait_us(50);
        self.command(from, TXSTRT);
        self.wait_us(1_000);
        self.status(to)
    }
}

fn header(write: bool, file: u8, offset: usize) -> Vec<u8> {
    let write = u8::from(write) << 7;
    match offset {
        0 => vec![write | file],
        1..=0x7F => vec![write | 0x40 | file, offset as u8],
        _ => vec![
            write | 0x40 | file,
            0x80 | (offset & 0x7F) as u8,
            (offset >> 7) as u8,
        ],
    }
}
