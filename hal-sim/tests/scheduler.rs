//! Boards, virtual time, UART, repeatability.

#![allow(clippy::unwrap_used)] // in helpers of tests

use std::cell::RefCell;
use std::rc::Rc;

use embedded_hal::digital::InputPin as _;
use embedded_hal::spi::{Operation, SpiDevice as _};
use nova_hal_sim::{
    BoardConfig, BoardHal, Motion, SimConfig, SimDuration, SimError, SimTime, Simulation,
    UartConfig,
};

fn named(name: &str) -> BoardConfig {
    BoardConfig {
        name: name.into(),
        ..BoardConfig::default()
    }
}

fn simulation() -> Simulation {
    Simulation::new(SimConfig::default())
}

fn read_id(hal: &BoardHal) -> [u8; 4] {
    let mut id = [0; 4];
    hal.spi_device()
        .transaction(&mut [Operation::Write(&[0x00]), Operation::Read(&mut id)])
        .unwrap();
    id
}

#[test]
fn boards_run_in_the_order_of_their_local_time() {
    let log = Rc::new(RefCell::new(Vec::new()));
    let mut sim = simulation();
    for (name, period_us) in [("slow", 300u64), ("fast", 200)] {
        let log = Rc::clone(&log);
        sim.add_board(named(name), move |hal| {
            for n in 1..=3 {
                hal.sleep_until(n * period_us);
                log.borrow_mut().push((n * period_us, name));
            }
        });
    }
    sim.run_until(SimTime::from_ms(20)).unwrap();
    assert!(sim.all_finished());
    assert_eq!(
        *log.borrow(),
        [
            (200, "fast"),
            (300, "slow"),
            (400, "fast"),
            (600, "slow"),
            (600, "fast"),
            (900, "slow")
        ]
    );
}

#[test]
fn spi_costs_its_bits_and_the_overhead() {
    let took = Rc::new(RefCell::new(0));
    let out = Rc::clone(&took);
    let mut sim = simulation();
    sim.add_board(named("a"), move |hal| {
        hal.spi_device().set_frequency(1_000_000);
        let start = hal.now_us();
        for _ in 0..100 {
            assert_eq!(read_id(&hal), [0x30, 0x01, 0xCA, 0xDE]);
        }
        *out.borrow_mut() = hal.now_us() - start;
    });
    sim.run_until(SimTime::from_ms(50)).unwrap();
    // 40 bits at 1 MHz and 3 us, a hundred times.
    assert!((4_300..4_302).contains(&*took.borrow()), "{took:?}");
}

#[test]
fn charged_cpu_time_passes_with_the_next_call() {
    let seen = Rc::new(RefCell::new((0, 0)));
    let out = Rc::clone(&seen);
    let mut sim = simulation();
    sim.add_board(named("a"), move |hal| {
        let before = hal.now_us();
        hal.charge_cpu_ns(250_000);
        *out.borrow_mut() = (before, hal.now_us());
    });
    sim.run_until(SimTime::from_ms(50)).unwrap();
    let (before, after) = *seen.borrow();
    assert_eq!(after - before, 250);
}

#[test]
fn a_board_that_polls_lets_others_run() {
    let mut sim = simulation();
    sim.add_board(
        named("poller"),
        |hal| {
            while !hal.irq().is_high().unwrap() {}
        },
    );
    sim.add_board(named("other"), |hal| hal.sleep_until(1_000));
    sim.run_until(SimTime::from_ms(7)).unwrap();
    let stats = sim.stats();
    assert!(!stats.boards[0].finished && stats.boards[1].finished);
}

#[test]
fn waiting_for_the_interrupt_ends_at_the_deadline() {
    let seen = Rc::new(RefCell::new(None));
    let out = Rc::clone(&seen);
    let mut sim = simulation();
    sim.add_board(named("a"), move |hal| {
        let high = hal.wait_irq_until(700);
        *out.borrow_mut() = Some((high, hal.now_us()));
    });
    sim.run_until(SimTime::from_ms(7)).unwrap();
    assert_eq!(*seen.borrow(), Some((false, 700)));
}

#[test]
fn a_panic_names_its_board_and_spares_the_others() {
    let mut sim = simulation();
    sim.add_board(named("good"), |hal| hal.sleep_until(50_000));
    sim.add_board(named("bad"), |hal| {
        hal.sleep_until(1_000);
        panic!("out of {}", "luck");
    });
    let error = sim.run_until(SimTime::from_ms(100)).unwrap_err();
    let SimError::BoardPanicked { board, message } = error else {
        panic!("wrong error");
    };
    assert_eq!((board.as_str(), message.as_str()), ("bad", "out of luck"));
    sim.run_until(SimTime::from_ms(100)).unwrap();
    assert!(sim.all_finished());
}

#[test]
fn boards_that_never_return_are_dropped_with_their_destructors_run() {
    struct OnDrop(Rc<RefCell<bool>>, BoardHal);
    impl Drop for OnDrop {
        fn drop(&mut self) {
            self.1.sleep_until(u64::MAX); // must neither hang nor crash
            *self.0.borrow_mut() = true;
        }
    }
    let dropped = Rc::new(RefCell::new(false));
    let guard = Rc::clone(&dropped);
    let mut sim = simulation();
    sim.add_board(named("a"), move |hal| {
        let _guard = OnDrop(guard, hal.clone());
        loop {
            hal.sleep_until(hal.now_us() + 100);
        }
    });
    sim.run_until(SimTime::from_ms(10)).unwrap();
    drop(sim);
    assert!(*dropped.borrow());
}

#[test]
fn uart_bytes_arrive_at_the_pace_of_the_line() {
    let mut sim = simulation();
    let config = BoardConfig {
        uart: UartConfig {
            baud: 100_000,
            buffer_bytes: 20,
        },
        ..named("a")
    };
    let id = sim.add_board(config, |hal| {
        assert_eq!(hal.uart().write(&[1; 15]), 15);
        assert_eq!(hal.uart().write(&[2; 15]), 5);
    });
    // Boot at 5 ms, 0.1 ms a byte.
    sim.run_until(SimTime::from_us(6_400)).unwrap();
    assert!(sim.uart(id).is_empty());
    sim.run_until(SimTime::from_ms(10)).unwrap();
    let chunks = sim.uart(id);
    assert_eq!(chunks.len(), 2);
    assert_eq!(chunks[0].bytes, [1; 15]);
    assert_eq!(
        chunks[0].t.since(SimTime::from_ms(5)).as_fs() / 1_000_000_000,
        1_500
    );
    assert_eq!(chunks[1].bytes, [2; 5]);
    assert_eq!(sim.stats().boards[0].uart_overflow_bytes, 10);
}

#[test]
fn bytes_from_the_host_reach_the_board() {
    let mut sim = simulation();
    let id = sim.add_board(named("echo"), |hal| {
        let mut buffer = [0; 16];
        loop {
            let n = hal.uart_rx().read(&mut buffer);
            hal.uart().write(&buffer[..n]);
            hal.sleep_until(hal.now_us() + 1_000);
        }
    });
    sim.run_until(SimTime::from_ms(10)).unwrap();
    sim.uart_send(id, b"range");
    sim.run_for(SimDuration::from_ms(10)).unwrap();
    let echoed: Vec<u8> = sim.uart(id).into_iter().flat_map(|c| c.bytes).collect();
    assert_eq!(echoed, b"range");
}

#[test]
fn true_distance_follows_the_path() {
    let mut sim = simulation();
    let a = sim.add_board(named("still"), |_| {});
    let moving = BoardConfig {
        motion: Motion::path(|t| [3.0 * t, 4.0 * t, 0.0]),
        ..named("moving")
    };
    let b = sim.add_board(moving, |_| {});
    let d = sim.true_distance_m(a, b, SimTime::from_s_f64(2.0));
    assert!((d - 10.0).abs() < 1e-9);
}
