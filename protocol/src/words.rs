//! Nouns behind numbers, for messages.

use std::fmt::Display;

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
}
