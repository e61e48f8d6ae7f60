//! Building the firmware and watching its size.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;

use crate::process::{display, run as run_command};
use crate::size::{BUDGET, Report, table};
use crate::toolchain::{self, Toolchain};

const PACKAGE: &str = "nova-dwm1001";

/// Cargo profile of what goes onto a board.
const PROFILE: &str = "firmware";

/// Tells the tests on emulated boards where the binaries are.
pub(crate) const FOLDER_VARIABLE: &str = "NOVA_FIRMWARE";

/// Which firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Binary {
    /// Answers whoever ranges with it.
    Tag,
    /// Ranges with the tags it finds.
    Anchor,
}

impl Binary {
    const ALL: [Self; 2] = [Self::Tag, Self::Anchor];

    /// Its name in Cargo.toml.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tag => "tag",
            Self::Anchor => "anchor",
        }
    }
}

/// `cargo xtask firmware`
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Build only this one
    #[arg(long)]
    bin: Option<Binary>,
    /// Print the sizes as JSON on standard output
    #[arg(long)]
    json: bool,
    /// How many of the largest symbols to list
    #[arg(long, default_value_t = 12, value_name = "N")]
    symbols: usize,
}

/// Builds, prints the sizes and checks the budgets.
///
/// # Errors
/// When there is no compiler, the build fails, or a binary exceeds its budget.
pub(crate) fn run(args: &Args) -> Result<()> {
    let toolchain = toolchain::find_or_install()?;
    let binaries = args
        .bin
        .map_or_else(|| Binary::ALL.to_vec(), |binary| vec![binary]);
    let reports = build_and_measure(&toolchain, &binaries, args.symbols)?;
    if args.json {
        let values: Vec<_> = reports.iter().map(Report::to_json).collect();
        println!("{:#}", serde_json::Value::from(values));
    } else {
        print!("{}", table(&reports, &BUDGET));
    }
    check_budgets(&reports)
}

/// Builds `binary` alone; returns where it lies.
///
/// # Errors
/// When the build fails.
pub(crate) fn build(toolchain: &Toolchain, binary: Binary) -> Result<PathBuf> {
    run_command(&mut build_command(toolchain, &[binary]))?;
    Ok(path(toolchain, binary))
}

/// The command that builds `binary`, as one would type it, and where the binary will lie.
pub(crate) fn describe_build(toolchain: &Toolchain, binary: Binary) -> (String, PathBuf) {
    (
        display(&build_command(toolchain, &[binary])),
        path(toolchain, binary),
    )
}

/// Builds both; returns the folder they lie in.
///
/// # Errors
/// When there is no compiler or the build fails.
pub(crate) fn build_all() -> Result<PathBuf> {
    let toolchain = toolchain::find_or_install()?;
    run_command(&mut build_command(&toolchain, &Binary::ALL))?;
    Ok(folder(&toolchain))
}

fn build_and_measure(
    toolchain: &Toolchain,
    binaries: &[Binary],
    symbols: usize,
) -> Result<Vec<Report>> {
    // Cargo's own messages go straight to the terminal: a cold build takes minutes.
    run_command(&mut build_command(toolchain, binaries))?;
    let measure = |binary: &Binary| {
        let path = path(toolchain, *binary);
        let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        Report::measure(binary.name(), &bytes, symbols)
    };
    binaries.iter().map(measure).collect()
}

fn build_command(toolchain: &Toolchain, binaries: &[Binary]) -> std::process::Command {
    let mut command = toolchain.cargo_build();
    command.args(["--package", PACKAGE, "--profile", PROFILE]);
    for binary in binaries {
        command.args(["--bin", binary.name()]);
    }
    command
}

fn path(toolchain: &Toolchain, binary: Binary) -> PathBuf {
    folder(toolchain).join(binary.name())
}

/// Where both binaries come to lie.
pub(crate) fn folder(toolchain: &Toolchain) -> PathBuf {
    toolchain.binaries(PROFILE)
}

fn check_budgets(reports: &[Report]) -> Result<()> {
    let over = |report: &Report| {
        let excesses = report.sizes.excesses(&BUDGET).into_iter();
        excesses
            .map(|excess| format!("{}: {excess}", report.binary))
            .collect::<Vec<_>>()
    };
    let excesses: Vec<_> = reports.iter().flat_map(over).collect();
    if !excesses.is_empty() {
        bail!("over budget: {}", excesses.join("; "));
    }
    Ok(())
}

/// What `cargo xtask test` does: both binaries, with few symbols.
///
/// # Errors
/// As [`run`].
pub(crate) fn check() -> Result<()> {
    run(&Args {
        bin: None,
        json: false,
        symbols: 5,
    })
}
