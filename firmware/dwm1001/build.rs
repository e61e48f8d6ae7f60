//! Tells the linker where memory.x is: in the workspace root, found from here
//! so that a build from any directory works.

use std::env;
use std::path::Path;

fn main() {
    let Some(root) = env::var_os("CARGO_MANIFEST_DIR")
        .and_then(|dir| Path::new(&dir).ancestors().nth(2).map(Path::to_path_buf))
    else {
        println!("cargo::error=cannot tell where the workspace root is");
        return;
    };
    println!("cargo::rustc-link-search={}", root.display());
    println!(
        "cargo::rerun-if-changed={}",
        root.join("memory.x").display()
    );
    println!("cargo::rerun-if-changed=build.rs");
}
