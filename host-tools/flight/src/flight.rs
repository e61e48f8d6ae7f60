//! One flight.

use crate::closed_loop;
use crate::methods::Method;
use crate::outcome::FlightResult;
use crate::recording::Recording;
use crate::replay::assess;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::uwb::{RangeSource, UwbLink};
use nova_solver::navigation::{FirstGuess, Navigator};

/// One flight to be made. The settings are taken as [valid](Settings::validate).
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Who navigates.
    pub method: Method,
    /// Everything else.
    pub settings: Settings,
    /// What chance depends on.
    pub seed: u64,
}

/// A navigator of this method at hand-over. It is told the first guess, but for methods that
/// [know better](Method::starts_from_truth) by definition.
pub fn begin(method: Method, settings: &Settings, scene: &Scene) -> Box<dyn Navigator> {
    let truth = FirstGuess { tag_m: scene.tag_m };
    let said = if method.starts_from_truth() {
        truth
    } else {
        scene.first_guess
    };
    method.navigator(settings, said)
}

/// Makes a flight; what it came to.
pub fn fly(trial: &Trial) -> FlightResult {
    fly_recorded(trial).0
}

/// Makes a flight; also what happened during it.
pub fn fly_recorded(trial: &Trial) -> (FlightResult, Recording) {
    fly_with(trial, &mut UwbLink::new(&trial.settings, trial.seed))
}

/// Makes a flight and shows it to another method that has no say in it; what that would have come to:
/// its error is that of the tag's place relative to the vehicle as it believes at the end, path and
/// time are the flight's.
pub fn fly_shown(trial: &Trial, shown_to: Method) -> FlightResult {
    let (_, recording) = fly_recorded(trial);
    let mut navigator = begin(shown_to, &trial.settings, &recording.scene);
    assess(&recording, &trial.settings, navigator.as_mut())
}

/// Makes a flight with ranges from elsewhere.
pub fn fly_with(trial: &Trial, ranges: &mut dyn RangeSource) -> (FlightResult, Recording) {
    let scene = Scene::new(&trial.settings, trial.seed);
    let mut navigator = begin(trial.method, &trial.settings, &scene);
    fly_navigator(
        &scene,
        &trial.settings,
        trial.seed,
        navigator.as_mut(),
        ranges,
    )
}

/// Makes a flight with any navigator. The settings are taken as [valid](Settings::validate).
pub fn fly_navigator(
    scene: &Scene,
    settings: &Settings,
    seed: u64,
    navigator: &mut dyn Navigator,
    ranges: &mut dyn RangeSource,
) -> (FlightResult, Recording) {
    let recording = closed_loop::run(scene, settings, seed, navigator, ranges);
    (FlightResult::of(&recording, settings), recording)
}
