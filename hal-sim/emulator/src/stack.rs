//! How far a stack has grown: down to the lowest word that no longer holds what it held when the supply came.

use crate::image::StackRegion;
use crate::soc::RAM_START;

/// A stack's use, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StackUse {
    /// What there is.
    pub size: u32,
    /// The most that was used.
    pub high_water: u32,
}

/// Compares RAM with what it held at first.
pub(crate) fn measure(region: StackRegion, ram: &[u8], initial: &[u8]) -> Option<StackUse> {
    let from = region.bottom.checked_sub(RAM_START)? as usize;
    let to = region.top.checked_sub(RAM_START)? as usize;
    let now = ram.get(from..to)?;
    let untouched = now
        .iter()
        .zip(initial.get(from..to)?)
        .take_while(|(now, then)| now == then)
        .count();
    Some(StackUse {
        size: now.len() as u32,
        high_water: (now.len() - untouched) as u32,
    })
}
