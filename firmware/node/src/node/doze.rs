//! An initiator whose radio sleeps between rounds.
//!
//! ```text
//!  Nothing ── next round is far ──► Asleep ── 5.5 ms before it ──► Waking ── answers: restored ──► Nothing ── round
//!                                                                   │  ▲ not yet: 0.5 ms later
//!                                                                   └──┴─ not in 25 ms, or not as it was ──► Down
//! ```
//!
//! The processor's clock alone says when: the radio's starts anew with each wake-up.

use super::{Doing, Node, Playing, count};
use crate::bus::RadioBus;
use crate::radio::RadioError;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;

/// From the order to wake a radio that sleeps until it answers, as a rule; from one look at whether it does to the
/// next; and how long it is given.
const WAKE_US: u64 = 4_700;
const WAKE_LOOK_US: u64 = 500;
const WAKE_GUARD_US: u64 = 20_000;

/// How long before a round the radio is woken: what it takes to answer, and to put back what it has lost.
const WAKE_AHEAD_US: u64 = 5_500;

/// The shortest time between rounds for which the radio is sent to sleep.
const LEAST_SLEEP_US: u64 = 2 * WAKE_AHEAD_US;

impl<B: RadioBus, R: OutputPin, D: DelayNs> Node<B, R, D> {
    /// Sends the radio of an initiator to sleep if it is to sleep and the next round is far enough.
    pub(super) fn fall_asleep(&mut self, now_us: u64) -> Result<(), RadioError> {
        if let (Playing::Initiator(polling), Doing::Nothing) = (&self.playing, self.doing)
            && polling.sleeps
            && polling.turn_us >= now_us + LEAST_SLEEP_US
        {
            self.doing = Doing::Asleep {
                since_us: now_us,
                wake_us: polling.turn_us - WAKE_AHEAD_US,
            };
            self.radio.fall_asleep()?;
        }
        Ok(())
    }

    /// Wakes a radio that sleeps when its time has come. Whether it is awake.
    pub(super) fn wake_up(&mut self, now_us: u64) -> Result<bool, RadioError> {
        match self.doing {
            Doing::Asleep { since_us, wake_us } if now_us >= wake_us => {
                self.radio.wake()?;
                // Who sleeps hears nobody: that is no silence.
                self.heard_us += now_us.saturating_sub(since_us);
                self.doing = Doing::Waking {
                    look_us: now_us + WAKE_US,
                    until_us: now_us + WAKE_US + WAKE_GUARD_US,
                };
                Ok(false)
            }
            Doing::Waking { look_us, until_us } if now_us >= look_us => {
                match self.radio.resume() {
                    Ok(()) => {
                        self.doing = Doing::Nothing;
                        if let Playing::Initiator(polling) = &mut self.playing {
                            polling.slept = true;
                        }
                        return Ok(true);
                    }
                    Err(RadioError::WrongDevice(_)) if now_us < until_us => {
                        self.doing = Doing::Waking {
                            look_us: now_us + WAKE_LOOK_US,
                            until_us,
                        };
                    }
                    Err(error) => {
                        count(&mut self.counters.late_wakeups);
                        return Err(error);
                    }
                }
                Ok(false)
            }
            Doing::Asleep { .. } | Doing::Waking { .. } => Ok(false),
            _ => Ok(true),
        }
    }
}
