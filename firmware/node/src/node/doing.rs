//! What the radio is at, and until when at most: the state machine's commands carried out.

use super::{LISTEN_GUARD_US, LISTEN_REFRESH_US, Node};
use crate::bus::RadioBus;
use crate::radio::RadioError;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::{Command, DeviceTime, Event, Then, Ticks};

/// A send that has not come to an end so long after its time never will.
const SEND_GUARD_US: u64 = 10_000;

/// What the radio is at, and until when at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Doing {
    Nothing,
    Sending {
        until_us: u64,
        /// From the frame's marker to its end.
        tail_us: u32,
        then: Then,
    },
    Listening {
        until: DeviceTime,
        until_us: u64,
    },
    ListeningForEver {
        refresh_us: u64,
    },
    /// The radio sleeps.
    Asleep {
        since_us: u64,
        /// When it is to be woken.
        wake_us: u64,
    },
    /// The radio is waking.
    Waking {
        /// When to look whether it answers.
        look_us: u64,
        /// Until when it has to.
        until_us: u64,
    },
    /// The radio is out of order; to be started again.
    Down {
        retry_us: u64,
    },
}

impl<B: RadioBus, R: OutputPin, D: DelayNs> Node<B, R, D> {
    /// What came of it, if that is known at once.
    pub(super) fn carry_out(
        &mut self,
        command: Command,
        now_us: u64,
    ) -> Result<Option<Event<'static>>, RadioError> {
        match command {
            Command::Idle => {
                self.radio.switch_off()?;
                self.doing = Doing::Nothing;
            }
            Command::Listen { until } => return self.listen(until, now_us),
            Command::KeepListening => return self.keep_listening(now_us),
            // See `after_sending`.
            Command::Wait => {}
            Command::Send {
                frame,
                when,
                ahead_us,
                then,
            } => {
                let on_time = self.radio.send(&frame, when, then)?;
                let tail_us = self.timing.tail_us(frame.len());
                let takes_us = u64::from(ahead_us + self.timing.preamble_us() + tail_us);
                self.doing = Doing::Sending {
                    until_us: now_us + takes_us + SEND_GUARD_US,
                    tail_us,
                    then,
                };
                if !on_time {
                    return Ok(Some(Event::SendTooLate));
                }
            }
        }
        Ok(None)
    }

    pub(super) fn listen(
        &mut self,
        until: Option<DeviceTime>,
        now_us: u64,
    ) -> Result<Option<Event<'static>>, RadioError> {
        let left_us = self.radio.listen(until)?;
        self.doing = match until {
            Some(until) => Doing::Listening {
                until,
                until_us: now_us + u64::from(left_us.unwrap_or(0)),
            },
            None => Doing::ListeningForEver {
                refresh_us: now_us + LISTEN_REFRESH_US,
            },
        };
        Ok(left_us.is_none().then_some(Event::ListenTimeout))
    }

    /// Switches the receiver on again after a frame that did not count, for
    /// what is left of the time.
    pub(super) fn keep_listening(
        &mut self,
        now_us: u64,
    ) -> Result<Option<Event<'static>>, RadioError> {
        match self.doing {
            Doing::Listening { until, .. } => self.listen(Some(until), now_us),
            Doing::ListeningForEver { .. } => self.listen(None, now_us),
            // Nothing to go on with: a damaged frame cannot come while sending.
            _ => Ok(None),
        }
    }

    /// What the radio is at now that a frame has gone.
    pub(super) fn after_sending(&mut self, at: DeviceTime, now_us: u64) {
        let Doing::Sending { tail_us, then, .. } = self.doing else {
            return;
        };
        self.spare = matches!(
            then,
            Then::Listen {
                timeout_us: Some(_),
                ..
            }
        );
        self.doing = match then {
            Then::Idle => Doing::Nothing,
            Then::Listen {
                after_us,
                timeout_us: Some(timeout_us),
            } => Doing::Listening {
                until: at.after(Ticks::from_us(tail_us + after_us + timeout_us)),
                until_us: now_us + u64::from(after_us) + u64::from(timeout_us),
            },
            Then::Listen {
                timeout_us: None, ..
            } => Doing::ListeningForEver {
                refresh_us: now_us + LISTEN_REFRESH_US,
            },
        };
    }

    pub(super) fn check_deadlines(&mut self, now_us: u64) {
        let missed = match self.doing {
            Doing::Sending { until_us, .. } => now_us >= until_us,
            Doing::Listening { until_us, .. } => now_us >= until_us + LISTEN_GUARD_US,
            _ => false,
        };
        if missed {
            // The radio has stopped answering.
            self.doing = Doing::Down { retry_us: now_us };
        }
    }
}
