//! One navigator and the vehicle it is heard by.

use super::lines::{self, Believed, News, Summary};
use super::pairing::Heard;
use crate::peer::Peer;
use nova_solver::navigation::{Action, InputFault, InsSample, Navigator, RangeSample};

/// A navigator for one node, and what it has been given.
pub(crate) struct Guided {
    peer: Peer,
    /// From the first range on whose place is known.
    navigator: Option<Box<dyn Navigator>>,
    ranges: u64,
    refused: u64,
    unpaired: u64,
    /// What the last line told: number of updates, command.
    told: Option<(u64, u32, Action)>,
}

impl Guided {
    pub(crate) fn new(peer: Peer) -> Self {
        Self {
            peer,
            navigator: None,
            ranges: 0,
            refused: 0,
            unpaired: 0,
            told: None,
        }
    }

    /// Hands a range and the vehicle's place to the navigator, which is made for the first.
    pub(crate) fn take(
        &mut self,
        place: InsSample,
        heard: &Heard,
        make: impl FnOnce() -> Box<dyn Navigator>,
        arrival_radius_m: f64,
    ) {
        let navigator = self.navigator.get_or_insert_with(make).as_mut();
        match offer(navigator, place, heard.range) {
            Ok(()) => self.ranges += 1,
            Err(_) => self.refused += 1,
        }
        notice_arrival(navigator, place, arrival_radius_m);
    }

    /// The navigator, from the first range on whose place is known.
    pub(crate) fn navigator(&self) -> Option<&dyn Navigator> {
        self.navigator.as_deref()
    }

    /// Counts a range without a place.
    pub(crate) fn pass_over(&mut self) {
        self.unpaired += 1;
    }

    /// What is new since it was last asked.
    pub(crate) fn news(&mut self, t_s: f64) -> Option<News<'_>> {
        let navigator = self.navigator.as_ref()?;
        let command = navigator.command();
        let state = (navigator.updates(), command.id, command.action);
        if self.told == Some(state) {
            return None;
        }
        self.told = Some(state);
        Some(News {
            t_s,
            peer: &self.peer,
            phase: lines::phase(navigator.phase()),
            estimate: navigator.estimate().as_ref().map(Believed::from),
            command: (&command).into(),
        })
    }

    pub(crate) fn summary(self) -> Summary {
        Summary {
            peer: self.peer,
            ranges: self.ranges,
            refused: self.refused,
            unpaired: self.unpaired,
            estimate: (self.navigator)
                .and_then(|navigator| navigator.estimate())
                .as_ref()
                .map(Believed::from),
        }
    }
}

fn offer(
    navigator: &mut dyn Navigator,
    place: InsSample,
    range: RangeSample,
) -> Result<(), InputFault> {
    navigator.on_ins(place)?;
    navigator.on_range(range)
}

/// The autopilot does not say when it has arrived; where the vehicle is does.
fn notice_arrival(navigator: &mut dyn Navigator, place: InsSample, radius_m: f64) {
    let command = navigator.command();
    let vehicle_m = place.position_m - command.ins_error.at(place.t_s);
    let away_m = (command.waypoint_m - vehicle_m).norm();
    if command.action == Action::Fly && away_m <= radius_m {
        navigator.on_arrival(command.id);
    }
}
