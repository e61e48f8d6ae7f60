//! The paper's Tables 3 to 8, flown again: its methods and ours on the same logs.

use nalgebra::{Matrix3, Vector3};
use nova_solver::fusion::FusionAnchor;
use nova_solver::multilateration::Height;
use nova_solver::survey::{AnchorRanges, SurveyOptions, Track, as_measured, inverted_uwb, survey};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::anchors_m;
use super::bound::survey_bound;
use super::log::{Air, Log, Receiver};
use super::navigation::{Errors, Method, RANGE_SIGMA_M, navigate, positions_of_uwb};
use super::path::{Moment, Route, path};
use crate::streams::{normal, trial_seed};

/// One line of a table: numbers in the order of the paper's columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Number of the table in the paper.
    pub table: u8,
    /// What the line is about.
    pub name: String,
    /// Names of the numbers.
    pub columns: &'static [&'static str],
    /// The paper's; empty where it has none.
    pub theirs: Vec<f64>,
    /// Mean over the seeds (root mean square for RMSE columns).
    pub here: Vec<f64>,
}

/// The tables.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Lines.
    pub rows: Vec<Row>,
    /// Normalised innovation squared of the third flight's ranges in the tight filter without blocked
    /// paths: mean over all, and how many. 1 where the filter is honest.
    pub nis: (f64, usize),
    /// Seeds of which a survey or fix failed and which are left out.
    pub failed: usize,
}

const ENU: &[&str] = &["E (m)", "N (m)", "U (m)"];
const BOTH: &[&str] = &["horizontal (m)", "vertical (m)"];
const FULL: &[&str] = &["RMSE h (m)", "RMSE v (m)", "max h (m)", "max v (m)"];

/// Runs the experiment with so many seeds.
pub fn run_experiment(seeds: u64, base_seed: u64) -> Report {
    let paths = Route::ALL.map(path);
    let trials: Vec<Option<Trial>> = (0..seeds)
        .into_par_iter()
        .map(|trial| Trial::run(&paths, trial_seed(base_seed, trial)))
        .collect();
    let failed = trials.iter().filter(|trial| trial.is_none()).count();
    let good: Vec<&Trial> = trials.iter().flatten().collect();
    let mut rows = good
        .first()
        .map_or_else(Vec::new, |first| first.rows.clone());
    for (k, row) in rows.iter_mut().enumerate() {
        for (c, value) in row.here.iter_mut().enumerate() {
            let of = |trial: &&Trial| trial.rows.get(k).and_then(|row| row.here.get(c)).copied();
            let values: Vec<f64> = good
                .iter()
                .filter_map(of)
                .filter(|v| v.is_finite())
                .collect();
            let n = values.len().max(1) as f64;
            let is_max = row
                .columns
                .get(c)
                .is_some_and(|name| name.starts_with("max"));
            *value = if row.table <= 5 || is_max {
                values.iter().sum::<f64>() / n
            } else {
                (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt()
            };
        }
    }
    rows.sort_by_key(|row| row.table);
    let nis: Vec<f64> = good.iter().flat_map(|trial| &trial.nis).copied().collect();
    Report {
        rows,
        nis: (nis.iter().sum::<f64>() / nis.len().max(1) as f64, nis.len()),
        failed,
    }
}

struct Trial {
    rows: Vec<Row>,
    nis: Vec<f64>,
}

/// Anchors as a method has them, and what it knows of the ranges' clock and slope.
struct Site {
    anchors: Vec<FusionAnchor>,
    lag_and_slope: [f64; 2],
}

impl Trial {
    fn run(paths: &[Vec<Moment>; 3], seed: u64) -> Option<Self> {
        let air = [0, 1, 2].map(Air::of_flight);
        let log = |flight: usize| {
            Log::new(
                &paths[flight],
                &air[flight],
                seed,
                trial_seed(seed, 1 + flight as u64),
            )
        };
        let logs = [log(0), log(1), log(2)];
        let truth = anchors_m();
        let mut rows = Vec::new();
        let mut say = |table: u8, name: String, columns, theirs: &[f64], here: Vec<f64>| {
            rows.push(Row {
                table,
                name,
                columns,
                theirs: theirs.to_vec(),
                here,
            });
        };

        // Tables 2 and 3: the survey by flight.
        let one_by_one = [0, 1, 2].map(|flight| surveyed_one_by_one(&logs[flight], 0));
        let [Some(first), Some(second), Some(third)] = &one_by_one else {
            return None;
        };
        let joint = [0, 1, 2].map(|flight| surveyed_jointly(&logs[flight], 0));
        let [Some(joint_first), Some(joint_second), Some(joint_third)] = &joint else {
            return None;
        };
        let theirs = [[7.72, 0.70, 4.18], [8.32, 0.82, 3.22]];
        for (k, found) in [first, second].into_iter().enumerate() {
            let name = format!("flight {}, one by one, against the third flight's", k + 1);
            say(3, name, ENU, &theirs[k], apart(found, &places(third)));
        }
        for (k, (alone, together)) in [
            (first, joint_first),
            (second, joint_second),
            (third, joint_third),
        ]
        .into_iter()
        .enumerate()
        {
            let name = |how| format!("flight {}, {how}, against the truth", k + 1);
            say(3, name("one by one"), ENU, &[], apart(alone, &truth));
            say(3, name("all at once"), ENU, &[], apart(together, &truth));
            if let Some(bound) = survey_bound(&paths[k], Receiver::ALL[0].rms_m, &air[k]) {
                say(3, name("bound"), ENU, &[], bound.to_vec());
            }
        }

        // Tables 4 and 5: the survey by receiver, third flight.
        let table_4 = [[6.04, 6.65], [3.29, 3.66]];
        let table_5 = [[4.47, 2.50, 6.25], [2.54, 1.14, 3.67]];
        for receiver in [1, 2] {
            let name = Receiver::ALL[receiver].name;
            let track = &logs[2].tracks[receiver];
            say(
                4,
                name.to_owned(),
                BOTH,
                &table_4[receiver - 1],
                track_error(track, &paths[2]),
            );
            let alone = surveyed_one_by_one(&logs[2], receiver)?;
            let text = format!("{name}, one by one, against PwrPak7's");
            say(
                5,
                text,
                ENU,
                &table_5[receiver - 1],
                apart(&alone, &places(third)),
            );
            let together = surveyed_jointly(&logs[2], receiver)?;
            let text = format!("{name}, all at once, against PwrPak7's");
            say(5, text, ENU, &[], apart(&together, &places(joint_third)));
            if let Some(bound) = survey_bound(&paths[2], Receiver::ALL[receiver].rms_m, &air[2]) {
                say(5, format!("{name}, bound"), ENU, &[], bound.to_vec());
            }
        }

        // Tables 6 and 7: navigation in the anchored area.
        let fly = |method, flight: usize, site: &Site| {
            let (positions, _) = navigate(method, &logs[flight], &site.anchors, site.lag_and_slope);
            let e = Errors::of(&positions, &paths[flight], true);
            vec![e.rmse_m[0], e.rmse_m[1], e.max_m[0], e.max_m[1]]
        };
        let loose = Method::Loose {
            without_blocked: false,
        };
        let tight = Method::Tight { judge_ranges: true };
        let table_6 = [
            [[2.00, 4.17, 4.90, 13.94], [2.13, 3.93, 8.81, 13.94]],
            [[2.42, 5.74, 6.29, 15.54], [1.63, 2.90, 5.91, 13.97]],
            [[5.26, 14.62, 8.81, 23.58], [0.56, 0.70, 2.03, 4.49]],
        ];
        for (flight, [gnss, with_uwb]) in table_6.iter().enumerate() {
            let name = |what| format!("flight {}, {what}", flight + 1);
            say(
                6,
                name("GNSS/INS"),
                FULL,
                gnss,
                fly(Method::GnssIns, flight, third),
            );
            say(6, name("loose"), FULL, with_uwb, fly(loose, flight, third));
            say(
                6,
                name("tight, joint survey"),
                FULL,
                &[],
                fly(tight, flight, joint_third),
            );
        }
        let by_hand = Method::Loose {
            without_blocked: true,
        };
        let unjudged = Method::Tight {
            judge_ranges: false,
        };
        let name = |what: &str| format!("flight 1, {what}");
        say(
            7,
            name("loose, all ranges"),
            FULL,
            &[2.13, 3.93, 8.81, 13.94],
            fly(loose, 0, third),
        );
        say(
            7,
            name("loose, blocked taken out by hand"),
            FULL,
            &[1.94, 3.64, 4.87, 10.47],
            fly(by_hand, 0, third),
        );
        say(
            7,
            name("tight, every range as it is"),
            FULL,
            &[],
            fly(unjudged, 0, joint_third),
        );
        say(
            7,
            name("tight, judged live"),
            FULL,
            &[],
            fly(tight, 0, joint_third),
        );

        // Table 8: UWB alone, by where its anchors came from.
        let by_gnss = placed_by_gnss(seed);
        let table_8 = [
            [[1.19, 4.84], [0.37, 0.64]],
            [[1.49, 3.35], [0.41, 0.56]],
            [[1.32, 4.54], [0.46, 0.51]],
        ];
        for (flight, [gnss, estimated]) in table_8.iter().enumerate() {
            let alone = |site: &Site, judge_ranges| {
                let positions = positions_of_uwb(&logs[flight], &site.anchors, judge_ranges);
                let late = positions
                    .into_iter()
                    .map(|(t, p, c)| (t - site.lag_and_slope[0], p, c));
                Errors::of(&late.collect(), &paths[flight], true)
                    .rmse_m
                    .to_vec()
            };
            let name = |what| format!("flight {}, UWB alone, anchors {what}", flight + 1);
            say(8, name("by GNSS"), BOTH, gnss, alone(&by_gnss, false));
            say(8, name("one by one"), BOTH, estimated, alone(third, false));
            say(
                8,
                name("all at once, ranges judged"),
                BOTH,
                &[],
                alone(joint_third, true),
            );
        }

        let clear = Air {
            blocked_rate_hz: 0.0,
            ..air[2]
        };
        let log = Log::new(&paths[2], &clear, seed, trial_seed(seed, 9));
        let site = surveyed_jointly(&log, 0)?;
        let (_, nis) = navigate(tight, &log, &site.anchors, site.lag_and_slope);
        Some(Self { rows, nis })
    }
}

/// The paper's survey: no bias, no lag, no covariance.
fn surveyed_one_by_one(log: &Log, receiver: usize) -> Option<Site> {
    let track = Track::new(&log.tracks[receiver]).ok()?;
    let anchors = log
        .survey_ranges(0.1)
        .iter()
        .map(|ranges| {
            let found = inverted_uwb(&as_measured(&track, ranges, 1.0)).ok()?;
            Some(FusionAnchor {
                position_m: found.position_m,
                covariance_m2: Matrix3::zeros(),
                bias_m: 0.0,
                bias_sigma_m: 0.0,
                position_bias_m2: Vector3::zeros(),
                range_sigma_m: RANGE_SIGMA_M,
            })
        })
        .collect::<Option<Vec<_>>>()?;
    Some(Site {
        anchors,
        lag_and_slope: [0.0; 2],
    })
}

fn surveyed_jointly(log: &Log, receiver: usize) -> Option<Site> {
    let track = Track::new(&log.tracks[receiver]).ok()?;
    let ranges = log.survey_ranges(0.1);
    let parts: Vec<_> = ranges
        .iter()
        .map(|ranges| AnchorRanges {
            ranges,
            height: Height::Unknown,
        })
        .collect();
    let [horizontal, vertical] = Receiver::ALL[receiver].rms_m;
    let options = SurveyOptions {
        track_sigma_m: horizontal.hypot(vertical) / 3f64.sqrt(),
        ..SurveyOptions::default()
    };
    let found = survey(&track, &parts, &options).ok()?;
    Some(Site {
        anchors: (found.anchors.iter())
            .map(|anchor| FusionAnchor {
                position_m: anchor.found.position_m,
                covariance_m2: anchor.found.covariance_m2,
                bias_m: anchor.found.range_bias_m,
                bias_sigma_m: anchor.found.range_bias_sigma_m,
                position_bias_m2: anchor.found.position_bias_m2,
                range_sigma_m: anchor.found.residual_rms_m,
            })
            .collect(),
        lag_and_slope: [found.common.lag_s, found.common.slope],
    })
}

/// Anchors where GNSS beside buildings puts them: 1.5 m along each horizontal axis, 4 m in height.
fn placed_by_gnss(seed: u64) -> Site {
    let mut rng = ChaCha8Rng::seed_from_u64(trial_seed(seed, 77));
    let anchors = anchors_m().map(|place| {
        let off = Vector3::new(
            1.5 * normal(&mut rng),
            1.5 * normal(&mut rng),
            4.0 * normal(&mut rng),
        );
        FusionAnchor {
            position_m: place + off,
            covariance_m2: Matrix3::zeros(),
            bias_m: 0.0,
            bias_sigma_m: 0.0,
            position_bias_m2: Vector3::zeros(),
            range_sigma_m: RANGE_SIGMA_M,
        }
    });
    Site {
        anchors: anchors.to_vec(),
        lag_and_slope: [0.0; 2],
    }
}

fn places(site: &Site) -> Vec<Vector3<f64>> {
    site.anchors
        .iter()
        .map(|anchor| anchor.position_m)
        .collect()
}

/// Mean absolute difference over the anchors along each axis, metres.
fn apart(site: &Site, reference: &[Vector3<f64>]) -> Vec<f64> {
    let n = reference.len().max(1) as f64;
    let sum = (site.anchors.iter().zip(reference))
        .map(|(anchor, place)| (anchor.position_m - place).abs())
        .sum::<Vector3<f64>>();
    (sum / n).iter().copied().collect()
}

fn track_error(track: &[nova_solver::survey::TrackPoint], path: &[Moment]) -> Vec<f64> {
    let positions = track
        .iter()
        .map(|p| (p.t_s, p.position_m, Matrix3::zeros()))
        .collect();
    Errors::of(&positions, path, false).rmse_m.to_vec()
}
