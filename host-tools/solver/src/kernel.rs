//! Robust kernels: how much a residual that is too large to be noise may still pull.
//!
//! With the whitened residual `r = (predicted - measured) / sigma`, the cost of a problem is `1/2
//! sum rho(r)`. The influence is `psi(r) = 1/2 rho'(r) = w(r) r`, and a Gauss-Newton step solves
//! the least squares problem with weights `w` (iteratively reweighted least squares; Huber, "Robust
//! Statistics", 1981, ch. 7).
//!
//! | kernel | `rho(r)` | `w(r)` |
//! |---|---|---|
//! | none | `r^2` | `1` |
//! | Huber | `r^2` for `abs(r) <= k`, else `2 k abs(r) - k^2` | `min(1, k / abs(r))` |
//! | Cauchy | `c^2 ln(1 + r^2 / c^2)` | `1 / (1 + r^2 / c^2)` |

/// Huber's tuning constant for 95 % efficiency on Gaussian noise.
pub const HUBER_95: f64 = 1.345;
/// The Cauchy kernel's tuning constant for 95 % efficiency on Gaussian noise.
pub const CAUCHY_95: f64 = 2.385;

/// A robust kernel with its tuning constant in units of sigma.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// Plain least squares.
    None,
    /// Quadratic up to `k` sigma, linear beyond: convex, but an outlier keeps a bounded pull.
    Huber {
        /// Where the linear part begins, in sigma.
        k: f64,
    },
    /// Redescending: the pull of an outlier fades as `1/r`. Not convex, hence needs a good start.
    Cauchy {
        /// The width, in sigma.
        c: f64,
    },
}

impl Default for Kernel {
    fn default() -> Self {
        Kernel::Cauchy { c: CAUCHY_95 }
    }
}

impl Kernel {
    /// True where the tuning constant is a positive finite number.
    pub fn is_valid(self) -> bool {
        match self {
            Kernel::None => true,
            Kernel::Huber { k: width } | Kernel::Cauchy { c: width } => {
                width.is_finite() && width > 0.0
            }
        }
    }

    /// `(rho, w)` of the squared whitened residual `r2 = r^2`.
    #[inline]
    pub fn rho_and_weight(self, r2: f64) -> (f64, f64) {
        match self {
            Kernel::None => (r2, 1.0),
            Kernel::Huber { k } => {
                if r2 <= k * k {
                    (r2, 1.0)
                } else {
                    let r = r2.sqrt();
                    (2.0 * k * r - k * k, k / r)
                }
            }
            Kernel::Cauchy { c } => {
                let c2 = c * c;
                let scaled = r2 / c2;
                (c2 * scaled.ln_1p(), 1.0 / (1.0 + scaled))
            }
        }
    }

    /// Starts a sum of `rho`; see [`RhoSum`].
    pub fn sum<const LANES: usize>(self) -> RhoSum<LANES> {
        RhoSum {
            kernel: self,
            sum: 0.0,
            products: [1.0; LANES],
            factors: 0,
        }
    }

    /// Slope of the influence, `psi'(r) = d(w r)/dr`, of the squared whitened residual. May be
    /// negative for the Cauchy kernel.
    #[inline]
    pub fn influence_slope(self, r2: f64) -> f64 {
        match self {
            Kernel::None => 1.0,
            Kernel::Huber { k } => {
                if r2 <= k * k {
                    1.0
                } else {
                    0.0
                }
            }
            Kernel::Cauchy { c } => {
                let scaled = r2 / (c * c);
                (1.0 - scaled) / ((1.0 + scaled) * (1.0 + scaled))
            }
        }
    }

    /// Variance of the estimate on Gaussian noise relative to plain least squares, `E[psi^2] /
    /// E[psi']^2 >= 1` (Huber 1981, eq. 7.6.3). Its inverse is the kernel's efficiency.
    pub fn gaussian_variance_factor(self) -> f64 {
        if self == Kernel::None {
            return 1.0;
        }
        // E[psi'] = E[psi r] for Gaussian r (Stein's lemma), which spares the jumps of psi'.
        // Midpoint rule over +-8 sigma; the normalisation of the Gaussian is taken from the same
        // sum.
        const STEPS: u32 = 64;
        let step = 8.0 / f64::from(STEPS);
        let (mut density, mut influence2, mut slope) = (0.0, 0.0, 0.0);
        for i in 0..STEPS {
            let r = (f64::from(i) + 0.5) * step;
            let r2 = r * r;
            let p = (-0.5 * r2).exp();
            let (_, w) = self.rho_and_weight(r2);
            density += p;
            influence2 += p * w * w * r2;
            slope += p * w * r2;
        }
        // A kernel far narrower than the noise has hardly any slope left; the floor keeps the
        // answer finite.
        let slope = (slope / density).max(1e-3);
        (influence2 / density / (slope * slope)).max(1.0)
    }
}

/// A running sum of `rho` over many residuals, taken `LANES` at a time.
///
/// The Cauchy kernel's logarithms are most of the cost of a fit. `sum ln a_i = ln prod a_i`, so it
/// takes one logarithm for several residuals.
#[derive(Debug, Clone, Copy)]
pub struct RhoSum<const LANES: usize> {
    kernel: Kernel,
    sum: f64,
    products: [f64; LANES],
    factors: u32,
}

impl<const LANES: usize> RhoSum<LANES> {
    /// Factors a product may gather: with residuals up to 1e15 sigma it stays below 1e270.
    const FACTORS: u32 = 9;

    /// Adds `rho` of the squared whitened residuals `r2 = r^2` and returns their weights `w` and
    /// what they add to the second derivatives: the slope of the influence, but no less than
    /// `least_curvature * w`.
    ///
    /// With `least_curvature` 1 a Gauss-Newton step is that of iteratively reweighted least
    /// squares: it goes down from anywhere, but the last steps shrink by a constant factor only.
    /// With less it becomes Newton's, which converges quadratically near a minimum (Triggs et al.,
    /// "Bundle adjustment, a modern synthesis", 2000, sec. 4.3) and overshoots far from it.
    #[inline]
    pub fn add(&mut self, r2: &[f64; LANES], least_curvature: f64) -> ([f64; LANES], [f64; LANES]) {
        let (mut weights, mut curvatures) = ([1.0; LANES], [1.0; LANES]);
        match self.kernel {
            Kernel::None => self.sum += r2.iter().sum::<f64>(),
            Kernel::Huber { .. } => {
                for k in 0..LANES {
                    let (rho, w) = self.kernel.rho_and_weight(r2[k]);
                    self.sum += rho;
                    let slope = self.kernel.influence_slope(r2[k]);
                    (weights[k], curvatures[k]) = (w, slope.max(least_curvature * w));
                }
            }
            Kernel::Cauchy { c } => {
                let inv_c2 = 1.0 / (c * c);
                for k in 0..LANES {
                    let factor = 1.0 + r2[k] * inv_c2;
                    self.products[k] *= factor;
                    let w = 1.0 / factor;
                    // The slope is (1 - r2/c2) w^2 = (2 w - 1) w.
                    let curvature = w * (2.0 * w - 1.0).max(least_curvature);
                    (weights[k], curvatures[k]) = (w, curvature);
                }
                self.factors += 1;
                if self.factors == Self::FACTORS {
                    self.fold();
                }
            }
        }
        (weights, curvatures)
    }

    fn fold(&mut self) {
        if let Kernel::Cauchy { c } = self.kernel {
            self.sum += c * c * self.products.iter().map(|p| p.ln()).sum::<f64>();
        }
        self.products = [1.0; LANES];
        self.factors = 0;
    }

    /// The sum.
    pub fn total(mut self) -> f64 {
        self.fold();
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNELS: [Kernel; 3] = [
        Kernel::None,
        Kernel::Huber { k: HUBER_95 },
        Kernel::Cauchy { c: CAUCHY_95 },
    ];

    #[test]
    fn weight_is_the_derivative_of_rho() {
        for kernel in KERNELS {
            for r in [0.1, 0.9, 1.3, 1.4, 3.0, 50.0] {
                let h = 1e-5 * r;
                let rho = |r: f64| kernel.rho_and_weight(r * r).0;
                let half_slope = (rho(r + h) - rho(r - h)) / (4.0 * h);
                let (_, w) = kernel.rho_and_weight(r * r);
                assert!(
                    (half_slope - w * r).abs() < 1e-6 * (1.0 + w * r),
                    "{kernel:?} at {r}"
                );
            }
        }
    }

    #[test]
    fn influence_slope_is_the_derivative_of_the_influence() {
        for kernel in KERNELS {
            for r in [0.1, 0.9, 1.3, 1.4, 3.0, 50.0] {
                let h = 1e-5 * r;
                let psi = |r: f64| kernel.rho_and_weight(r * r).1 * r;
                let slope = (psi(r + h) - psi(r - h)) / (2.0 * h);
                assert!(
                    (slope - kernel.influence_slope(r * r)).abs() < 1e-6,
                    "{kernel:?} at {r}"
                );
            }
        }
    }

    #[test]
    fn running_sum_is_the_sum_of_rho_even_for_absurd_residuals() {
        for kernel in KERNELS {
            let squares: Vec<f64> = (0..40).map(|i| 10f64.powi(i - 10)).collect();
            let mut sum = kernel.sum();
            let mut expected = 0.0;
            for pair in squares.as_chunks::<2>().0 {
                let (weights, curvatures) = sum.add(pair, 0.25);
                for k in 0..2 {
                    let (rho, w) = kernel.rho_and_weight(pair[k]);
                    expected += rho;
                    assert!((weights[k] - w).abs() < 1e-12 * w);
                    let curvature = kernel.influence_slope(pair[k]).max(0.25 * w);
                    assert!((curvatures[k] - curvature).abs() < 1e-12 * w);
                }
            }
            assert!((sum.total() / expected - 1.0).abs() < 1e-12, "{kernel:?}");
        }
    }

    #[test]
    fn default_tunings_are_95_percent_efficient() {
        for kernel in [
            Kernel::Huber { k: HUBER_95 },
            Kernel::Cauchy { c: CAUCHY_95 },
        ] {
            let efficiency = 1.0 / kernel.gaussian_variance_factor();
            assert!((efficiency - 0.95).abs() < 2e-3, "{kernel:?}: {efficiency}");
        }
        assert_eq!(Kernel::None.gaussian_variance_factor(), 1.0);
    }

    #[test]
    fn pull_of_a_gross_outlier_fades_only_with_cauchy() {
        let pull = |kernel: Kernel, r: f64| kernel.rho_and_weight(r * r).1 * r;
        assert!(pull(Kernel::None, 1000.0) > 999.0);
        assert!((pull(Kernel::Huber { k: 2.0 }, 1000.0) - 2.0).abs() < 1e-12);
        assert!(pull(Kernel::Cauchy { c: 2.0 }, 1000.0) < 0.005);
    }
}
