//! Registers of UARTE and UART (product specification, 35.9 and 57.9): the same offsets mean the same in both.

use super::super::block::{Layout, ro, rw};

pub(super) const STARTRX: u16 = 0x000;
pub(super) const STOPRX: u16 = 0x004;
pub(super) const STARTTX: u16 = 0x008;
pub(super) const STOPTX: u16 = 0x00C;
pub(super) const SUSPEND: u16 = 0x01C;
pub(super) const FLUSHRX: u16 = 0x02C;
pub(super) const RXDRDY: u16 = 0x108;
pub(super) const ENDRX: u16 = 0x110;
pub(super) const TXDRDY: u16 = 0x11C;
pub(super) const ENDTX: u16 = 0x120;
pub(super) const ERROR: u16 = 0x124;
pub(super) const RXTO: u16 = 0x144;
pub(super) const RXSTARTED: u16 = 0x14C;
pub(super) const TXSTARTED: u16 = 0x150;
pub(super) const TXSTOPPED: u16 = 0x158;
pub(super) const ERRORSRC: u16 = 0x480;
pub(super) const ENABLE: u16 = 0x500;
pub(super) const RXD: u16 = 0x518;
pub(super) const TXD: u16 = 0x51C;
pub(super) const BAUDRATE: u16 = 0x524;
pub(super) const RXD_PTR: u16 = 0x534;
pub(super) const RXD_MAXCNT: u16 = 0x538;
pub(super) const RXD_AMOUNT: u16 = 0x53C;
pub(super) const TXD_PTR: u16 = 0x544;
pub(super) const TXD_MAXCNT: u16 = 0x548;
pub(super) const TXD_AMOUNT: u16 = 0x54C;

pub(super) const ENDRX_STARTRX: u32 = 1 << 5;
pub(super) const ENDRX_STOPRX: u32 = 1 << 6;

pub(super) const LAYOUT: Layout = Layout {
    name: "UART0/UARTE0",
    tasks: &[STARTRX, STOPRX, STARTTX, STOPTX, SUSPEND, FLUSHRX],
    // 0x100 CTS and 0x104 NCTS never happen here.
    events: &[
        0x100, 0x104, RXDRDY, ENDRX, TXDRDY, ENDTX, ERROR, RXTO, RXSTARTED, TXSTARTED, TXSTOPPED,
    ],
    // 3 and 4, CTS_STARTRX and NCTS_STOPRX of the older UART, never act here.
    shorts: ENDRX_STARTRX | ENDRX_STOPRX | 0x18,
    interrupts: true,
    registers: &[
        rw(ERRORSRC, 0xF),
        rw(ENABLE, 0xF),
        // PSEL.RTS, TXD, CTS, RXD.
        rw(0x508, !0).reset(!0).times(4),
        ro(RXD, 0),
        rw(TXD, 0xFF),
        rw(BAUDRATE, !0).reset(0x0400_0000),
        rw(RXD_PTR, !0),
        rw(RXD_MAXCNT, 0xFF),
        ro(RXD_AMOUNT, 0),
        rw(TXD_PTR, !0),
        rw(TXD_MAXCNT, 0xFF),
        ro(TXD_AMOUNT, 0),
        rw(0x56C, 0x1F),
    ],
};
