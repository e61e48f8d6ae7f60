//! What a node thinks of its ranges before it reports them.

use micromath::F32Ext;
use nova_ranging::filter::{self, FilterBank, FilterSettings, RawRange};
use nova_ranging::nlos::{self, NlosRule, Signs};
use nova_ranging::{Address, PhyProfile};
use nova_wire::{Filtered, Range, RangeFlags, Treatment};

/// Peers whose ranges are filtered at the same time; those heard from least
/// recently lose their place.
const PEERS: usize = 20;

/// The NLOS rule and the filters for all peers.
#[derive(Debug)]
pub(crate) struct Judge {
    rule: NlosRule,
    filters: FilterBank<PEERS>,
}

impl Judge {
    pub(crate) const fn new(phy: &PhyProfile, settings: FilterSettings) -> Self {
        Self {
            rule: NlosRule::new(phy.channel, phy.prf),
            filters: FilterBank::new(settings),
        }
    }

    /// Adds to a range with its raw value and quality what follows from them:
    /// NLOS probability and flag, treatment and estimate.
    pub(crate) fn judge(&mut self, range: &mut Range) {
        let probability = range.quality.and_then(|quality| {
            self.rule.probability(&Signs {
                rx_power_dbm: quality.rx_power_dbm,
                first_path_power_dbm: quality.first_path_power_dbm,
                range_m: range.raw_m,
            })
        });
        if let Some(quality) = &mut range.quality {
            // By the trait's name: where std is linked in, f32 has its own round.
            quality.nlos_percent = probability.map(|p| F32Ext::round(p * 100.0) as u8);
        }
        if probability.is_some_and(|p| p >= nlos::LIKELY) {
            range.flags = range.flags.with(RangeFlags::NLOS);
        }
        let raw = RawRange {
            at_us: range.t_us,
            range_m: range.raw_m,
            nlos_probability: probability,
        };
        let (treatment, estimate) = self.filters.update(Address(range.peer), &raw);
        range.treatment = match treatment {
            filter::Treatment::Started => Treatment::Started,
            filter::Treatment::Accepted => Treatment::Accepted,
            filter::Treatment::DownWeighted => Treatment::DownWeighted,
            filter::Treatment::RejectedOutlier => Treatment::RejectedOutlier,
            filter::Treatment::RejectedNlos => Treatment::RejectedNlos,
            filter::Treatment::RejectedInvalid => Treatment::RejectedInvalid,
            filter::Treatment::Reacquired => Treatment::Reacquired,
        };
        range.filtered = estimate.map(|e| Filtered {
            range_m: e.range_m,
            rate_m_per_s: e.rate_m_per_s,
            variance_m2: e.variance_m2,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_wire::Quality;

    fn range(t_us: u64, raw_m: f32, quality: Option<Quality>) -> Range {
        Range {
            t_us,
            peer: 7,
            raw_m,
            quality,
            flags: RangeFlags::INITIATOR,
            ..Range::default()
        }
    }

    #[test]
    fn a_range_is_judged_by_its_reception_and_filtered_per_peer() {
        let mut judge = Judge::new(&PhyProfile::DEFAULT, FilterSettings::DEFAULT);
        let healthy = Quality {
            rx_power_dbm: -80.0,
            first_path_power_dbm: -81.0,
            ..Quality::default()
        };
        let spread = Quality {
            first_path_power_dbm: -94.0,
            ..healthy
        };
        let mut first = range(0, 5.0, Some(healthy));
        judge.judge(&mut first);
        assert_eq!(first.treatment, Treatment::Started);
        assert_eq!(first.filtered.map(|f| f.range_m), Some(5.0));
        assert!(
            first
                .quality
                .and_then(|q| q.nlos_percent)
                .is_some_and(|p| p < 5)
        );
        assert_eq!(first.flags, RangeFlags::INITIATOR);

        let mut blocked = range(10_000, 7.5, Some(spread));
        judge.judge(&mut blocked);
        assert_eq!(blocked.treatment, Treatment::RejectedNlos);
        assert!(
            blocked
                .quality
                .and_then(|q| q.nlos_percent)
                .is_some_and(|p| p > 50)
        );
        assert!(blocked.flags.contains(RangeFlags::NLOS));
        assert!(blocked.flags.contains(RangeFlags::INITIATOR));
        assert_eq!(blocked.raw_m, 7.5);
        assert!(
            blocked
                .filtered
                .is_some_and(|f| (f.range_m - 5.0).abs() < 0.01)
        );

        let mut other = Range {
            peer: 8,
            ..range(20_000, 50.0, None)
        };
        judge.judge(&mut other);
        assert_eq!(other.treatment, Treatment::Started);
        assert_eq!(other.quality, None);
    }
}
