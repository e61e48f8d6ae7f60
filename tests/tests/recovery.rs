//! A radio that fails is noticed and started again.
#![allow(clippy::unwrap_used)]

use nova_cli::sim_node::radio_bus;
use nova_hal_sim::{BoardConfig, BoardHal, Motion, SimConfig, SimTime, Simulation};
use nova_node::ranging::Address;
use nova_node::{Node, NodeConfig};
use nova_wire::{Counters, Record};
use std::cell::RefCell;
use std::rc::Rc;

use embedded_hal::digital::OutputPin;

/// What happens to a board's radio behind its node's back.
#[derive(Clone, Copy, PartialEq)]
enum Mishap {
    None,
    /// It loses its supply for a moment and comes back with nothing set.
    BrownOut,
    /// It is held in reset for half a second: nobody drives the bus.
    Absent,
    /// The bus runs too fast while its clock is not locked, which upsets it
    /// until the next reset.
    Upset,
}

/// Times of all ranges that a node reported, and its last counters.
#[derive(Default)]
struct Seen {
    ranges_us: Vec<u64>,
    counters: Counters,
}

const MISHAP_US: u64 = 3_000_000;
const END_S: f64 = 8.0;

fn serve(hal: &BoardHal, config: NodeConfig, mishap: Mishap, seen: &RefCell<Seen>) {
    let mut node = Node::new(radio_bus(hal), hal.rst(), hal.delay(), config).unwrap();
    let mut reset = hal.rst();
    let mut pending = mishap != Mishap::None;
    let mut release_us = None;
    loop {
        if pending && hal.now_us() >= MISHAP_US {
            pending = false;
            reset.set_low().unwrap();
            match mishap {
                Mishap::None => {}
                Mishap::BrownOut => reset.set_high().unwrap(),
                Mishap::Absent => release_us = Some(MISHAP_US + 500_000),
                Mishap::Upset => {
                    reset.set_high().unwrap();
                    // The bus is still at full speed.
                    let mut spi = hal.spi_device();
                    let _ = embedded_hal::spi::SpiDevice::write(&mut spi, &[0x00, 0x00]);
                }
            }
        }
        if release_us.is_some_and(|at| hal.now_us() >= at) {
            release_us = None;
            reset.set_high().unwrap();
        }
        let now_us = hal.now_us();
        let wake_us = node.service(now_us, &mut |record| match record {
            Record::Range(_) => seen.borrow_mut().ranges_us.push(now_us),
            Record::Status(status) => seen.borrow_mut().counters = status.counters,
            _ => {}
        });
        let wake_us = release_us.map_or(wake_us, |at| wake_us.min(at));
        hal.wait_irq_until(wake_us);
    }
}

/// Runs an anchor and a tag, and returns what the anchor reported.
fn run(to_anchor: Mishap, to_tag: Mishap) -> [Rc<RefCell<Seen>>; 2] {
    let mut sim = Simulation::new(SimConfig::default());
    let mut anchor = NodeConfig::anchor(Address(0x0A));
    if let nova_node::Part::Initiator { peers, .. } = &mut anchor.part {
        peers.push(Address(1)).unwrap();
    }
    let nodes = [
        (anchor, to_anchor, 0.0),
        (NodeConfig::tag(Address(1)), to_tag, 5.0),
    ];
    let seen = nodes.map(|(config, mishap, x)| {
        let seen = Rc::new(RefCell::new(Seen::default()));
        let board = BoardConfig {
            motion: Motion::fixed([x, 0.0, 0.0]),
            ..BoardConfig::default()
        };
        let inside = Rc::clone(&seen);
        sim.add_board(board, move |hal| serve(&hal, config, mishap, &inside));
        seen
    });
    sim.run_until(SimTime::from_s_f64(END_S)).unwrap();
    seen
}

/// Ranges between two times.
fn ranges(seen: &Seen, from_s: f64, to_s: f64) -> usize {
    seen.ranges_us
        .iter()
        .filter(|&&us| (from_s..to_s).contains(&(us as f64 * 1e-6)))
        .count()
}

#[test]
fn without_mishap_no_radio_is_started_again() {
    for seen in run(Mishap::None, Mishap::None) {
        assert_eq!(seen.borrow().counters.radio_resets, 0);
        assert!(ranges(&seen.borrow(), 0.0, END_S) > 780);
    }
}

#[test]
fn a_radio_that_fails_ranges_again_within_two_seconds_and_says_so() {
    for mishap in [Mishap::BrownOut, Mishap::Absent, Mishap::Upset] {
        for victim in [0, 1] {
            let seen = match victim {
                0 => run(mishap, Mishap::None),
                _ => run(Mishap::None, mishap),
            };
            let anchor = seen[0].borrow();
            assert!(ranges(&anchor, 0.0, 3.0) > 290);
            assert!(ranges(&anchor, 5.0, 6.0) > 90, "{:?}", anchor.counters);
            let resets = seen[victim].borrow().counters.radio_resets;
            assert!((1..=10).contains(&resets), "{resets} resets");
            assert_eq!(seen[1 - victim].borrow().counters.radio_resets, 0);
        }
    }
}
