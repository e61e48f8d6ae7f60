use super::*;
use crate::bus::SpiSpeed;
use crate::cost::DWM1001;
use core::convert::Infallible;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use nova_ranging::phy::Work;
use nova_ranging::{Then, Ticks, When};

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
