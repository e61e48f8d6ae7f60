//! A navigator for every node heard.

use super::guided::Guided;
use super::lines::Summary;
use super::pairing::{Heard, Outcome, Pairing};
use crate::peer::Peer;
use anyhow::Result;
use nova_solver::navigation::{InsSample, Navigator};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{StdoutLock, Write};

/// What to do.
pub(super) struct Orders<'a> {
    /// Only this node is wanted.
    pub(super) only: Option<Peer>,
    /// A table at the end instead of lines.
    pub(super) summary: bool,
    /// A waypoint this near has been reached, metres.
    pub(super) arrival_radius_m: f64,
    /// A navigator for a node first heard here.
    pub(super) navigator: &'a dyn Fn(&InsSample, &Heard) -> Box<dyn Navigator>,
}

/// The navigators, what they wait for, and where their news goes.
pub(super) struct Team<'a> {
    orders: Orders<'a>,
    pairing: Pairing,
    guided: BTreeMap<Peer, Guided>,
    out: StdoutLock<'static>,
}

/// The last lines.
#[derive(Serialize)]
struct End<'a> {
    end: &'a Summary,
}

impl<'a> Team<'a> {
    pub(super) fn new(orders: Orders<'a>) -> Self {
        Self {
            orders,
            pairing: Pairing::default(),
            guided: BTreeMap::new(),
            out: std::io::stdout().lock(),
        }
    }

    /// Whether a reading is not after the one before.
    pub(super) fn is_late(&self, sample: &InsSample) -> bool {
        (self.pairing.last_ins_s()).is_some_and(|last_s| sample.t_s <= last_s)
    }

    /// Takes a reading of dead reckoning that is not late.
    pub(super) fn ins(&mut self, sample: InsSample) -> Result<()> {
        self.pairing.ins(sample);
        self.work()
    }

    /// Takes a range.
    pub(super) fn range(&mut self, heard: Heard) -> Result<()> {
        if self.orders.only.as_ref().is_none_or(|p| *p == heard.peer) {
            self.pairing.range(heard);
        }
        self.work()
    }

    /// Says what is left to say; the number of ranges that were of use.
    pub(super) fn conclude(mut self) -> Result<u64> {
        let rest: Vec<Heard> = self.pairing.rest().collect();
        for heard in rest {
            self.node(&heard.peer).pass_over();
        }
        let summaries: Vec<Summary> = (std::mem::take(&mut self.guided).into_values())
            .map(Guided::summary)
            .collect();
        if self.orders.summary {
            print_table(&mut self.out, &summaries)?;
        } else {
            for summary in &summaries {
                print(&mut self.out, &End { end: summary })?;
            }
        }
        self.out.flush()?;
        Ok(summaries.iter().map(|summary| summary.ranges).sum())
    }

    fn work(&mut self) -> Result<()> {
        while let Some(outcome) = self.pairing.next() {
            match outcome {
                Outcome::Unpaired(heard) => self.node(&heard.peer).pass_over(),
                Outcome::Paired(place, heard) => {
                    let new = self.orders.navigator;
                    let radius_m = self.orders.arrival_radius_m;
                    let node = self.node(&heard.peer);
                    node.take(place, &heard, || new(&place, &heard), radius_m);
                    self.tell(place.t_s, &heard.peer)?;
                }
            }
        }
        Ok(())
    }

    fn tell(&mut self, t_s: f64, peer: &Peer) -> Result<()> {
        let news = self.guided.get_mut(peer).and_then(|node| node.news(t_s));
        if let Some(news) = news.filter(|_| !self.orders.summary) {
            print(&mut self.out, &news)?;
            // An autopilot waits for it.
            self.out.flush()?;
        }
        Ok(())
    }

    fn node(&mut self, peer: &Peer) -> &mut Guided {
        (self.guided.entry(peer.clone())).or_insert_with(|| Guided::new(peer.clone()))
    }
}

fn print(out: &mut impl Write, line: &impl Serialize) -> Result<()> {
    serde_json::to_writer(&mut *out, line)?;
    Ok(out.write_all(b"\n")?)
}

fn print_table(out: &mut impl Write, summaries: &[Summary]) -> Result<()> {
    writeln!(
        out,
        "{:>8}  {:^27}  {:^21}  {:>7}  {:>6}  {:>8}  {:>8}",
        "node", "position (m)", "sigma (m)", "bias", "ranges", "refused", "unpaired"
    )?;
    for summary in summaries {
        let vector = |v: [f64; 3], width: usize| {
            let [x, y, z] = v;
            format!("{x:>width$.3} {y:>width$.3} {z:>width$.3}")
        };
        let estimate = summary.estimate.as_ref();
        let sigma_m = estimate.and_then(|estimate| estimate.sigma_m);
        let bias_m = estimate.and_then(|estimate| estimate.range_bias_m);
        writeln!(
            out,
            "{:>8}  {:>26}   {:>20}  {:>7}  {:>6}  {:>8}  {:>8}",
            summary.peer.to_string(),
            estimate.map_or_else(|| "nothing known".to_owned(), |e| vector(e.tag_m, 8)),
            sigma_m.map_or_else(String::new, |s| vector(s, 6)),
            bias_m.map_or_else(String::new, |bias_m| format!("{bias_m:.3}")),
            summary.ranges,
            summary.refused,
            summary.unpaired,
        )?;
        let Some(estimate) = estimate else { continue };
        if !estimate.doubts.is_empty() {
            let doubts = estimate.doubts.join(", ").replace('_', " ");
            writeln!(out, "{:>8}  ! {doubts}", "")?;
        }
        if let Some(other) = estimate.alternative_m {
            writeln!(out, "{:>8}  ! or at {}", "", vector(other, 0))?;
        }
    }
    Ok(())
}
