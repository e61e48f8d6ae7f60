//! The receiver.
//!
//! ```text
//!      RXENAB          start-up over           preamble seen          SFD        PHR        data
//!  Off ───────> Starting ───────────> Hunting ───────────────> Locked ───> ... ───> ... ───────> Off
//!   ^                                  │    ^   RXPRD           │  RXSFDD    RXPHD    RXDFR + RXFCG / RXFCE
//!   │ RXPTO, RXRFTO, TRXOFF            │    └── RXAUTR ─────────┤
//!   └──────────────────────────────────┴────────────────────────┘ RXSFDTO, RXPHE, RXRFSL, AFFREJ, RXRFTO
//! ```
//!
//! Decided per frame: it is noticed if channel, PRF and preamble code match, it is strong enough and the receiver
//! was listening for enough of the preamble. It then stands or falls with its parts. Another frame on the same
//! channel less than the capture threshold weaker destroys the parts that it overlaps: the SFD (no RXSFDD, then
//! RXSFDTO), the PHR (RXPHE) or the data (RXRFSL); overlap with the preamble alone does no harm. The address filter
//! decides at the end of the frame (the chip decides once the header is in). The frame wait timer runs on when RXAUTR
//! restarts the receiver (the chip starts it anew after a good frame, 7.2.14). The events of the last reception go when
//! the host switches the receiver on again; on the chip RXAUTR does that too (7.2.17).

use crate::air::{FrameId, FramesInFlight, Signal};
use crate::airtime::preamble_symbol_ticks;
use crate::phy::DataRate;
use crate::time::SimTime;

use super::accumulator::Accumulator;
use super::bits::{file, status, sub, sys_cfg};
use super::leading_edge::LeadingEdge;
use super::power::PowerState;
use super::settings::RxSettings;
use super::status::Counter;
use super::transmitter::TxActivity;
use super::{Chip, ChipEvent};

/// RX_FWTO and W4R_TIM count units of 512 chips, 1.0256 us (7.2.14, 7.2.28).
const TIMER_UNIT_TICKS: u64 = 512 * crate::airtime::TICKS_PER_CHIP;

/// What the chip clears by itself when its receiver is switched on (7.2.17).
const ENDED_BY_NEXT_RECEPTION: u64 = status::RXPRD
    | status::RXSFDD
    | status::RXPHD
    | status::RXPHE
    | status::RXRFSL
    | status::RXRFTO
    | status::RXPTO
    | status::RXSFDTO
    | status::AFFREJ;
/// The same of the double receive buffer, where the host may still have a frame to read.
const ENDED_IN_SINGLE_BUFFER: u64 = status::LDEDONE | status::RXDFR | status::RXFCG | status::RXFCE;

/// The first number is the hunt that asked for the call.
#[derive(Debug, Clone, Copy)]
pub(crate) enum RxEvent {
    /// A start that was asked for too late is no longer more than half a period of the counter away.
    HalfPeriodLeft,
    On,
    FrameWaitTimeout,
    PreambleTimeout(u32),
    PreambleDetected(u32, FrameId),
    SfdTimeout(u32),
    SfdEnd(u32),
    PhrEnd(u32),
    DataEnd(u32),
    /// The leading edge of reception number so-and-so has been found.
    LdeDone(u32),
}

#[derive(Debug, Default)]
pub(super) struct Receiver {
    state: State,
    /// Counts receptions asked for by the host.
    session: u32,
    /// Counts searches for a preamble; several in one session with RXAUTR.
    hunt: u32,
    /// Frames at the antenna, heard or not.
    pub(super) signals: Vec<Signal>,
    pub(super) lde: LeadingEdge,
    pub(super) held_in_reset: bool,
    /// Hears nothing until the chip is reset.
    stuck: bool,
    /// An error has happened since the last receiver reset.
    pub(super) stale: bool,
    pub(super) accumulator: Option<Accumulator>,
}

#[derive(Debug, Default)]
enum State {
    #[default]
    Off,
    Starting,
    Hunting(Hunt),
    Locked(Lock),
}

#[derive(Debug, Clone, Copy)]
struct Hunt {
    since: SimTime,
    settings: RxSettings,
}

/// A reception under way.
#[derive(Debug, Clone)]
pub(super) struct Lock {
    pub(super) signal: Signal,
    pub(super) detected_at: SimTime,
    sfd_seen: bool,
    /// Set at the SFD.
    pub(super) rxpacc: u16,
}

impl Receiver {
    pub(super) fn is_on(&self) -> bool {
        !matches!(self.state, State::Off)
    }

    pub(super) fn is_waiting(&self) -> bool {
        matches!(self.state, State::Starting)
    }

    /// Back to the state after a chip reset; what is on the air stays there.
    pub(super) fn reset(&mut self) {
        self.held_in_reset = false;
        self.stuck = false;
        self.stale = false;
        self.lde.cancel();
        self.accumulator = None;
    }
}

// Commands.
impl Chip {
    pub(super) fn enable_receiver(&mut self, now: SimTime, delayed: bool) {
        let earliest = now + self.timing.rx_start_up;
        if !delayed {
            self.start_receiver_at(earliest);
            return;
        }
        let phase = self.clock.next_phase_of(now, self.dx_time());
        let started = self.start_receiver_at(earliest.max(self.clock.time_of(phase)));
        if started && let Some(at) = self.half_period_before(now, phase) {
            self.warn_half_period();
            self.ask_rx(at, RxEvent::HalfPeriodLeft);
        }
    }

    /// WAIT4RESP: the receiver follows a transmission after W4R_TIM (7.2.28).
    pub(super) fn enable_receiver_for_response(&mut self, now: SimTime) {
        let units = u64::from(self.registers.u32(file::ACK_RESP_T, 0) & 0xF_FFFF);
        let turn = self.after_ticks(now, units * TIMER_UNIT_TICKS);
        let on = turn + self.timing.rx_start_up;
        self.start_receiver_at(on);
    }

    /// The receiver goes on as if nobody ever sent.
    pub(crate) fn stick_receiver(&mut self) {
        self.receiver.stuck = true;
    }

    /// Returns whether the receiver could take the command.
    fn start_receiver_at(&mut self, on: SimTime) -> bool {
        let busy = self.receiver.is_on() || self.transmitter.activity() != TxActivity::Idle;
        if busy || self.receiver.held_in_reset || self.power.state != PowerState::Idle {
            self.stats.ignored_commands += 1;
            return false;
        }
        self.end_status(ENDED_BY_NEXT_RECEPTION);
        if self.registers.sys_cfg() & sys_cfg::DIS_DRXB != 0 {
            self.end_status(ENDED_IN_SINGLE_BUFFER);
        }
        self.receiver.session += 1;
        self.receiver.state = State::Starting;
        self.ask_rx(on, RxEvent::On);
        true
    }

    pub(super) fn receiver_off(&mut self) {
        if self.receiver.is_waiting() {
            self.end_status(status::HPDWARN);
        }
        self.receiver.session += 1;
        self.receiver.state = State::Off;
    }

    pub(super) fn ask_rx(&mut self, at: SimTime, event: RxEvent) {
        self.ask(at, ChipEvent::Receiver(self.receiver.session, event));
    }
}

// Events.
impl Chip {
    pub(super) fn on_rx_event(
        &mut self,
        now: SimTime,
        session: u32,
        event: RxEvent,
        frames: &FramesInFlight,
    ) {
        if let RxEvent::LdeDone(number) = event {
            // The search goes on when the receiver is switched off meanwhile.
            self.on_lde_done(number);
            return;
        }
        if session != self.receiver.session {
            return;
        }
        let current = |hunt| hunt == self.receiver.hunt;
        match event {
            RxEvent::HalfPeriodLeft => self.end_status(status::HPDWARN),
            RxEvent::On => self.on_receiver_on(now),
            RxEvent::FrameWaitTimeout => self.time_out(status::RXRFTO, Counter::FrameWaitTimeout),
            RxEvent::PreambleTimeout(hunt) if current(hunt) => {
                if matches!(self.receiver.state, State::Hunting(_)) {
                    self.time_out(status::RXPTO, Counter::PreambleTimeout);
                }
            }
            RxEvent::PreambleDetected(hunt, frame) if current(hunt) => {
                self.on_preamble_detected(now, frame, frames);
            }
            RxEvent::SfdTimeout(hunt) if current(hunt) => self.on_sfd_timeout(now),
            RxEvent::SfdEnd(hunt) if current(hunt) => self.on_sfd_end(now, frames),
            RxEvent::PhrEnd(hunt) if current(hunt) => self.on_phr_end(now, frames),
            RxEvent::DataEnd(hunt) if current(hunt) => self.on_data_end(now, frames),
            _ => {}
        }
    }

    pub(super) fn on_signal_start(&mut self, now: SimTime, signal: Signal) {
        // Frames that have passed still matter to a reception that they overlapped.
        let keep_from = match &self.receiver.state {
            State::Locked(lock) => lock.signal.wave.start.min(now),
            _ => now,
        };
        self.receiver.signals.retain(|s| s.wave.end >= keep_from);
        if let State::Hunting(hunt) = self.receiver.state {
            self.plan_detection(&hunt, &signal);
        }
        self.receiver.signals.push(signal);
    }

    fn on_receiver_on(&mut self, now: SimTime) {
        if self.registers.sys_cfg() & sys_cfg::RXWTOE != 0 {
            let units = u64::from(self.registers.u16(file::RX_FWTO, 0));
            let at = self.after_ticks(now, units * TIMER_UNIT_TICKS);
            self.ask_rx(at, RxEvent::FrameWaitTimeout);
        }
        self.hunt(now);
    }

    /// Starts looking for a preamble.
    pub(super) fn hunt(&mut self, now: SimTime) {
        self.receiver.hunt += 1;
        let Some(settings) = self.registers.rx_settings() else {
            self.stats.ignored_commands += 1;
            self.receiver_off();
            return;
        };
        let hunt = Hunt {
            since: now,
            settings,
        };
        self.receiver.state = State::Hunting(hunt);
        let timeout_pacs = u64::from(self.registers.u16(file::DRX_CONF, sub::DRX_PRETOC));
        if timeout_pacs != 0 {
            // The counter is programmed one lower than the number of chunks (7.2.40.9).
            let symbols = (timeout_pacs + 1) * u64::from(settings.pac);
            let at = self.after_ticks(now, symbols * preamble_symbol_ticks(settings.prf));
            self.ask_rx(at, RxEvent::PreambleTimeout(self.receiver.hunt));
        }
        let signals = std::mem::take(&mut self.receiver.signals);
        signals
            .iter()
            .for_each(|signal| self.plan_detection(&hunt, signal));
        self.receiver.signals = signals;
    }

    fn plan_detection(&mut self, hunt: &Hunt, signal: &Signal) {
        let phy = &signal.wave.phy;
        let RxSettings {
            channel,
            prf,
            preamble_code,
            pac,
            ..
        } = hunt.settings;
        let matches = (phy.channel, phy.prf, phy.preamble_code) == (channel, prf, preamble_code);
        if !matches
            || self.receiver.stuck
            || signal.wave.power_dbm < self.air.sensitivity.dbm(phy.rate)
        {
            return;
        }
        let symbols = u64::from(self.timing.detection_pacs) * u64::from(pac);
        let from = signal.wave.start.max(hunt.since);
        let at = self.after_ticks(from, symbols * preamble_symbol_ticks(prf));
        if at <= signal.wave.sfd_start {
            let event = RxEvent::PreambleDetected(self.receiver.hunt, signal.frame);
            self.ask_rx(at, event);
        }
    }

    fn on_preamble_detected(&mut self, now: SimTime, frame: FrameId, frames: &FramesInFlight) {
        let State::Hunting(hunt) = self.receiver.state else {
            return;
        };
        let Some(signal) = self.receiver.signals.iter().find(|s| s.frame == frame) else {
            return;
        };
        if frames.cut_before(signal, now) {
            return;
        }
        let signal = signal.clone();
        self.status.raise(status::RXPRD);
        let sfd_symbols = u64::from(self.registers.u16(file::DRX_CONF, sub::DRX_SFDTOC));
        if sfd_symbols != 0 {
            let ticks = sfd_symbols * preamble_symbol_ticks(hunt.settings.prf);
            let at = self.after_ticks(now, ticks);
            self.ask_rx(at, RxEvent::SfdTimeout(self.receiver.hunt));
        }
        let phy = &signal.wave.phy;
        let slow = phy.rate == DataRate::Kbps110;
        if phy.sfd == hunt.settings.sfd && slow == hunt.settings.slow {
            self.ask_rx(signal.wave.rmarker, RxEvent::SfdEnd(self.receiver.hunt));
        }
        self.receiver.state = State::Locked(Lock {
            signal,
            detected_at: now,
            sfd_seen: false,
            rxpacc: 0,
        });
    }

    fn on_sfd_timeout(&mut self, now: SimTime) {
        if matches!(&self.receiver.state, State::Locked(lock) if !lock.sfd_seen) {
            self.fail(now, status::RXSFDTO, Counter::SfdTimeout);
        }
    }

    fn on_sfd_end(&mut self, now: SimTime, frames: &FramesInFlight) {
        let State::Locked(lock) = &self.receiver.state else {
            return;
        };
        let mut lock = lock.clone();
        if self.destroyed(&lock.signal, lock.signal.wave.sfd_start, now, frames) {
            return; // and the SFD timeout will end it
        }
        lock.sfd_seen = true;
        self.status.raise(status::RXSFDD);
        lock.rxpacc = self.time_stamp(now, &lock);
        self.ask_rx(
            lock.signal.wave.phr_end,
            RxEvent::PhrEnd(self.receiver.hunt),
        );
        self.receiver.state = State::Locked(lock);
    }

    fn on_phr_end(&mut self, now: SimTime, frames: &FramesInFlight) {
        let State::Locked(lock) = &self.receiver.state else {
            return;
        };
        let wave = &lock.signal.wave;
        let unreadable = wave.long_phr != self.registers.long_phr();
        if unreadable || self.destroyed(&lock.signal, wave.rmarker, now, frames) {
            self.fail(now, status::RXPHE, Counter::PhrError);
            return;
        }
        let end = wave.end;
        self.status.raise(status::RXPHD);
        self.ask_rx(end, RxEvent::DataEnd(self.receiver.hunt));
    }

    fn on_data_end(&mut self, now: SimTime, frames: &FramesInFlight) {
        let State::Locked(lock) = std::mem::take(&mut self.receiver.state) else {
            return;
        };
        let signal = &lock.signal;
        let bytes = frames.bytes(signal.frame);
        let destroyed = self.destroyed(signal, signal.wave.phr_end, now, frames);
        let Some(bytes) = bytes.filter(|_| !destroyed) else {
            self.fail(now, status::RXRFSL, Counter::FrameSyncLoss);
            return;
        };
        let mut bytes = bytes.to_vec();
        if signal.corrupt
            && let Some(byte) = bytes.first_mut()
        {
            *byte ^= 0x40;
        }
        self.accept(now, &lock, &bytes);
    }
}
