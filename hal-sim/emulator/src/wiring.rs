//! What is wired to what on the DWM1001 module and the DWM1001-DEV board (DWM1001 datasheet, table 2; DWM1001-DEV
//! schematic). Pins of port 0.

/// The DW1000's SPICSn: low selects it.
pub const RADIO_SELECT: u8 = 17;
/// The DW1000's RSTn: low resets it; never to be driven high.
pub const RADIO_RESET: u8 = 24;
/// The DW1000's IRQ, high when it wants something.
pub const RADIO_INTERRUPT: u8 = 19;
/// SPICLK.
pub const RADIO_CLOCK: u8 = 16;
/// SPIMOSI.
pub const RADIO_MOSI: u8 = 20;
/// SPIMISO.
pub const RADIO_MISO: u8 = 18;
/// The serial line to the host.
pub const SERIAL_TX: u8 = 5;
/// The serial line from the host.
pub const SERIAL_RX: u8 = 11;
/// The button, low when pressed.
pub const BUTTON: u8 = 2;
/// The lights D9 to D12, lit by a low pin.
pub const LIGHTS: [u8; 4] = [30, 31, 22, 14];

/// Pins that the board drives or pulls: the radio's interrupt, the serial line from the host, the button, and the
/// radio's chip select and reset, which have pull-ups.
pub(crate) const DRIVEN: u32 =
    1 << RADIO_INTERRUPT | 1 << SERIAL_RX | 1 << BUTTON | 1 << RADIO_SELECT | 1 << RADIO_RESET;

/// Those of them that are high while nothing happens.
pub(crate) const IDLE_HIGH: u32 = DRIVEN & !(1 << RADIO_INTERRUPT);
