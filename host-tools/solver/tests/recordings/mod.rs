//! Recorded measurements, which are not part of this repository.

#![allow(dead_code)] // compiled into each test that declares it, and none uses all of it
#![allow(clippy::unwrap_used)] // a recording that cannot be read fails the test

pub(crate) mod drive;

use std::path::{Path, PathBuf};

/// A file in the folder that `NOVA_DATA` names, or in `../shared/data` beside the workspace. Says so when it is
/// not there.
pub(crate) fn data(file: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("NOVA_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(file);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {file} is not in {}", folder.display());
    None
}

/// Columns of a CSV file by their names, row by row; NaN where a field holds no number.
pub(crate) fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Vec<[f64; N]> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headers = reader.headers().unwrap().clone();
    let places = names.map(|name| headers.iter().position(|h| h == name).unwrap());
    reader
        .records()
        .map(|record| {
            let record = record.unwrap();
            places.map(|place| record[place].parse().unwrap_or(f64::NAN))
        })
        .collect()
}
