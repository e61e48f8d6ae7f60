//! Whom an initiator polls next.

use nova_ranging::{Address, MAX_RESPONDERS};

/// Most peers that one initiator polls.
pub const MAX_PEERS: usize = 8;

/// A peer that was found is dropped after this many rounds in a row without a range.
const FAILURES_TO_DROP: u8 = 50;

/// After so many rounds with known peers one has a slot open to nodes that are not known.
const SEARCH_AFTER: u8 = 15;

/// Open slots while nobody is known.
const OPEN_AT_FIRST: usize = 2;

/// The peers of an initiator, polled in turn, several in a round.
#[derive(Clone, Debug)]
pub(crate) struct Peers {
    known: heapless::Vec<Peer, MAX_PEERS>,
    /// Most of them in one round.
    per_round: usize,
    /// Index into `known` of the next.
    next: usize,
    /// Whether peers come and go, or are configured.
    search: bool,
    /// Rounds until the next with an open slot.
    until_search: u8,
}

#[derive(Clone, Copy, Debug)]
struct Peer {
    address: Address,
    failures: u8,
}

/// Whom a round is with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Plan {
    /// Peers, in the order of their slots.
    pub(crate) named: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Slots for nodes that are not known.
    pub(crate) open: usize,
}

impl Peers {
    /// These peers for ever, or whoever is found if there are none.
    pub(crate) fn new(configured: &[Address], per_round: u8) -> Self {
        let known: heapless::Vec<Peer, MAX_PEERS> = configured
            .iter()
            .take(MAX_PEERS)
            .map(|&address| Peer {
                address,
                failures: 0,
            })
            .collect();
        Self {
            search: known.is_empty(),
            known,
            per_round: usize::from(per_round).clamp(1, MAX_RESPONDERS),
            next: 0,
            until_search: 0,
        }
    }

    /// Slots that a round has as a rule.
    pub(crate) fn slots(&self) -> usize {
        self.per_round.min(self.known.len()).max(1)
    }

    /// Whom to poll now, in at most `most` slots. With nobody known all are open.
    pub(crate) fn next_round(&mut self, most: usize) -> Plan {
        let most = most.max(1);
        let per_round = self.per_round.min(most);
        let searches = self.search && !self.known.is_full();
        let mut open = 0;
        if searches && self.known.is_empty() {
            open = OPEN_AT_FIRST.min(most);
        } else if searches {
            if self.until_search > 0 {
                self.until_search -= 1;
            } else if most > 1 {
                self.until_search = SEARCH_AFTER;
                open = 1;
            }
        }
        // An open slot takes the place of a peer where the round would get too long.
        let room = (per_round.max(2) - open.min(1)).min(per_round);
        let mut named = heapless::Vec::new();
        for _ in 0..room.min(self.known.len()) {
            let index = if self.next < self.known.len() {
                self.next
            } else {
                0
            };
            self.next = index + 1;
            if let Some(peer) = self.known.get(index) {
                // There is room: `per_round` is at most that.
                let _ = named.push(peer.address);
            }
        }
        Plan { named, open }
    }

    /// A measurement with `peer` gave a range.
    pub(crate) fn answered(&mut self, peer: Address) {
        match self.known.iter_mut().find(|p| p.address == peer) {
            Some(known) => known.failures = 0,
            // A full list takes no more: `next_round` then stops searching.
            None if self.search => {
                let _ = self.known.push(Peer {
                    address: peer,
                    failures: 0,
                });
            }
            None => {}
        }
    }

    /// A measurement with `peer` failed.
    pub(crate) fn failed(&mut self, peer: Address) {
        let Some(index) = self.known.iter().position(|p| p.address == peer) else {
            return;
        };
        let Some(known) = self.known.get_mut(index) else {
            return;
        };
        known.failures = known.failures.saturating_add(1);
        if self.search && known.failures >= FAILURES_TO_DROP {
            self.known.remove(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Address = Address(1);
    const B: Address = Address(2);
    const C: Address = Address(3);

    fn plan(named: &[Address], open: usize) -> Plan {
        Plan {
            named: named.iter().copied().collect(),
            open,
        }
    }

    #[test]
    fn configured_peers_are_polled_in_turn_and_never_dropped() {
        let mut peers = Peers::new(&[A, B, C], 2);
        for _ in 0..100 {
            for pair in [[A, B], [C, A], [B, C]] {
                assert_eq!(peers.next_round(8), plan(&pair, 0));
                pair.iter().for_each(|&peer| peers.failed(peer));
            }
        }
    }

    #[test]
    fn who_has_no_room_in_a_short_round_is_first_in_the_next() {
        let mut peers = Peers::new(&[A, B, C], 3);
        assert_eq!(peers.next_round(2), plan(&[A, B], 0));
        assert_eq!(peers.next_round(3), plan(&[C, A, B], 0));
        assert_eq!(peers.next_round(0), plan(&[C], 0));
    }

    #[test]
    fn a_round_names_nobody_twice() {
        let mut peers = Peers::new(&[A, B], 8);
        for _ in 0..10 {
            assert_eq!(peers.next_round(8), plan(&[A, B], 0));
        }
    }

    #[test]
    fn without_peers_all_slots_are_open_until_one_answers() {
        let mut peers = Peers::new(&[], 4);
        assert!((0..40).all(|_| peers.next_round(8) == plan(&[], OPEN_AT_FIRST)));
        peers.answered(A);
        let plans: heapless::Vec<_, 128> = (0..128).map(|_| peers.next_round(8)).collect();
        assert!(plans.iter().all(|plan| plan.named == [A]));
        assert_eq!(plans.iter().filter(|plan| plan.open == 1).count(), 8);
    }

    #[test]
    fn an_open_slot_does_not_lengthen_a_full_round() {
        let mut peers = Peers::new(&[], 2);
        [A, B, C].iter().for_each(|&peer| peers.answered(peer));
        for _ in 0..200 {
            let Plan { named, open } = peers.next_round(8);
            assert_eq!(named.len() + open, 2);
        }
    }

    #[test]
    fn a_found_peer_that_is_gone_is_dropped() {
        let mut peers = Peers::new(&[], 4);
        peers.answered(A);
        peers.answered(B);
        for _ in 0..FAILURES_TO_DROP {
            peers.failed(A);
        }
        assert!((0..100).all(|_| peers.next_round(8).named == [B]));
    }

    #[test]
    fn a_full_list_stops_the_search() {
        let mut peers = Peers::new(&[], 4);
        for k in 0..MAX_PEERS as u16 {
            peers.answered(Address(k));
        }
        peers.answered(Address(99));
        assert!((0..100).all(|_| {
            let plan = peers.next_round(8);
            plan.open == 0 && plan.named.iter().all(|peer| peer.0 < MAX_PEERS as u16)
        }));
    }
}
