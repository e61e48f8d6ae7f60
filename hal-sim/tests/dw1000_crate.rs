//! A driver that nobody here wrote runs on the simulator unmodified: the high-level API of the `dw1000` crate.

#![allow(clippy::unwrap_used, clippy::expect_used)] // in helpers of tests

use std::cell::RefCell;
use std::rc::Rc;

use dw1000::hl::{SendTime, SingleBufferReceiving};
use dw1000::mac::{Address, PanId, ShortAddress};
use dw1000::ranging::{
    Message, Ping, Request, Response, RxMessage, TxMessage, compute_distance_mm,
};
use dw1000::time::Duration;
use dw1000::{DW1000, Error, Ready, RxConfig, TxConfig};
use nova_hal_sim::board::{ChipSelect, Spi};
use nova_hal_sim::chip::{LevelReport, MASK_POWER_DBM, Quirks};
use nova_hal_sim::clock::COUNTER_WRAP;
use nova_hal_sim::phy::Channel;
use nova_hal_sim::{
    BoardConfig, BoardHal, BoardId, ChannelConfig, ClockConfig, Motion, SimConfig, SimTime,
    Simulation,
};

type Radio = DW1000<Spi, ChipSelect, Ready>;

const PAN: PanId = PanId(0x0D57);
const ANTENNA_DELAY_TICKS: u16 = 16_456;

fn board(x_m: f64, ppm: f64) -> BoardConfig {
    BoardConfig {
        name: format!("board at {x_m} m"),
        clock: ClockConfig {
            ppm,
            ..ClockConfig::default()
        },
        motion: Motion::fixed([x_m, 0.0, 0.0]),
        // That driver corrects neither.
        quirks: Quirks {
            range_bias: false,
            level_report: LevelReport::Linear,
            ..Quirks::default()
        },
        ..BoardConfig::default()
    }
}

fn radio(hal: &BoardHal, address: u16) -> Radio {
    let mut radio = DW1000::new(hal.spi(), hal.cs())
        .init(&mut hal.delay())
        .unwrap();
    radio
        .set_antenna_delay(ANTENNA_DELAY_TICKS, ANTENNA_DELAY_TICKS)
        .unwrap();
    radio.set_address(PAN, ShortAddress(address)).unwrap();
    radio
}

fn to(address: u16) -> Option<Address> {
    Some(Address::Short(PAN, ShortAddress(address)))
}

fn send(radio: Radio, body: &[u8], address: u16, when: SendTime) -> (Radio, u64) {
    let mut sending = radio
        .send(body, to(address), when, TxConfig::default())
        .unwrap();
    let stamp = nb::block!(sending.wait_transmit()).unwrap();
    (sending.finish_sending().unwrap(), stamp.value())
}

/// A frame's payload and time stamp, or the crate's error.
type Received = Result<(Vec<u8>, u64), String>;

/// What comes within 100 ms.
fn receive(hal: &BoardHal, radio: Radio) -> Option<Received> {
    let mut receiving = radio.receive(RxConfig::default()).unwrap();
    enable_interrupts(&mut receiving);
    let mut buffer = [0; 128];
    hal.wait_irq_until(hal.now_us() + 100_000).then(|| {
        nb::block!(receiving.wait_receive(&mut buffer))
            .map(|m| (m.frame.payload.to_vec(), m.rx_time.value()))
            .map_err(|e| format!("{e:?}"))
    })
}

/// Interrupts for whatever ends a reception.
fn enable_interrupts(receiving: &mut DW1000<Spi, ChipSelect, SingleBufferReceiving>) {
    receiving
        .ll()
        .sys_mask()
        .write(|w| w.mrxdfr(1).maffrej(1).mrxrfsl(1).mrxphe(1))
        .unwrap();
}

/// Runs two boards for a second; each stores one value.
fn run<A: 'static, B: 'static>(
    config: SimConfig,
    distance_m: f64,
    a: impl FnOnce(BoardHal) -> A + 'static,
    b: impl FnOnce(BoardHal) -> B + 'static,
) -> (A, B) {
    let results = (Rc::new(RefCell::new(None)), Rc::new(RefCell::new(None)));
    let (out_a, out_b) = (Rc::clone(&results.0), Rc::clone(&results.1));
    let mut sim = Simulation::new(config);
    sim.add_board(board(0.0, 0.0), move |hal| {
        *out_a.borrow_mut() = Some(a(hal));
    });
    sim.add_board(board(distance_m, 0.0), move |hal| {
        *out_b.borrow_mut() = Some(b(hal));
    });
    sim.run_until(SimTime::from_s_f64(1.0)).unwrap();
    let a = results.0.borrow_mut().take().expect("board a returned");
    let b = results.1.borrow_mut().take().expect("board b returned");
    (a, b)
}

#[test]
fn a_frame_sent_is_received_with_both_time_stamps() {
    let distance_m = 20.0;
    let (sent, received) = run(
        SimConfig::default(),
        distance_m,
        |hal| {
            let radio = radio(&hal, 1);
            hal.sleep_until(30_000);
            send(radio, b"hello", 2, SendTime::Now).1
        },
        |hal| {
            let radio = radio(&hal, 2);
            receive(&hal, radio)
        },
    );
    let (payload, rx_stamp) = received.expect("in time").expect("no error");
    assert_eq!(payload, b"hello");
    // Both clocks started together and run alike.
    let flight_ticks = rx_stamp as f64 - sent as f64;
    let expected = distance_m / 299_702_547.0 * 63.8976e9;
    assert!((flight_ticks - expected).abs() <= 1.0, "{flight_ticks}");
}

#[test]
fn a_delayed_frame_leaves_at_the_time_asked_for_rounded_down_to_512_ticks() {
    let (asked, sent) = run(
        SimConfig::default(),
        5.0,
        |hal| {
            let mut radio = radio(&hal, 1);
            let when = radio.sys_time().unwrap() + Duration::from_nanos(3_000_005);
            (
                when.value(),
                send(radio, b"later", 2, SendTime::Delayed(when)).1,
            )
        },
        |_| {},
    )
    .0;
    assert_ne!(asked % 512, 0);
    assert_eq!(sent, asked / 512 * 512 + u64::from(ANTENNA_DELAY_TICKS));
}

#[test]
fn a_delayed_frame_in_the_past_is_refused_as_too_late() {
    let (late, ()) = run(
        SimConfig::default(),
        5.0,
        |hal| {
            let mut radio = radio(&hal, 1);
            let when = radio.sys_time().unwrap();
            let mut sending = radio
                .send(b"late", to(2), SendTime::Delayed(when), TxConfig::default())
                .unwrap();
            matches!(
                nb::block!(sending.wait_transmit()),
                Err(Error::DelayedSendTooLate)
            )
        },
        |_| {},
    );
    assert!(late);
}

#[test]
fn a_frame_for_somebody_else_is_rejected_by_the_filter() {
    let ((), received) = run(
        SimConfig::default(),
        5.0,
        |hal| {
            let radio = radio(&hal, 1);
            hal.sleep_until(30_000);
            send(radio, b"not you", 3, SendTime::Now);
        },
        |hal| {
            let radio = radio(&hal, 2);
            receive(&hal, radio)
        },
    );
    assert_eq!(received, Some(Err("FrameFilteringRejection".into())));
}

#[test]
fn the_reported_signal_strength_is_that_of_the_link() {
    let distance_m = 15.0;
    let ((), (rssi, confidence)) = run(
        SimConfig::default(),
        distance_m,
        |hal| {
            let radio = radio(&hal, 1);
            hal.sleep_until(30_000);
            send(radio, b"hello", 2, SendTime::Now);
        },
        |hal| {
            let mut receiving = radio(&hal, 2).receive(RxConfig::default()).unwrap();
            let mut buffer = [0; 128];
            nb::block!(receiving.wait_receive(&mut buffer)).unwrap();
            let quality = receiving.read_rx_quality().unwrap();
            (f64::from(quality.rssi), quality.los_confidence_level)
        },
    );
    // The crate's power setting boosts frames below 250 us by two coarse steps of 2.5 dB.
    let loss_db = ChannelConfig::default().path_loss_db(Channel::Ch5, distance_m);
    let expected = MASK_POWER_DBM + 5.0 - loss_db;
    assert!((rssi - expected).abs() < 0.5, "{rssi} dBm, not {expected}");
    // The crate reads the impulse response from the wrong place, so this says nothing about the link.
    assert!((0.0..=1.0).contains(&confidence));
}

#[test]
fn double_buffered_reception_loses_no_frame_of_a_burst() {
    let ((), payloads) = run(
        SimConfig::default(),
        5.0,
        |hal| {
            let mut radio = radio(&hal, 1);
            hal.sleep_until(30_000);
            for n in 0..5u8 {
                radio = send(radio, &[n; 8], 2, SendTime::Now).0;
            }
        },
        |hal| {
            let config = RxConfig {
                frame_filtering: false,
                ..RxConfig::default()
            };
            let mut receiving = radio(&hal, 2).receive_auto_double_buffered(config).unwrap();
            let mut buffer = [0; 128];
            let mut payloads = Vec::new();
            while payloads.len() < 5 {
                let message = nb::block!(receiving.wait_receive(&mut buffer)).unwrap();
                payloads.push(message.frame.payload.to_vec());
                receiving = receiving.continue_receiving().ok().unwrap();
            }
            payloads
        },
    );
    assert_eq!(payloads, (0..5u8).map(|n| vec![n; 8]).collect::<Vec<_>>());
}

// Ranging: ping, request, response between two boards.

fn send_message<M: Message>(radio: Radio, message: &TxMessage<M>) -> Radio {
    let mut sending = message.send(radio).unwrap();
    nb::block!(sending.wait_transmit()).unwrap();
    sending.finish_sending().unwrap()
}

fn receive_message<M: Message>(hal: &BoardHal, radio: Radio) -> (Radio, Option<RxMessage<M>>) {
    let mut receiving = radio.receive(RxConfig::default()).unwrap();
    enable_interrupts(&mut receiving);
    let mut buffer = [0; 128];
    let mut message = None;
    if hal.wait_irq_until(hal.now_us() + 60_000)
        && let Ok(frame) = nb::block!(receiving.wait_receive(&mut buffer))
    {
        message = M::decode::<Spi, ChipSelect>(&frame).ok().flatten();
    }
    (receiving.finish_receiving().unwrap(), message)
}

fn anchor_main(hal: &BoardHal) {
    let mut radio = radio(hal, 1);
    loop {
        let ping = Ping::new(&mut radio).unwrap();
        radio = send_message(radio, &ping);
        let (next, request) = receive_message::<Request>(hal, radio);
        radio = next;
        if let Some(request) = request {
            let response = Response::new(&mut radio, &request).unwrap();
            radio = send_message(radio, &response);
        }
        hal.sleep_until(hal.now_us() + 20_000);
    }
}

fn tag_main(hal: &BoardHal, ranges_mm: &RefCell<Vec<u64>>) {
    let mut radio = radio(hal, 2);
    loop {
        let (next, ping) = receive_message::<Ping>(hal, radio);
        radio = next;
        let Some(ping) = ping else { continue };
        let request = Request::new(&mut radio, &ping).unwrap();
        radio = send_message(radio, &request);
        let (next, response) = receive_message::<Response>(hal, radio);
        radio = next;
        if let Some(Ok(mm)) = response.map(|r| compute_distance_mm(&r)) {
            ranges_mm.borrow_mut().push(mm);
        }
    }
}

struct Ranging {
    seed: u64,
    distance_m: f64,
    anchor_clock: ClockConfig,
    tag_clock: ClockConfig,
    rx_noise_ps: f64,
    duration_s: f64,
    /// Called with the tag before the run.
    disturb: fn(&mut Simulation, BoardId),
}

impl Default for Ranging {
    fn default() -> Self {
        Ranging {
            seed: 7,
            distance_m: 20.0,
            anchor_clock: ClockConfig::default(),
            tag_clock: ClockConfig::default(),
            rx_noise_ps: 0.0,
            duration_s: 2.0,
            disturb: |_, _| {},
        }
    }
}

impl Ranging {
    fn run_mm(self) -> Vec<u64> {
        let ranges_mm = Rc::new(RefCell::new(Vec::new()));
        let out = Rc::clone(&ranges_mm);
        let mut sim = Simulation::new(SimConfig {
            seed: self.seed,
            ..SimConfig::default()
        });
        let config = |x_m, clock| BoardConfig {
            clock,
            rx_noise_ps: self.rx_noise_ps,
            ..board(x_m, 0.0)
        };
        sim.add_board(config(0.0, self.anchor_clock), |hal| anchor_main(&hal));
        let tag = sim.add_board(config(self.distance_m, self.tag_clock), move |hal| {
            tag_main(&hal, &out);
        });
        (self.disturb)(&mut sim, tag);
        sim.run_until(SimTime::from_s_f64(self.duration_s)).unwrap();
        drop(sim);
        ranges_mm.take()
    }
}

/// What the crate makes of a true distance: time of flight cut to whole ticks, the clock taken for 64 GHz, light in
/// vacuum.
fn crate_mm(distance_m: f64, tick_error: f64) -> u64 {
    let ticks = (distance_m / 299_702_547.0 * 63.8976e9 + tick_error).floor() as u64;
    299_792_458 * ticks / 64 / 1_000_000
}

#[test]
fn ranging_lands_where_the_crates_64_ghz_and_truncation_put_it() {
    for distance_m in [3.0, 20.0, 45.0] {
        let ranges = Ranging {
            distance_m,
            ..Ranging::default()
        }
        .run_mm();
        assert!(ranges.len() > 20, "{} ranges", ranges.len());
        // Each receive stamp is rounded to a tick, which moves the result by at most one tick.
        let allowed = crate_mm(distance_m, -1.0)..=crate_mm(distance_m, 1.0);
        for mm in &ranges {
            assert!(allowed.contains(mm), "{mm} mm for {distance_m} m");
        }
        assert!((*allowed.end() as f64) < distance_m * 1000.0);
    }
}

#[test]
fn ranging_does_not_care_about_clock_offsets() {
    let clock = |ppm| ClockConfig {
        ppm,
        drift_ppm_per_s: 0.01,
        ..ClockConfig::default()
    };
    let ranges = Ranging {
        anchor_clock: clock(20.0),
        tag_clock: clock(-20.0),
        ..Ranging::default()
    }
    .run_mm();
    assert!(ranges.len() > 20);
    let allowed = crate_mm(20.0, -2.0)..=crate_mm(20.0, 2.0);
    assert!(ranges.iter().all(|mm| allowed.contains(mm)), "{ranges:?}");
}

#[test]
fn ranging_goes_on_across_the_wrap_of_either_counter() {
    let before_wrap = |s: f64| ClockConfig {
        offset_ticks: COUNTER_WRAP - (s * 63.8976e9) as u64,
        ..ClockConfig::default()
    };
    let ranges = Ranging {
        anchor_clock: before_wrap(0.5),
        tag_clock: before_wrap(1.2),
        ..Ranging::default()
    }
    .run_mm();
    assert!(ranges.len() > 20);
    let allowed = crate_mm(20.0, -1.0)..=crate_mm(20.0, 1.0);
    assert!(ranges.iter().all(|mm| allowed.contains(mm)), "{ranges:?}");
}

#[test]
fn a_lost_frame_costs_one_range_and_no_more() {
    let undisturbed = Ranging::default().run_mm().len();
    let disturbed = Ranging {
        disturb: |sim, tag| sim.drop_next(tag, 1),
        ..Ranging::default()
    }
    .run_mm()
    .len();
    assert!(
        (1..=3).contains(&(undisturbed - disturbed)),
        "{undisturbed} and {disturbed}"
    );
}

#[test]
fn equal_seeds_give_identical_ranges_and_others_do_not() {
    let noisy = |seed| {
        Ranging {
            seed,
            rx_noise_ps: 150.0,
            ..Ranging::default()
        }
        .run_mm()
    };
    assert_eq!(noisy(1), noisy(1));
    assert_ne!(noisy(1), noisy(2));
}
