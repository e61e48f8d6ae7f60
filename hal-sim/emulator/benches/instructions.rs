//! Instructions a second of the executor, and of rsemu's own interpreter that it was taken from, on the same loop of
//! loads, arithmetic, stores and a branch.

#![allow(missing_docs)] // criterion's macros
#![allow(clippy::unwrap_used)] // memories as long as they were made

use std::sync::Arc;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rsemu::core::space::{AddressSpace, RamStore, Region};
use rsemu::cpu::arm::v7m::{ArmV7m, Config};
use rsemu_executor::{Bus, Core};

const STEPS: u64 = 100_000;
const CODE_BYTES: usize = 0x1000;
const RAM_START: u32 = 0x2000_0000;
const ENTRY: usize = 0x200;

/// LDR r2,[r0]; ADDS r1,r1,r2; EORS r1,r3; LSRS r4,r1,#3; STR r1,[r0]; ADDS r3,#1; ADD.W r6,r1,r4; B to the first.
const LOOP: [u16; 9] = [
    0x6802, 0x1889, 0x4059, 0x08CC, 0x6001, 0x3301, 0xEB01, 0x0604, 0xE7F6,
];

fn code() -> Vec<u8> {
    let mut code = vec![0; CODE_BYTES];
    code[..8].copy_from_slice(&[0, 8, 0, 0x20, 1, 2, 0, 0]);
    for (place, halfword) in code[ENTRY..].chunks_exact_mut(2).zip(LOOP) {
        place.copy_from_slice(&halfword.to_le_bytes());
    }
    code
}

struct Memory {
    code: Vec<u8>,
    ram: Vec<u8>,
}

impl Bus for Memory {
    #[inline]
    fn read(&mut self, address: u32, _: u32) -> Option<u32> {
        let (memory, offset) = match address.checked_sub(RAM_START) {
            Some(offset) => (&self.ram, offset),
            None => (&self.code, address),
        };
        let word = memory.get(offset as usize..)?.first_chunk()?;
        Some(u32::from_le_bytes(*word))
    }

    #[inline]
    fn write(&mut self, address: u32, _: u32, value: u32) -> Option<()> {
        let offset = address.checked_sub(RAM_START)? as usize;
        *self.ram.get_mut(offset..)?.first_chunk_mut()? = value.to_le_bytes();
        Some(())
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Option<u16> {
        let halfword = self.code.get(address as usize..)?.first_chunk()?;
        Some(u16::from_le_bytes(*halfword))
    }

    #[inline]
    fn is_constant(&self, address: u32) -> bool {
        address < CODE_BYTES as u32
    }
}

fn executor() -> impl FnMut() {
    let ram = vec![0; CODE_BYTES];
    let mut memory = Memory { code: code(), ram };
    let mut core = Core::new(3);
    core.step(&mut memory);
    let mut registers = core.registers();
    registers.r[0] = RAM_START;
    core.set_registers(registers);
    move || {
        for _ in 0..STEPS {
            core.step(&mut memory);
        }
    }
}

fn rsemu() -> impl FnMut() {
    let store = Arc::new(RamStore::new(CODE_BYTES as u64));
    store.write_at(0, &code()).unwrap();
    let ram = Arc::new(RamStore::new(CODE_BYTES as u64));
    let space = AddressSpace::new("bench", 32);
    let mut topology = space.topology();
    topology.map(Region::ram("code", store), 0).unwrap();
    let ram = Region::ram("RAM", ram);
    topology.map(ram, RAM_START.into()).unwrap();
    drop(topology);
    let core = ArmV7m::new(Config::CORTEX_M4F.with_priority_bits(3));
    core.attach_space(Arc::new(space));
    core.step();
    core.set_reg(0, RAM_START);
    move || {
        for _ in 0..STEPS {
            core.step();
        }
    }
}

fn rate(mut run: impl FnMut()) -> f64 {
    run();
    let start = Instant::now();
    (0..20).for_each(|_| run());
    20.0 * STEPS as f64 / start.elapsed().as_secs_f64()
}

fn instructions(c: &mut Criterion) {
    let mut group = c.benchmark_group("instructions");
    group.throughput(Throughput::Elements(STEPS));
    let mut run = executor();
    group.bench_function("executor", |bencher| bencher.iter(&mut run));
    let mut run = rsemu();
    group.bench_function("rsemu", |bencher| bencher.iter(&mut run));
    group.finish();
    let (ours, theirs) = (rate(executor()), rate(rsemu()));
    println!(
        "executor {:.1}, rsemu {:.1} million instructions a second: {:.1} times",
        ours * 1e-6,
        theirs * 1e-6,
        ours / theirs
    );
}

criterion_group!(benches, instructions);
criterion_main!(benches);
