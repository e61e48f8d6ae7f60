//! GDB's remote protocol, spoken by a script, against a board that runs a few instructions.

#![allow(clippy::unwrap_used)] // a test's own connection

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;

use nova_emulator::gdb::{Ended, serve};
use nova_emulator::{BoardConfig, BoardStats, Emulation, EmulatorError, Image};
use nova_hal_sim::{ChannelConfig, SimTime};

/// Counts in R0, stores it in RAM, and calls a function that returns at once.
const PROGRAM: [u16; 8] = [
    0x3001, // 0x200: ADDS r0, #1
    0x6008, // 0x202: STR r0, [r1]
    0xF000, 0xF801, // 0x204: BL 0x20A
    0xE7FA, // 0x208: B 0x200
    0x4770, // 0x20A: BX lr
    0xDE00, // 0x20C: UDF
    0xBF00,
];
const ENTRY: u32 = 0x200;
const FUNCTION: u32 = 0x20A;
const RAM: u32 = 0x2000_0000;

fn image() -> Image {
    let mut code = vec![0; 0x400];
    // R1 is 0 after a reset: LDR r1 comes first, at 0x210, from the word at 0x218.
    code[..8].copy_from_slice(&[0x00, 0x10, 0x00, 0x20, 0x11, 0x02, 0x00, 0x00]);
    for (place, halfword) in code[0x200..].chunks_exact_mut(2).zip(PROGRAM) {
        place.copy_from_slice(&halfword.to_le_bytes());
    }
    code[0x210..0x214].copy_from_slice(&[0x01, 0x49, 0xF5, 0xE7]); // LDR r1, [pc, #4]; B 0x200
    code[0x218..0x21C].copy_from_slice(&RAM.to_le_bytes());
    Image::from_segments(vec![(0, code)])
}

fn emulation() -> Emulation {
    let boards = ["a", "b"].map(|name| (BoardConfig::new(name, [1, 2]), image()));
    Emulation::new(1, ChannelConfig::default(), boards.into()).unwrap()
}

struct Gdb {
    stream: TcpStream,
    server: JoinHandle<(Result<Ended, EmulatorError>, BoardStats)>,
}

impl Gdb {
    fn connect(end: SimTime) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = std::thread::spawn(move || {
            let (stream, _) = listener.accept().unwrap();
            let mut emulation = emulation();
            let ended = serve(&mut emulation, "b", stream, end, &mut |_| {});
            if ended == Ok(Ended::Detached) {
                emulation.run_until(end).unwrap();
            }
            (ended, emulation.board("b").unwrap().stats())
        });
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        Gdb { stream, server }
    }

    fn byte(&mut self) -> u8 {
        let mut byte = [0];
        self.stream.read_exact(&mut byte).unwrap();
        byte[0]
    }

    /// A packet's contents, acknowledged.
    fn receive(&mut self) -> String {
        while self.byte() != b'$' {}
        let mut text = String::new();
        loop {
            match self.byte() {
                b'#' => break,
                // The next byte stands for itself, but for a bit.
                b'}' => text.push((self.byte() ^ 0x20).into()),
                // Run-length encoding: so many more of the last.
                b'*' => {
                    let count = self.byte() - 29;
                    let last = text.chars().last().unwrap();
                    text.extend(std::iter::repeat_n(last, count.into()));
                }
                byte => text.push(byte.into()),
            }
        }
        let _checksum = [self.byte(), self.byte()];
        self.stream.write_all(b"+").unwrap();
        text
    }

    fn send(&mut self, text: &str) {
        let sum = text.bytes().fold(0, u8::wrapping_add);
        let packet = format!("${text}#{sum:02x}");
        self.stream.write_all(packet.as_bytes()).unwrap();
    }

    fn ask(&mut self, text: &str) -> String {
        self.send(text);
        self.receive()
    }

    /// Register `n`, of 32 bits.
    fn register(&mut self, n: usize) -> u32 {
        let all = self.ask("g");
        u32::from_str_radix(&all[8 * n..8 * n + 8], 16)
            .unwrap()
            .swap_bytes()
    }

    fn end(self) -> (Result<Ended, EmulatorError>, BoardStats) {
        drop(self.stream);
        self.server.join().unwrap()
    }
}

const PC: usize = 15;

#[test]
fn breakpoints_steps_registers_and_memory_are_served() {
    let mut gdb = Gdb::connect(SimTime::from_ms(100));
    assert!(
        gdb.ask("qSupported:swbreak+;hwbreak+")
            .contains("PacketSize")
    );
    let description = gdb.ask("qXfer:features:read:target.xml:0,1000");
    assert!(
        description.contains("org.gnu.gdb.arm.m-profile"),
        "{description}"
    );
    assert!(gdb.ask("?").starts_with(['S', 'T']));

    assert_eq!(gdb.ask(&format!("Z1,{FUNCTION:x},2")), "OK");
    assert!(gdb.ask("c").starts_with("T05"), "a trap");
    assert_eq!([gdb.register(PC), gdb.register(0)], [FUNCTION, 1]);
    assert_eq!(gdb.ask(&format!("m{RAM:x},4")), "01000000");
    assert_eq!(
        gdb.ask(&format!("m{ENTRY:x},2")),
        "0130",
        "flash: ADDS r0, #1"
    );

    // Over the breakpoint: BX lr.
    assert!(gdb.ask("s").starts_with("S05"));
    assert_eq!(gdb.register(PC), 0x208);
    assert!(gdb.ask("s").starts_with("S05"));
    assert_eq!(gdb.register(PC), ENTRY);

    assert!(gdb.ask("c").starts_with("T05"));
    assert_eq!(gdb.register(0), 2);

    // R0 becomes 0x10; all others stay.
    let all = gdb.ask("g");
    assert_eq!(gdb.ask(&format!("G10000000{}", &all[8..])), "OK");
    assert!(gdb.ask("c").starts_with("T05"));
    assert_eq!(gdb.register(0), 0x11);

    assert_eq!(gdb.ask(&format!("M{RAM:x},2:beef")), "OK");
    assert_eq!(gdb.ask(&format!("m{RAM:x},4")), "beef0000");
    assert!(
        gdb.ask(&format!("M{ENTRY:x},2:0000")).starts_with('E'),
        "flash is not written"
    );
    assert!(
        gdb.ask("m50000000,4").starts_with('E'),
        "registers of peripherals are left alone"
    );

    assert_eq!(gdb.ask(&format!("z1,{FUNCTION:x},2")), "OK");
    assert_eq!(gdb.ask("D"), "OK");
    let (ended, stats) = gdb.end();
    assert_eq!(ended, Ok(Ended::Detached));
    assert!(stats.instructions > 1_000_000, "it runs on: {stats:?}");
}

#[test]
fn a_running_board_is_interrupted() {
    let mut gdb = Gdb::connect(SimTime::from_ms(3_600_000));
    gdb.send("c");
    gdb.stream.write_all(&[0x03]).unwrap();
    assert!(gdb.receive().starts_with("S02"), "SIGINT");
    let before = gdb.register(0);
    assert_eq!(
        gdb.register(0),
        before,
        "no time passes while it stands still"
    );
    gdb.send("k");
    assert_eq!(gdb.end().0, Ok(Ended::Killed));
}

#[test]
fn the_end_of_the_emulated_time_is_reported() {
    let mut gdb = Gdb::connect(SimTime::from_ms(10));
    assert_eq!(gdb.ask("c"), "W00");
    assert_eq!(gdb.end().0, Ok(Ended::TimeIsUp));
}

#[test]
fn a_debugger_changes_nothing() {
    let end = SimTime::from_ms(20);
    let mut alone = emulation();
    alone.run_until(end).unwrap();
    let mut gdb = Gdb::connect(end);
    assert_eq!(gdb.ask(&format!("Z0,{FUNCTION:x},2")), "OK");
    for _ in 0..50 {
        assert!(gdb.ask("c").starts_with("T05"));
        gdb.ask("s");
    }
    assert_eq!(gdb.ask(&format!("z0,{FUNCTION:x},2")), "OK");
    assert_eq!(gdb.ask("D"), "OK");
    assert_eq!(gdb.end().1, alone.board("b").unwrap().stats());
}

#[test]
fn what_is_not_modelled_stops_the_board_where_gdb_can_look_at_it() {
    let mut gdb = Gdb::connect(SimTime::from_ms(1_000));
    // The program's STR goes to a register of the ADC, which is not modelled.
    assert_eq!(gdb.ask(&format!("Z1,{ENTRY:x},2")), "OK");
    assert!(gdb.ask("c").starts_with("T05"));
    let all = gdb.ask("g");
    let change = format!("G{}00750040{}", &all[..8], &all[16..]);
    assert_eq!(gdb.ask(&change), "OK");
    assert_eq!(gdb.ask(&format!("z1,{ENTRY:x},2")), "OK");
    assert!(gdb.ask("c").starts_with("S04"), "SIGILL");
    assert_eq!(gdb.register(0), 1);
    gdb.send("c");
    let (ended, _) = gdb.end();
    let told = ended.unwrap_err().to_string();
    assert!(
        told.contains("SAADC") && told.contains("not modelled"),
        "{told}"
    );
}
