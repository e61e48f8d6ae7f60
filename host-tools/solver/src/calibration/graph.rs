//! Which offsets the pairs can tell.
//!
//! Pairs see sums. In a connected group of nodes, all sums follow from one node's offset: walk along
//! the pairs, the unknown part changes sign at each step. If a walk comes back to its start after an
//! odd number of steps, the unknown part is its own negative, that is zero. So a group is determined
//! if it has a ring of odd length (is not bipartite), or a node that is known.

/// What is known about a node's offset beyond what was believed before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Determined {
    /// The node's own offset.
    Each,
    /// Only the sum with one other node: the two share it in halves.
    PairSum,
    /// Only sums with neighbours: what one side of the group has too much the other may have too little.
    Sums,
    /// Nothing: no pair holds this node.
    Nothing,
}

/// What pairs tell.
pub(super) struct Told {
    /// Of each node.
    pub(super) determined: Vec<Determined>,
    /// How many independent pairs suffice for it; more can contradict each other.
    pub(super) unknowns: usize,
}

/// What the pairs tell.
pub(super) fn told(known: &[bool], pairs: &[[usize; 2]]) -> Told {
    let nodes = known.len();
    let mut neighbours = vec![Vec::new(); nodes];
    for &[a, b] in pairs {
        if let Some(list) = neighbours.get_mut(a) {
            list.push(b);
        }
        if let Some(list) = neighbours.get_mut(b) {
            list.push(a);
        }
    }
    // The side of each node's group that it is on, once it was visited.
    let mut side: Vec<Option<bool>> = vec![None; nodes];
    let mut determined = vec![Determined::Nothing; nodes];
    let mut unknowns = 0;
    for start in 0..nodes {
        if side.get(start).copied().flatten().is_some() {
            continue;
        }
        let mut group = vec![start];
        let mut odd_ring = false;
        set(&mut side, start, Some(true));
        let mut next = 0;
        while let Some(&node) = group.get(next) {
            next += 1;
            let here = side.get(node).copied().flatten();
            for &other in neighbours.get(node).into_iter().flatten() {
                match side.get(other).copied().flatten() {
                    None => {
                        set(&mut side, other, here.map(|here| !here));
                        group.push(other);
                    }
                    there => odd_ring |= there == here,
                }
            }
        }
        let is_known = |node: &&usize| known.get(**node).copied().unwrap_or(false);
        let of_known = group.iter().filter(is_known).count();
        let (verdict, told) = match group.len() {
            1 => (Determined::Nothing, 0),
            all if of_known > 0 => (Determined::Each, all - of_known),
            all if odd_ring => (Determined::Each, all),
            2 => (Determined::PairSum, 1),
            all => (Determined::Sums, all - 1),
        };
        unknowns += told;
        for node in group {
            set(&mut determined, node, verdict);
        }
    }
    Told {
        determined,
        unknowns,
    }
}

fn set<T>(list: &mut [T], index: usize, value: T) {
    if let Some(place) = list.get_mut(index) {
        *place = value;
    }
}

#[cfg(test)]
mod tests {
    use super::Determined::*;
    use super::*;

    #[test]
    fn rings_of_odd_length_and_known_nodes_determine_a_group() {
        let none = |nodes| vec![false; nodes];
        for (known, pairs, expected, unknowns) in [
            (none(2), vec![[0, 1]], vec![PairSum; 2], 1),
            (none(3), vec![[0, 1], [1, 2], [2, 0]], vec![Each; 3], 3),
            // A star, and a ring of four: walks back take an even number of steps.
            (none(4), vec![[0, 1], [0, 2], [0, 3]], vec![Sums; 4], 3),
            (
                none(4),
                vec![[0, 1], [1, 2], [2, 3], [3, 0]],
                vec![Sums; 4],
                3,
            ),
            (
                none(4),
                vec![[0, 1], [1, 2], [2, 0], [2, 3]],
                vec![Each; 4],
                4,
            ),
            (
                vec![true, false, false],
                vec![[0, 1], [1, 2]],
                vec![Each; 3],
                2,
            ),
            (
                none(6),
                vec![[0, 1], [2, 3], [3, 4], [4, 2]],
                vec![PairSum, PairSum, Each, Each, Each, Nothing],
                4,
            ),
        ] {
            let told = told(&known, &pairs);
            assert_eq!(told.determined, expected, "{pairs:?}");
            assert_eq!(told.unknowns, unknowns, "{pairs:?}");
        }
    }
}
