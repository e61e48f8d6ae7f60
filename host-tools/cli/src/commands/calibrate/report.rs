//! What was found: for people, for programs, and for `nova config import`.

use super::collect::Delays;
use super::survey::Link;
use crate::error::bad_input;
use crate::files::write_whole;
use crate::node_address::hex;
use anyhow::Result;
use nova_ranging::time::TICKS_PER_SECOND;
use nova_ranging::tof::SPEED_OF_LIGHT_AIR_M_PER_S;
use nova_solver::calibration::{Calibration, Determined, PairFit, offset_per_tick_m};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// What is said about one node.
#[derive(Serialize)]
pub(super) struct NodeReport {
    pub(super) address: u16,
    /// What it added to every range, and the doubt of that.
    pub(super) offset_m: f64,
    pub(super) sigma_m: f64,
    /// The same as a change of the sum of its antenna delays.
    pub(super) sum_change_ticks: f64,
    pub(super) sum_sigma_ticks: f64,
    /// In force when the ranges were taken.
    pub(super) was: DelayReport,
    /// To be set.
    pub(super) antenna_delay: DelayReport,
    pub(super) determined: &'static str,
}

/// Antenna delays as configuration files have them.
#[derive(Clone, Copy, Serialize)]
pub(super) struct DelayReport {
    tx_ticks: u16,
    rx_ticks: u16,
}

impl From<Delays> for DelayReport {
    fn from(delays: Delays) -> Self {
        Self {
            tx_ticks: delays.tx_ticks,
            rx_ticks: delays.rx_ticks,
        }
    }
}

/// What is said about one pair in one placement.
#[derive(Serialize)]
pub(super) struct PairReport {
    pub(super) nodes: [u16; 2],
    placement: usize,
    distance_m: f64,
    measured_m: f64,
    scatter_m: f64,
    used: usize,
    rejected: usize,
    error_m: f64,
    sigma_m: f64,
    residual_m: f64,
    weight: f64,
    /// Doubt of what the pair will read, calibrated.
    calibrated_sigma_m: Option<f64>,
}

/// All of it.
#[derive(Serialize)]
pub(super) struct Report {
    pub(super) nodes: Vec<NodeReport>,
    pub(super) pairs: Vec<PairReport>,
    freedom: usize,
    reduced_chi_square: Option<f64>,
    /// Of the offsets, in the order of the nodes.
    covariance_m2: Vec<Vec<f64>>,
}

/// A pair that was measured: in which placement, and how far apart it was.
pub(super) struct MeasuredPair {
    pub(super) link: Link,
    pub(super) placement: usize,
    pub(super) distance_m: f64,
    /// The nodes' places in the list of nodes.
    pub(super) nodes: [usize; 2],
}

impl Report {
    /// From the solution; `nodes` are addresses with the delays in force, in the solver's order.
    pub(super) fn new(
        nodes: &[(u16, Delays)],
        pairs: &[MeasuredPair],
        found: &Calibration,
        tx_share: Option<f64>,
    ) -> Result<Self> {
        let per_tick_m = offset_per_tick_m(SPEED_OF_LIGHT_AIR_M_PER_S, TICKS_PER_SECOND as f64);
        let sigmas_m = found.sigma_m();
        let mut reports = Vec::new();
        for (((&(address, was), &offset_m), sigma_m), determined) in (nodes.iter())
            .zip(&found.offsets_m)
            .zip(sigmas_m)
            .zip(&found.determined)
        {
            let sum_change_ticks = offset_m / per_tick_m;
            let antenna_delay = split(was, sum_change_ticks, tx_share).ok_or_else(|| {
                bad_input!(
                    "{}: its antenna delays would change by {sum_change_ticks:.0} ticks together, \
                     which does not fit 0 to 65535: are the distances right?",
                    hex(address)
                )
            })?;
            reports.push(NodeReport {
                address,
                offset_m,
                sigma_m,
                sum_change_ticks,
                sum_sigma_ticks: sigma_m / per_tick_m,
                was: was.into(),
                antenna_delay,
                determined: word(*determined),
            });
        }
        let covariance = &found.covariance_m2;
        Ok(Self {
            nodes: reports,
            pairs: (pairs.iter().zip(&found.pairs))
                .map(|(pair, fit)| PairReport::new(pair, fit, found))
                .collect(),
            freedom: found.freedom,
            reduced_chi_square: found.reduced_chi_square,
            covariance_m2: (covariance.row_iter())
                .map(|row| row.iter().copied().collect())
                .collect(),
        })
    }

    /// For people.
    pub(super) fn print(&self, out: &mut impl Write) -> Result<()> {
        writeln!(
            out,
            "pair              placement  distance  measured  scatter  ranges  set aside   error  residual"
        )?;
        for pair in &self.pairs {
            let [a, b] = pair.nodes.map(hex);
            writeln!(
                out,
                "{a} {b} {:>13}  {:>8.3}  {:>8.3}  {:>7.3}  {:>6}  {:>9}  {:>+6.3}  {:>+8.3}{}",
                pair.placement,
                pair.distance_m,
                pair.measured_m,
                pair.scatter_m,
                pair.used,
                pair.rejected,
                pair.error_m,
                pair.residual_m,
                if pair.is_suspect() { "  !" } else { "" }
            )?;
        }
        writeln!(
            out,
            "\nnode      offset   sigma   antenna delay, ticks: was          now      sum, sigma"
        )?;
        for node in &self.nodes {
            let (was, now) = (node.was, node.antenna_delay);
            writeln!(
                out,
                "{}   {:>+6.3}  {:>6.3}  {:>17} + {:<5} {:>7} + {:<5} {:>8.1}{}",
                hex(node.address),
                node.offset_m,
                node.sigma_m,
                was.tx_ticks,
                was.rx_ticks,
                now.tx_ticks,
                now.rx_ticks,
                node.sum_sigma_ticks,
                if node.determined == word(Determined::Each) {
                    ""
                } else {
                    "  !"
                }
            )?;
        }
        for remark in self.remarks() {
            writeln!(out, "! {remark}")?;
        }
        Ok(())
    }

    /// What must be known before the answer is used.
    pub(super) fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        let of = |verdict| {
            let nodes: Vec<String> = (self.nodes.iter())
                .filter(|node| node.determined == word(verdict))
                .map(|node| hex(node.address))
                .collect();
            (!nodes.is_empty()).then(|| nodes.join(", "))
        };
        if let Some(nodes) = of(Determined::PairSum) {
            remarks.push(format!(
                "{nodes}: two nodes give only the sum of what they are off. Each got half: ranges \
                 between the two are right, ranges to others are as doubtful as sigma says. A third \
                 node that ranges with both, or --known, tells them apart."
            ));
        }
        if let Some(nodes) = of(Determined::Sums) {
            remarks.push(format!(
                "{nodes}: only sums of neighbours are known, since no three of them all range with \
                 each other. Ranges of the pairs above are right, others are as doubtful as sigma \
                 says. Let two nodes that have not ranged do so, or name one with --known."
            ));
        }
        for pair in self.pairs.iter().filter(|pair| pair.is_suspect()) {
            let [a, b] = pair.nodes.map(hex);
            remarks.push(format!(
                "{a} {b}: {:+.3} m do not fit the other pairs: a wrong distance, or no line of sight",
                pair.residual_m
            ));
        }
        if self.freedom == 0 && self.nodes.len() > 2 {
            remarks.push(
                "as many unknowns as pairs: a wrong distance would not show. A second placement, or \
                 more nodes, would check this."
                    .to_owned(),
            );
        }
        remarks
    }

    /// Writes a file for each node, as `nova config import` takes it.
    pub(super) fn write_files(&self, folder: &Path) -> Result<Vec<String>> {
        std::fs::create_dir_all(folder)
            .map_err(|error| bad_input!("{}: cannot be made: {error}", folder.display()))?;
        let mut written = Vec::new();
        for node in &self.nodes {
            let path = folder.join(format!("{}.toml", hex(node.address)));
            let doubt = if node.determined == word(Determined::Each) {
                String::new()
            } else {
                "# Known only together with its neighbours' delays.\n".to_owned()
            };
            let text = format!(
                "# From `nova calibrate`: ranges were {:+.3} m off through this node, sigma {:.3} m.\n\
                 {doubt}address = {}\n\n[antenna_delay]\ntx_ticks = {}\nrx_ticks = {}\n",
                node.offset_m,
                node.sigma_m,
                hex(node.address),
                node.antenna_delay.tx_ticks,
                node.antenna_delay.rx_ticks
            );
            write_whole(&path, text)?;
            written.push(path.display().to_string());
        }
        Ok(written)
    }
}

impl PairReport {
    fn new(pair: &MeasuredPair, fit: &PairFit, found: &Calibration) -> Self {
        let [a, b] = pair.nodes;
        Self {
            nodes: pair.link.nodes(),
            placement: pair.placement,
            distance_m: pair.distance_m,
            measured_m: fit.measured.mean_m,
            scatter_m: fit.measured.scatter_m,
            used: fit.measured.used,
            rejected: fit.measured.rejected,
            error_m: fit.error_m,
            sigma_m: fit.sigma_m,
            residual_m: fit.residual_m,
            weight: fit.weight,
            calibrated_sigma_m: found.sum_sigma_m(a, b),
        }
    }

    /// Whether it contradicts the others.
    fn is_suspect(&self) -> bool {
        const SIGMAS: f64 = 3.0;
        self.residual_m.abs() > SIGMAS * self.sigma_m
    }
}

fn word(determined: Determined) -> &'static str {
    match determined {
        Determined::Each => "each",
        Determined::PairSum => "pair_sum",
        Determined::Sums => "sums",
        Determined::Nothing => "nothing",
    }
}

/// Delays whose sum differs by so much from what it was: whole ticks, sending in the share given or
/// as it was. `None` where they do not fit the registers.
fn split(was: Delays, change_ticks: f64, tx_share: Option<f64>) -> Option<DelayReport> {
    let (tx, rx) = (f64::from(was.tx_ticks), f64::from(was.rx_ticks));
    let sum = (tx + rx + change_ticks).round();
    let tx_share = tx_share.unwrap_or(if tx + rx > 0.0 { tx / (tx + rx) } else { 0.5 });
    let tx_ticks = (sum * tx_share).round();
    let fits = |ticks: f64| {
        let range = 0.0..=f64::from(u16::MAX);
        range.contains(&ticks).then_some(ticks as u16)
    };
    Some(DelayReport {
        tx_ticks: fits(tx_ticks)?,
        rx_ticks: fits(sum - tx_ticks)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_kept_to_half_a_tick_whatever_the_share() {
        let was = Delays {
            tx_ticks: 16_456,
            rx_ticks: 16_456,
        };
        for change in [-60.4, -0.5, 0.0, 0.4, 37.2, 101.9] {
            for share in [None, Some(0.44), Some(0.5), Some(0.0)] {
                let now = split(was, change, share).unwrap();
                let sum = f64::from(now.tx_ticks) + f64::from(now.rx_ticks);
                assert!((sum - 32_912.0 - change).abs() <= 0.5, "{change} {share:?}");
                if let Some(share) = share {
                    assert!((f64::from(now.tx_ticks) - share * sum).abs() <= 0.5);
                }
            }
        }
        assert!(split(was, -40_000.0, None).is_none());
        assert!(split(was, 1e6, None).is_none());
    }
}
