//! Notes of a bake: what of the file is not drawn, or not as it is there. Each kind is said once,
//! with the first place where it stands and how many more there are.

use polyptych_scene::limits::{NOTE_BYTES_MAX, NOTES_MAX};
use polyptych_text::counted;

/// The notes of one bake, in the order in which their kinds came up.
#[derive(Debug, Default)]
pub(super) struct Notes {
    kinds: Vec<Kind>,
    /// Notes of further kinds, which are only counted.
    uncounted: u64,
}

#[derive(Debug)]
struct Kind {
    place: String,
    what: String,
    /// Places beside the first.
    more: u64,
}

impl Notes {
    /// Adds a note, `PLACE: WHAT`. One that differs from an earlier one in its place only is
    /// counted with that; one that is the same in both is said already.
    pub(super) fn add(&mut self, note: &str) {
        let (place, what) = note.split_once(": ").unwrap_or(("", note));
        if let Some(kind) = self.kinds.iter_mut().find(|kind| kind.what == what) {
            kind.more += u64::from(kind.place != place);
        } else if self.kinds.len() < NOTES_MAX - 1 {
            self.kinds.push(Kind { place: place.into(), what: what.into(), more: 0 });
        } else {
            self.uncounted += 1;
        }
    }

    /// Returns the notes as lines: at most [`NOTES_MAX`] of at most [`NOTE_BYTES_MAX`] bytes, in
    /// which control characters are escaped. The last one counts those that had no room.
    pub(super) fn into_lines(self) -> Vec<String> {
        let line = |kind: &Kind| match (kind.place.as_str(), kind.more) {
            ("", _) => kind.what.clone(),
            (place, 0) => format!("{place}: {}", kind.what),
            (place, more) => format!("{place} and {more} more: {}", kind.what),
        };
        let more =
            (self.uncounted > 0).then(|| format!("… and {}", counted(self.uncounted, "more note")));
        self.kinds.iter().map(line).chain(more).map(|line| bounded(&line)).collect()
    }
}

/// The line without control characters, cut to [`NOTE_BYTES_MAX`] bytes.
fn bounded(line: &str) -> String {
    let mut text = String::with_capacity(line.len());
    for c in line.chars() {
        if c.is_control() {
            text.extend(c.escape_default());
        } else {
            text.push(c);
        }
    }
    if text.len() > NOTE_BYTES_MAX {
        text.truncate(text.floor_char_boundary(NOTE_BYTES_MAX - '…'.len_utf8()));
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(notes: &[&str]) -> Vec<String> {
        let mut kept = Notes::default();
        for note in notes {
            kept.add(note);
        }
        kept.into_lines()
    }

    #[test]
    fn counts_places_of_one_kind() {
        let notes = ["meshes[0]: no", "meshes[1]: no", "skins: 2 rest", "meshes[1]: no"];
        assert_eq!(lines(&notes), ["meshes[0] and 2 more: no", "skins: 2 rest"]);
        assert_eq!(lines(&["skins: 2 rest", "skins: 2 rest"]), ["skins: 2 rest"]);
        assert_eq!(lines(&["no place"]), ["no place"]);
    }

    #[test]
    fn bounds_number_and_length_and_escapes_control_characters() {
        let many: Vec<String> = (0..NOTES_MAX * 2).map(|i| format!("a: kind {i}")).collect();
        let kept = lines(&many.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(kept.len(), NOTES_MAX);
        assert_eq!(kept.last().map(String::as_str), Some("… and 65 more notes"));
        let long = lines(&[&format!("a: \u{1b}[2J\n{}", "ä".repeat(NOTE_BYTES_MAX))]);
        assert!(long[0].starts_with("a: \\u{1b}[2J\\n") && long[0].ends_with('…'), "{long:?}");
        assert!(long[0].len() <= NOTE_BYTES_MAX, "{} bytes", long[0].len());
    }
}
