//! What can be set of the filter.

use core::fmt;
use core::ops::RangeInclusive;

/// Settings of a [`RangeFilter`](super::RangeFilter).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FilterSettings {
    /// Standard deviation of a raw range along the line of sight, in metres.
    pub sigma_m: f32,
    /// Standard deviation of one likely not along the line of sight, in metres.
    pub nlos_sigma_m: f32,
    /// How restless the range is: spectral density of its acceleration, in
    /// m^2/s^3. At 1, the rate wanders by 1 m/s in a second.
    pub agility_m2_per_s3: f32,
    /// From here on a raw range pulls no harder, in standard deviations of what
    /// is expected.
    pub soft_gate_sigmas: f32,
    /// From here on it is left out.
    pub hard_gate_sigmas: f32,
    /// So many ranges left out in a row that agree with each other are believed.
    pub reacquire_after: u8,
    /// No peer moves faster, in m/s.
    pub max_speed_m_per_s: f32,
    /// After so long without a range the filter starts anew, in seconds.
    pub silence_s: f32,
}

/// A setting that cannot work.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettingsError {
    /// Which, by its name among the fields of [`FilterSettings`].
    pub name: &'static str,
    /// What it was set to.
    pub value: f32,
    /// The least that works.
    pub least: f32,
    /// The most that works.
    pub most: f32,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            value,
            least,
            most,
        } = self;
        write!(f, "{name} = {value} is not between {least} and {most}")
    }
}

impl core::error::Error for SettingsError {}

impl FilterSettings {
    /// For ranges of 6.8 Mbit/s between people, vehicles and small drones.
    pub const DEFAULT: Self = Self {
        sigma_m: 0.05,
        nlos_sigma_m: 0.3,
        agility_m2_per_s3: 1.0,
        soft_gate_sigmas: 3.0,
        hard_gate_sigmas: 6.0,
        reacquire_after: 5,
        max_speed_m_per_s: 15.0,
        silence_s: 5.0,
    };

    /// Raw ranges that can be, in metres: a little below zero by noise and
    /// antenna delay, and no farther than any mode of the radio reaches.
    pub const POSSIBLE_M: RangeInclusive<f32> = -1.0..=2_000.0;

    /// Whether the filter can work with these.
    ///
    /// # Errors
    /// The first that cannot be.
    pub fn check(&self) -> Result<(), SettingsError> {
        let within = |name, value: f32, least, most| {
            if (least..=most).contains(&value) {
                Ok(())
            } else {
                Err(SettingsError {
                    name,
                    value,
                    least,
                    most,
                })
            }
        };
        within("sigma_m", self.sigma_m, 0.001, 10.0)?;
        within("nlos_sigma_m", self.nlos_sigma_m, self.sigma_m, 100.0)?;
        within("agility_m2_per_s3", self.agility_m2_per_s3, 1e-4, 1e4)?;
        within("soft_gate_sigmas", self.soft_gate_sigmas, 1.0, 100.0)?;
        let soft = self.soft_gate_sigmas;
        within("hard_gate_sigmas", self.hard_gate_sigmas, soft, 1_000.0)?;
        within("reacquire_after", self.reacquire_after.into(), 2.0, 100.0)?;
        within("max_speed_m_per_s", self.max_speed_m_per_s, 0.1, 1_000.0)?;
        within("silence_s", self.silence_s, 0.05, 60.0)
    }

    /// The silence in microseconds; a conversion saturates.
    pub(super) fn silence_us(&self) -> u64 {
        (self.silence_s * 1e6) as u64
    }
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}
