//! Recorded measurements, which are not part of this repository.

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
