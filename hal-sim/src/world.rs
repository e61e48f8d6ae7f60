//! Chips and the air between them, driven by explicit time.
//!
//! A [`World`] knows nothing of boards, processors or HAL traits. Whoever runs the processors calls
//! [`World::next_event_time`] to see what the radios will do by themselves, [`World::advance_to`] to let them do it,
//! and the SPI and pin functions at the present moment. Time never goes back: a call for an earlier moment acts now.
//!
//! Events happen strictly in the order of (time, order of scheduling), and every chip has its own stream of random
//! numbers, so equal seeds and equal calls give equal bits.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::air::{
    ChannelConfig, Fault, FaultAction, FrameId, FramesInFlight, LinkEffect, OutgoingFrame, Signal,
    distance_m,
};
use crate::chip::{Chip, ChipConfig, ChipEvent, ChipStats, Consumption, Request};
use crate::time::{SimDuration, SimTime};

/// Identifies a chip in its world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ChipId(pub(crate) usize);

/// What happened on the air, by count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AirStats {
    /// Frames begun by all chips.
    pub frames: u64,
    /// Frames that reached some other antenna with any power, per antenna.
    pub signals: u64,
    /// Signals taken out by the loss probability.
    pub lost: u64,
    /// Signals dropped or corrupted by script.
    pub faults: u64,
    /// Signals corrupted at random.
    pub corrupted: u64,
    /// Signals that came a second time.
    pub repeated: u64,
}

/// Stream of random numbers for losses; chips take the streams from 0 on.
const LOSS_STREAM: u64 = u64::MAX;
/// Signals this much below the weakest receivable frame are not even considered as interferers.
const FORGET_BELOW_SENSITIVITY_DB: f64 = 20.0;

/// Chips and air.
#[derive(Debug)]
pub struct World {
    now: SimTime,
    seed: u64,
    channel: ChannelConfig,
    slots: Vec<Slot>,
    queue: BinaryHeap<Reverse<Scheduled>>,
    sequence: u64,
    frames: FramesInFlight,
    frame_count: u64,
    links: BTreeMap<(ChipId, ChipId), LinkEffect>,
    faults: Vec<Fault>,
    loss_rng: ChaCha8Rng,
    stats: AirStats,
}

#[derive(Debug)]
struct Slot {
    chip: Chip,
    sending: Option<FrameId>,
    frames_begun: u64,
}

#[derive(Debug)]
struct Scheduled {
    at: SimTime,
    sequence: u64,
    chip: ChipId,
    event: ChipEvent,
}

impl Scheduled {
    fn key(&self) -> (SimTime, u64) {
        (self.at, self.sequence)
    }
}

impl PartialEq for Scheduled {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Scheduled {}

impl PartialOrd for Scheduled {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Scheduled {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

impl World {
    /// A world without chips at time zero.
    pub fn new(seed: u64, channel: ChannelConfig) -> Self {
        let mut loss_rng = ChaCha8Rng::seed_from_u64(seed);
        loss_rng.set_stream(LOSS_STREAM);
        World {
            now: SimTime::ZERO,
            seed,
            channel,
            slots: Vec::new(),
            queue: BinaryHeap::new(),
            sequence: 0,
            frames: FramesInFlight::default(),
            frame_count: 0,
            links: BTreeMap::new(),
            faults: Vec::new(),
            loss_rng,
            stats: AirStats::default(),
        }
    }

    /// Adds a chip whose supply comes up at time zero. Chips are to be added before time moves.
    pub fn add_chip(&mut self, config: ChipConfig) -> ChipId {
        let id = ChipId(self.slots.len());
        self.slots.push(Slot {
            chip: Chip::new(config, self.channel.clone(), self.seed, id.0 as u64),
            sending: None,
            frames_begun: 0,
        });
        self.serve(id);
        id
    }

    /// The present moment.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// When a chip will next do something by itself. Some of these events turn out to be stale and do nothing.
    pub fn next_event_time(&self) -> Option<SimTime> {
        self.queue.peek().map(|Reverse(event)| event.at)
    }

    /// Lets everything happen that is due up to and including `t`.
    pub fn advance_to(&mut self, t: SimTime) {
        while self.next_event_time().is_some_and(|at| at <= t) {
            self.step();
        }
        self.now = self.now.max(t);
    }

    /// Lets the next event happen, if there is one.
    pub fn step(&mut self) {
        if let Some(Reverse(event)) = self.queue.pop() {
            self.now = self.now.max(event.at);
            if let Some(slot) = self.slots.get_mut(event.chip.0) {
                slot.chip.settle(self.now);
                slot.chip.on_event(self.now, event.event, &self.frames);
                self.serve(event.chip);
            }
        }
    }

    /// Chip select goes low at `t`: a transaction begins.
    pub fn spi_select(&mut self, chip: ChipId, t: SimTime) {
        self.with_chip(chip, t, |chip, now| chip.select(now));
    }

    /// Clocks bytes within a transaction, starting at `t`. Reads sample the registers at `t`. `miso` is filled as far
    /// as `mosi` reaches. The caller lets the time pass that the bytes take.
    pub fn spi_transfer(
        &mut self,
        chip: ChipId,
        t: SimTime,
        bits_per_s: u32,
        mosi: &[u8],
        miso: &mut [u8],
    ) {
        self.with_chip(chip, t, |chip, now| {
            chip.transfer(now, bits_per_s, mosi, miso);
        });
    }

    /// Chip select goes high at `t`: what was written takes effect.
    pub fn spi_deselect(&mut self, chip: ChipId, t: SimTime) {
        self.with_chip(chip, t, |chip, now| chip.deselect(now));
    }

    /// A whole transaction starting at `t`; returns when its last bit has been clocked. Writes take effect then, and
    /// time has advanced to then.
    pub fn spi_transaction(
        &mut self,
        chip: ChipId,
        t: SimTime,
        bits_per_s: u32,
        mosi: &[u8],
        miso: &mut [u8],
    ) -> SimTime {
        self.spi_select(chip, t);
        self.spi_transfer(chip, t, bits_per_s, mosi, miso);
        let end = self.now + SimDuration::of_bits(8 * mosi.len() as u64, bits_per_s);
        self.spi_deselect(chip, end);
        end
    }

    /// Drives the reset pin: `low` resets and holds the chip, releasing it lets it start.
    pub fn set_reset(&mut self, chip: ChipId, t: SimTime, low: bool) {
        self.with_chip(chip, t, |chip, now| chip.set_reset(now, low));
    }

    /// The chip's supply breaks down for a moment: it starts anew with nothing set.
    pub fn brown_out(&mut self, chip: ChipId, t: SimTime) {
        self.set_reset(chip, t, true);
        self.set_reset(chip, t, false);
    }

    /// The chip's receiver hears nothing any more until the chip is reset.
    pub fn stick_receiver(&mut self, chip: ChipId, t: SimTime) {
        self.with_chip(chip, t, |chip, _| chip.stick_receiver());
    }

    /// Level of the chip's IRQ pin now.
    pub fn irq_level(&self, chip: ChipId) -> bool {
        self.chip(chip).is_some_and(Chip::irq_level)
    }

    /// The chip; `None` for an id of another world.
    pub fn chip(&self, chip: ChipId) -> Option<&Chip> {
        self.slots.get(chip.0).map(|slot| &slot.chip)
    }

    /// Counts of what happened inside a chip.
    pub fn chip_stats(&self, chip: ChipId) -> ChipStats {
        self.chip(chip).map(Chip::stats).unwrap_or_default()
    }

    /// What a chip has drawn from its supply until now; `None` for an id of another world.
    pub fn consumption(&self, chip: ChipId) -> Option<Consumption> {
        Some(self.chip(chip)?.consumption(self.now))
    }

    /// Counts of what happened on the air.
    pub fn air_stats(&self) -> AirStats {
        self.stats
    }

    /// Number of frames that a chip has begun to send.
    pub fn frames_begun(&self, chip: ChipId) -> u64 {
        self.slots.get(chip.0).map_or(0, |slot| slot.frames_begun)
    }

    /// True distance between two chips at `t`, in metres.
    pub fn true_distance_m(&self, a: ChipId, b: ChipId, t: SimTime) -> f64 {
        match (self.chip(a), self.chip(b)) {
            (Some(a), Some(b)) => distance_m(a.motion().at(t), b.motion().at(t)),
            _ => f64::NAN,
        }
    }

    /// Puts something between two chips, in both directions, from now on.
    pub fn set_link_effect(&mut self, a: ChipId, b: ChipId, effect: LinkEffect) {
        self.links.insert((a, b), effect);
        self.links.insert((b, a), effect);
    }

    /// Adds scripted damage.
    pub fn add_fault(&mut self, fault: Fault) {
        self.faults.push(fault);
    }

    fn with_chip(&mut self, id: ChipId, t: SimTime, act: impl FnOnce(&mut Chip, SimTime)) {
        self.advance_to(t);
        if let Some(slot) = self.slots.get_mut(id.0) {
            slot.chip.settle(self.now);
            act(&mut slot.chip, self.now);
            self.serve(id);
        }
    }

    /// Does what a chip asked for.
    fn serve(&mut self, id: ChipId) {
        let Some(slot) = self.slots.get_mut(id.0) else {
            return;
        };
        for request in slot.chip.take_requests() {
            match request {
                Request::At(at, event) => self.schedule(at, id, event),
                Request::StartFrame(frame) => self.start_frame(id, frame),
                Request::SealFrame(bytes) => {
                    if let Some(frame) = self.sending(id) {
                        self.frames.seal(frame, bytes);
                    }
                }
                Request::AbortFrame => {
                    if let Some(frame) = self.sending(id) {
                        self.frames.abort(frame, self.now);
                    }
                }
            }
        }
    }

    fn schedule(&mut self, at: SimTime, chip: ChipId, event: ChipEvent) {
        self.sequence += 1;
        self.queue.push(Reverse(Scheduled {
            at: at.max(self.now),
            sequence: self.sequence,
            chip,
            event,
        }));
    }

    fn sending(&self, id: ChipId) -> Option<FrameId> {
        self.slots.get(id.0)?.sending
    }

    fn start_frame(&mut self, from: ChipId, frame: OutgoingFrame) {
        let id = FrameId(self.frame_count);
        self.frame_count += 1;
        self.stats.frames += 1;
        self.frames.add(id, frame.end, self.now);
        let mut number = 0;
        if let Some(slot) = self.slots.get_mut(from.0) {
            number = slot.frames_begun;
            slot.frames_begun += 1;
            slot.sending = Some(id);
        }
        for to in (0..self.slots.len()).map(ChipId).filter(|to| *to != from) {
            if let Some(signal) = self.propagate(id, number, from, to, &frame) {
                self.stats.signals += 1;
                if let Some(late) = self.repetition(&signal) {
                    let start = late.wave.start;
                    self.schedule(start, to, ChipEvent::SignalStart(Box::new(late)));
                }
                let start = signal.wave.start;
                self.schedule(start, to, ChipEvent::SignalStart(Box::new(signal)));
            }
        }
    }

    /// The same frame once more, if somebody repeats it.
    fn repetition(&mut self, signal: &Signal) -> Option<Signal> {
        let ChannelConfig {
            repeat_probability,
            repeat_delay: [least, most],
            ..
        } = self.channel;
        if repeat_probability <= 0.0 || self.loss_rng.random::<f64>() >= repeat_probability {
            return None;
        }
        self.stats.repeated += 1;
        let span = most.as_s_f64() - least.as_s_f64();
        let delay = least + SimDuration::from_s_f64(span * self.loss_rng.random::<f64>());
        let mut late = signal.clone();
        late.wave.delay(delay);
        late.flight += delay;
        Some(late)
    }

    /// The frame as it reaches `to`, if it does.
    fn propagate(
        &mut self,
        id: FrameId,
        number: u64,
        from: ChipId,
        to: ChipId,
        frame: &OutgoingFrame,
    ) -> Option<Signal> {
        let fault = self
            .faults
            .iter()
            .find(|fault| fault.hits(from, to, number))
            .map(|fault| fault.action);
        if fault.is_some() {
            self.stats.faults += 1;
        }
        // Drawn for every pair, so that a fault does not change the luck of later frames.
        let lost = self.loss_rng.random::<f64>() < self.channel.loss_probability;
        if fault == Some(FaultAction::Drop) {
            return None;
        }
        if lost {
            self.stats.lost += 1;
            return None;
        }

        let corrupt = self.channel.corrupt_probability > 0.0
            && self.loss_rng.random::<f64>() < self.channel.corrupt_probability;
        if corrupt {
            self.stats.corrupted += 1;
        }
        let distance_m = self.true_distance_m(from, to, frame.rmarker);
        let effect = self.links.get(&(from, to)).copied().unwrap_or_default();
        let loss_db = self.channel.path_loss_db(frame.phy.channel, distance_m) + effect.loss_db
            - self.channel.antenna_gain_db;
        let power_dbm = frame.power_dbm - loss_db;
        let floor_dbm = self.channel.sensitivity.dbm(frame.phy.rate) - FORGET_BELOW_SENSITIVITY_DB;
        if power_dbm < floor_dbm {
            return None;
        }
        let flight = SimDuration::from_s_f64(
            distance_m / self.channel.speed_m_per_s + effect.extra_delay_ps * 1e-12,
        );
        let mut wave = frame.clone();
        wave.delay(flight);
        wave.power_dbm = power_dbm;
        Some(Signal {
            frame: id,
            from,
            wave,
            first_path_dbm: power_dbm - effect.first_path_loss_db,
            flight,
            corrupt: corrupt || fault == Some(FaultAction::Corrupt),
        })
    }
}
