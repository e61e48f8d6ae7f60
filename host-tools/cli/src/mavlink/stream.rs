//! Frames in and out.
//!
//! In: MAVLink 1 and 2 as they come, checked by their CRC; what is no frame is passed over. Sequence numbers tell what was
//! lost and what came twice: a repeated frame is dropped, one that was overtaken is handed on, for its own time says
//! what it is worth. Out: MAVLink 2, numbered.

use mavlink::dialects::common::MavMessage;
use mavlink::error::MessageReadError;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};

/// What became of frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct FrameCounts {
    /// Good frames.
    pub(crate) frames: u64,
    /// Frames that their numbers say are missing.
    pub(crate) lost: u64,
    /// Frames that came twice; dropped.
    pub(crate) repeated: u64,
    /// Frames with a good CRC whose content makes no sense.
    pub(crate) unusable: u64,
}

/// Frames from one link.
pub(crate) struct Incoming {
    stream: MavlinkReader<VecDeque<u8>>,
    numbers: BTreeMap<(u32, u8), Numbers>,
    counts: FrameCounts,
}

impl Incoming {
    pub(crate) fn new() -> Self {
        Self {
            stream: MavlinkReader::new(VecDeque::new()),
            numbers: BTreeMap::new(),
            counts: FrameCounts::default(),
        }
    }

    /// Takes the next bytes of a stream.
    pub(crate) fn bytes(&mut self, bytes: &[u8], mut take: impl FnMut(MavHeader, MavMessage)) {
        self.stream.get_mut().extend(bytes);
        loop {
            let next = self.stream.read_any_message();
            if !self.handle(next, &mut take) {
                return;
            }
        }
    }

    /// Takes one datagram: frames do not reach over its end.
    pub(crate) fn datagram(
        &mut self,
        datagram: &[u8],
        mut take: impl FnMut(MavHeader, MavMessage),
    ) {
        let mut reader = MavlinkReader::with_capacity(datagram.len(), datagram);
        loop {
            let next = reader.read_any_message();
            if !self.handle(next, &mut take) {
                return;
            }
        }
    }

    /// A stream that was lost begins anew: half a frame of the old one is none.
    pub(crate) fn begin_anew(&mut self) {
        self.stream = MavlinkReader::new(VecDeque::new());
    }

    pub(crate) fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// Whether there may be more.
    fn handle(
        &mut self,
        next: Result<(MavHeader, MavMessage), MessageReadError>,
        take: &mut impl FnMut(MavHeader, MavMessage),
    ) -> bool {
        match next {
            Ok((header, message)) => {
                let from = (header.system_id, header.component_id);
                let numbers = self.numbers.entry(from).or_default();
                if numbers.take(header.sequence, &mut self.counts) {
                    take(header, message);
                }
                true
            }
            Err(MessageReadError::Parse(_)) => {
                self.counts.unusable += 1;
                true
            }
            // All bytes are used up.
            Err(MessageReadError::Io(_)) => false,
        }
    }
}

/// The last 64 numbers of one sender.
#[derive(Clone, Copy, Debug, Default)]
struct Numbers {
    newest: Option<u8>,
    /// Bit k: the number k before the newest was seen.
    seen: u64,
}

impl Numbers {
    /// Whether a frame of this number is new.
    fn take(&mut self, number: u8, counts: &mut FrameCounts) -> bool {
        let ahead = self.newest.map(|newest| number.wrapping_sub(newest) as i8);
        match ahead {
            Some(0) => {
                counts.repeated += 1;
                return false;
            }
            Some(ahead @ 1..) => {
                let ahead = u32::from(ahead.unsigned_abs());
                counts.lost += u64::from(ahead) - 1;
                self.seen = self.seen.checked_shl(ahead).unwrap_or(0) | 1;
                self.newest = Some(number);
            }
            Some(behind @ -63..=-1) => {
                let bit = 1 << behind.unsigned_abs();
                if self.seen & bit != 0 {
                    counts.repeated += 1;
                    return false;
                }
                self.seen |= bit;
                // It was taken for lost, unless it was sent before the first that we heard.
                counts.lost = counts.lost.saturating_sub(1);
            }
            // The first one, or a sender that has started again.
            None | Some(_) => {
                self.newest = Some(number);
                self.seen = 1;
            }
        }
        counts.frames += 1;
        true
    }
}

/// The message of one frame.
///
/// # Errors
/// What is wrong with the frame.
pub(crate) fn one(frame: &[u8]) -> Result<(MavHeader, MavMessage), MessageReadError> {
    MavlinkReader::with_capacity(frame.len(), frame).read_any_message()
}

/// Numbers and packs what we say.
pub(crate) struct Outgoing {
    header: MavHeader,
    raw: MAVLinkV2MessageRaw,
}

impl Outgoing {
    /// As this system and component.
    pub(crate) fn of(system: u8, component: u8) -> Self {
        Self {
            header: MavHeader {
                system_id: system.into(),
                component_id: component,
                sequence: 0,
            },
            raw: MAVLinkV2MessageRaw::new(),
        }
    }

    /// From now on as this system.
    pub(crate) fn join(&mut self, system: u8) {
        self.header.system_id = system.into();
    }

    /// The message as a frame.
    pub(crate) fn pack(&mut self, message: &MavMessage) -> &[u8] {
        self.raw = MAVLinkV2MessageRaw::new();
        self.raw.serialize_message(self.header, message);
        self.header.sequence = self.header.sequence.wrapping_add(1);
        self.raw.raw_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::SYSTEM_TIME_DATA;
    use proptest::prelude::*;

    fn message(number: u32) -> MavMessage {
        MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
            time_unix_usec: 7,
            time_boot_ms: number,
        })
    }

    fn number(message: &MavMessage) -> u32 {
        match message {
            MavMessage::SYSTEM_TIME(time) => time.time_boot_ms,
            other => panic!("{other:?}"),
        }
    }

    fn frames(count: u32) -> Vec<Vec<u8>> {
        let mut outgoing = Outgoing::of(1, 191);
        (0..count)
            .map(|k| outgoing.pack(&message(k)).to_vec())
            .collect()
    }

    proptest! {
        #[test]
        fn a_stream_cut_anywhere_with_garbage_between_gives_every_frame(
            garbage in prop::collection::vec(prop::collection::vec(0..0xf0u8, 0..40), 20),
            cut in 1..50usize,
        ) {
            let mut stream = Vec::new();
            for (frame, garbage) in frames(20).iter().zip(&garbage) {
                stream.extend(garbage);
                stream.extend(frame);
            }
            let mut incoming = Incoming::new();
            let mut heard = Vec::new();
            for piece in stream.chunks(cut) {
                incoming.bytes(piece, |_, m| heard.push(number(&m)));
            }
            prop_assert_eq!(heard, (0..20).collect::<Vec<_>>());
            prop_assert_eq!(incoming.counts(), FrameCounts { frames: 20, ..FrameCounts::default() });
        }

        #[test]
        fn datagrams_lost_repeated_and_out_of_order_give_each_frame_at_most_once(
            // For each frame: how many copies, and how far it is held up.
            fates in prop::collection::vec((0..3usize, 0..30u32), 1..300),
        ) {
            let mut sent: Vec<(u32, Vec<u8>)> = Vec::new();
            for (k, (frame, &(copies, late))) in frames(300).iter().zip(&fates).enumerate() {
                sent.extend((0..copies).map(|copy| (k as u32 + late * copy as u32, frame.clone())));
            }
            sent.sort_by_key(|&(at, _)| at);
            let mut incoming = Incoming::new();
            let mut heard = Vec::new();
            for (_, datagram) in &sent {
                incoming.datagram(datagram, |_, m| heard.push(number(&m)));
            }
            let mut unique = heard.clone();
            unique.sort_unstable();
            unique.dedup();
            prop_assert_eq!(unique.len(), heard.len());
            let wanted: Vec<u32> = (0..).zip(&fates).filter(|(_, f)| f.0 > 0).map(|(k, _)| k).collect();
            // A gap of more than 127 looks like a new start; nothing is lost by that.
            prop_assert_eq!(unique, wanted);
        }

        #[test]
        fn any_datagram_and_any_stream_are_borne(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut incoming = Incoming::new();
            incoming.datagram(&bytes, |_, _| {});
            incoming.bytes(&bytes, |_, _| {});
            incoming.begin_anew();
            let mut heard = 0;
            incoming.bytes(&frames(1)[0], |_, _| heard += 1);
            prop_assert_eq!(heard, 1);
        }
    }

    #[test]
    fn what_is_missing_is_counted_and_taken_back_when_it_comes_late() {
        let frames = frames(10);
        let mut incoming = Incoming::new();
        for k in [0, 1, 5, 3, 3, 9] {
            incoming.datagram(&frames[k], |_, _| {});
        }
        let counts = incoming.counts();
        assert_eq!((counts.frames, counts.lost, counts.repeated), (5, 5, 1));
    }
}
