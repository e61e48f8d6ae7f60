//! Frames sorted into rounds, rounds into differences.
//!
//! ```text
//!            poll                 response                final, with Ra, Da of each responder
//!  (none) ─────────► open round ──────────► its stamp ──────────► waiting for reports ── all there ─► differences
//!            ▲                                                     │
//!            └── a later poll of the same initiator; of anybody, once the final was heard: what is there
//! ```

use super::{
    HeardExchange, HeardFrame, HeardIntervals, HeardMessage, ListenedAnchor, ListenedDifference,
    ListenedRound, ListeningCounts, ListeningOptions, SideIntervals,
};
use crate::positioning::RangeDifference;
use nalgebra::Vector3;

/// Rounds of so many initiators are followed at once.
const MOST_OPEN: usize = 24;
/// Responders of a round, as the air protocol has them.
const MOST_RESPONDERS: usize = 8;

/// A stamp of the listener.
#[derive(Debug, Clone, Copy)]
struct Stamp {
    t_s: f64,
    ticks: u64,
    late_m: f64,
}

#[derive(Debug, Clone, Default)]
struct Responder {
    address: u16,
    response: Option<Stamp>,
    /// By the final.
    initiator: Option<SideIntervals>,
    /// By the report.
    responder: Option<SideIntervals>,
}

#[derive(Debug, Clone)]
struct Open {
    initiator: u16,
    round: u8,
    poll: Stamp,
    last: Option<Stamp>,
    responders: Vec<Responder>,
}

/// Turns what a listener hears into differences.
#[derive(Debug, Clone)]
pub struct Listening {
    options: ListeningOptions,
    anchors: Vec<ListenedAnchor>,
    open: Vec<Open>,
    counts: ListeningCounts,
}

impl Listening {
    /// Listens for these anchors.
    pub fn new(anchors: &[ListenedAnchor], options: ListeningOptions) -> Self {
        Self {
            options,
            anchors: anchors.to_vec(),
            open: Vec::new(),
            counts: ListeningCounts::default(),
        }
    }

    /// What was heard so far.
    pub fn counts(&self) -> &ListeningCounts {
        &self.counts
    }

    /// A frame was heard; `done` is given the rounds that end with it.
    pub fn on_frame(&mut self, frame: &HeardFrame, mut done: impl FnMut(ListenedRound)) {
        let stamp = Stamp {
            t_s: frame.t_s,
            ticks: frame.ticks,
            late_m: frame.late_m,
        };
        match frame.message {
            HeardMessage::Other => {}
            HeardMessage::Poll => {
                let again = (self.open.iter())
                    .any(|open| (open.initiator, open.round) == (frame.source, frame.round));
                if again {
                    self.counts.repeated += 1;
                    return;
                }
                // Whoever polls has waited for the air: rounds whose final is past are over.
                let over = |open: &Open| open.initiator == frame.source || open.last.is_some();
                let mut index = 0;
                while let Some(open) = self.open.get(index) {
                    if over(open) {
                        let ended = self.open.remove(index);
                        self.end(&ended, &mut done);
                    } else {
                        index += 1;
                    }
                }
                if self.open.len() >= MOST_OPEN {
                    self.open.remove(0);
                    self.counts.cut_off += 1;
                }
                self.open.push(Open {
                    initiator: frame.source,
                    round: frame.round,
                    poll: stamp,
                    last: None,
                    responders: Vec::new(),
                });
            }
            HeardMessage::Response => {
                match self.responder(frame.destination, frame.round, frame.source) {
                    None => self.counts.no_poll += 1,
                    Some(Responder {
                        response: Some(_), ..
                    }) => self.counts.repeated += 1,
                    Some(responder) => responder.response = Some(stamp),
                }
            }
            HeardMessage::Final => {
                let open = (self.open.iter_mut())
                    .find(|open| (open.initiator, open.round) == (frame.source, frame.round));
                match open {
                    None => self.counts.no_poll += 1,
                    Some(open) if open.last.is_some() => self.counts.repeated += 1,
                    Some(open) => open.last = Some(stamp),
                }
            }
        }
    }

    /// What a final or a report says was heard; `done` is given the round if it is whole with it.
    pub fn on_intervals(&mut self, heard: &HeardIntervals, mut done: impl FnMut(ListenedRound)) {
        let of = |open: &Open, initiator| (open.initiator, open.round) == (initiator, heard.round);
        // A node is either an initiator or a responder: whose round it is tells which of the two speaks.
        if self.open.iter().any(|open| of(open, heard.source)) {
            match self.responder(heard.source, heard.round, heard.peer) {
                Some(responder) if responder.initiator.is_none() => {
                    responder.initiator = Some(heard.intervals);
                }
                _ => self.counts.repeated += 1,
            }
            return;
        }
        match self.responder(heard.peer, heard.round, heard.source) {
            None => self.counts.no_poll += 1,
            Some(responder) if responder.responder.is_some() => self.counts.repeated += 1,
            Some(responder) => responder.responder = Some(heard.intervals),
        }
        let whole = self.open.iter().position(|open| {
            of(open, heard.peer)
                && open.last.is_some()
                && (open.responders.iter()).all(|r| r.initiator.is_none() || r.responder.is_some())
        });
        if let Some(index) = whole {
            let ended = self.open.remove(index);
            self.end(&ended, &mut done);
        }
    }

    /// Nothing more comes: the rounds that are still open end with what they have.
    pub fn finish(&mut self, mut done: impl FnMut(ListenedRound)) {
        for ended in std::mem::take(&mut self.open) {
            self.end(&ended, &mut done);
        }
    }

    /// The listener has started anew, and its clock with it: open rounds are given up.
    pub fn restart(&mut self) {
        self.counts.cut_off += self.open.len() as u64;
        self.open.clear();
    }

    /// This responder in the open round; taken in if there is room.
    fn responder(&mut self, initiator: u16, round: u8, address: u16) -> Option<&mut Responder> {
        let open = (self.open.iter_mut())
            .find(|open| (open.initiator, open.round) == (initiator, round))?;
        let known = open.responders.iter().position(|r| r.address == address);
        if known.is_none() && open.responders.len() < MOST_RESPONDERS {
            open.responders.push(Responder {
                address,
                ..Responder::default()
            });
            return open.responders.last_mut();
        }
        open.responders.get_mut(known?)
    }

    fn end(&mut self, open: &Open, done: &mut impl FnMut(ListenedRound)) {
        let differences: Vec<_> = (open.responders.iter())
            .filter_map(|responder| self.difference(open, responder))
            .collect();
        self.counts.differences += differences.len() as u64;
        if !differences.is_empty() {
            done(ListenedRound { differences });
        }
    }

    /// The difference of one exchange; counted where there is none.
    fn difference(&mut self, open: &Open, of: &Responder) -> Option<ListenedDifference> {
        let counts = &mut self.counts;
        let (Some(last), Some(initiator)) = (open.last, of.initiator) else {
            counts.no_final += 1;
            return None;
        };
        let Some(response) = of.response else {
            counts.no_response += 1;
            return None;
        };
        let Some(responder) = of.responder else {
            counts.no_report += 1;
            return None;
        };
        let place = |address: u16| -> Option<Vector3<f64>> {
            let anchor = self.anchors.iter().find(|a| a.address == address)?;
            Some(anchor.position_m)
        };
        let (Some(a), Some(b)) = (place(open.initiator), place(of.address)) else {
            counts.unknown_anchor += 1;
            return None;
        };
        let heard = HeardExchange {
            heard_ticks: [open.poll.ticks, response.ticks, last.ticks],
            initiator,
            responder,
        };
        let Ok(heard) = heard.difference() else {
            counts.bad_stamps += 1;
            return None;
        };
        let (apart_m, tolerance_m) = ((b - a).norm(), self.options.tolerance_m);
        // NaN is within nothing.
        let within = |length_m: f64, most_m: f64| length_m.abs() <= most_m;
        if !within(heard.between_m - apart_m, tolerance_m) {
            counts.other_distance += 1;
            return None;
        }
        // Poll and final come from one place at one level.
        let [poll_part, last_part] = heard.shared;
        let late_m = response.late_m - poll_part * open.poll.late_m - last_part * last.late_m;
        let difference_m = heard.difference_m - late_m;
        if !within(difference_m, apart_m + tolerance_m) {
            counts.impossible += 1;
            return None;
        }
        let s = self.options.stamp_sigma_m;
        let shared_m = heard.shared.map(|part| part * s);
        let variance: f64 = shared_m.iter().map(|v| v * v).sum();
        Some(ListenedDifference {
            t_s: response.t_s,
            addresses: [open.initiator, of.address],
            difference: RangeDifference {
                anchors_m: [a, b],
                difference_m,
                sigma_m: ((heard.own * s).powi(2) + variance).sqrt(),
            },
            shared_m,
        })
    }
}
