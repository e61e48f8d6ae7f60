//! What can end a simulation early.

/// Why a run stopped before its end.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// A board's code panicked; the board stays dead, the others can be run on.
    #[error("board {board} panicked: {message}")]
    BoardPanicked {
        /// Name of the board.
        board: String,
        /// The panic's message.
        message: String,
    },
    /// The system gave no memory for a board's stack.
    #[error("no stack for board {board}: {source}")]
    NoStack {
        /// Name of the board.
        board: String,
        /// What the system said.
        source: std::io::Error,
    },
}
