//! SYS_STATUS, the interrupt request and the event counters (User Manual 7.2.17 and 7.2.48).

use super::bits::{file, status, sys_cfg};
use super::power::PowerState;
use super::{Chip, SimTime};

/// Event counters by their offset in DIG_DIAG (0x2F).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Counter {
    PhrError = 0x04,
    FrameSyncLoss = 0x06,
    FcsGood = 0x08,
    FcsError = 0x0A,
    FilterRejection = 0x0C,
    Overrun = 0x0E,
    SfdTimeout = 0x10,
    PreambleTimeout = 0x12,
    FrameWaitTimeout = 0x14,
    FramesSent = 0x16,
    HalfPeriodWarning = 0x18,
    PowerUpWarning = 0x1A,
}

/// The event counters are 12 bits wide.
const COUNTER_MASK: u16 = 0x0FFF;

/// The status bits that belong to the chip as a whole; those of a receive buffer live in the buffer.
#[derive(Debug, Default)]
pub(super) struct Status {
    bits: u64,
    counting: bool,
}

impl Status {
    pub(super) fn raise(&mut self, bits: u64) {
        self.bits |= bits;
    }

    pub(super) fn reset(&mut self) {
        *self = Status::default();
    }
}

impl Chip {
    /// SYS_STATUS as the host reads it.
    pub(super) fn sys_status(&self) -> u64 {
        let events = self.status.bits | self.buffers.host().status | self.buffers.pointer_bits();
        if events & self.interrupt_mask() != 0 {
            events | status::IRQS
        } else {
            events
        }
    }

    fn interrupt_mask(&self) -> u64 {
        // Bit 0 masks nothing: IRQS is the outcome.
        u64::from(self.registers.u32(file::SYS_MASK, 0)) & !status::IRQS
    }

    /// Level of the IRQ pin.
    pub(crate) fn irq_level(&self) -> bool {
        if !matches!(self.power.state, PowerState::Init | PowerState::Idle) {
            return false;
        }
        let active_high = self.registers.sys_cfg() & sys_cfg::HIRQ_POL != 0;
        (self.sys_status() & status::IRQS != 0) == active_high
    }

    /// The host writes SYS_STATUS: ones clear, except the read-only bits.
    pub(super) fn clear_status(&mut self, ones: u64) {
        self.end_status(ones & !status::READ_ONLY);
    }

    /// The chip itself takes bits back, read-only ones too.
    pub(super) fn end_status(&mut self, bits: u64) {
        self.status.bits &= !bits;
        self.buffers.host_mut().status &= !bits;
    }

    pub(super) fn count(&mut self, counter: Counter) {
        if self.status.counting {
            let offset = counter as usize;
            let n = self.registers.u16(file::DIG_DIAG, offset).wrapping_add(1) & COUNTER_MASK;
            self.registers.set(file::DIG_DIAG, offset, &n.to_le_bytes());
        }
    }

    /// EVC_CTRL: both bits act and read back as 0.
    pub(super) fn on_evc_ctrl(&mut self, _now: SimTime) {
        let ctrl = self.registers.u8(file::DIG_DIAG, 0);
        if ctrl & 0b10 != 0 {
            self.registers.set(file::DIG_DIAG, 0x04, &[0; 0x18]);
            self.status.counting = false;
        }
        if ctrl & 0b01 != 0 {
            self.status.counting = true;
        }
        self.registers.set(file::DIG_DIAG, 0, &[0; 4]);
    }
}
