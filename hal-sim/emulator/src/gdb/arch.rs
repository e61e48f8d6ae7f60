//! A Cortex-M4F as GDB wants it described: the features `org.gnu.gdb.arm.m-profile`, `m-system` and `vfp` ("ARM
//! Features" in GDB's manual).

use gdbstub::arch::{Arch, Registers};

/// The architecture.
pub(super) enum CortexM4f {}

impl Arch for CortexM4f {
    type Usize = u32;
    type Registers = AllRegisters;
    type BreakpointKind = usize;
    type RegId = ();

    fn target_description_xml() -> Option<&'static str> {
        Some(DESCRIPTION)
    }
}

/// All registers, in the order of the description.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct AllRegisters {
    /// R0 to R15, xPSR, MSP, PSP.
    pub(super) core: [u32; 19],
    /// S0 to S31, which D0 to D15 are pairs of.
    pub(super) floats: [u32; 32],
    pub(super) fpscr: u32,
}

impl AllRegisters {
    fn words(&self) -> impl Iterator<Item = &u32> {
        self.core.iter().chain(&self.floats).chain([&self.fpscr])
    }
}

impl Registers for AllRegisters {
    type ProgramCounter = u32;

    fn pc(&self) -> u32 {
        let [.., pc, _, _, _] = self.core;
        pc
    }

    fn gdb_serialize(&self, write_byte: impl FnMut(Option<u8>)) {
        let bytes = self.words().flat_map(|word| word.to_le_bytes());
        bytes.map(Some).for_each(write_byte);
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let words = bytes.as_chunks::<4>().0;
        if words.len() < self.words().count() {
            return Err(());
        }
        let places = self.core.iter_mut().chain(&mut self.floats);
        let places = places.chain([&mut self.fpscr]);
        for (place, &word) in places.zip(words) {
            *place = u32::from_le_bytes(word);
        }
        Ok(())
    }
}

const DESCRIPTION: &str = r#"<?xml version="1.0"?>
<!DOCTYPE target SYSTEM "gdb-target.dtd">
<target version="1.0">
<architecture>arm</architecture>
<feature name="org.gnu.gdb.arm.m-profile">
<reg name="r0" bitsize="32"/><reg name="r1" bitsize="32"/><reg name="r2" bitsize="32"/><reg name="r3" bitsize="32"/>
<reg name="r4" bitsize="32"/><reg name="r5" bitsize="32"/><reg name="r6" bitsize="32"/><reg name="r7" bitsize="32"/>
<reg name="r8" bitsize="32"/><reg name="r9" bitsize="32"/><reg name="r10" bitsize="32"/><reg name="r11" bitsize="32"/>
<reg name="r12" bitsize="32"/>
<reg name="sp" bitsize="32" type="data_ptr"/>
<reg name="lr" bitsize="32"/>
<reg name="pc" bitsize="32" type="code_ptr"/>
<reg name="xpsr" bitsize="32"/>
</feature>
<feature name="org.gnu.gdb.arm.m-system">
<reg name="msp" bitsize="32" type="data_ptr"/>
<reg name="psp" bitsize="32" type="data_ptr"/>
</feature>
<feature name="org.gnu.gdb.arm.vfp">
<reg name="d0" bitsize="64" type="ieee_double"/><reg name="d1" bitsize="64" type="ieee_double"/>
<reg name="d2" bitsize="64" type="ieee_double"/><reg name="d3" bitsize="64" type="ieee_double"/>
<reg name="d4" bitsize="64" type="ieee_double"/><reg name="d5" bitsize="64" type="ieee_double"/>
<reg name="d6" bitsize="64" type="ieee_double"/><reg name="d7" bitsize="64" type="ieee_double"/>
<reg name="d8" bitsize="64" type="ieee_double"/><reg name="d9" bitsize="64" type="ieee_double"/>
<reg name="d10" bitsize="64" type="ieee_double"/><reg name="d11" bitsize="64" type="ieee_double"/>
<reg name="d12" bitsize="64" type="ieee_double"/><reg name="d13" bitsize="64" type="ieee_double"/>
<reg name="d14" bitsize="64" type="ieee_double"/><reg name="d15" bitsize="64" type="ieee_double"/>
<reg name="fpscr" bitsize="32" type="int" group="float"/>
</feature>
</target>
"#;
