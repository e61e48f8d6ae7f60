//! Recordings as MCAP files, and what they are played to again.

pub(crate) mod delivery;
pub(crate) mod file;
pub(crate) mod schema;
