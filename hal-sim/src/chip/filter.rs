//! Frame filtering on the MAC header (User Manual 5.2).

use super::bits::sys_cfg;

/// Who this chip is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identity {
    pub(crate) pan: u16,
    pub(crate) short: u16,
    pub(crate) eui: u64,
}

const BROADCAST: u16 = 0xFFFF;

/// Whether a frame (with its FCS) passes the filter that `cfg` (SYS_CFG) sets up.
pub(crate) fn accepts(cfg: u32, me: &Identity, frame: &[u8]) -> bool {
    cfg & sys_cfg::FFEN == 0 || passes(cfg, me, frame).unwrap_or(false)
}

/// `None` when the frame is too short for what its header announces.
fn passes(cfg: u32, me: &Identity, frame: &[u8]) -> Option<bool> {
    let control = u16::from_le_bytes([*frame.first()?, *frame.get(1)?]);
    let kind = control & 0b111;
    let allowed = match kind {
        0 => sys_cfg::FFAB,
        1 => sys_cfg::FFAD,
        2 => sys_cfg::FFAA,
        3 => sys_cfg::FFAM,
        4 => sys_cfg::FFA4,
        5 => sys_cfg::FFA5,
        _ => sys_cfg::FFAR,
    };
    if cfg & allowed == 0 {
        return Some(false);
    }
    // Acknowledgements have no addresses; types 4 and up are not defined far enough to filter on more.
    if kind == 2 || kind > 3 {
        return Some(true);
    }
    if control >> 12 & 0b11 > 1 {
        return Some(false); // frame version not known to the chip
    }
    let dest_mode = control >> 10 & 0b11;
    let source_mode = control >> 14 & 0b11;
    if dest_mode == 1 || source_mode == 1 {
        return Some(false); // reserved
    }

    let mut at = 3; // frame control and sequence number
    let mut take = |n: usize| -> Option<u64> {
        let bytes = frame.get(at..at + n)?;
        at += n;
        Some(bytes.iter().rev().fold(0, |v, b| v << 8 | u64::from(*b)))
    };

    let mut dest_pan = None;
    if dest_mode != 0 {
        let pan = take(2)? as u16;
        dest_pan = Some(pan);
        if pan != me.pan && pan != BROADCAST {
            return Some(false);
        }
        let to_me = if dest_mode == 2 {
            let short = take(2)? as u16;
            short == me.short || short == BROADCAST
        } else {
            take(8)? == me.eui
        };
        if !to_me {
            return Some(false);
        }
    }
    let pan_compressed = control & 1 << 6 != 0;
    let source_pan = match (source_mode, pan_compressed) {
        (0, _) => None,
        (_, true) => dest_pan,
        (_, false) => Some(take(2)? as u16),
    };
    if kind == 0 {
        return Some(me.pan == BROADCAST || source_pan == Some(me.pan));
    }
    if dest_mode == 0 {
        // Only a source: meant for the PAN coordinator.
        return Some(cfg & sys_cfg::FFBC != 0 && source_pan == Some(me.pan));
    }
    Some(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ME: Identity = Identity {
        pan: 0xDECA,
        short: 0x1234,
        eui: 0x1122_3344_5566_7788,
    };
    const DATA: u32 = sys_cfg::FFEN | sys_cfg::FFAD;

    fn data_to(pan: u16, short: u16) -> Vec<u8> {
        let mut frame = vec![0x41, 0x88, 0];
        frame.extend(pan.to_le_bytes());
        frame.extend(short.to_le_bytes());
        frame.extend([0x78, 0x56, 0, 0]);
        frame
    }

    #[test]
    fn data_frames_pass_by_pan_and_short_address() {
        assert!(accepts(DATA, &ME, &data_to(0xDECA, 0x1234)));
        assert!(accepts(DATA, &ME, &data_to(0xFFFF, 0xFFFF)));
        assert!(!accepts(DATA, &ME, &data_to(0xDECA, 0x1235)));
        assert!(!accepts(DATA, &ME, &data_to(0xDECB, 0x1234)));
    }

    #[test]
    fn type_must_be_allowed() {
        assert!(!accepts(
            sys_cfg::FFEN | sys_cfg::FFAA,
            &ME,
            &data_to(0xDECA, 0x1234)
        ));
        assert!(accepts(
            sys_cfg::FFEN | sys_cfg::FFAA,
            &ME,
            &[0x02, 0, 7, 0, 0]
        ));
        assert!(accepts(0, &ME, &data_to(1, 2)));
    }

    #[test]
    fn long_destination_must_be_the_eui() {
        let mut frame = vec![0x41, 0xCC, 0];
        frame.extend(0xDECAu16.to_le_bytes());
        frame.extend(ME.eui.to_le_bytes());
        frame.extend([0; 10]);
        assert!(accepts(DATA, &ME, &frame));
        frame[5] ^= 1;
        assert!(!accepts(DATA, &ME, &frame));
    }

    #[test]
    fn frames_without_destination_are_for_the_coordinator() {
        let mut frame = vec![0x01, 0x80, 0];
        frame.extend(0xDECAu16.to_le_bytes());
        frame.extend([1, 2, 0, 0]);
        assert!(!accepts(DATA, &ME, &frame));
        assert!(accepts(DATA | sys_cfg::FFBC, &ME, &frame));
    }

    #[test]
    fn truncated_headers_are_rejected() {
        assert!(!accepts(DATA, &ME, &[0x41]));
        assert!(!accepts(DATA, &ME, &[0x41, 0x88, 0, 0xCA, 0xDE, 0x34]));
    }
}
