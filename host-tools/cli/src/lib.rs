//! The `nova` command, as a library: `main.rs` only calls [`run`].
//!
//! | module | what |
//! |---|---|
//! | `commands` | one file a subcommand |
//! | `anchors` | files of surveyed anchors |
//! | `evaluation` | Monte Carlo tables, whole or in pieces |
//! | `board` | a board that takes commands |
//! | `settings` | settings of a flight as given |
//! | `source` | a board's bytes: serial port, TCP, file, standard input |
//! | `mavlink` | an autopilot: messages, frames, clocks, links |
//! | `table` | CSV files with messages that name file and line |
//! | `page`, `chart` | self-contained HTML pages with pictures |
//! | [`sim_node`] | the firmware's node on a simulated board |

mod anchors;
mod arrivals;
mod board;
mod board_clock;
mod chart;
mod commands;
mod error;
mod evaluation;
mod files;
mod interrupt;
mod mavlink;
mod node_address;
mod page;
mod peer;
mod place;
mod record_line;
mod recording;
mod screen;
mod settings;
pub mod sim_node;
mod source;
mod table;

pub use commands::run;
