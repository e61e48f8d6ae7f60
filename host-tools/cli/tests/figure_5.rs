//! The table about the paper's Fig. 5 in docs/nova.md.
#![allow(clippy::unwrap_used)]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const RANGE_ERROR_M: f64 = 0.28;

/// Ratio, factor, error of the horizontal distance and that distance at 30 m height, row by row.
fn rows() -> Vec<[f64; 4]> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/nova.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, section) = page.split_once("\n## Fig. 5").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    section
        .lines()
        .filter(|line| {
            line.starts_with("| 0.") || line.starts_with("| 1 ") || line.starts_with("| 2 ")
        })
        .map(|line| {
            let cells: Vec<f64> = line
                .trim_matches('|')
                .split('|')
                .map(|cell| cell.trim().parse().unwrap())
                .collect();
            cells.try_into().unwrap()
        })
        .collect()
}

#[test]
fn rows_follow_equation_7() {
    let rows = rows();
    assert_eq!(rows.len(), 8);
    for [ratio, factor, error_m, distance_m] in rows {
        let exact = ratio.hypot(1.0) / ratio;
        assert!((factor - exact).abs() < 6e-4, "{ratio}: {exact}");
        assert!((error_m - RANGE_ERROR_M * exact).abs() < 6e-4, "{ratio}");
        assert!((distance_m - 30.0 * ratio).abs() < 6e-3, "{ratio}");
    }
}

#[test]
fn drawn_ranges_scatter_as_the_rows_say_where_errors_are_small() {
    const HEIGHT_M: f64 = 30.0;
    const DRAWS: u32 = 20_000;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // Eq. 7 is of first order: nearer to the tag the error is no longer small beside the distance.
    let far = |row: &[f64; 4]| row[0] >= 0.25;
    for [ratio, _, error_m, _] in rows().into_iter().filter(far) {
        let distance_m = ratio * HEIGHT_M;
        // An even distribution with this standard deviation.
        let half_width_m = RANGE_ERROR_M * 3f64.sqrt();
        let square: f64 = (0..DRAWS)
            .map(|_| {
                let range_m =
                    distance_m.hypot(HEIGHT_M) + rng.random_range(-half_width_m..half_width_m);
                // Eq. 5, the height known.
                let measured_m = (range_m * range_m - HEIGHT_M * HEIGHT_M).max(0.0).sqrt();
                (measured_m - distance_m).powi(2)
            })
            .sum();
        let rms_m = (square / f64::from(DRAWS)).sqrt();
        assert!(
            (rms_m / error_m - 1.0).abs() < 0.06,
            "{ratio}: {rms_m} {error_m}"
        );
    }
}
