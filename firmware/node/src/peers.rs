//! Whom an initiator polls next.

use nova_ranging::Address;

/// Most peers that one initiator polls.
pub const MAX_PEERS: usize = 8;

/// A peer that was found is dropped after this many exchanges in a row failed.
const FAILURES_TO_DROP: u8 = 50;

/// After so many exchanges with known peers one goes to all nodes, to find new
/// ones.
const SEARCH_AFTER: u8 = 63;

/// The peers of an initiator, polled in turn.
#[derive(Clone, Debug)]
pub(crate) struct Peers {
    known: heapless::Vec<Peer, MAX_PEERS>,
    /// Index into `known` of the next.
    next: usize,
    /// Whether peers come and go, or are configured.
    search: bool,
    /// Exchanges until the next poll to all nodes.
    until_search: u8,
}

#[derive(Clone, Copy, Debug)]
struct Peer {
    address: Address,
    failures: u8,
}

impl Peers {
    /// These peers for ever, or whoever is found if there are none.
    pub(crate) fn new(configured: &[Address]) -> Self {
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
            next: 0,
            until_search: 0,
        }
    }

    /// Whom to poll now: a peer, or all nodes.
    pub(crate) fn next(&mut self) -> Address {
        if self.search && !self.known.is_full() {
            if self.until_search == 0 {
                self.until_search = SEARCH_AFTER;
                return Address::BROADCAST;
            }
            self.until_search -= 1;
        }
        let index = self.next;
        self.next += 1;
        match self.known.get(index) {
            Some(peer) => peer.address,
            None => {
                self.next = 1;
                self.known
                    .first()
                    .map_or(Address::BROADCAST, |peer| peer.address)
            }
        }
    }

    /// An exchange with `peer` gave a range.
    pub(crate) fn answered(&mut self, peer: Address) {
        match self.known.iter_mut().find(|p| p.address == peer) {
            Some(known) => known.failures = 0,
            // A full list takes no more: `next` then stops searching.
            None if self.search => {
                let _ = self.known.push(Peer {
                    address: peer,
                    failures: 0,
                });
            }
            None => {}
        }
    }

    /// An exchange with `peer` failed.
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

    #[test]
    fn configured_peers_are_polled_in_turn_and_never_dropped() {
        let mut peers = Peers::new(&[A, B]);
        for _ in 0..100 {
            assert_eq!(peers.next(), A);
            assert_eq!(peers.next(), B);
            peers.failed(A);
            peers.failed(B);
        }
    }

    #[test]
    fn without_peers_all_nodes_are_polled_until_one_answers() {
        let mut peers = Peers::new(&[]);
        assert!((0..40).all(|_| peers.next() == Address::BROADCAST));
        peers.answered(A);
        let polled: heapless::Vec<_, 128> = (0..128).map(|_| peers.next()).collect();
        let searches = polled.iter().filter(|&&p| p == Address::BROADCAST).count();
        assert_eq!(searches, 2);
        assert_eq!(polled.iter().filter(|&&p| p == A).count(), 126);
    }

    #[test]
    fn a_found_peer_that_is_gone_is_dropped() {
        let mut peers = Peers::new(&[]);
        peers.answered(A);
        peers.answered(B);
        for _ in 0..FAILURES_TO_DROP {
            peers.failed(A);
        }
        assert!((0..100).all(|_| peers.next() != A));
    }

    #[test]
    fn a_full_list_stops_the_search() {
        let mut peers = Peers::new(&[]);
        for k in 0..MAX_PEERS as u16 {
            peers.answered(Address(k));
        }
        peers.answered(Address(99));
        assert!((0..100).all(|_| peers.next().0 < MAX_PEERS as u16));
    }
}
