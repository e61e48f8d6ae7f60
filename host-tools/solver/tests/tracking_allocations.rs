//! What following a target takes from the heap. A program of its own, because the counting allocator
//! serves all of it.
#![allow(clippy::unwrap_used)]

mod target;

use nova_solver::tracking::{
    GraphOptions, InteractingOptions, InteractingTracker, TargetGraph, Tracker,
};
use target::{prior, sightings};

#[test]
fn an_hour_at_20_hz_takes_nothing_from_the_heap() {
    const HOUR: usize = 72_000;
    let log = sightings(HOUR, 0.1, 8100);
    let mut graph = TargetGraph::new(prior(), GraphOptions::robust()).unwrap();
    let mut models = InteractingTracker::new(prior(), InteractingOptions::default()).unwrap();
    let taken = allocation_counter::measure(|| {
        for sighting in &log {
            graph.observe(sighting).unwrap();
            models.observe(sighting).unwrap();
        }
    });
    assert_eq!(taken.count_total, 0);
    assert_eq!(graph.states().len(), 64);
    assert_eq!(graph.counts().used, HOUR as u64);
    assert_eq!(models.counts().used, HOUR as u64);
}
