//! The bridge against a simulated autopilot, in simulated time, through a network that may be bad.

use super::core::{Bridge, Given, Orders, Outlet};
use super::journal::{Again, Journal};
use crate::commands::guide::lines::News;
use crate::commands::guide::options::NavigatorOptions;
use crate::commands::guide::pairing::Heard;
use crate::mavlink::frames::{Attitude, ned_from_enu};
use crate::mavlink::inbound::Reading;
use crate::mavlink::stream::{Incoming, Outgoing};
use crate::peer::Peer;
use crate::recording::file::{Place, Player, play};
use crate::recording::schema::check::every_message_fits_its_schema;
use clap::Parser;
use mavlink::dialects::common::{
    ATTITUDE_DATA, DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, LANDING_TARGET_DATA,
    LOCAL_POSITION_NED_DATA, MavAutopilot, MavFrame, MavMessage,
    SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
};
use nalgebra::Vector3;
use nova_solver::navigation::RangeSample;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// Our clock when the autopilot was switched on, and when it is first heard.
const BOOT_S: f64 = 1_000.0;
const START_S: f64 = 1_060.0;
const TAG_M: [f64; 3] = [3.0, -4.0, 0.0];
/// Milliseconds a step.
const STEP_MS: u32 = 10;

/// Where the vehicle is, ENU.
fn path(t_s: f64) -> Vector3<f64> {
    let angle = t_s / 6.0;
    Vector3::new(6.0 * angle.cos(), 6.0 * angle.sin(), 12.0 - 0.12 * t_s)
}

/// How it is turned: roll, pitch, yaw.
fn turned(t_s: f64) -> [f64; 3] {
    [
        0.1 * (0.7 * t_s).sin(),
        0.08 * (0.5 * t_s).cos(),
        0.3 + 0.05 * t_s,
    ]
}

/// Datagrams on their way: when they arrive, and what they are.
#[derive(Default)]
struct Air {
    under_way: Vec<(u32, Vec<u8>)>,
}

/// How bad a network is.
#[derive(Clone, Copy, Debug)]
struct Weather {
    loss: f64,
    twice: f64,
    longest_ms: u32,
}

const FAIR: Weather = Weather {
    loss: 0.0,
    twice: 0.0,
    longest_ms: 0,
};

impl Air {
    fn send(&mut self, now_ms: u32, datagram: &[u8], weather: Weather, rng: &mut ChaCha8Rng) {
        let copies = if rng.random_bool(weather.twice) { 2 } else { 1 };
        for _ in 0..copies {
            let delay_ms = rng.random_range(0..=weather.longest_ms);
            if !rng.random_bool(weather.loss) {
                self.under_way.push((now_ms + delay_ms, datagram.to_vec()));
            }
        }
    }

    fn arrived(&mut self, now_ms: u32) -> Vec<Vec<u8>> {
        let mut here: Vec<(u32, Vec<u8>)> = Vec::new();
        self.under_way.retain(|(at_ms, datagram)| {
            let is_here = *at_ms <= now_ms;
            if is_here {
                here.push((*at_ms, datagram.clone()));
            }
            !is_here
        });
        here.sort_by_key(|(at_ms, _)| *at_ms);
        here.into_iter().map(|(_, datagram)| datagram).collect()
    }
}

/// What the bridge says, packed.
struct Wire {
    frames: Outgoing,
    datagrams: Vec<Vec<u8>>,
    news: usize,
    now_s: f64,
    journal: Journal,
}

impl Outlet for Wire {
    fn send(&mut self, message: &MavMessage) -> bool {
        let frame = self.frames.pack(message);
        self.journal.said(self.now_s, message, frame, true);
        self.datagrams.push(frame.to_vec());
        true
    }

    fn news(&mut self, news: &News<'_>) {
        self.journal.news(self.now_s, news);
        self.news += 1;
    }

    fn reading(&mut self, t_s: f64, reading: &Reading) {
        self.journal.reading(self.now_s, t_s, reading);
    }

    fn tell(&mut self, _: &str) {}
}

impl Wire {
    fn give(&mut self, bridge: &mut Bridge, given: Given<'_>, now_s: f64) {
        self.now_s = now_s;
        self.journal.given(now_s, &given);
        bridge.take(given, now_s, self);
    }
}

/// What an autopilot took in.
#[derive(Default)]
struct Took {
    recording: Vec<u8>,
    targets: Vec<(f64, LANDING_TARGET_DATA)>,
    ranges: Vec<DISTANCE_SENSOR_DATA>,
    fly: Vec<SET_POSITION_TARGET_LOCAL_NED_DATA>,
    heartbeats: usize,
    clock_doubt_s: Option<f64>,
    restarts: u64,
    news: usize,
}

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    navigator: NavigatorOptions,
}

fn orders() -> Orders {
    Orders {
        only: None,
        frame: None,
        most_sigma_m: 1.0,
        fly: true,
        rate_hz: 30.0,
        news: true,
        readings: true,
        navigator: Line::parse_from(["test"]).navigator,
    }
}

/// Flies `for_s` seconds past a tag that is ranged at 10 Hz with errors of up to 5 cm.
fn fly(kind: MavAutopilot, weather: Weather, seed: u64, for_s: f64) -> Took {
    ranged_every(100, kind, weather, seed, for_s)
}

/// The same with a range every so many milliseconds.
fn ranged_every(
    range_ms: u32,
    kind: MavAutopilot,
    weather: Weather,
    seed: u64,
    for_s: f64,
) -> Took {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut bridge = Bridge::new(orders(), START_S);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bridge.mcap");
    let mut wire = Wire {
        frames: Outgoing::of(1, 191),
        datagrams: Vec::new(),
        news: 0,
        now_s: START_S,
        journal: Journal::begin(&file, &orders(), START_S).unwrap(),
    };
    let mut autopilot = Outgoing::of(1, 1);
    let (mut to_bridge, mut to_autopilot) = (Air::default(), Air::default());
    let (mut at_bridge, mut at_autopilot) = (Incoming::new(), Incoming::new());
    let mut took = Took::default();
    for tick in 0..(for_s * 1e3) as u32 / STEP_MS {
        let ms = tick * STEP_MS;
        let t_s = f64::from(ms) * 1e-3;
        let now_s = START_S + t_s;
        let boot_ms = ((now_s - BOOT_S) * 1e3).round() as u32;
        // The autopilot's side.
        let mut say = |message: MavMessage, to_bridge: &mut Air, rng: &mut ChaCha8Rng| {
            to_bridge.send(ms, autopilot.pack(&message), weather, rng);
        };
        if ms.is_multiple_of(1000) {
            let beat = HEARTBEAT_DATA {
                autopilot: kind,
                ..HEARTBEAT_DATA::default()
            };
            say(MavMessage::HEARTBEAT(beat), &mut to_bridge, &mut rng);
        }
        if ms.is_multiple_of(50) {
            let ned = ned_from_enu(path(t_s));
            let place = LOCAL_POSITION_NED_DATA {
                time_boot_ms: boot_ms,
                x: ned.x as f32,
                y: ned.y as f32,
                // A barometer is never at rest.
                z: (ned.z + rng.random_range(-0.01..0.01)) as f32,
                ..LOCAL_POSITION_NED_DATA::default()
            };
            say(
                MavMessage::LOCAL_POSITION_NED(place),
                &mut to_bridge,
                &mut rng,
            );
            let [roll, pitch, yaw] = turned(t_s).map(|angle| angle as f32);
            let attitude = ATTITUDE_DATA {
                time_boot_ms: boot_ms,
                roll,
                pitch,
                yaw,
                ..ATTITUDE_DATA::default()
            };
            say(MavMessage::ATTITUDE(attitude), &mut to_bridge, &mut rng);
        }
        for datagram in to_autopilot.arrived(ms) {
            let mut answers = Vec::new();
            at_autopilot.datagram(&datagram, |_, message| match message {
                MavMessage::LANDING_TARGET(target) => took.targets.push((now_s, target)),
                MavMessage::DISTANCE_SENSOR(range) => took.ranges.push(range),
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(place) => took.fly.push(place),
                MavMessage::HEARTBEAT(_) => took.heartbeats += 1,
                MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => answers.push(TIMESYNC_DATA {
                    tc1: ((now_s - BOOT_S) * 1e9) as i64,
                    ts1: sync.ts1,
                    ..TIMESYNC_DATA::default()
                }),
                _ => {}
            });
            for answer in answers {
                say(MavMessage::TIMESYNC(answer), &mut to_bridge, &mut rng);
            }
        }
        // The bridge's.
        for datagram in to_bridge.arrived(ms) {
            at_bridge.datagram(&datagram, |header, message| {
                wire.give(&mut bridge, Given::Message(header, &message), now_s);
            });
        }
        if ms >= 20 && (ms - 20).is_multiple_of(range_ms) {
            let range_m = (path(t_s) - Vector3::from(TAG_M)).norm() + rng.random_range(-0.05..0.05);
            let heard = Heard {
                peer: Peer::Number(7),
                range: RangeSample {
                    t_s: now_s,
                    range_m,
                },
            };
            wire.give(&mut bridge, Given::Range(heard), now_s);
        }
        if now_s >= bridge.due_s() {
            wire.give(&mut bridge, Given::Time, now_s);
        }
        for datagram in wire.datagrams.drain(..) {
            to_autopilot.send(ms, &datagram, weather, &mut rng);
        }
    }
    let (_, vehicle, nodes) = bridge.conclude();
    assert_eq!(nodes.len(), 1);
    took.clock_doubt_s = vehicle.clock_doubt_s();
    took.restarts = vehicle.counts().restarts;
    took.news = wire.news;
    wire.journal.finish().unwrap();
    took.recording = std::fs::read(file).unwrap();
    took
}

fn place(target: &LANDING_TARGET_DATA) -> Vector3<f64> {
    Vector3::new(target.x, target.y, target.z).map(f64::from)
}

#[test]
fn px4_is_told_the_landing_place_from_its_own_origin() {
    let took = fly(MavAutopilot::MAV_AUTOPILOT_PX4, FAIR, 2025, 50.0);
    assert!(took.heartbeats >= 49, "{}", took.heartbeats);
    assert!(took.news > 300, "{}", took.news);
    assert_eq!(took.ranges.len(), 500);
    let (_, last) = took.targets.last().unwrap();
    assert_eq!(last.frame, MavFrame::MAV_FRAME_LOCAL_NED);
    let off_m = |target| (place(target) - ned_from_enu(TAG_M.into())).norm();
    let error_m = off_m(last);
    let worst_m =
        (took.targets.iter()).fold(0.0, |worst, (_, target)| f64::max(worst, off_m(target)));
    println!(
        "{} targets, the last {error_m:.3} m off, the worst {worst_m:.3} m",
        took.targets.len()
    );
    // Three times the sigma above which none is told.
    assert!(worst_m < 3.0, "{worst_m}");
    assert!(took.targets.len() > 100 && error_m < 0.3, "{error_m}");
    // Times are ours, as TIMESYNC says them.
    assert!((last.time_usec as f64 * 1e-6 - (START_S + 50.0)).abs() < 0.2);
    // Zero delay: the clock is known to the step.
    assert!(
        took.clock_doubt_s.unwrap() <= 0.011,
        "{:?}",
        took.clock_doubt_s
    );
    assert!(!took.fly.is_empty());
}

/// After a second and two metres of flight a place at the vehicle's own height explains a hundred ranges as well.
#[test]
fn what_a_short_path_cannot_tell_is_not_told_however_many_ranges_there_are() {
    for seed in 2025..2029 {
        let took = ranged_every(10, MavAutopilot::MAV_AUTOPILOT_PX4, FAIR, seed, 12.0);
        let off_m = |target| (place(target) - ned_from_enu(TAG_M.into())).norm();
        let worst_m =
            (took.targets.iter()).fold(0.0, |worst, (_, target)| f64::max(worst, off_m(target)));
        println!(
            "{} targets, the worst {worst_m:.3} m off",
            took.targets.len()
        );
        assert!(took.targets.len() > 100 && worst_m < 3.0, "{worst_m}");
    }
}

#[test]
fn ardupilot_is_told_the_landing_place_from_its_body() {
    let took = fly(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, FAIR, 2025, 50.0);
    let mut worst_m: f64 = 0.0;
    for (_, target) in took.targets.iter().rev().take(50) {
        assert_eq!(target.frame, MavFrame::MAV_FRAME_BODY_FRD);
        // Where the vehicle was when it says it was, and how it was turned.
        let t_s = target.time_usec as f64 * 1e-6 - START_S;
        let [roll, pitch, yaw] = turned(t_s);
        let attitude = Attitude::from_euler(roll, pitch, yaw).unwrap();
        let relative = ned_from_enu(Vector3::from(TAG_M) - path(t_s));
        worst_m = worst_m.max((place(target) - attitude.body_frd(relative)).norm());
    }
    println!(
        "{} targets, {worst_m:.3} m at worst of the last 50",
        took.targets.len()
    );
    assert!(took.targets.len() > 100 && worst_m < 0.35, "{worst_m}");
}

#[test]
fn what_is_doubtful_is_not_told() {
    // After three seconds nothing is known about the far side of the circle.
    let took = fly(MavAutopilot::MAV_AUTOPILOT_PX4, FAIR, 2025, 1.0);
    assert!(
        took.ranges.len() >= 9 && took.targets.is_empty(),
        "{}",
        took.targets.len()
    );
}

fn replayed(recording: &[u8]) -> (String, anyhow::Result<()>) {
    let begin = |place: &Place<'_>, data: &[u8]| {
        let again = Again::begin(place, data)?;
        Ok(Some(Box::new(again) as Box<dyn Player>))
    };
    let mut said = Vec::new();
    let end = play("bridge.mcap", recording, begin, &mut said);
    (String::from_utf8(said).unwrap(), end)
}

/// A network at its worst, and what was recorded there.
fn recorded() -> (usize, Vec<u8>) {
    let weather = Weather {
        loss: 0.2,
        twice: 0.2,
        longest_ms: 200,
    };
    let took = fly(MavAutopilot::MAV_AUTOPILOT_PX4, weather, 2025, 30.0);
    (took.news, took.recording)
}

#[test]
fn a_recording_holds_all_that_was_said_and_says_it_again_byte_for_byte() {
    let (news, recording) = recorded();
    every_message_fits_its_schema(&recording);
    let mut estimates = String::new();
    let mut topics = BTreeMap::new();
    for message in mcap::MessageStream::new(&recording).unwrap() {
        let message = message.unwrap();
        *topics.entry(message.channel.topic.clone()).or_insert(0) += 1;
        if message.channel.topic == "/estimate" {
            estimates += std::str::from_utf8(&message.data).unwrap();
            estimates.push('\n');
        }
    }
    println!("{topics:?}, {} bytes", recording.len());
    assert_eq!(topics["/estimate"], news);
    assert_eq!(topics["/range"], 300);
    assert!(topics["/position"] > 300 && topics["/attitude"] > 300);
    assert!(topics["/mavlink/out"] > 600);
    let (said, end) = replayed(&recording);
    end.unwrap();
    assert!(news > 100 && said == estimates);
}

#[test]
fn of_a_recording_that_was_cut_off_all_is_played_up_to_there() {
    let (_, recording) = recorded();
    let (whole, _) = replayed(&recording);
    for part in 1..10 {
        let (said, end) = replayed(&recording[..recording.len() * part / 10]);
        let error = end.unwrap_err();
        assert!(
            error.downcast_ref::<crate::error::BadInput>().is_some(),
            "{error:?}"
        );
        assert!(whole.starts_with(&said) && said.len() < whole.len());
        // Chunks of 64 KiB.
        assert!(
            part < 3 || said.len() * 10 > whole.len() * (part - 2),
            "{part}: {} of {}",
            said.len(),
            whole.len()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    #[test]
    fn a_network_that_loses_repeats_and_reorders_does_no_harm(
        loss in 0.0..0.3f64,
        twice in 0.0..0.3f64,
        longest_ms in 0..250u32,
        seed in any::<u64>(),
    ) {
        let weather = Weather { loss, twice, longest_ms };
        let took = fly(MavAutopilot::MAV_AUTOPILOT_PX4, weather, seed, 50.0);
        prop_assert_eq!(took.restarts, 0);
        let last = took.targets.last().map(|(_, target)| place(target));
        let error_m = last.map(|last| (last - ned_from_enu(TAG_M.into())).norm());
        prop_assert!(error_m.is_some_and(|error_m| error_m < 0.6), "{:?} after {} targets", error_m, took.targets.len());
        prop_assert!(took.clock_doubt_s.is_some_and(|s| s <= 0.5 * 2.0 * f64::from(longest_ms) * 1e-3 + 0.011));
    }
}
