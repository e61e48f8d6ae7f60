//! Mean length of a Gaussian vector in the plane.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

use nalgebra::Matrix3;

/// Mean horizontal error, metres, of an unbiased Gaussian estimate of covariance `covariance_m2`.
///
/// With the standard deviations `a >= b` along the principal axes of the horizontal part,
///
/// ```text
/// E|x| = a sqrt(2/pi) E(1 - b^2/a^2)
/// ```
///
/// with the complete elliptic integral of the second kind `E(m)`. A circle (`a = b`) gives
/// `sqrt(pi)/2 = 0.886` of the root mean square, a line (`b = 0`) 0.798 of it.
pub fn mean_error_m(covariance_m2: &Matrix3<f64>) -> f64 {
    let (xx, xy, yy) = (
        covariance_m2[(0, 0)],
        covariance_m2[(0, 1)],
        covariance_m2[(1, 1)],
    );
    let middle = 0.5 * (xx + yy);
    let spread = (0.5 * (xx - yy)).hypot(xy);
    let (long, short) = (middle + spread, (middle - spread).max(0.0));
    if long > 0.0 {
        (FRAC_2_PI * long).sqrt() * elliptic_e(short / long)
    } else {
        0.0
    }
}

/// `E(m)` of `1 - m`, for `0 <= 1 - m <= 1`, by the arithmetic-geometric mean (Abramowitz and
/// Stegun 17.6): `E = K (1 - sum 2^(n-1) c_n^2)`, `K = pi / (2 a)`.
fn elliptic_e(complement: f64) -> f64 {
    // The mean loses its digits where K goes to infinity; there E - 1 is below this times 20.
    if complement < 1e-14 {
        return 1.0;
    }
    let (mut a, mut b) = (1.0, complement.sqrt());
    let mut sum = 0.5 * (1.0 - complement);
    let mut power = 0.5;
    while a - b > 1e-15 * a {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
        power *= 2.0;
        sum += power * c * c;
        if power > 1e3 {
            break; // doubles its digits each time: never this many rounds
        }
    }
    FRAC_PI_2 / a * (1.0 - sum)
}
