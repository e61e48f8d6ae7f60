//! Random numbers that need no source of chance.

use crate::frame::Address;

/// Random numbers, from a different start for each address.
#[derive(Clone, Copy, Debug)]
pub struct Random(u32);

impl Random {
    /// The numbers of this node.
    pub fn new(address: Address) -> Self {
        // xorshift must not start at 0.
        Self(u32::from(address.0) | 0x1_0000)
    }

    /// A number from 0 to `end` - 1, or 0.
    pub fn below(&mut self, end: u32) -> u32 {
        // xorshift32 (Marsaglia 2003).
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        ((u64::from(self.0) * u64::from(end)) >> 32) as u32
    }
}
