//! What was proved: a row for each measure, with what it came to and what it must keep.

use std::fmt;

use serde::Serialize;

/// All rows, as text for people and as JSON.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Table {
    /// In the order in which they were measured.
    pub rows: Vec<Row>,
}

/// One measure.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    /// What was measured, and where.
    pub what: String,
    /// What it came to.
    pub measured: f64,
    /// Of `measured` and `target`.
    pub unit: &'static str,
    /// The most, or the least, that it may come to; `None`: it is told, not judged.
    pub target: Option<Target>,
    /// Where it was worst, or why there is nothing to measure.
    pub note: String,
    /// Whether the target is kept.
    pub is_kept: bool,
}

/// A bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Target {
    AtMost(f64),
    AtLeast(f64),
}

impl Table {
    /// Adds a measure.
    pub fn add(
        &mut self,
        what: impl Into<String>,
        measured: f64,
        unit: &'static str,
        target: Option<Target>,
        note: impl Into<String>,
    ) {
        let is_kept = match target {
            None => true,
            // NaN keeps nothing.
            Some(Target::AtMost(most)) => measured <= most,
            Some(Target::AtLeast(least)) => measured >= least,
        };
        let (what, note) = (what.into(), note.into());
        self.rows.push(Row { what, measured, unit, target, note, is_kept });
    }

    /// Whether all targets are kept, and there was something to judge.
    pub fn is_kept(&self) -> bool {
        self.rows.iter().all(|row| row.is_kept) && self.rows.iter().any(|row| row.target.is_some())
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cells = |row: &Row| {
            let target = match row.target {
                None => String::new(),
                Some(Target::AtMost(most)) => format!("≤ {most}"),
                Some(Target::AtLeast(least)) => format!("≥ {least}"),
            };
            let judged = match (row.target, row.is_kept) {
                (None, _) => "",
                (_, true) => "kept",
                (_, false) => "MISSED",
            };
            [row.what.clone(), format!("{:.5} {}", row.measured, row.unit), target, judged.into()]
        };
        let rows: Vec<[String; 4]> = self.rows.iter().map(cells).collect();
        let width = |column: usize| {
            rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default()
        };
        let widths = [width(0), width(1), width(2), width(3)];
        for (row, Row { note, .. }) in rows.iter().zip(&self.rows) {
            let mut line = String::new();
            for (index, (cell, width)) in row.iter().zip(widths).enumerate() {
                let padding = " ".repeat(width - cell.chars().count());
                // Numbers end in line.
                let (before, after) =
                    if index == 1 { (padding.as_str(), "") } else { ("", padding.as_str()) };
                line.extend([before, cell, after, "  "]);
            }
            writeln!(f, "{}", format!("{line}{note}").trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_judged_and_lined_up() {
        let mut table = Table::default();
        table.add("markers", 0.004, "px", Some(Target::AtMost(0.01)), "front-1-1");
        table.add("time", 12.5, "ms", None, "");
        assert!(table.is_kept());
        table.add("identical", 0.98, "", Some(Target::AtLeast(0.995)), "");
        assert!(!table.is_kept());
        let text = table.to_string();
        assert!(text.contains("markers     0.00400 px  ≤ 0.01   kept    front-1-1"), "{text}");
        assert!(text.contains("MISSED"), "{text}");
    }

    #[test]
    fn what_is_no_number_keeps_no_target() {
        let mut table = Table::default();
        assert!(!table.is_kept(), "nothing was judged");
        table.add("markers", f64::NAN, "px", Some(Target::AtMost(0.01)), "");
        assert!(!table.is_kept());
    }
}
