//! Files of anchors: what `nova survey --out` writes and `nova fuse --anchors` reads.
//!
//! ```toml
//! [origin]                    # of the ENU frame; without it the frame is local and nothing more
//! lat_deg = 37.63103
//! lon_deg = 141.01487
//! height_m = 45.0
//!
//! [[anchor]]
//! node = 3
//! position_m = [2.55, 0.83, 1.97]
//! covariance_m2 = [[0.016, -0.018, 0.0], [-0.018, 0.043, 0.0], [0.0, 0.0, 0.01]]
//! range_bias_m = -0.01        # to be taken off every range
//! range_bias_sigma_m = 0.13
//! position_bias_m2 = [0.01, 0.0, 0.0]   # covariance of the coordinates with the bias
//! range_sigma_m = 0.05        # how far its ranges scattered; left out where nobody knows
//! ```

use crate::error::bad_input;
use crate::files::write_whole;
use crate::peer::Peer;
use anyhow::Result;
use nalgebra::{Matrix3, Matrix4};
use nova_solver::Localisation;
use nova_solver::fusion::FusionAnchor;
use nova_solver::geodesy::{Geodetic, LocalFrame};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Ranges whose residuals happen to vanish are not taken for better than this, metres.
const SMALLEST_SIGMA_M: f64 = 0.01;

/// A file of anchors.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnchorsFile {
    /// How far the ranges' time stamps were behind the track's, and the slope of ranges.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) common: Option<CommonEntry>,
    /// Origin of the ENU frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) origin: Option<OriginEntry>,
    /// The anchors.
    #[serde(rename = "anchor", default)]
    pub(crate) anchors: Vec<AnchorEntry>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CommonEntry {
    pub(crate) lag_s: f64,
    pub(crate) lag_sigma_s: f64,
    pub(crate) slope: f64,
    pub(crate) slope_sigma: f64,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OriginEntry {
    pub(crate) lat_deg: f64,
    pub(crate) lon_deg: f64,
    pub(crate) height_m: f64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnchorEntry {
    pub(crate) node: NodeName,
    pub(crate) position_m: [f64; 3],
    #[serde(default)]
    pub(crate) covariance_m2: [[f64; 3]; 3],
    #[serde(default)]
    pub(crate) range_bias_m: f64,
    #[serde(default)]
    pub(crate) range_bias_sigma_m: f64,
    #[serde(default)]
    pub(crate) position_bias_m2: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) range_sigma_m: Option<f64>,
}

impl AnchorEntry {
    /// An anchor as a survey found it.
    pub(crate) fn new(node: NodeName, found: &Localisation) -> Self {
        Self {
            node,
            position_m: found.position_m.into(),
            covariance_m2: found.covariance_m2.into(),
            range_bias_m: found.range_bias_m,
            range_bias_sigma_m: found.range_bias_sigma_m,
            position_bias_m2: found.position_bias_m2.into(),
            range_sigma_m: Some(found.residual_rms_m.max(SMALLEST_SIGMA_M)),
        }
    }

    /// The same for the filter; `sigma_m` is that of ranges where the file says nothing.
    pub(crate) fn for_fusion(&self, sigma_m: f64) -> FusionAnchor {
        FusionAnchor {
            position_m: self.position_m.into(),
            covariance_m2: self.covariance_m2.into(),
            bias_m: self.range_bias_m,
            bias_sigma_m: self.range_bias_sigma_m,
            position_bias_m2: self.position_bias_m2.into(),
            range_sigma_m: self.range_sigma_m.unwrap_or(sigma_m),
        }
    }

    /// Covariance of position and bias together.
    fn joint_covariance(&self) -> Matrix4<f64> {
        let mut joint = Matrix4::zeros();
        let place = Matrix3::from(self.covariance_m2);
        joint.fixed_view_mut::<3, 3>(0, 0).copy_from(&place);
        for (i, linked) in self.position_bias_m2.into_iter().enumerate() {
            joint[(i, 3)] = linked;
            joint[(3, i)] = linked;
        }
        joint[(3, 3)] = self.range_bias_sigma_m.powi(2);
        joint
    }
}

/// A number or a word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum NodeName {
    Number(i64),
    Word(String),
}

impl From<&Peer> for NodeName {
    fn from(peer: &Peer) -> Self {
        match peer {
            Peer::Number(n) => {
                i64::try_from(*n).map_or_else(|_| Self::Word(n.to_string()), Self::Number)
            }
            Peer::Name(name) => Self::Word(name.clone()),
        }
    }
}

impl NodeName {
    pub(crate) fn peer(&self) -> Peer {
        match self {
            Self::Number(n) => Peer::from(n.to_string().as_str()),
            Self::Word(word) => Peer::from(word.as_str()),
        }
    }
}

impl AnchorsFile {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let name = path.display();
        let text = std::fs::read_to_string(path)
            .map_err(|error| bad_input!("{name}: cannot be read: {error}"))?;
        let file: Self = toml::from_str(&text)
            .map_err(|error| bad_input!("{name}: {}", error.to_string().trim_end()))?;
        if file.anchors.is_empty() {
            return Err(bad_input!("{name}: there is no [[anchor]] in it"));
        }
        for (index, anchor) in file.anchors.iter().enumerate() {
            let peer = anchor.node.peer();
            let finite = (anchor.position_m.iter())
                .chain(anchor.covariance_m2.as_flattened())
                .chain([&anchor.range_bias_m, &anchor.range_bias_sigma_m])
                .chain(&anchor.position_bias_m2)
                .all(|v| v.is_finite() && v.abs() < 1e9);
            if !finite {
                return Err(bad_input!(
                    "{name}: anchor {peer}: a number is not finite or absurdly large"
                ));
            }
            let covariance = anchor.joint_covariance();
            let lopsided =
                (covariance - covariance.transpose()).amax() > 1e-6 * (1.0 + covariance.amax());
            let smallest = covariance.symmetric_eigenvalues().min();
            if lopsided || smallest < -1e-6 * (1.0 + covariance.amax()) {
                return Err(bad_input!(
                    "{name}: anchor {peer}: covariance_m2 (with range_bias_sigma_m and position_bias_m2) must be \
                     symmetric and not negative"
                ));
            }
            if anchor.range_bias_sigma_m < 0.0 {
                return Err(bad_input!(
                    "{name}: anchor {peer}: range_bias_sigma_m is negative"
                ));
            }
            if anchor.range_sigma_m.is_some_and(|s| !(s > 0.0 && s < 1e9)) {
                return Err(bad_input!(
                    "{name}: anchor {peer}: range_sigma_m must be more than 0 metres"
                ));
            }
            if file
                .anchors
                .iter()
                .take(index)
                .any(|other| other.node.peer() == peer)
            {
                return Err(bad_input!("{name}: anchor {peer} is in it twice"));
            }
        }
        if let Some(common) = file.common {
            let sound = [
                common.lag_s,
                common.lag_sigma_s,
                common.slope,
                common.slope_sigma,
            ]
            .iter()
            .all(|v| v.is_finite());
            if !sound || common.slope <= -0.5 || common.slope > 0.5 {
                return Err(bad_input!(
                    "{name}: [common] holds a number that cannot be meant"
                ));
            }
        }
        file.frame(path)?;
        Ok(file)
    }

    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, toml::to_string(self)?)
    }

    /// The ENU frame where its origin is given.
    pub(crate) fn frame(&self, path: &Path) -> Result<Option<LocalFrame>> {
        let Some(origin) = self.origin else {
            return Ok(None);
        };
        let place = Geodetic::new(origin.lat_deg, origin.lon_deg, origin.height_m)
            .map_err(|error| bad_input!("{}: [origin]: {error}", path.display()))?;
        Ok(Some(LocalFrame::at(place)))
    }
}

impl From<Geodetic> for OriginEntry {
    fn from(place: Geodetic) -> Self {
        Self {
            lat_deg: place.lat_deg,
            lon_deg: place.lon_deg,
            height_m: place.height_m,
        }
    }
}
