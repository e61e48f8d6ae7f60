//! The executor, which decodes an instruction once and reads plain memory, against rsemu's own interpreter that it
//! was taken from: the same programs from the same state, step for step.

#![allow(clippy::unwrap_used)] // memories as long as they were made

use std::sync::Arc;

use proptest::prelude::*;
use rsemu::core::space::{AddressSpace, Mapping, Perms, RamStore, Region, UnassignedPolicy};
use rsemu::cpu::arm::v7m::{ArmV7m, Config};
use rsemu_executor::{Bus, Core, Registers};

const CODE_BYTES: u32 = 0x1000;
const RAM_START: u32 = 0x2000_0000;
const RAM_BYTES: u32 = 0x1000;
/// Code begins behind the vectors of all interrupts.
const ENTRY: u32 = 0x200;
/// Where the program's handlers begin: four instructions each, so that they run into one another.
const HANDLERS: u32 = 0x800;
const STACK: u32 = RAM_START + 0x800;

/// Code that stays, RAM, and nothing else.
#[derive(Clone)]
struct Memory {
    code: Vec<u8>,
    ram: Vec<u8>,
}

impl Memory {
    fn place(&self, address: u32, bytes: u32) -> Option<(&[u8], std::ops::Range<usize>)> {
        let (memory, offset) = match address.checked_sub(RAM_START) {
            Some(offset) => (&self.ram, offset),
            None => (&self.code, address),
        };
        let place = offset as usize..offset.checked_add(bytes)? as usize;
        (place.end <= memory.len()).then_some((memory.as_slice(), place))
    }
}

impl Bus for Memory {
    fn read(&mut self, address: u32, bytes: u32) -> Option<u32> {
        let (memory, place) = self.place(address, bytes)?;
        let bytes = memory[place].iter().rev();
        Some(bytes.fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }

    fn write(&mut self, address: u32, bytes: u32, value: u32) -> Option<()> {
        address.checked_sub(RAM_START)?;
        let (_, place) = self.place(address, bytes)?;
        let bytes = &value.to_le_bytes()[..place.len()];
        self.ram[place].copy_from_slice(bytes);
        Some(())
    }

    fn fetch(&mut self, address: u32) -> Option<u16> {
        self.read(address, 2).map(|halfword| halfword as u16)
    }

    fn is_constant(&self, address: u32) -> bool {
        address < CODE_BYTES
    }
}

/// Both, side by side.
struct Pair {
    core: Core,
    memory: Memory,
    model: ArmV7m,
    model_ram: Arc<RamStore>,
}

/// What a program begins with.
#[derive(Debug, Clone)]
struct Start {
    program: Vec<u16>,
    handlers: Vec<u16>,
    registers: [u32; 13],
    floats: [u32; 32],
    flags: u32,
    /// CPACR: without it floating point traps.
    floating_point: bool,
    /// SHCSR: faults of their own, or all HardFault.
    faults: bool,
    /// NVIC's enables, and its priorities as far as interrupt 16.
    enabled: u32,
    priorities: [u8; 16],
    systick: u32,
}

impl Pair {
    fn new(start: &Start) -> Self {
        let mut code = vec![0; CODE_BYTES as usize];
        let vectors = (0..ENTRY / 4).map(|n| match n {
            0 => STACK,
            1 => ENTRY | 1,
            _ => (HANDLERS + 8 * n) | 1,
        });
        for (place, vector) in code.chunks_exact_mut(4).zip(vectors) {
            place.copy_from_slice(&vector.to_le_bytes());
        }
        for (at, halfwords) in [(ENTRY, &start.program), (HANDLERS, &start.handlers)] {
            let places = code[at as usize..].chunks_exact_mut(2);
            for (place, halfword) in places.zip(halfwords) {
                place.copy_from_slice(&halfword.to_le_bytes());
            }
        }
        let ram: Vec<u8> = (0..RAM_BYTES).map(|n| (n * 7 + n / 256) as u8).collect();
        let store = |bytes: &[u8]| {
            let store = Arc::new(RamStore::new(bytes.len() as u64));
            store.write_at(0, bytes).unwrap();
            store
        };
        let model_ram = store(&ram);
        let space = AddressSpace::new("test", 32).with_unassigned(UnassignedPolicy::FAULT);
        let mut topology = space.topology();
        let flash = Mapping::new(Region::ram("code", store(&code)), 0).with_perms(Perms::RX);
        topology.map_with(flash).unwrap();
        let ram_mapping = Mapping::new(Region::ram("RAM", model_ram.clone()), RAM_START.into());
        topology.map_with(ram_mapping).unwrap();
        drop(topology);
        let model = ArmV7m::new(Config::CORTEX_M4F.with_priority_bits(3));
        model.attach_space(Arc::new(space));
        let mut pair = Pair {
            core: Core::new(3),
            memory: Memory { code, ram },
            model,
            model_ram,
        };
        assert_eq!(pair.step(), None, "the reset sequence");
        pair.begin(start);
        pair
    }

    fn begin(&mut self, start: &Start) {
        let mut registers = self.core.registers();
        registers.r[..13].copy_from_slice(&start.registers);
        registers.xpsr |= start.flags & 0xF80F_0000;
        self.core.set_registers(registers);
        self.core.set_floats(start.floats, 0);
        for (n, &value) in (0..).zip(&registers.r) {
            self.model.set_reg(n, value);
        }
        for (n, &value) in (0..).zip(&start.floats) {
            self.model.set_s(n, value);
        }
        self.model.set_xpsr(registers.xpsr);
        let writes = [
            (0xE000_ED88, u32::from(start.floating_point) * 0x00F0_0000),
            (0xE000_ED24, u32::from(start.faults) * 0x0007_0000),
            (0xE000_E100, start.enabled),
            (0xE000_E014, start.systick),
            (0xE000_E010, u32::from(start.systick != 0) * 0b111),
        ];
        let quads = start.priorities.chunks_exact(4).zip(0..);
        let priorities = quads.map(|(quad, n)| {
            let word = quad.iter().rev();
            let word = word.fold(0, |word, &byte| word << 8 | u32::from(byte));
            (0xE000_E400 + 4 * n, word)
        });
        for (register, value) in priorities.chain(writes) {
            self.core.sys_mut().write_word(register, value);
            self.model.with_sys(|sys| sys.write_word(register, value));
        }
    }

    fn set_levels(&mut self, levels: u32) {
        self.core.set_levels(levels.into());
        (0..32).for_each(|n| self.model.set_irq(n, levels >> n & 1 == 1));
    }

    /// What differs after a step, if anything does; `Err` when the programs part because they are known to differ:
    /// rsemu drops ITSTATE where an exception begins or ends within an IT block, and takes it one further at a fault;
    /// it enters HardFault again where an SVC or a BKPT in it locks the processor up.
    fn known_step(&mut self) -> Result<Option<String>, ()> {
        const ITSTATE: u32 = 0x0600_FC00;
        const SVC: u16 = 0xDF;
        const BKPT: u16 = 0xBE;
        let before = self.core.registers().xpsr;
        let instruction = self.memory.fetch(self.core.pc());
        let instruction_traps = matches!(instruction.map(|first| first >> 8), Some(SVC | BKPT));
        let difference = self.step();
        let exceptions = before ^ self.core.registers().xpsr;
        let faulted = exceptions & 0x1FF != 0 || self.core.is_locked_up();
        let nested = self.core.is_locked_up() && !self.model.is_locked_up();
        if before & ITSTATE != 0 && faulted || nested && instruction_traps {
            return Err(());
        }
        Ok(difference)
    }

    /// What differs after a step, if anything does.
    fn step(&mut self) -> Option<String> {
        let at = self.core.pc();
        let cycles = [self.core.step(&mut self.memory), self.model.step()];
        let regs = self.model.regs();
        let of_model = Registers {
            r: regs.r,
            xpsr: regs.xpsr,
        };
        let floats: [u32; 32] = std::array::from_fn(|n| self.model.s(n as u8));
        let sys = self.model.with_sys(|sys| format!("{sys:?}"));
        let same = cycles[0] == cycles[1]
            && self.core.registers() == of_model
            && [self.core.msp(), self.core.psp()] == [regs.msp, regs.psp]
            && (self.core.floats(), self.core.fpscr()) == (floats, self.model.fpscr())
            && self.core.is_asleep() == self.model.is_asleep()
            && self.core.is_locked_up() == self.model.is_locked_up()
            && format!("{:?}", self.core.sys()) == sys;
        (!same).then(|| {
            format!(
                "at {at:#x}, {cycles:?} cycles\n{:x?}\n{of_model:x?}\n{:?}\n{sys}",
                self.core.registers(),
                self.core.sys()
            )
        })
    }

    fn ram_is_the_same(&self) -> bool {
        let mut ram = vec![0; RAM_BYTES as usize];
        self.model_ram.read_at(0, &mut ram).unwrap();
        ram == self.memory.ram
    }
}

/// A value such as programs have in their registers: a place in RAM, aligned or not, a small number, or anything.
fn value() -> impl Strategy<Value = u32> {
    prop_oneof![
        3 => (0..RAM_BYTES / 4).prop_map(|word| RAM_START + 4 * word),
        1 => (0..RAM_BYTES).prop_map(|byte| RAM_START + byte),
        // Bits of the first 128 bytes of RAM, through their aliases.
        1 => (0..1024u32).prop_map(|bit| 0x2200_0000 + 4 * bit),
        1 => (ENTRY / 2..CODE_BYTES / 2).prop_map(|halfword| 2 * halfword + 1),
        2 => 0..70u32,
        1 => (0..32u32).prop_map(|shift| 1 << shift),
        2 => any::<u32>(),
    ]
}

/// Instructions: any halfword, and wide ones with any second half.
fn program(most: usize) -> impl Strategy<Value = Vec<u16>> {
    let instruction = prop_oneof![
        6 => (0..0xE800u16).prop_map(|halfword| vec![halfword]),
        // Loads, stores and data processing with wide encodings; then all others.
        2 => (0xE840..0xF9A0u16, any::<u16>()).prop_map(|(first, second)| vec![first, second]),
        1 => (0xE800..=0xFFFFu16, any::<u16>()).prop_map(|(first, second)| vec![first, second]),
        // Single-precision arithmetic (coprocessor 10).
        1 => (0xEE00..=0xEEFFu16, any::<u16>())
            .prop_map(|(first, second)| vec![first, second & !0xF00 | 0xA00]),
        // IT with any condition and mask.
        1 => (0xBF01..=0xBFEFu16).prop_map(|halfword| vec![halfword]),
    ];
    prop::collection::vec(instruction, 1..most).prop_map(|all| all.concat())
}

fn start(most: usize) -> impl Strategy<Value = Start> {
    let machine = (
        any::<bool>(),
        any::<bool>(),
        any::<u32>(),
        any::<[u8; 16]>(),
    );
    let systick = prop_oneof![3 => Just(0), 1 => 1..60u32];
    (
        program(most),
        program(80),
        prop::array::uniform13(value()),
        prop::array::uniform32(any::<u32>()),
        any::<u32>(),
        machine,
        systick,
    )
        .prop_map(
            |(program, handlers, registers, floats, flags, machine, systick)| {
                let (floating_point, faults, enabled, priorities) = machine;
                Start {
                    program,
                    handlers,
                    registers,
                    floats,
                    flags,
                    floating_point,
                    faults,
                    enabled,
                    priorities,
                    systick,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Two or three instructions at a time meet more kinds than long programs do, which soon lie in a fault.
    #[test]
    fn any_instruction_does_what_it_does_in_rsemu(start in start(4)) {
        let mut pair = Pair::new(&start);
        for _ in 0..4 {
            let Ok(difference) = pair.known_step() else {
                return Ok(());
            };
            prop_assert_eq!(difference, None);
        }
        prop_assert!(pair.ram_is_the_same());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn programs_with_interrupts_run_as_in_rsemu(
        start in start(60),
        lines in prop::collection::vec((any::<u32>(), any::<u32>(), 1..20usize), 1..8),
    ) {
        let mut pair = Pair::new(&start);
        for (levels, fewer, steps) in lines {
            pair.set_levels(levels & fewer);
            for _ in 0..steps {
                let Ok(difference) = pair.known_step() else {
                    return Ok(());
                };
                prop_assert_eq!(difference, None);
            }
        }
        prop_assert!(pair.ram_is_the_same());
    }
}

#[test]
fn code_that_has_changed_is_decoded_anew_once_it_is_forgotten() {
    let mut core = Core::new(3);
    let mut code = vec![0; CODE_BYTES as usize];
    code[..8].copy_from_slice(&[0, 8, 0, 0x20, 1, 2, 0, 0]);
    // MOVS r0, #1; B to itself two bytes before.
    code[0x200..0x204].copy_from_slice(&[1, 0x20, 0xFD, 0xE7]);
    let ram = vec![0; RAM_BYTES as usize];
    let mut memory = Memory { code, ram };
    for _ in 0..3 {
        core.step(&mut memory);
    }
    memory.code[0x200] = 2;
    core.step(&mut memory);
    assert_eq!(core.reg(0), 1, "what was decoded stands");
    core.forget_code();
    for _ in 0..2 {
        core.step(&mut memory);
    }
    assert_eq!(core.reg(0), 2);
}

/// Armv7-M ARM, B1.5.6: what is stacked is all of xPSR, with the place within an IT block.
#[test]
fn an_interrupt_within_an_it_block_comes_back_into_it() {
    let mut code = vec![0; CODE_BYTES as usize];
    code[..8].copy_from_slice(&[0, 8, 0, 0x20, 1, 2, 0, 0]);
    // Interrupt 0: BX lr at 0x300.
    code[0x40..0x44].copy_from_slice(&[1, 3, 0, 0]);
    code[0x300..0x302].copy_from_slice(&[0x70, 0x47]);
    // MOVS r0, #1; ITE EQ; MOVEQ r1, #5; MOVNE r2, #6; B to itself.
    let program = [0x2001u16, 0xBF0C, 0x2105, 0x2206, 0xE7FE];
    for (place, halfword) in code[ENTRY as usize..].chunks_exact_mut(2).zip(program) {
        place.copy_from_slice(&halfword.to_le_bytes());
    }
    // The interrupt comes before the n-th step.
    for n in 0..6 {
        let mut core = Core::new(3);
        let ram = vec![0; RAM_BYTES as usize];
        let mut memory = Memory {
            code: code.clone(),
            ram,
        };
        core.step(&mut memory);
        core.sys_mut().write_word(0xE000_E100, 1);
        for step in 0..10 {
            core.set_levels(u64::from(step == n));
            core.step(&mut memory);
        }
        let registers = core.registers();
        assert_eq!([registers.r[1], registers.r[2]], [0, 6], "before step {n}");
        assert_eq!(registers.r[15], ENTRY + 8);
    }
}

/// Armv7-M ARM, B1.5.15: what escalates to HardFault at HardFault's own priority is a lockup.
#[test]
fn a_call_or_a_breakpoint_within_hardfault_locks_the_processor_up() {
    for trap in [0xDF00u16, 0xBE00] {
        let mut code = vec![0; CODE_BYTES as usize];
        // HardFault at 0x300.
        code[..16].copy_from_slice(&[0, 8, 0, 0x20, 1, 2, 0, 0, 0, 0, 0, 0, 1, 3, 0, 0]);
        // UDF; in the handler the trap.
        code[ENTRY as usize..][..2].copy_from_slice(&0xDE00u16.to_le_bytes());
        code[0x300..0x302].copy_from_slice(&trap.to_le_bytes());
        let ram = vec![0; RAM_BYTES as usize];
        let (mut core, mut memory) = (Core::new(3), Memory { code, ram });
        for (step, locked_up) in [false, false, true].into_iter().enumerate() {
            core.step(&mut memory);
            assert_eq!(core.is_locked_up(), locked_up, "{trap:#x}, step {step}");
        }
    }
}
