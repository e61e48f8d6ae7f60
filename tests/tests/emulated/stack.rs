//! A stack that grows out of RAM.

use super::pair;
use libtest_mimic::Failed;
use nova_emulator::{Image, ResetReason};
use nova_tests::{FIRMWARE_VARIABLE, Firmware};
use object::Endianness;
use object::read::elf::{ElfFile32, ProgramHeader as _};
use std::path::Path;

/// Where RAM begins, and where flip-link puts the end of the stack.
const RAM_START: u32 = 0x2000_0000;

/// The tag's ELF with the stack pointer starting so many bytes above the beginning of RAM.
fn tag_with_stack_of(bytes: u32) -> Result<Image, Failed> {
    let folder = std::env::var(FIRMWARE_VARIABLE)?;
    let mut elf = std::fs::read(Path::new(&folder).join("tag"))?;
    let file = ElfFile32::<Endianness>::parse(&*elf)?;
    let endian = file.endian();
    let vectors = file
        .elf_program_headers()
        .iter()
        .find(|header| header.p_paddr(endian) == 0 && header.p_filesz(endian) > 0)
        .ok_or("no vector table")?;
    let at = vectors.p_offset(endian) as usize;
    let pointer = elf.get_mut(at..at + 4).ok_or("the file is cut off")?;
    pointer.copy_from_slice(&(RAM_START + bytes).to_le_bytes());
    Ok(Image::parse(&elf)?)
}

pub(super) fn overflow_resets(firmware: &Firmware) -> Result<(), Failed> {
    // In the start-up code, while it sets up its radio, and while it ranges: it needs some 7000.
    for bytes in [64, 1024, 4096, 6144] {
        let firmware = Firmware {
            tag: tag_with_stack_of(bytes)?,
            ..firmware.clone()
        };
        let mut network = pair(10.0, 0.0, 9, &firmware);
        network.run_until_s(1.0)?;
        let resets = network.stats("tag").ok_or("no tag")?.resets;
        let overflows = resets
            .iter()
            .filter(|&&(_, why)| why == ResetReason::Lockup)
            .count();
        println!("{bytes} bytes: {overflows} overflows in a second");
        if overflows == 0 {
            return Err(format!("{bytes} bytes of stack were enough: {resets:?}").into());
        }
    }
    Ok(())
}
