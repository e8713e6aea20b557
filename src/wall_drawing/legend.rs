//! The meanings of lines and hatchings of a drawing, and the notes of the wall's check.

use glam::DVec2;
use polyptych_text::printable;

use super::label::width;
use super::room_view::head_fault;
use super::{Drawing, has_projectors};
use crate::report_page::markup::{add as add_text, escaped};

/// Width of a line of notes.
const NOTE_WIDTH: f64 = 1160.0;

/// Maximum number of notes; the table of `check` has them all.
const NOTES_MAX: usize = 24;

/// Height of a line.
const LINE: f64 = 17.0;

/// Hatchings.
pub(super) const PATTERNS: &str = include_str!("patterns.svg");

/// Adds the legend and the notes at a place, as wide as to `right`. Returns the end of the drawing.
pub(super) fn add(svg: &mut String, drawing: &Drawing<'_>, at: DVec2, right: f64) -> f64 {
    let mut pen = at;
    for (class, text) in entries(drawing) {
        let extent = 30.0 + width(text, 11.0) + 18.0;
        if pen.x + extent > right {
            pen = DVec2::new(at.x, pen.y + LINE + 3.0);
        }
        let (x, y) = (pen.x, pen.y);
        add_text(
            svg,
            format_args!(
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"22\" height=\"11\"/>\
                 <text class=\"w-fact\" x=\"{:.1}\" y=\"{y:.1}\">{text}</text>\n",
                y - 10.0,
                x + 28.0
            ),
        );
        pen.x += extent;
    }
    pen = DVec2::new(at.x, pen.y + 10.0);
    for line in notes(drawing) {
        pen.y += LINE;
        let (x, y, text) = (pen.x, pen.y, escaped(&line));
        add_text(
            svg,
            format_args!("<text class=\"w-fact\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>\n"),
        );
    }
    pen.y + 24.0
}

/// Returns the classes of drawn things, with their meanings.
fn entries(drawing: &Drawing<'_>) -> Vec<(&'static str, &'static str)> {
    let wall = drawing.of.wall;
    let coverage = || drawing.report.screens.iter().flat_map(|row| &row.coverage);
    let is_open =
        |blends: bool| coverage().any(|row| row.blends == blends && row.uncovered_pixels > 0.0);
    let all = [
        (true, "w-edge", "screen"),
        (true, "w-lit w-fill c0", "channel"),
        (has_projectors(wall), "w-beam c1", "light of a projector"),
        (true, "w-sight", "from the eye to a screen"),
        (drawing.blend.is_some(), "w-overlap", "several channels"),
        (drawing.blend.is_some(), "w-iso c0", "25, 50 and 75 % of the light"),
        (is_open(true), "w-gap", "no channel"),
        (is_open(false), "w-hidden", "behind bezels"),
        (
            head_fault(wall).is_none(),
            "w-no-head",
            "where no head can be, at the height of the eye and straight before it",
        ),
    ];
    let shown = all.into_iter().filter(|(is_drawn, _, _)| *is_drawn);
    shown.map(|(_, class, text)| (class, text)).collect()
}

fn notes(drawing: &Drawing<'_>) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    notes.extend(head_fault(drawing.of.wall).map(|fault| format!("The head stays: {fault}")));
    notes.extend(drawing.report.warnings.iter().cloned());
    if drawing.report.screens.iter().any(|row| row.size_m.is_none()) {
        notes.push("a screen without a size is drawn with pixels of 1 mm".to_owned());
    }
    let more = notes.len().saturating_sub(NOTES_MAX);
    notes.truncate(NOTES_MAX);
    if more > 0 {
        notes.push(format!("and {more} more: see polyptych check without --svg"));
    }
    notes.iter().flat_map(|note| wrapped(&format!("• {}", printable(note)))).collect()
}

/// Returns a text in lines that are no wider than [`NOTE_WIDTH`].
fn wrapped(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let word = super::label::shortened(word, 11.0, NOTE_WIDTH);
        match lines.last_mut() {
            Some(line) if width(line, 11.0) + width(&word, 11.0) < NOTE_WIDTH => {
                line.push_str(if line.is_empty() { "" } else { " " });
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}
