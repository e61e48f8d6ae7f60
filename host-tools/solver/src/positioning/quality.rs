//! How much a range is worth, by the powers that came with it.
//!
//! Where the direct path is blocked, little of what is received came along it. The DW1000 user manual
//! (sec. 4.7, and APS006 part 3) takes a first path within 6 dB of the total for line of sight, and one
//! more than 10 dB below for none.

/// Powers of one reception.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// Total, dBm.
    pub rx_dbm: f64,
    /// Along the first path, dBm.
    pub first_path_dbm: f64,
}

/// Line of sight up to this difference, dB.
const LINE_OF_SIGHT_DB: f64 = 6.0;
/// None from this difference, dB.
const BLOCKED_DB: f64 = 10.0;
/// What blocked ranges scatter more: 0.38 m beside 0.11 m in the recordings of docs/recorded-data.md.
const BLOCKED_FACTOR: f64 = 3.5;

/// What to multiply a range's standard deviation by: 1 in line of sight, more where it is doubtful. 1
/// for powers that are no numbers.
pub fn sigma_factor(power: Power) -> f64 {
    let missing_db = power.rx_dbm - power.first_path_dbm;
    let blocked = (missing_db - LINE_OF_SIGHT_DB) / (BLOCKED_DB - LINE_OF_SIGHT_DB);
    if blocked.is_nan() {
        return 1.0;
    }
    1.0 + (BLOCKED_FACTOR - 1.0) * blocked.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_first_path_widens_and_nonsense_does_not() {
        let factor = |rx_dbm, first_path_dbm| {
            sigma_factor(Power {
                rx_dbm,
                first_path_dbm,
            })
        };
        assert_eq!(factor(-80.0, -82.0), 1.0);
        assert_eq!(factor(-80.0, -95.0), BLOCKED_FACTOR);
        assert!((1.0..BLOCKED_FACTOR).contains(&factor(-80.0, -88.0)));
        assert_eq!(factor(f64::NAN, -88.0), 1.0);
    }
}
