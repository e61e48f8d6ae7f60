//! Firmware of an anchor: ranges with the tags it finds.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[embassy_executor::main]
async fn main(spawner: embassy_executor::Spawner) {
    nova_dwm1001::run(spawner, nova_dwm1001::Role::Anchor).await
}

/// On the host there is nothing to run: `cargo xtask firmware` builds this for the board.
#[cfg(not(target_os = "none"))]
fn main() {}
