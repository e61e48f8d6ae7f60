//! Settings of the navigator.

use super::elimination::KNOT;
use super::noise::NoiseModel;

/// Which way to spend the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Plan {
    /// About as long as flying there horizontally and then going down: the time saved by gliding is
    /// spent near the ground, where a range tells most.
    #[default]
    Careful,
    /// A sixth shorter than that.
    Fast,
}

/// Settings; the default needs to know nothing about the sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapOptions {
    /// Speed of the vehicle, m/s.
    pub speed_m_s: f64,
    /// Which way to spend the flight.
    pub plan: Plan,
    /// Noise to begin with.
    pub noise: NoiseModel,
    /// Whether the noise is adapted to what the flight shows.
    pub adapt_noise: bool,
    /// How far the first guess may be off horizontally, each axis, metres.
    pub guess_sigma_horizontal_m: f64,
    /// The same vertically.
    pub guess_sigma_vertical_m: f64,
    /// Range bias to expect, metres.
    pub bias_prior_m: f64,
    /// How far the bias may be from that, metres.
    pub bias_sigma_m: f64,
    /// Velocity error of dead reckoning at hand-over, each axis, m/s.
    pub initial_velocity_sigma: f64,
    /// Accelerometer error at hand-over, each axis, m/s^2.
    pub initial_acceleration_sigma: f64,
    /// Whether the tag is known to lie below the flight, as one to land on does. It settles most
    /// mirror images.
    pub tag_below_flight: bool,
    /// How long after the hand-over explanations are not yet ripe for the sum of Gaussians of the last metres, seconds: a first
    /// guess that is known to a metre or two needs less.
    pub mixture_after_s: f64,
    /// Distance of knots in time, seconds.
    pub knot_interval_s: f64,
    /// Most knots kept; older ones become a prior.
    pub most_knots: usize,
}

impl Default for MapOptions {
    fn default() -> Self {
        Self {
            speed_m_s: 1.0,
            plan: Plan::default(),
            noise: NoiseModel::data_sheet(),
            adapt_noise: true,
            guess_sigma_horizontal_m: 15.0,
            guess_sigma_vertical_m: 15.0,
            bias_prior_m: 0.0,
            bias_sigma_m: 0.15,
            initial_velocity_sigma: 0.01,
            initial_acceleration_sigma: 1e-3,
            tag_below_flight: true,
            mixture_after_s: 20.0,
            knot_interval_s: 0.5,
            most_knots: 160,
        }
    }
}

impl MapOptions {
    /// Standard deviations of the error of dead reckoning at hand-over, in the order of a knot. The
    /// navigation frame is where dead reckoning says it is at that moment, so position has none.
    pub(super) fn initial_ins_sigma(&self) -> [f64; KNOT] {
        const POSITION_M: f64 = 1e-3;
        let (v, a) = (self.initial_velocity_sigma, self.initial_acceleration_sigma);
        [POSITION_M, POSITION_M, POSITION_M, v, v, a, a]
    }
}
