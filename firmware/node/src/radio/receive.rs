//! A frame comes in: its time stamp, its bytes, how well it was received.

use super::{FCS_LEN, RX_BUFFER_LEN, Radio, RadioError, RadioEvent, RxBuffer, STAMP_TRIES};
use crate::access::{self, header, status};
use crate::bus::RadioBus;
use crate::diagnostics::Reception;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// How well the last frame was received. Valid until the next one comes.
    ///
    /// Each register is read once: a bit that the bus loses shows as a level that the peer's others do not bear out
    /// ([`Radio::read_level_again`]).
    pub(crate) fn reception(&mut self) -> Result<Reception, RadioError> {
        let [noise, f2, f3, response_power] = self.power_registers()?;
        let [register, sub] = header::READ_RX_TIME_5;
        let [_, _, a, b, c, d] = access::read(&mut self.bus, [register, sub, 0, 0, 0, 0])?;
        let [x, y, z] = header::READ_LDE_PPINDX;
        let [_, _, _, peak_low, peak_high] = access::read(&mut self.bus, [x, y, z, 0, 0])?;
        // DRX_CAR_INT, which `ll` takes for two bytes of its three (7.2.40.11),
        // and RXPACC_NOSAT behind it (7.2.40.12).
        let [register, sub] = header::READ_DRX_CAR_INT;
        let digital = [register, sub, 0, 0, 0, 0, 0, 0];
        let [_, _, low, mid, high, _, count_low, count_high] =
            access::read(&mut self.bus, digital)?;
        Ok(Reception {
            profile: self.profile,
            first_path_amplitudes: [u16::from_le_bytes([c, d]), f2, f3],
            response_power,
            preamble_count: preamble_count(self.taken_info),
            preamble_count_unsaturated: u16::from_le_bytes([count_low, count_high]),
            noise,
            first_path_index: u16::from_le_bytes([a, b]),
            peak_index: u16::from_le_bytes([peak_low, peak_high]),
            // Sign extension: the highest of the 21 bits goes to the top.
            carrier_integrator: i32::from_le_bytes([low, mid, high, 0]) << 11 >> 11,
        })
    }

    /// Puts in place of what a receive level follows from what two readings agree in.
    pub(crate) fn read_level_again(&mut self, reception: &mut Reception) -> Result<(), RadioError> {
        let (count, [noise, f2, f3, response_power]) = self.the_same_twice(|radio| {
            Ok((
                preamble_count(radio.frame_information()?),
                radio.power_registers()?,
            ))
        })?;
        let [f1, ..] = reception.first_path_amplitudes;
        reception.preamble_count = count;
        reception.noise = noise;
        reception.first_path_amplitudes = [f1, f2, f3];
        reception.response_power = response_power;
        Ok(())
    }

    /// RX_FINFO.
    pub(super) fn frame_information(&mut self) -> Result<[u8; 4], RadioError> {
        let [_, info @ ..] = access::read(&mut self.bus, [header::READ_RX_FINFO, 0, 0, 0, 0])?;
        Ok(info)
    }

    /// RX_FQUAL: STD_NOISE, FP_AMPL2, FP_AMPL3, CIR_PWR.
    pub(super) fn power_registers(&mut self) -> Result<[u16; 4], RadioError> {
        let [_, a, b, c, d, e, f, g, h] = access::read(
            &mut self.bus,
            [header::READ_RX_FQUAL, 0, 0, 0, 0, 0, 0, 0, 0],
        )?;
        Ok([[a, b], [c, d], [e, f], [g, h]].map(u16::from_le_bytes))
    }

    /// Whether the leading-edge search has given the frame a time stamp.
    pub(super) fn is_stamped(&mut self, mut now: u32) -> Result<bool, RadioError> {
        for _ in 0..STAMP_TRIES {
            if now & (status::LDEDONE | status::LDEERR) != 0 {
                break;
            }
            now = self.status()?;
        }
        Ok(now & status::LDEDONE != 0 && now & status::LDEERR == 0)
    }

    pub(super) fn take_frame<'b>(
        &mut self,
        buffer: &'b mut RxBuffer,
    ) -> Result<RadioEvent<'b>, RadioError> {
        self.taken_info = self.frame_information()?;
        let [low, high, _, _] = self.taken_info;
        // RXFLEN and RXFLE: ten bits.
        let len = u16::from_le_bytes([low, high & 0x03]);
        let len = usize::from(len.saturating_sub(FCS_LEN.into())).min(RX_BUFFER_LEN);
        let at = self.the_same_twice(|radio| radio.stamp_once(header::READ_RX_TIME))?;
        let transfer = buffer.get_mut(..=len).ok_or(RadioError::Bus)?;
        if let Some(first) = transfer.first_mut() {
            *first = header::READ_RX_BUFFER;
        }
        // A header without data would be one byte, which the nRF52832 must not
        // transfer (its anomaly 58).
        if len > 0 {
            self.bus
                .transfer_in_place(transfer)
                .map_err(|_| RadioError::Bus)?;
        }
        self.taken = true;
        let bytes = buffer.get(1..=len).ok_or(RadioError::Bus)?;
        Ok(RadioEvent::Received { bytes, at })
    }

    /// What two readings agree in: nothing else guards it on the bus, and one wrong bit makes
    /// a wrong range.
    pub(super) fn the_same_twice<T: PartialEq>(
        &mut self,
        read: impl Fn(&mut Self) -> Result<T, RadioError>,
    ) -> Result<T, RadioError> {
        let mut first = read(self)?;
        for _ in 0..STAMP_TRIES {
            let again = read(self)?;
            if again == first {
                return Ok(first);
            }
            self.bus_errors = self.bus_errors.wrapping_add(1);
            first = again;
        }
        Err(RadioError::Bus)
    }

    /// Soft reset of the receiver only (7.2.50.1). Reads back whether it took place: a
    /// receiver that goes on without stamps its frames wrong, and nothing shows it.
    pub(super) fn reset_receiver(&mut self) -> Result<(), RadioError> {
        for reset in [0b1110, 0b1111] {
            ll!(self.ll().pmsc_ctrl0().modify(|_, w| w.softreset(reset)))?;
            if ll!(self.ll().pmsc_ctrl0().read())?.softreset() != reset {
                return Err(RadioError::Bus);
            }
        }
        Ok(())
    }
}

/// RXPACC, the highest twelve bits of RX_FINFO (7.2.18).
fn preamble_count([_, _, low, high]: [u8; 4]) -> u16 {
    u16::from_le_bytes([low, high]) >> 4
}
