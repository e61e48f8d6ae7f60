//! What the simulation costs apart from navigators.

#[path = "../tests/common/mod.rs"]
mod common;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use nova_flight::{Preset, Scene, Settings, UwbLink, fly_navigator};

fn flight(criterion: &mut Criterion) {
    let settings = Settings {
        wind_xy: 0.3,
        wind_z: 0.1,
        ..Settings::preset(Preset::R)
    };
    let scene = Scene::new(&settings, 1);
    let over_tag = Vector3::new(0.0, 0.0, settings.altitude_m);
    criterion.bench_function(
        "51 s of flight over one waypoint, with its bound",
        |bencher| {
            bencher.iter(|| {
                let mut navigator = common::Legs::new(vec![over_tag]);
                let mut ranges = UwbLink::new(&settings, 1);
                fly_navigator(&scene, &settings, 1, &mut navigator, &mut ranges).0
            });
        },
    );
}

criterion_group!(benches, flight);
criterion_main!(benches);
