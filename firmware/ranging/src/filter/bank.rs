//! A filter for each peer.

use super::{Estimate, FilterSettings, RawRange, Track, Treatment, update};
use crate::frame::Address;

/// Filters for up to `N` peers. One peer more takes the place of the one
/// heard from least recently.
#[derive(Clone, Debug)]
pub struct FilterBank<const N: usize> {
    settings: FilterSettings,
    filters: heapless::Vec<Entry, N>,
}

#[derive(Clone, Debug)]
struct Entry {
    peer: Address,
    track: Option<Track>,
    heard_us: u64,
}

impl<const N: usize> FilterBank<N> {
    /// A bank that knows no peer yet.
    pub const fn new(settings: FilterSettings) -> Self {
        Self {
            settings,
            filters: heapless::Vec::new(),
        }
    }

    /// [`RangeFilter::update`](super::RangeFilter::update) of the filter for `peer`.
    pub fn update(&mut self, peer: Address, raw: &RawRange) -> (Treatment, Option<Estimate>) {
        let settings = self.settings;
        match self.entry(peer) {
            Some(entry) => {
                entry.heard_us = raw.at_us;
                update(&mut entry.track, &settings, raw)
            }
            // A bank without places: every range is the first.
            None => update(&mut None, &settings, raw),
        }
    }

    fn entry(&mut self, peer: Address) -> Option<&mut Entry> {
        let known = self.filters.iter().position(|entry| entry.peer == peer);
        let place = match known {
            Some(place) => place,
            None => {
                let fresh = Entry {
                    peer,
                    track: None,
                    heard_us: 0,
                };
                match self.filters.push(fresh) {
                    Ok(()) => self.filters.len().saturating_sub(1),
                    Err(fresh) => {
                        let by_age = self.filters.iter().enumerate();
                        let (oldest, _) = by_age.min_by_key(|(_, entry)| entry.heard_us)?;
                        *self.filters.get_mut(oldest)? = fresh;
                        oldest
                    }
                }
            }
        };
        self.filters.get_mut(place)
    }
}
