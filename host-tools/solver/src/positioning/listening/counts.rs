//! What became of what was heard.

/// Exchanges and frames by what became of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ListeningCounts {
    /// Exchanges that gave a difference.
    pub differences: u64,
    /// Of an anchor whose place nobody gave.
    pub unknown_anchor: u64,
    /// Responses, finals and reports of a round whose poll was not heard, or that is over.
    pub no_poll: u64,
    /// Responses to which the initiator named none in its final, or whose final was not heard.
    pub no_final: u64,
    /// Responders that a final names, but whose response was not heard.
    pub no_response: u64,
    /// Responders whose report was not heard.
    pub no_report: u64,
    /// Frames that came twice; the first counts.
    pub repeated: u64,
    /// Stamps or intervals that cannot be: see [`ExchangeFault`](super::ExchangeFault).
    pub bad_stamps: u64,
    /// Exchanges whose two anchors measured another distance than that of their places.
    pub other_distance: u64,
    /// Differences larger than the two anchors are apart: no place has such.
    pub impossible: u64,
    /// Rounds given up because too many initiators were heard at once, or because the listener started anew.
    pub cut_off: u64,
}

impl ListeningCounts {
    /// All causes with their names, differences left out.
    pub fn rejections(&self) -> [(&'static str, u64); 10] {
        [
            ("unknown_anchor", self.unknown_anchor),
            ("no_poll", self.no_poll),
            ("no_final", self.no_final),
            ("no_response", self.no_response),
            ("no_report", self.no_report),
            ("repeated", self.repeated),
            ("bad_stamps", self.bad_stamps),
            ("other_distance", self.other_distance),
            ("impossible", self.impossible),
            ("cut_off", self.cut_off),
        ]
    }
}
