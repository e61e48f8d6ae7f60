//! The platform in perspective.

use super::marker::NestedMarker;
use crate::streams::scramble;
use nalgebra::{Vector2, Vector3};
use nova_solver::delivery::{CameraMount, Pose};

/// Samples along each side of a pixel that shows the platform.
const SAMPLES: u32 = 4;
/// Cells of the ground's texture, metres.
const TEXTURE_M: f64 = 0.07;

/// A pinhole camera that looks down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Pixels in a row, and rows.
    pub size_px: [usize; 2],
    /// Focal length, pixels.
    pub focal_px: f64,
}

impl Default for Camera {
    /// Raspberry Pi Camera 2, a quarter of its pixels: 62.2 by 48.8 degrees.
    fn default() -> Self {
        Self {
            size_px: [1280, 960],
            focal_px: 1061.0,
        }
    }
}

/// How much light comes from where, before lens and sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 0 to 1, row by row.
    pub(super) albedo: Vec<f64>,
}

impl Camera {
    /// Where a place on the ground is in the picture, pixels from its upper left corner; `None` behind the camera.
    pub fn project(&self, pose: &Pose, place_m: Vector2<f64>) -> Option<Vector2<f64>> {
        let mount = CameraMount::looking_down(Vector3::zeros());
        let body = pose.attitude.inverse() * (place_m.push(0.0) - pose.position_m);
        let seen = mount.rotation.inverse() * body;
        let middle = Vector2::from(self.size_px.map(|side| 0.5 * side as f64));
        (seen.z > 1e-6).then(|| middle + seen.xy() * (self.focal_px / seen.z))
    }

    /// What the camera sees from a pose; the ground's texture is that of `ground`. Without `marker` there is ground only.
    pub fn render(&self, pose: &Pose, marker: Option<&NestedMarker>, ground: u64) -> Picture {
        let [width, height] = self.size_px;
        let mount = CameraMount::looking_down(Vector3::zeros());
        let turn = pose.attitude.to_rotation_matrix() * mount.rotation;
        let middle = Vector2::new(0.5 * width as f64, 0.5 * height as f64);
        let place = |at: Vector2<f64>| -> Option<Vector2<f64>> {
            let ray = turn * ((at - middle) / self.focal_px).push(1.0);
            (ray.z < -1e-6).then(|| (pose.position_m - ray * (pose.position_m.z / ray.z)).xy())
        };
        let albedo = |at: Vector2<f64>| {
            let Some(place_m) = place(at) else {
                return 0.3;
            };
            marker
                .and_then(|marker| marker.albedo(place_m))
                .unwrap_or_else(|| texture(place_m, ground))
        };
        let pixels = (0..width * height).map(|index| {
            let corner = Vector2::new((index % width) as f64, (index / width) as f64);
            let centre = corner.add_scalar(0.5);
            let fine = place(centre).is_some_and(|place_m| place_m.amax() < 0.7);
            if !fine {
                return albedo(centre);
            }
            let step = 1.0 / f64::from(SAMPLES);
            let samples = (0..SAMPLES * SAMPLES).map(|sample| {
                let right = f64::from(sample % SAMPLES) + 0.5;
                let down = f64::from(sample / SAMPLES) + 0.5;
                albedo(corner + Vector2::new(right, down) * step)
            });
            samples.sum::<f64>() * step * step
        });
        Picture {
            width,
            height,
            albedo: pixels.collect(),
        }
    }
}

/// Gravel: cells of random brightness, smoothed in between.
fn texture(place_m: Vector2<f64>, ground: u64) -> f64 {
    let scaled = place_m / TEXTURE_M;
    let cell = scaled.map(f64::floor);
    let [fx, fy] = (scaled - cell).into();
    let value = |right: f64, down: f64| hashed(cell.x + right, cell.y + down, ground);
    let upper = value(0.0, 0.0) * (1.0 - fx) + value(1.0, 0.0) * fx;
    let lower = value(0.0, 1.0) * (1.0 - fx) + value(1.0, 1.0) * fx;
    0.15 + 0.5 * (upper * (1.0 - fy) + lower * fy)
}

/// 0 to 1, for a cell.
fn hashed(x: f64, y: f64, ground: u64) -> f64 {
    let cell = scramble(scramble(ground ^ (x as i64 as u64)).wrapping_add(y as i64 as u64));
    (cell >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn what_is_projected_is_where_it_is_drawn() {
        let camera = Camera::default();
        let marker = NestedMarker::default();
        let pose = Pose {
            position_m: Vector3::new(0.2, -0.3, 2.5),
            attitude: UnitQuaternion::from_euler_angles(0.1, -0.15, 0.7),
        };
        let picture = camera.render(&pose, Some(&marker), 1);
        let corners = marker.corners_m(NestedMarker::LARGE_ID).unwrap();
        for corner in corners {
            // A centimetre inside it is black, a centimetre outside white: 4 pixels.
            for (share, black) in [(0.975, true), (1.025, false)] {
                let at = camera.project(&pose, corner * share).unwrap();
                let index = at.y as usize * picture.width + at.x as usize;
                assert_eq!(picture.albedo[index] < 0.3, black, "{corner} {share}");
            }
        }
    }
}
