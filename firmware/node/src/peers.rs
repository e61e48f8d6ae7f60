//! Whom an initiator polls next.

use nova_ranging::{Address, MAX_RESPONDERS};

/// Most peers that one initiator polls.
pub const MAX_PEERS: usize = 8;

/// A peer that was found is dropped when it has given no range for so long, whatever the rate ...
const DROP_AFTER_US: u64 = 3_000_000;

/// ... and in so many rounds, where there is less than one a second.
const DROP_AFTER_FAILURES: u8 = 3;

/// Where nobody is missing or new, so many rounds pass from one with a slot open to nodes that are not known to the next.
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
    /// Rounds from there to the next but one: where one was found there are often others, and who was dropped
    /// may come back. One more after each search that finds nobody.
    pause: u8,
}

#[derive(Clone, Copy, Debug)]
struct Peer {
    address: Address,
    /// When it gave a range last, on the board's clock.
    measured_us: u64,
    /// How often it has given none since.
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
                measured_us: 0,
                failures: 0,
            })
            .collect();
        Self {
            search: known.is_empty(),
            known,
            per_round: usize::from(per_round).clamp(1, MAX_RESPONDERS),
            next: 0,
            until_search: 0,
            pause: 0,
        }
    }

    /// Slots that a round has as a rule.
    pub(crate) fn slots(&self) -> usize {
        self.per_round.min(self.known.len()).max(1)
    }

    /// Whether there is one peer and nobody else is looked for.
    pub(crate) fn is_one(&self) -> bool {
        self.known.len() == 1 && !self.search
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
                self.pause = (self.pause + 1).min(SEARCH_AFTER);
                self.until_search = self.pause;
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

    /// A measurement with `peer` gave a range at `now_us`.
    pub(crate) fn answered(&mut self, peer: Address, now_us: u64) {
        match self.known.iter_mut().find(|p| p.address == peer) {
            Some(known) => (known.measured_us, known.failures) = (now_us, 0),
            // A full list takes no more: `next_round` then stops searching.
            None if self.search => {
                let _ = self.known.push(Peer {
                    address: peer,
                    measured_us: now_us,
                    failures: 0,
                });
                self.search_soon();
            }
            None => {}
        }
    }

    /// A measurement with `peer` failed at `now_us`.
    pub(crate) fn failed(&mut self, peer: Address, now_us: u64) {
        let Some(index) = self.known.iter().position(|p| p.address == peer) else {
            return;
        };
        let Some(known) = self.known.get_mut(index) else {
            return;
        };
        known.failures = known.failures.saturating_add(1);
        let gone = known.failures >= DROP_AFTER_FAILURES
            && now_us.saturating_sub(known.measured_us) >= DROP_AFTER_US;
        if self.search && gone {
            self.known.remove(index);
            self.search_soon();
        }
    }

    fn search_soon(&mut self) {
        (self.until_search, self.pause) = (0, 0);
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
        for k in 0..100 {
            for pair in [[A, B], [C, A], [B, C]] {
                assert_eq!(peers.next_round(8), plan(&pair, 0));
                pair.iter()
                    .for_each(|&peer| peers.failed(peer, k * 1_000_000));
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
        peers.answered(A, 0);
        assert!((0..128).all(|_| peers.next_round(8).named == [A]));
    }

    /// Which of the next rounds have an open slot.
    fn searches(peers: &mut Peers, rounds: usize) -> heapless::Vec<usize, 256> {
        (0..rounds)
            .filter(|_| peers.next_round(8).open == 1)
            .collect()
    }

    #[test]
    fn searches_that_find_nobody_become_rare_and_one_that_does_is_followed_by_others() {
        let mut peers = Peers::new(&[], 4);
        let at_once = [0, 2, 5, 9, 14, 20];
        peers.answered(A, 0);
        assert_eq!(searches(&mut peers, 22), at_once);
        let later = searches(&mut peers, 256);
        assert!(
            later
                .windows(2)
                .skip(10)
                .all(|pair| pair[1] - pair[0] == 16)
        );
        peers.answered(B, 0);
        assert_eq!(searches(&mut peers, 22), at_once);
        // Known peers change nothing, one that is dropped does.
        (0..40).for_each(|_| drop(peers.next_round(8)));
        peers.answered(A, 0);
        let rare = searches(&mut peers, 22);
        assert!(rare.len() < 3, "{rare:?}");
        (0..3).for_each(|_| peers.failed(B, 9_000_000));
        assert_eq!(searches(&mut peers, 22), at_once);
    }

    #[test]
    fn an_open_slot_does_not_lengthen_a_full_round() {
        let mut peers = Peers::new(&[], 2);
        [A, B, C].iter().for_each(|&peer| peers.answered(peer, 0));
        for _ in 0..200 {
            let Plan { named, open } = peers.next_round(8);
            assert_eq!(named.len() + open, 2);
        }
    }

    #[test]
    fn a_found_peer_is_dropped_after_three_seconds_without_a_range_and_not_before() {
        let mut peers = Peers::new(&[], 4);
        peers.answered(A, 0);
        peers.answered(B, 0);
        peers.answered(A, 1_000_000);
        (1_000_001..1_001_000).for_each(|now_us| peers.failed(A, now_us));
        peers.failed(A, 3_999_999);
        assert_eq!(peers.next_round(8).named, [A, B]);
        peers.failed(A, 4_000_000);
        assert!((0..100).all(|_| peers.next_round(8).named == [B]));
    }

    #[test]
    fn where_rounds_are_rare_one_or_two_losses_drop_nobody() {
        let mut peers = Peers::new(&[], 4);
        for lost in [1, 2, 1, 2] {
            peers.answered(A, 0);
            (1..=lost).for_each(|k| peers.failed(A, k * 10_000_000));
            assert_eq!(peers.next_round(8).named, [A]);
        }
        peers.failed(A, 30_000_000);
        assert!(peers.next_round(8).named.is_empty());
    }

    #[test]
    fn a_full_list_stops_the_search() {
        let mut peers = Peers::new(&[], 4);
        for k in 0..MAX_PEERS as u16 {
            peers.answered(Address(k), 0);
        }
        peers.answered(Address(99), 0);
        assert!((0..100).all(|_| {
            let plan = peers.next_round(8);
            plan.open == 0 && plan.named.iter().all(|peer| peer.0 < MAX_PEERS as u16)
        }));
    }
}
