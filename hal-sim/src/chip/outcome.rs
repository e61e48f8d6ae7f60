//! How receptions end: timeouts, errors, collisions, and whole frames that go through filter and FCS check.

use crate::air::{FramesInFlight, Signal};
use crate::time::SimTime;

use super::Chip;
use super::bits::{file, status, sys_cfg};
use super::filter::{self, Identity};
use super::receiver::Lock;
use super::status::Counter;
use super::transmitter::fcs;

impl Chip {
    pub(super) fn time_out(&mut self, bit: u64, counter: Counter) {
        self.status.raise(bit);
        self.count(counter);
        self.stats.receive_timeouts += 1;
        self.receiver.stale = true;
        self.receiver_off();
    }

    pub(super) fn fail(&mut self, now: SimTime, bit: u64, counter: Counter) {
        self.status.raise(bit);
        self.count(counter);
        self.stats.receive_errors += 1;
        self.after_failure(now);
    }

    fn after_failure(&mut self, now: SimTime) {
        self.receiver.stale = true;
        if self.registers.sys_cfg() & sys_cfg::RXAUTR != 0 {
            self.hunt(now);
        } else {
            self.receiver_off();
        }
    }

    /// A whole frame is in: buffer, filter, FCS.
    pub(super) fn accept(&mut self, now: SimTime, lock: &Lock, bytes: &[u8]) {
        let cfg = self.registers.sys_cfg();
        let double = cfg & sys_cfg::DIS_DRXB == 0;
        if double && self.buffers.overrun() {
            self.fail(now, status::RXOVRR, Counter::Overrun);
            return;
        }
        let finfo = frame_info(lock);
        let set = self.buffers.chip_mut();
        set.finfo = finfo.to_le_bytes();
        set.data.iter_mut().zip(bytes).for_each(|(d, b)| *d = *b);

        if !filter::accepts(cfg, &self.identity(), bytes) {
            self.status.raise(status::AFFREJ);
            self.count(Counter::FilterRejection);
            self.stats.frames_filtered += 1;
            self.receiver.lde.cancel();
            self.buffers.chip_mut().status &= !status::LDEDONE;
            self.after_failure(now);
            return;
        }
        self.buffers.chip_mut().status |= status::RXDFR;
        if self.lde_hangs() {
            // Neither RXFCG nor RXFCE is how the host finds out that the microcode is missing (7.2.17). Assumed: the
            // receiver goes off and stays with its buffer.
            self.receiver_off();
            return;
        }
        let body_len = bytes.len().saturating_sub(2);
        let (body, tail) = bytes.split_at(body_len);
        let good = tail == fcs(body);
        let bit = if good { status::RXFCG } else { status::RXFCE };
        self.buffers.chip_mut().status |= bit;
        if good {
            self.count(Counter::FcsGood);
            self.stats.frames_good += 1;
        } else {
            self.count(Counter::FcsError);
            self.stats.frames_bad_fcs += 1;
        }
        if !good && cfg & sys_cfg::DIS_FCE == 0 {
            self.after_failure(now);
            return;
        }
        if double {
            self.buffers.toggle_chip();
        }
        if double && cfg & sys_cfg::RXAUTR != 0 {
            self.hunt(now);
        } else {
            self.receiver_off();
        }
    }

    fn identity(&self) -> Identity {
        Identity {
            short: self.registers.u16(file::PANADR, 0),
            pan: self.registers.u16(file::PANADR, 2),
            eui: self.registers.number(file::EUI, 0, 8),
        }
    }

    /// Whether the part of `own` between two moments was spoilt by its sender stopping or by another frame.
    pub(super) fn destroyed(
        &self,
        own: &Signal,
        from: SimTime,
        to: SimTime,
        frames: &FramesInFlight,
    ) -> bool {
        let collides = |other: &Signal| {
            let same_band = other.wave.phy.channel.centre_hz() == own.wave.phy.channel.centre_hz();
            let overlaps = other.wave.start < to && frames.end_of(other) > from;
            let same_code = other.wave.phy.preamble_code == own.wave.phy.preamble_code
                && other.wave.phy.prf == own.wave.phy.prf;
            let isolation_db = if same_code {
                0.0
            } else {
                self.air.code_isolation_db
            };
            let margin_db = own.wave.power_dbm - (other.wave.power_dbm - isolation_db);
            same_band && overlaps && margin_db < self.air.capture_threshold_db
        };
        frames.cut_before(own, to)
            || self
                .receiver
                .signals
                .iter()
                .any(|other| other.frame != own.frame && collides(other))
    }
}

/// RX_FINFO (7.2.18).
fn frame_info(lock: &Lock) -> u32 {
    let wave = &lock.signal.wave;
    let (psr, extension) = wave.phy.preamble.bits();
    u32::from(wave.length & 0x3FF)
        | u32::from(extension) << 11
        | u32::from(wave.phy.rate.bits()) << 13
        | u32::from(wave.ranging) << 15
        | u32::from(wave.phy.prf.bits()) << 16
        | u32::from(psr) << 18
        | u32::from(lock.rxpacc) << 20
}
