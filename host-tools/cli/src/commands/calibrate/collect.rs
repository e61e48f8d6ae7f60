//! Ranges of every pair, and the antenna delays in force, from streams.

use super::survey::{Link, Placement};
use crate::arrivals::{Arrival, News, hear};
use crate::interrupt;
use crate::screen::spinner;
use crate::source::{PATIENCE, Place, Source};
use anyhow::Result;
use nova_wire::{Decoder, Event, Record, Setting, SettingValue, Value};
use std::collections::BTreeMap;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// Antenna delays that a node's firmware works by, in ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Delays {
    pub(super) tx_ticks: u16,
    pub(super) rx_ticks: u16,
}

/// When a live placement has enough.
#[derive(Clone, Copy, Debug)]
pub(super) struct Enough {
    /// Ranges of each pair.
    pub(super) ranges: usize,
    /// Or so much time.
    pub(super) duration: Duration,
}

/// One range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) raw_m: f64,
    /// What the board has taken off it for the power received.
    pub(super) bias_m: f64,
    /// With which power it was received, if the radio was asked.
    pub(super) rx_power_dbm: Option<f64>,
}

/// What one placement's streams have brought.
#[derive(Default)]
pub(super) struct Collected {
    /// Ranges by the node that reports and the one it is away from, in time order.
    by_reporter: BTreeMap<(u16, u16), Vec<Sample>>,
    /// What nodes have told of their antenna delays.
    pub(super) delays: BTreeMap<u16, Delays>,
    /// Bytes and records of each source, for complaints.
    pub(super) heard: Vec<Heard>,
}

/// How a source was heard.
pub(super) struct Heard {
    pub(super) name: String,
    pub(super) bytes: u64,
    pub(super) records: u64,
    /// Whether it said which board it is.
    pub(super) has_address: bool,
}

impl Collected {
    /// The ranges of a pair. Both nodes tell the same ranges; those of the one that tells more count.
    pub(super) fn ranges(&self, link: Link) -> &[Sample] {
        let [a, b] = link.nodes();
        let of = |reporter, peer| {
            let ranges = self.by_reporter.get(&(reporter, peer));
            ranges.map(Vec::as_slice).unwrap_or_default()
        };
        let (one, other): (&[Sample], &[Sample]) = (of(a, b), of(b, a));
        if one.len() >= other.len() { one } else { other }
    }

    /// All pairs that have ranges.
    pub(super) fn links(&self) -> Vec<Link> {
        let mut links: Vec<Link> = (self.by_reporter.keys())
            .map(|&(a, b)| Link::new(a, b))
            .collect();
        links.sort_unstable();
        links.dedup();
        links
    }

    fn has(&self, links: &[Link], ranges: usize) -> bool {
        links.iter().all(|&link| self.ranges(link).len() >= ranges)
    }
}

/// One board's stream.
struct Stream {
    decoder: Decoder,
    /// Whose it is, once it has told.
    address: Option<u16>,
    /// Ranges from before that.
    early: Vec<(u16, Sample)>,
    tx_ticks: Option<u16>,
    rx_ticks: Option<u16>,
}

impl Stream {
    fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            address: None,
            early: Vec::new(),
            tx_ticks: None,
            rx_ticks: None,
        }
    }

    fn take(&mut self, record: &Record, into: &mut Collected) {
        match record {
            Record::Boot(boot) | Record::About(boot) => self.address = Some(boot.address),
            Record::Status(status) => self.address = Some(status.address),
            Record::Range(range) => {
                let raw_m = f64::from(range.raw_m);
                let rx_power_dbm = (range.quality.as_ref())
                    .map(|quality| f64::from(quality.rx_power_dbm))
                    .filter(|power| power.is_finite());
                let bias_m = f64::from(range.bias_m);
                if raw_m.is_finite() && bias_m.is_finite() {
                    let sample = Sample {
                        raw_m,
                        bias_m,
                        rx_power_dbm,
                    };
                    self.early.push((range.peer, sample));
                }
            }
            Record::Setting(SettingValue {
                setting,
                value: Value::Number(ticks),
                ..
            }) => match Setting::from_number(*setting) {
                Some(Setting::TxAntennaDelay) => self.tx_ticks = u16::try_from(*ticks).ok(),
                Some(Setting::RxAntennaDelay) => self.rx_ticks = u16::try_from(*ticks).ok(),
                _ => {}
            },
            _ => {}
        }
        let Some(address) = self.address else {
            return;
        };
        for (peer, sample) in self.early.drain(..) {
            into.by_reporter
                .entry((address, peer))
                .or_default()
                .push(sample);
        }
        if let (Some(tx_ticks), Some(rx_ticks)) = (self.tx_ticks, self.rx_ticks) {
            into.delays.insert(address, Delays { tx_ticks, rx_ticks });
        }
    }
}

/// Reads all of a placement's streams: recordings to their end, live boards until there is enough.
pub(super) fn collect(
    placement: &Placement,
    baud: u32,
    enough: Enough,
    quiet: bool,
) -> Result<Collected> {
    let mut sources = Vec::new();
    let mut collected = Collected::default();
    let mut live = false;
    for name in &placement.sources {
        let place = Place::named(name, baud)?;
        live |= place.is_live();
        let mut source = Source::open(place)?;
        source.ask_for_settings();
        collected.heard.push(Heard {
            name: source.place().to_string(),
            bytes: 0,
            records: 0,
            has_address: false,
        });
        sources.push(source);
    }
    let wanted = placement.links();
    let mut streams: Vec<Stream> = sources.iter().map(|_| Stream::new()).collect();
    let arrivals = hear(sources);
    let until = Instant::now() + enough.duration;
    let bar = spinner(quiet);
    while !interrupt::caught() {
        if live && (Instant::now() >= until || collected.has(&wanted, enough.ranges)) {
            break;
        }
        match arrivals.recv_timeout(PATIENCE) {
            Ok(arrival) => take(arrival, &mut streams, &mut collected)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        let least = wanted
            .iter()
            .map(|&link| collected.ranges(link).len())
            .min();
        bar.set_message(format!(
            "{} ranges of each pair at least",
            least.unwrap_or(0)
        ));
    }
    bar.finish_and_clear();
    Ok(collected)
}

fn take(arrival: Arrival, streams: &mut [Stream], into: &mut Collected) -> Result<()> {
    let bytes = match arrival.news {
        News::Bytes(bytes) => bytes,
        News::End(result) => return result,
        // Nobody asked for lost ports to be tried again.
        News::Lost(_) | News::Back => return Ok(()),
    };
    let Some(stream) = streams.get_mut(arrival.source) else {
        return Ok(());
    };
    for byte in &bytes {
        if let Some(Event::Record { record, .. }) = stream.decoder.push(*byte) {
            stream.take(&record, into);
        }
    }
    if let Some(heard) = into.heard.get_mut(arrival.source) {
        let statistics = stream.decoder.statistics();
        heard.bytes = statistics.bytes;
        heard.records = statistics.records;
        heard.has_address = stream.address.is_some();
    }
    Ok(())
}
