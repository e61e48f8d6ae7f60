//! Topics of a recording and their schemas.

use serde_json::{Value, json};

/// A topic.
pub(super) struct Topic {
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    /// Name, shape and meaning of each field; all are there in each message.
    fields: &'static [(&'static str, Shape, &'static str)],
}

#[derive(Clone, Copy)]
enum Shape {
    Text,
    Number,
    /// So many numbers.
    Numbers(usize),
    /// So many rows of as many numbers.
    Square(usize),
}

use Shape::{Number, Numbers, Square, Text};

const T: (&str, Shape, &str) = ("t_s", Number, "time, seconds since take-off");
const TAKEN: (&str, Shape, &str) = (
    "taken_s",
    Number,
    "when it was taken as the filter is told, seconds",
);
const TURN: (&str, Shape, &str) = ("attitude_wxyz", Numbers(4), "w, x, y, z; body to frame");
const BIAS: (&str, Shape, &str) = (
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
                Square(3),
                "rows of its covariance, square metres",
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

impl Topic {
    /// Its JSON Schema.
    pub(super) fn schema(&self) -> Value {
        let fields: serde_json::Map<String, Value> = (self.fields.iter())
            .map(|(name, shape, meaning)| {
                let mut field = shape.schema();
                if let Some(field) = field.as_object_mut() {
                    field.insert("description".to_owned(), json!(meaning));
                }
                ((*name).to_owned(), field)
            })
            .collect();
        let names: Vec<&str> = self.fields.iter().map(|(name, ..)| *name).collect();
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.title,
            "type": "object",
            "properties": fields,
            "required": names,
            "additionalProperties": false,
        })
    }
}

impl Shape {
    fn schema(self) -> Value {
        let list = |of: Value, length: usize| json!({ "type": "array", "items": of, "minItems": length, "maxItems": length });
        match self {
            Text => json!({ "type": "string" }),
            Number => json!({ "type": "number" }),
            Numbers(length) => list(Number.schema(), length),
            Square(length) => list(Numbers(length).schema(), length),
        }
    }
}
