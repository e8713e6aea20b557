//! Words as a shell reads them back.

/// Returns a word so that a POSIX shell takes it as one word, unchanged.
pub(crate) fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "@%_+:,./-".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// Returns a command line of these words.
pub(crate) fn line<'w>(words: impl IntoIterator<Item = &'w str>) -> String {
    words.into_iter().map(quoted).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_back_every_word() {
        let words =
            ["plain", "", "two words", "it's", "$HOME `id` \"x\" \\", "a;b|c&d", "ü*?~#!", "-x=1"];
        let script = format!("for word in {}; do printf '%s\\n' \"$word\"; done", line(words));
        let output = std::process::Command::new("/bin/sh").args(["-c", &script]).output();
        let output = output.expect("a shell");
        let read = String::from_utf8(output.stdout).expect("text");
        assert_eq!(read.lines().collect::<Vec<_>>(), words);
        assert_eq!(quoted("/usr/bin/polyptych"), "/usr/bin/polyptych");
    }
}
