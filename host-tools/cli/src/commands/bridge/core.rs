//! The bridge itself, without I/O: ranges, messages and time in; messages and lines out.
//!
//! ```text
//!   range ────────────┬──► DISTANCE_SENSOR, at once
//!                     ▼
//!   LOCAL_POSITION ► Pairing ► navigator of the node ──► LANDING_TARGET, if it may be leant on
//!   ATTITUDE ─────────────────────────────────────────┘
//!   time ───► HEARTBEAT, TIMESYNC, requests; SET_POSITION_TARGET where asked for
//! ```

use super::counts::Sent;
use crate::commands::guide::guided::Guided;
use crate::commands::guide::lines::{News, Summary};
use crate::commands::guide::options::NavigatorOptions;
use crate::commands::guide::pairing::{Heard, Outcome, Pairing};
use crate::error::bad_input;
use crate::mavlink::clock::nanoseconds;
use crate::mavlink::inbound::{Reading, readings};
use crate::mavlink::outbound::{self, Target, TargetFrame};
use crate::mavlink::vehicle::{self, Vehicle};
use crate::peer::Peer;
use anyhow::Result;
use mavlink::MavHeader;
use mavlink::dialects::common::MavMessage;
use nalgebra::Vector3;
use nova_solver::navigation::{Action, Estimate, InsSample, horizontal_sigma_m};
use std::collections::BTreeMap;

/// Heartbeats and questions for the time, seconds apart.
const BEAT_S: f64 = 1.0;
/// Position targets, seconds apart; PX4 wants more than two a second.
const FLY_S: f64 = 0.1;
/// Requests for places and attitudes are repeated so often while none come, seconds apart.
const ASK_S: f64 = 3.0;
/// A place older than this is none to send a target from, seconds.
const OLD_S: f64 = 1.0;
/// MAVLink numbers sensors and targets with eight bits.
const MOST_NODES: usize = 256;

/// What to do.
pub(super) struct Orders {
    /// Only this node.
    pub(super) only: Option<Peer>,
    /// How the landing place is told; as the autopilot takes it where it is not said.
    pub(super) frame: Option<TargetFrame>,
    /// Horizontal sigma above which no landing place is told, metres.
    pub(super) most_sigma_m: f64,
    /// Whether position targets are sent.
    pub(super) fly: bool,
    /// How often the vehicle shall tell its place, Hz; 0 asks for nothing.
    pub(super) rate_hz: f32,
    /// Whether news of the navigators are wanted.
    pub(super) news: bool,
    /// Whether readings of the autopilot's sensors are wanted.
    pub(super) readings: bool,
    /// How navigators are set up.
    pub(super) navigator: NavigatorOptions,
}

impl Orders {
    /// Whether all numbers can be used.
    pub(super) fn check(&self) -> Result<()> {
        self.navigator.check()?;
        if !(self.most_sigma_m.is_finite() && self.most_sigma_m > 0.0) {
            return Err(bad_input!("--max-sigma must be more than 0"));
        }
        if !(0.0..=200.0).contains(&self.rate_hz) {
            return Err(bad_input!("--rate must be between 0 and 200 Hz"));
        }
        Ok(())
    }
}

/// What the bridge is given.
pub(super) enum Given<'a> {
    /// A range.
    Range(Heard),
    /// A message.
    Message(MavHeader, &'a MavMessage),
    /// It is time to do what is due.
    Time,
}

/// What is to be done with what the bridge says.
pub(super) trait Outlet {
    /// A message for the autopilot; whether it went out.
    fn send(&mut self, message: &MavMessage) -> bool;
    /// News of a navigator.
    fn news(&mut self, news: &News<'_>);
    /// A reading of the autopilot's sensors, taken at `t_s` on our clock.
    fn reading(&mut self, t_s: f64, reading: &Reading);
    /// Something for the eyes of people.
    fn tell(&mut self, text: &str);
}

/// The bridge.
pub(super) struct Bridge {
    orders: Orders,
    vehicle: Vehicle,
    pairing: Pairing,
    nodes: BTreeMap<Peer, Node>,
    start_s: f64,
    next_beat_s: f64,
    next_fly_s: f64,
    next_ask_s: f64,
    hold_m: Option<Vector3<f64>>,
    sent: Sent,
}

struct Node {
    number: u8,
    guided: Guided,
}

impl Bridge {
    /// Starts at `now_s`, seconds on our clock.
    pub(super) fn new(orders: Orders, now_s: f64) -> Self {
        Self {
            orders,
            vehicle: Vehicle::default(),
            pairing: Pairing::default(),
            nodes: BTreeMap::new(),
            start_s: now_s,
            next_beat_s: now_s,
            next_fly_s: now_s,
            next_ask_s: now_s,
            hold_m: None,
            sent: Sent::default(),
        }
    }

    /// Takes what has come at `now_s`.
    pub(super) fn take(&mut self, given: Given<'_>, now_s: f64, out: &mut impl Outlet) {
        match given {
            Given::Range(heard) => self.range(heard, now_s, out),
            Given::Message(header, message) => self.message(header, message, now_s, out),
            Given::Time => self.time(now_s, out),
        }
    }

    /// When there is something to do next: then it is to be given [`Given::Time`].
    pub(super) fn due_s(&self) -> f64 {
        let there = self.vehicle.identity().is_some();
        let when = |is: bool, at_s: f64| if is { at_s } else { f64::INFINITY };
        (self.next_beat_s)
            .min(when(there && self.orders.rate_hz > 0.0, self.next_ask_s))
            .min(when(there && self.orders.fly, self.next_fly_s))
    }

    fn range(&mut self, heard: Heard, now_s: f64, out: &mut impl Outlet) {
        if self
            .orders
            .only
            .as_ref()
            .is_some_and(|only| *only != heard.peer)
        {
            return;
        }
        if heard.range.validate().is_err() {
            self.sent.ranges_refused += 1;
            return;
        }
        let Some(number) = self.number(&heard.peer) else {
            self.sent.ranges_refused += 1;
            return;
        };
        let estimate = self.estimate(&heard.peer);
        let sigma_m = estimate
            .as_ref()
            .and_then(|estimate| estimate.range_sigma_m);
        let towards = (self.vehicle.attitude_at(now_s))
            .and_then(|attitude| Some((self.relative(&estimate?, &heard.peer)?, attitude)));
        let boot_ms = self.boot_ms(heard.range.t_s);
        let range_m = heard.range.range_m;
        match outbound::distance_sensor(number, range_m, sigma_m, boot_ms, towards) {
            Some(message) => self.sent.distance_sensor.note(out.send(&message)),
            None => self.sent.ranges_refused += 1,
        }
        self.pairing.range(heard);
        self.work(out);
    }

    fn message(
        &mut self,
        header: MavHeader,
        message: &MavMessage,
        now_s: f64,
        out: &mut impl Outlet,
    ) {
        if self.orders.readings {
            for (taken, reading) in readings(message).unwrap_or_default() {
                let t_s = self.vehicle.time_of(taken, now_s);
                out.reading(t_s, &reading);
            }
        }
        match self.vehicle.take(header, message, now_s) {
            vehicle::Heard::Nothing => {}
            vehicle::Heard::Found(identity) => {
                out.tell(&format!(
                    "autopilot: system {}, component {}, {:?}",
                    identity.system, identity.component, identity.kind
                ));
                self.next_ask_s = now_s;
            }
            vehicle::Heard::Place(place) => {
                self.next_ask_s = now_s + ASK_S;
                self.pairing.ins(place);
                self.work(out);
            }
            vehicle::Heard::Restarted => {
                out.tell(
                    "autopilot: has started again; its places are new, and all estimates with them",
                );
                self.pairing = Pairing::default();
                for (peer, node) in &mut self.nodes {
                    node.guided = Guided::new(peer.clone());
                }
            }
            vehicle::Heard::AsksTime { ts1 } => {
                let answer = outbound::time_answer(nanoseconds(now_s), ts1);
                self.sent.timesync.note(out.send(&answer));
            }
        }
    }

    fn time(&mut self, now_s: f64, out: &mut impl Outlet) {
        if now_s >= self.next_beat_s {
            self.next_beat_s = now_s + BEAT_S;
            self.sent.heartbeat.note(out.send(&outbound::heartbeat()));
            if self.vehicle.identity().is_some() {
                let ts1 = self.vehicle.clock().ask(now_s);
                let question = outbound::time_question(ts1);
                self.sent.timesync.note(out.send(&question));
            }
            if self.vehicle.fell_silent(now_s) {
                out.tell("autopilot: no heartbeat for 5 s");
            }
        }
        if let Some(identity) = self.vehicle.identity() {
            if now_s >= self.next_ask_s && self.orders.rate_hz > 0.0 {
                self.next_ask_s = now_s + ASK_S;
                for request in outbound::requests(identity, self.orders.rate_hz) {
                    self.sent.requests.note(out.send(&request));
                }
            }
            if self.orders.fly && now_s >= self.next_fly_s {
                self.next_fly_s = now_s + FLY_S;
                if let Some(place_m) = self.wanted(now_s) {
                    let message = outbound::position_target(identity, place_m, self.boot_ms(now_s));
                    self.sent.position_target.note(out.send(&message));
                }
            }
        }
    }

    /// What the end of the run has to say.
    pub(super) fn conclude(mut self) -> (Sent, Vehicle, Vec<Summary>) {
        let rest: Vec<Heard> = self.pairing.rest().collect();
        for heard in rest {
            if let Some(node) = self.nodes.get_mut(&heard.peer) {
                node.guided.pass_over();
            }
        }
        let nodes = self.nodes.into_values().map(|node| node.guided.summary());
        (self.sent, self.vehicle, nodes.collect())
    }

    /// Whose system we are of.
    pub(super) fn system(&self) -> Option<u8> {
        self.vehicle.identity().map(|identity| identity.system)
    }

    fn work(&mut self, out: &mut impl Outlet) {
        while let Some(outcome) = self.pairing.next() {
            match outcome {
                Outcome::Unpaired(heard) => {
                    if let Some(node) = self.nodes.get_mut(&heard.peer) {
                        node.guided.pass_over();
                    }
                }
                Outcome::Paired(place, heard) => self.paired(place, &heard, out),
            }
        }
    }

    fn paired(&mut self, place: InsSample, heard: &Heard, out: &mut impl Outlet) {
        let options = &self.orders.navigator;
        let Some(node) = self.nodes.get_mut(&heard.peer) else {
            return;
        };
        let before = updates(&node.guided);
        let make = || options.navigator(&place, heard);
        (node.guided).take(place, heard, make, options.arrival_radius);
        let updated = updates(&node.guided) != before;
        if self.orders.news
            && let Some(news) = node.guided.news(place.t_s)
        {
            out.news(&news);
        }
        // One landing place at a time: that of the node asked for, or of the first heard.
        if updated && self.target() == Some(&heard.peer) {
            match self.landing_target(&heard.peer) {
                Some(message) => self.sent.landing_target.note(out.send(&message)),
                None => self.sent.landing_target_withheld += 1,
            }
        }
    }

    /// The node whose place is told as the landing place.
    fn target(&self) -> Option<&Peer> {
        let first = self.nodes.iter().find(|(_, node)| node.number == 0);
        first.map(|(peer, _)| peer)
    }

    /// LANDING_TARGET if the estimate may be leant on. With `position_valid` at 0 receivers would take the angles, which
    /// say "straight below": nothing is sent instead.
    fn landing_target(&self, peer: &Peer) -> Option<MavMessage> {
        let estimate = self.estimate(peer)?;
        let doubts = estimate.doubts;
        let sigma_m = horizontal_sigma_m(&estimate.relative_covariance_m2?);
        // NaN fails the comparison.
        let sure = sigma_m <= self.orders.most_sigma_m;
        if !sure || doubts.weak_geometry || doubts.ambiguous || doubts.frozen_ins {
            return None;
        }
        let node = self.nodes.get(peer)?;
        let place = self.vehicle.last_place()?;
        if (place.t_s - estimate.t_s).abs() > OLD_S {
            return None;
        }
        let error_m = node.guided.navigator()?.command().ins_error.at(place.t_s);
        let target = Target {
            t_s: place.t_s,
            number: node.number,
            relative_m: self.relative(&estimate, peer)?,
            absolute_m: estimate.tag_m + error_m,
        };
        let kind = self.vehicle.identity()?.kind;
        let frame = self.orders.frame.unwrap_or_else(|| TargetFrame::of(kind));
        outbound::landing_target(&target, frame, self.vehicle.attitude_at(place.t_s))
    }

    /// From where the vehicle is now to the node, ENU.
    fn relative(&self, estimate: &Estimate, peer: &Peer) -> Option<Vector3<f64>> {
        let place = self.vehicle.last_place()?;
        let command = self.nodes.get(peer)?.guided.navigator()?.command();
        Some(estimate.tag_m - (place.position_m - command.ins_error.at(place.t_s)))
    }

    /// Where the vehicle should fly, by its own reckoning.
    fn wanted(&mut self, now_s: f64) -> Option<Vector3<f64>> {
        let place = self.vehicle.last_place()?;
        if now_s - place.t_s > OLD_S {
            return None;
        }
        let peer = self.target()?;
        let command = self.nodes.get(peer)?.guided.navigator()?.command();
        if command.action == Action::Hold {
            return Some(*self.hold_m.get_or_insert(place.position_m));
        }
        self.hold_m = None;
        Some(command.waypoint_m + command.ins_error.at(place.t_s))
    }

    fn estimate(&self, peer: &Peer) -> Option<Estimate> {
        self.nodes.get(peer)?.guided.navigator()?.estimate()
    }

    fn number(&mut self, peer: &Peer) -> Option<u8> {
        if let Some(node) = self.nodes.get(peer) {
            return Some(node.number);
        }
        let number = u8::try_from(self.nodes.len()).ok()?;
        debug_assert!(self.nodes.len() < MOST_NODES);
        let node = Node {
            number,
            guided: Guided::new(peer.clone()),
        };
        self.nodes.insert(peer.clone(), node);
        Some(number)
    }

    fn boot_ms(&self, t_s: f64) -> u32 {
        // Saturates: a range of before our start counts as taken then.
        ((t_s - self.start_s) * 1e3) as u32
    }
}

fn updates(guided: &Guided) -> u64 {
    guided
        .navigator()
        .map_or(0, |navigator| navigator.updates())
}
