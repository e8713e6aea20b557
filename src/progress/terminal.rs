//! The terminal that progress is drawn on, which no drawing waits for.

use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};

use indicatif::TermLike;

use crate::logging;

/// Columns of a terminal that does not say how many it has.
const COLUMNS_DEFAULT: u16 = 80;

/// Standard error by way of the log's thread: after Ctrl-S the terminal takes nothing, and a
/// command that draws frames must not wait for its progress bar.
#[derive(Debug, Default)]
pub(super) struct ProgressTerminal(Mutex<Vec<u8>>);

impl ProgressTerminal {
    fn add(&self, text: &str) -> io::Result<()> {
        let mut bytes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        bytes.write_all(text.as_bytes())
    }

    /// Moves the cursor by `count` places, in the direction of an ANSI letter.
    fn move_cursor(&self, count: usize, letter: char) -> io::Result<()> {
        if count == 0 { Ok(()) } else { self.add(&format!("\u{1b}[{count}{letter}")) }
    }
}

impl TermLike for ProgressTerminal {
    fn width(&self) -> u16 {
        crossterm::terminal::size().map_or(COLUMNS_DEFAULT, |(columns, _)| columns)
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.move_cursor(n, 'A')
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.move_cursor(n, 'B')
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.move_cursor(n, 'C')
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.move_cursor(n, 'D')
    }

    fn write_line(&self, s: &str) -> io::Result<()> {
        self.add(s)?;
        self.add("\n")
    }

    fn write_str(&self, s: &str) -> io::Result<()> {
        self.add(s)
    }

    fn clear_line(&self) -> io::Result<()> {
        self.add("\r\u{1b}[2K")
    }

    fn flush(&self) -> io::Result<()> {
        let bytes = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        logging::draw(&bytes);
        Ok(())
    }
}
