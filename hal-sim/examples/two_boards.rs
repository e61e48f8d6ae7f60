//! Two simulated boards measure their distance with the `dw1000` crate's own high-level API.
//!
//! `cargo run -p nova-hal-sim --release --example two_boards`

#![allow(clippy::unwrap_used)] // a failing board should stop the example

use std::cell::RefCell;
use std::error::Error;
use std::rc::Rc;

use dw1000::mac::{PanId, ShortAddress};
use dw1000::ranging::{
    Message, Ping, Request, Response, RxMessage, TxMessage, compute_distance_mm,
};
use dw1000::{DW1000, Ready, RxConfig};
use nova_hal_sim::board::{ChipSelect, Spi};
use nova_hal_sim::{BoardConfig, BoardHal, ClockConfig, Motion, SimConfig, SimTime, Simulation};

type Radio = DW1000<Spi, ChipSelect, Ready>;

const ANTENNA_DELAY_TICKS: u16 = 16_456;

fn main() -> Result<(), Box<dyn Error>> {
    let mut sim = Simulation::new(SimConfig::default());
    let ranges_mm = Rc::new(RefCell::new(Vec::new()));

    let anchor = sim.add_board(board("anchor", 7.0, Motion::fixed([0.0; 3])), anchor_main);
    let out = Rc::clone(&ranges_mm);
    let tag = sim.add_board(
        board("tag", -4.0, Motion::path(|t_s| [5.0 + t_s, 0.0, 0.0])),
        move |hal| tag_main(&hal, &mut |mm| out.borrow_mut().push(mm)),
    );

    println!(
        "  t [s]  true [m]  measured [m] (the crate takes the clock for 64 GHz, 0.16 % short, and leaves the bias in)"
    );
    for second in 1..=5 {
        let t = SimTime::from_s_f64(f64::from(second));
        sim.run_until(t)?;
        if let Some(mm) = ranges_mm.borrow().last() {
            let true_m = sim.true_distance_m(anchor, tag, t);
            println!("{second:7}  {true_m:8.3}  {:12.3}", *mm as f64 / 1000.0);
        }
    }
    println!("{} ranges", ranges_mm.borrow().len());
    Ok(())
}

fn board(name: &str, ppm: f64, motion: Motion) -> BoardConfig {
    BoardConfig {
        name: name.into(),
        clock: ClockConfig {
            ppm,
            ..ClockConfig::default()
        },
        rx_noise_ps: 100.0,
        motion,
        ..BoardConfig::default()
    }
}

/// SPI cannot fail on a simulated board, so neither can the crate's calls here.
fn radio(hal: &BoardHal, address: u16) -> Radio {
    let mut radio = DW1000::new(hal.spi(), hal.cs())
        .init(&mut hal.delay())
        .unwrap();
    radio
        .set_antenna_delay(ANTENNA_DELAY_TICKS, ANTENNA_DELAY_TICKS)
        .unwrap();
    radio
        .set_address(PanId(0x0D57), ShortAddress(address))
        .unwrap();
    radio
}

/// Pings, and answers the request that follows with a response.
fn anchor_main(hal: BoardHal) {
    let mut radio = radio(&hal, 1);
    loop {
        let ping = Ping::new(&mut radio).unwrap();
        radio = send(radio, &ping);
        let (next, request) = receive::<Request>(&hal, radio);
        radio = next;
        if let Some(request) = request {
            let response = Response::new(&mut radio, &request).unwrap();
            radio = send(radio, &response);
        }
        hal.sleep_until(hal.now_us() + 50_000);
    }
}

/// Answers pings with requests and computes the range from the response.
fn tag_main(hal: &BoardHal, report_mm: &mut dyn FnMut(u64)) {
    let mut radio = radio(hal, 2);
    loop {
        let (mut next, ping) = receive::<Ping>(hal, radio);
        if let Some(ping) = ping {
            let request = Request::new(&mut next, &ping).unwrap();
            next = send(next, &request);
            let (after, response) = receive::<Response>(hal, next);
            next = after;
            if let Some(Ok(mm)) = response.map(|r| compute_distance_mm(&r)) {
                report_mm(mm);
            }
        }
        radio = next;
    }
}

fn send<M: Message>(radio: Radio, message: &TxMessage<M>) -> Radio {
    let mut sending = message.send(radio).unwrap();
    nb::block!(sending.wait_transmit()).unwrap();
    sending.finish_sending().unwrap()
}

/// Waits up to 100 ms for a message of type `M`.
fn receive<M: Message>(hal: &BoardHal, radio: Radio) -> (Radio, Option<RxMessage<M>>) {
    let mut receiving = radio.receive(RxConfig::default()).unwrap();
    receiving
        .ll()
        .sys_mask()
        .modify(|_, w| w.mrxdfr(1))
        .unwrap();
    let mut buffer = [0; 128];
    let mut message = None;
    if hal.wait_irq_until(hal.now_us() + 100_000)
        && let Ok(frame) = nb::block!(receiving.wait_receive(&mut buffer))
    {
        message = M::decode::<Spi, ChipSelect>(&frame).ok().flatten();
    }
    (receiving.finish_receiving().unwrap(), message)
}
