//! The recording that the NLOS rule was fitted to, and the fit.
//!
//! 9147 receptions between 7 places of a tag and 19 anchors in an industrial hall, labelled by whether the anchor was in
//! sight, with the surveyed distance; channel 1, 110 kbit/s, PRF 64 MHz, 1536 symbols. Sight is a matter of tag's place
//! and anchor: one label for each of the 123 pairs. So rows must not be split at random, since neighbours would
//! stand on both sides: places are.
#![allow(dead_code, clippy::unwrap_used)] // Two programs use this, each a part.

use nalgebra::{Matrix3, Vector3};
use nova_ranging::nlos::{NlosRule, Signs};
use nova_ranging::phy::{Channel, Prf};
use std::path::PathBuf;

/// Places whose receptions the rule was fitted to; it is judged on the others.
pub(crate) const FITTED_TO: [u32; 4] = [10, 14, 18, 22];

/// The rule's mode: that of the recording.
pub(crate) const RULE: NlosRule = NlosRule::new(Channel::Ch1, Prf::Mhz64);

/// A reception.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reception {
    pub(crate) place: u32,
    pub(crate) anchor: u32,
    pub(crate) signs: Signs,
    pub(crate) nlos: bool,
    pub(crate) error_m: f64,
}

impl Reception {
    /// The detector to beat: receive less first-path power.
    pub(crate) fn spread_db(&self) -> f64 {
        f64::from(self.signs.rx_power_dbm - self.signs.first_path_power_dbm)
    }

    pub(crate) fn probability(&self) -> f64 {
        RULE.probability(&self.signs).unwrap().into()
    }
}

/// The recording, or where it was looked for.
pub(crate) fn recording() -> Result<Vec<Reception>, PathBuf> {
    let folder = std::env::var_os("NOVA_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join("C_nlos_dw1000/iiot19.csv");
    let Ok(mut reader) = csv::Reader::from_path(&path) else {
        return Err(path);
    };
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let [place, anchor, rx, fp, range, truth, nlos] = [
        "location",
        "anchor",
        "rx_power_dbm",
        "fp_power_dbm",
        "range_mm",
        "gt_mm",
        "nlos",
    ]
    .map(column);
    Ok(reader
        .records()
        .map(|row| {
            let row = row.unwrap();
            let number = |c: usize| row[c].parse::<f64>().unwrap();
            Reception {
                place: number(place) as u32,
                anchor: number(anchor) as u32,
                signs: Signs {
                    rx_power_dbm: number(rx) as f32,
                    first_path_power_dbm: number(fp) as f32,
                    range_m: (number(range) / 1e3) as f32,
                },
                nlos: &row[nlos] == "NLOS",
                error_m: (number(range) - number(truth)) / 1e3,
            }
        })
        .collect())
}

/// Bias and weights of a logistic rule on the two signs: maximum likelihood,
/// both labels with the same weight in all. Newton's method.
pub(crate) fn fit(receptions: &[Reception]) -> [f64; 3] {
    let nlos = receptions.iter().filter(|r| r.nlos).count() as f64;
    let weight = |r: &Reception| {
        if r.nlos {
            0.5 / nlos
        } else {
            0.5 / (receptions.len() as f64 - nlos)
        }
    };
    let mut w = Vector3::zeros();
    for _ in 0..50 {
        let (mut gradient, mut hessian) = (Vector3::zeros(), Matrix3::zeros());
        for r in receptions {
            let x = features(r);
            let p = 1.0 / (1.0 + (-w.dot(&x)).exp());
            gradient += x * (f64::from(u8::from(r.nlos)) - p) * weight(r);
            hessian += x * x.transpose() * (p * (1.0 - p) * weight(r));
        }
        let step = hessian.try_inverse().unwrap() * gradient;
        w += step;
        if step.norm() < 1e-9 {
            break;
        }
    }
    w.into()
}

/// 1, spread, missing.
pub(crate) fn features(r: &Reception) -> Vector3<f64> {
    let (spread, missing) = RULE.evidence(&r.signs).unwrap();
    Vector3::new(1.0, spread.into(), missing.into())
}

/// Share of NLOS found when `false_positives` of the others are taken for it.
pub(crate) fn found_at(
    receptions: &[Reception],
    false_positives: f64,
    score: impl Fn(&Reception) -> f64,
) -> f64 {
    let scored: Vec<_> = receptions.iter().map(|r| (*r, score(r))).collect();
    found_by_scores(&scored, false_positives)
}

/// Share of those with or without line of sight that `is` says yes to.
pub(crate) fn share(receptions: &[Reception], nlos: bool, is: impl Fn(&Reception) -> bool) -> f64 {
    let of: Vec<_> = receptions.iter().filter(|r| r.nlos == nlos).collect();
    of.iter().filter(|r| is(r)).count() as f64 / of.len() as f64
}

/// Scores from fits that never saw the reception's group: each group left out once.
pub(crate) fn left_out<K: Ord + Copy>(
    receptions: &[Reception],
    group: impl Fn(&Reception) -> K,
) -> Vec<(Reception, f64)> {
    let groups: std::collections::BTreeSet<K> = receptions.iter().map(&group).collect();
    let mut scored = Vec::new();
    for left_out in groups {
        let (test, train): (Vec<Reception>, Vec<Reception>) =
            receptions.iter().partition(|r| group(r) == left_out);
        let w = Vector3::from(fit(&train));
        scored.extend(test.into_iter().map(|r| (r, w.dot(&features(&r)))));
    }
    scored
}

/// [`found_at`] for receptions that have their scores already.
pub(crate) fn found_by_scores(scored: &[(Reception, f64)], false_positives: f64) -> f64 {
    let of = |nlos: bool| {
        let of = scored.iter().filter(move |(r, _)| r.nlos == nlos);
        of.map(|(_, score)| *score).collect::<Vec<f64>>()
    };
    let (mut free, blocked) = (of(false), of(true));
    free.sort_by(f64::total_cmp);
    let place = ((1.0 - false_positives) * free.len() as f64).ceil() as usize;
    let threshold = free[place.clamp(1, free.len()) - 1];
    blocked.iter().filter(|s| **s > threshold).count() as f64 / blocked.len() as f64
}
