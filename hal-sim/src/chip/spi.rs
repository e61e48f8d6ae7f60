//! SPI transactions: a header of one to three bytes, then data (User Manual 2.2.1).
//!
//! Byte 0: bit 7 write, bit 6 sub-index present, bits 5-0 register file. Byte 1: bit 7 extended, bits 6-0 low part of
//! the sub-index. Byte 2: bits 14-7 of the sub-index.

/// Decoder of one transaction, from chip select low to high.
#[derive(Debug, Clone, Default)]
pub(crate) struct Transaction {
    header: [u8; 3],
    header_len: usize,
    complete: bool,
    /// Bytes read so far, or the bytes to write.
    pub(crate) read_count: usize,
    pub(crate) written: Vec<u8>,
}

/// What a complete header asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Target {
    pub(crate) write: bool,
    pub(crate) file: u8,
    pub(crate) offset: usize,
}

impl Transaction {
    /// Takes header bytes from the front of `mosi`; returns how many.
    pub(crate) fn take_header(&mut self, mosi: &[u8]) -> usize {
        let mut taken = 0;
        for &byte in mosi {
            if self.complete {
                break;
            }
            if let Some(slot) = self.header.get_mut(self.header_len) {
                *slot = byte;
            }
            self.header_len += 1;
            taken += 1;
            self.complete = match self.header_len {
                1 => byte & 0x40 == 0,
                2 => byte & 0x80 == 0,
                _ => true,
            };
        }
        taken
    }

    /// The target, once the header is complete.
    pub(crate) fn target(&self) -> Option<Target> {
        if !self.complete {
            return None;
        }
        let [first, second, third] = self.header;
        let offset = match self.header_len {
            1 => 0,
            2 => usize::from(second & 0x7F),
            _ => usize::from(second & 0x7F) | usize::from(third) << 7,
        };
        Some(Target {
            write: first & 0x80 != 0,
            file: first & 0x3F,
            offset,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(bytes: &[u8]) -> (usize, Option<Target>) {
        let mut transaction = Transaction::default();
        let taken = transaction.take_header(bytes);
        (taken, transaction.target())
    }

    #[test]
    fn headers_of_one_two_and_three_bytes_are_told_apart() {
        let target = |write, file, offset| {
            Some(Target {
                write,
                file,
                offset,
            })
        };
        assert_eq!(decode(&[0x0F, 1, 2]), (1, target(false, 0x0F, 0)));
        assert_eq!(decode(&[0xED, 0x06, 2]), (2, target(true, 0x2D, 0x06)));
        assert_eq!(
            decode(&[0x6E, 0x84, 0x30, 9]),
            (3, target(false, 0x2E, 0x1804))
        );
        assert_eq!(decode(&[0x6E, 0x84]), (2, None));
    }
}
