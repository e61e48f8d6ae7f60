//! Can these measurements tell where the node is? And if not, how far could it be?
//!
//! The covariance of a fit is a statement about its surroundings, seen through straight tangents.
//! Where its longest axis is no longer small against the curvature of the set of places that fit (a
//! ring about a straight path, a sphere about a single place), the whole set stands in for it: the
//! reported covariance becomes the second moment, about the reported position, of a node anywhere
//! on that set. For a mirror image of probability `q` at distance `d`: `(1 - q) P + q (P' + d
//! d^T)`. So a reader who looks at the standard deviations alone is warned as well.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::{Shape, descending_eigen};

/// A standard deviation above this part of the radius of curvature counts as undetermined. At a
/// quarter the arc and its tangent part by an eighth of that standard deviation.
const UNDETERMINED_ABOVE: f64 = 0.25;
/// A ring or sphere is claimed only where the free directions are this much weaker (in variance)
/// than the others.
const MUCH_WEAKER: f64 = 25.0;

/// What the geometry lets the measurements tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Observability {
    /// One place fits.
    Unique,
    /// Two places fit: the path is too flat (or too straight) to tell a node from its mirror image.
    /// The other is `alternative`.
    Mirror,
    /// The places of measurement lie so close to a line (or, at known height, to a point) that the
    /// node may be anywhere on a ring about it.
    Ring {
        /// Centre of the ring.
        centre_m: Vector3<f64>,
        /// Unit vector along the axis.
        axis: Vector3<f64>,
        /// Radius of the ring.
        radius_m: f64,
    },
    /// All measurements come from one place: the node may be anywhere around it.
    Sphere {
        /// Where the measurements come from.
        centre_m: Vector3<f64>,
        /// Distance of the node.
        radius_m: f64,
    },
    /// One place fits best, but along `direction` its standard deviation is more than a quarter of
    /// the distance to the path.
    Weak {
        /// Unit vector.
        direction: Vector3<f64>,
        /// Standard deviation along it.
        sigma_m: f64,
    },
}

impl Observability {
    /// True for [`Observability::Unique`] alone.
    pub fn is_unique(&self) -> bool {
        matches!(self, Observability::Unique)
    }

    /// In a word, as outputs for machines have it.
    pub fn name(&self) -> &'static str {
        match self {
            Observability::Unique => "unique",
            Observability::Mirror => "mirror",
            Observability::Ring { .. } => "ring",
            Observability::Sphere { .. } => "sphere",
            Observability::Weak { .. } => "weak",
        }
    }

    /// The same with the origin of the coordinates moved by `-origin`.
    pub(crate) fn moved_by(mut self, origin: Vector3<f64>) -> Self {
        match &mut self {
            Observability::Ring { centre_m, .. } | Observability::Sphere { centre_m, .. } => {
                *centre_m += origin
            }
            Observability::Unique | Observability::Mirror | Observability::Weak { .. } => {}
        }
        self
    }
}

/// Judges the surroundings of a fit: covariance `local` at `place`, for measurements from places of
/// the given shape. Returns the verdict (never [`Observability::Mirror`], which is not a matter of
/// the surroundings) and the covariance to report.
pub(crate) fn judge(
    place: Vector3<f64>,
    local: &Matrix3<f64>,
    shape: &Shape,
    height_known: bool,
) -> (Observability, Matrix3<f64>) {
    let from_centre = place - shape.centre;
    let distance = from_centre.norm();
    let (variances, axes) = descending_eigen(*local);
    let undetermined =
        |variance: f64, radius: f64| variance > (UNDETERMINED_ABOVE * radius).powi(2);

    if variances[1] > MUCH_WEAKER * variances[2]
        && !height_known
        && undetermined(variances[1], distance)
        && from_centre.dot(&axes[2]).abs() > 0.9 * distance
    {
        let second_moment = Matrix3::identity() * (distance * distance / 3.0)
            + from_centre * from_centre.transpose();
        let across = axes[2] * axes[2].transpose() * variances[2];
        let verdict = Observability::Sphere {
            centre_m: shape.centre,
            radius_m: distance,
        };
        return (verdict, second_moment + across);
    }

    let axis = if height_known {
        Vector3::z()
    } else {
        shape.axes[0]
    };
    let centre_m = shape.centre + axis * from_centre.dot(&axis);
    let spoke = place - centre_m;
    let radius_m = spoke.norm();
    let along_ring = axes[0].dot(&axis.cross(&spoke)).abs() > 0.9 * radius_m;
    if variances[0] > MUCH_WEAKER * variances[1]
        && undetermined(variances[0], radius_m)
        && along_ring
    {
        let plane = Matrix3::identity() - axis * axis.transpose();
        let second_moment = plane * (radius_m * radius_m / 2.0) + spoke * spoke.transpose();
        // Summed up rather than subtracted from `local`, whose long axis may be larger by more than
        // f64 has digits.
        let across: Matrix3<f64> = (1..3)
            .map(|i| axes[i] * axes[i].transpose() * variances[i].max(0.0))
            .sum();
        let verdict = Observability::Ring {
            centre_m,
            axis,
            radius_m,
        };
        return (verdict, second_moment + across);
    }

    let bent = local + sagitta(variances[0], axes[0], from_centre);
    if undetermined(variances[0], distance) {
        let verdict = Observability::Weak {
            direction: axes[0],
            sigma_m: variances[0].max(0.0).sqrt(),
        };
        return (verdict, bent);
    }
    (Observability::Unique, bent)
}

/// Second-order part of the covariance: places that fit lie not on the tangent along the longest
/// axis but on an arc of radius `R` about the path, which leaves the tangent by `t^2 / (2 R)`. For
/// Gaussian `t` the second moment of that is `3 sigma^4 / (4 R^2)`, towards the path.
fn sagitta(variance: f64, along: Vector3<f64>, from_centre: Vector3<f64>) -> Matrix3<f64> {
    let spoke = from_centre - along * from_centre.dot(&along);
    let radius2 = spoke.norm_squared();
    if radius2 > 0.0 {
        spoke * spoke.transpose() * (0.75 * variance * variance / (radius2 * radius2))
    } else {
        Matrix3::zeros()
    }
}

/// Second moment about the better of two places, `apart` from the other which has probability `q`.
pub(crate) fn mixture(
    local: &Matrix3<f64>,
    other: &Matrix3<f64>,
    apart: Vector3<f64>,
    q: f64,
) -> Matrix3<f64> {
    local * (1.0 - q) + (other + apart * apart.transpose()) * q
}
