//! Sending: immediate, delayed, late, without FCS.

mod bench;

use bench::*;
use nova_hal_sim::chip::{ChipConfig, ChipTiming};
use nova_hal_sim::clock::COUNTER_WRAP;
use nova_hal_sim::world::ChipId;
use nova_hal_sim::{ChannelConfig, ClockConfig, SimDuration};

const FRAME: &[u8] = b"\x41\x88\x00 twelve by";
/// 128 + 8 symbols at PRF 16 MHz.
const SHR_TICKS: u64 = 136 * 496 * 128;
const TICKS_PER_US: u64 = 63_898;

#[test]
fn delayed_frames_leave_on_the_512_tick_grid() {
    let (mut bench, [a]) = Bench::ready([with_ppm(at(0.0), 13.7)]);
    bench.write(a, 0x18, 0, &16_456u16.to_le_bytes());
    bench.load_frame(a, FRAME);
    let when = bench.system_time(a) + 640_000_000 + 300;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    bench.wait_us(11_000);
    assert_ne!(bench.status(a) & TXFRS, 0);
    assert_eq!(bench.tx_time(a), (when & !0x1FF) + 16_456);
    assert_eq!(bench.number(a, TX_TIME, 5, 5), when & !0x1FF);
}

#[test]
fn immediate_frames_leave_on_the_grid_as_soon_as_the_transmitter_is_up() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.load_frame(a, FRAME);
    bench.command(a, TXSTRT);
    let started = bench
        .world
        .chip(a)
        .unwrap()
        .clock()
        .counter_at(bench.world.now());
    bench.wait_us(1_000);
    let raw = bench.number(a, TX_TIME, 5, 5);
    assert_eq!(raw % 512, 0);
    let start_up_us = (raw - SHR_TICKS - started) as f64 / 63_897.6;
    assert!((10.0..10.1).contains(&start_up_us), "{start_up_us} us");
}

#[test]
fn a_time_just_past_sets_hpdwarn_and_the_chip_waits_a_whole_wrap() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.write(a, EVC, 0, &[1, 0, 0, 0]);
    bench.load_frame(a, FRAME);
    let when = bench.system_time(a);
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    assert_ne!(bench.status(a) & HPDWARN, 0);
    assert_eq!(bench.number(a, EVC, 0x18, 2), 1);
    bench.wait_us(17_000_000);
    assert_eq!(bench.status(a) & TXFRS, 0);
    bench.wait_us(300_000);
    assert_ne!(bench.status(a) & TXFRS, 0);
    assert_eq!(bench.number(a, TX_TIME, 5, 5), when & !0x1FF);
}

#[test]
fn too_little_time_to_power_up_counts_and_costs_preamble_but_not_the_time() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.write(a, EVC, 0, &[1, 0, 0, 0]);
    bench.load_frame(a, FRAME);
    // The transactions up to the command take 68 us; power-up would take 10 us more.
    let when = bench.system_time(a) + SHR_TICKS + 73 * TICKS_PER_US;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    bench.wait_us(1_000);
    // The flag itself has ended with the preamble's start.
    assert_eq!(bench.status(a) & (TXFRS | TXPUTE | HPDWARN), TXFRS);
    assert_eq!(bench.number(a, EVC, 0x18, 2), 0);
    assert_eq!(bench.number(a, EVC, 0x1A, 2), 1);
    assert_eq!(bench.number(a, TX_TIME, 5, 5), when & !0x1FF);
}

#[test]
fn a_preamble_that_should_have_begun_already_is_late() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.load_frame(a, FRAME);
    // The RMARKER is still to come, the preamble's start is not.
    let when = bench.system_time(a) + SHR_TICKS + 60 * TICKS_PER_US;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    assert_ne!(bench.status(a) & HPDWARN, 0);
    bench.wait_us(10_000);
    assert_eq!(bench.status(a) & TXFRS, 0);
}

#[test]
fn events_of_the_last_frame_go_when_the_next_one_begins() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.load_frame(a, FRAME);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    let when = bench.system_time(a) + 2_000 * TICKS_PER_US;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    assert_ne!(bench.status(a) & TXFRS, 0);
    bench.wait_us(1_850);
    assert_eq!(bench.status(a) & TXFRS, 0);
    bench.wait_us(500);
    assert_ne!(bench.status(a) & TXFRS, 0);
}

#[test]
fn trxoff_ends_the_wait_of_a_late_frame() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.load_frame(a, FRAME);
    let when = bench.system_time(a);
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    assert_ne!(bench.status(a) & HPDWARN, 0);
    bench.command(a, TRXOFF);
    assert_eq!(bench.status(a) & HPDWARN, 0);
    assert_eq!(bench.number(a, SYS_CTRL, 0, 4), 0);
    bench.wait_us(20_000_000);
    assert_eq!(bench.status(a) & TXFRS, 0);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_ne!(bench.status(a) & TXFRS, 0);
}

/// Asks for a frame at the time that it is, which is too late.
fn send_late(bench: &mut Bench, chip: ChipId) {
    bench.load_frame(chip, FRAME);
    let when = bench.system_time(chip);
    bench.write(chip, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(chip, TXSTRT | TXDLYS);
}

#[test]
fn hpdwarn_cannot_be_cleared_by_writing_one() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    send_late(&mut bench, a);
    bench.clear_status(a);
    assert_eq!(bench.status(a) & (HPDWARN | CPLOCK), HPDWARN);
    bench.command(a, TRXOFF);
    assert_eq!(bench.status(a) & HPDWARN, 0);
}

#[test]
fn hpdwarn_ends_when_a_late_frame_is_half_a_counter_period_away() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    send_late(&mut bench, a);
    // Half a period is 8.604 s.
    bench.wait_us(8_600_000);
    assert_ne!(bench.status(a) & HPDWARN, 0);
    bench.wait_us(10_000);
    assert_eq!(bench.status(a) & (HPDWARN | TXFRS), 0);
    bench.wait_us(8_600_000);
    assert_eq!(bench.status(a) & (HPDWARN | TXFRS), TXFRS);
}

#[test]
fn the_warning_of_an_abandoned_late_frame_does_not_end_that_of_the_next() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    send_late(&mut bench, a);
    bench.wait_us(1_000_000);
    bench.command(a, TRXOFF);
    send_late(&mut bench, a);
    bench.wait_us(8_000_000);
    assert_ne!(bench.status(a) & HPDWARN, 0);
}

/// Asks for a frame 80 us before its preamble, with a transmitter that takes 200 us to power up.
fn send_without_time_to_power_up() -> (Bench, ChipId) {
    let timing = ChipTiming {
        tx_start_up: SimDuration::from_us(200),
        ..ChipTiming::default()
    };
    let (mut bench, [a]) = Bench::ready([ChipConfig { timing, ..at(0.0) }]);
    bench.load_frame(a, FRAME);
    // The transactions up to the command take 68 us.
    let when = bench.system_time(a) + SHR_TICKS + 148 * TICKS_PER_US;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    (bench, a)
}

#[test]
fn txpute_is_read_only_and_ends_with_the_preambles_start() {
    let (mut bench, a) = send_without_time_to_power_up();
    bench.clear_status(a);
    assert_eq!(bench.status(a) & (TXPUTE | HPDWARN | CPLOCK), TXPUTE);
    bench.wait_us(160);
    // On the air, not sent yet.
    assert_eq!(bench.status(a) & (TXFRB | TXFRS | TXPUTE), TXFRB);
}

#[test]
fn txpute_ends_with_trxoff() {
    let (mut bench, a) = send_without_time_to_power_up();
    assert_ne!(bench.status(a) & TXPUTE, 0);
    bench.command(a, TRXOFF);
    assert_eq!(bench.status(a) & (TXFRB | TXPUTE), 0);
}

#[test]
fn delayed_frames_cross_the_wrap_of_the_counter() {
    let mut config = with_ppm(at(0.0), 0.0);
    // The counter starts when the chip reaches INIT, 1 ms after power-on; wrap 20 ms later.
    config.clock = ClockConfig {
        offset_ticks: COUNTER_WRAP - 1_277_952_000,
        ..config.clock
    };
    let (mut bench, [a]) = Bench::ready([config]);
    bench.load_frame(a, FRAME);
    let now = bench.system_time(a);
    let when = (now + 1_300_000_000) % COUNTER_WRAP;
    assert!(when < now);
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS);
    assert_eq!(bench.status(a) & (HPDWARN | TXPUTE), 0);
    bench.wait_us(25_000);
    assert_eq!(bench.number(a, TX_TIME, 5, 5), when & !0x1FF);
}

#[test]
fn payload_written_during_the_preamble_goes_out_once_fcs_suppression_is_cancelled() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, b"old old old ");
    bench.command(b, RXENAB);
    bench.wait_us(50);
    let when = bench.system_time(a) + SHR_TICKS + 12_000_000;
    bench.write(a, DX_TIME, 0, &when.to_le_bytes()[..5]);
    bench.command(a, TXSTRT | TXDLYS | SFCST);
    // Start-up is over and the preamble is on the air for 135 us.
    bench.wait_us(150);
    bench.write(a, TX_BUFFER, 0, b"new new new ");
    bench.command(a, CANSFCS);
    bench.wait_us(500);
    let status = bench.status(b);
    assert_eq!(status & (RXFCG | RXFCE), RXFCG, "{status:#x}");
    assert_eq!(bench.read(b, RX_BUFFER, 0, 12), b"new new new ");
}

#[test]
fn suppressed_fcs_makes_receivers_see_a_bad_one() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, FRAME);
    bench.write(a, TX_BUFFER, FRAME.len(), &[0xAA, 0x55]);
    bench.command(b, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT | SFCST);
    bench.wait_us(1_000);
    let status = bench.status(b);
    assert_eq!(status & (RXDFR | RXFCG | RXFCE), RXDFR | RXFCE);
    assert_eq!(bench.read(b, RX_BUFFER, FRAME.len(), 2), [0xAA, 0x55]);
}

#[test]
fn payload_written_during_the_data_part_is_too_late() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, b"old old old ");
    bench.command(b, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT);
    // 10 us of start-up, 135 us of preamble and SFD, 22 us of PHR.
    bench.wait_us(170);
    bench.write(a, TX_BUFFER, 0, b"new");
    bench.wait_us(500);
    assert_ne!(bench.status(b) & RXFCG, 0);
    assert_eq!(bench.read(b, RX_BUFFER, 0, 3), b"old");
}

#[test]
fn a_frame_switched_off_in_its_data_is_lost_with_a_frame_error() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(10.0)]);
    bench.load_frame(a, &[7; 100]);
    bench.command(b, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT);
    bench.wait_us(200);
    bench.command(a, TRXOFF);
    bench.wait_us(500);
    let status = bench.status(b);
    assert_eq!(status & (RXDFR | RXRFSL), RXRFSL);
    assert_eq!(bench.status(a) & TXFRS, 0);
}

#[test]
fn a_busy_radio_ignores_commands() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.load_frame(a, FRAME);
    bench.command(a, RXENAB);
    bench.wait_us(50);
    bench.command(a, TXSTRT);
    bench.wait_us(1_000);
    assert_eq!(bench.status(a) & TXFRS, 0);
    assert_eq!(bench.world.chip_stats(a).ignored_commands, 1);
}

#[test]
fn distance_weakens_a_frame_by_6_db_a_doubling() {
    let channel = ChannelConfig::default();
    let loss = |m| channel.path_loss_db(nova_hal_sim::phy::Channel::Ch5, m);
    assert!((loss(20.0) - loss(10.0) - 6.02).abs() < 0.01);
    // Friis at 1 m and 6489.6 MHz.
    assert!((loss(1.0) - 48.69).abs() < 0.01);
}
