//! Another navigator on a flight that has been made.

use crate::outcome::FlightResult;
use crate::recording::Recording;
use crate::settings::Settings;
use nova_solver::navigation::{Command, Navigator};

/// Feeds a recorded flight to a navigator that has no say in it (paper Fig. 13: all methods on one
/// trajectory). For each time of a range at which there was an estimate: that time, seconds, and the
/// horizontal error of the tag's place relative to the vehicle as believed then, metres.
///
/// Arrivals are passed on where the navigator had given the very command that the recorded vehicle
/// followed; so the recorded flight's own method finds what it found in flight.
pub fn replay(recording: &Recording, navigator: &mut dyn Navigator) -> Vec<(f64, f64)> {
    Replay::of(recording, navigator).errors
}

/// What a navigator would have come to at the end of a recorded flight: its error is that of the
/// tag's place as it believes; path and time are the flight's.
pub(crate) fn assess(
    recording: &Recording,
    settings: &Settings,
    navigator: &mut dyn Navigator,
) -> FlightResult {
    let replay = Replay::of(recording, navigator);
    let believed = replay.recording.estimates.last().map(|(_, estimate)| {
        let error = recording.relative_error_m(estimate, recording.end_s());
        error.norm()
    });
    let guess = recording.scene.first_guess.tag_m - recording.scene.tag_m;
    FlightResult {
        error_m: believed.unwrap_or_else(|| guess.xy().norm()),
        ..FlightResult::of(&replay.recording, settings)
    }
}

struct Replay {
    errors: Vec<(f64, f64)>,
    /// The flight, with this navigator's estimates instead of its own.
    recording: Recording,
}

impl Replay {
    fn of(recording: &Recording, navigator: &mut dyn Navigator) -> Self {
        let mut replay = Self {
            errors: Vec::with_capacity(recording.ins.len()),
            recording: Recording {
                estimates: Vec::new(),
                update_ms: Vec::new(),
                refused: 0,
                ..recording.clone()
            },
        };
        let mut ranges = recording.ranges.iter().peekable();
        let mut arrivals = recording.arrivals.iter().peekable();
        for &sample in &recording.ins {
            let now_s = sample.t_s;
            replay.recording.note(navigator.on_ins(sample));
            if let Some(&range) = ranges.next_if(|range| range.t_s <= now_s) {
                let tell = |navigator: &mut dyn Navigator| navigator.on_range(range);
                replay.recording.call(now_s, navigator, tell);
            }
            if let Some(estimate) = navigator.estimate() {
                let error = recording.relative_error_m(&estimate, now_s);
                replay.errors.push((now_s, error.norm()));
            }
            let until_s = next_sample_s(recording, now_s);
            while let Some((t_s, command)) = arrivals.next_if(|&&(t_s, _)| t_s < until_s) {
                if same_leg(command, &navigator.command()) {
                    replay.recording.call(*t_s, navigator, |navigator| {
                        navigator.on_arrival(command.id);
                        Ok(())
                    });
                }
            }
        }
        replay
    }
}

fn next_sample_s(recording: &Recording, t_s: f64) -> f64 {
    let next = recording.ins.partition_point(|sample| sample.t_s <= t_s);
    recording
        .ins
        .get(next)
        .map_or(f64::INFINITY, |sample| sample.t_s)
}

fn same_leg(a: &Command, b: &Command) -> bool {
    a.id == b.id && a.action == b.action && (a.waypoint_m - b.waypoint_m).norm() < 1e-6
}
