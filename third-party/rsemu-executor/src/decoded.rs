//! Instructions that have been decoded before, by address.

use rsemu::cpu::arm::v7m::isa::Insn;

/// An instruction, and whether it takes two halfwords.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Decoded {
    pub(crate) insn: Insn,
    pub(crate) wide: bool,
}

/// One place for each of so many neighbouring halfwords; others that fall onto the same place take turns.
const PLACES: usize = 1 << 14;

/// No instruction lies at an odd address.
const NOWHERE: u32 = 1;

#[derive(Debug, Clone)]
pub(crate) struct DecodedCode {
    places: Vec<(u32, Decoded)>,
}

impl DecodedCode {
    pub(crate) fn new() -> Self {
        let nothing = Decoded {
            insn: Insn::Undefined,
            wide: false,
        };
        DecodedCode {
            places: vec![(NOWHERE, nothing); PLACES],
        }
    }

    #[inline]
    pub(crate) fn get(&self, pc: u32) -> Option<Decoded> {
        let (at, decoded) = self.places.get(place(pc))?;
        (*at == pc).then_some(*decoded)
    }

    #[inline]
    pub(crate) fn put(&mut self, pc: u32, decoded: Decoded) {
        if let Some(place) = self.places.get_mut(place(pc)) {
            *place = (pc, decoded);
        }
    }

    pub(crate) fn forget(&mut self) {
        self.places.iter_mut().for_each(|(at, _)| *at = NOWHERE);
    }
}

#[inline]
fn place(pc: u32) -> usize {
    (pc >> 1) as usize % PLACES
}
