//! From light to bytes: lens, motion, photons, sensor.

use super::render::Picture;
use crate::streams::normal;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};

/// White comes out as this byte: exposure and gain are set by the brightest.
const WHITE_BYTE: f64 = 230.0;

/// How a picture is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Standard deviation of the lens' blur, pixels.
    pub blur_px: f64,
    /// How far the picture moves sideways while the shutter is open, pixels.
    pub motion_px: usize,
    /// Electrons that a pixel collects from what is white: 10 000 by day, tens at dusk.
    pub electrons: f64,
    /// Noise of reading a pixel, electrons.
    pub read_noise: f64,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            blur_px: 0.7,
            motion_px: 0,
            electrons: 10_000.0,
            read_noise: 3.0,
        }
    }
}

impl Light {
    /// The picture as the sensor gives it: bytes, row by row.
    pub fn take(&self, picture: &Picture, rng: &mut ChaCha8Rng) -> Vec<u8> {
        let (width, height) = (picture.width, picture.height);
        let lens = gaussian(self.blur_px);
        let open = vec![1.0 / (self.motion_px + 1) as f64; self.motion_px + 1];
        let mut light = along(&picture.albedo, width, height, (1, 0), &lens);
        light = along(&light, width, height, (0, 1), &lens);
        light = along(&light, width, height, (1, 0), &open);
        light
            .iter()
            .map(|albedo| {
                let mean = (albedo * self.electrons).max(1e-9);
                let counted = Poisson::new(mean).map_or(mean, |photons| photons.sample(rng));
                let read = counted + self.read_noise * normal(rng);
                (read * WHITE_BYTE / self.electrons).clamp(0.0, 255.0) as u8
            })
            .collect()
    }
}

fn gaussian(sigma: f64) -> Vec<f64> {
    if sigma <= 0.0 {
        return vec![1.0];
    }
    let reach = (3.0 * sigma).ceil() as i32;
    let weights: Vec<f64> = (-reach..=reach)
        .map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

/// Folded with a row of weights in a direction; the picture goes on beyond its edges as it ends there.
fn along(
    values: &[f64],
    width: usize,
    height: usize,
    (right, down): (isize, isize),
    weights: &[f64],
) -> Vec<f64> {
    let middle = (weights.len() / 2) as isize;
    let at = |x: isize, y: isize| {
        let x = x.clamp(0, width as isize - 1) as usize;
        let y = y.clamp(0, height as isize - 1) as usize;
        values.get(y * width + x).copied().unwrap_or(0.0)
    };
    (0..height * width)
        .map(|index| {
            let (x, y) = ((index % width) as isize, (index / width) as isize);
            (weights.iter().zip(-middle..))
                .map(|(weight, off)| weight * at(x + off * right, y + off * down))
                .sum()
        })
        .collect()
}
