//! A frame goes out, on time or not at all.

use super::{FCS_LEN, Radio, RadioError, STAMP_TRIES, timer_counts};
use crate::access::{self, ctrl, header, status};
use crate::bus::RadioBus;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::frame::MAX_FRAME_LEN;
use nova_ranging::{DeviceTime, Then, Ticks, When};

/// The most that W4R_TIM holds: 20 bits (7.2.28).
const W4R_TIM_MAX: u32 = 0xF_FFFF;
impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// Sends a frame; the radio then does by itself what `then` says. `Ok(false)`
    /// means that the time for it had passed; the radio is idle then.
    pub(crate) fn send(
        &mut self,
        frame: &[u8],
        when: When,
        then: Then,
    ) -> Result<bool, RadioError> {
        self.write_tx_buffer(frame)?;
        let len = u32::from(frame.len() as u8 + FCS_LEN);
        let [a, b, c, d] = (self.tx_fctrl | len).to_le_bytes();
        self.write_raw(&[header::WRITE_TX_FCTRL, a, b, c, d])?;
        let mut command = ctrl::TXSTRT;
        if let When::At(start) = when {
            let [a, b, c, d, e, ..] = start.ticks().to_le_bytes();
            self.write_raw(&[header::WRITE_DX_TIME, a, b, c, d, e])?;
            command |= ctrl::TXDLYS;
        }
        if let Then::Listen { .. } = then {
            command |= ctrl::WAIT4RESP;
        }
        self.write_raw(&[header::WRITE_SYS_CTRL, command])?;
        if let When::At(start) = when
            && (self.is_late()? || self.is_misled(start)?)
        {
            self.switch_off()?;
            return Ok(false);
        }
        // From here on there is time: the preamble has yet to go.
        if let Then::Listen {
            after_us,
            timeout_us,
        } = then
        {
            self.set_listen_after(after_us)?;
            self.set_timeout(timeout_us)?;
        }
        self.clear_taken()?;
        Ok(true)
    }

    /// Whether the delayed transmission just asked for is.
    ///
    /// A start in the past would come true after a wrap, 17 s from now; one with too
    /// little time to power up would go out damaged (7.2.17) or never end (application
    /// note APS022, section 5.4).
    pub(super) fn is_late(&mut self) -> Result<bool, RadioError> {
        let [register, sub] = header::READ_SYS_STATUS_3;
        let [_, _, low, high] = access::read(&mut self.bus, [register, sub, 0, 0])?;
        let warnings = u16::from_le_bytes([low, high]);
        Ok(warnings & (status::HPDWARN_3 | status::TXPUTE_3) != 0)
    }

    /// Whether the time for the delayed transmission that waits has arrived in the radio
    /// with wrong bits. The frame says when it was sent: it must not leave otherwise.
    pub(super) fn is_misled(&mut self, start: DeviceTime) -> Result<bool, RadioError> {
        let arrived = self.stamp_once(header::READ_DX_TIME)?;
        if arrived != start {
            self.bus_errors = self.bus_errors.wrapping_add(1);
        }
        Ok(arrived != start)
    }

    /// The stamp of the frame just sent, which must be the radio's raw one with the antenna
    /// delay that was set. If it is not the bus has lost a bit, now, or when something was
    /// written that landed on the antenna delay: then no stamp is true any more.
    pub(super) fn sent_at(&mut self) -> Result<DeviceTime, RadioError> {
        for _ in 0..STAMP_TRIES {
            let bytes = [header::READ_TX_TIME, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
            let [_, a, b, c, d, e, f, g, h, i, j] = access::read(&mut self.bus, bytes)?;
            let time = |[a, b, c, d, e]: [u8; 5]| {
                DeviceTime::from_ticks(u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]))
            };
            let stamp = time([a, b, c, d, e]);
            let delay = Ticks::new(self.antenna_delay.tx_ticks.into());
            if stamp == time([f, g, h, i, j]).after(delay) {
                return Ok(stamp);
            }
            self.bus_errors = self.bus_errors.wrapping_add(1);
        }
        Err(RadioError::SettingsLost)
    }

    /// Sets how long after a frame sent the receiver goes on by itself.
    pub(super) fn set_listen_after(&mut self, us: u32) -> Result<(), RadioError> {
        let counts = timer_counts(us).min(W4R_TIM_MAX);
        if counts != self.set.listen_after {
            let [a, b, c, d] = counts.to_le_bytes();
            self.write_raw(&[header::WRITE_ACK_RESP_T, a, b, c, d])?;
            self.set.listen_after = counts;
        }
        Ok(())
    }

    pub(super) fn write_tx_buffer(&mut self, frame: &[u8]) -> Result<(), RadioError> {
        let mut bytes: heapless::Vec<u8, { MAX_FRAME_LEN + 1 }> = heapless::Vec::new();
        bytes
            .push(header::WRITE_TX_BUFFER)
            .map_err(|_| RadioError::Bus)?;
        bytes
            .extend_from_slice(frame)
            .map_err(|_| RadioError::Bus)?;
        self.write_raw(&bytes)
    }
}
