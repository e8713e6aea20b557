//! Serde's error messages in the words of a wall file's author.

/// A complaint, translated.
pub(super) struct Explanation {
    /// The name of the key that is missing, where one is.
    pub missing: Option<String>,
    /// The fault.
    pub what: String,
    /// The fix.
    pub remedy: String,
}

/// Translates one message of serde or of the toml crate; what it cannot translate it repeats.
pub(super) fn from_serde(message: &str) -> Explanation {
    if let Some((name, valid)) = unknown(message, "unknown field ") {
        let what = format!("there is no key {name:?} here");
        return Explanation { missing: None, what, remedy: suggest(&name, &valid, "keys") };
    }
    if let Some((name, valid)) = unknown(message, "unknown variant ") {
        let what = format!("{name:?} is none of the values possible");
        return Explanation { missing: None, what, remedy: suggest(&name, &valid, "values") };
    }
    if let Some(name) = message.strip_prefix("missing field ") {
        let name = name.trim_matches('`').to_owned();
        let remedy = format!("add {name} = …");
        return Explanation { missing: Some(name), what: "the key is missing".to_owned(), remedy };
    }
    let invalid = ["invalid type: ", "invalid value: ", "invalid length "];
    if let Some(rest) = invalid.iter().find_map(|prefix| message.strip_prefix(prefix))
        && let Some((found, expected)) = rest.rsplit_once(", expected ")
    {
        let what = format!("found {}", found_words(found));
        let remedy = format!("write {}", expected_words(expected));
        return Explanation { missing: None, what, remedy };
    }
    if message.ends_with("number overflowed") {
        let what = "the number is too large".to_owned();
        return Explanation { missing: None, what, remedy: "write a smaller one".to_owned() };
    }
    let remedy = "polyptych wall schema prints what may stand here".to_owned();
    Explanation { missing: None, what: message.to_owned(), remedy }
}

/// Explains a value in the place of one of these words.
pub(super) fn explain_words(found: &str, words: &[String]) -> Explanation {
    let quoted: Vec<_> = words.iter().map(|word| format!("{word:?}")).collect();
    let remedy = format!("write one of {}", quoted.join(", "));
    Explanation { missing: None, what: format!("found {found}"), remedy }
}

/// The name and the valid names in "unknown field `x`, expected `a` or `b`".
fn unknown(message: &str, prefix: &str) -> Option<(String, Vec<String>)> {
    let rest = message.strip_prefix(prefix)?;
    // The name may hold anything, backticks and ", expected" too; what follows it may not.
    let (name, valid) = rest.rsplit_once("`, expected ").unwrap_or((rest, ""));
    let valid = valid.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    Some((name.trim_matches('`').to_owned(), valid))
}

/// The nearest of the names possible, and all of them.
pub(super) fn suggest(name: &str, valid: &[String], kind: &str) -> String {
    let list = valid.join(", ");
    // More than half of it changed is no slip of the finger.
    let near = valid
        .iter()
        .map(|v| (edits(&name.to_lowercase(), v), v))
        .filter(|(edits, v)| *edits * 2 <= v.chars().count())
        .min_by_key(|(edits, _)| *edits);
    match near {
        Some((_, near)) => format!("did you mean {near:?}? {kind} here: {list}"),
        None => format!("{kind} here: {list}"),
    }
}

/// Returns the number of letters to add, drop or change to get from one name to the other
/// (Levenshtein 1966).
fn edits(from: &str, to: &str) -> usize {
    // A name of a kilobyte is like none of ours, and would only cost time.
    let from: Vec<char> = from.chars().take(64).collect();
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, a) in from.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in to.iter().enumerate() {
            let changed = diagonal + usize::from(a != b);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[to.len()]
}

fn found_words(found: &str) -> String {
    let (kind, rest) = found.split_once(' ').unwrap_or((found, ""));
    let value = rest.trim_start_matches("point ").trim_matches('`');
    // Of numbers beyond 64 bits serde says how it held them.
    let value = value.split_once("` as ").map_or(value, |(number, _)| number);
    match kind {
        "string" => format!("the text {value}"),
        "integer" | "floating" => format!("the number {value}"),
        "boolean" => value.to_owned(),
        "sequence" => "a list".to_owned(),
        "map" => "a table or a date".to_owned(),
        count if count.parse::<usize>().is_ok() => format!("{count} of them"),
        _ => found.to_owned(),
    }
}

fn expected_words(expected: &str) -> String {
    match expected {
        "f64" => "a number".to_owned(),
        "u32" => format!("a whole number from 0 to {}", u32::MAX),
        "a string" => "a text in quotes, \"like this\"".to_owned(),
        "a sequence" => "a list, [a, b, …]".to_owned(),
        "a list of 2 numbers" => "a list of 2 numbers, [a, b]".to_owned(),
        "a list of 3 numbers" => "a list of 3 numbers, [x, y, z]".to_owned(),
        "a list of 4 numbers" => "a list of 4 numbers, [a, b, c, d]".to_owned(),
        "a list of 4 points" => "a list of 4 points, [[x, y], [x, y], [x, y], [x, y]]".to_owned(),
        "a list of 3 rows" => "a list of 3 rows, [[a, b, c], [a, b, c], [a, b, c]]".to_owned(),
        "a boolean" => "true or false".to_owned(),
        _ if expected.starts_with("struct ") => "a table of its own".to_owned(),
        _ => expected.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        assert_eq!(edits("colums", "columns"), 1);
        assert_eq!(edits("", "rows"), 4);
        assert_eq!(edits("rows", "rows"), 0);
        assert_eq!(edits("kitten", "sitting"), 3);
    }

    #[test]
    fn far_names_get_no_suggestion() {
        let valid = ["columns".to_owned(), "rows".to_owned()];
        assert_eq!(suggest("zzz", &valid, "keys"), "keys here: columns, rows");
        let near = suggest("Row", &valid, "keys");
        assert_eq!(near, "did you mean \"rows\"? keys here: columns, rows");
    }

    #[test]
    fn numbers_of_any_size_are_repeated() {
        let what = |found| from_serde(&format!("invalid type: {found}, expected u32")).what;
        assert_eq!(what("integer `-1`"), "found the number -1");
        let large = "18446744073709551616";
        assert_eq!(
            what(&format!("integer `{large}` as i128")),
            format!("found the number {large}")
        );
    }

    #[test]
    fn a_name_with_backticks_is_taken_whole() {
        let (name, valid) =
            unknown("unknown field `a`, expected `b`, expected `c` or `d`", "unknown field ")
                .unwrap();
        assert_eq!((name.as_str(), valid.len()), ("a`, expected `b", 2));
    }
}
