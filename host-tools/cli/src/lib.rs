//! The `nova` command, as a library: `main.rs` only calls [`run`].
//!
//! | module | what |
//! |---|---|
//! | `commands` | one file a subcommand |
//! | `table` | CSV files with messages that name file and line |
//! | `page`, `chart` | self-contained HTML pages with pictures |
//! | [`sim_node`] | the firmware's node on a simulated board |

mod board_clock;
mod chart;
mod commands;
mod error;
mod files;
mod page;
mod screen;
pub mod sim_node;
mod table;

pub use commands::run;
