//! What SPI transactions do to the chip.
//!
//! - A read samples the registers when its transfer starts, so SYS_TIME is at most the three header bytes old
//!   (3 us at 8 MHz) when it reaches the host, and all bytes of one transfer belong together.
//! - A write takes effect when chip select goes high.
//! - Beyond the end of a register file zeros are read (the chip gives parts of 0xDEADDEAD, 7.2.1), writes vanish, and
//!   both are counted.

use crate::clock::{COUNTER_WRAP, Phase, wrap};
use crate::time::SimTime;

use super::bits::{file, status, sub, sys_ctrl};
use super::power::PowerState;
use super::registers::Access;
use super::spi::Transaction;
use super::transmitter::{DelayedTx, TxActivity};
use super::{Chip, RegisterFile};

/// What the host reads while the chip does not drive MISO.
const MISO_IDLE: u8 = 0xFF;

impl Chip {
    pub(crate) fn select(&mut self, now: SimTime) {
        self.stats.spi_transactions += 1;
        self.on_chip_select(now, true);
        self.transaction = Some(Transaction::default());
    }

    /// One transfer within a transaction. `miso` gets one byte for each of `mosi`; excess of either is ignored.
    pub(crate) fn transfer(&mut self, now: SimTime, bits_per_s: u32, mosi: &[u8], miso: &mut [u8]) {
        self.stats.spi_bytes += mosi.len() as u64;
        miso.fill(MISO_IDLE);
        if self.on_crystal_clock() && bits_per_s > self.timing.slow_spi_max_hz {
            self.kill();
        }
        if !matches!(self.power.state, PowerState::Init | PowerState::Idle) {
            self.stats.unanswered += 1;
            return;
        }
        let Some(mut transaction) = self.transaction.take() else {
            return; // not selected
        };
        let header_len = transaction.take_header(mosi);
        if let Some(target) = transaction.target() {
            let data = mosi.get(header_len..).unwrap_or(&[]);
            if target.write {
                transaction.written.extend_from_slice(data);
            } else if let Some(out) = miso.get_mut(header_len..mosi.len()) {
                let from = target.offset + transaction.read_count;
                transaction.read_count += out.len();
                self.read(
                    now,
                    target.file,
                    from,
                    transaction.read_count == out.len(),
                    out,
                );
            }
        }
        miso.iter_mut().take(header_len).for_each(|b| *b = 0);
        self.transaction = Some(transaction);
    }

    pub(crate) fn deselect(&mut self, now: SimTime) {
        self.on_chip_select(now, false);
        let Some(transaction) = self.transaction.take() else {
            return;
        };
        if let Some(target) = transaction.target()
            && target.write
            && !transaction.written.is_empty()
        {
            self.write(now, target.file, target.offset, &transaction.written);
        }
    }

    fn read(&mut self, now: SimTime, id: u8, offset: usize, first: bool, out: &mut [u8]) {
        out.fill(0);
        let beyond = match id {
            file::SYS_TIME => copy_from(&self.sys_time(now).to_le_bytes()[..5], offset, out),
            file::SYS_STATUS => copy_from(&self.sys_status().to_le_bytes()[..5], offset, out),
            file::SYS_STATE => copy_from(&self.sys_state(), offset, out),
            file::ACC_MEM => {
                self.read_accumulator(offset, first, out);
                0
            }
            id => match self.buffers.host().file(id) {
                Some(bytes) => copy_from(bytes, offset, out),
                None => self.registers.get(id, offset, out),
            },
        };
        self.stats.beyond_register += beyond as u64;
        if id == file::RF_CONF {
            self.fill_rf_status(offset, out);
        }
    }

    /// The counter moves in steps of 512 ticks, one period of the 125 MHz system clock (7.2.8).
    fn sys_time(&self, now: SimTime) -> u64 {
        self.clock.counter_at(now) & !0x1FF
    }

    /// SYS_STATE with the PMSC's state in byte 2 (7.2.27, described from version 2.18 on); the finer states of
    /// transmitter and receiver stay 0.
    fn sys_state(&self) -> [u8; 5] {
        let pmsc = if self.power.state == PowerState::Init {
            0
        } else {
            match self.transmitter.activity() {
                TxActivity::Waiting => 2,
                TxActivity::OnAir => 4,
                TxActivity::Idle if self.receiver.is_waiting() => 3,
                TxActivity::Idle if self.receiver.is_on() => 5,
                TxActivity::Idle => 1,
            }
        };
        [0, 0, pmsc, 0, 0]
    }

    /// RF_STATUS (7.2.41.6): the clock PLL is locked from IDLE on, the RF PLL while transmitter or receiver is on.
    fn fill_rf_status(&self, offset: usize, out: &mut [u8]) {
        if let Some(byte) = sub::RF_STATUS
            .checked_sub(offset)
            .and_then(|i| out.get_mut(i))
        {
            let clock = self.power.state == PowerState::Idle;
            let rf = self.transmitter.activity() == TxActivity::OnAir || self.receiver.is_on();
            *byte = u8::from(clock) | u8::from(clock && rf) << 3;
        }
    }

    /// The first byte of every transaction on ACC_MEM is a dummy (7.2.38).
    fn read_accumulator(&mut self, offset: usize, first: bool, out: &mut [u8]) {
        let Some(accumulator) = self.receiver.accumulator else {
            return;
        };
        let dummy = usize::from(first);
        for (i, byte) in out.iter_mut().enumerate().skip(dummy) {
            // In a transaction of several transfers the dummy has shifted everything by one.
            *byte = accumulator.byte(offset + i - 1);
        }
    }

    fn write(&mut self, now: SimTime, id: u8, offset: usize, data: &[u8]) {
        match RegisterFile::access(id) {
            Some(Access::ReadWrite) => {}
            Some(Access::ReadOnly) => {
                self.stats.read_only_writes += 1;
                return;
            }
            None => {
                self.stats.beyond_register += data.len() as u64;
                return;
            }
        }
        if id == file::SYS_STATUS {
            self.clear_status(shifted(offset, data));
            return;
        }
        let trim_before = self.registers.u8(file::FS_CTRL, sub::FS_XTALT);
        self.stats.beyond_register += self.registers.set(id, offset, data) as u64;

        let touches =
            |start: usize, len: usize| offset < start + len && start < offset + data.len();
        match id {
            file::SYS_CTRL => {
                let command = self.registers.u32(file::SYS_CTRL, 0);
                // All bits clear themselves, those of delayed operations only when these begin (7.2.15); here all do at
                // once.
                self.registers.set(file::SYS_CTRL, 0, &[0; 4]);
                self.command(now, command);
            }
            file::DIG_DIAG if touches(0, 4) => self.on_evc_ctrl(now),
            file::OTP_IF if touches(sub::OTP_CTRL, 2) => self.on_otp_ctrl(now),
            file::PMSC if touches(sub::PMSC_CTRL0, 4) => self.on_pmsc_ctrl0(now),
            file::AON if touches(sub::AON_CTRL, 1) => self.on_aon_ctrl(now),
            file::FS_CTRL if touches(sub::FS_XTALT, 1) => self.on_xtal_trim(now, trim_before),
            _ => {}
        }
    }

    /// SYS_CTRL, in the order in which the bits make sense together.
    fn command(&mut self, now: SimTime, command: u32) {
        let set = |bit| command & bit != 0;
        if set(sys_ctrl::HRBPT) {
            self.buffers.toggle_host();
            self.end_status(status::RXOVRR);
        }
        if set(sys_ctrl::TRXOFF) {
            self.abort_transmission();
            self.receiver_off();
            // They end with what they warn of (7.2.17).
            self.end_status(status::HPDWARN | status::TXPUTE);
            return;
        }
        if set(sys_ctrl::CANSFCS) {
            self.transmitter.cancel_fcs_suppression();
        }
        if set(sys_ctrl::TXSTRT) {
            let delayed = if set(sys_ctrl::TXDLYS) {
                DelayedTx::AtDxTime
            } else {
                DelayedTx::Now
            };
            self.start_transmission(now, delayed, set(sys_ctrl::SFCST), set(sys_ctrl::WAIT4RESP));
        } else if set(sys_ctrl::RXENAB) {
            self.enable_receiver(now, set(sys_ctrl::RXDLYE));
        }
    }

    /// DX_TIME with its low nine bits ignored (7.2.12).
    pub(super) fn dx_time(&self) -> u64 {
        self.registers.number(file::DX_TIME, 0, 5) & !0x1FF
    }

    /// When the wait for `start` will be down to half a period of the counter; `None` if it already is.
    pub(super) fn half_period_before(&self, now: SimTime, start: Phase) -> Option<SimTime> {
        let half = COUNTER_WRAP / 2;
        let ahead = wrap(start.ticks() - self.clock.phase_at(now).ticks());
        (ahead > half).then(|| self.clock.time_of(start.plus_ticks(-i128::from(half))))
    }

    /// Notes that a delayed operation was asked for after its time; it will then wait for the counter to come round.
    /// HPDWARN stays until the wait is down to half a period or is given up (7.2.17).
    pub(super) fn warn_half_period(&mut self) {
        self.status.raise(status::HPDWARN);
        self.count(super::status::Counter::HalfPeriodWarning);
        self.stats.late_commands += 1;
    }
}

/// Copies from `offset` on; returns how many bytes of `out` lie beyond the end.
pub(super) fn copy_from(bytes: &[u8], offset: usize, out: &mut [u8]) -> usize {
    let bytes = bytes.get(offset..).unwrap_or(&[]);
    out.iter_mut().zip(bytes).for_each(|(o, b)| *o = *b);
    out.len().saturating_sub(bytes.len())
}

/// `data` written at byte `offset` as a number.
fn shifted(offset: usize, data: &[u8]) -> u64 {
    data.iter()
        .enumerate()
        .filter(|(i, _)| offset + i < 8)
        .fold(0, |v, (i, b)| v | u64::from(*b) << (8 * (offset + i)))
}
