//! Errors that are the input's fault.

/// Something is wrong with what the user gave: one sentence that says what,
/// where, and what to do. The command exits with code 2.
#[derive(Debug)]
pub(crate) struct BadInput(pub(crate) String);

impl std::fmt::Display for BadInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

/// A [`BadInput`] from a format string, as an [`anyhow::Error`].
macro_rules! bad_input {
    ($($arguments:tt)*) => {
        anyhow::Error::new($crate::error::BadInput(format!($($arguments)*)))
    };
}
pub(crate) use bad_input;
