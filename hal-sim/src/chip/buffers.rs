//! The double receive buffer: two sets of registers that the host and the receiver use in turn (User Manual 4.3).
//!
//! With DIS_DRXB set, the reset default, both sides stay on the same set.

use super::bits::{file, status};

/// RX_FINFO to RX_TIME and the status bits of one reception.
#[derive(Debug, Clone)]
pub(super) struct BufferSet {
    pub(super) finfo: [u8; 4],
    pub(super) data: Vec<u8>,
    pub(super) fqual: [u8; 8],
    pub(super) tracking_interval: [u8; 4],
    pub(super) tracking_offset: [u8; 5],
    pub(super) time: [u8; 14],
    /// LDEDONE, RXDFR, RXFCG and RXFCE.
    pub(super) status: u64,
}

impl Default for BufferSet {
    fn default() -> Self {
        BufferSet {
            finfo: [0; 4],
            data: vec![0; 1024],
            fqual: [0; 8],
            tracking_interval: [0; 4],
            tracking_offset: [0; 5],
            time: [0; 14],
            status: 0,
        }
    }
}

impl BufferSet {
    /// The bytes behind a register file of the set; `None` for register files outside it.
    pub(super) fn file(&self, id: u8) -> Option<&[u8]> {
        Some(match id {
            file::RX_FINFO => &self.finfo,
            file::RX_BUFFER => &self.data,
            file::RX_FQUAL => &self.fqual,
            file::RX_TTCKI => &self.tracking_interval,
            file::RX_TTCKO => &self.tracking_offset,
            file::RX_TIME => &self.time,
            _ => return None,
        })
    }
}

#[derive(Debug, Default)]
pub(super) struct ReceiveBuffers {
    sets: [BufferSet; 2],
    host: bool,
    chip: bool,
}

impl ReceiveBuffers {
    /// The set that the host sees.
    pub(super) fn host(&self) -> &BufferSet {
        &self.sets[usize::from(self.host)]
    }

    pub(super) fn host_mut(&mut self) -> &mut BufferSet {
        &mut self.sets[usize::from(self.host)]
    }

    /// The set that the receiver fills.
    pub(super) fn chip_mut(&mut self) -> &mut BufferSet {
        &mut self.sets[usize::from(self.chip)]
    }

    /// Which set the receiver fills.
    pub(super) fn chip_index(&self) -> usize {
        usize::from(self.chip)
    }

    pub(super) fn set_mut(&mut self, index: usize) -> &mut BufferSet {
        &mut self.sets[index % 2]
    }

    /// HRBPT: the host is done with its set, whose events go with it (4.3.3: the host clears them itself only when
    /// both pointers are equal).
    pub(super) fn toggle_host(&mut self) {
        self.host_mut().status = 0;
        self.host = !self.host;
    }

    /// The receiver has filled its set and takes the other.
    pub(super) fn toggle_chip(&mut self) {
        self.chip = !self.chip;
    }

    /// The receiver would overwrite a frame that the host has not released.
    pub(super) fn overrun(&self) -> bool {
        self.sets[usize::from(self.chip)].status & status::RXDFR != 0
    }

    /// HSRBP and ICRBP.
    pub(super) fn pointer_bits(&self) -> u64 {
        let host = if self.host { status::HSRBP } else { 0 };
        let chip = if self.chip { status::ICRBP } else { 0 };
        host | chip
    }
}
