//! What a delivery can be told.

use super::recording::RecordFault;
use nalgebra::Vector3;
use nova_solver::delivery::{DeliveryPath, FieldOptions, MissionOptions, PathFault, VectorField};
use serde::{Deserialize, Serialize};

/// Which filter lands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterKind {
    /// The paper's EKF, which takes late measurements for new.
    Paper,
    /// The error-state filter, with late measurements put where they belong.
    ErrorState,
}

/// How UWB tells the place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UwbBy {
    /// Ranges to four anchors around the platform (the paper's).
    Ranges,
    /// Ranges to one tag on the platform: NOVA's navigator, and a descent that circles.
    SingleTag,
    /// The vehicle only listens while the four anchors range among themselves.
    Differences,
}

/// A delivery. The defaults are the paper's Sec. 5.1, its noises ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Height of the cruise, h, metres.
    pub height_m: f64,
    /// Radius of the arcs, r, metres.
    pub radius_m: f64,
    /// Distance between start and goal, d, metres.
    pub distance_m: f64,
    /// Which filter.
    pub filter: FilterKind,
    /// The large marker (0.8 m) can be seen.
    pub large_marker: bool,
    /// The small marker (0.09 m) can be seen.
    pub small_marker: bool,
    /// UWB answers.
    pub uwb: bool,
    /// What it answers with.
    pub uwb_by: UwbBy,
    /// UWB reaches so far, metres (the paper: 10 m).
    pub uwb_reach_m: f64,
    /// Land by GPS alone where nothing else is heard; without it such landings are broken off.
    pub land_by_gps: bool,
    /// Fly back after the release.
    pub return_trip: bool,
    /// GPS is lost at this time, seconds; never where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gps_lost_s: Option<f64>,
    /// Standard deviation of the GPS bias along each horizontal axis, metres; 1.5 times that in height.
    pub gps_bias_m: f64,
    /// The platform is not where it was said to be: by this, metres.
    pub platform_off_m: [f64; 2],
    /// Standard deviation of gusts as accelerations, m/s^2.
    pub gust_m_s2: f64,
    /// Mass without package, kilograms.
    pub vehicle_kg: f64,
    /// Mass of the package, kilograms.
    pub package_kg: f64,
    /// Standard deviation of ranges, metres.
    pub range_sigma_m: f64,
    /// Standard deviation of the anchors' biases, metres.
    pub anchor_bias_m: f64,
    /// How old a marker's pose is when it has been computed, seconds.
    pub marker_delay_s: f64,
    /// How far the camera is turned from how it was measured to be mounted, standard deviation about each axis, radians.
    pub mount_turn_rad: f64,
    /// How far it sits from there, standard deviation along each axis, metres.
    pub mount_off_m: f64,
    /// Weight of convergence k_f, 1/m.
    pub convergence_per_m: f64,
    /// Speeds of the five sectors, m/s.
    pub speeds_m_s: [f64; 5],
    /// Part of the battery that a minute of flight takes.
    pub battery_per_minute: f64,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            height_m: 45.0,
            radius_m: 6.0,
            distance_m: 100.03,
            filter: FilterKind::ErrorState,
            large_marker: true,
            small_marker: true,
            uwb: true,
            uwb_by: UwbBy::Ranges,
            uwb_reach_m: 10.0,
            land_by_gps: false,
            return_trip: true,
            gps_lost_s: None,
            // A mean distance of 1.2 m, as Table 2 has it.
            gps_bias_m: 0.96,
            platform_off_m: [0.0; 2],
            gust_m_s2: 0.3,
            vehicle_kg: 3.0,
            package_kg: 0.2,
            range_sigma_m: 0.05,
            anchor_bias_m: 0.03,
            marker_delay_s: 0.12,
            // A degree and a centimetre: mounted and measured by hand.
            mount_turn_rad: 0.0175,
            mount_off_m: 0.01,
            convergence_per_m: 6.0,
            speeds_m_s: [1.5, 2.0, 4.0, 1.5, 0.8],
            battery_per_minute: 0.04,
        }
    }
}

/// A scenario that cannot be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioFault {
    /// The path.
    #[error(transparent)]
    Path(#[from] PathFault),
    /// What the autopilot says first is no pose.
    #[error("the first pose: {0}")]
    FirstPose(#[from] RecordFault),
    /// A number is out of range.
    #[error("{name} is {value}; it has to be from {least} to {most}")]
    OutOfRange {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Least.
        least: f64,
        /// Most.
        most: f64,
    },
}

impl Scenario {
    /// The path, once all numbers have been checked.
    ///
    /// # Errors
    /// [`ScenarioFault`].
    pub fn path(&self) -> Result<DeliveryPath, ScenarioFault> {
        let [v1, v2, v3, v4, v5] = self.speeds_m_s;
        let [x, y] = self.platform_off_m;
        for (name, value, least, most) in [
            ("gps_bias_m", self.gps_bias_m, 0.0, 100.0),
            ("platform_off_m", x, -100.0, 100.0),
            ("platform_off_m", y, -100.0, 100.0),
            ("gust_m_s2", self.gust_m_s2, 0.0, 5.0),
            ("vehicle_kg", self.vehicle_kg, 0.1, 1000.0),
            ("package_kg", self.package_kg, 0.0, 1000.0),
            ("uwb_reach_m", self.uwb_reach_m, 0.1, 1000.0),
            ("range_sigma_m", self.range_sigma_m, 0.001, 10.0),
            ("anchor_bias_m", self.anchor_bias_m, 0.0, 10.0),
            ("marker_delay_s", self.marker_delay_s, 0.0, 0.4),
            ("mount_turn_rad", self.mount_turn_rad, 0.0, 0.3),
            ("mount_off_m", self.mount_off_m, 0.0, 1.0),
            ("convergence_per_m", self.convergence_per_m, 0.01, 100.0),
            ("battery_per_minute", self.battery_per_minute, 0.0, 1.0),
            ("gps_lost_s", self.gps_lost_s.unwrap_or(0.0), 0.0, 1e6),
            ("speeds_m_s", v1, 0.1, 30.0),
            ("speeds_m_s", v2, 0.1, 30.0),
            ("speeds_m_s", v3, 0.1, 30.0),
            ("speeds_m_s", v4, 0.1, 30.0),
            ("speeds_m_s", v5, 0.1, 30.0),
        ] {
            // NaN is in no range.
            if !(least..=most).contains(&value) {
                return Err(ScenarioFault::OutOfRange {
                    name,
                    value,
                    least,
                    most,
                });
            }
        }
        Ok(DeliveryPath::new(
            self.height_m,
            self.radius_m,
            self.distance_m,
        )?)
    }

    /// How far GPS may be off along each axis, as filters are told: more than it is on average, and never nothing, metres.
    pub fn first_bias_sigma_m(&self) -> f64 {
        1.5 * self.gps_bias_m.max(0.1)
    }

    /// The field that leads along its path.
    ///
    /// # Errors
    /// As [`Scenario::path`].
    pub fn field(&self) -> Result<VectorField, ScenarioFault> {
        let options = FieldOptions {
            convergence_per_m: self.convergence_per_m,
            speeds_m_s: self.speeds_m_s,
            ..FieldOptions::default()
        };
        Ok(VectorField::new(self.path()?, options))
    }

    /// What the mission goes by along its path.
    pub fn mission_options(&self, path: &DeliveryPath) -> MissionOptions {
        MissionOptions {
            length_m: path.along_m(&Vector3::zeros()),
            retry_height_m: (self.height_m - self.radius_m).min(15.0),
            decision_height_m: if self.land_by_gps {
                f64::NEG_INFINITY
            } else {
                3.0
            },
            most_sigma_m: 0.3,
            tries: 3,
            lost_s: 1.0,
            local_lost_s: 3.0,
            longest_search_s: 30.0,
            longest_hold_s: 15.0,
            low_battery: 0.35,
            empty_battery: 0.1,
            fence_m: 10.0,
        }
    }
}
