//! The terminal: drawn whole in one write, restored however the program ends.

use std::io::{Stdout, Write, stdout};
use std::time::Duration;

use crossterm::cursor::{Hide, MoveTo, Show};
use crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, poll, read};
use crossterm::style::{Attribute, Color, Print, ResetColor, SetAttribute, SetForegroundColor};
use crossterm::terminal::{
    BeginSynchronizedUpdate, Clear, ClearType, DisableLineWrap, EnableLineWrap,
    EndSynchronizedUpdate, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode,
    enable_raw_mode, size,
};
use crossterm::{execute, queue};

use super::table::{Line, Tone};
use crate::logging;

/// A terminal that is ours until this is dropped.
#[derive(Debug)]
pub(super) struct Terminal {
    out: Stdout,
    has_color: bool,
}

/// What came from the terminal.
#[derive(Debug, Default)]
pub(super) struct TerminalInput {
    /// `q` or Ctrl-C.
    pub is_end: bool,
    pub is_resized: bool,
}

impl Terminal {
    /// Takes the terminal.
    ///
    /// # Errors
    /// It can't be taken, and is as it was.
    pub fn open() -> std::io::Result<Self> {
        enable_raw_mode()?;
        // From here on dropping gives it back.
        let mut screen = Self { out: stdout(), has_color: !logging::is_plain() };
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            // Said on the screen that is about to vanish, nobody would read it.
            restore();
            usual(panic);
        }));
        execute!(screen.out, EnterAlternateScreen, Hide, DisableLineWrap)?;
        Ok(screen)
    }

    /// Columns and rows.
    pub fn size() -> std::io::Result<(usize, usize)> {
        let (columns, rows) = match size()? {
            // A terminal that nobody has given a size.
            (0, _) | (_, 0) => (80, 24),
            size => size,
        };
        Ok((usize::from(columns), usize::from(rows)))
    }

    /// Waits so long for a key or a change of size, then takes all that came.
    pub fn await_input(longest: Duration) -> std::io::Result<TerminalInput> {
        let mut input = TerminalInput::default();
        let mut wait = longest;
        while poll(wait)? {
            wait = Duration::ZERO;
            match read()? {
                Event::Resize(..) => input.is_resized = true,
                Event::Key(key) if key.kind != KeyEventKind::Release => {
                    let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
                    input.is_end |= match key.code {
                        KeyCode::Char('c') => is_control,
                        KeyCode::Char('q' | 'Q') => true,
                        _ => false,
                    };
                }
                _ => {}
            }
        }
        Ok(input)
    }

    /// Replaces what is shown, without a moment in which it is empty.
    pub fn draw(&mut self, lines: &[Line]) -> std::io::Result<()> {
        let mut bytes = Vec::new();
        queue!(bytes, BeginSynchronizedUpdate)?;
        for (row, line) in (0..).zip(lines) {
            queue!(bytes, MoveTo(0, row))?;
            for piece in line {
                self.style(&mut bytes, piece.tone)?;
                queue!(bytes, Print(&piece.text), SetAttribute(Attribute::Reset), ResetColor)?;
            }
            queue!(bytes, Clear(ClearType::UntilNewLine))?;
        }
        if let Ok(below) = u16::try_from(lines.len()) {
            queue!(bytes, MoveTo(0, below), Clear(ClearType::FromCursorDown))?;
        }
        queue!(bytes, EndSynchronizedUpdate)?;
        self.out.write_all(&bytes)?;
        self.out.flush()
    }

    fn style(&self, bytes: &mut Vec<u8>, tone: Tone) -> std::io::Result<()> {
        let (color, attribute) = match tone {
            Tone::Plain => (None, None),
            Tone::Head => (None, Some(Attribute::Bold)),
            Tone::Quiet => (None, Some(Attribute::Dim)),
            Tone::Good => (Some(Color::Green), None),
            Tone::Busy => (Some(Color::Cyan), None),
            Tone::Warning => (Some(Color::Yellow), Some(Attribute::Bold)),
            Tone::Bad => (Some(Color::Red), Some(Attribute::Bold)),
        };
        if let Some(color) = color.filter(|_| self.has_color) {
            queue!(bytes, SetForegroundColor(color))?;
        }
        if let Some(attribute) = attribute {
            queue!(bytes, SetAttribute(attribute))?;
        }
        Ok(())
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        restore();
    }
}

/// Gives the terminal back; a second time does no harm. Where it fails, the terminal is gone.
fn restore() {
    let _ = execute!(stdout(), EnableLineWrap, Show, LeaveAlternateScreen);
    let _ = disable_raw_mode();
}
