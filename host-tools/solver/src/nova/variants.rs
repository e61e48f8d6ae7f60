//! The ablation study (paper Table IV).

/// How the tag is found during the approach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LocalisationMethod {
    /// Not at all: the first guess is believed.
    None,
    /// Plain multilateration over dead reckoning (Eq. 4).
    Multilateration,
    /// Joint optimisation of trajectory and tag (Eqs. 10-13).
    Joint,
}

/// How far to fly before the tag is looked for again, where there is no planner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stride {
    /// A fixed length, metres.
    Fixed(f64),
    /// Half the horizontal distance to the estimate.
    HalfDistance,
}

/// Which of NOVA's parts are used: one row of Table IV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Switches {
    /// Exploratory flight at the beginning.
    pub initial_flight: bool,
    /// DOP-based planner; without it, straight towards the estimate.
    pub trajectory_planning: bool,
    /// How the tag is found.
    pub localisation: LocalisationMethod,
    /// Length of legs without a planner.
    pub stride: Stride,
    /// Two-step descent; without it, straight down over the estimate.
    pub final_descent: bool,
}

/// A row of Table IV.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// First guess only, heading adjusted every metre.
    V1,
    /// Multilateration every metre.
    V2,
    /// Multilateration after half of the remaining distance ("V2'").
    V2Prime,
    /// V2' with the exploratory flight.
    V3,
    /// V3 with joint optimisation instead of multilateration.
    V4,
    /// V3 with trajectory planning.
    V5,
    /// V5 with joint optimisation instead of multilateration.
    V6,
    /// V6 with the two-step descent: NOVA.
    V7,
}

impl Variant {
    /// All of them, in order.
    pub const ALL: [Self; 8] = [
        Self::V1,
        Self::V2,
        Self::V2Prime,
        Self::V3,
        Self::V4,
        Self::V5,
        Self::V6,
        Self::V7,
    ];

    /// The row.
    pub fn switches(self) -> Switches {
        let number = self as u8;
        let from = |first: Self| number >= first as u8;
        Switches {
            initial_flight: from(Self::V3),
            trajectory_planning: from(Self::V5),
            localisation: match self {
                Self::V1 => LocalisationMethod::None,
                Self::V4 | Self::V6 | Self::V7 => LocalisationMethod::Joint,
                _ => LocalisationMethod::Multilateration,
            },
            stride: match self {
                Self::V1 | Self::V2 => Stride::Fixed(1.0),
                _ => Stride::HalfDistance,
            },
            final_descent: from(Self::V7),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_those_of_table_four() {
        use LocalisationMethod::{Joint, Multilateration, None};
        let rows = [
            (false, false, None, false),
            (false, false, Multilateration, false),
            (false, false, Multilateration, false),
            (true, false, Multilateration, false),
            (true, false, Joint, false),
            (true, true, Multilateration, false),
            (true, true, Joint, false),
            (true, true, Joint, true),
        ];
        for (variant, row) in Variant::ALL.into_iter().zip(rows) {
            let s = variant.switches();
            let found = (
                s.initial_flight,
                s.trajectory_planning,
                s.localisation,
                s.final_descent,
            );
            assert_eq!(found, row, "{variant:?}");
        }
    }
}
