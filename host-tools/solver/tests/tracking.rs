//! What is claimed of trackers of a moving target.
#![allow(clippy::unwrap_used)]

mod target;

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};
use nova_solver::tracking::{
    Belief, Graduation, GraphOptions, InteractingOptions, InteractingTracker, Kernels, Sighting,
    SightingFault, TargetEkf, TargetGraph, Tilted, Tracker,
};
use nova_solver::{Kernel, SolveError};
use proptest::prelude::*;
use target::{BEARING_SIGMA, RANGE_SIGMA_M, STEP_S, prior, sightings, truth_m};

const DENSITY: f64 = 0.5;

fn exact(kernel: Kernel) -> GraphOptions {
    GraphOptions {
        kernels: Kernels {
            range: Kernel::None,
            bearing: kernel,
        },
        acceleration_density: DENSITY,
        window: None,
        tolerance_m: 1e-10,
        rounds: 200,
        ..GraphOptions::robust()
    }
}

fn followed(log: &[Sighting], options: GraphOptions) -> TargetGraph {
    let mut graph = TargetGraph::new(prior(), options).unwrap();
    for sighting in log {
        graph.observe(sighting).unwrap();
    }
    graph
}

/// Residuals of all factors in one vector, whitened, the kernel's square root included; written anew
/// from the paper's equations, with azimuth and elevation turned into directions on its own.
fn residuals(x: &DVector<f64>, log: &[Sighting], c: Option<f64>) -> DVector<f64> {
    let mut out = Vec::new();
    let prior = prior();
    let white = prior
        .covariance()
        .cholesky()
        .unwrap()
        .l()
        .try_inverse()
        .unwrap();
    let mut off = nalgebra::Vector6::zeros();
    for k in 0..3 {
        off[k] = x[k] - prior.position_m[k];
        off[3 + k] = x[3 + k] - prior.velocity_m_s[k];
    }
    out.extend((white * off).iter());
    let mut q = Matrix6::zeros();
    let dt = STEP_S;
    for k in 0..3 {
        q[(k, k)] = DENSITY * dt.powi(3) / 3.0;
        q[(k, k + 3)] = DENSITY * dt.powi(2) / 2.0;
        q[(k + 3, k)] = q[(k, k + 3)];
        q[(k + 3, k + 3)] = DENSITY * dt;
    }
    let white = q.cholesky().unwrap().l().try_inverse().unwrap();
    for (i, sighting) in log.iter().enumerate() {
        let state = x.fixed_rows::<6>(6 * i).into_owned();
        let position = state.fixed_rows::<3>(0).into_owned();
        if i > 0 {
            let last = x.fixed_rows::<6>(6 * (i - 1)).into_owned();
            let mut moved = last;
            for k in 0..3 {
                moved[k] += dt * last[k + 3];
            }
            out.extend((white * (state - moved)).iter());
        }
        let offset = position - sighting.pose.position_m;
        if let Some(range) = sighting.range {
            out.push((offset.norm() - range.range_m) / range.sigma_m);
        }
        if let Some(bearing) = sighting.bearing {
            let h = (sighting.pose.to_sensor * offset).normalize();
            let angle = h.angle(&bearing.direction) / bearing.sigma_rad;
            // One residual whose square is rho of the angle: basis-free.
            out.push(c.map_or(angle, |c| c * (angle * angle / (c * c)).ln_1p().sqrt()));
        }
    }
    DVector::from_vec(out)
}

/// Levenberg-Marquardt on one dense matrix with slopes by differences, from guesses of its own.
fn batch(log: &[Sighting], c: Option<f64>) -> DVector<f64> {
    let n = log.len();
    let mut x = DVector::zeros(6 * n);
    for (i, sighting) in log.iter().enumerate() {
        let ahead = truth_m(sighting.t_s) + Vector3::new(0.05, 0.03, -0.04);
        x.fixed_rows_mut::<3>(6 * i).copy_from(&ahead);
    }
    let mut damping = 1e-3;
    for _ in 0..400 {
        let r = residuals(&x, log, c);
        let mut j = DMatrix::zeros(r.len(), x.len());
        for k in 0..x.len() {
            let (mut up, mut down) = (x.clone(), x.clone());
            up[k] += 1e-5;
            down[k] -= 1e-5;
            let column = (residuals(&up, log, c) - residuals(&down, log, c)) / 2e-5;
            j.set_column(k, &column);
        }
        let normal = j.transpose() * &j;
        let gradient = j.transpose() * &r;
        let mut damped = normal.clone();
        for k in 0..x.len() {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = damped.cholesky().unwrap().solve(&gradient);
        let next = &x - &step;
        if residuals(&next, log, c).norm_squared() <= r.norm_squared() {
            x = next;
            damping = (damping * 0.1).max(1e-14);
            if step.amax() < 1e-12 {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    x
}

fn apart(graph: &TargetGraph, x: &DVector<f64>) -> f64 {
    let mut most: f64 = 0.0;
    for (i, (_, position, velocity)) in graph.states().enumerate() {
        most = most.max((position - x.fixed_rows::<3>(6 * i)).amax());
        most = most.max((velocity - x.fixed_rows::<3>(6 * i + 3)).amax());
    }
    most
}

#[test]
fn with_nothing_dropped_the_graph_is_the_batch_maximum_a_posteriori() {
    for (kernel, c, outliers) in [
        (Kernel::None, None, 0.0),
        (Kernel::Cauchy { c: 2.385 }, Some(2.385), 0.1),
        (Kernel::Cauchy { c: 2.385 }, Some(2.385), 0.3),
    ] {
        let log = sightings(40, outliers, 8001);
        let graph = followed(&log, exact(kernel));
        let off = apart(&graph, &batch(&log, c));
        assert!(off < 1e-6, "{kernel:?}, {outliers}: {off:e}");
    }
}

#[test]
fn the_marginal_of_the_newest_state_is_that_of_the_whole_information_matrix() {
    let log = sightings(30, 0.0, 8002);
    let graph = followed(&log, exact(Kernel::None));
    let x = batch(&log, None);
    // Near the minimum J'J of the angles alone misses half of the bearing's information: the angle is
    // the length of two residuals. The other half is that of the direction across.
    let n = x.len();
    let mut information = DMatrix::zeros(n, n);
    let without: Vec<Sighting> = log
        .iter()
        .map(|s| Sighting {
            bearing: None,
            ..*s
        })
        .collect();
    let rows = residuals(&x, &without, None).len();
    let mut j = DMatrix::zeros(rows, n);
    for k in 0..n {
        let (mut up, mut down) = (x.clone(), x.clone());
        up[k] += 1e-5;
        down[k] -= 1e-5;
        let column = (residuals(&up, &without, None) - residuals(&down, &without, None)) / 2e-5;
        j.set_column(k, &column);
    }
    information += j.transpose() * &j;
    for (i, sighting) in log.iter().enumerate() {
        let offset: Vector3<f64> = x.fixed_rows::<3>(6 * i) - sighting.pose.position_m;
        let n = offset.normalize();
        let across =
            (Matrix3::identity() - n * n.transpose()) / (offset.norm() * BEARING_SIGMA).powi(2);
        let mut block = information.fixed_view_mut::<3, 3>(6 * i, 6 * i);
        block += across;
    }
    let covariance = information.try_inverse().unwrap();
    let expected = covariance.fixed_view::<6, 6>(n - 6, n - 6).into_owned();
    let found = graph.belief().covariance();
    assert!((found - expected).norm() < 1e-6 * expected.norm());
}

#[test]
fn what_leaves_the_window_stays_as_what_it_told() {
    // 80 states are far more than a sighting is felt: the window must not be missed.
    let log = sightings(400, 0.1, 8003);
    let whole = followed(&log, exact(Kernel::Cauchy { c: 2.385 }));
    let window = GraphOptions {
        window: Some(80),
        ..exact(Kernel::Cauchy { c: 2.385 })
    };
    let window = followed(&log, window);
    let (a, b) = (whole.belief(), window.belief());
    assert!(
        (a.position_m - b.position_m).norm() < 1e-4,
        "{}",
        (a.position_m - b.position_m).norm()
    );
    assert!((a.covariance() - b.covariance()).norm() < 1e-3 * a.covariance().norm());
    assert_eq!(window.states().len(), 80);
    // Of two, what has left must be missed.
    let two = GraphOptions {
        window: Some(2),
        ..exact(Kernel::Cauchy { c: 2.385 })
    };
    let two = followed(&log, two);
    assert!((a.position_m - two.belief().position_m).norm() > 1e-4);
}

#[test]
fn the_default_tolerances_cost_less_than_a_tenth_of_the_doubt() {
    let log = sightings(400, 0.2, 8004);
    let options = GraphOptions {
        acceleration_density: DENSITY,
        ..GraphOptions::robust()
    };
    let mut quick = TargetGraph::new(prior(), options).unwrap();
    let mut whole = TargetGraph::new(prior(), exact(options.kernels.bearing)).unwrap();
    let mut worst: f64 = 0.0;
    for sighting in &log {
        quick.observe(sighting).unwrap();
        whole.observe(sighting).unwrap();
        let (a, b) = (quick.belief(), whole.belief());
        worst = worst.max((a.position_m - b.position_m).norm() / b.pp.trace().sqrt());
    }
    assert!(worst < 0.1, "{worst}");
    assert!(quick.relinearised() < whole.relinearised() / 4);
}

fn rmse_m(tracker: &mut dyn Tracker, log: &[Sighting]) -> f64 {
    let mut sum = 0.0;
    for sighting in log {
        tracker.observe(sighting).unwrap();
        sum += (tracker.belief().position_m - truth_m(sighting.t_s)).norm_squared();
    }
    (sum / log.len() as f64).sqrt()
}

#[test]
fn with_one_bearing_in_five_wrong_the_robust_graph_errs_half_as_much_as_the_filter() {
    let (mut robust, mut plain, mut filter) = (0.0, 0.0, 0.0);
    for seed in 9000..9010 {
        let log = sightings(400, 0.2, seed);
        let graph = |options: GraphOptions| {
            let options = GraphOptions {
                acceleration_density: DENSITY,
                ..options
            };
            TargetGraph::new(prior(), options).unwrap()
        };
        robust += rmse_m(&mut graph(GraphOptions::robust()), &log);
        plain += rmse_m(&mut graph(GraphOptions::plain()), &log);
        filter += rmse_m(&mut TargetEkf::new(prior(), DENSITY).unwrap(), &log);
    }
    println!("robust {robust:.3}, plain {plain:.3}, EKF {filter:.3} (sums of ten)");
    assert!(robust < 0.5 * filter);
    assert!(robust < 0.5 * plain);
}

#[test]
fn without_outliers_filter_and_plain_graph_agree() {
    let log = sightings(200, 0.0, 8005);
    let plain = GraphOptions {
        acceleration_density: DENSITY,
        ..GraphOptions::plain()
    };
    let graph = followed(&log, plain);
    let mut filter = TargetEkf::new(prior(), DENSITY).unwrap();
    rmse_m(&mut filter, &log);
    let apart = (graph.belief().position_m - filter.belief().position_m).norm();
    assert!(apart < 0.3 * graph.belief().pp.trace().sqrt(), "{apart}");
}

#[test]
fn gaps_of_either_reading_are_bridged_and_doubt_grows_in_them() {
    let log = sightings(400, 0.05, 8006);
    let mut graph = TargetGraph::new(prior(), GraphOptions::robust()).unwrap();
    let mut doubt = Vec::new();
    for (i, sighting) in log.iter().enumerate() {
        let mut sighting = *sighting;
        if (100..160).contains(&i) {
            sighting.bearing = None;
        }
        if (200..260).contains(&i) {
            sighting.range = None;
        }
        if (300..320).contains(&i) {
            (sighting.range, sighting.bearing) = (None, None);
        }
        graph.observe(&sighting).unwrap();
        let belief = graph.belief();
        let error = belief.position_m - truth_m(sighting.t_s);
        let normal = error.dot(&(belief.pp.try_inverse().unwrap() * error));
        assert!(normal < 30.0, "{normal} at {i}");
        doubt.push(belief.pp.trace().sqrt());
    }
    for (before, after) in [(99, 159), (199, 259), (299, 319)] {
        assert!(doubt[after] > 1.2 * doubt[before], "{before}");
    }
    assert!(doubt[399] < 1.3 * doubt[99]);
}

#[test]
fn a_graduated_kernel_leaves_the_side_it_wrongly_began_at() {
    // The prior is a metre and a half off and far too sure of itself for its bearings: for a narrow
    // kernel they all are outliers.
    let log = sightings(60, 0.0, 8007);
    let wrong = Belief::about(
        truth_m(0.0) + Vector3::new(0.0, 1.6, 0.0),
        0.6,
        Vector3::zeros(),
        0.5,
    );
    let after = |graduation| {
        let options = GraphOptions {
            graduation,
            acceleration_density: 0.05,
            kernels: Kernels {
                range: Kernel::None,
                bearing: Kernel::Cauchy { c: 0.5 },
            },
            ..GraphOptions::robust()
        };
        let mut graph = TargetGraph::new(wrong, options).unwrap();
        rmse_m(&mut graph, &log)
    };
    let (narrow, graduated) = (after(None), after(Some(Graduation::default())));
    assert!(graduated < 0.8 * narrow, "{graduated} against {narrow}");
}

#[test]
fn a_target_overhead_is_followed_through_the_zenith() {
    let mut graph = TargetGraph::new(
        Belief::about(Vector3::new(-2.0, 0.0, 3.0), 0.3, Vector3::x(), 0.5),
        GraphOptions::robust(),
    )
    .unwrap();
    for (i, seen) in sightings(80, 0.0, 8008).into_iter().enumerate() {
        let t_s = STEP_S * i as f64;
        let at = Vector3::new(-2.0 + t_s, 0.0, 3.0);
        let mut sighting = seen;
        sighting.pose.position_m = Vector3::zeros();
        sighting.pose.to_sensor = nalgebra::UnitQuaternion::identity();
        sighting.range.as_mut().unwrap().range_m = at.norm();
        sighting.bearing.as_mut().unwrap().direction = at.normalize();
        graph.observe(&sighting).unwrap();
        assert!((graph.belief().position_m - at).norm() < 0.4);
    }
    assert!((graph.belief().position_m - Vector3::new(1.95, 0.0, 3.0)).norm() < 0.05);
}

fn interacting() -> InteractingTracker {
    InteractingTracker::new(prior(), InteractingOptions::default()).unwrap()
}

#[test]
fn with_one_motion_and_clear_sight_interacting_models_are_the_filter() {
    let options = InteractingOptions {
        steady_density: DENSITY,
        steady_s: 1e12,
        outliers: 1e-12,
        blocked_every_s: 1e12,
        ..InteractingOptions::default()
    };
    let mut models = InteractingTracker::new(prior(), options).unwrap();
    let mut filter = TargetEkf::new(prior(), DENSITY).unwrap();
    for sighting in sightings(300, 0.0, 8010) {
        models.observe(&sighting).unwrap();
        filter.observe(&sighting).unwrap();
        let (a, b) = (models.belief(), filter.belief());
        // They differ in where they are linearised, and that elevation is not across the sight.
        assert!((a.position_m - b.position_m).norm() < 0.5 * b.pp.trace().sqrt());
    }
    let (a, b) = (models.belief(), filter.belief());
    assert!((a.position_m - b.position_m).norm() < 0.1 * b.pp.trace().sqrt());
    assert!((a.covariance() - b.covariance()).norm() < 0.05 * b.covariance().norm());
}

#[test]
fn blocked_sight_is_noticed_while_it_lasts_and_not_otherwise() {
    let mut models = interacting();
    let log = sightings(300, 0.1, 8011);
    for (i, sighting) in log.iter().enumerate() {
        let mut sighting = *sighting;
        let blocked = (100..130).contains(&i);
        if blocked {
            // Late ranges, and bearings from anywhere. (A reflection that stays is followed: nothing tells
            // it from a target that moves.)
            sighting.range.as_mut().unwrap().range_m += 0.7;
            let bearing = sighting.bearing.as_mut().unwrap();
            let (azimuth, elevation) = bearing.angles();
            *bearing = nova_solver::tracking::Bearing::from_angles(
                azimuth + 0.8 * (12.9 * i as f64).sin(),
                elevation,
                bearing.sigma_rad,
            );
        }
        models.observe(&sighting).unwrap();
        let after_a_moment = (105..130).contains(&i);
        let long_after = !(95..140).contains(&i);
        if after_a_moment {
            assert!(models.blocked() > 0.5, "{} at {i}", models.blocked());
        } else if long_after {
            assert!(models.blocked() < 0.5, "{} at {i}", models.blocked());
        }
        let belief = models.belief();
        let error = belief.position_m - truth_m(sighting.t_s);
        let normal = error.dot(&(belief.pp.try_inverse().unwrap() * error));
        assert!(normal < 30.0, "{normal} at {i}");
    }
}

#[test]
fn a_tilt_that_may_be_widens_the_belief_across_the_line_of_sight_alone() {
    let log = sightings(50, 0.0, 8012);
    let mut straight = interacting();
    let mut tilted = Tilted::new(interacting(), 0.1).unwrap();
    assert_eq!(tilted.belief(), straight.belief());
    for sighting in &log {
        straight.observe(sighting).unwrap();
        tilted.observe(sighting).unwrap();
    }
    let (a, b) = (straight.belief(), tilted.belief());
    let r = a.position_m - log[49].pose.position_m;
    let n = r.normalize();
    let wider = b.pp - a.pp;
    assert!((wider * n).norm() < 1e-12);
    assert!((wider.trace() - 2.0 * (0.1 * r.norm()).powi(2)).abs() < 1e-12);
    assert_eq!((a.position_m, a.vv), (b.position_m, b.vv));
    assert!(Tilted::new(interacting(), f64::NAN).is_err());
}

#[test]
fn what_cannot_be_meant_is_refused_counted_and_leaves_no_trace() {
    let log = sightings(50, 0.0, 8009);
    let mut bad: Vec<(Sighting, &str)> = Vec::new();
    let mut with = |change: &dyn Fn(&mut Sighting), says| {
        let mut sighting = log[20];
        change(&mut sighting);
        bad.push((sighting, says));
    };
    with(&|s| s.t_s = f64::NAN, "time is not");
    with(&|s| s.t_s = log[19].t_s, "does not come after");
    with(&|s| s.t_s = 0.0, "does not come after");
    with(&|s| s.t_s = 1e9, "can be bridged");
    with(
        &|s| s.range.as_mut().unwrap().range_m = 0.0,
        "a range of 0 m",
    );
    with(
        &|s| s.range.as_mut().unwrap().range_m = -2.0,
        "a range of -2 m",
    );
    with(
        &|s| s.range.as_mut().unwrap().range_m = f64::NAN,
        "the range is not",
    );
    with(
        &|s| s.range.as_mut().unwrap().sigma_m = 0.0,
        "standard deviation",
    );
    with(
        &|s| s.bearing.as_mut().unwrap().direction *= 0.0,
        "length of 0",
    );
    with(
        &|s| s.bearing.as_mut().unwrap().direction.x = f64::INFINITY,
        "the bearing is not",
    );
    with(&|s| s.pose.position_m.z = f64::NAN, "the sensor's place");
    with(
        &|s| s.pose.attitude_covariance[(1, 1)] = -1.0,
        "the attitude",
    );
    let clean = followed(&log, GraphOptions::robust());
    let mut graph = TargetGraph::new(prior(), GraphOptions::robust()).unwrap();
    let mut filter = TargetEkf::new(prior(), 1.0).unwrap();
    let mut models = interacting();
    let mut untouched = interacting();
    for (i, sighting) in log.iter().enumerate() {
        if i == 20 {
            for (sighting, says) in &bad {
                let fault: SightingFault = graph.observe(sighting).unwrap_err();
                assert!(fault.to_string().contains(says), "{fault}");
                assert!(filter.observe(sighting).is_err());
                assert!(models.observe(sighting).is_err());
            }
        }
        graph.observe(sighting).unwrap();
        filter.observe(sighting).unwrap();
        models.observe(sighting).unwrap();
        untouched.observe(sighting).unwrap();
    }
    assert_eq!(graph.belief(), clean.belief());
    assert_eq!(models.belief(), untouched.belief());
    for counts in [graph.counts(), filter.counts(), models.counts()] {
        assert_eq!((counts.used, counts.refused()), (50, bad.len() as u64));
        assert_eq!((counts.out_of_order, counts.after_gap), (2, 1));
    }
}

#[test]
fn options_that_cannot_be_meant_are_refused_by_name() {
    let refused = |change: fn(&mut GraphOptions)| {
        let mut options = GraphOptions::robust();
        change(&mut options);
        match TargetGraph::new(prior(), options) {
            Err(SolveError::BadOption { name, .. }) => name,
            _ => "none",
        }
    };
    assert_eq!(refused(|o| o.window = Some(1)), "window");
    assert_eq!(refused(|o| o.rounds = 0), "rounds");
    assert_eq!(refused(|o| o.tolerance_m = f64::NAN), "tolerance_m");
    assert_eq!(
        refused(|o| o.acceleration_density = -1.0),
        "acceleration_density"
    );
    assert_eq!(
        refused(|o| o.kernels.range = Kernel::Cauchy { c: 0.0 }),
        "kernels"
    );
    assert_eq!(refused(|_| ()), "none");
    let refused = |change: fn(&mut InteractingOptions)| {
        let mut options = InteractingOptions::default();
        change(&mut options);
        match InteractingTracker::new(prior(), options) {
            Err(SolveError::BadOption { name, .. }) => name,
            _ => "none",
        }
    };
    assert_eq!(refused(|o| o.turn_rad_s = 0.0), "turn_rad_s");
    assert_eq!(refused(|o| o.late_m = f64::INFINITY), "late_m");
    assert_eq!(refused(|o| o.outliers = 1.0), "outliers");
    assert_eq!(refused(|_| ()), "none");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever the directions, distances and times: beliefs stay finite, covariances are covariances.
    #[test]
    fn no_sightings_break_the_graph(
        seen in prop::collection::vec(
            (1e-3..2.0_f64, -3.2..3.2_f64, -1.6..1.6_f64, 1e-3..50.0_f64, -3.0..3.0_f64, 0..4_u8),
            1..120,
        ),
        graduated in any::<bool>(),
    ) {
        let options = GraphOptions {
            window: Some(20),
            graduation: graduated.then(Graduation::default),
            ..GraphOptions::robust()
        };
        let mut graph = TargetGraph::new(prior(), options).unwrap();
        let mut filter = TargetEkf::new(prior(), 1.0).unwrap();
        let mut models = interacting();
        let mut sighting = sightings(1, 0.0, 1)[0];
        for (dt_s, azimuth, elevation, range_m, moved, readings) in seen {
            sighting.t_s += dt_s;
            sighting.pose.position_m += Vector3::new(moved, -moved, 0.3 * moved);
            sighting.range = (readings & 1 == 0).then_some(nova_solver::tracking::Range {
                range_m,
                sigma_m: RANGE_SIGMA_M,
            });
            sighting.bearing = (readings & 2 == 0).then(|| {
                nova_solver::tracking::Bearing::from_angles(azimuth, elevation, BEARING_SIGMA)
            });
            graph.observe(&sighting).unwrap();
            filter.observe(&sighting).unwrap();
            models.observe(&sighting).unwrap();
            for belief in [graph.belief(), models.belief()] {
                prop_assert!(belief.is_sound());
                let least = belief.covariance().symmetric_eigenvalues().min();
                prop_assert!(least > -1e-9 * belief.covariance().norm(), "{least}");
            }
            prop_assert!((0.0..=1.0).contains(&models.blocked()));
            prop_assert!((0.0..=1.0).contains(&models.manoeuvring()));
            prop_assert!(filter.belief().is_sound());
            prop_assert!(graph.cost().is_finite());
        }
    }
}
