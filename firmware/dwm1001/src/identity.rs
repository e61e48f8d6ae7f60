//! Who this board is, without anybody having to say so.

/// Addresses that IEEE 802.15.4 keeps for itself: 0xFFFF is broadcast, 0xFFFE
/// means "has no short address" (IEEE 802.15.4-2011, 5.1.3.1); 0 is left to mean "none".
const RESERVED: [u16; 3] = [0x0000, 0xFFFE, 0xFFFF];

/// The 16-bit short address of a board, made from the 64-bit number Nordic burnt
/// into its nRF52832 (FICR.DEVICEID\[0\] and \[1\], product specification 13.1).
///
/// The same board always gets the same address. Two boards of a set of `n` share one with
/// a probability of about `n² / 131 000`: 0.1 % for a dozen.
pub fn short_address(device_id: [u32; 2]) -> u16 {
    let [low, high] = device_id;
    let mut hash = mix(u64::from(high) << 32 | u64::from(low));
    loop {
        let address = hash as u16;
        if !RESERVED.contains(&address) {
            return address;
        }
        hash = mix(hash);
    }
}

/// SplitMix64's step and finaliser: neighbouring serial numbers land far apart, and
/// no state is a fixed point, so that [`short_address`] always ends.
fn mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_same_board_keeps_its_address() {
        let id = [0x1234_5678, 0x9ABC_DEF0];
        assert_eq!(short_address(id), short_address(id));
    }

    #[test]
    fn both_words_of_the_device_id_count() {
        assert_ne!(short_address([1, 0]), short_address([0, 1]));
        assert_ne!(short_address([1, 2]), short_address([1, 3]));
        assert_ne!(short_address([1, 2]), short_address([0, 2]));
    }

    #[test]
    fn reserved_addresses_are_never_given_out() {
        // Enough ids that each of the 65 536 values, reserved ones too, comes up ~15 times unless avoided.
        for low in 0..1_000_000 {
            assert!(!RESERVED.contains(&short_address([low, 7])));
        }
    }

    #[test]
    fn consecutive_serial_numbers_collide_no_more_than_chance() {
        // 256 boards in 65 533 addresses: 0.5 colliding pairs are expected, 5 or more in less than 1 of 5000 sets.
        let addresses: BTreeSet<u16> = (0..256).map(|n| short_address([n, 0])).collect();
        assert!(addresses.len() > 251, "{} of 256 distinct", addresses.len());
    }
}
