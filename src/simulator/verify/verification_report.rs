//! The report of a verification: a row for each measure, with its value and its target.

use std::fmt;

use glam::DVec2;
use polyptych_wall::Eye;
use serde::Serialize;

/// All rows, as text for people and as JSON.
#[derive(Debug, Default, Serialize)]
pub(crate) struct VerificationReport {
    /// The rows, in the order in which they were measured.
    pub rows: Vec<Measurement>,
    /// The points that channels showed, from which the rows of points are made.
    #[serde(skip)]
    pub points: Vec<MeasuredPoint>,
}

/// A point that one channel showed in one frame.
#[derive(Clone, Debug)]
pub(crate) struct MeasuredPoint {
    /// The channel's name.
    pub channel: String,
    /// The eye that sees it there.
    pub eye: Eye,
    /// The index of its screen.
    pub screen: usize,
    /// The place at which it must be, in pixels of the channel's picture.
    pub pixel: DVec2,
    /// The place of `pixel` on the screen's canvas, in pixels; NaN if it lies beside it.
    pub canvas: DVec2,
    /// The distance from there, in pixels of the channel; NaN if it was not found.
    pub error_px: f64,
    /// The maximum of `error_px` that keeps the target.
    pub bound_px: f64,
    /// The distance of the scene from the origin, in metres.
    pub offset_m: f64,
}

impl MeasuredPoint {
    /// Returns the channel's name, with the eye where it is not for the middle of both.
    pub fn label(&self) -> String {
        with_eye(&self.channel, self.eye)
    }
}

/// Returns a channel's name with the eye that sees it, if that is not the middle of both.
pub(crate) fn with_eye(channel: &str, eye: Eye) -> String {
    match eye {
        Eye::Center => channel.to_owned(),
        Eye::Left => format!("{channel}, left eye"),
        Eye::Right => format!("{channel}, right eye"),
    }
}

/// One measure.
#[derive(Debug, Serialize)]
pub(crate) struct Measurement {
    /// The measure and its place.
    pub what: String,
    /// The measured value; `None`: it could not be measured, which keeps no target.
    pub measured: Option<f64>,
    /// The unit of `measured` and `target`.
    pub unit: &'static str,
    /// The most, or the least, that it may come to; `None`: it is told, not judged.
    pub target: Option<Bound>,
    /// The place of the worst value, or the reason why there is nothing to measure.
    pub note: String,
    /// `true` if the target is kept.
    pub is_kept: bool,
}

/// A bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Bound {
    AtMost(f64),
    AtLeast(f64),
}

impl VerificationReport {
    /// Adds a measure that could not be made, with the reason.
    pub fn add_unmeasured(
        &mut self,
        what: impl Into<String>,
        target: Option<Bound>,
        why: impl Into<String>,
    ) {
        self.add(what, f64::NAN, "", target, why);
    }

    /// Adds a measure; a number that is none says that it could not be made.
    pub fn add(
        &mut self,
        what: impl Into<String>,
        measured: f64,
        unit: &'static str,
        target: Option<Bound>,
        note: impl Into<String>,
    ) {
        let measured = Some(measured).filter(|number| number.is_finite());
        let is_kept = match (target, measured) {
            (None, _) => true,
            (Some(_), None) => false,
            (Some(Bound::AtMost(most)), Some(measured)) => measured <= most,
            (Some(Bound::AtLeast(least)), Some(measured)) => measured >= least,
        };
        let (what, note) = (what.into(), note.into());
        self.rows.push(Measurement { what, measured, unit, target, note, is_kept });
    }

    /// Returns the number of targets that are kept, and of all.
    pub fn kept(&self) -> (usize, usize) {
        let judged = || self.rows.iter().filter(|row| row.target.is_some());
        (judged().filter(|row| row.is_kept).count(), judged().count())
    }

    /// Returns the kinds of rows with their meanings, each once.
    pub fn meanings(&self) -> Vec<(&'static str, &'static str)> {
        let mut meanings = Vec::new();
        for found in self.rows.iter().filter_map(|row| meaning(&row.what)) {
            if !meanings.contains(&found) {
                meanings.push(found);
            }
        }
        meanings
    }

    /// Returns whether all targets are kept, and there was something to judge.
    pub fn is_met(&self) -> bool {
        self.rows.iter().all(|row| row.is_kept) && self.rows.iter().any(|row| row.target.is_some())
    }
}

/// Headings of the columns.
pub(crate) const HEADINGS: [&str; 5] =
    ["what", "measured", "target", "kept", "where worst, or why"];

/// The column of numbers, which end in line.
const NUMBERS: usize = 1;

impl Measurement {
    /// Returns the texts of its columns, in the order of [`HEADINGS`].
    pub fn cells(&self) -> [String; 5] {
        let target = match self.target {
            None => "none".to_owned(),
            Some(Bound::AtMost(most)) => format!("≤ {}", short(most)),
            Some(Bound::AtLeast(least)) => format!("≥ {}", short(least)),
        };
        let kept = match (self.target, self.is_kept) {
            (None, _) => "-",
            (_, true) => "yes",
            (_, false) => "MISSED",
        };
        let measured = self.measured.map(|number| format!("{number:.5} {}", self.unit));
        let measured = measured.map_or("not measured".to_owned(), |m| m.trim_end().to_owned());
        [self.what.clone(), measured, target, kept.to_owned(), self.note.clone()]
    }
}

/// A table for people with headings, the number of kept targets, and the meanings of rows.
impl fmt::Display for VerificationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.rows.iter().map(Measurement::cells);
        let lines: Vec<_> = std::iter::once(HEADINGS.map(str::to_owned)).chain(rows).collect();
        let width = |column: usize| {
            lines.iter().map(|line| line[column].chars().count()).max().unwrap_or_default()
        };
        let widths = [0, 1, 2, 3].map(width);
        for cells in &lines {
            let mut line = String::new();
            for (index, (cell, width)) in cells.iter().zip(widths).enumerate() {
                let padding = " ".repeat(width - cell.chars().count());
                let (before, after) =
                    if index == NUMBERS { (padding.as_str(), "") } else { ("", padding.as_str()) };
                line.extend([before, cell, after, "  "]);
            }
            writeln!(f, "{}", format!("{line}{}", cells[4]).trim_end())?;
        }
        let (kept, judged) = self.kept();
        writeln!(f, "\ntargets kept: {kept} of {judged}")?;
        self.meanings().into_iter().try_for_each(|(name, text)| writeln!(f, "  {name}: {text}"))
    }
}

/// A number with six decimals at most.
fn short(number: f64) -> String {
    format!("{number:.6}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Returns the beginning of `what` that rows of this kind share, and their meaning, for people who
/// read the table for the first time.
fn meaning(what: &str) -> Option<(&'static str, &'static str)> {
    const MEANINGS: [(&str, &str); 17] = [
        ("points in views", "the same in a camera's own picture that lies on a screen"),
        (
            "omnidirectional stereo",
            "by how much each eye sees points off that are not on the screen, against an eye of \
             its own for each pixel",
        ),
        ("source pixels per pixel", "how finely a warped channel is drawn before it is warped"),
        ("sum of blend weights", "flat white of overlapping channels, read from their pictures"),
        ("superposed codes", "error of flat fields where channels come together, of half a level"),
        ("black", "the same for black, which is lifted to the leak of the most projectors"),
        (
            "4 × 4 means that keep it",
            "the share of the wall that keeps it in means over 4 × 4 pixels",
        ),
        (
            "4 × 4 means of overlapping masks",
            "the share whose masks add up to one at white, to 1 %",
        ),
        ("channels without markers", "they are not measured"),
        ("points", "how far points are drawn from where exact arithmetic has them"),
        ("warped points", "the same where a warp resamples the picture"),
        ("one point on two channels", "how far apart two channels show the same point"),
        ("jitter", "how much the error of a point changes from frame to frame of a slow move"),
        ("pixels within 2 levels", "share of the wall's pixels like those of one large display"),
        ("pixels that are the same", "share of the wall's pixels as one large display shows them"),
        ("pixels within one level", "the same, where a pixel may be one level of 255 off"),
        ("pixels off by more than eight", "share of pixels that anybody might see"),
    ];
    MEANINGS.into_iter().find(|(name, _)| what.starts_with(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_judged_and_lined_up() {
        let mut table = VerificationReport::default();
        table.add("markers", 0.004, "px", Some(Bound::AtMost(0.01)), "front-1-1");
        table.add("time", 12.5, "ms", None, "");
        assert!(table.is_met());
        table.add("identical", 0.98, "", Some(Bound::AtLeast(0.995)), "");
        assert!(!table.is_met());
        let text = table.to_string();
        let lines: Vec<&str> = text.lines().collect();
        let headings = "what          measured  target   kept    where worst, or why";
        assert_eq!(lines[..2], [headings, "markers     0.00400 px  ≤ 0.01   yes     front-1-1"]);
        assert!(lines[2].contains("none") && lines[3].contains("MISSED"), "{text}");
        assert!(text.contains("targets kept: 1 of 2"), "{text}");
    }

    #[test]
    fn each_kind_of_row_is_explained_once() {
        let mut table = VerificationReport::default();
        for what in ["points", "points, 1e4 m away", "jitter", "warped points"] {
            table.add(what, 0.0, "px", Some(Bound::AtMost(0.01)), "");
        }
        let text = table.to_string();
        for name in ["  points: ", "  jitter: ", "  warped points: "] {
            assert_eq!(text.matches(name).count(), 1, "{text}");
        }
    }

    #[test]
    fn what_is_no_number_keeps_no_target() {
        let mut table = VerificationReport::default();
        assert!(!table.is_met(), "nothing was judged");
        table.add("markers", f64::NAN, "px", Some(Bound::AtMost(0.01)), "no light");
        assert!(!table.is_met());
        let json = serde_json::to_value(&table).expect("JSON");
        assert!(json["rows"][0]["measured"].is_null(), "{json}");
        let text = table.to_string();
        assert!(text.contains("not measured") && text.contains("no light"), "{text}");
    }
}
