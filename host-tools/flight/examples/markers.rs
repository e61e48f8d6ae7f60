//! Who finds the landing marker in pictures, from how far, and how well? A judge for the crate `locus-core`.
//!
//! `cargo run --release -p nova-flight --example markers`, some minutes; with a folder as argument the pictures are also written there
//! (PGM, with `truth.csv`), for other detectors: `markers.py` beside this file asks OpenCV.
//!
//! The camera is that of the simulated delivery. Each picture shows the nested marker (0.8 m and 0.09 m) from a random place above it with
//! a random heading; markers that are not wholly in the picture are not asked for.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)] // an example

use locus_core::config::TagFamily;
use locus_core::{CameraIntrinsics, Detector, DetectorConfig, ImageView};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use nova_flight::camera::{Camera, Light, NestedMarker};
use nova_solver::delivery::Pose;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

const HEIGHTS_M: [f64; 14] = [
    0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0,
];
/// Pictures from each height, and of bare ground.
const PICTURES: u64 = 6;
const BARE: u64 = 40;
/// Sides of markers as they appear, pixels.
const SIDES_PX: [f64; 6] = [10.0, 15.0, 20.0, 30.0, 60.0, 150.0];
/// A marker whose corners are further off than this was not found, pixels.
const WRONG_PX: f64 = 5.0;

/// A camera, a lens, a light, a tilt.
struct Condition {
    name: &'static str,
    tilt_deg: f64,
    light: Light,
}

fn conditions() -> Vec<Condition> {
    let plain = Light::default();
    let with = |name, tilt_deg, light| Condition {
        name,
        tilt_deg,
        light,
    };
    vec![
        with("clear", 0.0, plain),
        with("tilt 10 deg", 10.0, plain),
        with("tilt 20 deg", 20.0, plain),
        with(
            "blur 2 px",
            0.0,
            Light {
                blur_px: 2.0,
                ..plain
            },
        ),
        with(
            "blur 4 px",
            0.0,
            Light {
                blur_px: 4.0,
                ..plain
            },
        ),
        with(
            "motion 4 px",
            0.0,
            Light {
                motion_px: 4,
                ..plain
            },
        ),
        with(
            "motion 8 px",
            0.0,
            Light {
                motion_px: 8,
                ..plain
            },
        ),
        with(
            "400 electrons",
            0.0,
            Light {
                electrons: 400.0,
                ..plain
            },
        ),
        with(
            "100 electrons",
            0.0,
            Light {
                electrons: 100.0,
                ..plain
            },
        ),
        with(
            "30 electrons",
            0.0,
            Light {
                electrons: 30.0,
                ..plain
            },
        ),
    ]
}

#[derive(Default, Clone, Copy)]
struct Tally {
    asked: u32,
    found: u32,
    squares_px2: f64,
    /// Of the place, in parts of the distance: across the view, along it.
    squares: [f64; 2],
}

#[derive(Default)]
struct Result {
    by_side: [Tally; SIDES_PX.len() + 1],
    /// Of any number, and of those that lie on the platform.
    false_ones: u32,
    false_as_ours: u32,
    pictures: u32,
    detecting_s: f64,
}

fn main() {
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let (camera, marker) = (Camera::default(), NestedMarker::default());
    let [width, height] = camera.size_px;
    let centre = [width, height].map(|side| 0.5 * side as f64);
    let intrinsics = CameraIntrinsics::new(camera.focal_px, camera.focal_px, centre[0], centre[1]);
    // One wrong bit is allowed, as by default: the small marker spoils one of the large one's.
    let mut detector = Detector::with_config(DetectorConfig::default());
    detector.set_families(&[TagFamily::ArUco4x4_50]);
    let mut truth = String::from("picture,condition,id,side_px,x0,y0,x1,y1,x2,y2,x3,y3\n");
    let mut number = 0;
    for (index, condition) in conditions().iter().enumerate() {
        let mut result = Result::default();
        let bare = if index == 0 { BARE } else { 0 };
        let views = (HEIGHTS_M.iter()).flat_map(|&height_m| (0..PICTURES).map(move |_| height_m));
        let views = views
            .map(|h| (h, true))
            .chain((0..bare).map(|k| (1.0 + k as f64, false)));
        for (view, (height_m, shown)) in views.enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(2025 + 1000 * index as u64 + view as u64);
            let pose = pose(height_m, condition.tilt_deg, &mut rng);
            let picture = camera.render(&pose, shown.then_some(&marker), rng.random());
            let bytes = condition.light.take(&picture, &mut rng);
            let image = ImageView::new(&bytes, width, height, width).unwrap();
            let begin = Instant::now();
            // Side 1: places come out in sides.
            let found = detector
                .detect(&image, Some(&intrinsics), Some(1.0), false)
                .unwrap();
            result.detecting_s += begin.elapsed().as_secs_f64();
            result.pictures += 1;
            let mut left: Vec<usize> = (0..found.ids.len()).collect();
            for (id, side_m) in [
                (NestedMarker::LARGE_ID, marker.large_m),
                (NestedMarker::SMALL_ID, marker.small_m),
            ] {
                let Some(corners) = in_view(&camera, &pose, &marker, id).filter(|_| shown) else {
                    // What is only partly in view may be found or not.
                    left.retain(|&k| found.ids[k] != id || !shown);
                    continue;
                };
                let side_px = (corners[0] - corners[2]).norm() / std::f64::consts::SQRT_2;
                let row: Vec<String> = corners
                    .iter()
                    .map(|c| format!("{:.3},{:.3}", c.x, c.y))
                    .collect();
                writeln!(
                    truth,
                    "{number},{},{id},{side_px:.2},{}",
                    condition.name,
                    row.join(",")
                )
                .unwrap();
                let bin = SIDES_PX.iter().take_while(|&&side| side_px >= side).count();
                let tally = &mut result.by_side[bin];
                tally.asked += 1;
                let best = (left.iter().copied().filter(|&k| found.ids[k] == id))
                    .map(|k| {
                        (
                            k,
                            off_px(
                                &found.corners[k]
                                    .map(|c| Vector2::new(f64::from(c.x), f64::from(c.y))),
                                &corners,
                            ),
                        )
                    })
                    .min_by(|a, b| a.1.total_cmp(&b.1))
                    .filter(|(_, off)| *off < WRONG_PX);
                if let Some((k, off)) = best {
                    left.retain(|&other| other != k);
                    tally.found += 1;
                    tally.squares_px2 += off * off;
                    let [x, y, z, ..] = found.poses[k].data.map(f64::from);
                    let centre_m = if id == NestedMarker::SMALL_ID {
                        marker.small_centre_m()
                    } else {
                        Vector2::zeros()
                    };
                    let mount = nova_solver::delivery::CameraMount::looking_down(Vector3::zeros());
                    let seen = mount.rotation.inverse()
                        * (pose.attitude.inverse() * (centre_m.push(0.0) - pose.position_m));
                    let error = (Vector3::new(x, y, z) * side_m - seen) / seen.z;
                    tally.squares[0] += 0.5 * error.xy().norm_squared();
                    tally.squares[1] += error.z * error.z;
                }
            }
            result.false_ones += left.len() as u32;
            result.false_as_ours += (left.iter())
                .filter(|&&k| marker.corners_m(found.ids[k]).is_some())
                .count() as u32;
            if let Some(folder) = &folder {
                let mut file = format!("P5 {width} {height} 255\n").into_bytes();
                file.extend(&bytes);
                std::fs::write(folder.join(format!("{number}.pgm")), file).unwrap();
            }
            number += 1;
        }
        print(condition.name, &result);
    }
    if let Some(folder) = &folder {
        std::fs::write(folder.join("truth.csv"), truth).unwrap();
    }
}

/// Above a place from which the small marker is likely in view, at least in part.
fn pose(height_m: f64, tilt_deg: f64, rng: &mut ChaCha8Rng) -> Pose {
    let aside = 0.25 * height_m;
    let angle = rng.random_range(0.0..std::f64::consts::TAU);
    let lean = UnitQuaternion::from_scaled_axis(
        Vector3::new(angle.cos(), angle.sin(), 0.0) * tilt_deg.to_radians(),
    );
    let heading = UnitQuaternion::from_scaled_axis(Vector3::z() * rng.random_range(-3.1..3.1));
    // Tilted, it looks to where the marker is.
    let looks_at = lean * heading * Vector3::new(0.0, 0.0, -height_m);
    let off = Vector2::new(
        rng.random_range(-aside..aside),
        rng.random_range(-aside..aside),
    );
    Pose {
        position_m: (off - looks_at.xy()).push(height_m),
        attitude: lean * heading,
    }
}

/// Corners of a marker that is wholly in view.
fn in_view(
    camera: &Camera,
    pose: &Pose,
    marker: &NestedMarker,
    id: u32,
) -> Option<[Vector2<f64>; 4]> {
    let [width, height] = camera.size_px.map(|side| side as f64);
    let margin = 3.0;
    let mut corners = marker.corners_m(id)?;
    for corner in &mut corners {
        *corner = camera.project(pose, *corner)?;
        let inside = (margin..width - margin).contains(&corner.x)
            && (margin..height - margin).contains(&corner.y);
        if !inside {
            return None;
        }
    }
    Some(corners)
}

/// Root mean square of the distances between corners in order, pixels.
fn off_px(found: &[Vector2<f64>; 4], corners: &[Vector2<f64>; 4]) -> f64 {
    let squares = found
        .iter()
        .zip(corners)
        .map(|(a, b)| (a - b).norm_squared());
    (squares.sum::<f64>() / 4.0).sqrt()
}

fn print(name: &str, result: &Result) {
    println!(
        "{name}: {} pictures, {} false ones, {} of them with a number of ours, {:.1} ms each",
        result.pictures,
        result.false_ones,
        result.false_as_ours,
        1e3 * result.detecting_s / f64::from(result.pictures)
    );
    for (k, tally) in result
        .by_side
        .iter()
        .enumerate()
        .filter(|(_, tally)| tally.asked > 0)
    {
        let from = if k == 0 { 0.0 } else { SIDES_PX[k - 1] };
        let to = SIDES_PX
            .get(k)
            .map_or_else(|| "-".to_owned(), |side| side.to_string());
        let found = f64::from(tally.found.max(1));
        println!(
            "  side {from:>4} to {to:>4} px: {:>3} of {:>3} found, corners {:.2} px, place {:.4} across and {:.4} along, parts of the distance",
            tally.found,
            tally.asked,
            (tally.squares_px2 / found).sqrt(),
            (tally.squares[0] / found).sqrt(),
            (tally.squares[1] / found).sqrt(),
        );
    }
}
