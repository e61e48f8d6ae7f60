//! Firmware images: ELF files as linkers write them, with what their symbols tell, and Intel HEX files.

use std::collections::BTreeMap;
use std::sync::Arc;

use defmt_decoder::Table;
use object::read::elf::{ElfFile32, ProgramHeader as _};
use object::{Endianness, Object as _, ObjectSection as _, ObjectSymbol as _, SectionKind, elf};

use crate::error::EmulatorError;
use crate::soc::{RAM_BYTES, RAM_START};

/// What is loaded onto a board.
#[derive(Clone)]
pub struct Image(Arc<Contents>);

struct Contents {
    /// Bytes and where they go.
    segments: Vec<(u32, Vec<u8>)>,
    symbols: BTreeMap<String, u32>,
    stack: Option<StackRegion>,
    log: Option<Table>,
}

/// Where a stack may grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StackRegion {
    /// The lowest address that belongs to it.
    pub bottom: u32,
    /// One past the highest: where the stack pointer starts.
    pub top: u32,
}

impl Image {
    /// Reads an ELF file, or an Intel HEX file, which has no symbols.
    ///
    /// # Errors
    /// [`EmulatorError::Image`] if it is neither, is not for a 32-bit little-endian ARM, or has nothing to load.
    pub fn parse(bytes: &[u8]) -> Result<Self, EmulatorError> {
        if bytes.first() == Some(&b':') {
            return Self::parse_hex(bytes);
        }
        let wrong = |what: String| EmulatorError::Image(what);
        let file = ElfFile32::<Endianness>::parse(bytes).map_err(|e| wrong(e.to_string()))?;
        if file.architecture() != object::Architecture::Arm || !file.is_little_endian() {
            return Err(wrong("it is not for a little-endian ARM".to_owned()));
        }
        let endian = file.endian();
        let mut segments = Vec::new();
        for header in file.elf_program_headers() {
            if header.p_type(endian) == elf::PT_LOAD && header.p_filesz(endian) > 0 {
                let data = header
                    .data(endian, bytes)
                    .map_err(|()| wrong("a segment lies outside of the file".to_owned()))?;
                segments.push((header.p_paddr(endian), data.to_vec()));
            }
        }
        if segments.is_empty() {
            return Err(wrong("it has nothing to load".to_owned()));
        }
        let symbols = file.symbols().filter_map(|symbol| {
            let name = symbol.name().ok().filter(|name| !name.is_empty())?;
            Some((name.to_owned(), symbol.address() as u32))
        });
        let symbols = symbols.collect();
        let stack = initial_stack_pointer(&segments).and_then(|top| stack_below(top, &file));
        // Firmware without defmt has no table; one that cannot be read is as good as none.
        let log = Table::parse(bytes).ok().flatten();
        Ok(Image(Arc::new(Contents {
            segments,
            symbols,
            stack,
            log,
        })))
    }

    fn parse_hex(bytes: &[u8]) -> Result<Self, EmulatorError> {
        let wrong = |what: String| EmulatorError::Image(what);
        let text = std::str::from_utf8(bytes).map_err(|error| wrong(error.to_string()))?;
        let mut base = 0;
        let mut segments: Vec<(u32, Vec<u8>)> = Vec::new();
        for (record, line) in ihex::Reader::new(text).zip(1..) {
            match record.map_err(|error| wrong(format!("record {line}: {error}")))? {
                ihex::Record::Data { offset, value } => {
                    let address = base + u32::from(offset);
                    match segments.last_mut() {
                        Some((start, bytes)) if *start + bytes.len() as u32 == address => {
                            bytes.extend(value);
                        }
                        _ => segments.push((address, value)),
                    }
                }
                ihex::Record::ExtendedLinearAddress(high) => base = u32::from(high) << 16,
                ihex::Record::ExtendedSegmentAddress(paragraph) => base = u32::from(paragraph) << 4,
                _ => {}
            }
        }
        if segments.is_empty() {
            return Err(wrong("it has nothing to load".to_owned()));
        }
        Ok(Self::from_segments(segments))
    }

    /// Bytes and where they go: an image without symbols.
    pub fn from_segments(segments: Vec<(u32, Vec<u8>)>) -> Self {
        Image(Arc::new(Contents {
            segments,
            symbols: BTreeMap::new(),
            stack: None,
            log: None,
        }))
    }

    pub(crate) fn segments(&self) -> &[(u32, Vec<u8>)] {
        &self.0.segments
    }

    /// The address of a symbol.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.0.symbols.get(name).copied()
    }

    /// The main stack.
    pub fn stack(&self) -> Option<StackRegion> {
        self.0.stack
    }

    pub(crate) fn log_table(&self) -> Option<&Table> {
        self.0.log.as_ref()
    }
}

/// The first word of the vector table.
fn initial_stack_pointer(segments: &[(u32, Vec<u8>)]) -> Option<u32> {
    let (_, bytes) = segments.iter().find(|(address, _)| *address == 0)?;
    let word = bytes.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*word))
}

/// The stack has all of RAM below `top` down to the next variable.
fn stack_below(top: u32, file: &ElfFile32<'_>) -> Option<StackRegion> {
    if !(RAM_START..=RAM_START + RAM_BYTES).contains(&top) {
        return None;
    }
    let is_variables = |name: &str| !(name.contains("stack") || name.contains("heap"));
    let variables = file.sections().filter(|section| {
        let allocated = matches!(
            section.kind(),
            SectionKind::Data | SectionKind::UninitializedData
        );
        allocated && section.size() > 0 && section.name().is_ok_and(is_variables)
    });
    let ends = variables.map(|section| (section.address() + section.size()) as u32);
    let bottom = ends
        .filter(|end| (RAM_START..=top).contains(end))
        .max()
        .unwrap_or(RAM_START);
    Some(StackRegion { bottom, top })
}
