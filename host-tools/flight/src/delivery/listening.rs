//! A vehicle that only listens: the platform's four anchors range among themselves.
//!
//! The first of them polls, the others answer; from what the vehicle overhears comes how much further each is than the
//! first (`solver::positioning::Listening` makes that of a board's records; here it is drawn with its noise), and from the
//! three differences of a round a place.

use super::scenario::Scenario;
use crate::streams::normal;
use nalgebra::Vector3;
use nova_solver::delivery::Measurement;
use nova_solver::positioning::{
    ListenedDifference, ListenedRound, RangeDifference, TdoaOptions, locate_round,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Noise of a receive stamp against that of a range: a two-way range has 0.61 of it (docs/air-protocol.md).
const STAMPS_IN_A_RANGE: f64 = 0.61;
/// Of a difference in stamps (`positioning::listening::exchange`, replies equally long): what it has for itself, and what it
/// shares with its round by the poll and by the final.
const OWN: f64 = 1.173;
const SHARED: f64 = 0.5;
/// Places whose standard deviation along any direction is more say nothing that a filter could take as a straight line,
/// metres. Chosen on other seeds than those of docs/delivery.md: at 1, 2, 4, 8 and 20 m, 19, 53, 60, 60 and 60 of 60 landed.
const MOST_SIGMA_M: f64 = 4.0;

/// The place from a round of these anchors (places and biases, the one that polls first) at this truth, if enough is heard
/// of it. `repeated` places share their anchors' offsets, so that
/// each may only say so much about them.
pub(super) fn by_differences(
    rng: &mut ChaCha8Rng,
    scenario: &Scenario,
    anchors: &[([f64; 3], f64)],
    from_platform: &Vector3<f64>,
    heard: f64,
    repeated: f64,
) -> Option<Measurement> {
    let stamp_m = scenario.range_sigma_m / STAMPS_IN_A_RANGE;
    let mut noise = |sigma_m: f64| sigma_m * normal(rng);
    // Poll and final of the first anchor are in all differences.
    let common_m = noise(SHARED * stamp_m) + noise(SHARED * stamp_m);
    let own_m: Vec<f64> = (1..anchors.len()).map(|_| noise(OWN * stamp_m)).collect();
    let away = |anchor: &[f64; 3]| (from_platform - Vector3::from(*anchor)).norm();
    let ((first, first_bias_m), others) = anchors.split_first()?;
    let sigma_m = stamp_m * (OWN * OWN + 2.0 * SHARED * SHARED).sqrt();
    // The first anchor's frames are in every exchange.
    let reaches = |anchor| away(anchor) <= scenario.uwb_reach_m;
    if !reaches(first) || !rng.random_bool(heard) {
        return None;
    }
    let differences: Vec<ListenedDifference> = (2..)
        .zip(others)
        .zip(own_m)
        .filter_map(|((address, (anchor, bias_m)), own_m)| {
            let difference_m =
                away(anchor) + bias_m - away(first) - first_bias_m + own_m + common_m;
            (reaches(anchor) && rng.random_bool(heard)).then_some(ListenedDifference {
                t_s: 0.0,
                addresses: [1, address],
                difference: RangeDifference {
                    anchors_m: [Vector3::from(*first), Vector3::from(*anchor)],
                    difference_m,
                    sigma_m,
                },
                shared_m: [SHARED * stamp_m; 2],
            })
        })
        .collect();
    let options = TdoaOptions {
        offset_sigma_m: (scenario.anchor_bias_m * f64::sqrt(repeated)).max(1e-6),
        heights_m: Some([-0.5, 20.0]),
        ..TdoaOptions::default()
    };
    let fix = locate_round(&ListenedRound { differences }, &options).ok()?;
    let largest_m2 = fix.covariance_m2.symmetric_eigenvalues().max();
    (largest_m2 <= MOST_SIGMA_M * MOST_SIGMA_M).then_some(Measurement::Uwb {
        position_m: fix.position_m,
        covariance_m2: fix.covariance_m2,
    })
}
