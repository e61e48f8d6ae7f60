//! A simulated board, running the firmware's node, whose serial port is a TCP server or a pseudo-terminal.
#![allow(dead_code, clippy::unwrap_used)]

use nova_cli::sim_node;
use nova_hal_sim::{BoardConfig, Flash, Motion, SimConfig, SimDuration, Simulation};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The address that the board brings.
pub(crate) const ADDRESS: u16 = 0x0202;

/// From the anchor to the tag, in metres.
pub(crate) const DISTANCE_M: f64 = 5.0;

/// Simulated time a turn; real time passes only while the line is read.
const TURN_MS: u64 = 20;

/// The longest wait for a byte a turn.
const PATIENCE: Duration = Duration::from_millis(2);

/// An anchor with a tag beside it, at the end of a line.
pub(crate) struct Served {
    /// For the command line.
    pub(crate) place: String,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Served {
    /// Behind a TCP port; whoever connects talks to the same board.
    pub(crate) fn tcp(flash: &Flash) -> Self {
        Self::tcp_off(flash, [0.0; 2])
    }

    /// The same with antenna delays, sending and receiving, so many ticks longer than boards take for granted.
    pub(crate) fn tcp_off(flash: &Flash, off_ticks: [f64; 2]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let place = format!("tcp://{}", listener.local_addr().unwrap());
        listener.set_nonblocking(true).unwrap();
        let mut line = None;
        Self::start(place, flash, off_ticks, move |out| {
            if let Ok((stream, _)) = listener.accept() {
                stream.set_nonblocking(false).unwrap();
                stream.set_read_timeout(Some(PATIENCE)).unwrap();
                line = Some(stream);
            }
            match &mut line {
                Some(stream) => exchange(stream, out),
                None => Vec::new(),
            }
        })
    }

    /// Behind a serial port.
    #[cfg(unix)]
    pub(crate) fn terminal(flash: &Flash) -> Self {
        use serialport::SerialPort;
        let (mut board, host) = serialport::TTYPort::pair().unwrap();
        board.set_timeout(PATIENCE).unwrap();
        let place = host.name().unwrap();
        Self::start(place, flash, [0.0; 2], move |out| {
            // Keeps the terminal there while nobody has it open.
            let _host = &host;
            exchange(&mut board, out)
        })
    }

    fn start(
        place: String,
        flash: &Flash,
        [tx_off, rx_off]: [f64; 2],
        mut exchange: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static,
    ) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let (flash, ended) = (flash.clone(), Arc::clone(&end));
        let thread = std::thread::spawn(move || {
            let mut sim = Simulation::new(SimConfig::default());
            let at = |x, flash| BoardConfig {
                motion: Motion::fixed([x, 0.0, 1.0]),
                flash,
                ..BoardConfig::default()
            };
            let tag = NodeConfig::tag(Address(0x0101));
            sim_node::add(&mut sim, at(DISTANCE_M, Flash::new(4)), tag).unwrap();
            let anchor = NodeConfig::anchor(Address(ADDRESS));
            let mut hardware = at(0.0, flash);
            hardware.tx_antenna_delay_ticks += tx_off;
            hardware.rx_antenna_delay_ticks += rx_off;
            let anchor = sim_node::add(&mut sim, hardware, anchor).unwrap();
            while !ended.load(Ordering::Relaxed) {
                sim.run_for(SimDuration::from_ms(TURN_MS)).unwrap();
                let chunks = sim.uart(anchor).into_iter();
                let out: Vec<u8> = chunks.flat_map(|chunk| chunk.bytes).collect();
                sim.uart_send(anchor, &exchange(&out));
            }
        });
        Self {
            place,
            end,
            thread: Some(thread),
        }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic there has told the test already.
            let _ = thread.join();
        }
    }
}

/// Writes `out`, returns what has come. A line that nobody is at loses both.
fn exchange(line: &mut (impl Read + Write), out: &[u8]) -> Vec<u8> {
    let _ = line.write_all(out);
    let mut bytes = [0; 512];
    match line.read(&mut bytes) {
        Ok(count) => bytes[..count].to_vec(),
        Err(error) => {
            assert_ne!(error.kind(), ErrorKind::InvalidInput);
            Vec::new()
        }
    }
}
