//! Finding a compiler and a linker for the board, and installing them where that may be done.
//!
//! The compiler: first what is there: the Rust in use with the target, or Debian's compiler, which builds `core` and
//! `alloc` from its own source package. Then what can be installed: the target through rustup, Debian's
//! packages through apt. So nobody waits for the network twice.
//!
//! The linker: flip-link around `rust-lld`. It puts the stack below the variables, so that a stack that grows too far
//! leaves RAM, which faults, instead of overwriting variables, which nobody notices.

use std::env;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Result, bail};

use crate::process::{cargo, display, find_on_path, output, run, succeeds_within, workspace_root};

/// What the nRF52832 runs: Cortex-M4 with a single-precision FPU.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Debian's packages of one compiler version: never mix these with another's source.
const DEBIAN_PACKAGES: [&str; 3] = ["rustc-web", "cargo-web", "rust-web-src"];
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_SOURCE: &str = "/usr/lib/rustlib/src/rust/library/core/src/lib.rs";

/// The version that works with `rust-lld`.
const FLIP_LINK: &str = "flip-link@0.1.12";

/// Where the network swallows packets, rustup would wait much longer.
const RUSTUP_LIMIT: Duration = Duration::from_secs(90);

const HELP: &str = "no compiler for thumbv7em-none-eabihf: run `rustup target add thumbv7em-none-eabihf`, \
    or on Debian, as root, `apt-get install rustc-web cargo-web rust-web-src`";

/// A compiler and a linker that build for the board.
#[derive(Debug)]
pub(crate) struct Toolchain {
    compiler: Compiler,
    linker: Linker,
}

#[derive(Debug, PartialEq, Eq)]
enum Compiler {
    /// The Rust in use, with the target's `core` installed.
    Installed,
    /// Debian's, which builds `core` itself.
    Debian,
}

#[derive(Debug, PartialEq, Eq)]
struct Linker {
    /// What cargo is told; a bare name is looked up on PATH.
    program: PathBuf,
    /// Has to be on PATH for it.
    folder: Option<PathBuf>,
}

impl Toolchain {
    /// `cargo build` for the board, without saying what to build.
    pub(crate) fn cargo_build(&self) -> Command {
        let mut command = match self.compiler {
            Compiler::Installed => cargo(),
            Compiler::Debian => debian_cargo(),
        };
        // They would replace the linker arguments in .cargo/config.toml.
        command
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS");
        command.env(
            "CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER",
            &self.linker.program,
        );
        if let Some(folder) = &self.linker.folder {
            let path = env::var_os("PATH").unwrap_or_default();
            let folders = std::iter::once(folder.clone()).chain(env::split_paths(&path));
            if let Ok(path) = env::join_paths(folders) {
                command.env("PATH", path);
            }
        }
        command
            .args(["build", "--target", TARGET])
            .arg("--target-dir")
            .arg(self.target_dir());
        if self.compiler == Compiler::Debian {
            command.args(["-Z", "build-std=core,alloc"]);
        }
        command
    }

    /// Where `profile`'s binaries come to lie.
    pub(crate) fn binaries(&self, profile: &str) -> PathBuf {
        self.target_dir().join(TARGET).join(profile)
    }

    /// The two compilers keep apart what they build: each would rebuild the other's.
    fn target_dir(&self) -> PathBuf {
        let base = env::var_os("CARGO_TARGET_DIR").map_or_else(|| "target".into(), PathBuf::from);
        let base = workspace_root().join(base);
        match self.compiler {
            Compiler::Installed => base,
            Compiler::Debian => base.join("build-std"),
        }
    }
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.compiler {
            Compiler::Installed => write!(f, "{TARGET}: installed target")?,
            Compiler::Debian => write!(f, "{TARGET}: Debian's compiler with its source")?,
        }
        write!(f, ", linker {}", self.linker.program.display())
    }
}

/// Finds a toolchain, or installs what is missing. Says what it installs.
///
/// # Errors
/// One line that says what to do, when nothing can be had.
pub(crate) fn find_or_install() -> Result<Toolchain> {
    let compiler = if target_is_installed() {
        Compiler::Installed
    } else if debian_is_ready() {
        Compiler::Debian
    } else if rustup_adds_target() {
        Compiler::Installed
    } else if apt_installs_debian() {
        Compiler::Debian
    } else {
        bail!(HELP);
    };
    if find_flip_link().is_none() && has_rust_lld() {
        install_flip_link();
    }
    let Some(linker) = find_linker() else {
        bail!(
            "no linker for {TARGET}: install Debian's `lld`, or Rust through rustup, which brings `rust-lld`"
        );
    };
    Ok(Toolchain { compiler, linker })
}

fn target_is_installed() -> bool {
    let libraries = output(rustc().args(["--print", "target-libdir", "--target", TARGET]));
    libraries.is_ok_and(|folder| has_core(Path::new(&folder)))
}

/// Whether `folder` holds a compiled `core`; rustup leaves empty folders behind.
fn has_core(folder: &Path) -> bool {
    let Ok(files) = folder.read_dir() else {
        return false;
    };
    files
        .flatten()
        .any(|file| file.file_name().to_string_lossy().starts_with("libcore-"))
}

fn rustup_adds_target() -> bool {
    if find_on_path("rustup").is_none() {
        return false;
    }
    let mut command = Command::new("rustup");
    command
        .args(["target", "add", TARGET])
        .current_dir(workspace_root());
    eprintln!("{TARGET} is not installed: running `{}`", display(&command));
    succeeds_within(&mut command, RUSTUP_LIMIT) && target_is_installed()
}

fn debian_is_ready() -> bool {
    let version = output(Command::new(DEBIAN_RUSTC).arg("-V")).unwrap_or_default();
    Path::new(DEBIAN_CARGO).is_file()
        && Path::new(DEBIAN_SOURCE).is_file()
        && is_at_least(&version, env!("CARGO_PKG_RUST_VERSION"))
}

/// Compares `rustc -V`'s answer ("rustc 1.96.0 (...)") with a version like "1.95".
fn is_at_least(answer: &str, wanted: &str) -> bool {
    let numbers = |version: &str| -> Option<(u32, u32)> {
        let mut parts = version.split('.').map(|part| part.parse().ok());
        Some((parts.next()??, parts.next()??))
    };
    let found = answer.split_whitespace().nth(1).and_then(numbers);
    found.is_some_and(|found| Some(found) >= numbers(wanted))
}

/// Only as root: asking for a password in the middle of a build helps nobody.
fn apt_installs_debian() -> bool {
    let root = output(Command::new("id").arg("-u")).is_ok_and(|id| id == "0");
    if !root || find_on_path("apt-get").is_none() {
        return false;
    }
    let apt = |arguments: &[&str]| {
        let mut command = Command::new("apt-get");
        command
            .args(arguments)
            .env("DEBIAN_FRONTEND", "noninteractive");
        eprintln!("running `{}`", display(&command));
        run(&mut command).is_ok()
    };
    let mut install = vec!["install", "-y", "--no-install-recommends"];
    install.extend(DEBIAN_PACKAGES);
    if find_linker().is_none() {
        install.push("lld");
    }
    // The package lists of a fresh container are empty: fetch them only where needed.
    (apt(&install) || (apt(&["update"]) && apt(&install))) && debian_is_ready()
}

fn rustc() -> Command {
    let mut command = Command::new(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    command.current_dir(workspace_root());
    command
}

/// Debian's cargo with Debian's rustc, cut off from the toolchain that runs this program.
fn debian_cargo() -> Command {
    let mut command = Command::new(DEBIAN_CARGO);
    command.current_dir(workspace_root());
    for name in [
        "CARGO",
        "RUSTDOC",
        "RUSTUP_TOOLCHAIN",
        "RUSTC_WRAPPER",
        "LD_LIBRARY_PATH",
    ] {
        command.env_remove(name);
    }
    // Building `core` is unstable; the variable permits it on a stable compiler.
    command
        .env("RUSTC", DEBIAN_RUSTC)
        .env("RUSTC_BOOTSTRAP", "1");
    command
}

/// flip-link around `rust-lld` of the Rust in use; where it could not be had, `rust-lld` alone; then any LLD.
fn find_linker() -> Option<Linker> {
    let own = rust_lld_folder();
    if has_rust_lld() {
        let program = find_flip_link().unwrap_or_else(|| "rust-lld".into());
        return Some(Linker {
            program,
            folder: own,
        });
    }
    let program = find_on_path("ld.lld")?;
    Some(Linker {
        program,
        folder: None,
    })
}

fn has_rust_lld() -> bool {
    rust_lld_folder().is_some() || find_on_path("rust-lld").is_some()
}

/// On PATH, or where `cargo install` puts it.
fn find_flip_link() -> Option<PathBuf> {
    find_on_path("flip-link").or_else(|| {
        let home = env::var_os("CARGO_HOME").map_or_else(
            || env::home_dir().map(|home| home.join(".cargo")),
            |home| Some(PathBuf::from(home)),
        )?;
        let program = home
            .join("bin")
            .join(format!("flip-link{}", env::consts::EXE_SUFFIX));
        program.is_file().then_some(program)
    })
}

/// Without it the firmware still links: a stack that overflows then goes unnoticed, which is said here.
fn install_flip_link() {
    let mut command = cargo();
    command.args(["install", "--locked", FLIP_LINK]);
    // Not into this workspace's target folder, and not with its settings.
    command
        .env_remove("CARGO_TARGET_DIR")
        .current_dir(env::temp_dir());
    eprintln!(
        "flip-link is not installed: running `{}`",
        display(&command)
    );
    if let Err(error) = run(&mut command) {
        eprintln!("{error:#}: linking without it; a stack that overflows will overwrite variables");
    }
}

/// rustup keeps `rust-lld` among the host's libraries, where only its own rustc looks.
fn rust_lld_folder() -> Option<PathBuf> {
    let libraries = PathBuf::from(output(rustc().args(["--print", "target-libdir"])).ok()?);
    let folder = libraries.parent()?.join("bin");
    folder
        .join(format!("rust-lld{}", env::consts::EXE_SUFFIX))
        .is_file()
        .then_some(folder)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    fn toolchain(compiler: Compiler) -> Toolchain {
        let linker = Linker {
            program: "rust-lld".into(),
            folder: Some("/lld/bin".into()),
        };
        Toolchain { compiler, linker }
    }

    fn variable<'c>(command: &'c Command, name: &str) -> Option<Option<&'c OsStr>> {
        command
            .get_envs()
            .find(|(key, _)| *key == name)
            .map(|(_, value)| value)
    }

    #[test]
    fn debians_compiler_builds_core_and_keeps_its_own_target_directory() {
        let toolchain = toolchain(Compiler::Debian);
        let command = toolchain.cargo_build();
        let shown = display(&command);
        assert!(
            shown.contains("RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 /usr/bin/cargo build"),
            "{shown}"
        );
        assert!(
            shown.ends_with("build-std -Z build-std=core,alloc"),
            "{shown}"
        );
        assert_eq!(
            variable(&command, "RUSTUP_TOOLCHAIN"),
            Some(None),
            "must not leak in"
        );
        assert!(
            toolchain
                .binaries("firmware")
                .ends_with("build-std/thumbv7em-none-eabihf/firmware")
        );
    }

    #[test]
    fn an_installed_target_is_built_the_ordinary_way() {
        let shown = display(&toolchain(Compiler::Installed).cargo_build());
        assert!(
            shown.contains(" build --target thumbv7em-none-eabihf"),
            "{shown}"
        );
        assert!(!shown.contains("build-std"), "{shown}");
        assert!(!shown.contains("RUSTC_BOOTSTRAP"), "{shown}");
    }

    #[test]
    fn the_linkers_folder_comes_first_on_path_and_foreign_flags_are_dropped() {
        let command = toolchain(Compiler::Installed).cargo_build();
        let path = variable(&command, "PATH").flatten().unwrap();
        assert_eq!(env::split_paths(path).next(), Some("/lld/bin".into()));
        assert_eq!(variable(&command, "RUSTFLAGS"), Some(None));
    }

    #[test]
    fn versions_compare_as_numbers() {
        assert!(is_at_least("rustc 1.96.0 (ac68faa20 2026-05-25)", "1.95"));
        assert!(is_at_least("rustc 1.95.0", "1.95"));
        assert!(is_at_least("rustc 1.100.0", "1.95"));
        assert!(!is_at_least("rustc 1.63.0", "1.95"));
        assert!(!is_at_least("", "1.95"));
        assert!(!is_at_least("rustc nightly", "1.95"));
    }

    #[test]
    fn an_empty_target_folder_does_not_count_as_installed() {
        assert!(!has_core(Path::new(env!("CARGO_MANIFEST_DIR"))));
        assert!(!has_core(Path::new("/no/such/folder")));
        let own = output(rustc().args(["--print", "target-libdir"])).unwrap();
        assert!(
            has_core(Path::new(&own)),
            "the host's own library is there: {own}"
        );
    }
}
