//! The node: radio, state machine, deadlines, counters and records.

mod doing;
mod doze;
mod others;
mod playing;
mod records;

use doing::Doing;
use others::Untold;
use playing::Playing;

use crate::bus::RadioBus;
use crate::config::{AntennaDelay, ConfigError, NodeConfig};
use crate::diagnostics::Reception;
use crate::judge::Judge;
use crate::level::Levels;
use crate::radio::{EMPTY_RX_BUFFER, Radio, RadioError, RadioEvent};
use core::fmt;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::{Command, DeviceTime, Event, Failure, MAX_RESPONDERS, Outcome, Timing};
use nova_wire::{Counters, Record, SettingsSource};

/// From one status record to the next.
const STATUS_PERIOD_US: u64 = 1_000_000;

/// How long what is due once a second waits for a moment in which it takes no frame's
/// time: see [`Node::spare`].
const PATIENCE_US: u64 = 100_000;

/// How much later than the radio's own time-out the node gives up on it.
const LISTEN_GUARD_US: u64 = 2_000;

/// A receiver that has heard nothing for this long is switched on anew, so
/// that none stays deaf for ever.
const LISTEN_REFRESH_US: u64 = 1_000_000;

/// From one look at whether the radio still holds its settings to the next.
const CHECK_PERIOD_US: u64 = 1_000_000;

/// A radio that has received no frame for so long is started again.
const SILENCE_US: u64 = 5_000_000;

/// As is one that has given no range for that long although so many were tried.
const FRUITLESS: u32 = 100;

/// From a failed start of the radio to the next attempt.
const RESTART_AFTER_US: u64 = 100_000;

/// Events handled in one call of [`Node::service`], so that a radio that never
/// stops reporting cannot hold up the rest of the board.
const EVENTS_PER_CALL: usize = 8;

/// Records that a listener keeps until the air is quiet: making one takes as long as a frame, and who is at it when the
/// next frame ends listens again too late for the one after that. Those of a round with eight responders.
const UNTOLD: usize = 34;

/// The air is quiet when nothing was heard for so long: more than from one frame of a round to the next, but in modes
/// that are slow enough for a record in between.
const QUIET_US: u64 = 900;

/// A node that takes part in exchanges.
///
/// `B`: the radio's bus, `R`: its reset line (open drain, low resets), `D`: a
/// delay, used only while the radio starts.
pub struct Node<B, R, D> {
    config: NodeConfig,
    radio: Radio<B, R, D>,
    playing: Playing,
    doing: Doing,
    timing: Timing,
    /// How well the frames were received on whose time stamps ranges rest: the response
    /// in each slot at the initiator; the final, the first, at the responder.
    receptions: [Reception; MAX_RESPONDERS],
    judge: Judge,
    levels: Levels,
    counters: Counters,
    /// What a listener has heard and not told yet.
    untold: heapless::Deque<Untold, UNTOLD>,
    next_status_us: u64,
    next_check_us: u64,
    /// When a frame was received last, or the radio started.
    heard_us: u64,
    /// When a range was measured last, or the radio started; and what failed since.
    measured_us: u64,
    fruitless: u32,
    /// Whether a frame of this node's has just left whose answer takes a reply time: then there is time
    /// for what is due once a second. Between rounds there may be none, as a poll can come at any time.
    spare: bool,
    booted: bool,
    /// Whether the radio's start has been tried before.
    tried: bool,
}

/// The radio did not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StartError(pub RadioError);

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the radio did not start: {}", self.0)
    }
}

impl core::error::Error for StartError {}

impl<B: RadioBus, R: OutputPin, D: DelayNs> Node<B, R, D> {
    /// A node whose radio is not started yet.
    ///
    /// # Errors
    /// [`ConfigError`] says which setting cannot work.
    pub fn new(bus: B, reset: R, delay: D, config: NodeConfig) -> Result<Self, ConfigError> {
        config.check()?;
        let timing = config.timing(config.antenna_delay.or(AntennaDelay::UNCALIBRATED));
        Ok(Self {
            radio: Radio::new(bus, reset, delay, config.phy, config.antenna_delay),
            playing: Playing::by(&config, timing),
            counters: Counters {
                settings_discarded: u32::from(matches!(
                    config.settings,
                    SettingsSource::Damaged
                        | SettingsSource::OtherVersion
                        | SettingsSource::FlashFailed
                )),
                ..Counters::default()
            },
            judge: Judge::new(&config.phy, config.filter),
            levels: Levels::default(),
            untold: heapless::Deque::new(),
            config,
            doing: Doing::Down { retry_us: 0 },
            timing,
            receptions: [Reception::default(); MAX_RESPONDERS],
            next_status_us: 0,
            next_check_us: 0,
            heard_us: 0,
            measured_us: 0,
            fruitless: 0,
            spare: false,
            booted: false,
            tried: false,
        })
    }

    /// Works by another configuration from now on. An exchange that runs is
    /// given up; the radio is started again by the next [`Node::service`].
    ///
    /// # Errors
    /// [`ConfigError`] says which setting cannot work; nothing has changed then.
    pub fn reconfigure(&mut self, config: NodeConfig, now_us: u64) -> Result<(), ConfigError> {
        config.check()?;
        if !self.playing.is_idle() {
            count(&mut self.counters.cut_off);
        }
        self.timing = config.timing(config.antenna_delay.or(AntennaDelay::UNCALIBRATED));
        self.playing = Playing::by(&config, self.timing);
        self.judge = Judge::new(&config.phy, config.filter);
        self.levels = Levels::default();
        self.radio.set_up_as(config.phy, config.antenna_delay);
        self.config = config;
        self.doing = Doing::Down { retry_us: now_us };
        // A start that was asked for is none of the radio's faults.
        self.tried = false;
        Ok(())
    }

    /// Starts the radio; blocks for some 10 ms.
    ///
    /// Calling this is not required: [`Node::service`] starts a radio that is
    /// not running, and tries again for as long as that fails. It serves to
    /// learn of a fault at once.
    ///
    /// # Errors
    /// [`StartError`] says what is wrong with the radio.
    pub fn start(&mut self, now_us: u64) -> Result<(), StartError> {
        if core::mem::replace(&mut self.tried, true) {
            count(&mut self.counters.radio_resets);
        }
        self.next_check_us = now_us + CHECK_PERIOD_US;
        self.radio
            .start()
            .and_then(|()| self.begin(now_us))
            .map_err(|error| {
                self.out_of_order(now_us, error);
                StartError(error)
            })
    }

    /// Does all that is due at `now_us`, the board's time in microseconds
    /// since its start, and hands records to `emit`. Takes some 100 us, and
    /// some 10 ms when the radio has to be started again.
    ///
    /// Returns the time at which it must be called again, unless the radio's
    /// interrupt line goes high before.
    pub fn service(&mut self, now_us: u64, emit: &mut impl FnMut(&Record)) -> u64 {
        self.spare = false;
        if !self.booted {
            self.booted = true;
            self.next_status_us = now_us + STATUS_PERIOD_US;
            emit(&Record::Boot(self.about()));
        }
        match self.doing {
            Doing::Down { retry_us } if now_us >= retry_us => {
                // The outcome is in `doing` and in the counters. `now_us` is long over when
                // the radio has started: what is due comes with the next call.
                let _ = self.start(now_us);
            }
            Doing::Down { .. } => {}
            _ => {
                if let Err(error) = self.run(now_us, emit) {
                    self.out_of_order(now_us, error);
                }
            }
        }
        // One, and then the radio is looked at again.
        if now_us >= self.heard_us + QUIET_US
            && let Some(untold) = self.untold.pop_front()
        {
            emit(&untold.into());
        }
        if self.is_time_for(self.next_status_us, now_us) {
            // From when it was due, so that a late one does not move the next.
            self.next_status_us += STATUS_PERIOD_US;
            if self.next_status_us <= now_us {
                self.next_status_us = now_us + STATUS_PERIOD_US;
            }
            emit(&Record::Status(self.status(now_us)));
        }
        self.wake_us()
    }

    /// Radio events first, then deadlines, then new rounds.
    fn run(&mut self, now_us: u64, emit: &mut impl FnMut(&Record)) -> Result<(), RadioError> {
        if !self.wake_up(now_us)? {
            return Ok(());
        }
        // There may be nobody; or this radio is deaf, or mute, which looks the same.
        let mute = self.fruitless >= FRUITLESS && now_us >= self.measured_us + SILENCE_US;
        if mute || now_us >= self.heard_us + SILENCE_US {
            count(&mut self.counters.silences);
            return self.radio.start().and_then(|()| self.begin(now_us));
        }
        let mut buffer = EMPTY_RX_BUFFER;
        for _ in 0..EVENTS_PER_CALL {
            let Some(event) = self.radio.poll(&mut buffer)? else {
                break;
            };
            let event = match event {
                RadioEvent::Sent { at } => Event::Sent { at },
                RadioEvent::Received { bytes, at } => {
                    self.heard_us = now_us;
                    Event::Received { bytes, at }
                }
                RadioEvent::ListenTimeout => Event::ListenTimeout,
                RadioEvent::Damaged => {
                    count(&mut self.counters.damaged_frames);
                    if let Playing::Initiator(polling) = &mut self.playing {
                        polling.air.on_noise(now_us);
                    }
                    match self.keep_listening(now_us)? {
                        Some(event) => event,
                        None => continue,
                    }
                }
            };
            if let Playing::Listener = self.playing {
                self.eavesdrop(event, now_us, emit)?;
            } else if matches!(self.playing, Playing::Initiator(_)) && self.playing.is_idle() {
                self.overhear(event, now_us)?;
            } else {
                self.handle(event, now_us, emit)?;
            }
        }
        let c = &mut self.counters;
        c.bus_errors = c.bus_errors.wrapping_add(self.radio.take_bus_errors());
        self.check_deadlines(now_us);
        self.check_settings(now_us)?;
        self.start_round(now_us)
    }

    /// Lets the state machine answer an event and carries its commands out.
    fn handle(
        &mut self,
        event: Event<'_>,
        now_us: u64,
        emit: &mut impl FnMut(&Record),
    ) -> Result<(), RadioError> {
        let mut step = self.playing.on_event(event);
        let goes_on = matches!(step.command, Command::Send { .. } | Command::Listen { .. });
        // A frame that counts in the middle of a round, neither its end nor a stranger.
        let counts = matches!(event, Event::Received { .. }) && goes_on && step.outcome.is_none();
        if let Event::Sent { at } = event {
            self.after_sending(at, now_us);
        }
        loop {
            // What is to be done first: its time is short.
            let next = self.carry_out(step.command, now_us)?;
            match step.outcome {
                Some(Outcome::Measured(measurement)) => {
                    count(&mut self.counters.ranges);
                    (self.measured_us, self.fruitless) = (now_us, 0);
                    self.playing.measured(measurement.peer, now_us);
                    if self.playing.may_hurry() {
                        // If a poll is due it does not wait for this record; its answer takes longer.
                        self.start_round(now_us)?;
                    }
                    let record = self.range_record(&measurement, now_us)?;
                    emit(&Record::Range(record));
                }
                Some(Outcome::Failed { peer, why }) => {
                    count(self.failure_counter(&why));
                    if why != Failure::NobodyNew {
                        self.fruitless = self.fruitless.saturating_add(1);
                    }
                    self.playing.failed(peer, now_us);
                }
                Some(Outcome::Ignored(ignored)) => {
                    count(self.ignored_counter(ignored));
                    if let Event::Received { bytes, at } = event {
                        self.note(bytes, at, now_us)?;
                    }
                }
                None => {}
            }
            match next {
                Some(event) => step = self.playing.on_event(event),
                None => break,
            }
        }
        if counts && self.playing.measures_by_this() {
            // Now that what comes next is on its way there is time.
            let mut reception = self.radio.reception()?;
            let expected = self
                .playing
                .partner()
                .is_some_and(|peer| (self.levels).expects(peer, reception.rx_power_dbm(), now_us));
            if !expected {
                // It was another level, or the bus has lost a bit.
                self.radio.read_level_again(&mut reception)?;
            }
            if let Some(place) = self.receptions.get_mut(self.playing.slot()) {
                *place = reception;
            }
        }
        Ok(())
    }

    /// How long ago the radio's clock showed `at`.
    fn age_us(&mut self, at: DeviceTime) -> Result<u64, RadioError> {
        Ok(self.radio.now()?.since(at).to_us().into())
    }

    /// Whether something that was due at `due_us` is done now.
    fn is_time_for(&self, due_us: u64, now_us: u64) -> bool {
        let patience_us = if self.spare { 0 } else { PATIENCE_US };
        now_us >= due_us + patience_us
    }

    /// Looks from time to time, when there is time, whether the radio is
    /// still what it was set up to be.
    fn check_settings(&mut self, now_us: u64) -> Result<(), RadioError> {
        let idle = matches!(self.doing, Doing::Nothing | Doing::ListeningForEver { .. });
        if (idle || self.spare) && self.is_time_for(self.next_check_us, now_us) {
            self.next_check_us = now_us + CHECK_PERIOD_US;
            self.radio.check_settings()?;
        }
        if let Doing::ListeningForEver { refresh_us } = self.doing
            && now_us >= refresh_us
        {
            self.radio.switch_off()?;
            self.listen(None, now_us)?;
        }
        Ok(())
    }

    /// Begins what an initiator has to say, if it may.
    fn start_round(&mut self, now_us: u64) -> Result<(), RadioError> {
        let listening = match self.doing {
            Doing::Nothing => false,
            Doing::ListeningForEver { .. } => true,
            _ => return Ok(()),
        };
        let Playing::Initiator(polling) = &mut self.playing else {
            return Ok(());
        };
        let command = polling.next(now_us);
        let left_out = polling.air.take_left_out();
        let listens = polling.air.listens();
        let c = &mut self.counters;
        c.late_wakeups = (c.late_wakeups).wrapping_add(core::mem::take(&mut polling.late).into());
        c.slots_left_out = c.slots_left_out.wrapping_add(left_out.slots);
        c.beacons_left_out = c.beacons_left_out.wrapping_add(left_out.beacons);
        match command {
            Some(command) => {
                if listening {
                    // The radio does not send while it listens.
                    self.radio.switch_off()?;
                }
                // What is sent at once cannot be late.
                self.carry_out(command, now_us).map(|_| ())
            }
            None if listens && !listening => self.listen(None, now_us).map(|_| ()),
            None => self.fall_asleep(now_us),
        }
    }

    /// Puts a radio that was just started to work.
    fn begin(&mut self, now_us: u64) -> Result<(), RadioError> {
        (self.heard_us, self.measured_us, self.fruitless) = (now_us, now_us, 0);
        if !self.playing.is_idle() {
            count(&mut self.counters.cut_off);
        }
        // The factory's antenna delay is known only now.
        self.timing = self.config.timing(self.radio.antenna_delay());
        self.playing.set_timing(self.timing);
        match &mut self.playing {
            Playing::Responder(machine) => {
                let command = machine.start();
                self.carry_out(command, now_us).map(|_| ())
            }
            Playing::Listener => self.listen(None, now_us).map(|_| ()),
            Playing::Initiator(polling) => {
                polling.machine.stop();
                polling.beacon = false;
                polling.repeat_until_us = None;
                polling.next_us = polling.next_us.max(now_us);
                polling.turn_us = now_us;
                self.doing = Doing::Nothing;
                Ok(())
            }
        }
    }

    fn out_of_order(&mut self, now_us: u64, error: RadioError) {
        if error == RadioError::Bus {
            count(&mut self.counters.bus_errors);
        }
        self.doing = Doing::Down {
            retry_us: now_us + RESTART_AFTER_US,
        };
    }

    fn wake_us(&self) -> u64 {
        let turn_us = match &self.playing {
            Playing::Initiator(polling) => polling.turn_us,
            Playing::Responder(_) | Playing::Listener => u64::MAX,
        };
        let radio_us = match self.doing {
            Doing::Nothing => turn_us,
            Doing::Sending { until_us, .. } => until_us,
            Doing::Listening { until_us, .. } => until_us + LISTEN_GUARD_US,
            Doing::ListeningForEver { refresh_us } => refresh_us
                .min(self.next_check_us + PATIENCE_US)
                .min(turn_us),
            Doing::Asleep { wake_us, .. } => wake_us,
            Doing::Waking { look_us, .. } => look_us,
            Doing::Down { retry_us } => retry_us,
        };
        let untold_us = if self.untold.is_empty() {
            u64::MAX
        } else {
            self.heard_us + QUIET_US
        };
        (radio_us.min(untold_us)).min(self.next_status_us + PATIENCE_US)
    }
}

fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
