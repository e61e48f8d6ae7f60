//! Chapter 22.

use super::Bench;

const PPI: u8 = 31;
const RTC1: u8 = 17;
const TIMER1: u8 = 9;
const TIMER2: u8 = 10;
const CHEN: u16 = 0x500;
const CHENSET: u16 = 0x504;
const CHENCLR: u16 = 0x508;
const EEP: u16 = 0x510;
const TEP: u16 = 0x514;
const GROUP: u16 = 0x800;
const FORK: u16 = 0x910;

const START: u16 = 0x000;
const COUNT: u16 = 0x008;
const CAPTURE: u16 = 0x040;
const COMPARE: u16 = 0x140;
const CC: u16 = 0x540;
const MODE: u16 = 0x504;
const PRESCALER: u16 = 0x510;

fn address(id: u8, offset: u16) -> u32 {
    0x4000_0000 | u32::from(id) << 12 | u32::from(offset)
}

/// Channel 3: TIMER1's compare captures TIMER2 and counts in TIMER3.
fn set_up() -> Bench {
    let mut bench = Bench::new();
    for timer in [TIMER1, TIMER2] {
        bench.write(timer, PRESCALER, 0);
    }
    bench.write(26, MODE, 1);
    bench.task(26, START);
    bench.write(TIMER1, CC, 100);
    bench.write(PPI, EEP + 24, address(TIMER1, COMPARE));
    bench.write(PPI, TEP + 24, address(TIMER2, CAPTURE));
    bench.write(PPI, FORK + 12, address(26, COUNT));
    bench
}

fn counted(bench: &mut Bench) -> u32 {
    bench.task(26, CAPTURE + 4);
    bench.read(26, CC + 4)
}

#[test]
fn an_event_triggers_both_tasks_of_an_enabled_channel_in_the_same_cycle() {
    let mut bench = set_up();
    bench.write(PPI, CHENSET, 1 << 3);
    bench.task(TIMER2, START);
    bench.pass(40);
    bench.task(TIMER1, START);
    bench.pass(5_000);
    assert_eq!(
        bench.read(TIMER2, CC),
        110,
        "ten steps of four cycles earlier"
    );
    assert_eq!(counted(&mut bench), 1);
}

#[test]
fn a_disabled_channel_does_nothing() {
    let mut bench = set_up();
    bench.write(PPI, CHENSET, 1 << 3 | 1 << 4);
    bench.write(PPI, CHENCLR, 1 << 3);
    assert_eq!(bench.read(PPI, CHEN), 1 << 4);
    bench.task(TIMER1, START);
    bench.pass(5_000);
    assert_eq!(counted(&mut bench), 0);
}

#[test]
fn tasks_of_a_group_enable_and_disable_its_channels() {
    let mut bench = set_up();
    bench.write(PPI, GROUP + 8, 1 << 3 | 1 << 7);
    bench.write(PPI, CHEN, 1 << 1);
    bench.task(PPI, 0x010);
    assert_eq!(bench.read(PPI, CHEN), 1 << 1 | 1 << 3 | 1 << 7);
    bench.task(PPI, 0x014);
    assert_eq!(bench.read(PPI, CHEN), 1 << 1);
}

#[test]
fn a_ring_the_fixed_channels_and_tasks_of_what_is_not_modelled_are_refused() {
    let mut bench = Bench::new();
    assert!(bench.try_write(PPI, CHENSET, 1 << 20).is_err());

    // A counter whose compare at 0 steps makes it count again: each of two timers steps the other.
    let mut bench = Bench::new();
    for (channel, from, to) in [(0, TIMER1, TIMER2), (1, TIMER2, TIMER1)] {
        bench.write(from, MODE, 1);
        bench.write(from, 0x508, 1);
        // Every count hits: the shortcut clears, and 1 comes next.
        bench.write(from, CC, 1);
        bench.write(from, 0x200, 1);
        bench.task(from, START);
        bench.write(PPI, EEP + 8 * channel, address(from, COMPARE));
        bench.write(PPI, TEP + 8 * channel, address(to, COUNT));
    }
    bench.write(PPI, CHEN, 0b11);
    let trouble = bench.try_write(TIMER1, COUNT, 1).unwrap_err().to_string();
    assert!(trouble.contains("ring"), "{trouble}");

    let mut bench = Bench::new();
    bench.write(PPI, EEP, address(RTC1, COMPARE));
    bench.write(PPI, TEP, address(7, START));
    bench.write(PPI, CHEN, 1);
    bench.write(RTC1, CC, 1);
    bench.write(RTC1, 0x344, 1 << 16);
    bench.task(RTC1, START);
    bench.pass(10_000);
    let trouble = bench.soc.trouble.take().map(|trouble| trouble.to_string());
    assert!(trouble.is_some_and(|told| told.contains("peripheral 7")));
}
