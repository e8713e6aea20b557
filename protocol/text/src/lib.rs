//! Words of messages: nouns behind numbers, and text of peers and files made printable.

use std::borrow::Cow;
use std::fmt::{Display, Write};

use serde::{Deserialize, Deserializer};

/// Returns a number of things in words: `1 channel`, `2 channels`, `0 meshes`.
pub fn counted(count: impl Display, noun: &str) -> String {
    let count = count.to_string();
    if count == "1" { format!("1 {noun}") } else { format!("{count} {}", plural(noun)) }
}

/// Returns the plural of a noun, or of several words that end with one.
fn plural(noun: &str) -> String {
    if let Some(stem) = noun.strip_suffix("vertex") {
        return format!("{stem}vertices");
    }
    let is_after_vowel = |stem: &str| stem.ends_with(['a', 'e', 'i', 'o', 'u']);
    match noun.strip_suffix('y') {
        Some(stem) if !is_after_vowel(stem) => format!("{stem}ies"),
        _ if noun.ends_with(['s', 'x']) || noun.ends_with("sh") || noun.ends_with("ch") => {
            format!("{noun}es")
        }
        _ => format!("{noun}s"),
    }
}

/// Returns the text as it may be written to a terminal or a log: one line that moves no cursor,
/// changes no colour and reverses no direction of reading. What does so is escaped as in Rust
/// source: `\n`, `\u{1b}`. All other characters stay; a text that was made printable stays too.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_unprintable) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        let written = match c {
            '\t' | '\n' | '\r' => write!(escaped, "{}", c.escape_debug()),
            c if is_unprintable(c) => write!(escaped, "{}", c.escape_unicode()),
            c => escaped.write_char(c),
        };
        debug_assert!(written.is_ok(), "a String takes every text");
    }
    Cow::Owned(escaped)
}

/// Returns whether a character is a control character (C0, C1), a mark or an override of the
/// direction of reading, a separator of lines, or invisible. Joiners stay: scripts need them.
fn is_unprintable(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{61c}'
                | '\u{200b}'
                | '\u{200e}'..='\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}'
                | '\u{e0000}'..='\u{e007f}'
        )
}

/// Makes a text printable in its place.
pub fn make_printable(text: &mut String) {
    if let Cow::Owned(escaped) = printable(text) {
        *text = escaped;
    }
}

/// Text of a peer: printable as soon as it is decoded. For fields of messages:
/// `#[serde(deserialize_with = "words::text_of_peer")]`.
///
/// # Errors
/// Those of the deserializer.
pub fn text_of_peer<'de, D: Deserializer<'de>, T: PeerText + Deserialize<'de>>(
    deserializer: D,
) -> Result<T, D::Error> {
    let mut text = T::deserialize(deserializer)?;
    text.make_printable();
    Ok(text)
}

/// A value that [`text_of_peer`] can make printable.
pub trait PeerText {
    /// Escapes what must not reach a terminal.
    fn make_printable(&mut self);
}

impl PeerText for String {
    fn make_printable(&mut self) {
        make_printable(self);
    }
}

impl<T: PeerText> PeerText for Option<T> {
    fn make_printable(&mut self) {
        self.iter_mut().for_each(T::make_printable);
    }
}

impl<T: PeerText> PeerText for Vec<T> {
    fn make_printable(&mut self) {
        self.iter_mut().for_each(T::make_printable);
    }
}

impl<A: PeerText, B: PeerText> PeerText for (A, B) {
    fn make_printable(&mut self) {
        self.0.make_printable();
        self.1.make_printable();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_has_a_singular_and_all_other_numbers_a_plural() {
        for (count, noun, words) in [
            (0, "channel", "0 channels"),
            (1, "channel", "1 channel"),
            (2, "channel", "2 channels"),
            (1, "mesh", "1 mesh"),
            (3, "mesh", "3 meshes"),
            (2, "vertex", "2 vertices"),
            (2, "display", "2 displays"),
            (5, "query", "5 queries"),
            (11, "pixel", "11 pixels"),
        ] {
            assert_eq!(counted(count, noun), words);
        }
    }

    #[test]
    fn escapes_what_moves_a_terminal_and_keeps_ordinary_text() {
        for (text, printed) in [
            ("Größe 5 µm — 東京, नमस्ते, e\u{301}, 👩\u{200d}🚀", None),
            ("C:\\wall \"a\"", None),
            ("a\u{1b}[2Jb", Some("a\\u{1b}[2Jb")),
            ("\r\n\tline\u{7f}", Some("\\r\\n\\tline\\u{7f}")),
            ("c1 \u{9b}31m", Some("c1 \\u{9b}31m")),
            ("\u{202e}gpj.exe\u{2066}", Some("\\u{202e}gpj.exe\\u{2066}")),
            ("a\u{2028}b\u{feff}\u{e0041}", Some("a\\u{2028}b\\u{feff}\\u{e0041}")),
        ] {
            let escaped = printable(text);
            assert_eq!(escaped, printed.unwrap_or(text));
            assert_eq!(printable(&escaped), escaped, "once is enough");
        }
    }

    #[test]
    fn text_of_a_peer_is_printable_once_it_is_decoded() {
        #[derive(serde::Serialize, Deserialize)]
        struct Message {
            #[serde(deserialize_with = "text_of_peer")]
            reason: Option<String>,
            #[serde(deserialize_with = "text_of_peer")]
            missing: Vec<(String, String)>,
        }
        let bad = || "\u{1b}]0;title\u{7}".to_owned();
        let sent = Message { reason: Some(bad()), missing: vec![(bad(), "well".into())] };
        let sent = serde_json::to_string(&sent).expect("encoded");
        let came: Message = serde_json::from_str(&sent).expect("decoded");
        let good = "\\u{1b}]0;title\\u{7}";
        assert_eq!(came.reason.as_deref(), Some(good));
        assert_eq!(came.missing, [(good.to_owned(), "well".to_owned())]);
    }
}
