//! Running other programs.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

/// The workspace's root: of the checkout that `cargo xtask` was called in, not the one it was compiled
/// in, since two may share a target directory.
pub(crate) fn workspace_root() -> PathBuf {
    let own =
        env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    let own = PathBuf::from(own);
    own.parent().map_or_else(|| own.clone(), Path::to_path_buf)
}

/// The cargo that runs this.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(workspace_root());
    command
}

/// Where `program` lies on PATH.
pub(crate) fn find_on_path(program: &str) -> Option<PathBuf> {
    find_in(env::var_os("PATH")?.as_os_str(), program)
}

fn find_in(path: &OsStr, program: &str) -> Option<PathBuf> {
    let file = format!("{program}{}", env::consts::EXE_SUFFIX);
    env::split_paths(path)
        .map(|folder| folder.join(&file))
        .find(|candidate| candidate.is_file())
}

/// Runs `command` with its output shown as it comes.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    let shown = display(command);
    let status = command
        .status()
        .with_context(|| format!("cannot run `{shown}`"))?;
    ensure_success(status, &shown)
}

/// Runs `command` and returns what it prints.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let shown = display(command);
    let output = command
        .output()
        .with_context(|| format!("cannot run `{shown}`"))?;
    ensure_success(output.status, &shown)?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Runs `command` without showing its output; whether it ended well within `limit`. It is ended when
/// the time is over.
pub(crate) fn succeeds_within(command: &mut Command, limit: Duration) -> bool {
    let child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut child) = child else {
        return false;
    };
    let deadline = Instant::now() + limit;
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return status.success(),
            Ok(None) if Instant::now() < deadline => sleep(Duration::from_millis(50)),
            _ => {
                let _ = child.kill();
                let _ = child.wait();
                return false;
            }
        }
    }
}

/// A command as one would type it.
pub(crate) fn display(command: &Command) -> String {
    let settings = command.get_envs().filter_map(|(name, value)| {
        let value = value?;
        // PATH is long and says nothing about what is done.
        (name != "PATH").then(|| format!("{}={}", name.to_string_lossy(), quoted(value)))
    });
    let words = std::iter::once(command.get_program())
        .chain(command.get_args())
        .map(quoted);
    settings.chain(words).collect::<Vec<_>>().join(" ")
}

fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=./:,+@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

fn ensure_success(status: ExitStatus, shown: &str) -> Result<()> {
    if !status.success() {
        bail!("`{shown}` failed ({status})");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn a_command_is_shown_so_that_it_can_be_typed() {
        let mut command = Command::new("cargo");
        command
            .args(["build", "--config", "a b", "it's"])
            .env("RUSTC", "/usr/bin/rustc");
        command.env("PATH", "/somewhere").env_remove("CARGO");
        assert_eq!(
            display(&command),
            r"RUSTC=/usr/bin/rustc cargo build --config 'a b' 'it'\''s'"
        );
    }

    #[test]
    fn a_program_is_found_only_where_path_says() {
        let own = env::current_exe().unwrap();
        let folder = own.parent().unwrap();
        let name = own.file_stem().unwrap().to_str().unwrap();
        assert_eq!(find_in(folder.as_os_str(), name), Some(own.clone()));
        assert_eq!(find_in(OsStr::new(""), name), None);
        assert_eq!(find_in(folder.as_os_str(), "no-such-program"), None);
    }

    #[test]
    fn a_failure_names_the_command() {
        let error = run(Command::new("no-such-program").arg("--flag")).unwrap_err();
        assert_eq!(error.to_string(), "cannot run `no-such-program --flag`");
    }

    #[cfg(unix)]
    #[test]
    fn a_program_that_takes_too_long_counts_as_failed() {
        assert!(succeeds_within(&mut Command::new("true"), PATIENCE));
        assert!(!succeeds_within(&mut Command::new("false"), PATIENCE));
        // `cat` on a pipe nobody writes to would wait for ever; its input is closed, so it ends at once.
        assert!(succeeds_within(&mut Command::new("cat"), PATIENCE));
        assert!(!succeeds_within(
            Command::new("tail").args(["-f", "/dev/null"]),
            Duration::ZERO
        ));
    }
}
