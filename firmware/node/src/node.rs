//! The node: radio, state machine, deadlines, counters and records.

mod doze;

use crate::bus::RadioBus;
use crate::config::{AntennaDelay, ConfigError, NodeConfig, Part};
use crate::diagnostics::Reception;
use crate::judge::Judge;
use crate::level::Levels;
use crate::peers::{Peers, Plan};
use crate::radio::{EMPTY_RX_BUFFER, Radio, RadioError, RadioEvent};
use core::fmt;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::superframe::{Random, Superframe, Turn};
use nova_ranging::tof::SPEED_OF_LIGHT_AIR_M_PER_S;
use nova_ranging::{
    Address, Command, DeviceTime, Event, Failure, Frame, FrameError, Ignored, Initiator,
    MAX_RESPONDERS, Measurement, Message, Outcome, Responder, Step, Then, Ticks, Timing,
};
use nova_wire::{
    Boot, Counters, Overheard, OverheardInterval, Range, RangeFlags, Record, SettingsSource, Status,
};

/// From one status record to the next.
const STATUS_PERIOD_US: u64 = 1_000_000;

/// How long what is due once a second waits for a moment in which it takes no frame's
/// time: see [`Node::spare`].
const PATIENCE_US: u64 = 100_000;

/// A send that has not come to an end so long after its time never will.
const SEND_GUARD_US: u64 = 10_000;

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

/// A round that begins so much later than due, when the radio has slept, is late.
const LATE_US: u64 = 1_000;

/// From a failed start of the radio to the next attempt.
const RESTART_AFTER_US: u64 = 100_000;

/// Events handled in one call of [`Node::service`], so that a radio that never
/// stops reporting cannot hold up the rest of the board.
const EVENTS_PER_CALL: usize = 8;

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

/// The part in rounds, with what it takes beside its state machine.
// There is one in a node, made at its start and never moved.
#[allow(clippy::large_enum_variant)]
enum Playing {
    Initiator(Polling),
    Responder(Responder),
    Listener,
}

/// What an initiator has beside its radio.
struct Polling {
    machine: Initiator,
    air: Superframe,
    peers: Peers,
    /// Who was named in the round that runs, or ran last, and has given no range yet.
    missing: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Who was still missing when a slot was over. They are polled once more in the next, if
    /// there is time.
    owed: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Until when a repeat has to be over, if there may be one.
    repeat_until_us: Option<u64>,
    /// Whether anybody was missing in the round that runs.
    missed: bool,
    /// The frame that is being sent is a beacon.
    beacon: bool,
    period_us: u64,
    /// Whether the radio sleeps between rounds.
    sleeps: bool,
    /// The radio has slept since the last round.
    slept: bool,
    /// The round that runs has begun late for that.
    late: bool,
    /// When the next round is due.
    next_us: u64,
    /// When to look again whether it can begin.
    turn_us: u64,
    spread: Spread,
}

/// What the radio is at, and until when at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
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

/// Moves an initiator that shares the air with another off the other's times.
///
/// Without it two that have the same period and meet once meet every time.
#[derive(Clone, Copy, Debug)]
struct Spread {
    random: Random,
    /// From the earliest to the latest, in microseconds.
    width_us: u32,
}

impl Spread {
    /// Two exchanges wide, from a different start for each address.
    fn new(address: Address, reply_us: u32) -> Self {
        Self {
            random: Random::new(address),
            width_us: 8 * reply_us,
        }
    }

    /// A shift to either side, so that the rate stays.
    fn next_us(&mut self) -> i64 {
        i64::from(self.random.below(self.width_us)) - i64::from(self.width_us / 2)
    }
}

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

    /// What an initiator hears and sends outside of its rounds.
    fn overhear(&mut self, event: Event<'_>, now_us: u64) -> Result<(), RadioError> {
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

    /// What a listener hears goes to the host.
    fn eavesdrop(
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
        let t_us = now_us.saturating_sub(self.age_us(at)?);
        // Another may follow at once.
        self.listen(None, now_us)?;
        emit(&Record::Overheard(Overheard {
            t_us,
            at_ticks: at.ticks(),
            pan: frame.pan.0,
            source: frame.source.0,
            destination: frame.destination.0,
            message: frame.message.code(),
            round: frame.round,
            sequence: frame.sequence,
            quality: Some(quality),
        }));
        for (peer, round, reply) in frame.intervals() {
            emit(&Record::OverheardInterval(OverheardInterval {
                source: frame.source.0,
                peer: peer.0,
                round: frame.round,
                round_ticks: round.get(),
                reply_ticks: reply.get(),
            }));
        }
        Ok(())
    }

    /// Takes note of a frame that is not for this node's own round.
    fn note(&mut self, bytes: &[u8], at: DeviceTime, now_us: u64) -> Result<(), RadioError> {
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

    /// How long ago the radio's clock showed `at`.
    fn age_us(&mut self, at: DeviceTime) -> Result<u64, RadioError> {
        Ok(self.radio.now()?.since(at).to_us().into())
    }

    /// What came of it, if that is known at once.
    fn carry_out(
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

    fn listen(
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
    fn keep_listening(&mut self, now_us: u64) -> Result<Option<Event<'static>>, RadioError> {
        match self.doing {
            Doing::Listening { until, .. } => self.listen(Some(until), now_us),
            Doing::ListeningForEver { .. } => self.listen(None, now_us),
            // Nothing to go on with: a damaged frame cannot come while sending.
            _ => Ok(None),
        }
    }

    /// What the radio is at now that a frame has gone.
    fn after_sending(&mut self, at: DeviceTime, now_us: u64) {
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

    fn check_deadlines(&mut self, now_us: u64) {
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
        radio_us.min(self.next_status_us + PATIENCE_US)
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

    fn range_record(&mut self, m: &Measurement, now_us: u64) -> Result<Range, RadioError> {
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

    fn failure_counter(&mut self, failure: &Failure) -> &mut u32 {
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

    fn ignored_counter(&mut self, ignored: Ignored) -> &mut u32 {
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

impl Playing {
    /// The part that `config` says, at its beginning.
    fn by(config: &NodeConfig, timing: Timing) -> Self {
        match &config.part {
            Part::Responder => Self::Responder(Responder::new(config.identity, timing)),
            Part::Listener => Self::Listener,
            Part::Initiator {
                period_us,
                per_round,
                peers,
                sharing,
                sleep,
            } => {
                let peers = Peers::new(peers, *per_round);
                Self::Initiator(Polling {
                    machine: Initiator::new(config.identity, timing),
                    air: Superframe::new(
                        config.identity,
                        *sharing,
                        timing,
                        peers.slots(),
                        *period_us,
                    ),
                    peers,
                    missing: heapless::Vec::new(),
                    owed: heapless::Vec::new(),
                    repeat_until_us: None,
                    missed: false,
                    beacon: false,
                    period_us: u64::from(*period_us),
                    sleeps: *sleep,
                    slept: false,
                    late: false,
                    next_us: 0,
                    turn_us: 0,
                    spread: Spread::new(config.identity.address, config.reply_us()),
                })
            }
        }
    }

    fn set_timing(&mut self, timing: Timing) {
        match self {
            Self::Initiator(polling) => polling.machine.set_timing(timing),
            Self::Responder(machine) => machine.set_timing(timing),
            Self::Listener => {}
        }
    }

    fn on_event(&mut self, event: Event<'_>) -> Step {
        match self {
            Self::Initiator(polling) => polling.machine.on_event(event),
            Self::Responder(machine) => machine.on_event(event),
            // It never comes here.
            Self::Listener => Step {
                command: Command::Listen { until: None },
                outcome: None,
            },
        }
    }

    /// Into the node's receptions: where that of the frame just taken belongs.
    fn slot(&self) -> usize {
        match self {
            Self::Initiator(polling) => polling.machine.slot(),
            Self::Responder(_) | Self::Listener => 0,
        }
    }

    /// Whether a range rests on the time stamp of the frame just taken in.
    fn measures_by_this(&self) -> bool {
        match self {
            Self::Initiator(_) => true,
            Self::Responder(machine) => machine.is_reporting(),
            Self::Listener => false,
        }
    }

    /// From whom that frame was.
    fn partner(&self) -> Option<Address> {
        match self {
            Self::Initiator(polling) => polling.machine.heard_last(),
            Self::Responder(machine) => machine.partner(),
            Self::Listener => None,
        }
    }

    /// Whether the next poll can follow a report at once. Not where others than the one that has just reported are to
    /// hear it: they still read the report.
    fn may_hurry(&self) -> bool {
        matches!(self, Self::Initiator(polling)
            if polling.peers.is_one() && polling.repeat_until_us.is_none() && !polling.sleeps)
    }

    fn measured(&mut self, peer: Address, now_us: u64) {
        if let Self::Initiator(polling) = self {
            polling.peers.answered(peer, now_us);
            polling.missing.retain(|&missing| missing != peer);
        }
    }

    fn failed(&mut self, peer: Address, now_us: u64) {
        if let Self::Initiator(polling) = self {
            polling.peers.failed(peer, now_us);
            if !core::mem::replace(&mut polling.missed, true) {
                let shift_us = polling.spread.next_us();
                polling.next_us = polling.next_us.saturating_add_signed(shift_us);
            }
        }
    }

    fn is_idle(&self) -> bool {
        match self {
            Self::Initiator(polling) => polling.machine.is_idle(),
            Self::Responder(machine) => machine.is_idle(),
            Self::Listener => true,
        }
    }
}

impl Polling {
    fn owe(&mut self, peer: Option<Address>) {
        if let Some(peer) = peer
            && !self.owed.contains(&peer)
        {
            // There is room: peers are no more than responders.
            let _ = self.owed.push(peer);
        }
    }

    /// What to send now, if anything.
    fn next(&mut self, now_us: u64) -> Option<Command> {
        self.turn_us = now_us;
        if let Some(until_us) = self.repeat_until_us.take() {
            // Who has waited for longest goes first.
            core::mem::swap(&mut self.missing, &mut self.owed);
            for &peer in &self.owed {
                if !self.missing.contains(&peer) {
                    let _ = self.missing.push(peer);
                }
            }
            self.owed.clear();
            while !self.missing.is_empty() && !self.air.fits(now_us, self.missing.len(), until_us) {
                let left = self.missing.pop();
                self.owe(left);
            }
            if !self.missing.is_empty() {
                self.repeat_until_us = Some(until_us);
                return Some(self.machine.start(&self.missing, 0));
            }
        }
        match self.air.turn(now_us, self.next_us) {
            Turn::Wait(until_us) => {
                self.turn_us = until_us;
                None
            }
            Turn::Talk { until_us } => {
                self.late = core::mem::take(&mut self.slept) && now_us > self.next_us + LATE_US;
                // Rounds that there was no time for are left out, not made up for.
                self.next_us = (self.next_us + self.period_us).max(now_us);
                self.missed = false;
                self.repeat_until_us = until_us;
                // The slot may be shorter than was asked for, or have begun late.
                let most = until_us.map_or(MAX_RESPONDERS, |until_us| {
                    (1..=MAX_RESPONDERS)
                        .rev()
                        .find(|&slots| self.air.fits(now_us, slots, until_us))
                        .unwrap_or(1)
                });
                let Plan { named, open } = self.peers.next_round(most);
                self.air.set_slots(self.peers.slots());
                while let Some(left) = self.missing.pop() {
                    self.owe(Some(left));
                }
                self.missing = named;
                Some(self.machine.start(&self.missing, open))
            }
            Turn::Beacon { superframe, beacon } => {
                self.beacon = true;
                let message = Message::Beacon(beacon);
                Some(self.machine.say(Address::BROADCAST, superframe, message))
            }
            Turn::Join(coordinator) => {
                let message = self.air.join();
                Some(self.machine.say(coordinator, 0, message))
            }
        }
    }
}

fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
