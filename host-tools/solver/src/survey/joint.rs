//! All anchors at once: Levenberg-Marquardt on equations in the shape of an arrow.
//!
//! Anchor `i` has its own unknowns `x_i` (place and bias); `c` (lag and slope) is common:
//!
//! ```text
//! | A_1           C_1 | | dx_1 |     | g_1 |
//! |      A_2      C_2 | | dx_2 | = - | g_2 |       S = B - sum C_i^T A_i^-1 C_i
//! |           .    .  | |   .  |     |  .  |       S dc = -(g_c - sum C_i^T A_i^-1 g_i)
//! | C_1' C_2' .    B  | |  dc  |     | g_c |       dx_i = -A_i^-1 (g_i + C_i dc)
//! ```
//!
//! so the work grows with the number of anchors, not with its cube. The rows of one range, with `u`
//! the unit vector from the anchor to the tag, `v` the tag's velocity and `D` their distance:
//!
//! ```text
//! dh/da = -(1 + s) u^T,   dh/db = 1,   dh/dlag = -(1 + s) u . v,   dh/ds = D
//! ```

use nalgebra::{Cholesky, Matrix2, Matrix4, Matrix4x2, Vector2, Vector4};

use super::track::Track;
use crate::kernel::Kernel;
use crate::noise::robust_scale;

/// A range with its time on its own clock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) t_s: f64,
    pub(super) range: f64,
    pub(super) inv_sigma: f64,
}

/// One anchor's part of the problem.
pub(super) struct Part {
    /// In order of time.
    pub(super) samples: Vec<Sample>,
    /// x, y, z, bias: which are free.
    pub(super) free: [bool; 4],
}

/// Where the minimum is sought.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// x, y, z, bias of each anchor.
    pub(super) anchors: Vec<Vector4<f64>>,
    /// Lag in seconds, slope.
    pub(super) common: Vector2<f64>,
}

pub(super) struct Joint<'a> {
    pub(super) track: &'a Track,
    pub(super) kernel: Kernel,
    pub(super) prior_bias: f64,
    /// `1 / sigma^2`.
    pub(super) bias_weight: f64,
    /// `1 / sigma^2` of lag and slope; infinite where they are given.
    pub(super) common_weight: Vector2<f64>,
}

/// One anchor's block of the equations, without priors.
pub(super) struct Block {
    cost: f64,
    g: Vector4<f64>,
    pub(super) a: Matrix4<f64>,
    pub(super) c: Matrix4x2<f64>,
    gc: Vector2<f64>,
    pub(super) b: Matrix2<f64>,
}

struct System {
    cost: f64,
    blocks: Vec<Block>,
    gc: Vector2<f64>,
    b: Matrix2<f64>,
}

/// Rounds of fit and re-scale.
const MAX_ROUNDS: u32 = 12;
/// Evaluations within one round: the scale is on its way as well.
const COARSE_EVALUATIONS: u32 = 8;
const FINE_EVALUATIONS: u32 = 40;

impl Joint<'_> {
    /// Fits `few` with the scale found along the way, then `all` of the samples from there. Returns
    /// the point and the scale of each anchor's residuals; `None` where the equations are singular.
    pub(super) fn solve(
        &self,
        few: &[Part],
        all: &[Part],
        start: Point,
    ) -> Option<(Point, Vec<f64>)> {
        let mut x = start;
        let mut scales = self.scales(few, &x);
        for _ in 0..MAX_ROUNDS {
            x = self.minimise(few, &scales, x, COARSE_EVALUATIONS, 1e-2)?;
            let next = self.scales(few, &x);
            let settled =
                (scales.iter().zip(&next)).all(|(old, new)| (new / old - 1.0).abs() < 0.02);
            scales = next;
            if settled {
                break;
            }
        }
        let scales = self.scales(all, &x);
        let x = self.minimise(all, &scales, x, FINE_EVALUATIONS, 1e-6)?;
        Some((x, scales))
    }

    /// Robust standard deviation of each anchor's residuals in units of the given one.
    fn scales(&self, parts: &[Part], x: &Point) -> Vec<f64> {
        let mut scratch = Vec::new();
        (parts.iter().zip(&x.anchors))
            .map(|(part, anchor)| {
                scratch.clear();
                let mut hint = 0;
                scratch.extend(part.samples.iter().filter_map(|sample| {
                    let (p, _) = self.track.anywhere(sample.t_s - x.common.x, &mut hint)?;
                    let h = (1.0 + x.common.y) * (p - anchor.xyz()).norm() + anchor.w;
                    Some((h - sample.range) * sample.inv_sigma)
                }));
                robust_scale(&mut scratch, 5).max(1e-3)
            })
            .collect()
    }

    fn minimise(
        &self,
        parts: &[Part],
        scales: &[f64],
        mut x: Point,
        most_evaluations: u32,
        tolerance: f64,
    ) -> Option<Point> {
        let mut system = self.system(parts, scales, &x);
        let mut damping = 1e-4;
        let mut growth = 2.0;
        let mut evaluations = 1;
        while evaluations < most_evaluations && damping < 1e12 {
            let Some((next, promised)) = self.step(parts, &system, &x, damping) else {
                damping *= growth;
                growth *= 2.0;
                continue;
            };
            let at_next = self.system(parts, scales, &next);
            evaluations += 1;
            let negligible = promised < tolerance + 1e-14 * system.cost;
            if at_next.cost < system.cost {
                x = next;
                system = at_next;
                damping = (damping / 3.0).max(1e-12);
                growth = 2.0;
            } else {
                damping *= growth;
                growth *= 2.0;
            }
            if negligible {
                break;
            }
        }
        system.cost.is_finite().then_some(x)
    }

    fn system(&self, parts: &[Part], scales: &[f64], x: &Point) -> System {
        let mut system = System {
            cost: 0.0,
            blocks: Vec::with_capacity(parts.len()),
            gc: Vector2::zeros(),
            b: Matrix2::zeros(),
        };
        for ((part, anchor), scale) in parts.iter().zip(&x.anchors).zip(scales) {
            let mut block = self.block(part, anchor, &x.common, *scale, self.kernel);
            let off = anchor.w - self.prior_bias;
            block.a[(3, 3)] += self.bias_weight;
            block.g.w += self.bias_weight * off;
            hold(&mut block, part.free);
            system.cost += block.cost + 0.5 * self.bias_weight * off * off;
            system.gc += block.gc;
            system.b += block.b;
            system.blocks.push(block);
        }
        for k in 0..2 {
            let weight = self.common_weight[k];
            if weight.is_finite() {
                system.cost += 0.5 * weight * x.common[k] * x.common[k];
                system.gc[k] += weight * x.common[k];
                system.b[(k, k)] += weight;
            }
        }
        system
    }

    /// Sums over one anchor's samples.
    pub(super) fn block(
        &self,
        part: &Part,
        anchor: &Vector4<f64>,
        common: &Vector2<f64>,
        scale: f64,
        kernel: Kernel,
    ) -> Block {
        let mut block = Block {
            cost: 0.0,
            g: Vector4::zeros(),
            a: Matrix4::zeros(),
            c: Matrix4x2::zeros(),
            gc: Vector2::zeros(),
            b: Matrix2::zeros(),
        };
        let stretch = 1.0 + common.y;
        let mut hint = 0;
        for sample in &part.samples {
            let Some((p, v)) = self.track.anywhere(sample.t_s - common.x, &mut hint) else {
                continue;
            };
            let away = p - anchor.xyz();
            let distance = away.norm();
            let u = if distance > 0.0 {
                away / distance
            } else {
                away
            };
            let whiten = sample.inv_sigma / scale;
            let r = (stretch * distance + anchor.w - sample.range) * whiten;
            let (rho, weight) = kernel.rho_and_weight(r * r);
            block.cost += 0.5 * rho;
            let j = Vector4::new(-stretch * u.x, -stretch * u.y, -stretch * u.z, 1.0) * whiten;
            let jc = Vector2::new(-stretch * u.dot(&v), distance) * whiten;
            let (wj, wjc) = (j * weight, jc * weight);
            block.g += wj * r;
            block.gc += wjc * r;
            block.a.ger(1.0, &wj, &j, 1.0);
            block.c.ger(1.0, &wj, &jc, 1.0);
            block.b.ger(1.0, &wjc, &jc, 1.0);
        }
        block
    }

    /// Next point and the decrease that the quadratic model promises.
    fn step(
        &self,
        parts: &[Part],
        system: &System,
        x: &Point,
        damping: f64,
    ) -> Option<(Point, f64)> {
        let mut s = damped(system.b, damping);
        let mut right = system.gc;
        let mut inverses = Vec::with_capacity(parts.len());
        for block in &system.blocks {
            let a = Cholesky::new(damped(block.a, damping))?;
            let solved = a.solve(&block.c);
            s -= block.c.transpose() * solved;
            right -= solved.transpose() * block.g;
            inverses.push(a);
        }
        for k in 0..2 {
            if !self.common_weight[k].is_finite() {
                s.row_mut(k).fill(0.0);
                s.column_mut(k).fill(0.0);
                s[(k, k)] = 1.0;
                right[k] = 0.0;
            }
        }
        let dc = -Cholesky::new(s)?.solve(&right);
        let mut next = x.clone();
        next.common += dc;
        let mut slope = system.gc.dot(&dc);
        let mut bend = dc.dot(&(system.b * dc));
        for ((block, a), anchor) in system.blocks.iter().zip(&inverses).zip(&mut next.anchors) {
            let dx = -a.solve(&(block.g + block.c * dc));
            *anchor += dx;
            slope += block.g.dot(&dx);
            bend += dx.dot(&(block.a * dx)) + 2.0 * dx.dot(&(block.c * dc));
        }
        let finite = next.anchors.iter().all(|a| a.iter().all(|v| v.is_finite()))
            && next.common.iter().all(|v| v.is_finite());
        finite.then_some((next, -slope - 0.5 * bend))
    }
}

/// Marquardt's damping; a parameter without any information gets some as well.
fn damped<const N: usize>(
    mut h: nalgebra::SMatrix<f64, N, N>,
    damping: f64,
) -> nalgebra::SMatrix<f64, N, N> {
    let floor = 1e-9 * h.diagonal().max().max(1e-12);
    for i in 0..N {
        h[(i, i)] += damping * h[(i, i)].max(floor) + 1e-3 * floor;
    }
    h
}

/// What is given keeps its start.
pub(super) fn hold(block: &mut Block, free: [bool; 4]) {
    for i in (0..4).filter(|&i| !free[i]) {
        block.a.row_mut(i).fill(0.0);
        block.a.column_mut(i).fill(0.0);
        block.a[(i, i)] = 1.0;
        block.c.row_mut(i).fill(0.0);
        block.g[i] = 0.0;
    }
}
