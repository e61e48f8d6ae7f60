//! Two boards that run the firmware's node, 10,000 exchanges each time: what
//! they report is the distance, and nothing else.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{ChannelConfig, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::{BoardLog, Network, anchor_polling, board_at};

const EXCHANGES: usize = 10_000;

/// What the noise of the three receive time stamps of an exchange makes of the
/// range, for equal reply times: `c s sqrt(1 + 4 + 1) / 4`.
const METRES_PER_PS: f64 = 299_702_547.0 * 1e-12 * 0.612;

struct Pair {
    distance_m: f64,
    ppm: [f64; 2],
    rx_noise_ps: f64,
    seed: u64,
}

impl Pair {
    /// What the initiator's serial port says.
    fn run(&self) -> BoardLog {
        let mut network = Network::new(SimConfig {
            seed: self.seed,
            channel: ChannelConfig {
                // At 6.8 Mbit/s the module does not reach 100 m with its own
                // antenna; with better ones it does.
                antenna_gain_db: 12.0,
                ..ChannelConfig::default()
            },
        });
        let board = |name: &str, x_m: f64, ppm, offset_ticks| {
            let mut board = board_at(name, x_m, ppm);
            board.clock.offset_ticks = offset_ticks;
            board.rx_noise_ps = self.rx_noise_ps;
            board
        };
        let [ppm_a, ppm_b] = self.ppm;
        let period_us = 5_000;
        // Both clocks wrap, at different times, while the test runs.
        let a = board("anchor", 0.0, ppm_a, 1 << 39);
        let a = network
            .add(a, anchor_polling(Address(2), period_us))
            .unwrap();
        let b = board("tag", self.distance_m, ppm_b, 12_345_678);
        network.add(b, NodeConfig::tag(Address(2))).unwrap();
        let duration_s = EXCHANGES as f64 * f64::from(period_us) * 1e-6 + 0.1;
        network.run_until_s(duration_s).unwrap();
        network.log(a).unwrap().clone()
    }

    fn errors_m(&self) -> Vec<f64> {
        let log = self.run();
        assert!(log.ranges.len() >= EXCHANGES, "{:?}", log.counters);
        assert_eq!(log.wire.lost + log.wire.corrupt, 0);
        log.ranges
            .iter()
            .map(|range| f64::from(range.raw_m) - self.distance_m)
            .collect()
    }
}

fn mean_and_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt())
}

#[test]
fn without_noise_the_range_is_the_distance_however_far_apart_the_clocks() {
    for (distance_m, ppm) in [
        (1.0, [0.5, -0.5]),
        (3.0, [20.0, -20.0]),
        (10.0, [-20.0, 20.0]),
        (30.0, [10.0, -10.0]),
        (60.0, [-5.0, 5.0]),
        (100.0, [20.0, -20.0]),
    ] {
        let pair = Pair {
            distance_m,
            ppm,
            rx_noise_ps: 0.0,
            seed: 1,
        };
        let (mean, std) = mean_and_std(&pair.errors_m());
        println!(
            "{distance_m:>5} m, {ppm:?} ppm: mean error {:+.2} mm, std {:.2} mm",
            mean * 1e3,
            std * 1e3
        );
        assert!(
            mean.abs() < 0.002,
            "mean error {mean} m at {distance_m} m, {ppm:?} ppm"
        );
        assert!(std < 0.0015, "std {std} m at {distance_m} m, {ppm:?} ppm");
    }
}

/// What two clocks have in common cannot be seen by either: it stretches the
/// time of flight and the antenna delays, 515 ns of them, alike.
#[test]
fn clocks_that_are_fast_together_stretch_the_range_by_what_they_must() {
    const ANTENNA_DELAYS_M: f64 = 2.0 * 16_456.0 * 299_702_547.0 / 63_897_600_000.0;
    for (distance_m, ppm) in [
        (30.0, [0.0, 20.0]),
        (60.0, [-20.0, 0.0]),
        (5.0, [20.0, 20.1]),
    ] {
        let pair = Pair {
            distance_m,
            ppm,
            rx_noise_ps: 0.0,
            seed: 1,
        };
        let (mean, _) = mean_and_std(&pair.errors_m());
        let [a, b] = ppm;
        let expected = (distance_m + ANTENNA_DELAYS_M) * (a + b) / 2.0 * 1e-6;
        println!(
            "{distance_m:>5} m, {ppm:?} ppm: mean error {:+.2} mm, {:+.2} mm expected",
            mean * 1e3,
            expected * 1e3
        );
        assert!((mean - expected).abs() < 0.0005);
    }
}

#[test]
fn noise_of_the_time_stamps_comes_through_unchanged_and_unbiased() {
    for (distance_m, ppm, rx_noise_ps) in [
        (5.0, [20.0, -20.0], 100.0),
        (50.0, [-20.0, 20.0], 100.0),
        (10.0, [7.0, -3.0], 300.0),
    ] {
        let pair = Pair {
            distance_m,
            ppm,
            rx_noise_ps,
            seed: 2,
        };
        let errors = pair.errors_m();
        let (mean, std) = mean_and_std(&errors);
        let expected = rx_noise_ps * METRES_PER_PS;
        println!(
            "{distance_m:>5} m, {ppm:?} ppm, {rx_noise_ps} ps: mean error {:+.2} mm, std {:.2} mm, {:.2} mm put in",
            mean * 1e3,
            std * 1e3,
            expected * 1e3
        );
        let mean_limit = 0.002 + 4.0 * expected / (errors.len() as f64).sqrt();
        assert!(mean.abs() < mean_limit, "mean error {mean} m");
        assert!(
            (0.95..1.05).contains(&(std / expected)),
            "std {std} m instead of {expected} m"
        );
    }
}

#[test]
fn noise_makes_short_ranges_negative_and_they_are_reported() {
    let pair = Pair {
        distance_m: 0.02,
        ppm: [3.0, -8.0],
        rx_noise_ps: 300.0,
        seed: 3,
    };
    let ranges: Vec<f64> = pair
        .errors_m()
        .iter()
        .map(|e| e + pair.distance_m)
        .collect();
    let negative = ranges.iter().filter(|&&r| r < 0.0).count() as f64 / ranges.len() as f64;
    println!("{:.1} % of ranges at 2 cm are negative", negative * 100.0);
    // Normal distribution below -0.02 m / (300 ps x METRES_PER_PS) = -0.36 sigma: 36 %.
    assert!((0.33..0.39).contains(&negative));
    let (mean, _) = mean_and_std(&ranges);
    assert!((mean - pair.distance_m).abs() < 0.002 + 4.0 * 0.055 / 100.0);
}

#[test]
fn the_reported_clock_offset_is_the_true_one() {
    for ppm in [[20.0, -20.0], [-7.5, 2.5]] {
        let pair = Pair {
            distance_m: 10.0,
            ppm,
            rx_noise_ps: 100.0,
            seed: 4,
        };
        let offsets: Vec<f64> = pair
            .run()
            .ranges
            .iter()
            .map(|range| f64::from(range.clock_offset_ppm))
            .collect();
        let (mean, _) = mean_and_std(&offsets);
        let [a, b] = ppm;
        let expected = ((1.0 + b * 1e-6) / (1.0 + a * 1e-6) - 1.0) * 1e6;
        assert!(
            (mean - expected).abs() < 0.02,
            "{mean} ppm instead of {expected}"
        );
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let bytes = |seed| {
        let pair = Pair {
            distance_m: 7.0,
            ppm: [11.0, -13.0],
            rx_noise_ps: 100.0,
            seed,
        };
        pair.run().bytes
    };
    let first = bytes(5);
    assert_eq!(first, bytes(5));
    assert_ne!(first, bytes(6));
}
