//! The vector field that leads onto the path and along it (Sec. 4.3, Eq. 18, 19).

use super::path::{DeliveryPath, Sector};
use nalgebra::Vector3;

/// How fast, how hard, how eagerly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldOptions {
    /// Weight of convergence k_f, 1/m.
    pub convergence_per_m: f64,
    /// Wanted speeds v_1 to v_5 of the sectors, m/s.
    pub speeds_m_s: [f64; 5],
    /// Speeds change along the path no faster than this allows, m/s^2. The paper's speeds jump at borders: infinity gives that.
    pub acceleration_m_s2: f64,
    /// Near the ground the descent is no faster than this, m/s.
    pub touchdown_m_s: f64,
}

impl Default for FieldOptions {
    fn default() -> Self {
        Self {
            convergence_per_m: 1.0,
            speeds_m_s: [1.5, 2.0, 4.0, 1.5, 0.8],
            acceleration_m_s2: 1.0,
            touchdown_m_s: 0.3,
        }
    }
}

/// The field of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorField {
    path: DeliveryPath,
    options: FieldOptions,
}

impl VectorField {
    /// The field that leads along `path`.
    pub fn new(path: DeliveryPath, options: FieldOptions) -> Self {
        Self { path, options }
    }

    /// The path.
    pub fn path(&self) -> &DeliveryPath {
        &self.path
    }

    /// The wanted velocity at a place, m/s: F = v_r (G F_conv + H F_tang) (Eq. 19); towards the goal with `forwards`
    /// (s = 1), else back to the start (s = -1).
    ///
    /// Its size is v_r everywhere: G^2 + H^2 = 1 and the two directions are at right angles.
    pub fn velocity_m_s(&self, place_m: &Vector3<f64>, forwards: bool) -> Vector3<f64> {
        let surface = self.path.surface(place_m);
        // V = (alpha_1^2 + alpha_2^2) / 2, grad V = alpha_1 grad alpha_1 + alpha_2 grad alpha_2.
        let gradient = Vector3::y() * place_m.y + surface.gradient * surface.value_m;
        let root_v_m = gradient.norm() / std::f64::consts::SQRT_2;
        let converging = gradient.try_normalize(1e-12).unwrap_or_default();
        let s = if forwards { 1.0 } else { -1.0 };
        // Both gradients are unit vectors at right angles: so is their product.
        let along = Vector3::y().cross(&surface.gradient) * s;
        let g = -std::f64::consts::FRAC_2_PI * (self.options.convergence_per_m * root_v_m).atan();
        let h = (1.0 - g * g).sqrt();
        (converging * g + along * h) * self.speed_m_s(place_m, forwards)
    }

    /// v_r: the speed of the sector, lowered so that the speeds of the sectors ahead are reached in time, and raised no
    /// faster behind a border.
    pub fn speed_m_s(&self, place_m: &Vector3<f64>, forwards: bool) -> f64 {
        let o = &self.options;
        let along_m = self.path.along_m(place_m);
        let here = self.path.sector(place_m) as usize;
        let ends = self.path.ends_m();
        let begin = |sector: usize| {
            sector
                .checked_sub(1)
                .and_then(|k| ends.get(k))
                .copied()
                .unwrap_or(0.0)
        };
        let mut speed = f64::INFINITY;
        for (sector, &wanted) in o.speeds_m_s.iter().enumerate() {
            let end = ends.get(sector).copied().unwrap_or(0.0);
            // How far away along the path this sector is.
            let away_m = match sector.cmp(&here) {
                std::cmp::Ordering::Less => along_m - end,
                std::cmp::Ordering::Equal => 0.0,
                std::cmp::Ordering::Greater => begin(sector) - along_m,
            };
            speed = speed.min(reachable(wanted, away_m, o.acceleration_m_s2));
        }
        // Ground is touched slowly, at whichever end.
        let down = if forwards {
            Sector::Descent
        } else {
            Sector::Climb
        };
        if self.path.sector(place_m) == down {
            speed = speed.min(reachable(
                o.touchdown_m_s,
                place_m.z,
                0.5 * o.acceleration_m_s2.min(1.0),
            ));
        }
        speed
    }
}

/// The speed so far from where it has to be `speed`: v^2 = v_0^2 + 2 a s.
fn reachable(speed: f64, away_m: f64, acceleration_m_s2: f64) -> f64 {
    if away_m <= 0.0 {
        speed
    } else {
        (speed * speed + 2.0 * acceleration_m_s2 * away_m).sqrt()
    }
}
