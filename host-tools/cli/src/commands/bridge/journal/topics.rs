//! Topics of a bridge.

use crate::recording::schema::Shape::{Bytes, Flag, Maybe, Number, Numbers, Object, Text, Texts};
use crate::recording::schema::{Field, Topic};

const AT: Field = (
    "at_s",
    Number,
    "when it came or went out, seconds since 1970",
);
const T: Field = ("t_s", Number, "when it was taken, seconds since 1970");
const NODE: Field = ("node", Text, "the node that it is about");
const NAME: Field = ("name", Text, "MAVLink message");
const FRAME: Field = ("frame", Bytes, "the message as a MAVLink 2 frame");
const POSITION: Field = (
    "position_m",
    Numbers(3),
    "ENU from the autopilot's origin, metres",
);

const NAVIGATOR: &[Field] = &[
    (
        "first_guess",
        Maybe(&Numbers(3)),
        "where the tag is said to be, ENU metres",
    ),
    (
        "guess_sigma",
        Maybe(&Number),
        "how far that may be off, metres",
    ),
    (
        "range_bias",
        Number,
        "constant error of ranges to expect, metres",
    ),
    (
        "range_bias_sigma",
        Number,
        "how far it may be from that, metres",
    ),
    ("speed", Number, "of the vehicle, m/s"),
    (
        "arrival_radius",
        Number,
        "a waypoint this near has been reached, metres",
    ),
];

const ESTIMATED: &[Field] = &[
    T,
    ("tag_m", Numbers(3), "the tag, ENU metres"),
    ("vehicle_m", Numbers(3), "the vehicle, ENU metres"),
    (
        "covariance_m2",
        Maybe(&Numbers(9)),
        "of the tag relative to the vehicle row by row, square metres",
    ),
    (
        "sigma_m",
        Maybe(&Numbers(3)),
        "of the tag relative to the vehicle, metres",
    ),
    (
        "alternative_m",
        Maybe(&Numbers(3)),
        "another place that explains the ranges, metres",
    ),
    (
        "range_bias_m",
        Maybe(&Number),
        "constant error of the ranges, metres",
    ),
    ("range_sigma_m", Maybe(&Number), "of a single range, metres"),
    ("doubts", Texts, "why it should not be leant on"),
];

const INS_ERROR: &[Field] = &[
    T,
    (
        "position_m",
        Numbers(3),
        "how far the autopilot's reckoning is off, metres",
    ),
    ("velocity_m_s", Numbers(3), "and how that grows, m/s"),
];

const COMMAND: &[Field] = &[
    ("id", Number, "number of the command"),
    ("action", Text, "hold, fly or land"),
    ("waypoint_m", Numbers(3), "where to, ENU metres"),
    (
        "ins_error",
        Object(INS_ERROR),
        "error of the autopilot's reckoning",
    ),
];

/// All topics.
pub(super) const TOPICS: [Topic; 11] = [
    Topic {
        name: super::BEGIN,
        title: "nova.Orders",
        fields: &[
            AT,
            ("peer", Maybe(&Text), "only this node"),
            ("frame", Maybe(&Text), "the frame of LANDING_TARGET"),
            (
                "most_sigma_m",
                Number,
                "horizontal sigma above which no landing place is told, metres",
            ),
            ("fly", Flag, "whether position targets are sent"),
            (
                "rate_hz",
                Number,
                "how often the autopilot is asked to tell its place, Hz",
            ),
            (
                "navigator",
                Object(NAVIGATOR),
                "how the navigator is set up",
            ),
        ],
    },
    Topic {
        name: super::RANGE,
        title: "nova.Range",
        fields: &[AT, T, NODE, ("range_m", Number, "metres")],
    },
    Topic {
        name: super::MAVLINK_IN,
        title: "nova.MavlinkIn",
        fields: &[AT, NAME, FRAME],
    },
    Topic {
        name: super::MAVLINK_OUT,
        title: "nova.MavlinkOut",
        fields: &[AT, NAME, FRAME, ("sent", Flag, "whether it went out")],
    },
    Topic {
        name: super::TIME,
        title: "nova.Time",
        fields: &[AT],
    },
    Topic {
        name: super::ESTIMATE,
        title: "nova.Navigator",
        fields: &[
            T,
            NODE,
            ("phase", Text, "of the navigator"),
            (
                "estimate",
                Maybe(&Object(ESTIMATED)),
                "what the navigator believes",
            ),
            ("command", Object(COMMAND), "what it wants flown"),
        ],
    },
    Topic {
        name: "/position",
        title: "nova.Position",
        fields: &[T, POSITION, ("velocity_m_s", Numbers(3), "ENU, m/s")],
    },
    Topic {
        name: "/attitude",
        title: "nova.Attitude",
        fields: &[
            T,
            ("roll_rad", Number, "about forward, radians"),
            ("pitch_rad", Number, "about right, radians"),
            ("yaw_rad", Number, "about down, from north, radians"),
        ],
    },
    Topic {
        name: "/imu",
        title: "nova.Imu",
        fields: &[
            T,
            (
                "force_m_s2",
                Numbers(3),
                "specific force along forward, right, down, m/s^2",
            ),
            ("rate_rad_s", Numbers(3), "turning rate about them, rad/s"),
        ],
    },
    Topic {
        name: "/barometer",
        title: "nova.Barometer",
        fields: &[T, ("pressure_pa", Number, "pascals")],
    },
    Topic {
        name: "/gps",
        title: "nova.Gps",
        fields: &[
            T,
            ("lat_deg", Number, "degrees north"),
            ("lon_deg", Number, "degrees east"),
            ("height_m", Number, "above the geoid, metres"),
            (
                "sigma_m",
                Maybe(&Number),
                "horizontal, as the receiver says, metres",
            ),
        ],
    },
];
