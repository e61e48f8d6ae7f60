//! The factor graph of a moving target, solved as it grows (eq. 15-28).
//!
//! ```text
//! prior -- x0 --motion-- x1 --motion-- x2 ... --motion-- xK
//!          |             |             |                 |
//!        range,        range,        range,            range,
//!        bearing       bearing       bearing           bearing
//! ```
//!
//! The graph is a chain, so that Gauss-Newton needs no sparse matrices: eliminating the states from
//! the first to the last is a Kalman filter linearised at the present guesses, and going back a smoother (Bell, "The
//! iterated Kalman smoother as a Gauss-Newton method", 1994). The way back is Bierman's
//! ("Fixed interval smoothing with discrete measurements", 1973), a product of a matrix and a vector a
//! state:
//!
//! ```text
//! x_k = m_k - S_k l_k        l~ = l_k - E' (N E S-_k l_k + innovation)        l_(k-1) = A' l~
//! ```
//!
//! with `m`, `S` what is known of a state from the past, `S-` the same before its own sighting. Weights of
//! the kernels are those at the guess (iteratively reweighted least squares).
//!
//! As in iSAM2, only what changes is done again. A new state changes the guesses of the last few; going back ends where they no longer move, and elimination begins again at the oldest state
//! that has moved by more than a tolerance from where it was linearised. With a tolerance of 0 and
//! rounds enough the result is the maximum a posteriori of all that is held.
//!
//! The window holds a given number of states. What leaves it stays as a prior on the oldest one that is left: that is
//! what the filter knew of it before its own sighting, and it is exact (Schur's complement) but for
//! where the sightings that left were linearised.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::factors::{Kernels, quadratic};
use super::motion::Belief;
use super::options::GraphOptions;
use super::sighting::{Sighting, SightingFault};
use super::tracker::{Counts, Tracker};
use super::update::{Told, update};
use crate::error::SolveError;

/// One state of the chain.
#[derive(Debug, Clone)]
struct Node {
    sighting: Sighting,
    /// Seconds since the state before, and the density of the acceleration in them.
    dt_s: f64,
    density: f64,
    /// What the past says of it, without and with its own sighting.
    before: Belief,
    filtered: Belief,
    told: Told,
    /// Where its sighting is linearised, and the kernel's weight of the bearing there.
    at: Vector3<f64>,
    bearing_weight: f64,
    /// What the whole window says of it.
    position_m: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
}

/// A target followed by a factor graph.
#[derive(Debug, Clone)]
pub struct TargetGraph {
    options: GraphOptions,
    prior: Belief,
    nodes: VecDeque<Node>,
    counts: Counts,
    relinearised: u64,
}

impl TargetGraph {
    /// A graph that holds nothing but the prior of the first state (eq. 15, 16).
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where an option or the prior cannot be meant.
    pub fn new(prior: Belief, options: GraphOptions) -> Result<Self, SolveError> {
        options.check()?;
        if !prior.is_sound() {
            return Err(SolveError::BadOption {
                name: "prior",
                why: "not finite, or of negative variance",
            });
        }
        // Room for the newest before the oldest goes.
        let room = options.window.map_or(0, |window| window.saturating_add(1));
        Ok(Self {
            options,
            prior,
            nodes: VecDeque::with_capacity(room),
            counts: Counts::default(),
            relinearised: 0,
        })
    }

    /// Adds a sighting, the target accelerating with this density since the last one, and solves.
    ///
    /// # Errors
    /// [`SightingFault`]; the graph stays as it was.
    pub fn push(&mut self, sighting: &Sighting, density: f64) -> Result<(), SightingFault> {
        let outcome = self.add(sighting, density);
        self.counts.note(&outcome);
        outcome
    }

    fn add(&mut self, sighting: &Sighting, density: f64) -> Result<(), SightingFault> {
        sighting.check()?;
        if !(density.is_finite() && density >= 0.0) {
            return Err(SightingFault::NotFinite {
                what: "the density of the acceleration",
            });
        }
        let (dt_s, before) = match self.nodes.back() {
            None => (0.0, self.prior),
            Some(last) => {
                let dt_s = step_s(sighting.t_s, last.sighting.t_s, self.options.longest_gap_s)?;
                (dt_s, last.filtered.after(dt_s, density))
            }
        };
        self.nodes.push_back(Node {
            sighting: *sighting,
            dt_s,
            density,
            before,
            filtered: before,
            told: Told::NOTHING,
            at: before.position_m,
            bearing_weight: 1.0,
            position_m: before.position_m,
            velocity_m_s: before.velocity_m_s,
        });
        let window = self.options.window.unwrap_or(usize::MAX);
        if self.nodes.len() > window {
            self.nodes.pop_front();
        }
        self.solve();
        Ok(())
    }

    fn solve(&mut self) {
        let Some(newest) = self.nodes.len().checked_sub(1) else {
            return;
        };
        let mut from = newest;
        if let Some(graduation) = self.options.graduation {
            from = (newest + 1).saturating_sub(graduation.states);
            let mut wider = graduation.widest;
            while wider > 1.0 {
                self.eliminate(from, self.options.kernels.widened(wider));
                self.substitute();
                wider /= graduation.narrowing;
            }
        }
        for _ in 0..self.options.rounds {
            self.eliminate(from, self.options.kernels);
            match self.substitute() {
                Some(moved) => from = moved,
                None => return,
            }
        }
    }

    /// From a state to the newest: sightings linearised at the present guess.
    fn eliminate(&mut self, from: usize, kernels: Kernels) {
        let mut carried = None;
        for node in self.nodes.range_mut(from..) {
            if let Some(last) = carried {
                node.before = Belief::after(&last, node.dt_s, node.density);
            }
            node.at = node.position_m;
            let told = quadratic(&node.sighting, &node.at, &kernels);
            node.bearing_weight = told.bearing_weight;
            (node.filtered, node.told) = update(&node.before, &told, &node.at)
                // Numbers that leave the finite tell nothing.
                .unwrap_or((node.before, Told::NOTHING));
            self.relinearised += 1;
            carried = Some(node.filtered);
        }
    }

    /// From the newest state back until guesses no longer change: the oldest that has moved away from
    /// where it was linearised.
    fn substitute(&mut self) -> Option<usize> {
        let tolerance_m = self.options.tolerance_m;
        let mut oldest = None;
        let mut still = 0;
        let (mut lp, mut lv) = (Vector3::zeros(), Vector3::zeros());
        for (i, node) in self.nodes.iter_mut().enumerate().rev() {
            let known = &node.filtered;
            let position_m = known.position_m - known.pp * lp - known.pv * lv;
            let velocity_m_s = known.velocity_m_s - known.pv.tr_mul(&lp) - known.vv * lv;
            let change = (position_m - node.position_m)
                .norm()
                .max((velocity_m_s - node.velocity_m_s).norm());
            node.position_m = position_m;
            node.velocity_m_s = velocity_m_s;
            if (position_m - node.at).norm() > tolerance_m {
                oldest = Some(i);
            }
            // One state may stand still by chance between others that move.
            still = if change <= 0.1 * tolerance_m {
                still + 1
            } else {
                0
            };
            if still >= 3 && oldest != Some(i) {
                break;
            }
            let seen = node.before.pp * lp + node.before.pv * lv;
            lp -= node.told.information * seen + node.told.innovation;
            lv += lp * node.dt_s;
        }
        oldest
    }

    /// States of the window, oldest first: time, position, velocity.
    pub fn states(&self) -> impl ExactSizeIterator<Item = (f64, Vector3<f64>, Vector3<f64>)> + '_ {
        self.nodes
            .iter()
            .map(|node| (node.sighting.t_s, node.position_m, node.velocity_m_s))
    }

    /// Weight the kernel leaves to the newest bearing; 1 for one that fits.
    pub fn bearing_weight(&self) -> Option<f64> {
        self.nodes.back().map(|node| node.bearing_weight)
    }

    /// How often a sighting was linearised so far.
    pub fn relinearised(&self) -> u64 {
        self.relinearised
    }

    /// Half the sum of all `rho` of the window at its guesses, the prior's and the motion's among them:
    /// what is minimised (eq. 26), up to what has left.
    pub fn cost(&self) -> f64 {
        let mut sum = 0.0;
        let mut last: Option<&Node> = None;
        for node in &self.nodes {
            sum += quadratic(&node.sighting, &node.position_m, &self.options.kernels).cost;
            sum += match last {
                None => prior_cost(&node.before, node.position_m, node.velocity_m_s),
                Some(last) => motion_cost(last, node),
            };
            last = Some(node);
        }
        sum
    }
}

fn prior_cost(prior: &Belief, position_m: Vector3<f64>, velocity_m_s: Vector3<f64>) -> f64 {
    let mut off = nalgebra::Vector6::zeros();
    off.fixed_rows_mut::<3>(0)
        .copy_from(&(position_m - prior.position_m));
    off.fixed_rows_mut::<3>(3)
        .copy_from(&(velocity_m_s - prior.velocity_m_s));
    (prior.covariance().cholesky()).map_or(0.0, |cholesky| 0.5 * off.dot(&cholesky.solve(&off)))
}

/// Half of `|x' - A x|^2` in the metric of `Q^-1 = 1/q [12/dt^3, -6/dt^2; -6/dt^2, 4/dt]`.
fn motion_cost(last: &Node, node: &Node) -> f64 {
    let dt = node.dt_s;
    if node.density <= 0.0 {
        return 0.0;
    }
    let rp = node.position_m - last.position_m - last.velocity_m_s * dt;
    let rv = node.velocity_m_s - last.velocity_m_s;
    let sum = 12.0 / (dt * dt * dt) * rp.norm_squared() - 12.0 / (dt * dt) * rp.dot(&rv)
        + 4.0 / dt * rv.norm_squared();
    0.5 * sum / node.density
}

/// Seconds between two sightings that follow each other.
pub(crate) fn step_s(t_s: f64, last_s: f64, most_s: f64) -> Result<f64, SightingFault> {
    let gap_s = t_s - last_s;
    if gap_s <= 0.0 {
        return Err(SightingFault::Order { t_s, last_s });
    }
    if gap_s > most_s {
        return Err(SightingFault::Gap { gap_s, most_s });
    }
    Ok(gap_s)
}

impl Tracker for TargetGraph {
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        self.push(sighting, self.options.acceleration_density)
    }

    fn belief(&self) -> Belief {
        self.nodes.back().map_or(self.prior, |node| node.filtered)
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}
