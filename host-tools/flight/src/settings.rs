//! All that can be set about a flight, with named presets.

use crate::error::FlightError;
use nova_solver::ins::GRAVITY_M_S2;
use nova_solver::ins_error::InsNoise;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// A named set of [`Settings`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Preset {
    /// Like the paper: quiet sensors, no wind.
    P,
    /// Realistic: noisier ranges with a bias, noisier barometer, accelerometer random walk.
    R,
}

impl FromStr for Preset {
    type Err = FlightError;

    fn from_str(word: &str) -> Result<Self, FlightError> {
        match word {
            "P" | "p" => Ok(Self::P),
            "R" | "r" => Ok(Self::R),
            _ => Err(FlightError::UnknownWord {
                kind: "preset",
                word: word.to_owned(),
                known: "P, R".to_owned(),
            }),
        }
    }
}

/// Who holds the vehicle on its commanded legs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pilot {
    /// The vehicle truly flies the commanded legs, as if an autopilot with a perfect position did;
    /// dead reckoning only measures.
    Follow,
    /// It flies on dead reckoning, less the error of it that the navigator reports.
    SelfNav,
}

/// How far the first guess of the tag is off: `(r cos θ, r sin θ, z)` with uniform `θ`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FirstGuessQuality {
    /// `r ~ N(5, 2^2)`, `z ~ N(0, 5^2)` metres.
    Normal,
    /// `r ~ N(10, 5^2)`, `z ~ N(0, 10^2)` metres.
    High,
    /// `r ~ N(20, 5^2)`, `z ~ N(0, 20^2)` metres.
    VeryHigh,
}

impl FirstGuessQuality {
    /// Mean and standard deviation of `r` and standard deviation of `z`, metres.
    pub fn spread_m(self) -> (f64, f64, f64) {
        match self {
            Self::Normal => (5.0, 2.0, 5.0),
            Self::High => (10.0, 5.0, 10.0),
            Self::VeryHigh => (20.0, 5.0, 20.0),
        }
    }
}

/// Which term of the planner's cost (paper Eq. 8) lambda multiplies; the other has `1 - lambda`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LambdaWeighs {
    /// The travelled distance, as Eq. 8 is printed.
    Travel,
    /// The dilution of precision, as the text about Fig. 14 reads.
    Dop,
}

/// How the MAP navigator approaches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Plan {
    /// About as long as flying there level and then down; what gliding saves is spent near the ground.
    Careful,
    /// A sixth shorter than that.
    Fast,
}

/// All that can be set about a flight. Flat, so that each setting is one key; the defaults are
/// preset [`Preset::P`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Who holds the vehicle on its legs.
    pub pilot: Pilot,
    /// Horizontal distance between tag and start, metres.
    pub distance_m: f64,
    /// Height of the start above the tag, metres.
    pub altitude_m: f64,
    /// Cruise speed, m/s.
    pub speed_m_s: f64,
    /// How fast the velocity can be changed, m/s^2.
    pub acceleration_m_s2: f64,
    /// When a flight that has not landed is ended, seconds.
    pub time_limit_s: f64,
    /// How far the first guess of the tag is off.
    pub first_guess: FirstGuessQuality,

    /// Standard deviation of the wind's velocity, east and north each, m/s.
    pub wind_xy: f64,
    /// The same, vertical, m/s.
    pub wind_z: f64,
    /// How long the wind stays the same, seconds.
    pub wind_hold_s: f64,
    /// Whether the accelerometer feels what the wind does. If not, horizontal displacement by wind
    /// is missing in dead reckoning; the barometer shows height in any case.
    pub wind_seen: bool,

    /// Accelerometer white noise, g/sqrt(Hz).
    pub imu_noise_density: f64,
    /// Accelerometer bias instability, g.
    pub imu_bias_instability: f64,
    /// Accelerometer random walk, m/s^2/sqrt(s).
    pub rw: f64,
    /// Factor on the three noises of the accelerometer.
    pub imu_scale: f64,
    /// Readings of the accelerometer a second; also the simulation's ticks a second.
    pub imu_rate_hz: f64,
    /// Error of the reckoned velocity at hand-over, each horizontal axis, m/s.
    pub initial_velocity_sigma: f64,
    /// Constant error of the accelerometer, each horizontal axis, m/s^2.
    pub initial_bias_sigma: f64,
    /// Constant error of the attitude about each axis, radians.
    pub attitude_sigma_rad: f64,

    /// White noise of the barometer, metres.
    pub baro_sigma_m: f64,
    /// Random walk of the barometer, m/sqrt(s).
    pub baro_drift: f64,
    /// Readings of the barometer a second.
    pub baro_rate_hz: f64,

    /// Ranges a second.
    pub uwb_rate_hz: f64,
    /// Part of the range noise that does not depend on the signal, metres.
    pub uwb_floor_m: f64,
    /// Part of the range noise that does, at 30 m with the powers of preset P, metres.
    pub uwb_reference_m: f64,
    /// Constant error of ranges, metres.
    pub uwb_bias_m: f64,
    /// Transmit power, dBm.
    pub tx_power_dbm: f64,
    /// Noise floor, dBm.
    pub uwb_noise_floor_dbm: f64,
    /// Receive power over noise floor at which one range in ten is lost, dB.
    pub uwb_required_snr_db: f64,
    /// Whether the antennas radiate nothing straight up and down, as vertical dipoles.
    pub antenna_null: bool,
    /// Probability that a range is late because its direct path is blocked.
    pub nlos_probability: f64,
    /// Mean lateness of such ranges (exponential), metres.
    pub nlos_mean_m: f64,

    /// Weight in the planner's cost of the paper's method (Eq. 8).
    pub lambda: f64,
    /// What that weight belongs to.
    pub lambda_weighs: LambdaWeighs,
    /// How the MAP navigator approaches.
    pub plan: Plan,
}

impl Default for Settings {
    fn default() -> Self {
        Self::preset(Preset::P)
    }
}

impl Settings {
    /// The settings of this name.
    pub fn preset(preset: Preset) -> Self {
        let paper = Self {
            pilot: Pilot::SelfNav,
            distance_m: 20.0,
            altitude_m: 30.0,
            speed_m_s: 1.0,
            acceleration_m_s2: 2.0,
            time_limit_s: 300.0,
            first_guess: FirstGuessQuality::Normal,
            wind_xy: 0.0,
            wind_z: 0.0,
            wind_hold_s: 0.1,
            wind_seen: false,
            imu_noise_density: 500e-6,
            imu_bias_instability: 3000e-6,
            rw: 0.0,
            imu_scale: 1.0,
            imu_rate_hz: 100.0,
            initial_velocity_sigma: 0.0,
            initial_bias_sigma: 0.0,
            attitude_sigma_rad: 0.0,
            baro_sigma_m: 0.03,
            baro_drift: 0.003,
            baro_rate_hz: 10.0,
            uwb_rate_hz: 10.0,
            uwb_floor_m: 0.02,
            uwb_reference_m: 0.02,
            uwb_bias_m: 0.0,
            tx_power_dbm: -14.0,
            uwb_noise_floor_dbm: -114.0,
            uwb_required_snr_db: 8.0,
            antenna_null: false,
            nlos_probability: 0.0,
            nlos_mean_m: 1.0,
            lambda: 0.7,
            lambda_weighs: LambdaWeighs::Travel,
            plan: Plan::Careful,
        };
        match preset {
            Preset::P => paper,
            Preset::R => Self {
                rw: 5e-4,
                baro_sigma_m: 0.1,
                baro_drift: 0.01,
                uwb_floor_m: 0.05,
                uwb_reference_m: 0.10,
                uwb_bias_m: 0.1,
                ..paper
            },
        }
    }

    /// Length of the ideal path, horizontal and then vertical, metres.
    pub fn ideal_path_m(&self) -> f64 {
        self.distance_m + self.altitude_m
    }

    /// Seconds between readings of the accelerometer.
    pub fn tick_s(&self) -> f64 {
        1.0 / self.imu_rate_hz
    }

    /// Noise of the dead reckoning in the terms of [`InsNoise`], as it truly is. For bounds and
    /// tests; a navigator is not told.
    ///
    /// Seen over times long against a reading, the bias instability is white noise as well: its
    /// filter `y' = y/2 + w` has the gain `1/(1 - 1/2) = 2` there. Unseen wind held for `T` moves
    /// the vehicle by independent `N(0, (sigma T)^2)`, a random walk of `sigma sqrt(T)`.
    pub fn ins_noise(&self) -> InsNoise {
        let white = self.imu_noise_density * GRAVITY_M_S2;
        let slow = 2.0 * self.imu_bias_instability * GRAVITY_M_S2 * self.tick_s().sqrt();
        let unseen = if self.wind_seen { 0.0 } else { self.wind_xy };
        InsNoise {
            velocity_random_walk: self.imu_scale * white.hypot(slow),
            acceleration_random_walk: self.imu_scale * self.rw,
            position_random_walk: unseen * self.wind_hold_s.sqrt(),
            height_random_walk: self.baro_drift,
            height_sigma_m: self.baro_sigma_m,
        }
    }

    /// Checks that every value means something.
    ///
    /// # Errors
    /// [`FlightError::Setting`] names the first that does not.
    pub fn validate(&self) -> Result<(), FlightError> {
        for (name, value) in [
            ("speed_m_s", self.speed_m_s),
            ("acceleration_m_s2", self.acceleration_m_s2),
            ("wind_hold_s", self.wind_hold_s),
        ] {
            check(name, value, (1e-3..=1e3).contains(&value), "0.001 to 1000")?;
        }
        for (name, value) in [
            ("distance_m", self.distance_m),
            ("wind_xy", self.wind_xy),
            ("wind_z", self.wind_z),
            ("imu_noise_density", self.imu_noise_density),
            ("imu_bias_instability", self.imu_bias_instability),
            ("rw", self.rw),
            ("imu_scale", self.imu_scale),
            ("initial_velocity_sigma", self.initial_velocity_sigma),
            ("initial_bias_sigma", self.initial_bias_sigma),
            ("attitude_sigma_rad", self.attitude_sigma_rad),
            ("baro_sigma_m", self.baro_sigma_m),
            ("baro_drift", self.baro_drift),
            ("uwb_floor_m", self.uwb_floor_m),
            ("uwb_reference_m", self.uwb_reference_m),
            ("nlos_mean_m", self.nlos_mean_m),
        ] {
            check(name, value, (0.0..=1e3).contains(&value), "0 to 1000")?;
        }
        let altitude_m = self.altitude_m;
        let fits = (0.1..=1e3).contains(&altitude_m);
        check("altitude_m", altitude_m, fits, "0.1 to 1000")?;
        let limit_s = self.time_limit_s;
        let fits = (1.0..=1e4).contains(&limit_s);
        check("time_limit_s", limit_s, fits, "1 to 10000")?;
        let rate_hz = self.imu_rate_hz;
        let fits = (1.0..=1e4).contains(&rate_hz);
        check("imu_rate_hz", rate_hz, fits, "1 to 10000")?;
        for (name, value) in [
            ("baro_rate_hz", self.baro_rate_hz),
            ("uwb_rate_hz", self.uwb_rate_hz),
        ] {
            let fits = (0.1..=rate_hz).contains(&value);
            check(name, value, fits, "0.1 to imu_rate_hz")?;
        }
        for (name, value) in [
            ("uwb_bias_m", self.uwb_bias_m),
            ("tx_power_dbm", self.tx_power_dbm),
            ("uwb_noise_floor_dbm", self.uwb_noise_floor_dbm),
            ("uwb_required_snr_db", self.uwb_required_snr_db),
        ] {
            check(name, value, value.abs() <= 1e3, "-1000 to 1000")?;
        }
        for (name, value) in [
            ("nlos_probability", self.nlos_probability),
            ("lambda", self.lambda),
        ] {
            check(name, value, (0.0..=1.0).contains(&value), "0 to 1")?;
        }
        Ok(())
    }
}

fn check(
    name: &'static str,
    value: f64,
    fits: bool,
    wanted: &'static str,
) -> Result<(), FlightError> {
    if fits {
        Ok(())
    } else {
        Err(FlightError::Setting {
            name,
            value,
            wanted,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_survive_writing_and_reading() {
        for preset in [Preset::P, Preset::R] {
            let settings = Settings::preset(preset);
            settings.validate().unwrap();
            let text = toml::to_string(&settings).unwrap();
            assert_eq!(toml::from_str::<Settings>(&text).unwrap(), settings);
        }
    }

    #[test]
    fn words_are_those_of_the_command_line() {
        let text =
            "pilot = 'self-nav'\nfirst_guess = 'very-high'\nplan = 'fast'\nlambda_weighs = 'dop'";
        let settings: Settings = toml::from_str(text).unwrap();
        assert_eq!(settings.first_guess, FirstGuessQuality::VeryHigh);
        assert_eq!(
            (settings.pilot, settings.plan),
            (Pilot::SelfNav, Plan::Fast)
        );
        assert_eq!(settings.lambda_weighs, LambdaWeighs::Dop);
        assert!("p".parse() == Ok(Preset::P) && "x".parse::<Preset>().is_err());
    }

    #[test]
    fn unknown_keys_are_refused() {
        assert!(toml::from_str::<Settings>("wind_yx = 0.3").is_err());
    }

    #[test]
    fn meaningless_values_are_refused_by_name() {
        let base = Settings::default();
        for (name, settings) in [
            (
                "wind_xy",
                Settings {
                    wind_xy: -0.1,
                    ..base.clone()
                },
            ),
            (
                "imu_rate_hz",
                Settings {
                    imu_rate_hz: f64::NAN,
                    ..base.clone()
                },
            ),
            (
                "uwb_rate_hz",
                Settings {
                    uwb_rate_hz: 101.0,
                    ..base.clone()
                },
            ),
            (
                "nlos_probability",
                Settings {
                    nlos_probability: 1.5,
                    ..base.clone()
                },
            ),
            (
                "altitude_m",
                Settings {
                    altitude_m: 0.0,
                    ..base.clone()
                },
            ),
            (
                "uwb_bias_m",
                Settings {
                    uwb_bias_m: f64::INFINITY,
                    ..base.clone()
                },
            ),
            (
                "time_limit_s",
                Settings {
                    time_limit_s: 1e9,
                    ..base
                },
            ),
        ] {
            let Err(FlightError::Setting { name: found, .. }) = settings.validate() else {
                panic!("{name} was taken");
            };
            assert_eq!(found, name);
        }
    }
}
