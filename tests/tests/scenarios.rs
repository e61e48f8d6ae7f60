//! Every TOML file in tests/scenarios is a test.

use libtest_mimic::{Arguments, Failed, Trial};
use nova_tests::Scenario;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
    let files = match std::fs::read_dir(&folder) {
        Ok(files) => files,
        Err(error) => {
            eprintln!("{}: {error}", folder.display());
            return ExitCode::FAILURE;
        }
    };
    let mut trials: Vec<Trial> = files
        .flatten()
        .map(|file| file.path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "toml")
        })
        .map(|path| {
            let name = path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .replace('-', "_");
            Trial::test(name, move || play(&path))
        })
        .collect();
    trials.sort_by(|a, b| a.name().cmp(b.name()));
    libtest_mimic::run(&arguments, trials).exit_code()
}

fn play(path: &Path) -> Result<(), Failed> {
    let toml = std::fs::read_to_string(path)?;
    let scenario = Scenario::parse(&toml)?;
    scenario
        .run()
        .map_err(|unmet| format!("{}\n{unmet}", scenario.about).into())
}
