//! The register accesses that every frame needs, in as few bytes and transactions as will do.
//!
//! `dw1000::ll` reads and writes whole registers, 15 bytes of RX_TIME where five hold the stamp. While a frame waits
//! for its answer each byte costs 1 us at 8 MHz, and each transaction some more. Everything else goes through `ll`.
//!
//! An access is an array: the SPI header, then bytes to write or room for bytes to read (user manual, section 2.2.1).

use crate::bus::RadioBus;
use crate::radio::RadioError;

/// Every error of the register layer is one of the bus: chip select is a
/// [`NoPin`](crate::bus::NoPin) and cannot fail.
macro_rules! ll {
    ($access:expr) => {
        $access.map_err(|_| $crate::radio::RadioError::Bus)
    };
}

/// SPI headers: register file, with bit 7 set for writing.
pub(crate) mod header {
    /// SYS_CFG (7.2.6).
    pub(crate) const WRITE_SYS_CFG: u8 = 0x80 | 0x04;
    /// TX_FCTRL (7.2.10).
    pub(crate) const WRITE_TX_FCTRL: u8 = 0x80 | 0x08;
    /// TX_BUFFER (7.2.11).
    pub(crate) const WRITE_TX_BUFFER: u8 = 0x80 | 0x09;
    /// DX_TIME (7.2.12).
    pub(crate) const READ_DX_TIME: u8 = 0x0A;
    /// See [`READ_DX_TIME`].
    pub(crate) const WRITE_DX_TIME: u8 = 0x80 | 0x0A;
    /// RX_FWTO: receive frame wait timeout, in units of 512/499.2 us (7.2.14).
    pub(crate) const WRITE_RX_FWTO: u8 = 0x80 | 0x0C;
    /// SYS_CTRL (7.2.15).
    pub(crate) const WRITE_SYS_CTRL: u8 = 0x80 | 0x0D;
    /// SYS_STATUS (7.2.17).
    pub(crate) const READ_SYS_STATUS: u8 = 0x0F;
    /// See [`READ_SYS_STATUS`].
    pub(crate) const WRITE_SYS_STATUS: u8 = 0x80 | 0x0F;
    /// The fourth and fifth byte of SYS_STATUS.
    pub(crate) const READ_SYS_STATUS_3: [u8; 2] = [0x40 | 0x0F, 3];
    /// RX_FINFO (7.2.18).
    pub(crate) const READ_RX_FINFO: u8 = 0x10;
    /// RX_BUFFER (7.2.19).
    pub(crate) const READ_RX_BUFFER: u8 = 0x11;
    /// RX_TIME (7.2.23).
    pub(crate) const READ_RX_TIME: u8 = 0x15;
    /// RX_FQUAL (7.2.20).
    pub(crate) const READ_RX_FQUAL: u8 = 0x12;
    /// FP_INDEX and FP_AMPL1, behind the stamp in RX_TIME (7.2.23).
    pub(crate) const READ_RX_TIME_5: [u8; 2] = [0x40 | 0x15, 5];
    /// LDE_PPINDX, register 0x2E:1000 (7.2.47.3).
    pub(crate) const READ_LDE_PPINDX: [u8; 3] = [0x40 | 0x2E, 0x80, 0x20];
    /// DRX_CAR_INT, register 0x27:28 (7.2.40.11).
    pub(crate) const READ_DRX_CAR_INT: [u8; 2] = [0x40 | 0x27, 0x28];
    /// TX_TIME (7.2.25).
    pub(crate) const READ_TX_TIME: u8 = 0x17;
    /// ACK_RESP_T: W4R_TIM in its low 20 bits (7.2.28).
    pub(crate) const WRITE_ACK_RESP_T: u8 = 0x80 | 0x1A;
}

/// SYS_CTRL's low half (7.2.15).
pub(crate) mod ctrl {
    /// Start a transmission.
    pub(crate) const TXSTRT: u8 = 1 << 1;
    /// At the time in DX_TIME.
    pub(crate) const TXDLYS: u8 = 1 << 2;
    /// Switch transmitter and receiver off.
    pub(crate) const TRXOFF: u8 = 1 << 6;
    /// Go over to receiving after the transmission.
    pub(crate) const WAIT4RESP: u8 = 1 << 7;
    /// Switch the receiver on; in the second byte.
    pub(crate) const RXENAB_1: u8 = 1 << 0;
}

/// SYS_STATUS's low four bytes (7.2.17).
pub(crate) mod status {
    /// TXFRB, TXPRS, TXPHS and TXFRS: how far a transmission has come.
    pub(crate) const TRANSMITTED: u32 = 0xF0;
    /// A frame has been sent.
    pub(crate) const TXFRS: u32 = 1 << 7;
    /// The leading-edge search is over.
    pub(crate) const LDEDONE: u32 = 1 << 10;
    /// Error in a PHY header.
    pub(crate) const RXPHE: u32 = 1 << 12;
    /// A frame with a good check sequence.
    pub(crate) const RXFCG: u32 = 1 << 14;
    /// A frame with a bad one.
    pub(crate) const RXFCE: u32 = 1 << 15;
    /// Data that the Reed-Solomon code could not repair.
    pub(crate) const RXRFSL: u32 = 1 << 16;
    /// The time for listening is over.
    pub(crate) const RXRFTO: u32 = 1 << 17;
    /// The leading-edge search has failed.
    pub(crate) const LDEERR: u32 = 1 << 18;
    /// No start-of-frame delimiter behind a preamble.
    pub(crate) const RXSFDTO: u32 = 1 << 26;
    /// The address filter has rejected a frame.
    pub(crate) const AFFREJ: u32 = 1 << 29;
    /// All that a reception can set, HSRBP and ICRBP not, which are no events.
    pub(crate) const RECEIVED: u32 = 0x2427_FF00;
    /// In bytes 3 and 4: the time of a delayed transmission has passed.
    pub(crate) const HPDWARN_3: u16 = 1 << 3;
    /// In bytes 3 and 4: the transmitter cannot be ready in time.
    pub(crate) const TXPUTE_3: u16 = 1 << 10;
}

/// Writes `bytes`, the header first.
pub(crate) fn write(bus: &mut impl RadioBus, bytes: &[u8]) -> Result<(), RadioError> {
    bus.write(bytes).map_err(|_| RadioError::Bus)
}

/// Reads into what is behind the header.
pub(crate) fn read<const N: usize>(
    bus: &mut impl RadioBus,
    mut bytes: [u8; N],
) -> Result<[u8; N], RadioError> {
    bus.transfer_in_place(&mut bytes)
        .map_err(|_| RadioError::Bus)?;
    Ok(bytes)
}
