//! The transmitter.
//!
//! ```text
//!          TXSTRT            start-up over         PHR ends           data ends
//!  Idle ────────────> Armed ──────────────> OnAir ───────────> OnAir ───────────> Idle (or receiver on: WAIT4RESP)
//!    ^                  │      TXFRB        TXPRS   TXPHS, data  │      TXFRS
//!    └──── TRXOFF ──────┴──────────────────────── sampled ───────┘
//! ```
//!
//! The RMARKER leaves the internal transmitter on a multiple of 512 ticks, for immediate transmissions too, and the
//! antenna the true antenna delay later. The payload is taken from TX_BUFFER when the data part begins (the chip
//! takes it byte by byte; a driver that races the data part is wrong on both). Whether the FCS is appended is decided
//! when its first bit is due, so CANSFCS works until then (7.2.15).

use crate::air::OutgoingFrame;
use crate::airtime::Airtime;
use crate::clock::{Phase, wrap};
use crate::time::{SimTime, TICKS_PER_S};

use super::bits::{file, status, sys_cfg};
use super::power::PowerState;
use super::settings::TxSettings;
use super::status::Counter;
use super::{Chip, ChipEvent, Request, tx_power};

/// Granularity of transmit times (7.2.12).
const GRID_TICKS: i128 = 512;
const FCS_LEN: usize = 2;
/// What the chip clears by itself when its transmitter starts (7.2.17).
const ENDED_BY_NEXT_FRAME: u64 =
    status::TXFRB | status::TXPRS | status::TXPHS | status::TXFRS | status::TXPUTE;
const FCS: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_KERMIT);

/// The IEEE 802.15.4 frame check sequence of `bytes`.
pub(super) fn fcs(bytes: &[u8]) -> [u8; FCS_LEN] {
    FCS.checksum(bytes).to_le_bytes()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DelayedTx {
    Now,
    AtDxTime,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TxActivity {
    Idle,
    Waiting,
    OnAir,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum TxEvent {
    /// A frame that was asked for too late is no longer more than half a period of the counter away.
    HalfPeriodLeft,
    Begin,
    PreambleSent,
    PhrSent,
    FcsDue,
    End,
}

#[derive(Debug, Default)]
pub(super) struct Transmitter {
    state: State,
    epoch: u32,
}

#[derive(Debug, Default)]
enum State {
    #[default]
    Idle,
    Armed(Plan),
    OnAir {
        plan: Plan,
        payload: Vec<u8>,
    },
}

#[derive(Debug, Clone, Copy)]
struct Plan {
    settings: TxSettings,
    airtime: Airtime,
    rmarker: Phase,
    suppress_fcs: bool,
    wait_for_response: bool,
}

impl Transmitter {
    pub(super) fn activity(&self) -> TxActivity {
        match self.state {
            State::Idle => TxActivity::Idle,
            State::Armed(_) => TxActivity::Waiting,
            State::OnAir { .. } => TxActivity::OnAir,
        }
    }

    pub(super) fn cancel_fcs_suppression(&mut self) {
        if let State::Armed(plan) | State::OnAir { plan, .. } = &mut self.state {
            plan.suppress_fcs = false;
        }
    }
}

impl Chip {
    pub(super) fn start_transmission(
        &mut self,
        now: SimTime,
        when: DelayedTx,
        suppress_fcs: bool,
        wait_for_response: bool,
    ) {
        let busy = self.transmitter.activity() != TxActivity::Idle || self.receiver.is_on();
        let settings = self.registers.tx_settings();
        let Some(settings) = settings.filter(|_| !busy && self.power.state == PowerState::Idle)
        else {
            self.stats.ignored_commands += 1;
            return;
        };
        self.transmitter.epoch += 1;
        let airtime = Airtime::of(&settings.phy, usize::from(settings.length));
        let shr = i128::from(airtime.shr_ticks());
        let ready = self.clock.phase_at(now + self.timing.tx_start_up);
        let rmarker = match when {
            DelayedTx::Now => {
                let earliest = ready.ticks() + 1 + shr;
                Phase::from_ticks((earliest + GRID_TICKS - 1).div_euclid(GRID_TICKS) * GRID_TICKS)
            }
            DelayedTx::AtDxTime => self.delayed_rmarker(now, ready, shr),
        };
        self.transmitter.state = State::Armed(Plan {
            settings,
            airtime,
            rmarker,
            suppress_fcs,
            wait_for_response,
        });
        let begin = rmarker.plus_ticks(-shr).max(ready);
        let begin = self.clock.time_of(begin).max(now);
        self.ask_tx(begin, TxEvent::Begin);
    }

    /// When a delayed transmission's RMARKER falls (3.3, 7.2.17 HPDWARN and TXPUTE). What counts is the start of the
    /// preamble. If that is over, the frame waits until the counter comes round, 17.2 s later, unless TRXOFF ends it.
    /// If only the time to power up is missing, the RMARKER leaves in time but the preamble lacks its first symbols.
    /// Not modelled: the chip may never end such a frame (application note APS022, section 5.4), and one asked for just
    /// in time may vanish without a flag (erratum TX-1).
    fn delayed_rmarker(&mut self, now: SimTime, ready: Phase, shr: i128) -> Phase {
        let start = wrap(i128::from(self.dx_time()) - shr);
        let start = self.clock.next_phase_of(now, start);
        if let Some(at) = self.half_period_before(now, start) {
            self.warn_half_period();
            self.ask_tx(at, TxEvent::HalfPeriodLeft);
        } else if start < ready {
            self.status.raise(status::TXPUTE);
            self.count(Counter::PowerUpWarning);
            self.stats.late_commands += 1;
        }
        start.plus_ticks(shr)
    }

    pub(super) fn abort_transmission(&mut self) {
        if let State::OnAir { .. } = self.transmitter.state {
            self.outbox.push(Request::AbortFrame);
        }
        self.transmitter.epoch += 1;
        self.transmitter.state = State::Idle;
    }

    fn ask_tx(&mut self, at: SimTime, event: TxEvent) {
        self.ask(at, ChipEvent::Transmitter(self.transmitter.epoch, event));
    }

    pub(super) fn on_tx_event(&mut self, now: SimTime, epoch: u32, event: TxEvent) {
        if epoch != self.transmitter.epoch {
            return;
        }
        match (event, std::mem::take(&mut self.transmitter.state)) {
            (TxEvent::Begin, State::Armed(plan)) => self.begin_frame(now, plan),
            (TxEvent::HalfPeriodLeft, state) => {
                self.transmitter.state = state;
                self.end_status(status::HPDWARN);
            }
            (TxEvent::PreambleSent, state) => {
                self.transmitter.state = state;
                self.status.raise(status::TXPRS);
            }
            (TxEvent::PhrSent, State::OnAir { plan, .. }) => {
                self.status.raise(status::TXPHS);
                self.report_tx_time(&plan);
                let payload = self.take_payload(&plan.settings);
                self.transmitter.state = State::OnAir { plan, payload };
            }
            (TxEvent::FcsDue, State::OnAir { plan, mut payload }) => {
                if !plan.suppress_fcs {
                    let body_len = payload.len().saturating_sub(FCS_LEN);
                    let (body, tail) = payload.split_at_mut(body_len);
                    let checksum = fcs(body);
                    tail.iter_mut().zip(checksum).for_each(|(t, c)| *t = c);
                }
                self.outbox.push(Request::SealFrame(payload.clone()));
                self.transmitter.state = State::OnAir { plan, payload };
            }
            (TxEvent::End, State::OnAir { plan, .. }) => {
                self.status.raise(status::TXFRS);
                self.count(Counter::FramesSent);
                self.stats.frames_sent += 1;
                if plan.wait_for_response {
                    self.enable_receiver_for_response(now);
                }
            }
            (_, state) => self.transmitter.state = state,
        }
    }

    fn begin_frame(&mut self, now: SimTime, plan: Plan) {
        let Plan {
            settings, airtime, ..
        } = plan;
        let at = |after_start: u64| {
            let offset = i128::from(after_start) - i128::from(airtime.shr_ticks());
            self.clock.time_of(plan.rmarker.plus_ticks(offset)).max(now)
        };
        let sfd_start = at(airtime.preamble_ticks);
        let rmarker = at(airtime.shr_ticks());
        let phr_end = at(airtime.shr_ticks() + airtime.phr_ticks);
        let end = at(airtime.total_ticks());
        let fcs_ticks = 8 * FCS_LEN as u64 * crate::airtime::data_bit_ticks(settings.phy.rate);
        let fcs_due = at(airtime.total_ticks().saturating_sub(fcs_ticks)).max(phr_end);

        let antenna = Self::fixed_delay(self.tx_antenna_delay_ticks);
        let frame = OutgoingFrame {
            phy: settings.phy,
            start: now + antenna,
            sfd_start: sfd_start + antenna,
            rmarker: rmarker + antenna,
            phr_end: phr_end + antenna,
            end: end + antenna,
            power_dbm: self.output_power_dbm(&settings, &airtime),
            ranging: settings.ranging,
            length: settings.length,
            long_phr: settings.long_phr,
            clock_ppm: self.clock.ppm_at(rmarker),
        };
        self.end_status(ENDED_BY_NEXT_FRAME);
        self.status.raise(status::TXFRB);
        self.stats.frames_begun += 1;
        self.outbox.push(Request::StartFrame(frame));
        self.ask_tx(sfd_start, TxEvent::PreambleSent);
        self.ask_tx(phr_end, TxEvent::PhrSent);
        self.ask_tx(fcs_due, TxEvent::FcsDue);
        self.ask_tx(end, TxEvent::End);
        self.transmitter.state = State::OnAir {
            plan,
            payload: Vec::new(),
        };
    }

    fn output_power_dbm(&self, settings: &TxSettings, airtime: &Airtime) -> f64 {
        let smart = self.registers.sys_cfg() & sys_cfg::DIS_STXP == 0;
        let frame_us = airtime.total_ticks() as f64 / TICKS_PER_S as f64 * 1e6;
        let register = self.registers.u32(file::TX_POWER, 0);
        tx_power::power_dbm(register, smart, &settings.phy, frame_us)
    }

    /// TX_STAMP is the internal time plus the configured antenna delay, TX_RAWST the internal time (7.2.25).
    fn report_tx_time(&mut self, plan: &Plan) {
        let raw = plan.rmarker.ticks();
        let delay = i128::from(self.registers.u16(file::TX_ANTD, 0));
        let mut bytes = [0; 10];
        bytes[..5].copy_from_slice(&wrap(raw + delay).to_le_bytes()[..5]);
        bytes[5..].copy_from_slice(&wrap(raw).to_le_bytes()[..5]);
        self.registers.set(file::TX_TIME, 0, &bytes);
    }

    fn take_payload(&self, settings: &TxSettings) -> Vec<u8> {
        let mut payload = vec![0; usize::from(settings.length)];
        self.registers
            .get(file::TX_BUFFER, settings.buffer_offset, &mut payload);
        payload
    }
}
