//! Delays, in the processor's true time.

use embedded_hal::delay::DelayNs;
use embedded_hal_02::blocking::delay::{DelayMs, DelayUs};

use super::core::Port;
use crate::time::SimDuration;

/// Blocking delays: embedded-hal 0.2 `DelayMs` and `DelayUs` for u8, u16 and u32, 1.0 [`DelayNs`].
#[derive(Clone)]
pub struct Delay(pub(super) Port);

macro_rules! delays {
    ($($unsigned:ty),*) => {$(
        impl DelayMs<$unsigned> for Delay {
            fn delay_ms(&mut self, ms: $unsigned) {
                self.0.pass(SimDuration::from_ms(u64::from(ms)));
            }
        }

        impl DelayUs<$unsigned> for Delay {
            fn delay_us(&mut self, us: $unsigned) {
                self.0.pass(SimDuration::from_us(u64::from(us)));
            }
        }
    )*};
}

delays!(u8, u16, u32);

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        self.0.pass(SimDuration::from_ns(u64::from(ns)));
    }
}
