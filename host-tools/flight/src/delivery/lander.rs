//! A filter that is told records, in a flight and in its replay alike.

use super::recording::{Begin, Estimate, Event, RecordFault, attitude, wxyz};
use super::scenario::FilterKind;
use nalgebra::{Matrix3, Vector3};
use nova_solver::delivery::{
    Delayed, ErrorStateFilter, ErrorStateOptions, EulerEkf, EulerEkfOptions, Input, LandingFilter,
    Measurement, Pose, Verdict,
};

/// How long the filter remembers, for measurements that come late, seconds.
const MEMORY_S: f64 = 0.5;

impl Begin {
    /// The filter.
    ///
    /// # Errors
    /// [`RecordFault`] where the attitude is none.
    pub fn lander(&self) -> Result<Lander, RecordFault> {
        let pose = Pose {
            position_m: self.position_m.into(),
            attitude: attitude(0.0, &self.attitude_wxyz)?,
        };
        let first_bias_sigma_m = self.first_bias_sigma_m;
        let filter = match self.filter {
            FilterKind::Paper => {
                let options = EulerEkfOptions {
                    first_bias_sigma_m,
                    ..EulerEkfOptions::default()
                };
                Filter::Paper(EulerEkf::new(&pose, 0.1, options))
            }
            FilterKind::ErrorState => {
                let options = ErrorStateOptions {
                    first_bias_sigma_m,
                    ..ErrorStateOptions::default()
                };
                Filter::ErrorState(ErrorStateFilter::new(&pose, options))
            }
        };
        Ok(Lander {
            filter: Delayed::new(filter, 0.0, MEMORY_S),
            input_s: 0.0,
        })
    }
}

/// A filter that takes records.
#[derive(Debug, Clone)]
pub struct Lander {
    filter: Delayed<Filter>,
    input_s: f64,
}

impl Lander {
    /// Feeds the filter; [`Event::Begin`], [`Event::Estimate`] and [`Event::Sample`] tell it nothing.
    ///
    /// # Errors
    /// [`RecordFault`] where the record is none that a flight makes; the filter is then as it was.
    pub fn take(&mut self, event: &Event) -> Result<Verdict, RecordFault> {
        let (taken_s, measurement) = match event {
            Event::Begin(_) | Event::Estimate(_) | Event::Sample(_) => return Ok(Verdict::Used),
            Event::Input(input) => {
                let (t_s, before_s) = (input.t_s, self.input_s);
                // What is no number is in no order.
                if !(t_s.is_finite() && t_s >= before_s) {
                    return Err(RecordFault::OutOfOrder { t_s, before_s });
                }
                self.input_s = t_s;
                let moved = Input {
                    velocity_m_s: input.velocity_m_s.into(),
                    rate_rad_s: input.rate_rad_s.into(),
                };
                return Ok(self.filter.input(t_s, moved));
            }
            Event::Autopilot(a) => {
                let measurement = Measurement::Autopilot {
                    position_m: a.position_m.into(),
                    attitude: attitude(a.t_s, &a.attitude_wxyz)?,
                };
                (a.taken_s, measurement)
            }
            Event::Marker(m) => {
                let measurement = Measurement::Marker {
                    position_m: m.position_m.into(),
                    attitude: attitude(m.t_s, &m.attitude_wxyz)?,
                    sigma_m: m.sigma_m,
                    sigma_rad: m.sigma_rad,
                };
                (m.taken_s, measurement)
            }
            Event::Uwb(u) => {
                let measurement = Measurement::Uwb {
                    position_m: u.position_m.into(),
                    covariance_m2: Matrix3::from_row_slice(&u.covariance_m2),
                };
                (u.taken_s, measurement)
            }
        };
        Ok(self.filter.measurement(taken_s, measurement))
    }

    /// The filter as of the last record.
    pub fn filter(&self) -> &impl LandingFilter {
        self.filter.filter()
    }

    /// What it says, as a record of `t_s`.
    pub fn estimate(&self, t_s: f64) -> Estimate {
        let filter = self.filter.filter();
        let (pose, covariance) = (filter.pose(), filter.position_covariance_m2());
        Estimate {
            t_s,
            position_m: pose.position_m.into(),
            attitude_wxyz: wxyz(&pose.attitude),
            gps_bias_m: filter.gps_bias_m().into(),
            sigma_m: covariance
                .diagonal()
                .map(|variance| variance.max(0.0).sqrt())
                .into(),
        }
    }
}

/// Either filter. Boxes would cost an allocation with each copy that [`Delayed`] keeps.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)]
enum Filter {
    Paper(EulerEkf),
    ErrorState(ErrorStateFilter),
}

impl Filter {
    fn either(&self) -> &dyn LandingFilter {
        match self {
            Self::Paper(filter) => filter,
            Self::ErrorState(filter) => filter,
        }
    }

    fn either_mut(&mut self) -> &mut dyn LandingFilter {
        match self {
            Self::Paper(filter) => filter,
            Self::ErrorState(filter) => filter,
        }
    }
}

impl LandingFilter for Filter {
    fn predict(&mut self, input: &Input, dt_s: f64) {
        self.either_mut().predict(input, dt_s);
    }

    fn update(&mut self, measurement: &Measurement) -> Verdict {
        self.either_mut().update(measurement)
    }

    fn pose(&self) -> Pose {
        self.either().pose()
    }

    fn position_covariance_m2(&self) -> Matrix3<f64> {
        self.either().position_covariance_m2()
    }

    fn gps_bias_m(&self) -> Vector3<f64> {
        self.either().gps_bias_m()
    }
}
