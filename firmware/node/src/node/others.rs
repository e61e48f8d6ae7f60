//! What is heard outside of this node's own rounds.

use super::{Node, Playing, count};
use crate::bus::RadioBus;
use crate::radio::RadioError;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::superframe::Superframe;
use nova_ranging::{DeviceTime, Event, Frame, FrameError, Ignored};
use nova_wire::{Overheard, OverheardInterval, Record};

/// What a listener has heard and not told yet; shorter than a record, of which there are longer ones.
pub(super) enum Untold {
    Frame(Overheard),
    Interval(OverheardInterval),
}

impl From<Untold> for Record {
    fn from(untold: Untold) -> Self {
        match untold {
            Untold::Frame(frame) => Self::Overheard(frame),
            Untold::Interval(interval) => Self::OverheardInterval(interval),
        }
    }
}

impl<B: RadioBus, R: OutputPin, D: DelayNs> Node<B, R, D> {
    /// What an initiator hears and sends outside of its rounds.
    pub(super) fn overhear(&mut self, event: Event<'_>, now_us: u64) -> Result<(), RadioError> {
        match event {
            Event::Sent { at } => {
                self.after_sending(at, now_us);
                let at_us = now_us.saturating_sub(self.age_us(at)?);
                if let Playing::Initiator(polling) = &mut self.playing
                    && core::mem::take(&mut polling.beacon)
                {
                    polling.air.on_beacon_sent(at_us);
                }
                Ok(())
            }
            Event::Received { bytes, at } => {
                self.keep_listening(now_us)?;
                let identity = self.config.identity;
                let counter = match Frame::parse(bytes) {
                    Ok(frame) if frame.pan == identity.pan => &mut self.counters.others_frames,
                    Err(FrameError::Check) => &mut self.counters.bus_errors,
                    _ => &mut self.counters.foreign_frames,
                };
                count(counter);
                self.note(bytes, at, now_us)
            }
            Event::ListenTimeout | Event::SendTooLate => {
                count(&mut self.counters.unexpected_events);
                self.listen(None, now_us).map(|_| ())
            }
        }
    }

    /// What a listener hears goes to the host, once the air is quiet.
    pub(super) fn eavesdrop(
        &mut self,
        event: Event<'_>,
        now_us: u64,
        emit: &mut impl FnMut(&Record),
    ) -> Result<(), RadioError> {
        let Event::Received { bytes, at } = event else {
            count(&mut self.counters.unexpected_events);
            return self.listen(None, now_us).map(|_| ());
        };
        let frame = match Frame::parse(bytes) {
            Ok(frame) => frame,
            Err(why) => {
                count(self.ignored_counter(Ignored::NotOurs(why)));
                return self.listen(None, now_us).map(|_| ());
            }
        };
        let quality = self.radio.reception()?.quality(false);
        // Another may follow at once.
        self.listen(None, now_us)?;
        let t_us = now_us.saturating_sub(self.age_us(at)?);
        let heard = Untold::Frame(Overheard {
            t_us,
            at_ticks: at.ticks(),
            pan: frame.pan.0,
            source: frame.source.0,
            destination: frame.destination.0,
            message: frame.message.code(),
            round: frame.round,
            sequence: frame.sequence,
            quality: Some(quality),
        });
        let intervals = frame.intervals().map(|(peer, round, reply)| {
            Untold::Interval(OverheardInterval {
                source: frame.source.0,
                peer: peer.0,
                round: frame.round,
                round_ticks: round.get(),
                reply_ticks: reply.get(),
            })
        });
        for untold in core::iter::once(heard).chain(intervals) {
            // In order, and none is lost: who waits longest is told now where there is no room.
            if self.untold.is_full()
                && let Some(longest) = self.untold.pop_front()
            {
                emit(&longest.into());
            }
            // There is room now.
            let _ = self.untold.push_back(untold);
        }
        Ok(())
    }

    /// Takes note of a frame that is not for this node's own round.
    pub(super) fn note(
        &mut self,
        bytes: &[u8],
        at: DeviceTime,
        now_us: u64,
    ) -> Result<(), RadioError> {
        if !matches!(self.playing, Playing::Initiator(_)) {
            return Ok(());
        }
        let frame = Frame::parse(bytes);
        let at_us = match &frame {
            // To ask the radio for the time takes a while.
            Ok(frame) if Superframe::heeds(&frame.message) => {
                now_us.saturating_sub(self.age_us(at)?)
            }
            _ => now_us,
        };
        if let Playing::Initiator(polling) = &mut self.playing {
            match frame {
                Ok(frame) => polling.air.on_frame(&frame, at_us),
                Err(_) => polling.air.on_noise(now_us),
            }
        }
        Ok(())
    }
}
