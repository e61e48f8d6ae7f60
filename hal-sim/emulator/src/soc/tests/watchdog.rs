//! Chapter 38.

use proptest::prelude::*;

use super::super::ResetReason;
use super::{Bench, Cycles, INTENSET, Outward};

const WDT: u8 = 16;
const START: u16 = 0x000;
const TIMEOUT: u16 = 0x100;
const RUNSTATUS: u16 = 0x400;
const REQSTATUS: u16 = 0x404;
const CRV: u16 = 0x504;
const RREN: u16 = 0x508;
const RR: u16 = 0x600;
const RELOAD: u32 = 0x6E52_4635;

fn cycles(ticks: u64) -> Cycles {
    (ticks * 64_000_000).div_ceil(32_768)
}

fn resets(bench: &mut Bench) -> bool {
    bench.told().contains(&Outward::WatchdogReset)
}

proptest! {
    /// 38.1: timeout = (CRV + 1) / 32768 s; the reset comes two ticks of 32 768 Hz later.
    #[test]
    fn it_resets_when_nobody_reloads_it(reload_value in 0xF..0x10_0000u32) {
        let mut bench = Bench::new();
        bench.write(WDT, CRV, reload_value);
        bench.write(WDT, INTENSET, 1);
        bench.task(WDT, START);
        let timeout = cycles(u64::from(reload_value) + 1);
        bench.until(timeout - 1);
        prop_assert!(!bench.interrupts(WDT));
        bench.until(timeout);
        prop_assert!(bench.interrupts(WDT) && bench.take_event(WDT, TIMEOUT));
        bench.until(timeout + cycles(2) - 1);
        prop_assert!(!resets(&mut bench));
        bench.until(timeout + cycles(2));
        prop_assert!(resets(&mut bench));
    }
}

#[test]
fn only_the_magic_value_in_every_enabled_register_reloads_it() {
    let mut bench = Bench::new();
    bench.write(WDT, CRV, 999);
    bench.write(WDT, RREN, 0b101);
    bench.task(WDT, START);
    assert_eq!(bench.read(WDT, RUNSTATUS), 1);
    bench.until(cycles(900));
    bench.write(WDT, RR, RELOAD);
    bench.write(WDT, RR + 8, RELOAD - 1);
    assert_eq!(bench.read(WDT, REQSTATUS), 0b100);
    bench.write(WDT, RR + 8, RELOAD);
    assert_eq!(bench.read(WDT, REQSTATUS), 0b101);
    bench.until(cycles(1800));
    assert!(!resets(&mut bench), "reloaded at 900");
    bench.write(WDT, RR, RELOAD);
    bench.until(cycles(1903));
    assert!(resets(&mut bench), "one of two is not enough");
}

#[test]
fn its_setup_is_locked_while_it_runs_and_a_software_reset_does_not_stop_it() {
    let mut bench = Bench::new();
    bench.write(WDT, CRV, 999);
    bench.task(WDT, START);
    bench.write(WDT, CRV, 0x00FF_FFFF);
    bench.write(WDT, RREN, 0);
    assert_eq!([bench.read(WDT, CRV), bench.read(WDT, RREN)], [999, 1]);
    bench.until(cycles(500));
    bench.soc.reset(ResetReason::Software);
    assert_eq!(bench.read(WDT, RUNSTATUS), 1);
    bench.until(cycles(1003));
    assert!(resets(&mut bench));
    bench.soc.reset(ResetReason::Watchdog);
    assert_eq!(bench.read(WDT, RUNSTATUS), 0);
}
