//! What the node says of itself: counters, status, records of ranges.

use super::{Node, Playing, count};
use crate::bus::RadioBus;
use crate::config::AntennaDelay;
use crate::radio::RadioError;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::tof::SPEED_OF_LIGHT_AIR_M_PER_S;
use nova_ranging::{Failure, FrameError, Ignored, Measurement};
use nova_wire::{Boot, Counters, Range, RangeFlags, Status};

impl<B: RadioBus, R: OutputPin, D: DelayNs> Node<B, R, D> {
    /// What happened since the node was made, by cause.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Tells the node that records were thrown away on their way to the host.
    pub fn count_dropped_records(&mut self, dropped: u32) {
        self.counters.records_dropped = self.counters.records_dropped.wrapping_add(dropped);
    }

    /// Tells the node that a frame from the host held no command.
    pub fn count_bad_command(&mut self) {
        count(&mut self.counters.bad_commands);
    }

    /// Tells the node that a command was refused, and whether that was the
    /// flash's fault.
    pub fn count_refused_command(&mut self, flash_failed: bool) {
        count(&mut self.counters.refused_commands);
        if flash_failed {
            count(&mut self.counters.flash_errors);
        }
    }

    /// The antenna delays that the radio was told when it was started last.
    pub fn antenna_delay(&self) -> AntennaDelay {
        self.radio.antenna_delay()
    }

    /// How the node is doing.
    pub fn status(&self, now_us: u64) -> Status {
        Status {
            t_us: now_us,
            address: self.config.identity.address.0,
            counters: self.counters,
        }
    }

    /// What the node is.
    pub fn about(&self) -> Boot {
        Boot {
            address: self.config.identity.address.0,
            pan: self.config.identity.pan.0,
            role: self.config.role,
            firmware: self.config.firmware,
            reset_cause: self.config.reset_cause,
            settings: self.config.settings,
        }
    }

    pub(super) fn range_record(
        &mut self,
        m: &Measurement,
        now_us: u64,
    ) -> Result<Range, RadioError> {
        let age_us = self.radio.now()?.since(m.at).to_us();
        let reception = (self.receptions.get(usize::from(m.slot)))
            .copied()
            .unwrap_or_default();
        let initiator = matches!(self.playing, Playing::Initiator(_));
        let quality = reception.quality(initiator);
        let phy = &self.config.phy;
        let level_dbm = self.levels.update(m.peer, quality.rx_power_dbm, now_us);
        let bias_m = phy.range_bias_m(phy.prf.true_level_dbm(level_dbm));
        let mut range = Range {
            t_us: now_us.saturating_sub(u64::from(age_us)),
            peer: m.peer.0,
            exchange: m.round,
            raw_m: m.two_way.range_m(SPEED_OF_LIGHT_AIR_M_PER_S) as f32 - bias_m,
            bias_m,
            clock_offset_ppm: m.two_way.clock_offset_ppm as f32,
            quality: Some(quality),
            flags: if initiator {
                RangeFlags::INITIATOR
            } else {
                RangeFlags::default()
            },
            ..Range::default()
        };
        self.judge.judge(&mut range);
        Ok(range)
    }

    pub(super) fn failure_counter(&mut self, failure: &Failure) -> &mut u32 {
        let c = &mut self.counters;
        match failure {
            Failure::NobodyNew => &mut c.unanswered_searches,
            Failure::NoResponse => &mut c.no_response,
            Failure::NoFinal => &mut c.no_final,
            Failure::NoReport => &mut c.no_report,
            Failure::Superseded => &mut c.superseded,
            Failure::SendTooLate => &mut c.send_too_late,
            Failure::SendTimeMismatch => &mut c.send_time_mismatch,
            Failure::NotHeard => &mut c.not_heard,
            Failure::Tof(_) => &mut c.bad_stamps,
            Failure::Implausible => &mut c.implausible,
            Failure::UnexpectedEvent => &mut c.unexpected_events,
        }
    }

    pub(super) fn ignored_counter(&mut self, ignored: Ignored) -> &mut u32 {
        let c = &mut self.counters;
        match ignored {
            // The radio's own check was good: the bus has lost a bit, here or there.
            Ignored::NotOurs(FrameError::Check) => &mut c.bus_errors,
            Ignored::NotOurs(_) | Ignored::ForeignNetwork => &mut c.foreign_frames,
            Ignored::ForOthers
            | Ignored::WrongPeer
            | Ignored::WrongRound
            | Ignored::OutOfTurn
            | Ignored::LeftToOthers => &mut c.others_frames,
            Ignored::OutOfTime | Ignored::TooSlow => &mut c.out_of_time,
            Ignored::TooFast => &mut c.polls_too_fast,
        }
    }
}
