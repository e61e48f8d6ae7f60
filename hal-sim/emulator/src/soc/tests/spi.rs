//! Chapters 31 (SPIM) and 58 (SPI).

use proptest::prelude::*;

use super::{Bench, Outward, RAM_START};
use crate::wiring;

const SPI2: u8 = 35;
const START: u16 = 0x010;
const STOP: u16 = 0x014;
const STOPPED: u16 = 0x104;
const READY: u16 = 0x108;
const ENDRX: u16 = 0x110;
const END: u16 = 0x118;
const ENDTX: u16 = 0x120;
const STARTED: u16 = 0x14C;
const ENABLE: u16 = 0x500;
const RXD: u16 = 0x518;
const TXD: u16 = 0x51C;
const FREQUENCY: u16 = 0x524;
const RXD_PTR: u16 = 0x534;
const RXD_MAXCNT: u16 = 0x538;
const RXD_AMOUNT: u16 = 0x53C;
const TXD_PTR: u16 = 0x544;
const TXD_MAXCNT: u16 = 0x548;
const TXD_AMOUNT: u16 = 0x54C;
const ORC: u16 = 0x5C0;

const EASY_DMA: u32 = 7;
const LEGACY: u32 = 1;
/// Register value and cycles of 64 MHz a bit.
const M8: (u32, u64) = (0x8000_0000, 8);
const K125: (u32, u64) = (0x0200_0000, 512);

fn on_the_radio(mode: u32, frequency: u32) -> Bench {
    let mut bench = Bench::new();
    let pins = [wiring::RADIO_CLOCK, wiring::RADIO_MOSI, wiring::RADIO_MISO];
    for (offset, pin) in (0x508..).step_by(4).zip(pins) {
        bench.write(SPI2, offset, pin.into());
    }
    bench.write(SPI2, FREQUENCY, frequency);
    bench.write(SPI2, ENABLE, mode);
    bench
}

proptest! {
    /// The longer of both buffers is clocked, ORC where nothing is left to send (31.3).
    #[test]
    fn a_transfer_clocks_the_longer_buffer_and_ends_after_its_bits(
        sent in prop::collection::vec(any::<u8>(), 0..=255), received in 0..=255usize,
        orc in any::<u8>(), fast in any::<bool>(),
    ) {
        let (frequency, cycles_a_bit) = if fast { M8 } else { K125 };
        let mut bench = on_the_radio(EASY_DMA, frequency);
        bench.put_ram(0x100, &sent);
        bench.write(SPI2, TXD_PTR, RAM_START + 0x100);
        bench.write(SPI2, TXD_MAXCNT, sent.len() as u32);
        bench.write(SPI2, RXD_PTR, RAM_START + 0x400);
        bench.write(SPI2, RXD_MAXCNT, received as u32);
        bench.write(SPI2, ORC, orc.into());
        bench.task(SPI2, START);
        prop_assert!(bench.take_event(SPI2, STARTED));
        let length = sent.len().max(received);
        let mut expected = sent.clone();
        expected.resize(length, orc);
        let told = bench.told();
        match told.as_slice() {
            [] => prop_assert_eq!(length, 0),
            [Outward::Transfer { id: SPI2, mosi, .. }] => prop_assert_eq!(mosi, &expected),
            other => return Err(TestCaseError::fail(format!("{other:?}"))),
        }
        let miso: Vec<u8> = (0..length).map(|n| n as u8 ^ 0x5A).collect();
        bench.soc.answer_transfer(SPI2, miso.clone());
        let bits = 8 * length as u64 * cycles_a_bit;
        if length > 0 {
            bench.pass(bits);
            prop_assert!(!bench.take_event(SPI2, END));
        }
        // What EasyDMA takes around the bits is assumed to be below a microsecond.
        bench.pass(64);
        for event in [ENDTX, ENDRX, END] {
            prop_assert!(bench.take_event(SPI2, event));
        }
        prop_assert_eq!(bench.read(SPI2, TXD_AMOUNT), sent.len() as u32);
        prop_assert_eq!(bench.read(SPI2, RXD_AMOUNT), received as u32);
        prop_assert_eq!(bench.ram(0x400, received), &miso[..received]);
        prop_assert_eq!(bench.ram(0x400 + received as u32, 1), &[0], "nothing behind the buffer");
    }
}

#[test]
fn a_count_has_eight_bits() {
    let mut bench = on_the_radio(EASY_DMA, M8.0);
    bench.write(SPI2, TXD_MAXCNT, 256);
    assert_eq!(bench.read(SPI2, TXD_MAXCNT), 0);
}

#[test]
fn a_second_start_a_start_without_enable_and_an_unlisted_frequency_are_refused() {
    let mut bench = on_the_radio(EASY_DMA, M8.0);
    bench.write(SPI2, TXD_PTR, RAM_START);
    bench.write(SPI2, TXD_MAXCNT, 1);
    bench.task(SPI2, START);
    assert!(bench.try_write(SPI2, START, 1).is_err());
    bench.task(SPI2, STOP);
    assert!(bench.take_event(SPI2, STOPPED));
    bench.write(SPI2, FREQUENCY, 0x0010_0000);
    assert!(bench.try_write(SPI2, START, 1).is_err());
    bench.write(SPI2, ENABLE, 0);
    assert!(bench.try_write(SPI2, START, 1).is_err());
}

/// 58.1: TXD and RXD hold two bytes each.
#[test]
fn the_older_spi_sends_a_byte_behind_the_one_under_way_and_holds_two_that_came() {
    let mut bench = on_the_radio(LEGACY, M8.0);
    let byte_time = 8 * M8.1;
    bench.write(SPI2, TXD, 0xA1);
    bench.write(SPI2, TXD, 0xA2);
    for answer in [0xB1, 0xB2] {
        bench.soc.answer_transfer(SPI2, vec![answer]);
        bench.pass(byte_time);
    }
    let sent = bench.told();
    let sent: Vec<_> = sent
        .iter()
        .map(|told| match told {
            Outward::Transfer { mosi, .. } => mosi.as_slice(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(sent, [[0xA1], [0xA2]]);
    assert!(bench.take_event(SPI2, READY));
    assert!(
        !bench.take_event(SPI2, READY),
        "the second waits behind the first"
    );
    assert_eq!(bench.read(SPI2, RXD), 0xB1);
    assert!(bench.take_event(SPI2, READY));
    assert_eq!(bench.read(SPI2, RXD), 0xB2);
    assert!(!bench.take_event(SPI2, READY));
}

#[test]
fn the_older_spi_refuses_to_lose_a_byte_that_was_not_read_or_not_sent() {
    let mut bench = on_the_radio(LEGACY, M8.0);
    bench.write(SPI2, TXD, 0xA1);
    bench.write(SPI2, TXD, 0xA2);
    assert!(
        bench.try_write(SPI2, TXD, 0xA3).is_err(),
        "no room for a third"
    );

    let mut bench = on_the_radio(LEGACY, M8.0);
    for _ in 0..3 {
        bench.write(SPI2, TXD, 0);
        bench.soc.answer_transfer(SPI2, vec![1]);
        bench.pass(8 * M8.1);
    }
    let trouble = bench.soc.trouble.take().map(|trouble| trouble.to_string());
    assert!(trouble.is_some_and(|told| told.contains("RXD")));
}

#[test]
fn a_master_on_other_pins_reads_zeros_and_leaves_the_radio_alone() {
    let mut bench = on_the_radio(EASY_DMA, M8.0);
    bench.write(SPI2, 0x508, 3);
    bench.put_ram(0x400, &[0xFF; 4]);
    bench.write(SPI2, RXD_PTR, RAM_START + 0x400);
    bench.write(SPI2, RXD_MAXCNT, 4);
    bench.task(SPI2, START);
    bench.pass(1000);
    assert!(bench.take_event(SPI2, END));
    assert_eq!(bench.told(), []);
    assert_eq!(bench.ram(0x400, 4), [0; 4]);
}
