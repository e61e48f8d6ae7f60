//! What an update of the MAP navigator takes from the heap. A program of its own, because the
//! counting allocator serves all of it.

mod vehicle;

use nova_solver::map::{MapNavigator, MapOptions};
use nova_solver::navigation::{FirstGuess, Navigator};
use vehicle::{Vehicle, World};

/// Least time between searches for other explanations (`map/navigator.rs`), which may allocate.
const SEARCHES_S: f64 = 0.5;
/// How often a flight may come to see the last metres in another light (`map/mixture.rs`).
const MOST_BEGINNINGS: u32 = 3;
/// From when on everything has its final size.
const WARM_S: f64 = 20.0;

#[test]
fn updates_between_searches_for_other_explanations_allocate_nothing() {
    let world = World::paper();
    let guess = FirstGuess {
        tag_m: world.guess_m,
    };
    let mut navigator = MapNavigator::new(guess, MapOptions::default());
    let mut vehicle = Vehicle::new(world, 1);
    let mut last_s = f64::NEG_INFINITY;
    let mut beginnings = 0;
    let mut in_the_air = true;
    while in_the_air {
        let tick = vehicle.obey(&navigator.command());
        let taken = allocation_counter::measure(|| {
            navigator.on_ins(tick.ins).unwrap();
            navigator.on_range(tick.range).unwrap();
        });
        let t_s = tick.range.t_s;
        if t_s > WARM_S && taken.count_total > 0 {
            if t_s - last_s > SEARCHES_S - 0.05 {
                last_s = t_s;
            } else {
                // The last metres begin with a posterior of their own, and may begin anew.
                beginnings += 1;
                assert!(beginnings <= MOST_BEGINNINGS, "{last_s} s, {t_s} s");
            }
        }
        in_the_air = tick.vehicle_m.z > world.tag_m.z;
        assert!(t_s < 150.0, "still in the air");
    }
}
