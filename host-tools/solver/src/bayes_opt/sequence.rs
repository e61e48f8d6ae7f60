//! Points that fill the unit box evenly.

use nalgebra::SVector;

/// Additive recurrence `x_n = frac(s + n a)` with `a_i = g^-i`, `g` the root of `g^(D+1) = g + 1`
/// (the golden ratio's generalisation: M. Roberts, "The unreasonable effectiveness of quasirandom
/// sequences", 2018), shifted by a start `s` drawn from the seed.
#[derive(Debug, Clone)]
pub(super) struct EvenSequence<const D: usize> {
    step: SVector<f64, D>,
    last: SVector<f64, D>,
}

impl<const D: usize> EvenSequence<D> {
    pub(super) fn new(seed: u64) -> Self {
        // Newton's iteration converges from above: the function is convex there.
        let order = D as f64 + 1.0;
        let mut g = 2.0_f64;
        for _ in 0..32 {
            g -= (g.powf(order) - g - 1.0) / (order * g.powf(order - 1.0) - 1.0);
        }
        let mut state = seed;
        Self {
            step: SVector::from_fn(|i, _| g.powi(-(i as i32 + 1))),
            last: SVector::from_fn(|_, _| unit(split_mix(&mut state))),
        }
    }

    /// The next point, each coordinate in `[0, 1)`.
    pub(super) fn next_point(&mut self) -> SVector<f64, D> {
        self.last = (self.last + self.step).map(f64::fract);
        self.last
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014): turns any seed into well-mixed bits.
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The upper 53 bits as a number in `[0, 1)`.
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * 2f64.powi(-53)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_eighth_of_the_box_gets_its_share() {
        for seed in 0..20 {
            let mut sequence = EvenSequence::<3>::new(seed);
            let mut counts = [0; 8];
            for _ in 0..800 {
                let x = sequence.next_point();
                assert!(x.iter().all(|c| (0.0..1.0).contains(c)), "{x}");
                let octant = x.iter().fold(0, |o, &c| 2 * o + usize::from(c >= 0.5));
                counts[octant] += 1;
            }
            // Independent draws would spread by +-9; these do by less.
            assert!(counts.iter().all(|n| (90..=110).contains(n)), "{counts:?}");
        }
    }

    #[test]
    fn seeds_shift_it() {
        let first = |seed| EvenSequence::<2>::new(seed).next_point();
        assert_eq!(first(1), first(1));
        assert!((first(1) - first(2)).norm() > 1e-3);
    }
}
