//! From records and commands to bytes.

use crate::{CRC, CRC_LEN, MAX_FRAME_LEN, MAX_PAYLOAD_LEN, Message, PROTOCOL_VERSION};

/// Numbers records and frames them.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    sequence: u16,
}

/// Why a record could not be framed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EncodeError {
    /// The record is longer than [`MAX_PAYLOAD_LEN`].
    TooLong,
}

impl core::fmt::Display for EncodeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooLong => write!(f, "the record is longer than {MAX_PAYLOAD_LEN} bytes"),
        }
    }
}

impl core::error::Error for EncodeError {}

impl Encoder {
    /// An encoder whose first frame has sequence number 0.
    pub const fn new() -> Self {
        Self::starting_at(0)
    }

    /// An encoder whose first frame has this sequence number: for a host, whose
    /// commands are to be told from those of whoever was connected before.
    pub const fn starting_at(sequence: u16) -> Self {
        Self { sequence }
    }

    /// The sequence number of the next frame.
    pub const fn next_sequence(&self) -> u16 {
        self.sequence
    }

    /// Frames `record` and returns the bytes for the wire, a part of `buffer`.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`]; no sequence number is used up then.
    pub fn encode<'b, M: Message>(
        &mut self,
        record: &M,
        buffer: &'b mut [u8; MAX_FRAME_LEN],
    ) -> Result<&'b [u8], EncodeError> {
        let mut payload = [0; MAX_PAYLOAD_LEN + CRC_LEN];
        let len = {
            let room = payload
                .get_mut(..MAX_PAYLOAD_LEN)
                .ok_or(EncodeError::TooLong)?;
            postcard::to_slice(&(PROTOCOL_VERSION, self.sequence, record), room)
                .map_err(|_| EncodeError::TooLong)?
                .len()
        };
        let (body, rest) = payload.split_at_mut(len);
        let crc = CRC.checksum(body).to_le_bytes();
        rest.iter_mut().zip(crc).for_each(|(to, byte)| *to = byte);

        let [leading, stuffed @ ..] = buffer;
        *leading = 0;
        let source = payload.get(..len + CRC_LEN).ok_or(EncodeError::TooLong)?;
        let stuffed_len = cobs::try_encode(source, stuffed).map_err(|_| EncodeError::TooLong)?;
        let trailing = stuffed.get_mut(stuffed_len).ok_or(EncodeError::TooLong)?;
        *trailing = 0;

        self.sequence = self.sequence.wrapping_add(1);
        buffer.get(..stuffed_len + 2).ok_or(EncodeError::TooLong)
    }
}
