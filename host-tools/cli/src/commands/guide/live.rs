//! Measurements as they come.

use super::pairing::Heard;
use crate::board_clock::BoardClock;
use crate::peer::Peer;
use crate::source::{Input, Source};
use anyhow::Result;
use nova_solver::navigation::{InsSample, RangeSample};
use nova_wire::{Decoder, Event, Record};
use serde::Deserialize;
use std::net::UdpSocket;
use std::sync::mpsc::Sender;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// What arrives.
pub(crate) enum Arrival {
    /// A range.
    Range(Heard),
    /// A reading of dead reckoning.
    Ins(InsSample),
    /// Something that cannot be used, and why.
    Unusable(String),
    /// The board says no more.
    BoardEnded(Result<()>),
}

/// The host's time: seconds since 1970, never going back while the program runs.
#[derive(Clone, Copy)]
pub(crate) struct HostClock {
    start: Instant,
    start_s: f64,
}

impl HostClock {
    pub(crate) fn start() -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            start: Instant::now(),
            start_s: since_1970.map_or(0.0, |d| d.as_secs_f64()),
        }
    }

    /// Seconds since 1970.
    pub(crate) fn now_s(&self) -> f64 {
        self.start_s + self.start.elapsed().as_secs_f64()
    }
}

/// Reads a board's bytes until they end, or nobody listens.
pub(crate) fn hear_board<T: From<Arrival>>(mut board: Source, clock: HostClock, to: &Sender<T>) {
    let mut decoder = Decoder::new();
    let mut board_clock = BoardClock::default();
    let mut chunk = [0; 4096];
    let end = loop {
        let news = match board.read(&mut chunk) {
            Ok(Input::Bytes(count)) => Ok(count),
            Ok(Input::Silence) => continue,
            Ok(Input::Lost(why)) => Err(format!("{}: lost, trying again: {why}", board.place())),
            Ok(Input::Back) => Err(format!("{}: heard again", board.place())),
            Ok(Input::End) => break Ok(()),
            Err(error) => break Err(error),
        };
        let count = match news {
            Ok(count) => count,
            Err(what) => match to.send(Arrival::Unusable(what).into()) {
                Ok(()) => continue,
                Err(_) => return,
            },
        };
        let arrival_s = clock.now_s();
        for event in chunk.iter().take(count).filter_map(|&b| decoder.push(b)) {
            let arrival = match event {
                Event::Record {
                    record: Record::Status(status),
                    ..
                } => {
                    board_clock.observe(arrival_s, status.t_us);
                    continue;
                }
                Event::Record {
                    record: Record::Range(range),
                    ..
                } => {
                    // A range arrives some time after it was taken, like a status.
                    board_clock.observe(arrival_s, range.t_us);
                    Arrival::Range(Heard {
                        peer: Peer::Number(range.peer.into()),
                        range: RangeSample {
                            t_s: board_clock.host_s(range.t_us),
                            range_m: range.raw_m.into(),
                        },
                    })
                }
                Event::Record {
                    record: Record::Boot(_),
                    ..
                } => {
                    // Its clock starts again.
                    board_clock = BoardClock::default();
                    continue;
                }
                Event::Record { .. } => continue,
                Event::Trouble(trouble) => Arrival::Unusable(format!("board: {trouble:?}")),
            };
            if to.send(arrival.into()).is_err() {
                return;
            }
        }
    };
    // Nobody listens any more: nobody to tell.
    let _ = to.send(Arrival::BoardEnded(end).into());
}

/// One datagram: dead reckoning as an autopilot sends it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Datagram {
    /// Host time; that of arrival where it is left out.
    t_s: Option<f64>,
    x_m: f64,
    y_m: f64,
    z_m: f64,
}

/// Reads datagrams until nobody listens.
pub(crate) fn hear_ins(socket: &UdpSocket, clock: HostClock, to: &Sender<Arrival>) {
    let mut bytes = [0; 65_536];
    loop {
        let arrival = match socket.recv(&mut bytes) {
            Ok(count) => ins(bytes.get(..count).unwrap_or_default(), clock.now_s()),
            Err(error) => Arrival::Unusable(format!("dead reckoning: {error}")),
        };
        if to.send(arrival).is_err() {
            return;
        }
    }
}

fn ins(datagram: &[u8], arrival_s: f64) -> Arrival {
    let complaint =
        |what: &dyn std::fmt::Display| Arrival::Unusable(format!("dead reckoning: {what}"));
    let datagram: Datagram = match serde_json::from_slice(datagram) {
        Ok(datagram) => datagram,
        Err(error) => return complaint(&error),
    };
    let sample = InsSample {
        t_s: datagram.t_s.unwrap_or(arrival_s),
        position_m: [datagram.x_m, datagram.y_m, datagram.z_m].into(),
    };
    match sample.validate() {
        Ok(()) => Arrival::Ins(sample),
        Err(fault) => complaint(&fault),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Place;
    use nova_wire::{Encoder, MAX_FRAME_LEN, Range, Status};
    use std::io::Cursor;
    use std::sync::mpsc;

    fn given(bytes: Vec<u8>) -> Source {
        Source::of(Place::StandardInput, Cursor::new(bytes))
    }

    fn frame(encoder: &mut Encoder, record: &Record) -> Vec<u8> {
        encoder
            .encode(record, &mut [0; MAX_FRAME_LEN])
            .unwrap()
            .to_vec()
    }

    fn range(t_us: u64) -> Record {
        Record::Range(Range {
            t_us,
            peer: 7,
            raw_m: 12.5,
            ..Range::default()
        })
    }

    #[test]
    fn a_boards_ranges_come_at_host_time_and_its_noise_is_told() {
        let mut encoder = Encoder::new();
        let status = Record::Status(Status {
            t_us: 2_000_000,
            ..Status::default()
        });
        let mut bytes = frame(&mut encoder, &status);
        bytes.extend(b"garbage\0");
        bytes.extend(frame(&mut encoder, &range(1_500_000)));
        let clock = HostClock::start();
        let (to_us, arrivals) = mpsc::channel();
        hear_board(given(bytes), clock, &to_us);
        drop(to_us);
        let arrivals: Vec<Arrival> = arrivals.iter().collect();
        let [
            Arrival::Unusable(trouble),
            Arrival::Range(heard),
            Arrival::BoardEnded(Ok(())),
        ] = &arrivals[..]
        else {
            panic!("{} arrivals", arrivals.len());
        };
        assert!(trouble.contains("Corrupt"), "{trouble}");
        assert_eq!(heard.peer, Peer::Number(7));
        assert_eq!(heard.range.range_m, 12.5);
        // Half a second before the status was made, which has just arrived.
        let age_s = clock.now_s() - heard.range.t_s;
        assert!((0.5..60.0).contains(&age_s), "{age_s}");
    }

    #[test]
    fn a_boards_clock_starts_again_with_the_board() {
        let mut encoder = Encoder::new();
        let boot = Record::Boot(nova_wire::Boot {
            address: 1,
            pan: 2,
            role: nova_wire::Role::Anchor,
            firmware: [0; 3],
            reset_cause: nova_wire::ResetCause::Watchdog,
            settings: nova_wire::SettingsSource::Defaults,
        });
        // An hour after its start the board starts again.
        let records = [range(3_600_000_000), boot, range(1_000_000)];
        let bytes: Vec<u8> = (records.iter())
            .flat_map(|record| frame(&mut encoder, record))
            .collect();
        let (to_us, arrivals) = mpsc::channel();
        hear_board(given(bytes), HostClock::start(), &to_us);
        drop(to_us);
        let times: Vec<f64> = (arrivals.iter())
            .filter_map(|arrival| match arrival {
                Arrival::Range(heard) => Some(heard.range.t_s),
                _ => None,
            })
            .collect();
        assert!(
            times[1] >= times[0] && times[1] - times[0] < 60.0,
            "{times:?}"
        );
    }

    #[test]
    fn a_datagram_without_a_time_counts_from_its_arrival() {
        let told = |text: &str| ins(text.as_bytes(), 100.0);
        let Arrival::Ins(sample) = told(r#"{"x_m": 1, "y_m": -2.5, "z_m": 30}"#) else {
            panic!();
        };
        assert_eq!(sample.t_s, 100.0);
        assert_eq!(sample.position_m.as_slice(), [1.0, -2.5, 30.0]);
        let Arrival::Ins(sample) = told(r#"{"t_s": 99.5, "x_m": 1, "y_m": 2, "z_m": 3}"#) else {
            panic!();
        };
        assert_eq!(sample.t_s, 99.5);
    }

    #[test]
    fn a_datagram_that_cannot_be_used_is_told() {
        for text in [
            "",
            "x",
            r#"{"x_m": 1, "y_m": 2}"#,
            r#"{"x_m": 1, "y_m": 2, "z_m": 3, "w_m": 4}"#,
            r#"{"x_m": 1e300, "y_m": 2, "z_m": 3}"#,
        ] {
            let told = ins(text.as_bytes(), 0.0);
            assert!(matches!(told, Arrival::Unusable(_)), "{text}");
        }
    }
}
