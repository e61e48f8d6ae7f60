//! Messages for viewers, who know no lists of lists and nothing that is null.

use crate::commands::guide::lines::{Believed, News, Ordered};
use crate::mavlink::inbound::Reading;
use serde::Serialize;
use serde_json::{Value, json};

/// [`News`] of a navigator.
#[derive(Serialize)]
pub(super) struct Estimated<'a> {
    t_s: f64,
    node: String,
    phase: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    estimate: Option<Known<'a>>,
    command: Ordered,
}

#[derive(Serialize)]
struct Known<'a> {
    t_s: f64,
    tag_m: [f64; 3],
    vehicle_m: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance_m2: Option<[f64; 9]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_m: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alternative_m: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    range_bias_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    range_sigma_m: Option<f64>,
    doubts: &'a [&'static str],
}

impl<'a> Estimated<'a> {
    pub(super) fn of(news: &'a News<'_>) -> Self {
        Self {
            t_s: news.t_s,
            node: news.peer.to_string(),
            phase: news.phase,
            estimate: news.estimate.as_ref().map(Known::of),
            command: news.command,
        }
    }
}

impl<'a> Known<'a> {
    fn of(believed: &'a Believed) -> Self {
        let flat = |[[a, b, c], [d, e, f], [g, h, i]]: [[f64; 3]; 3]| [a, b, c, d, e, f, g, h, i];
        Self {
            t_s: believed.t_s,
            tag_m: believed.tag_m,
            vehicle_m: believed.vehicle_m,
            covariance_m2: believed.covariance_m2.map(flat),
            sigma_m: believed.sigma_m,
            alternative_m: believed.alternative_m,
            range_bias_m: believed.range_bias_m,
            range_sigma_m: believed.range_sigma_m,
            doubts: &believed.doubts,
        }
    }
}

/// A reading, and its topic.
pub(super) fn reading(t_s: f64, reading: &Reading) -> (&'static str, Value) {
    match *reading {
        Reading::Local {
            position_m,
            velocity_m_s,
        } => (
            "/position",
            json!({ "t_s": t_s, "position_m": position_m, "velocity_m_s": velocity_m_s }),
        ),
        Reading::Attitude {
            roll_rad,
            pitch_rad,
            yaw_rad,
        } => (
            "/attitude",
            json!({ "t_s": t_s, "roll_rad": roll_rad, "pitch_rad": pitch_rad, "yaw_rad": yaw_rad }),
        ),
        Reading::Imu {
            force_m_s2,
            rate_rad_s,
        } => (
            "/imu",
            json!({ "t_s": t_s, "force_m_s2": force_m_s2, "rate_rad_s": rate_rad_s }),
        ),
        Reading::Barometer { pressure_pa } => (
            "/barometer",
            json!({ "t_s": t_s, "pressure_pa": pressure_pa }),
        ),
        Reading::Gps {
            lat_deg,
            lon_deg,
            height_m,
            sigma_m,
        } => {
            let mut line =
                json!({ "t_s": t_s, "lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": height_m });
            if let (Some(line), Some(sigma_m)) = (line.as_object_mut(), sigma_m) {
                line.insert("sigma_m".to_owned(), json!(sigma_m));
            }
            ("/gps", line)
        }
    }
}
