//! Rust source with comments and the contents of strings blanked out, so that a rule about code is
//! not broken by a sentence about it.

/// The context of a byte in the source.
#[derive(Clone, Copy)]
enum SourceContext {
    Code,
    LineComment,
    BlockComment { depth: usize },
    Text { hashes: Option<usize> },
}

/// The source with blanks for comments, strings and characters; lines keep their numbers.
pub fn code_of(source: &str) -> String {
    let bytes = source.as_bytes();
    let mut code = Vec::with_capacity(bytes.len());
    let mut place = SourceContext::Code;
    while code.len() < bytes.len() {
        let rest = &bytes[code.len()..];
        let before = code.last().copied();
        let (next, taken, is_kept) = step(place, rest, before);
        place = next;
        for &byte in &rest[..taken.min(rest.len())] {
            code.push(if is_kept || byte == b'\n' { byte } else { b' ' });
        }
    }
    String::from_utf8_lossy(&code).into_owned()
}

/// The place behind the next few bytes, how many they are, and whether they are code.
fn step(place: SourceContext, rest: &[u8], before: Option<u8>) -> (SourceContext, usize, bool) {
    match place {
        SourceContext::Code => step_in_code(rest, before),
        SourceContext::LineComment if rest[0] == b'\n' => (SourceContext::Code, 1, false),
        SourceContext::LineComment => (SourceContext::LineComment, 1, false),
        SourceContext::BlockComment { depth } if rest.starts_with(b"/*") => {
            (SourceContext::BlockComment { depth: depth + 1 }, 2, false)
        }
        SourceContext::BlockComment { depth: 1 } if rest.starts_with(b"*/") => {
            (SourceContext::Code, 2, false)
        }
        SourceContext::BlockComment { depth } if rest.starts_with(b"*/") => {
            (SourceContext::BlockComment { depth: depth - 1 }, 2, false)
        }
        SourceContext::BlockComment { depth } => (SourceContext::BlockComment { depth }, 1, false),
        SourceContext::Text { hashes: None } if rest[0] == b'\\' => {
            (SourceContext::Text { hashes: None }, 2, false)
        }
        SourceContext::Text { hashes } if rest[0] == b'"' => {
            let end = 1 + hashes.unwrap_or(0);
            if rest.len() >= end && rest[1..end].iter().all(|&byte| byte == b'#') {
                (SourceContext::Code, end, false)
            } else {
                (SourceContext::Text { hashes }, 1, false)
            }
        }
        SourceContext::Text { hashes } => (SourceContext::Text { hashes }, 1, false),
    }
}

fn step_in_code(rest: &[u8], before: Option<u8>) -> (SourceContext, usize, bool) {
    if rest.starts_with(b"//") {
        return (SourceContext::LineComment, 2, false);
    }
    if rest.starts_with(b"/*") {
        return (SourceContext::BlockComment { depth: 1 }, 2, false);
    }
    if rest[0] == b'"' {
        return (SourceContext::Text { hashes: None }, 1, false);
    }
    if rest[0] == b'r' && !before.is_some_and(is_identifier_but_b) {
        let hashes = rest[1..].iter().take_while(|&&byte| byte == b'#').count();
        if rest.get(1 + hashes) == Some(&b'"') {
            return (SourceContext::Text { hashes: Some(hashes) }, 2 + hashes, false);
        }
    }
    if rest[0] == b'\'' {
        let length = character_length(rest);
        return (SourceContext::Code, length, length == 1);
    }
    (SourceContext::Code, 1, true)
}

/// `br"` begins a raw string too.
fn is_identifier_but_b(byte: u8) -> bool {
    byte != b'b' && (byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Bytes of the character literal that begins here; one, the quote itself, for a lifetime.
fn character_length(rest: &[u8]) -> usize {
    if rest.get(1) == Some(&b'\\') {
        return rest.iter().skip(3).position(|&byte| byte == b'\'').map_or(1, |at| at + 4);
    }
    // A character has at most four bytes; what a lifetime has behind its name is no quote.
    let end = rest.iter().skip(2).take(4).position(|&byte| byte == b'\'');
    match end {
        Some(at) if std::str::from_utf8(&rest[1..at + 2]).is_ok_and(|s| s.chars().count() == 1) => {
            at + 3
        }
        _ => 1,
    }
}

/// The lines, counted from one, where `word` stands by itself.
///
/// At an end where `word` has a letter, no letter may follow; a `word` that ends in `::` may not
/// be a middle part of a longer path.
pub fn lines_with(code: &str, word: &str) -> Vec<usize> {
    let is_letter = |c: char| c.is_alphanumeric() || c == '_';
    let mut lines: Vec<usize> = code
        .match_indices(word)
        .filter(|(start, _)| {
            let before = code[..*start].chars().next_back();
            let behind = code[start + word.len()..].chars().next();
            let joins_before = word.starts_with(is_letter) && before.is_some_and(is_letter);
            let joins_behind = word.ends_with(is_letter) && behind.is_some_and(is_letter);
            let is_inner_part = word.ends_with("::") && before == Some(':');
            !joins_before && !joins_behind && !is_inner_part
        })
        .map(|(start, _)| code[..start].matches('\n').count() + 1)
        .collect();
    lines.dedup();
    lines
}

/// The code of the module of tests; nothing where there is none.
pub fn tests_only(code: &str) -> &str {
    &code[start_of_tests(code)..]
}

fn start_of_tests(code: &str) -> usize {
    code.match_indices("#[cfg(test)]")
        .find(|(start, _)| {
            let item = code[start + "#[cfg(test)]".len()..].trim_start();
            item.strip_prefix("mod tests").is_some_and(|rest| rest.trim_start().starts_with('{'))
        })
        .map_or(code.len(), |(start, _)| start)
}

#[test]
fn comments_strings_and_characters_are_blanked() {
    let code = code_of(concat!(
        "a // tokio\n",
        "/* b /* c */ tokio */ d\n",
        "\"tokio \\\" // e\" f\n",
        "r#\"tokio\" \"# g br\"h\" '\\'' '\"' '\\u{41}' 'ä' <'life> i",
    ));
    let words: Vec<&str> = code.split_whitespace().collect();
    assert_eq!(words, ["a", "d", "f", "g", "b", "<'life>", "i"]);
    assert_eq!(code.lines().count(), 4);
}
