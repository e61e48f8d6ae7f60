//! The register file as storage: sizes, access kinds, reset values (User Manual chapter 7).
//!
//! What a register does is elsewhere; here it only keeps bytes. Sub-registers without behaviour in this model (AGC,
//! GPIO, tuning values ...) are exactly that: storage with the right reset value where the manual gives one.

use super::bits::file;

/// What the host may do with a register file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    /// Writes are ignored and counted.
    ReadOnly,
    /// Plain.
    ReadWrite,
}

use Access::{ReadOnly, ReadWrite};

/// Identifier, length in bytes, access. Table 15 of the manual gives AGC_CTRL, DRX_CONF and OTP_IF 32, 44 and 18 bytes,
/// which would leave out the ends of AGC_STAT1, RXPACC_NOSAT and OTP_SF.
const MAP: &[(u8, usize, Access)] = &[
    (file::DEV_ID, 4, ReadOnly),
    (file::EUI, 8, ReadWrite),
    (file::PANADR, 4, ReadWrite),
    (file::SYS_CFG, 4, ReadWrite),
    (file::SYS_TIME, 5, ReadOnly),
    (file::TX_FCTRL, 5, ReadWrite),
    (file::TX_BUFFER, 1024, ReadWrite),
    (file::DX_TIME, 5, ReadWrite),
    (file::RX_FWTO, 2, ReadWrite),
    (file::SYS_CTRL, 4, ReadWrite),
    (file::SYS_MASK, 4, ReadWrite),
    (file::SYS_STATUS, 5, ReadWrite),
    (file::RX_FINFO, 4, ReadOnly),
    (file::RX_BUFFER, 1024, ReadOnly),
    (file::RX_FQUAL, 8, ReadOnly),
    (file::RX_TTCKI, 4, ReadOnly),
    (file::RX_TTCKO, 5, ReadOnly),
    (file::RX_TIME, 14, ReadOnly),
    (file::TX_TIME, 10, ReadOnly),
    (file::TX_ANTD, 2, ReadWrite),
    (file::SYS_STATE, 5, ReadOnly),
    (file::ACK_RESP_T, 4, ReadWrite),
    (0x1D, 4, ReadWrite), // RX_SNIFF
    (file::TX_POWER, 4, ReadWrite),
    (file::CHAN_CTRL, 4, ReadWrite),
    (file::USR_SFD, 41, ReadWrite),
    (0x23, 33, ReadWrite), // AGC_CTRL
    (0x24, 12, ReadWrite), // EXT_SYNC
    (file::ACC_MEM, 4064, ReadOnly),
    (0x26, 44, ReadWrite), // GPIO_CTRL
    (file::DRX_CONF, 46, ReadWrite),
    (file::RF_CONF, 58, ReadWrite),
    (0x2A, 52, ReadWrite), // TX_CAL
    (file::FS_CTRL, 21, ReadWrite),
    (file::AON, 12, ReadWrite),
    (file::OTP_IF, 19, ReadWrite),
    (file::LDE_IF, 0x2806, ReadWrite),
    (file::DIG_DIAG, 41, ReadWrite),
    (file::PMSC, 48, ReadWrite),
];

/// Register file, offset, bytes (little endian) after a reset.
const RESET: &[(u8, usize, &[u8])] = &[
    (file::DEV_ID, 0, &0xDECA_0130u32.to_le_bytes()),
    // What chips without an EUI in their OTP show; the manual gives no value.
    (file::EUI, 0, &0xFFFF_FFFF_0000_0000u64.to_le_bytes()),
    (file::PANADR, 0, &[0xFF; 4]),
    (file::SYS_CFG, 0, &0x0000_1200u32.to_le_bytes()),
    (file::TX_FCTRL, 0, &0x0015_400Cu32.to_le_bytes()),
    // So 7.2.31 and the vendor's driver; 2.5.5.6 says 0x1E08_0222.
    (file::TX_POWER, 0, &0x0E08_0222u32.to_le_bytes()),
    // Channel 5, PRF 16 MHz, preamble code 4 (2.5.2, default channel configuration).
    (file::CHAN_CTRL, 0, &0x2104_0055u32.to_le_bytes()),
    (0x23, 0x02, &0x0001u16.to_le_bytes()), // AGC_CTRL1
    (0x23, 0x04, &0x889Bu16.to_le_bytes()), // AGC_TUNE1
    // PRF 16 MHz, 6.8 Mbit/s, preamble of 128 symbols (2.5.4, default receiver configuration).
    (file::DRX_CONF, 0x02, &0x0001u16.to_le_bytes()), // DRX_TUNE0b
    (file::DRX_CONF, 0x04, &0x0087u16.to_le_bytes()), // DRX_TUNE1a
    (file::DRX_CONF, 0x06, &0x0020u16.to_le_bytes()), // DRX_TUNE1b
    (file::DRX_CONF, 0x08, &0x311E_0035u32.to_le_bytes()), // DRX_TUNE2
    (file::DRX_CONF, 0x20, &0x1041u16.to_le_bytes()), // DRX_SFDTOC
    (file::DRX_CONF, 0x26, &0x0028u16.to_le_bytes()), // DRX_TUNE4H
    (file::RF_CONF, 0x0B, &[0xD8]),                   // RF_RXCTRLH
    (file::RF_CONF, 0x0C, &0x001E_3DE0u32.to_le_bytes()), // RF_TXCTRL
    (file::RF_CONF, 0x30, &[0x88; 5]),                // LDOTUNE
    (0x2A, 0x0B, &[0xC5]),                            // TC_PGDELAY
    (file::FS_CTRL, 0x07, &0x0800_041Du32.to_le_bytes()), // FS_PLLCFG
    (file::FS_CTRL, 0x0B, &[0x46]),                   // FS_PLLTUNE
    (file::FS_CTRL, 0x0E, &[0x60]),                   // FS_XTALT
    (file::AON, 0x06, &0x50FF_1FEEu32.to_le_bytes()), // AON_CFG0
    (file::AON, 0x0A, &0x0007u16.to_le_bytes()),      // AON_CFG1
    (file::LDE_IF, 0x0806, &[0x6C]),                  // LDE_CFG1
    (file::PMSC, 0x00, &0xF030_0200u32.to_le_bytes()), // PMSC_CTRL0
    (file::PMSC, 0x04, &0x8102_0738u32.to_le_bytes()), // PMSC_CTRL1
    (file::PMSC, 0x0C, &[0x40]),                      // PMSC_SNOZT
    (file::PMSC, 0x26, &0x0B74u16.to_le_bytes()),     // PMSC_TXFSEQ
    (file::PMSC, 0x28, &0x0000_0020u32.to_le_bytes()), // PMSC_LEDC
];

const FILES: usize = 64;

/// All register files.
#[derive(Debug, Clone)]
pub(crate) struct RegisterFile {
    files: Vec<Vec<u8>>,
}

impl RegisterFile {
    /// After a reset.
    pub(crate) fn new() -> Self {
        let mut registers = RegisterFile {
            files: vec![Vec::new(); FILES],
        };
        for &(id, len, _) in MAP {
            if let Some(bytes) = registers.files.get_mut(usize::from(id)) {
                bytes.resize(len, 0);
            }
        }
        for &(id, offset, value) in RESET {
            registers.set(id, offset, value);
        }
        registers
    }

    /// How the host may use register file `id`; `None` when the chip has no such file.
    pub(crate) fn access(id: u8) -> Option<Access> {
        MAP.iter().find(|entry| entry.0 == id).map(|entry| entry.2)
    }

    /// Copies bytes out; returns how many of them lie beyond the end and were left alone.
    pub(crate) fn get(&self, id: u8, offset: usize, out: &mut [u8]) -> usize {
        let held = self.files.get(usize::from(id)).map_or(&[][..], |f| f);
        super::access::copy_from(held, offset, out)
    }

    /// Copies bytes in; returns how many of them lie beyond the end and were dropped.
    pub(crate) fn set(&mut self, id: u8, offset: usize, value: &[u8]) -> usize {
        let Some(held) = self.files.get_mut(usize::from(id)) else {
            return value.len();
        };
        let held = held.get_mut(offset..).unwrap_or(&mut []);
        let n = held.len().min(value.len());
        held.iter_mut().zip(value).for_each(|(h, v)| *h = *v);
        value.len() - n
    }

    /// Takes one register file over from `other`.
    pub(crate) fn copy_file(&mut self, other: &RegisterFile, id: u8) {
        if let Some(from) = other.files.get(usize::from(id)) {
            self.set(id, 0, from);
        }
    }

    /// A little-endian number of up to eight bytes.
    pub(crate) fn number(&self, id: u8, offset: usize, len: usize) -> u64 {
        let mut bytes = [0; 8];
        self.get(id, offset, &mut bytes[..len.min(8)]);
        u64::from_le_bytes(bytes)
    }

    pub(crate) fn u8(&self, id: u8, offset: usize) -> u8 {
        self.number(id, offset, 1) as u8
    }

    pub(crate) fn u16(&self, id: u8, offset: usize) -> u16 {
        self.number(id, offset, 2) as u16
    }

    pub(crate) fn u32(&self, id: u8, offset: usize) -> u32 {
        self.number(id, offset, 4) as u32
    }
}
