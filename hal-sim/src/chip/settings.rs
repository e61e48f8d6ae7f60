//! Typed views of the configuration registers.

use crate::phy::{Channel, DataRate, PhyConfig, PreambleLength, Prf, Sfd};

use super::bits::{file, sub, sys_cfg};
use super::registers::RegisterFile;

/// What the receiver listens for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RxSettings {
    pub(crate) channel: Channel,
    pub(crate) prf: Prf,
    pub(crate) preamble_code: u8,
    pub(crate) sfd: Sfd,
    /// Looks for 110 kbit/s frames; otherwise for the two faster rates.
    pub(crate) slow: bool,
    /// Preamble acquisition chunk in symbols.
    pub(crate) pac: u16,
}

/// What the transmitter has been told about the next frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TxSettings {
    pub(crate) phy: PhyConfig,
    pub(crate) length: u16,
    pub(crate) buffer_offset: usize,
    pub(crate) ranging: bool,
    pub(crate) long_phr: bool,
}

impl RegisterFile {
    pub(crate) fn sys_cfg(&self) -> u32 {
        self.u32(file::SYS_CFG, 0)
    }

    /// Long frames of up to 1023 bytes (SYS_CFG PHR_MODE = 3).
    pub(crate) fn long_phr(&self) -> bool {
        self.sys_cfg() >> 16 & 0b11 == 0b11
    }

    /// `None` when a field holds a value that the chip does not define.
    pub(crate) fn rx_settings(&self) -> Option<RxSettings> {
        let chan = self.u32(file::CHAN_CTRL, 0);
        let tune2 = self.u32(file::DRX_CONF, sub::DRX_TUNE2);
        Some(RxSettings {
            channel: Channel::from_number((chan >> 4 & 0xF) as u8)?,
            prf: Prf::from_bits((chan >> 18) as u8)?,
            preamble_code: (chan >> 27 & 0x1F) as u8,
            sfd: self.sfd(chan, chan >> 21 & 1 != 0),
            slow: self.sys_cfg() & sys_cfg::RXM110K != 0,
            // DRX_TUNE2 (7.2.40.5): the PAC size is bits 26-25.
            pac: 8 << (tune2 >> 25 & 0b11),
        })
    }

    /// `None` when a field holds a value that the chip does not define.
    pub(crate) fn tx_settings(&self) -> Option<TxSettings> {
        let fctrl = self.u32(file::TX_FCTRL, 0);
        let chan = self.u32(file::CHAN_CTRL, 0);
        let long_phr = self.long_phr();
        let length_mask = if long_phr { 0x3FF } else { 0x7F };
        Some(TxSettings {
            phy: PhyConfig {
                channel: Channel::from_number((chan & 0xF) as u8)?,
                prf: Prf::from_bits((fctrl >> 16) as u8)?,
                preamble_code: (chan >> 22 & 0x1F) as u8,
                preamble: PreambleLength::from_bits((fctrl >> 18) as u8, (fctrl >> 20) as u8)?,
                sfd: self.sfd(chan, chan >> 20 & 1 != 0),
                rate: DataRate::from_bits((fctrl >> 13) as u8)?,
            },
            length: (fctrl & length_mask) as u16,
            buffer_offset: (fctrl >> 22) as usize,
            ranging: fctrl >> 15 & 1 != 0,
            long_phr,
        })
    }

    /// DWSFD takes precedence over TNSSFD and RNSSFD (7.2.32); SFD_LENGTH then chooses between 8 and 16 symbols.
    fn sfd(&self, chan: u32, non_standard: bool) -> Sfd {
        let decawave = chan >> 17 & 1 != 0;
        let symbols = self.u8(file::USR_SFD, 0);
        match (decawave, non_standard) {
            (false, false) => Sfd::Standard,
            (true, _) if symbols == 16 => Sfd::Decawave { symbols: 16 },
            (true, _) => Sfd::Decawave { symbols: 8 },
            (false, true) => Sfd::User { symbols },
        }
    }
}
