//! How much of the board a binary takes.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::{Context, Result};
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SymbolKind, elf};
use serde_json::{Value, json};

/// The most a binary may take, in bytes. The chip has 512 KiB and 64 KiB: what is left is for what is
/// still to come, a second image for updates, and the stack.
pub(crate) const BUDGET: Budget = Budget {
    text: 96_000,
    ram: 24_000,
};

/// Upper limits in bytes.
pub(crate) struct Budget {
    /// Code and constants.
    pub(crate) text: u64,
    /// Variables; without the stack.
    pub(crate) ram: u64,
}

/// What one binary takes, in bytes, as `size` counts it.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Code, constants and vectors: flash only.
    text: u64,
    /// Variables with a first value: flash and RAM.
    data: u64,
    /// Variables that start as zero or unset: RAM only.
    bss: u64,
}

impl Sizes {
    fn ram(&self) -> u64 {
        self.data + self.bss
    }

    /// What exceeds `budget`, in words.
    pub(crate) fn excesses(&self, budget: &Budget) -> Vec<String> {
        let parts = [
            ("text", self.text, budget.text),
            ("RAM", self.ram(), budget.ram),
        ];
        let over = parts.into_iter().filter(|(_, size, limit)| size >= limit);
        over.map(|(name, size, limit)| {
            format!("{name} takes {size} bytes, the budget is below {limit}")
        })
        .collect()
    }
}

/// A function or variable.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Symbol {
    size: u64,
    /// "text", "data" or "bss".
    section: &'static str,
    name: String,
}

/// One binary's figures.
pub(crate) struct Report {
    /// The binary's name.
    pub(crate) binary: String,
    pub(crate) sizes: Sizes,
    /// The largest first.
    pub(crate) symbols: Vec<Symbol>,
}

impl Report {
    /// Measures the ELF file `bytes` and lists its `count` largest symbols.
    ///
    /// # Errors
    /// When `bytes` are not an ELF file.
    pub(crate) fn measure(binary: &str, bytes: &[u8], count: usize) -> Result<Self> {
        let file =
            object::File::parse(bytes).with_context(|| format!("{binary} is not an ELF file"))?;
        let mut sizes = Sizes::default();
        for section in file.sections() {
            match place(&section) {
                Some("text") => sizes.text += section.size(),
                Some("data") => sizes.data += section.size(),
                Some("bss") => sizes.bss += section.size(),
                _ => {}
            }
        }
        Ok(Self {
            binary: binary.to_owned(),
            sizes,
            symbols: largest_symbols(&file, count),
        })
    }

    /// For scripts.
    pub(crate) fn to_json(&self) -> Value {
        let symbols = self.symbols.iter().map(|symbol| {
            json!({ "name": symbol.name, "section": symbol.section, "bytes": symbol.size })
        });
        json!({
            "binary": self.binary,
            "text_bytes": self.sizes.text,
            "data_bytes": self.sizes.data,
            "bss_bytes": self.sizes.bss,
            "ram_bytes": self.sizes.ram(),
            "budget": { "text_bytes": BUDGET.text, "ram_bytes": BUDGET.ram },
            "largest_symbols": symbols.collect::<Vec<_>>(),
        })
    }
}

/// Where a section lies on the board; `None` for what stays on the host (log strings, debug information).
fn place<'d>(section: &impl ObjectSection<'d>) -> Option<&'static str> {
    let SectionFlags::Elf { sh_flags } = section.flags() else {
        return None;
    };
    let has = |flag: u32| sh_flags & u64::from(flag) != 0;
    if !has(elf::SHF_ALLOC) {
        None
    } else if !has(elf::SHF_WRITE) {
        Some("text")
    } else if section.kind().is_bss() {
        Some("bss")
    } else {
        Some("data")
    }
}

/// One symbol an address: LTO and generics leave several names for the same code.
fn largest_symbols(file: &object::File<'_>, count: usize) -> Vec<Symbol> {
    let mut by_address = BTreeMap::new();
    for symbol in file.symbols() {
        if !matches!(symbol.kind(), SymbolKind::Text | SymbolKind::Data) || symbol.size() == 0 {
            continue;
        }
        let section = symbol
            .section_index()
            .and_then(|index| file.section_by_index(index).ok());
        let (Some(section), Ok(name)) = (section.as_ref().and_then(place), symbol.name()) else {
            continue;
        };
        let name = format!("{:#}", rustc_demangle::demangle(name));
        by_address.insert(
            symbol.address(),
            Symbol {
                size: symbol.size(),
                section,
                name,
            },
        );
    }
    let mut symbols: Vec<_> = by_address.into_values().collect();
    symbols.sort_by(|a, b| b.size.cmp(&a.size).then_with(|| a.name.cmp(&b.name)));
    symbols.truncate(count);
    symbols
}

/// Sizes of all binaries against the budget, then the largest symbols of each.
pub(crate) fn table(reports: &[Report], budget: &Budget) -> String {
    let mut out = String::new();
    let width = reports
        .iter()
        .map(|report| report.binary.len())
        .max()
        .unwrap_or(0)
        .max("budget".len());
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "{:width$}  {:>8} {:>8} {:>8} {:>8}",
        "bytes", "text", "data", "bss", "RAM"
    );
    for Report { binary, sizes, .. } in reports {
        let Sizes { text, data, bss } = sizes;
        let _ = writeln!(
            out,
            "{binary:width$}  {text:>8} {data:>8} {bss:>8} {:>8}",
            sizes.ram()
        );
    }
    let _ = writeln!(
        out,
        "{:width$}  {:>8} {:>8} {:>8} {:>8}",
        "budget", budget.text, "", "", budget.ram
    );
    for report in reports.iter().filter(|report| !report.symbols.is_empty()) {
        let _ = writeln!(out, "\nlargest symbols of {}:", report.binary);
        for symbol in &report.symbols {
            let _ = writeln!(
                out,
                "{:>8}  {:<4}  {}",
                symbol.size,
                symbol.section,
                shortened(&symbol.name)
            );
        }
    }
    out
}

/// Generic names run over hundreds of characters; the first ones tell which it is.
fn shortened(name: &str) -> String {
    const LONGEST: usize = 100;
    if name.chars().count() <= LONGEST {
        return name.to_owned();
    }
    let start: String = name.chars().take(LONGEST - 1).collect();
    format!("{start}…")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(text: u64, data: u64, bss: u64) -> Report {
        let symbols = vec![Symbol {
            size: 1234,
            section: "text",
            name: "main::run".into(),
        }];
        Report {
            binary: "tag".into(),
            sizes: Sizes { text, data, bss },
            symbols,
        }
    }

    #[test]
    fn ram_counts_data_and_bss_but_not_text() {
        assert_eq!(report(1_000, 20, 300).sizes.ram(), 320);
    }

    #[test]
    fn each_budget_is_checked_and_reaching_it_is_too_much() {
        let budget = Budget {
            text: 1_000,
            ram: 300,
        };
        assert!(report(999, 100, 199).sizes.excesses(&budget).is_empty());
        assert_eq!(
            report(1_000, 0, 0).sizes.excesses(&budget),
            ["text takes 1000 bytes, the budget is below 1000"]
        );
        assert_eq!(
            report(0, 150, 151).sizes.excesses(&budget),
            ["RAM takes 301 bytes, the budget is below 300"]
        );
        assert_eq!(report(2_000, 0, 400).sizes.excesses(&budget).len(), 2);
    }

    #[test]
    fn the_table_lines_up() {
        let shown = table(&[report(40_500, 80, 6_568)], &BUDGET);
        let expected = "\
bytes       text     data      bss      RAM
tag        40500       80     6568     6648
budget     96000                      24000

largest symbols of tag:
    1234  text  main::run
";
        assert_eq!(shown, expected);
    }

    #[test]
    fn long_names_are_cut_between_characters() {
        assert_eq!(shortened("short"), "short");
        assert_eq!(shortened(&"é".repeat(200)).chars().count(), 100);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_parts_of_a_real_binary_are_told_apart() {
        // This test's own program: a variable of each kind, of a size that nothing else has.
        #[used]
        static CONSTANT: [u8; 7_003] = [1; 7_003];
        #[used]
        #[allow(unsafe_code)]
        static mut VARIABLE: [u8; 7_005] = [1; 7_005];
        #[used]
        #[allow(unsafe_code)]
        static mut ZERO: [u8; 7_007] = [0; 7_007];

        let bytes = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let report = Report::measure("test", &bytes, usize::MAX).unwrap();
        let section_of = |name: &str, size: u64| {
            let wanted = |symbol: &&Symbol| symbol.size == size && symbol.name.ends_with(name);
            report
                .symbols
                .iter()
                .find(wanted)
                .map(|symbol| symbol.section)
        };
        assert_eq!(section_of("CONSTANT", 7_003), Some("text"));
        assert_eq!(section_of("VARIABLE", 7_005), Some("data"));
        assert_eq!(section_of("ZERO", 7_007), Some("bss"));
        assert!(report.symbols.is_sorted_by(|a, b| a.size >= b.size));
        assert!(
            report.sizes.text > 7_003 && report.sizes.data >= 7_005 && report.sizes.bss >= 7_007
        );
    }

    #[test]
    fn something_else_than_a_binary_is_refused_by_name() {
        let error = Report::measure("tag", b"not an ELF file", 5).err().unwrap();
        assert_eq!(error.to_string(), "tag is not an ELF file");
    }
}
