//! The other end of the vendor's single-sided ranging example, for its initiator on an emulated board: answers each
//! poll with the time stamps of the poll and of the answer (frames as in the vendor's `ss_twr_init`).

use nova_emulator::{Peer, PeerRadio};
use nova_hal_sim::SimDuration;

const TX_FCTRL: u8 = 0x08;
const TX_BUFFER: u8 = 0x09;
const DX_TIME: u8 = 0x0A;
const SYS_CTRL: u8 = 0x0D;
const SYS_MASK: u8 = 0x0E;
const SYS_STATUS: u8 = 0x0F;
const RX_FINFO: u8 = 0x10;
const RX_BUFFER: u8 = 0x11;
const RX_TIME: u8 = 0x15;
const TX_ANTD: u8 = 0x18;
const CHAN_CTRL: u8 = 0x1F;
const DRX: u8 = 0x27;
const OTP: u8 = 0x2D;
const LDE: u8 = 0x2E;
const PMSC: u8 = 0x36;

const TXSTRT_DELAYED_THEN_RECEIVE: u8 = 1 << 1 | 1 << 2 | 1 << 7;
const RXENAB: [u8; 4] = [0, 1, 0, 0];
const RXFCG: u32 = 1 << 14;
/// RXPHE, RXFCE, RXRFSL, LDEERR, RXSFDTO.
const TROUBLE: u32 = 1 << 12 | 1 << 15 | 1 << 16 | 1 << 18 | 1 << 26;

/// Channel 5, PRF 64 MHz, code 10.
const CHANNEL: u32 = 5 | 5 << 4 | 2 << 18 | 10 << 22 | 10 << 27;
/// 6.8 Mbit/s, PRF 64 MHz, 128 symbols, ranging; the length is in the low bits.
const FRAME: u32 = 2 << 13 | 1 << 15 | 2 << 16 | 0b0101 << 18;
/// A PAC of 8 symbols at PRF 64 MHz (User Manual, table 33).
const PAC_8: u32 = 0x313B_006B;

/// What the simulated antennas have.
const ANTENNA_DELAY: u16 = 16_456;
/// From a poll to its answer: 2050 units of 512/499.2 us. The older of the vendor's initiators listens for 300 of them,
/// 1800 after its poll; the newer ones for much longer.
const REPLY_TICKS: u64 = 2_050 << 16;

const POLL: [u8; 10] = [0x41, 0x88, 0, 0xCA, 0xDE, b'W', b'A', b'V', b'E', 0xE0];
const ANSWER: [u8; 10] = [0x41, 0x88, 0, 0xCA, 0xDE, b'V', b'E', b'W', b'A', 0xE1];
/// In both: the sequence number.
const SEQUENCE: usize = 2;

/// Answers polls.
#[derive(Debug, Default)]
pub struct VendorResponder {
    state: State,
}

#[derive(Debug, Default)]
enum State {
    #[default]
    Cold,
    Loading,
    Ready {
        sequence: u8,
    },
}

impl Peer for VendorResponder {
    fn serve(&mut self, radio: &mut PeerRadio<'_>) -> Option<SimDuration> {
        match &mut self.state {
            State::Cold => {
                // The microcode that finds leading edges (User Manual 2.5.5.10).
                radio.write(PMSC, 0, &[0x01, 0x03]);
                radio.write(OTP, 0x06, &[0x00, 0x80]);
                self.state = State::Loading;
                Some(SimDuration::from_us(200))
            }
            State::Loading => {
                radio.write(PMSC, 0, &[0x00, 0x02]);
                radio.write(CHAN_CTRL, 0, &CHANNEL.to_le_bytes());
                radio.write(DRX, 0x08, &PAC_8.to_le_bytes());
                radio.write(TX_ANTD, 0, &ANTENNA_DELAY.to_le_bytes());
                radio.write(LDE, 0x1804, &ANTENNA_DELAY.to_le_bytes());
                radio.write(SYS_MASK, 0, &(RXFCG | TROUBLE).to_le_bytes());
                radio.write(SYS_CTRL, 0, &RXENAB);
                self.state = State::Ready { sequence: 0 };
                None
            }
            State::Ready { sequence } => {
                if !answer(radio, *sequence) {
                    radio.write(PMSC, 3, &[0xE0]);
                    radio.write(PMSC, 3, &[0xF0]);
                    radio.write(SYS_CTRL, 0, &RXENAB);
                }
                *sequence = sequence.wrapping_add(1);
                None
            }
        }
    }
}

/// Sends an answer if there is a poll.
fn answer(radio: &mut PeerRadio<'_>, sequence: u8) -> bool {
    let status = number(&radio.read(SYS_STATUS, 0, 4)) as u32;
    let length = number(&radio.read(RX_FINFO, 0, 2)) as usize & 0x7F;
    let mut poll = radio.read(RX_BUFFER, 0, length.min(POLL.len()));
    let received = number(&radio.read(RX_TIME, 0, 5));
    radio.write(SYS_STATUS, 0, &status.to_le_bytes());
    if let Some(place) = poll.get_mut(SEQUENCE) {
        *place = 0;
    }
    if status & RXFCG == 0 || poll != POLL {
        return false;
    }
    // The radio rounds down to 512 ticks, and then adds the antenna delay.
    let sends = (received + REPLY_TICKS) & 0xFF_FFFF_FE00;
    let sent = sends + u64::from(ANTENNA_DELAY);
    let mut frame = ANSWER.to_vec();
    if let Some(place) = frame.get_mut(SEQUENCE) {
        *place = sequence;
    }
    frame.extend((received as u32).to_le_bytes());
    frame.extend((sent as u32).to_le_bytes());
    radio.write(TX_BUFFER, 0, &frame);
    let control = FRAME | (frame.len() as u32 + 2);
    radio.write(TX_FCTRL, 0, &control.to_le_bytes());
    radio.write(DX_TIME, 0, &sends.to_le_bytes()[..5]);
    radio.write(SYS_CTRL, 0, &[TXSTRT_DELAYED_THEN_RECEIVE]);
    true
}

/// Least significant byte first.
fn number(bytes: &[u8]) -> u64 {
    let bytes = bytes.iter().rev();
    bytes.fold(0, |number, &byte| number << 8 | u64::from(byte))
}
