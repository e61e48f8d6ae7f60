//! The leading edge search (LDE): from a RMARKER to time stamp and diagnostics (User Manual 4.1.6, 7.2.23, 7.2.47).
//!
//! The time stamp is the RMARKER's arrival at the antenna, plus the true antenna delay, in the receiver's clock, plus
//! noise and the bias of its level, rounded to a tick, minus the antenna delay that LDE_RXANTD holds.

use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};

use crate::airtime::preamble_symbol_ticks;
use crate::clock::wrap;
use crate::time::SimTime;

use super::Chip;
use super::accumulator::Accumulator;
use super::bits::{file, status, sub};
use super::diagnostics::{Diagnostics, Reception, diagnose};
use super::range_bias::stamp_bias_ticks;
use super::receiver::{Lock, RxEvent};

/// The coarse time stamp is a multiple of 512 ticks, on average this much before the corrected one (recorded
/// exchanges: 1028 ticks).
const RAW_STAMP_LEAD_TICKS: f64 = 772.0;
const RAW_STAMP_GRID: i128 = 512;

/// At most one search runs at a time.
#[derive(Debug, Default)]
pub(super) struct LeadingEdge {
    job: Option<LdeJob>,
    count: u32,
}

impl LeadingEdge {
    pub(super) fn cancel(&mut self) {
        self.job = None;
    }
}

/// A search under way.
#[derive(Debug)]
struct LdeJob {
    number: u32,
    buffer: usize,
    stamp: u64,
    raw_stamp: u64,
    diagnostics: Diagnostics,
}

impl Chip {
    /// Starts the leading edge search at the RMARKER; returns RXPACC.
    pub(super) fn time_stamp(&mut self, now: SimTime, lock: &Lock) -> u16 {
        let wave = &lock.signal.wave;
        let internal = wave.rmarker + Self::fixed_delay(self.rx_antenna_delay_ticks);
        let normal: f64 = StandardNormal.sample(&mut self.rng);
        let mut phase = self
            .clock
            .phase_at(internal)
            .plus_ticks_f64(normal * self.rx_noise_ticks);
        if self.quirks.range_bias {
            let (channel, prf) = (wave.phy.channel, wave.phy.prf);
            phase = phase.plus_ticks_f64(stamp_bias_ticks(channel, prf, wave.power_dbm));
        }
        let limit = i128::from(self.quirks.stale_receiver_error_ticks);
        if self.receiver.stale && limit > 0 {
            phase = phase.plus_ticks(self.rng.random_range(-limit..=limit));
            self.stats.stale_timestamps += 1;
        }

        let coarse = phase.plus_ticks_f64(-RAW_STAMP_LEAD_TICKS).ticks();
        let raw = coarse.div_euclid(RAW_STAMP_GRID) * RAW_STAMP_GRID;
        let configured = i128::from(self.registers.u16(file::LDE_IF, sub::LDE_RXANTD));
        let symbol_ticks = preamble_symbol_ticks(wave.phy.prf) as f64;
        let accumulated = self
            .clock
            .phase_at(wave.sfd_start)
            .since(self.clock.phase_at(lock.detected_at));
        let diagnostics = diagnose(
            &lock.signal,
            &Reception {
                symbols: (accumulated / symbol_ticks).clamp(1.0, 3800.0) as u16,
                own_ppm: self.clock.ppm_at(now),
                clock_fraction: (coarse - raw) as f64 / RAW_STAMP_GRID as f64,
                report: self.quirks.level_report,
            },
        );

        self.receiver.lde.count += 1;
        let number = self.receiver.lde.count;
        self.receiver.lde.job = Some(LdeJob {
            number,
            buffer: self.buffers.chip_index(),
            stamp: wrap(phase.ticks_rounded() - configured),
            raw_stamp: wrap(raw),
            diagnostics,
        });
        let at = now + self.timing.lde_run;
        self.ask_rx(at, RxEvent::LdeDone(number));
        diagnostics.rxpacc
    }

    pub(super) fn on_lde_done(&mut self, number: u32) {
        let Some(job) = self.receiver.lde.job.take_if(|job| job.number == number) else {
            return;
        };
        if !self.lde_enabled() || !self.power.lde_loaded {
            // No time stamp and no event; the registers keep what they held.
            return;
        }
        let d = &job.diagnostics;
        let seed: u64 = self.rng.random();
        self.receiver.accumulator = Some(Accumulator::new(d, seed));
        let storage = [
            (file::LDE_IF, sub::LDE_PPINDX, u32::from(d.peak_index), 2),
            (file::LDE_IF, sub::LDE_PPAMPL, u32::from(d.peak_ampl), 2),
            // 21 bits, two's complement.
            (
                file::DRX_CONF,
                sub::DRX_CAR_INT,
                d.carrier_integrator as u32 & 0x1F_FFFF,
                3,
            ),
            (
                file::DRX_CONF,
                sub::RXPACC_NOSAT,
                u32::from(d.rxpacc_nosat),
                2,
            ),
        ];
        for (id, offset, value, len) in storage {
            self.registers.set(id, offset, &value.to_le_bytes()[..len]);
        }

        let set = self.buffers.set_mut(job.buffer);
        let [f1, f2, f3] = d.fp_ampl.map(u16::to_le_bytes);
        set.time[..5].copy_from_slice(&job.stamp.to_le_bytes()[..5]);
        set.time[5..7].copy_from_slice(&d.fp_index.to_le_bytes());
        set.time[7..9].copy_from_slice(&f1);
        set.time[9..].copy_from_slice(&job.raw_stamp.to_le_bytes()[..5]);
        set.fqual[..2].copy_from_slice(&d.std_noise.to_le_bytes());
        set.fqual[2..4].copy_from_slice(&f2);
        set.fqual[4..6].copy_from_slice(&f3);
        set.fqual[6..].copy_from_slice(&d.cir_pwr.to_le_bytes());
        set.tracking_interval = d.tracking_interval.to_le_bytes();
        let offset = (d.tracking_offset as u32 & 0x7_FFFF).to_le_bytes();
        set.tracking_offset[..4].copy_from_slice(&offset);
        set.status |= status::LDEDONE;
    }
}
