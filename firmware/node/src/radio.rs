//! The DW1000: configured once, then touched as little as possible.
//!
//! Registers are reached through `dw1000::ll`, those that every frame needs
//! through `access.rs`. The high-level interface of `dw1000` is not used: it sets
//! some twenty registers anew for every frame, accepts frames with a bad check
//! sequence and notices a late transmission only afterwards.
//!
//! While a frame waits for its answer only what the answer needs crosses the bus.
//! Time-outs, diagnostics and the clearing of events come when it is on its way.

use crate::access::{self, ctrl, header, status};
use crate::bus::{Legacy, NoPin, RadioBus};
use crate::config::{AntennaDelay, SetAntennaDelay};
use crate::diagnostics::Reception;
use crate::phy;
use dw1000::ll;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::frame::MAX_FRAME_LEN;
use nova_ranging::time::MODULUS;
use nova_ranging::{DeviceTime, PhyProfile, Then, Ticks, When};

/// A DW1000 and the lines to it.
pub(crate) struct Radio<B, R, D> {
    pub(crate) bus: B,
    pub(crate) reset: R,
    pub(crate) delay: D,
    pub(crate) profile: PhyProfile,
    /// What people have set of them.
    pub(crate) set_antenna_delay: SetAntennaDelay,
    /// What the radio was told.
    pub(crate) antenna_delay: AntennaDelay,
    /// SYS_CFG without the bit for the time-out.
    pub(crate) sys_cfg: u32,
    /// TX_FCTRL without the frame's length.
    pub(crate) tx_fctrl: u32,
    pub(crate) set: Set,
    /// What the factory's memory says of the crystal, and whether it holds LDO tuning.
    pub(crate) crystal_trim: u8,
    pub(crate) ldo_tuned: bool,
    /// A frame was taken out of the radio whose events it still shows.
    taken: bool,
    /// RX_FINFO of the frame taken last.
    taken_info: [u8; 4],
    /// Times that the bus was seen to lose bits.
    bus_errors: u32,
}

/// Registers that change from frame to frame, as they are in the radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Set {
    /// W4R_TIM.
    listen_after: u32,
    /// RX_FWTO.
    timeout: u16,
    /// Whether SYS_CFG lets it end a reception.
    timeout_on: bool,
}

/// What the radio has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RadioEvent<'a> {
    /// The frame has been sent.
    Sent { at: DeviceTime },
    /// A frame with a good check sequence has come in; its first bytes.
    Received { bytes: &'a [u8], at: DeviceTime },
    /// A frame came in damaged. The receiver is off now.
    Damaged,
    /// The time for listening is over. The receiver is off now.
    ListenTimeout,
}

/// Why the radio cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RadioError {
    /// An SPI transfer failed.
    Bus,
    /// The reset line could not be driven.
    Reset,
    /// Not a DW1000: its identifier read like this. 0 or 0xFFFF_FFFF mean that
    /// nobody answers on the bus.
    WrongDevice(u32),
    /// The radio's clock PLL does not lock after reset.
    ClockNotLocked,
    /// The radio no longer is as it was set up: it lost its supply or was
    /// reset, or nothing drives the bus.
    SettingsLost,
}

impl core::fmt::Display for RadioError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus => f.write_str("an SPI transfer failed"),
            Self::Reset => f.write_str("the radio's reset line could not be driven"),
            Self::WrongDevice(id) => {
                write!(
                    f,
                    "no DW1000 on the bus: its identifier reads {id:#010x}, not 0xdeca0130"
                )
            }
            Self::ClockNotLocked => f.write_str("the radio's clock PLL does not lock"),
            Self::SettingsLost => f.write_str("the radio has lost its settings"),
        }
    }
}

impl core::error::Error for RadioError {}

/// Bytes of a received frame that are read: one more than the longest of ours, so that a
/// longer one is still told from it.
const RX_BUFFER_LEN: usize = MAX_FRAME_LEN + 1;

/// Space for a received frame, and the SPI header before it.
pub(crate) type RxBuffer = [u8; RX_BUFFER_LEN + 1];

/// An [`RxBuffer`] to start with.
pub(crate) const EMPTY_RX_BUFFER: RxBuffer = [0; RX_BUFFER_LEN + 1];

/// SYS_STATUS is read this often for the time stamp of a received frame. The
/// radio holds RXDFR, and RXFCG with it, back until the leading-edge search is
/// over (7.2.17, RXDFR), so that no further read is needed as a rule.
const STAMP_TRIES: usize = 10;

/// The most that W4R_TIM holds: 20 bits (7.2.28).
const W4R_TIM_MAX: u32 = 0xF_FFFF;

/// Length of the frame check sequence that the radio adds and checks.
const FCS_LEN: u8 = 2;

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// A radio that is not started yet.
    pub(crate) fn new(
        bus: B,
        reset: R,
        delay: D,
        profile: PhyProfile,
        antenna_delay: SetAntennaDelay,
    ) -> Self {
        Self {
            bus,
            reset,
            delay,
            profile,
            set_antenna_delay: antenna_delay,
            antenna_delay: antenna_delay.or(AntennaDelay::UNCALIBRATED),
            sys_cfg: 0,
            tx_fctrl: 0,
            set: Set::default(),
            crystal_trim: 0,
            ldo_tuned: false,
            taken: false,
            taken_info: [0; 4],
            bus_errors: 0,
        }
    }

    /// Another mode and other antenna delays, from the next start on.
    pub(crate) fn set_up_as(&mut self, profile: PhyProfile, antenna_delay: SetAntennaDelay) {
        self.profile = profile;
        self.set_antenna_delay = antenna_delay;
    }

    /// The antenna delays that the radio was told when it was started last.
    pub(crate) fn antenna_delay(&self) -> AntennaDelay {
        self.antenna_delay
    }

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

    /// Switches the receiver on until the radio's clock shows `until`, or for ever. How
    /// many microseconds that is; `None` if it is over already: the radio stays off then.
    pub(crate) fn listen(&mut self, until: Option<DeviceTime>) -> Result<Option<u32>, RadioError> {
        let left_us = match until {
            None => None,
            Some(until) => {
                let left = until.since(self.now()?);
                // More than half a turn of the clock ahead is behind.
                if left.get() == 0 || left.get() > MODULUS / 2 {
                    self.switch_off()?;
                    return Ok(None);
                }
                Some(left.to_us())
            }
        };
        self.set_timeout(left_us)?;
        self.clear_taken()?;
        self.write_raw(&[header::WRITE_SYS_CTRL, 0, ctrl::RXENAB_1])?;
        Ok(Some(left_us.unwrap_or(u32::MAX)))
    }

    /// Switches transmitter and receiver off and forgets what they did.
    pub(crate) fn switch_off(&mut self) -> Result<(), RadioError> {
        self.write_raw(&[header::WRITE_SYS_CTRL, ctrl::TRXOFF])?;
        self.clear_status()
    }

    /// What has happened since the last call, one event at a time. A frame received
    /// counts as long as it is not followed by [`Radio::send`], [`Radio::listen`] or
    /// [`Radio::switch_off`].
    pub(crate) fn poll<'b>(
        &mut self,
        buffer: &'b mut RxBuffer,
    ) -> Result<Option<RadioEvent<'b>>, RadioError> {
        let now = self.status()?;
        // The radio's address filter is off: only a bus that nobody drives
        // reads like this.
        if now & status::AFFREJ != 0 {
            return Err(RadioError::SettingsLost);
        }
        if now & status::TXFRS != 0 {
            let at = self.sent_at()?;
            // A reception may have begun meanwhile: its events stay.
            self.write_raw(&[header::WRITE_SYS_STATUS, status::TRANSMITTED as u8])?;
            return Ok(Some(RadioEvent::Sent { at }));
        }
        let good = now & status::RXFCG != 0;
        if good && self.is_stamped(now)? {
            return self.take_frame(buffer).map(Some);
        }
        const BROKEN: u32 = status::RXPHE | status::RXFCE | status::RXRFSL | status::RXSFDTO;
        let damaged = good || now & BROKEN != 0;
        if damaged || now & status::RXRFTO != 0 {
            self.switch_off()?;
            // Without it, time stamps of later frames can be wrong (4.1.6).
            self.reset_receiver()?;
            return Ok(Some(if damaged {
                RadioEvent::Damaged
            } else {
                RadioEvent::ListenTimeout
            }));
        }
        Ok(None)
    }

    /// Whether the radio still is as it was set up. Reads the interrupt mask,
    /// which is neither all zeros, as after a reset, nor all ones.
    pub(crate) fn check_settings(&mut self) -> Result<(), RadioError> {
        let mask = ll!(self.ll().sys_mask().read())?;
        // A wrong antenna delay would make every range wrong, and nothing else show it.
        let AntennaDelay { tx_ticks, rx_ticks } = self.antenna_delay;
        let rx = ll!(self.ll().lde_rxantd().read())?.value();
        let tx = ll!(self.ll().tx_antd().read())?.value();
        let set = mask.mrxfcg() == 1 && mask.mtxfrs() == 1 && mask.maffrej() == 0;
        if set && (tx, rx) == (tx_ticks, rx_ticks) {
            Ok(())
        } else {
            Err(RadioError::SettingsLost)
        }
    }

    /// The radio's clock now.
    pub(crate) fn now(&mut self) -> Result<DeviceTime, RadioError> {
        let ticks = ll!(self.ll().sys_time().read())?.value();
        Ok(DeviceTime::from_ticks(ticks))
    }

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
    fn frame_information(&mut self) -> Result<[u8; 4], RadioError> {
        let [_, info @ ..] = access::read(&mut self.bus, [header::READ_RX_FINFO, 0, 0, 0, 0])?;
        Ok(info)
    }

    /// RX_FQUAL: STD_NOISE, FP_AMPL2, FP_AMPL3, CIR_PWR.
    fn power_registers(&mut self) -> Result<[u16; 4], RadioError> {
        let [_, a, b, c, d, e, f, g, h] = access::read(
            &mut self.bus,
            [header::READ_RX_FQUAL, 0, 0, 0, 0, 0, 0, 0, 0],
        )?;
        Ok([[a, b], [c, d], [e, f], [g, h]].map(u16::from_le_bytes))
    }

    /// Whether the leading-edge search has given the frame a time stamp.
    fn is_stamped(&mut self, mut now: u32) -> Result<bool, RadioError> {
        for _ in 0..STAMP_TRIES {
            if now & (status::LDEDONE | status::LDEERR) != 0 {
                break;
            }
            now = self.status()?;
        }
        Ok(now & status::LDEDONE != 0 && now & status::LDEERR == 0)
    }

    fn take_frame<'b>(&mut self, buffer: &'b mut RxBuffer) -> Result<RadioEvent<'b>, RadioError> {
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

    /// Whether the delayed transmission just asked for is.
    ///
    /// A start in the past would come true after a wrap, 17 s from now; one with too
    /// little time to power up would go out damaged (7.2.17) or never end (application
    /// note APS022, section 5.4).
    fn is_late(&mut self) -> Result<bool, RadioError> {
        let [register, sub] = header::READ_SYS_STATUS_3;
        let [_, _, low, high] = access::read(&mut self.bus, [register, sub, 0, 0])?;
        let warnings = u16::from_le_bytes([low, high]);
        Ok(warnings & (status::HPDWARN_3 | status::TXPUTE_3) != 0)
    }

    /// Whether the time for the delayed transmission that waits has arrived in the radio
    /// with wrong bits. The frame says when it was sent: it must not leave otherwise.
    fn is_misled(&mut self, start: DeviceTime) -> Result<bool, RadioError> {
        let arrived = self.stamp_once(header::READ_DX_TIME)?;
        if arrived != start {
            self.bus_errors = self.bus_errors.wrapping_add(1);
        }
        Ok(arrived != start)
    }

    /// How often the bus was seen to lose bits since this was asked last.
    pub(crate) fn take_bus_errors(&mut self) -> u32 {
        core::mem::take(&mut self.bus_errors)
    }

    /// The low four bytes of SYS_STATUS.
    fn status(&mut self) -> Result<u32, RadioError> {
        let [_, a, b, c, d] = access::read(&mut self.bus, [header::READ_SYS_STATUS, 0, 0, 0, 0])?;
        Ok(u32::from_le_bytes([a, b, c, d]))
    }

    /// What two readings agree in: nothing else guards it on the bus, and one wrong bit makes
    /// a wrong range.
    fn the_same_twice<T: PartialEq>(
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

    /// The stamp of the frame just sent, which must be the radio's raw one with the antenna
    /// delay that was set. If it is not the bus has lost a bit, now, or when something was
    /// written that landed on the antenna delay: then no stamp is true any more.
    fn sent_at(&mut self) -> Result<DeviceTime, RadioError> {
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

    fn stamp_once(&mut self, register: u8) -> Result<DeviceTime, RadioError> {
        let [_, a, b, c, d, e] = access::read(&mut self.bus, [register, 0, 0, 0, 0, 0])?;
        let ticks = u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]);
        Ok(DeviceTime::from_ticks(ticks))
    }

    /// Sets how long after a frame sent the receiver goes on by itself.
    fn set_listen_after(&mut self, us: u32) -> Result<(), RadioError> {
        let counts = timer_counts(us).min(W4R_TIM_MAX);
        if counts != self.set.listen_after {
            let [a, b, c, d] = counts.to_le_bytes();
            self.write_raw(&[header::WRITE_ACK_RESP_T, a, b, c, d])?;
            self.set.listen_after = counts;
        }
        Ok(())
    }

    /// Sets how long the receiver stays on.
    fn set_timeout(&mut self, us: Option<u32>) -> Result<(), RadioError> {
        if let Some(us) = us {
            // What 0 means is not said (7.2.14). Reply times are bounded so that
            // their time-outs fit.
            let counts = timer_counts(us).clamp(1, 0xFFFF) as u16;
            if counts != self.set.timeout {
                let [low, high] = counts.to_le_bytes();
                self.write_raw(&[header::WRITE_RX_FWTO, low, high])?;
                self.set.timeout = counts;
            }
        }
        if us.is_some() != self.set.timeout_on {
            let timeout = if us.is_some() { phy::RXWTOE } else { 0 };
            let [a, b, c, d] = (self.sys_cfg | timeout).to_le_bytes();
            self.write_raw(&[header::WRITE_SYS_CFG, a, b, c, d])?;
            self.set.timeout_on = us.is_some();
        }
        Ok(())
    }

    /// Forgets the events of a frame that was taken, so that they are not taken for
    /// those of the next.
    fn clear_taken(&mut self) -> Result<(), RadioError> {
        if core::mem::take(&mut self.taken) {
            let [a, b, c, d] = status::RECEIVED.to_le_bytes();
            self.write_raw(&[header::WRITE_SYS_STATUS, a, b, c, d])?;
        }
        Ok(())
    }

    /// Soft reset of the receiver only (7.2.50.1). Reads back whether it took place: a
    /// receiver that goes on without stamps its frames wrong, and nothing shows it.
    fn reset_receiver(&mut self) -> Result<(), RadioError> {
        for reset in [0b1110, 0b1111] {
            ll!(self.ll().pmsc_ctrl0().modify(|_, w| w.softreset(reset)))?;
            if ll!(self.ll().pmsc_ctrl0().read())?.softreset() != reset {
                return Err(RadioError::Bus);
            }
        }
        Ok(())
    }

    /// Clears all events of transmitter and receiver. HPDWARN, TXPUTE and
    /// RXOVRR are read-only and end with their cause (7.2.17).
    pub(crate) fn clear_status(&mut self) -> Result<(), RadioError> {
        self.taken = false;
        let [a, b, c, d] = (status::TRANSMITTED | status::RECEIVED).to_le_bytes();
        self.write_raw(&[header::WRITE_SYS_STATUS, a, b, c, d])
    }

    fn write_tx_buffer(&mut self, frame: &[u8]) -> Result<(), RadioError> {
        let mut bytes: heapless::Vec<u8, { MAX_FRAME_LEN + 1 }> = heapless::Vec::new();
        bytes
            .push(header::WRITE_TX_BUFFER)
            .map_err(|_| RadioError::Bus)?;
        bytes
            .extend_from_slice(frame)
            .map_err(|_| RadioError::Bus)?;
        self.write_raw(&bytes)
    }

    pub(crate) fn write_raw(&mut self, bytes: &[u8]) -> Result<(), RadioError> {
        access::write(&mut self.bus, bytes)
    }

    pub(crate) fn ll(&mut self) -> ll::DW1000<Legacy<'_, B>, NoPin> {
        ll::DW1000::new(Legacy(&mut self.bus), NoPin)
    }
}

/// RXPACC, the highest twelve bits of RX_FINFO (7.2.18).
fn preamble_count([_, _, low, high]: [u8; 4]) -> u16 {
    u16::from_le_bytes([low, high]) >> 4
}

/// Microseconds in the radio's timers' unit of 512/499.2 MHz = 1.0256 us, rounded down.
fn timer_counts(us: u32) -> u32 {
    (u64::from(us) * 39 / 40) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::SpiSpeed;
    use crate::cost::DWM1001;
    use core::convert::Infallible;
    use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
    use nova_ranging::Ticks;
    use nova_ranging::phy::Work;

    /// A radio that always has a frame of `frame_len` bytes, and counts what it costs.
    #[derive(Default)]
    struct Spy {
        frame_len: u8,
        transactions: u32,
        bytes: u32,
        /// The counts when a transmission was started.
        at_start: Option<(u32, u32)>,
        /// DX_TIME.
        start: [u8; 5],
    }

    impl Spy {
        fn take(&mut self) -> (u32, u32) {
            (
                core::mem::take(&mut self.transactions),
                core::mem::take(&mut self.bytes),
            )
        }
    }

    impl ErrorType for Spy {
        type Error = Infallible;
    }

    impl SpiDevice for Spy {
        fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
            self.transactions += 1;
            for operation in operations {
                match operation {
                    Operation::Write(bytes) => {
                        self.bytes += bytes.len() as u32;
                        if bytes.first() == Some(&header::WRITE_SYS_CTRL) {
                            self.at_start = Some((self.transactions, self.bytes));
                        }
                        if let [header::WRITE_DX_TIME, a, b, c, d, e] = **bytes {
                            self.start = [a, b, c, d, e];
                        }
                    }
                    Operation::TransferInPlace(bytes) => {
                        self.bytes += bytes.len() as u32;
                        let status = (status::RXFCG | status::LDEDONE).to_le_bytes();
                        let answer: &[u8] = match bytes.first() {
                            Some(&header::READ_SYS_STATUS) => &status,
                            Some(&header::READ_DX_TIME) => &self.start,
                            Some(&header::READ_RX_FINFO) => &[self.frame_len + FCS_LEN],
                            _ => &[],
                        };
                        bytes.fill(0);
                        for (byte, &value) in bytes.iter_mut().skip(1).zip(answer) {
                            *byte = value;
                        }
                    }
                    _ => unreachable!("no other operation is used"),
                }
            }
            Ok(())
        }
    }

    impl RadioBus for Spy {
        fn set_speed(&mut self, _: SpiSpeed) {}
    }

    struct Nothing;

    impl DelayNs for Nothing {
        fn delay_ns(&mut self, _: u32) {}
    }

    impl embedded_hal::digital::ErrorType for Nothing {
        type Error = Infallible;
    }

    impl OutputPin for Nothing {
        fn set_low(&mut self) -> Result<(), Infallible> {
            Ok(())
        }

        fn set_high(&mut self) -> Result<(), Infallible> {
            Ok(())
        }
    }

    fn cost(work: &Work, frame: u32) -> (u32, u32) {
        (work.transactions, work.bytes + frame)
    }

    /// Reply times are computed from these counts.
    #[test]
    fn frames_cost_the_transactions_and_bytes_of_the_budget() {
        let spy = Spy {
            frame_len: 21,
            ..Spy::default()
        };
        let mut radio = Radio::new(
            spy,
            Nothing,
            Nothing,
            PhyProfile::DEFAULT,
            SetAntennaDelay::default(),
        );
        let mut buffer = EMPTY_RX_BUFFER;
        let event = radio.poll(&mut buffer);
        assert!(matches!(
            event,
            Ok(Some(RadioEvent::Received { bytes, .. })) if bytes.len() == 21
        ));
        assert_eq!(radio.bus.take(), cost(&DWM1001.take, 21));

        let at = When::At(DeviceTime::from_ticks(512));
        assert_eq!(radio.send(&[0; 14], at, Then::Idle), Ok(true));
        assert_eq!(radio.bus.at_start, Some(cost(&DWM1001.answer, 14)));

        // The first time-out of all costs a transaction more.
        assert_eq!(radio.set_timeout(Some(1)), Ok(()));
        assert!(radio.poll(&mut buffer).is_ok());
        radio.bus.take();
        let until = DeviceTime::from_ticks(0).after(Ticks::from_us(500));
        assert_eq!(radio.listen(Some(until)), Ok(Some(500)));
        assert_eq!(radio.bus.take(), cost(&DWM1001.listen, 0));
    }
}
