//! Chapters 35 (UARTE) and 57 (UART).

use proptest::prelude::*;

use super::{Bench, Outward, RAM_START};

const UART: u8 = 2;
const STARTRX: u16 = 0x000;
const STOPRX: u16 = 0x004;
const STARTTX: u16 = 0x008;
const STOPTX: u16 = 0x00C;
const RXDRDY: u16 = 0x108;
const ENDRX: u16 = 0x110;
const TXDRDY: u16 = 0x11C;
const ENDTX: u16 = 0x120;
const ERROR: u16 = 0x124;
const RXTO: u16 = 0x144;
const TXSTOPPED: u16 = 0x158;
const SHORTS: u16 = 0x200;
const ERRORSRC: u16 = 0x480;
const ENABLE: u16 = 0x500;
const RXD: u16 = 0x518;
const TXD: u16 = 0x51C;
const BAUDRATE: u16 = 0x524;
const RXD_PTR: u16 = 0x534;
const RXD_MAXCNT: u16 = 0x538;
const RXD_AMOUNT: u16 = 0x53C;
const TXD_PTR: u16 = 0x544;
const TXD_MAXCNT: u16 = 0x548;
const TXD_AMOUNT: u16 = 0x54C;

const LEGACY: u32 = 4;
const EASY_DMA: u32 = 8;
/// 1 Mbit/s: ten bits of 64 cycles.
const MEGABAUD: u32 = 0x1000_0000;
const BYTE: u64 = 640;

fn enabled(mode: u32) -> Bench {
    let mut bench = Bench::new();
    bench.write(UART, BAUDRATE, MEGABAUD);
    bench.write(UART, ENABLE, mode);
    bench
}

fn hear(bench: &mut Bench, bytes: &[u8]) {
    let now = bench.now;
    bench.soc.hear(bytes, now);
}

fn bytes_told(bench: &mut Bench) -> Vec<u8> {
    let told = bench.told().into_iter();
    told.map(|told| match told {
        Outward::Byte(byte) => byte,
        other => panic!("{other:?}"),
    })
    .collect()
}

proptest! {
    #[test]
    fn a_buffer_leaves_byte_by_byte_and_ends_with_its_last_stop_bit(bytes in prop::collection::vec(any::<u8>(), 1..=255)) {
        let mut bench = enabled(EASY_DMA);
        bench.put_ram(0, &bytes);
        bench.write(UART, TXD_PTR, RAM_START);
        bench.write(UART, TXD_MAXCNT, bytes.len() as u32);
        bench.task(UART, STARTTX);
        // EasyDMA has taken them: what is in RAM then does not matter (35.4).
        bench.put_ram(0, &[0; 255]);
        bench.pass(BYTE * bytes.len() as u64 - 1);
        prop_assert!(!bench.take_event(UART, ENDTX));
        bench.pass(1);
        prop_assert!(bench.take_event(UART, ENDTX) && bench.take_event(UART, TXDRDY));
        prop_assert_eq!(bench.read(UART, TXD_AMOUNT), bytes.len() as u32);
        prop_assert_eq!(bytes_told(&mut bench), bytes);
    }

    #[test]
    fn what_the_host_says_fills_buffers_of_any_length_in_order(
        bytes in prop::collection::vec(any::<u8>(), 1..200), capacity in 1..20u32,
    ) {
        let mut bench = enabled(EASY_DMA);
        bench.write(UART, RXD_PTR, RAM_START);
        bench.write(UART, RXD_MAXCNT, capacity);
        bench.task(UART, STARTRX);
        hear(&mut bench, &bytes);
        let mut received = Vec::new();
        for _ in &bytes {
            bench.pass(BYTE);
            prop_assert!(bench.take_event(UART, RXDRDY));
            if bench.take_event(UART, ENDRX) {
                let count = bench.read(UART, RXD_AMOUNT);
                prop_assert_eq!(count, capacity);
                received.extend_from_slice(bench.ram(0, count as usize));
                bench.task(UART, STARTRX);
            }
        }
        // Four bytes' time after STOPRX the rest is there (35.5).
        bench.task(UART, STOPRX);
        bench.pass(4 * BYTE - 1);
        prop_assert!(!bench.take_event(UART, RXTO));
        bench.pass(1);
        prop_assert!(bench.take_event(UART, RXTO) && bench.take_event(UART, ENDRX));
        let count = bench.read(UART, RXD_AMOUNT);
        received.extend_from_slice(bench.ram(0, count as usize));
        prop_assert_eq!(received, bytes);
    }

    #[test]
    fn the_older_uart_gives_a_byte_for_each_time_that_it_is_ready(bytes in prop::collection::vec(any::<u8>(), 1..50)) {
        let mut bench = enabled(LEGACY);
        bench.task(UART, STARTRX);
        hear(&mut bench, &bytes);
        let mut received = Vec::new();
        for n in 0..bytes.len() {
            bench.pass(BYTE);
            // Reads in bursts of up to five.
            if n % 5 == 4 || n + 1 == bytes.len() {
                while bench.take_event(UART, RXDRDY) {
                    received.push(bench.read(UART, RXD) as u8);
                }
            }
        }
        prop_assert_eq!(received, bytes);
    }
}

#[test]
fn a_seventh_byte_that_nobody_takes_is_an_overrun() {
    for mode in [LEGACY, EASY_DMA] {
        let mut bench = enabled(mode);
        if mode == LEGACY {
            bench.task(UART, STARTRX);
        } else {
            // One byte of buffer, so that the receiver is on and the buffer full.
            bench.write(UART, RXD_PTR, RAM_START);
            bench.write(UART, RXD_MAXCNT, 1);
            bench.task(UART, STARTRX);
            hear(&mut bench, b"0");
            bench.pass(BYTE);
        }
        hear(&mut bench, b"1234567");
        bench.pass(6 * BYTE);
        assert!(!bench.take_event(UART, ERROR));
        bench.pass(BYTE);
        assert!(bench.take_event(UART, ERROR));
        assert_eq!(bench.read(UART, ERRORSRC), 1);
    }
}

#[test]
fn the_older_uart_sends_from_starttx_to_stoptx() {
    let mut bench = enabled(LEGACY);
    bench.write(UART, TXD, b'x'.into());
    bench.pass(2 * BYTE);
    assert_eq!(bytes_told(&mut bench), b"");
    bench.task(UART, STARTTX);
    bench.write(UART, TXD, b'a'.into());
    bench.pass(BYTE);
    assert!(bench.take_event(UART, TXDRDY));
    assert_eq!(bytes_told(&mut bench), b"a");
    bench.task(UART, STOPTX);
    assert!(bench.take_event(UART, TXSTOPPED));
    bench.write(UART, TXD, b'b'.into());
    bench.pass(2 * BYTE);
    assert_eq!(bytes_told(&mut bench), b"");
}

#[test]
fn the_shortcut_from_endrx_to_startrx_loses_no_byte() {
    let mut bench = enabled(EASY_DMA);
    bench.write(UART, RXD_PTR, RAM_START);
    bench.write(UART, RXD_MAXCNT, 4);
    bench.write(UART, SHORTS, 1 << 5);
    bench.task(UART, STARTRX);
    // The next buffer's place is taken when the present one is full (35.5).
    bench.write(UART, RXD_PTR, RAM_START + 4);
    hear(&mut bench, b"abcdefgh");
    bench.pass(8 * BYTE);
    assert_eq!(bench.ram(0, 8), b"abcdefgh");
}
