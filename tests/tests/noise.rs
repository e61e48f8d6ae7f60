//! Noise and bias of ranges at rest through the whole chain, against the noise put into the simulated time stamps.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{BoardConfig, ClockConfig, Motion, SimConfig};
use nova_node::ranging::Address;
use nova_node::{AntennaDelay, NodeConfig, SetAntennaDelay};
use nova_tests::Network;

/// Noise of each receive time stamp.
const RX_NOISE_PS: f64 = 100.0;
const DISTANCE_M: f64 = 7.0;
const SECONDS: f64 = 60.0;
/// Radios and filters settle.
const FROM_US: u64 = 200_000;

/// What that noise makes of a range where the reply times are as good as equal:
/// c s sqrt(Da² + (Da + Db)² + Db²) / 2 (Da + Db) (docs/air-protocol.md).
const PUT_IN_M: f64 = 299_702_547.0 * 1e-12 * RX_NOISE_PS * 0.612_372;

/// Mean error and standard deviation of the raw ranges of an initiator whose crystal is off by the first of `ppm`, and
/// drifts by the first of `drift`; the responder's by the second. Both know their antenna delays as `delay` says.
fn errors(
    ppm: [f64; 2],
    drift: [f64; 2],
    distance_m: f64,
    delay: SetAntennaDelay,
) -> (f64, f64, usize) {
    let mut network = Network::new(SimConfig {
        seed: 11,
        ..SimConfig::default()
    });
    let board = |index: usize, x: f64| BoardConfig {
        name: format!("{index}"),
        clock: ClockConfig {
            ppm: ppm[index],
            drift_ppm_per_s: drift[index],
            ..ClockConfig::default()
        },
        motion: Motion::fixed([x, 0.0, 0.0]),
        rx_noise_ps: RX_NOISE_PS,
        ..BoardConfig::default()
    };
    let mut anchor = NodeConfig::anchor(Address(1));
    anchor.antenna_delay = delay;
    let a = network.add(board(0, 0.0), anchor).unwrap();
    let mut tag = NodeConfig::tag(Address(2));
    tag.antenna_delay = delay;
    network.add(board(1, distance_m), tag).unwrap();
    network.run_until_s(SECONDS).unwrap();
    let settled = network.log(a).unwrap().ranges.iter();
    let errors: Vec<f64> = settled
        .filter(|r| r.t_us >= FROM_US)
        .map(|r| f64::from(r.raw_m) - distance_m)
        .collect();
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt(), errors.len())
}

#[test]
fn ranges_at_rest_are_no_noisier_than_what_was_put_in_whatever_the_clocks_do() {
    println!("put in: {:.2} mm", 1e3 * PUT_IN_M);
    for (ppm, drift) in [
        ([0.0, 0.0], [0.0, 0.0]),
        ([20.0, -20.0], [0.1, 0.1]),
        ([-20.0, 20.0], [0.1, -0.1]),
        ([40.0, 0.0], [0.1, 0.1]),
        ([0.0, -40.0], [-0.1, 0.1]),
        ([40.0, -40.0], [0.1, -0.1]),
        ([-40.0, 40.0], [0.1, 0.1]),
        // Both crystals read antenna delays and flight as long as they are fast: docs/found-by-trying.md.
        ([40.0, 40.0], [0.0, 0.0]),
    ] {
        let (bias_m, sigma_m, count) = errors(ppm, drift, DISTANCE_M, SetAntennaDelay::default());
        let rms_m = (bias_m * bias_m + sigma_m * sigma_m).sqrt();
        println!(
            "{ppm:?} ppm, {drift:?} ppm/s, {count} ranges: bias {:+.2} mm, sigma {:.2} mm, rms {:.2} mm: {:.3} of it",
            1e3 * bias_m,
            1e3 * sigma_m,
            1e3 * rms_m,
            rms_m / PUT_IN_M
        );
        assert!(count > 5_900, "{count}");
        assert!(sigma_m <= 1.05 * PUT_IN_M, "{ppm:?}: {sigma_m}");
        // Bias and all, as long as the crystals are not both that fast.
        if ppm[0] + ppm[1] <= 40.0 {
            assert!(rms_m <= 1.05 * PUT_IN_M, "{ppm:?}: {rms_m}");
        }
    }
}

/// What both crystals have in common cannot be told from the distance while ranging, but most of what it does is to the
/// antenna delays, 154 m of them: a calibration at a known distance reads those with the same crystals.
#[test]
fn boards_calibrated_at_one_distance_have_no_bias_at_another_however_fast_both_are() {
    const METRES_PER_TICK: f64 = 299_702_547.0 / 63_897_600_000.0;
    for ppm in [[40.0, 40.0], [-40.0, -40.0]] {
        let (before_m, ..) = errors(ppm, [0.0; 2], DISTANCE_M, SetAntennaDelay::default());
        // A range is half the sum of both boards' two delays too long: all of a board's share goes to reception.
        let ticks = (before_m / METRES_PER_TICK).round() as i32;
        let nominal = AntennaDelay::UNCALIBRATED;
        let delay = SetAntennaDelay {
            tx_ticks: Some(nominal.tx_ticks),
            rx_ticks: u16::try_from(i32::from(nominal.rx_ticks) + ticks).ok(),
        };
        let (bias_m, sigma_m, count) = errors(ppm, [0.0; 2], 3.0 * DISTANCE_M, delay);
        let rms_m = bias_m.hypot(sigma_m);
        println!(
            "{ppm:?} ppm: {:+.2} mm as bought; {ticks} ticks; bias {:+.2} mm, {:.3} of what was put in",
            1e3 * before_m,
            1e3 * bias_m,
            rms_m / PUT_IN_M
        );
        assert!(before_m.abs() > 0.005 && ticks != 0, "{ppm:?}: {before_m}");
        assert!(count > 5_900, "{count}");
        assert!(rms_m <= 1.05 * PUT_IN_M, "{ppm:?}: {rms_m}");
    }
}
