//! One-time programmable memory: 32-bit words behind OTP_ADDR, OTP_CTRL and OTP_RDAT (User Manual 6.3.1, table 10).

/// What the factory wrote into the chip. Words that are not listed read as 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtpConfig {
    /// Extended unique identifier (0x000, 0x001); copied to the EUI register at every reset unless it is 0.
    pub eui: u64,
    /// LDO tuning (0x004, 0x005), 40 bits.
    pub ldo_tune: u64,
    /// Part identifier (0x006): 0x101 and 20 bits.
    pub part_id: u32,
    /// Lot identifier (0x007): 0x1 and 28 bits.
    pub lot_id: u32,
    /// Transmit power words, for each of the channels 1 to 5 and 7 at PRF 16 and then 64 MHz (0x010 to 0x01B); 0 is not
    /// programmed.
    pub tx_power: [u32; 12],
    /// Antenna delays of sending and receiving together, in ticks at PRF 16 MHz (0x01C, low half).
    pub antenna_delay_prf16: u16,
    /// Antenna delays of sending and receiving together, in ticks at PRF 64 MHz (0x01C, high half).
    pub antenna_delay_prf64: u16,
    /// Crystal trim, 5 bits (0x01E, low byte); 0 is not programmed.
    pub xtal_trim: u8,
    /// Revision of this layout (0x01E, second byte).
    pub revision: u8,
}

impl Default for OtpConfig {
    fn default() -> Self {
        OtpConfig {
            eui: 0,
            ldo_tune: 0x88_8888_8888,
            part_id: 0x1010_0000,
            lot_id: 0x1000_0000,
            tx_power: [0; 12],
            antenna_delay_prf16: 32_912,
            antenna_delay_prf64: 32_912,
            xtal_trim: 0x10,
            revision: 1,
        }
    }
}

impl OtpConfig {
    /// The word at `address`.
    pub fn word(&self, address: u16) -> u32 {
        match address {
            0x000 => self.eui as u32,
            0x001 => (self.eui >> 32) as u32,
            0x004 => self.ldo_tune as u32,
            0x005 => (self.ldo_tune >> 32) as u32 & 0xFF,
            0x006 => self.part_id,
            0x007 => self.lot_id,
            0x010..=0x01B => self
                .tx_power
                .get(usize::from(address - 0x010))
                .copied()
                .unwrap_or(0),
            0x01C => {
                u32::from(self.antenna_delay_prf16) | u32::from(self.antenna_delay_prf64) << 16
            }
            0x01E => u32::from(self.xtal_trim & 0x1F) | u32::from(self.revision) << 8,
            _ => 0,
        }
    }
}
