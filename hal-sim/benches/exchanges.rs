//! Simulated three-frame exchanges per second of wall time, with a driver of the least register traffic.

#![allow(missing_docs)] // criterion's macros
#![allow(clippy::unwrap_used)] // SPI cannot fail on a simulated board

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use embedded_hal::spi::SpiDevice;
use nova_hal_sim::{BoardConfig, BoardHal, Motion, SimConfig, SimTime, Simulation};

const TXSTRT: u8 = 0x02;
const RXENAB: [u8; 2] = [0x00, 0x01];
const TXFRS: u8 = 1 << 7;
const RXDFR_RXFCG_LDEDONE: u8 = 0b0110_0100;

struct Radio {
    hal: BoardHal,
}

impl Radio {
    fn new(hal: BoardHal) -> Self {
        let radio = Radio { hal };
        // Load the LDE microcode, then interrupts for TXFRS and RXDFR.
        radio.write(&[0xB6, 0x01, 0x03]);
        radio.write(&[0xED, 0x06, 0x00, 0x80]);
        radio.hal.sleep_until(1_000);
        radio.write(&[0xB6, 0x00, 0x02]);
        radio.hal.spi_device().set_frequency(8_000_000);
        radio.write(&[0x8E, TXFRS, 0x20, 0, 0]);
        radio.write(&[0x88, 14]);
        radio
    }

    fn write(&self, bytes: &[u8]) {
        self.hal.spi_device().write(bytes).unwrap();
    }

    fn wait_and_clear(&self) -> bool {
        let done = self.hal.wait_irq_until(self.hal.now_us() + 5_000);
        self.write(&[0x8F, TXFRS, RXDFR_RXFCG_LDEDONE | 0x0B, 0, 0]);
        done
    }

    fn send(&self, n: u8) {
        self.write(&[0x89, n, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        self.write(&[0x8D, TXSTRT]);
        self.wait_and_clear();
        let mut stamp = [0x17, 0, 0, 0, 0, 0];
        self.hal.spi_device().transfer_in_place(&mut stamp).unwrap();
    }

    fn receive(&self) {
        self.write(&[0xCD, 0x01, RXENAB[1]]);
        if !self.wait_and_clear() {
            self.write(&[0x8D, 0x40]);
        }
        let mut frame = [0x11; 15];
        self.hal.spi_device().transfer_in_place(&mut frame).unwrap();
        let mut stamp = [0x15; 15];
        self.hal.spi_device().transfer_in_place(&mut stamp).unwrap();
    }
}

fn initiator(hal: BoardHal) {
    let radio = Radio::new(hal);
    radio.hal.sleep_until(2_000);
    for n in 0u64.. {
        radio.send(0);
        radio.receive();
        radio.hal.sleep_until(radio.hal.now_us() + 200);
        radio.send(1);
        radio.hal.sleep_until(2_000 * (n + 2));
    }
}

fn responder(hal: BoardHal) {
    let radio = Radio::new(hal);
    loop {
        radio.receive();
        radio.hal.sleep_until(radio.hal.now_us() + 200);
        radio.send(2);
        radio.receive();
    }
}

fn exchanges(criterion: &mut Criterion) {
    const COUNT: u64 = 1_000;
    let mut group = criterion.benchmark_group("simulation");
    group
        .throughput(Throughput::Elements(COUNT))
        .sample_size(10);
    group.bench_function("three-frame exchanges, two boards", |bencher| {
        bencher.iter(|| {
            let mut sim = Simulation::new(SimConfig::default());
            sim.add_board(BoardConfig::default(), initiator);
            let far = BoardConfig {
                motion: Motion::fixed([10.0, 0.0, 0.0]),
                ..BoardConfig::default()
            };
            sim.add_board(far, responder);
            sim.run_until(SimTime::from_ms(7 + 2 * COUNT)).unwrap();
            let stats = sim.stats();
            assert!(
                stats.boards[1].chip.frames_good.abs_diff(2 * COUNT) <= 4,
                "{stats:?}"
            );
        });
    });
    group.finish();
}

criterion_group!(benches, exchanges);
criterion_main!(benches);
