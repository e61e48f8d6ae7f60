//! The bias of ranges with receive power.

use super::CalibrationError;

/// How much too long ranges are, by receive power: the DW1000's leading-edge detection comes later
/// the weaker the signal (APS011). Between the points linear, beyond them as at the last.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeBias {
    /// Power in dBm and bias in metres, by rising power.
    points: Vec<[f64; 2]>,
}

impl RangeBias {
    /// From pairs of power in dBm and bias in metres, in any order.
    ///
    /// # Errors
    /// [`CalibrationError::BadOption`]: no point, two of the same power, or a number that is not finite.
    pub fn new(mut points: Vec<[f64; 2]>) -> Result<Self, CalibrationError> {
        let bad = CalibrationError::BadOption {
            name: "the table of range bias",
        };
        points.sort_by(|[a, _], [b, _]| a.total_cmp(b));
        let finite = points.iter().flatten().all(|value| value.is_finite());
        let rising = points.windows(2).all(|pair| match pair {
            [[a, _], [b, _]] => a < b,
            _ => true,
        });
        if points.is_empty() || !finite || !rising {
            return Err(bad);
        }
        Ok(Self { points })
    }

    /// How much too long a range at this receive power is, in metres.
    pub fn at_m(&self, rx_power_dbm: f64) -> f64 {
        let above = self
            .points
            .partition_point(|[power, _]| *power < rx_power_dbm);
        let point = |index: usize| self.points.get(index);
        match (above.checked_sub(1).and_then(point), point(above)) {
            (Some([low, bias_low]), Some([high, bias_high])) => {
                let part = (rx_power_dbm - low) / (high - low);
                bias_low + part * (bias_high - bias_low)
            }
            (Some([_, bias]), None) | (None, Some([_, bias])) => *bias,
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_points_it_is_linear_and_beyond_them_constant() {
        let table = RangeBias::new(vec![[-70.0, -0.05], [-90.0, 0.10], [-80.0, 0.0]]).unwrap();
        for (power, bias) in [
            (-120.0, 0.10),
            (-90.0, 0.10),
            (-85.0, 0.05),
            (-80.0, 0.0),
            (-74.0, -0.03),
            (-70.0, -0.05),
            (0.0, -0.05),
        ] {
            assert!((table.at_m(power) - bias).abs() < 1e-12, "{power}");
        }
    }

    #[test]
    fn a_table_that_cannot_be_read_is_refused() {
        for points in [
            vec![],
            vec![[-80.0, f64::NAN]],
            vec![[f64::INFINITY, 0.0]],
            vec![[-80.0, 0.0], [-80.0, 0.1]],
        ] {
            assert!(RangeBias::new(points).is_err());
        }
    }
}
