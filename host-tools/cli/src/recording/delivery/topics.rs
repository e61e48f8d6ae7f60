//! Topics of a delivery.

use crate::recording::schema::Shape::{Number, Numbers, Text};
use crate::recording::schema::{Field, Topic};

const T: Field = ("t_s", Number, "time, seconds since take-off");
const TAKEN: Field = (
    "taken_s",
    Number,
    "when it was taken as the filter is told, seconds",
);
const TURN: Field = ("attitude_wxyz", Numbers(4), "w, x, y, z; body to frame");
const BIAS: Field = (
    "gps_bias_m",
    Numbers(3),
    "estimated offset of the autopilot's place, metres",
);

/// All topics.
pub(super) const TOPICS: [Topic; 7] = [
    Topic {
        name: "/begin",
        title: "nova.Begin",
        fields: &[
            ("filter", Text, "paper or error-state"),
            (
                "position_m",
                Numbers(3),
                "the autopilot's first place, metres",
            ),
            TURN,
            (
                "first_bias_sigma_m",
                Number,
                "first sigma of the GPS bias, metres",
            ),
        ],
    },
    Topic {
        name: "/input",
        title: "nova.Input",
        fields: &[
            T,
            (
                "velocity_m_s",
                Numbers(3),
                "in the frame of the delivery, m/s",
            ),
            (
                "rate_rad_s",
                Numbers(3),
                "turning rate along the body's axes, rad/s",
            ),
        ],
    },
    Topic {
        name: "/autopilot",
        title: "nova.Autopilot",
        fields: &[T, TAKEN, ("position_m", Numbers(3), "metres"), TURN],
    },
    Topic {
        name: "/marker",
        title: "nova.Marker",
        fields: &[
            T,
            TAKEN,
            ("position_m", Numbers(3), "in the camera's frame, metres"),
            ("attitude_wxyz", Numbers(4), "w, x, y, z; marker to camera"),
            (
                "sigma_m",
                Numbers(2),
                "across the view and along it, metres",
            ),
            ("sigma_rad", Numbers(3), "about the marker's axes, radians"),
        ],
    },
    Topic {
        name: "/uwb",
        title: "nova.Uwb",
        fields: &[
            T,
            TAKEN,
            ("position_m", Numbers(3), "metres"),
            (
                "covariance_m2",
                Numbers(9),
                "its covariance row by row, square metres",
            ),
        ],
    },
    Topic {
        name: "/estimate",
        title: "nova.Estimate",
        fields: &[
            T,
            ("position_m", Numbers(3), "metres"),
            TURN,
            BIAS,
            (
                "sigma_m",
                Numbers(3),
                "standard deviations of the position, metres",
            ),
        ],
    },
    Topic {
        name: "/flight",
        title: "nova.Flight",
        fields: &[
            T,
            (
                "true_m",
                Numbers(3),
                "where the vehicle is, metres; no filter sees it",
            ),
            (
                "estimate_m",
                Numbers(3),
                "where the filter believes it, metres",
            ),
            (
                "lyapunov_m2",
                Number,
                "Lyapunov function at the estimate, square metres",
            ),
            BIAS,
        ],
    },
];
