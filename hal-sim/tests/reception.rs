//! Receiving: time stamps, timeouts, errors, filtering, collisions.

mod bench;

use bench::*;
use nova_hal_sim::chip::ChipConfig;
use nova_hal_sim::world::ChipId;
use nova_hal_sim::{ChannelConfig, Fault, LinkEffect, Motion, SimDuration, SimTime};

const FRAME: &[u8] = b"\x41\x88\x00\xCA\xDE\x02\x00\x01\x00hello";
const TICK_M: f64 = 299_702_547.0 / 63_897_600_000.0;

/// Sends from a to b and returns the flight time in ticks that the stamps show, chips sharing one perfect time base.
fn stamped_flight_ticks(bench: &mut Bench, a: ChipId, b: ChipId) -> f64 {
    bench.clear_status(b);
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & (RXFCG | LDEDONE), RXFCG | LDEDONE, "{status:#x}");
    bench.rx_time(b) as f64 - bench.tx_time(a) as f64
}

fn set_antenna_delays(bench: &mut Bench, chip: ChipId, ticks: u16) {
    bench.write(chip, 0x18, 0, &ticks.to_le_bytes());
    bench.write(chip, 0x2E, 0x1804, &ticks.to_le_bytes());
}

#[test]
fn stamps_of_calibrated_boards_differ_by_the_flight_time() {
    for distance_m in [0.5, 12.345, 30.0] {
        let (mut bench, [a, b]) = Bench::ready([at(0.0), at(distance_m)]);
        set_antenna_delays(&mut bench, a, 16_456);
        set_antenna_delays(&mut bench, b, 16_456);
        let ticks = stamped_flight_ticks(&mut bench, a, b);
        assert!((ticks - distance_m / TICK_M).abs() <= 1.0, "{ticks}");
    }
}

#[test]
fn a_wrong_antenna_delay_shows_as_a_range_offset() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    set_antenna_delays(&mut bench, a, 16_456 - 100);
    set_antenna_delays(&mut bench, b, 16_456 - 50);
    let ticks = stamped_flight_ticks(&mut bench, a, b);
    assert!((ticks - 10.0 / TICK_M - 150.0).abs() <= 1.0, "{ticks}");
}

#[test]
fn an_obstructed_link_is_late_and_its_first_path_weak() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    let effect = LinkEffect {
        extra_delay_ps: 3_000.0,
        loss_db: 3.0,
        first_path_loss_db: 9.0,
    };
    set_antenna_delays(&mut bench, a, 16_456);
    set_antenna_delays(&mut bench, b, 16_456);
    bench.world.set_link_effect(a, b, effect);
    let ticks = stamped_flight_ticks(&mut bench, a, b);
    assert!((ticks - 10.0 / TICK_M - 3_000.0 / 15.650).abs() <= 1.0);
}

#[test]
fn a_moving_board_counts_where_it_is_at_the_rmarker() {
    // The board jumps 10 m outwards that long after the frame's preamble began; the RMARKER comes at 135 us.
    for (jump_us, expected_m) in [(130, 20.0), (140, 10.0)] {
        let begin = SimTime::from_ms(10);
        let jump_s = (begin + SimDuration::from_us(jump_us)).as_s_f64();
        let jumper = ChipConfig {
            motion: Motion::path(move |t_s| [if t_s < jump_s { 10.0 } else { 20.0 }, 0.0, 0.0]),
            ..at(0.0)
        };
        let (mut bench, [a, b]) = Bench::ready([at(0.0), jumper]);
        set_antenna_delays(&mut bench, a, 16_456);
        set_antenna_delays(&mut bench, b, 16_456);
        bench.load_frame(a, FRAME);
        bench.command(b, RXENAB);
        // The command is 20 us on the bus and the transmitter starts up for 10 us.
        bench.world.advance_to(begin - SimDuration::from_us(30));
        bench.command(a, TXSTRT);
        bench.wait_us(1_000);
        let ticks = bench.rx_time(b) as f64 - bench.tx_time(a) as f64;
        assert!((ticks - expected_m / TICK_M).abs() <= 1.0, "{ticks}");
    }
}

#[test]
fn time_stamp_noise_has_the_configured_spread() {
    let noisy = ChipConfig {
        rx_noise_ps: 200.0,
        ..at(10.0)
    };
    let (mut bench, [a, b]) = Bench::ready([at(0.0), noisy]);
    let ticks: Vec<f64> = (0..400)
        .map(|_| stamped_flight_ticks(&mut bench, a, b))
        .collect();
    let mean = ticks.iter().sum::<f64>() / 400.0;
    let variance = ticks.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / 399.0;
    let std_ps = variance.sqrt() * 15.650;
    // Six standard errors of a standard deviation from 400 samples are 21 %.
    assert!((std_ps - 200.0).abs() < 0.21 * 200.0, "{std_ps} ps");
}

const DATA_EVENTS: u64 = RXDFR | RXFCG | RXFCE | LDEDONE | LDEERR;

#[test]
fn without_microcode_a_frame_is_ready_but_neither_good_nor_bad_nor_stamped() {
    let (mut bench, [a, b]) = Bench::cold([at(0.0), at(10.0)]);
    // The second frame arrives with a bad FCS.
    bench.world.add_fault(Fault::corrupt_nth(a, 1));
    for frame in ["whole", "corrupt"] {
        let status = bench.exchange(a, b, FRAME);
        assert_eq!(status & DATA_EVENTS, RXDFR, "{frame}");
        assert_eq!(bench.rx_time(b), 0, "{frame}");
    }
    let stats = bench.world.chip_stats(b);
    assert_eq!((stats.frames_good, stats.frames_bad_fcs), (0, 0));
    bench.load_lde(b);
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & DATA_EVENTS, RXDFR | RXFCG | LDEDONE);
}

#[test]
fn with_the_leading_edge_search_switched_off_frames_are_good_but_not_stamped() {
    let (mut bench, [a, b]) = Bench::cold([at(0.0), at(10.0)]);
    let ctrl1 = bench.number(b, PMSC, 4, 4) as u32 & !(1 << 17); // LDERUNE
    bench.write(b, PMSC, 4, &ctrl1.to_le_bytes());
    for microcode in ["missing", "loaded"] {
        let status = bench.exchange(a, b, FRAME);
        assert_eq!(status & DATA_EVENTS, RXDFR | RXFCG, "{microcode}");
        assert_eq!(bench.rx_time(b), 0, "{microcode}");
        bench.load_lde(b);
    }
}

#[test]
fn received_bytes_and_frame_info_are_those_sent() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.exchange(a, b, FRAME);
    assert_eq!(bench.read(b, RX_BUFFER, 0, FRAME.len()), FRAME);
    let finfo = bench.number(b, RX_FINFO, 0, 4);
    assert_eq!(finfo & 0x7F, FRAME.len() as u64 + 2);
    assert_eq!(finfo >> 13 & 0b11, 0b10, "6.8 Mbit/s");
    assert_eq!(finfo >> 16 & 0b11, 0b01, "PRF 16 MHz");
}

#[test]
fn settings_that_differ_are_not_received() {
    for (what, chan_ctrl, sys_cfg) in [
        ("channel", 0x2104_0053u32, 0x1200u32), // receiver on channel 5, sender on 3
        ("code", 0x1104_0055, 0x1200),
        ("SFD", 0x2106_0055, 0x1200),
        ("rate", 0x2104_0055, 0x0040_1200),
    ] {
        let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
        let odd = if what == "channel" { a } else { b };
        bench.write(odd, CHAN_CTRL, 0, &chan_ctrl.to_le_bytes());
        bench.write(b, SYS_CFG, 0, &sys_cfg.to_le_bytes());
        let status = bench.exchange(a, b, FRAME);
        assert_eq!(status & (RXDFR | RXSFDD), 0, "{what}");
    }
}

#[test]
fn an_undetected_sfd_times_out() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.write(b, CHAN_CTRL, 0, &0x2106_0055u32.to_le_bytes());
    bench.write(b, DRX, 0x20, &(128u16 + 1 + 8 - 8).to_le_bytes());
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & (RXPRD | RXSFDD | RXSFDTO), RXPRD | RXSFDTO);
}

#[test]
fn a_frame_too_weak_for_its_rate_is_not_received() {
    let (mut bench, [a, b, c]) = Bench::ready([at(0.0), at(60.0), at(200.0)]);
    bench.command(c, RXENAB);
    let status = bench.exchange(a, b, FRAME);
    assert_ne!(status & RXFCG, 0);
    assert_eq!(bench.status(c) & RXPRD, 0);
}

#[test]
fn frame_wait_timeout_ends_the_reception_and_wakes_the_host() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.write(a, RX_FWTO, 0, &1_000u16.to_le_bytes());
    bench.set_sys_cfg(a, 1 << 28);
    bench.write(a, SYS_MASK, 0, &(RXRFTO as u32).to_le_bytes());
    bench.command(a, RXENAB);
    // 16 us of start-up, then 1000 units of 1.0256 us.
    bench.wait_us(1_035);
    assert!(!bench.world.irq_level(a));
    bench.wait_us(10);
    assert!(bench.world.irq_level(a));
    assert_ne!(bench.status(a) & RXRFTO, 0);
}

#[test]
fn preamble_timeout_counts_acquisition_chunks() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    // DRX_TUNE2 for PAC 8; 10 + 1 chunks of 8 symbols are 87 us.
    bench.write(a, DRX, 0x08, &0x311A_002Du32.to_le_bytes());
    bench.write(a, DRX, 0x24, &10u16.to_le_bytes());
    bench.command(a, RXENAB);
    bench.wait_us(95);
    assert_eq!(bench.status(a) & RXPTO, 0);
    bench.wait_us(20);
    assert_ne!(bench.status(a) & RXPTO, 0);
}

#[test]
fn a_receiver_switched_on_late_in_the_preamble_hears_nothing() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, FRAME);
    bench.command(a, TXSTRT);
    bench.wait_us(120);
    bench.command(b, RXENAB);
    bench.wait_us(1_000);
    assert_eq!(bench.status(b) & RXPRD, 0);
}

#[test]
fn the_receiver_follows_a_transmission_that_waits_for_a_response() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, FRAME);
    bench.load_frame(b, b"the response");
    bench.command(b, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT | WAIT4RESP);
    bench.wait_us(300);
    bench.command(b, TXSTRT);
    bench.wait_us(500);
    assert_ne!(bench.status(a) & RXFCG, 0);
    assert_eq!(bench.read(a, RX_BUFFER, 0, 12), b"the response");
}

#[test]
fn switching_the_receiver_on_clears_the_events_of_the_last_reception() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    let status = bench.exchange(a, b, FRAME);
    assert_ne!(status & RXFCG, 0);
    bench.command(b, RXENAB);
    let events = RXPRD | RXSFDD | LDEDONE | RXDFR | RXFCG;
    assert_eq!(bench.status(b) & events, 0);
}

#[test]
fn decawaves_sfd_is_as_long_as_sfd_length_says() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    let channel_5_code_4 = 0x2104_0055u32;
    let dwsfd = channel_5_code_4 | 1 << 17;
    // DWSFD takes precedence over TNSSFD and RNSSFD.
    let with_user_sfd = dwsfd | 0b11 << 20;
    bench.write(a, CHAN_CTRL, 0, &with_user_sfd.to_le_bytes());
    bench.write(b, CHAN_CTRL, 0, &dwsfd.to_le_bytes());
    for (symbols_a, symbols_b, heard) in [(8, 8, true), (16, 8, false), (16, 16, true)] {
        bench.write(a, 0x21, 0, &[symbols_a]);
        bench.write(b, 0x21, 0, &[symbols_b]);
        let status = bench.exchange(a, b, FRAME);
        assert_eq!(status & RXFCG != 0, heard, "{symbols_a} and {symbols_b}");
        bench.command(b, TRXOFF);
    }
}

#[test]
fn frames_for_others_are_rejected_by_the_filter() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.set_sys_cfg(b, 1 | 1 << 3);
    bench.write(b, 0x03, 0, &[0x03, 0x00, 0xCA, 0xDE]);
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & (AFFREJ | RXDFR), AFFREJ);
    bench.clear_status(b);
    bench.write(b, 0x03, 0, &[0x02, 0x00, 0xCA, 0xDE]);
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & (AFFREJ | RXFCG), RXFCG);
}

#[test]
fn auto_re_enable_goes_on_listening_after_a_rejected_frame() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.set_sys_cfg(b, 1 | 1 << 3 | 1 << 29);
    bench.write(b, 0x03, 0, &[0x02, 0x00, 0xCA, 0xDE]);
    let mut stranger = FRAME.to_vec();
    stranger[5] = 9;
    bench.load_frame(a, &stranger);
    bench.command(b, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_ne!(bench.status(b) & AFFREJ, 0);
    bench.load_frame(a, FRAME);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_ne!(bench.status(b) & RXFCG, 0);
}

#[test]
fn a_corrupted_frame_fails_its_fcs() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.world.add_fault(Fault::corrupt_nth(a, 0));
    let status = bench.exchange(a, b, FRAME);
    assert_eq!(status & (RXDFR | RXFCE | RXFCG), RXDFR | RXFCE);
    let status = {
        bench.clear_status(b);
        bench.exchange(a, b, FRAME)
    };
    assert_ne!(status & RXFCG, 0);
}

#[test]
fn a_dropped_frame_reaches_nobody_and_the_next_one_does() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.world.add_fault(Fault::drop_nth(a, 0));
    assert_eq!(bench.exchange(a, b, FRAME) & RXPRD, 0);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_ne!(bench.status(b) & RXFCG, 0);
}

#[test]
fn a_fault_at_one_receiver_spares_the_others() {
    let (mut bench, [a, b, c]) = Bench::ready([at(0.0), at(10.0), at(12.0)]);
    bench.world.add_fault(Fault::drop_nth(a, 0).at(c));
    bench.command(c, RXENAB);
    assert_ne!(bench.exchange(a, b, FRAME) & RXFCG, 0);
    assert_eq!(bench.status(c) & RXPRD, 0);
}

#[test]
fn loss_probability_takes_its_share() {
    let channel = ChannelConfig {
        loss_probability: 0.3,
        ..ChannelConfig::default()
    };
    let (mut bench, [a, b]) = Bench::with_channel(channel, [at(0.0), at(10.0)]);
    bench.load_lde(b);
    bench.load_frame(a, FRAME);
    let mut heard = 0;
    for _ in 0..500 {
        bench.command(b, TRXOFF);
        bench.clear_status(b);
        heard += u32::from(bench.exchange(a, b, FRAME) & RXFCG != 0);
    }
    // 350 expected, standard deviation 10.2.
    assert!((290..=410).contains(&heard), "{heard} of 500");
}

/// Two senders at these distances from a receiver, the second starting so many microseconds after the first; the
/// receiver's status afterwards. The first one's preamble begins at 10 us, its SFD at 137, its PHR at 145, its data
/// at 167 us; the data lasts 76 us.
fn collide(first_m: f64, second_m: f64, after_us: u64) -> u64 {
    let (mut bench, [first, second, c]) = Bench::ready([at(first_m), at(-second_m), at(0.0)]);
    bench.load_frame(first, &[1; 60]);
    bench.load_frame(second, &[2; 60]);
    bench.write(c, DRX, 0x20, &129u16.to_le_bytes());
    bench.command(c, RXENAB);
    bench.wait_us(50);
    bench.command(first, TXSTRT);
    bench.wait_us(after_us - 20); // the command takes 20 us on the bus
    bench.command(second, TXSTRT);
    bench.wait_us(1_000);
    bench.status(c)
}

#[test]
fn a_frame_of_equal_power_destroys_the_part_that_it_overlaps() {
    const OUTCOMES: u64 = RXSFDTO | RXPHE | RXRFSL | RXDFR;
    for (after_us, outcome) in [(30, RXSFDTO), (140, RXPHE), (170, RXRFSL), (260, RXDFR)] {
        let status = collide(10.0, 10.0, after_us);
        assert_eq!(status & OUTCOMES, outcome, "{after_us} us: {status:#x}");
    }
}

#[test]
fn a_frame_much_stronger_than_the_other_survives() {
    for after_us in [30, 140, 170] {
        // 9.5 dB
        assert_ne!(collide(5.0, 15.0, after_us) & RXFCG, 0);
        assert_eq!(collide(15.0, 5.0, after_us) & RXDFR, 0);
    }
}

#[test]
fn a_sending_radio_hears_nothing() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, FRAME);
    bench.load_frame(b, &[0; 100]);
    bench.command(b, TXSTRT);
    bench.command(b, RXENAB);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_eq!(bench.status(b) & (TXFRS | RXPRD), TXFRS);
}

#[test]
fn after_an_error_time_stamps_are_wrong_until_the_receiver_is_reset() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    set_antenna_delays(&mut bench, a, 16_456);
    set_antenna_delays(&mut bench, b, 16_456);
    let expected = 10.0 / TICK_M;
    bench.world.add_fault(Fault::corrupt_nth(a, 0));
    bench.exchange(a, b, FRAME);

    let errors: Vec<f64> = (0..8)
        .map(|_| (stamped_flight_ticks(&mut bench, a, b) - expected).abs())
        .collect();
    assert!(errors.iter().any(|e| *e > 10.0), "{errors:?}");
    assert_eq!(bench.world.chip_stats(b).stale_timestamps, 8);

    bench.reset_receiver(b);
    assert!((stamped_flight_ticks(&mut bench, a, b) - expected).abs() <= 1.0);
}

#[test]
fn a_second_frame_waits_in_the_other_buffer() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.write(b, SYS_CFG, 0, &(0x0200u32 | 1 << 29).to_le_bytes()); // double buffer, RXAUTR
    bench.command(b, RXENAB);
    bench.wait_us(50);
    for body in [b"first frame ", b"second frame"] {
        bench.load_frame(a, body);
        bench.command(a, TXSTRT);
        bench.wait_us(500);
    }
    assert_eq!(bench.read(b, RX_BUFFER, 0, 12), b"first frame ");
    bench.clear_status(b);
    bench.command(b, HRBPT);
    assert_ne!(bench.status(b) & RXFCG, 0);
    assert_eq!(bench.read(b, RX_BUFFER, 0, 12), b"second frame");
}

/// Three frames from a to b, one more than b's buffers hold.
fn overrun() -> (Bench, ChipId) {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.write(b, SYS_CFG, 0, &(0x0200u32 | 1 << 29).to_le_bytes());
    bench.command(b, RXENAB);
    bench.wait_us(50);
    for n in 0..3 {
        assert_eq!(bench.status(b) & RXOVRR, 0, "frame {n}");
        bench.load_frame(a, FRAME);
        bench.command(a, TXSTRT);
        bench.wait_us(500);
    }
    assert_ne!(bench.status(b) & RXOVRR, 0);
    (bench, b)
}

#[test]
fn an_overrun_is_read_only_and_ends_when_the_host_releases_its_buffer() {
    let (mut bench, b) = overrun();
    bench.clear_status(b);
    assert_ne!(bench.status(b) & RXOVRR, 0);
    bench.command(b, HRBPT);
    assert_eq!(bench.status(b) & RXOVRR, 0);
}

#[test]
fn an_overrun_ends_with_a_receiver_reset() {
    let (mut bench, b) = overrun();
    bench.reset_receiver(b);
    assert_eq!(bench.status(b) & RXOVRR, 0);
}

/// Asks for a reception at the time that it is, which is too late.
fn listen_late(bench: &mut Bench, chip: ChipId) {
    let when = bench.system_time(chip);
    bench.write(chip, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(chip, RXENAB | RXDLYE);
}

#[test]
fn hpdwarn_of_a_late_reception_ends_half_a_counter_period_before_it() {
    let (mut bench, [b]) = Bench::ready([at(0.0)]);
    listen_late(&mut bench, b);
    bench.clear_status(b);
    // Half a period is 8.604 s.
    bench.wait_us(8_600_000);
    assert_ne!(bench.status(b) & HPDWARN, 0);
    bench.wait_us(10_000);
    assert_eq!(bench.status(b) & HPDWARN, 0);
}

#[test]
fn hpdwarn_of_a_late_reception_ends_with_whatever_cancels_it() {
    for cancel in [
        |bench: &mut Bench, b| bench.command(b, TRXOFF),
        |bench: &mut Bench, b| bench.reset_receiver(b),
    ] {
        let (mut bench, [b]) = Bench::ready([at(0.0)]);
        listen_late(&mut bench, b);
        assert_ne!(bench.status(b) & HPDWARN, 0);
        cancel(&mut bench, b);
        assert_eq!(bench.status(b) & HPDWARN, 0);
    }
}

#[test]
fn a_late_reception_that_a_busy_radio_ignores_warns_of_nothing() {
    let (mut bench, [b]) = Bench::ready([at(0.0)]);
    bench.command(b, RXENAB);
    bench.wait_us(50);
    listen_late(&mut bench, b);
    assert_eq!(bench.status(b) & HPDWARN, 0);
    let stats = bench.world.chip_stats(b);
    assert_eq!((stats.ignored_commands, stats.late_commands), (1, 0));
}
