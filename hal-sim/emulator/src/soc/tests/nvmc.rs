//! Chapter 11.

use proptest::prelude::*;

use super::{Bench, Outward};
use crate::error::Trouble;

const NVMC: u8 = 30;
const READY: u16 = 0x400;
const CONFIG: u16 = 0x504;
const ERASEPAGE: u16 = 0x508;
const ERASEUICR: u16 = 0x514;
const UICR: u32 = 0x1000_1000;
const WRITE: u32 = 1;
const ERASE: u32 = 2;

fn store(bench: &mut Bench, address: u32, bytes: &[u8]) -> Result<(), Trouble> {
    bench.soc.write_memory(address, bytes, bench.now);
    bench.soc.trouble.take().map_or(Ok(()), Err)
}

fn word(bench: &Bench, address: u32) -> u32 {
    let bytes = &bench.soc.memory.contents()[address as usize..];
    u32::from_le_bytes(*bytes.first_chunk().unwrap())
}

proptest! {
    #[test]
    fn a_write_clears_bits_and_what_would_set_one_is_refused_and_changes_nothing(
        writes in prop::collection::vec((0..64u32, any::<u32>()), 1..40),
    ) {
        let mut bench = Bench::new();
        bench.write(NVMC, CONFIG, WRITE);
        let mut expected = [u32::MAX; 64];
        for (place, value) in writes {
            // Often a value that fits, as firmware writes it.
            let old = expected[place as usize];
            let value = if value & 1 == 0 { value & old } else { value };
            let outcome = store(&mut bench, 4 * place, &value.to_le_bytes());
            prop_assert_eq!(outcome.is_ok(), value & !old == 0, "{:#x} over {:#x}", value, old);
            if value & !old == 0 {
                expected[place as usize] = value;
            }
            prop_assert_eq!(word(&bench, 4 * place), expected[place as usize]);
        }
    }
}

#[test]
fn writes_and_erases_need_to_be_enabled_and_whole_words() {
    let mut bench = Bench::new();
    assert!(store(&mut bench, 0, &[0; 4]).is_err());
    bench.write(NVMC, CONFIG, ERASE);
    assert!(store(&mut bench, 0, &[0; 4]).is_err());
    bench.write(NVMC, CONFIG, WRITE);
    assert!(store(&mut bench, 0, &[0; 2]).is_err());
    assert!(store(&mut bench, 2, &[0; 4]).is_err());
    assert!(bench.try_write(NVMC, ERASEPAGE, 0).is_err());
    assert_eq!(word(&bench, 0), u32::MAX);
}

#[test]
fn an_erase_sets_its_page_and_no_other_and_the_processor_stands_still_meanwhile() {
    let mut bench = Bench::new();
    bench.write(NVMC, CONFIG, WRITE);
    for address in [0xFFC, 0x1000, 0x1FFC, 0x2000] {
        store(&mut bench, address, &[0; 4]).unwrap();
    }
    // 338 us each, 89.7 ms a page (11.7, "NVMC electrical specification"), at 64 MHz.
    assert_eq!(bench.told(), [const { Outward::Stall(338 * 64) }; 4]);
    bench.write(NVMC, CONFIG, ERASE);
    bench.write(NVMC, ERASEPAGE, 0x1000);
    assert_eq!(bench.told(), [Outward::Stall(89_700 * 64)]);
    let words = [0xFFC, 0x1000, 0x1FFC, 0x2000].map(|address| word(&bench, address));
    assert_eq!(words, [0, u32::MAX, u32::MAX, 0]);
    assert_eq!(bench.read(NVMC, READY), 1);
}

#[test]
fn uicr_is_written_as_flash_and_erased_apart() {
    let mut bench = Bench::new();
    bench.write(NVMC, CONFIG, WRITE);
    store(&mut bench, UICR + 0x80, &[1, 2, 3, 4]).unwrap();
    assert_eq!(bench.soc.memory.read_uicr(0x80), 0x0403_0201);
    bench.write(NVMC, CONFIG, ERASE);
    bench.write(NVMC, ERASEUICR, 1);
    assert_eq!(bench.soc.memory.read_uicr(0x80), u32::MAX);
}

#[test]
fn a_page_that_is_no_page_is_refused() {
    let mut bench = Bench::new();
    bench.write(NVMC, CONFIG, ERASE);
    for address in [0x4, 0x8_0000, u32::MAX] {
        assert!(
            bench.try_write(NVMC, ERASEPAGE, address).is_err(),
            "{address:#x}"
        );
    }
}
