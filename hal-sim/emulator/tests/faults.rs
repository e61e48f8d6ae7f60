//! What the chip does with accesses that lead nowhere: flip-link relies on it, whose stack lies at the bottom of RAM.

#![allow(clippy::unwrap_used)] // a test's own images

use nova_emulator::{Board, BoardConfig, Emulation, Image, RAM_START, ResetReason};
use nova_hal_sim::{ChannelConfig, SimTime};

/// The stack begins so far above the bottom of RAM.
const STACK_BYTES: u32 = 0x100;
const CFSR: u32 = 0xE000_ED28;
const HFSR: u32 = 0xE000_ED2C;
const BFAR: u32 = 0xE000_ED38;

/// Vectors, then `program` at 0x100 and a HardFault handler at 0x200.
fn image(program: &[u16], handler: &[u16]) -> Image {
    let mut code = vec![0; 0x300];
    let vectors = [RAM_START + STACK_BYTES, 0x101, 0, 0x201];
    for (place, vector) in code.chunks_exact_mut(4).zip(vectors) {
        place.copy_from_slice(&vector.to_le_bytes());
    }
    for (at, halfwords) in [(0x100, program), (0x200, handler)] {
        let places = code[at..].chunks_exact_mut(2);
        for (place, halfword) in places.zip(halfwords) {
            place.copy_from_slice(&halfword.to_le_bytes());
        }
    }
    Image::from_segments(vec![(0, code)])
}

fn run(image: Image, ms: u64) -> Emulation {
    let boards = vec![(BoardConfig::new("board", [1, 2]), image)];
    let mut emulation = Emulation::new(1, ChannelConfig::default(), boards).unwrap();
    emulation.run_until(SimTime::from_ms(ms)).unwrap();
    emulation
}

fn word(board: &Board, address: u32) -> u32 {
    let mut bytes = [0; 4];
    assert_eq!(board.read_memory(address, &mut bytes), 4);
    u32::from_le_bytes(bytes)
}

/// B to itself.
const STAY: u16 = 0xE7FE;

#[test]
fn a_stack_that_grows_below_ram_is_a_fault_and_what_lies_above_it_stays() {
    // PUSH {r0}, for ever. The handler stays where it is.
    let emulation = run(image(&[0xB401, 0xE7FD], &[STAY]), 6);
    let board = emulation.board("board").unwrap();
    assert_eq!(board.program_counter(), 0x200, "HardFault's handler");
    // PRECISERR and BFARVALID, then STKERR: the exception's frame had no place either. FORCED: BusFault is not enabled.
    assert_eq!(word(board, CFSR), 1 << 9 | 1 << 12 | 1 << 15);
    assert_eq!(word(board, HFSR), 1 << 30);
    assert!((RAM_START - 0x40..RAM_START).contains(&word(board, BFAR)));
    let stack = (RAM_START..RAM_START + STACK_BYTES).step_by(4);
    assert!(
        stack.clone().all(|address| word(board, address) == 0),
        "R0, all the way down"
    );
    let above = run(image(&[STAY], &[STAY]), 6);
    let untouched = above.board("board").unwrap();
    for address in (RAM_START + STACK_BYTES..RAM_START + 0x1_0000).step_by(4) {
        assert_eq!(
            word(board, address),
            word(untouched, address),
            "{address:#x}"
        );
    }
}

#[test]
fn reads_and_calls_of_addresses_where_nothing_is_are_faults() {
    // LDR r0, [r1] with R1 = 0x30000000 (MOVS r1, #3; LSLS r1, r1, #28).
    let emulation = run(image(&[0x2103, 0x0709, 0x6808, STAY], &[STAY]), 6);
    let board = emulation.board("board").unwrap();
    assert_eq!(
        [word(board, CFSR), word(board, BFAR)],
        [1 << 9 | 1 << 15, 0x3000_0000]
    );
    // BLX there: ADDS r1, #1; BLX r1. IBUSERR.
    let emulation = run(image(&[0x2103, 0x0709, 0x3101, 0x4788, STAY], &[STAY]), 6);
    let board = emulation.board("board").unwrap();
    assert_eq!(word(board, CFSR), 1 << 8);
}

#[test]
fn a_fault_in_the_handler_locks_the_core_up_which_resets_the_chip() {
    // An undefined instruction in both.
    let emulation = run(image(&[0xDE00], &[0xDE00]), 6);
    let resets = emulation.board("board").unwrap().stats().resets;
    let reasons: Vec<_> = resets.iter().map(|(_, reason)| *reason).collect();
    assert!(reasons.len() > 1, "{reasons:?}");
    assert_eq!(reasons[..2], [ResetReason::PowerOn, ResetReason::Lockup]);
}

#[test]
fn an_intel_hex_file_is_loaded_where_its_records_say() {
    let hex = ":020000040000FA\n:0801000000200000013000E0E6\n:0400FC00AABBCCDDF2\n:00000001FF\n";
    let error = Image::parse(hex.as_bytes())
        .err()
        .map(|error| error.to_string());
    assert!(
        error.is_some_and(|told| told.contains("record 2")),
        "a wrong checksum"
    );
    // 0x100: MOVS r0, #1; B to itself. Vectors in a record of their own, behind it in the file.
    let records = [
        ":0401000001 20 FE E7 F5",
        ":0800000000010020 01010000 D5",
        ":00000001FF",
    ];
    let hex = records.map(|record| record.replace(' ', "")).join("\n");
    let emulation = run(Image::parse(hex.as_bytes()).unwrap(), 6);
    let board = emulation.board("board").unwrap();
    assert_eq!(board.registers().r[0], 1);
    assert_eq!(board.program_counter(), 0x102);
}
