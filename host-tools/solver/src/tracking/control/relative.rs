//! The target as the controller sees it: distance, line of sight and speeds (eq. 29-34).

use nalgebra::Vector3;

use crate::tracking::motion::Belief;

/// Position and velocity of the vehicle that follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleState {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Metres a second.
    pub velocity_m_s: Vector3<f64>,
}

/// The target relative to the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Relative {
    /// Distance, never below a millimetre.
    pub(super) distance_m: f64,
    /// Unit vector to the target.
    pub(super) sight: Vector3<f64>,
    /// Speed at which the distance grows.
    pub(super) radial: f64,
    /// Velocity across the line of sight.
    pub(super) tangential: Vector3<f64>,
    /// Height of the vehicle over the target, and its rate.
    pub(super) above: [f64; 2],
}

impl Relative {
    pub(super) fn new(vehicle: &VehicleState, belief: &Belief) -> Self {
        let offset = belief.position_m - vehicle.position_m;
        let velocity = belief.velocity_m_s - vehicle.velocity_m_s;
        let distance_m = offset.norm().max(1e-3);
        let sight = offset.try_normalize(1e-3).unwrap_or_else(Vector3::x);
        let radial = sight.dot(&velocity);
        Self {
            distance_m,
            sight,
            radial,
            tangential: velocity - sight * radial,
            above: [-offset.z, -velocity.z],
        }
    }
}

/// Quantile of chi-square with three degrees of freedom, whose distribution is `erf(sqrt(x/2)) -
/// sqrt(2 x / pi) e^(-x/2)`.
pub fn chi_square_3(probability: f64) -> f64 {
    let below = |x: f64| {
        libm::erf((0.5 * x).sqrt()) - (2.0 * x / std::f64::consts::PI).sqrt() * (-0.5 * x).exp()
    };
    let (mut low, mut high) = (0.0, 1.0);
    while below(high) < probability && high < 1e3 {
        high *= 2.0;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if below(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// The confidence radius of eq. 29 without its quantile: the standard deviation along the longest
/// axis.
pub fn longest_sigma_m(belief: &Belief) -> f64 {
    belief.pp.symmetric_eigenvalues().max().max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (probability, quantile) in [(0.5, 2.36597), (0.95, 7.81473), (0.99, 11.34487)] {
            assert!((chi_square_3(probability) - quantile).abs() < 1e-5);
        }
    }
}
