//! How fast a stream of range records is decoded, beside the bare CRC-32 of
//! the same bytes, which no decoder can beat.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nova_wire::{
    Decoder, Encoder, Filtered, MAX_FRAME_LEN, Quality, Range, RangeFlags, Record, Treatment,
};
use std::hint::black_box;

fn stream() -> Vec<u8> {
    let mut encoder = Encoder::new();
    let mut bytes = Vec::new();
    for k in 0..10_000u32 {
        let record = Record::Range(Range {
            t_us: u64::from(k) * 3_333,
            peer: 0xBEEF,
            exchange: k as u8,
            raw_m: k as f32 * 0.01,
            bias_m: -0.0625,
            treatment: Treatment::Accepted,
            filtered: Some(Filtered {
                range_m: k as f32 * 0.01,
                rate_m_per_s: 0.25,
                variance_m2: 0.001,
            }),
            clock_offset_ppm: 3.5,
            quality: Some(Quality {
                rx_power_dbm: -81.5,
                first_path_power_dbm: -83.25,
                noise: 44,
                preamble_count: 121,
                peak_delay_ns: 1.5,
                carrier_offset_ppm: 3.25,
                nlos_percent: Some(7),
            }),
            flags: RangeFlags::INITIATOR,
        });
        bytes.extend_from_slice(encoder.encode(&record, &mut [0; MAX_FRAME_LEN]).unwrap());
    }
    bytes
}

fn decode(c: &mut Criterion) {
    let bytes = stream();
    let mut group = c.benchmark_group("10000 range records");
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    group.bench_function("decode", |b| {
        b.iter(|| {
            let mut decoder = Decoder::new();
            for &byte in black_box(&bytes) {
                black_box(decoder.push(byte));
            }
            assert_eq!(decoder.statistics().records, 10_000);
        });
    });
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    group.bench_function("crc-32 alone", |b| {
        b.iter(|| crc.checksum(black_box(&bytes)))
    });
    group.finish();
}

criterion_group!(benches, decode);
criterion_main!(benches);
