//! The range filter through the whole chain: radio, node, wire.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{BoardConfig, ClockConfig, LinkEffect, Motion, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::Network;
use nova_wire::{Range, RangeFlags, Treatment};

/// Noise of each receive time stamp; some 2 cm of range.
const RX_NOISE_PS: f64 = 100.0;

/// A pair for `duration_s`, 100 ranges a second; `x_m` is where the tag is.
/// From half-time on something stands between them.
fn ranges(
    duration_s: f64,
    x_m: impl Fn(f64) -> f64 + Send + Sync + 'static,
    later: LinkEffect,
) -> Vec<Range> {
    let mut network = Network::new(SimConfig {
        seed: 11,
        ..SimConfig::default()
    });
    let board = |name: &str, ppm, motion| BoardConfig {
        name: name.to_owned(),
        clock: ClockConfig {
            ppm,
            drift_ppm_per_s: 0.1,
            ..ClockConfig::default()
        },
        motion,
        rx_noise_ps: RX_NOISE_PS,
        ..BoardConfig::default()
    };
    let anchor = board("anchor", 20.0, Motion::fixed([0.0; 3]));
    let a = network.add(anchor, NodeConfig::anchor(Address(1))).unwrap();
    let tag = board("tag", -20.0, Motion::path(move |t_s| [x_m(t_s), 0.0, 0.0]));
    let b = network.add(tag, NodeConfig::tag(Address(2))).unwrap();
    network.run_until_s(duration_s / 2.0).unwrap();
    let [a_id, b_id] = [a, b].map(|board| network.id(board).unwrap());
    network.sim().set_link_effect(a_id, b_id, later);
    network.run_until_s(duration_s).unwrap();
    network.log(a).unwrap().ranges.clone()
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = errors.fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
    f64::sqrt(sum / n)
}

fn count(ranges: &[Range], treatment: Treatment) -> usize {
    ranges.iter().filter(|r| r.treatment == treatment).count()
}

#[test]
fn at_rest_every_range_is_accepted_and_the_noise_falls() {
    let ranges = ranges(60.0, |_| 7.0, LinkEffect::default());
    let settled = &ranges[100..];
    let raw = rms(settled.iter().map(|r| f64::from(r.raw_m) - 7.0));
    let filtered = settled
        .iter()
        .map(|r| f64::from(r.filtered.unwrap().range_m) - 7.0);
    let filtered = rms(filtered);
    println!(
        "{} ranges: raw {raw:.4} m, filtered {filtered:.4} m rms",
        settled.len()
    );
    assert!(filtered < 0.5 * raw, "{filtered} {raw}");
    assert_eq!(count(settled, Treatment::Accepted), settled.len());
}

#[test]
fn a_tag_that_moves_is_followed_without_a_bias() {
    // 3 m to and fro, 1.9 m/s at most.
    let x_m = |t_s: f64| 8.0 + 3.0 * (t_s * std::f64::consts::TAU / 10.0).sin();
    let ranges = ranges(30.0, x_m, LinkEffect::default());
    let settled = &ranges[100..];
    let error = |r: &Range| f64::from(r.filtered.unwrap().range_m - r.raw_m);
    // Against the raw ranges, whose noise is the greater part of this.
    assert!(rms(settled.iter().map(error)) < 0.05);
    let along: f64 = settled
        .iter()
        .map(|r| error(r) * f64::from(r.filtered.unwrap().rate_m_per_s))
        .sum::<f64>()
        / settled.len() as f64;
    assert!(along.abs() < 0.005, "{along}");
    assert!(count(settled, Treatment::Accepted) > settled.len() * 99 / 100);
}

#[test]
fn a_jump_is_believed_once_and_the_raw_range_is_there_all_the_while() {
    let ranges = ranges(
        10.0,
        |t_s| if t_s < 5.0 { 6.0 } else { 14.0 },
        LinkEffect::default(),
    );
    assert_eq!(count(&ranges, Treatment::Reacquired), 1);
    // An exchange in the middle of which the tag jumps lies between the two places.
    let (whole, torn): (Vec<Range>, Vec<Range>) =
        (ranges.iter()).partition(|r| (r.raw_m - 6.0).abs() < 0.2 || (r.raw_m - 14.0).abs() < 0.2);
    assert_eq!(count(&whole, Treatment::RejectedOutlier), 4);
    assert_eq!(count(&torn, Treatment::RejectedOutlier), torn.len());
    assert!(torn.len() <= 1 && torn.iter().all(|r| (6.0..14.0).contains(&r.raw_m)));
    let last = ranges.last().unwrap().filtered.unwrap();
    assert!((last.range_m - 14.0).abs() < 0.1);
}

#[test]
fn a_wall_that_comes_between_is_seen_as_one() {
    let wall = LinkEffect {
        extra_delay_ps: 5_000.0,
        loss_db: 0.0,
        // The radio's figures show 13 dB of it: they read low above -88 dBm.
        first_path_loss_db: 20.0,
    };
    let ranges = ranges(10.0, |_| 7.0, wall);
    let (free, behind): (Vec<Range>, Vec<Range>) = ranges
        .into_iter()
        .partition(|r| !r.flags.contains(RangeFlags::NLOS));
    assert!(
        free.len() > 400 && behind.len() > 400,
        "{} {}",
        free.len(),
        behind.len()
    );
    // An exchange that the wall comes into is between the two.
    let torn = |r: &&Range| (r.raw_m - 7.0).abs() >= 0.2;
    assert!(free.iter().filter(torn).count() <= 1);
    assert!(free.iter().filter(torn).all(|r| r.raw_m < 8.7));
    assert!(behind.iter().all(|r| (r.raw_m - 8.5).abs() < 0.2));
    assert!(
        behind
            .iter()
            .all(|r| r.quality.unwrap().nlos_percent.unwrap() >= 50)
    );
    // Too long at first; what stays so long is believed after twice as many as a jump in the open.
    assert_eq!(count(&behind, Treatment::RejectedNlos), 9);
    assert_eq!(count(&behind, Treatment::Reacquired), 1);
}
