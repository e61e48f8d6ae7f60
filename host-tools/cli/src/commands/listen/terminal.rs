//! The terminal while the table is on it.

use super::model::Model;
use super::view::{Screen, draw};
use anyhow::{Context, Result};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use std::time::{Duration, Instant};

/// Nobody reads faster, and the boards' processor time is ours.
const REDRAW: Duration = Duration::from_millis(100);

/// The terminal, given back as it was when this is dropped, and before a panic's message.
pub(super) struct Tui {
    terminal: DefaultTerminal,
    drawn_at: Option<Instant>,
}

impl Tui {
    pub(super) fn begin() -> Result<Self> {
        let terminal = ratatui::try_init().context("the terminal cannot be drawn on")?;
        Ok(Self {
            terminal,
            drawn_at: None,
        })
    }

    /// Draws, unless that was done just now.
    pub(super) fn show(&mut self, model: &Model, screen: &mut Screen) -> Result<()> {
        if self.drawn_at.is_some_and(|at| at.elapsed() < REDRAW) {
            return Ok(());
        }
        self.terminal
            .draw(|frame| draw(frame, model, screen))
            .context("the terminal cannot be drawn on")?;
        self.drawn_at = Some(Instant::now());
        Ok(())
    }

    /// Takes the keys that were pressed; whether one of them means to leave.
    pub(super) fn keys(&mut self, screen: &mut Screen) -> Result<bool> {
        const PAGE: usize = 10;
        while event::poll(Duration::ZERO).context("the keyboard cannot be read")? {
            let Event::Key(key) = event::read().context("the keyboard cannot be read")? else {
                // A new size, for instance: to be drawn at once.
                self.drawn_at = None;
                continue;
            };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => return Ok(true),
                KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => {
                    return Ok(true);
                }
                KeyCode::Up => screen.scrolled = screen.scrolled.saturating_sub(1),
                KeyCode::Down => screen.scrolled = screen.scrolled.saturating_add(1),
                KeyCode::PageUp => screen.scrolled = screen.scrolled.saturating_sub(PAGE),
                KeyCode::PageDown => screen.scrolled = screen.scrolled.saturating_add(PAGE),
                KeyCode::Home => screen.scrolled = 0,
                _ => continue,
            }
            self.drawn_at = None;
        }
        Ok(false)
    }
}

impl Drop for Tui {
    fn drop(&mut self) {
        ratatui::restore();
    }
}
