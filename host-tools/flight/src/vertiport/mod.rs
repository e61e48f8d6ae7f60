//! The experiment of Osaka and Tsujii (Sensors 2025, 25(24), 7419) in simulation: a drone flies through
//! an intersection of the Fukushima Robot Test Field where buildings spoil GNSS, past six anchors.
//!
//! ```text
//!  Route ─► path ─► Log: IMU, GNSS, ranges, receivers' tracks ─► survey      Tables 2-5
//!           truth                                             └► navigation  Tables 6-8
//!             └────────────────── errors ◄───────────────────────────┘
//! ```
//!
//! What the paper gives is used as it is: the anchors of Table 2, the three routes, GNSS errors of the
//! size of Table 6's GNSS/INS rows, receivers of the size of Table 4. What it does not give is chosen
//! here: flying height and speed ([`Route`]), how errors hang together in time, ranges' noise, bias,
//! time offset and blocked paths ([`Air`]). Not modelled: buildings as such (blocked paths come and go
//! by chance), satellites (GNSS gives positions), vibration.

mod bound;
mod log;
mod navigation;
mod path;
mod tables;

pub use log::{Air, Log, Range, Receiver};
pub use navigation::{Errors, Method, Positions, navigate, positions_of_uwb};
pub use path::{Moment, Route, path};
pub use tables::{Report, Row, run_experiment};

use nalgebra::Vector3;
use nova_solver::geodesy::{Geodetic, LocalFrame};

/// Table 2: latitude and longitude in degrees, altitude in metres.
pub const ANCHORS: [(f64, f64, f64); 6] = [
    (37.63112978, 141.01495082, 53.87),
    (37.63102664, 141.01497757, 43.89),
    (37.63090325, 141.01494878, 45.52),
    (37.63095534, 141.01479009, 43.32),
    (37.63103971, 141.01473920, 46.82),
    (37.63110109, 141.01480428, 46.99),
];

/// Height of the ground in the local frame, metres: under the lowest anchor by a tripod.
pub const GROUND_M: f64 = -1.5;

/// ENU with its origin among the anchors at the height of the lowest.
pub fn frame() -> LocalFrame {
    LocalFrame::at(Geodetic {
        lat_deg: 37.631_016_5,
        lon_deg: 141.014_858_4,
        height_m: 43.32,
    })
}

/// Table 2 in [`frame`], metres.
pub fn anchors_m() -> [Vector3<f64>; 6] {
    let frame = frame();
    ANCHORS.map(|(lat_deg, lon_deg, height_m)| {
        frame.enu_of(&Geodetic {
            lat_deg,
            lon_deg,
            height_m,
        })
    })
}

/// Whether a place lies in the UWB-anchored area: between anchors 3 and 1 in latitude and 5 and 2 in
/// longitude (the paper's Fig. 17).
pub fn in_area(place_m: &Vector3<f64>) -> bool {
    let [a1, a2, a3, _, a5, _] = anchors_m();
    (a3.y..a1.y).contains(&place_m.y) && (a5.x..a2.x).contains(&place_m.x)
}
