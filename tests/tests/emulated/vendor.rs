//! The vendor's compiled single-sided ranging examples: firmware that is not ours, as it lies in a public repository.

use super::channel;
use libtest_mimic::Failed;
use nova_emulator::{BoardConfig, Image};
use nova_hal_sim::Motion;
use nova_tests::EmulatedNetwork;
use std::path::Path;

/// Names the folder with `ss_twr_init.axf` and `ss_twr_resp.axf`; docs/emulator.md tells where they come from.
pub(super) const VARIABLE: &str = "NOVA_VENDOR_FIRMWARE";

const DISTANCE_M: f64 = 10.0;
/// The examples set antenna delays of their own, and compute in single precision.
const TOLERANCE_M: f64 = 0.5;
/// It polls once a second.
const SECONDS: f64 = 5.0;

pub(super) fn a_pair_prints_its_distance() -> Result<(), Failed> {
    let folder = std::env::var_os(VARIABLE).ok_or(format!("{VARIABLE} is not set"))?;
    let boards = [("init", 5.0, 0.0), ("resp", -5.0, DISTANCE_M)].map(|(name, ppm, x)| {
        let path = Path::new(&folder).join(format!("ss_twr_{name}.axf"));
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let mut board = BoardConfig::new(name, [1, 2]);
        board.chip.clock.ppm = ppm;
        board.chip.motion = Motion::fixed([x, 0.0, 0.0]);
        Ok::<_, Failed>((board, Image::parse(&bytes)?))
    });
    let boards = boards.into_iter().collect::<Result<Vec<_>, _>>()?;
    let mut network = EmulatedNetwork::new(5, channel(), boards)?;
    network.run_until_s(SECONDS)?;
    let said = &network.log("init").ok_or("no log")?.bytes;
    let said = String::from_utf8_lossy(said);
    println!("{said}");
    let distances: Vec<f64> = said
        .lines()
        .filter_map(|line| line.strip_prefix("Distance : ")?.trim().parse().ok())
        .collect();
    let right = |distance_m: &f64| (distance_m - DISTANCE_M).abs() < TOLERANCE_M;
    if distances.len() < 4 || !distances.iter().all(right) {
        return Err(format!("{distances:?} at {DISTANCE_M} m").into());
    }
    Ok(())
}
