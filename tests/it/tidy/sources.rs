//! The rules for single source files: heads, lengths, names, and what code must not contain.

use super::code::{code_of, lines_with, tests_only};
use super::tree::{Tree, is_test_file};

/// A file longer than this has a second noun in it.
const LINES_MAX: usize = 500;

/// Tests are lists of cases, and longer.
const TEST_LINES_MAX: usize = 600;

/// Maximum length of a line, as in rustfmt.toml, which leaves comments, strings and shaders alone.
const COLUMNS_MAX: usize = 100;

/// Names that say nothing about what is inside.
const NAMES_REFUSED: &[&str] =
    &["mod.rs", "utils.rs", "util.rs", "helpers.rs", "types.rs", "common.rs", "misc.rs"];

/// Code that must not stand anywhere, and what does instead.
const CODE_REFUSED: &[(&str, &str)] = &[
    ("todo!", "write it, or leave it out"),
    ("unimplemented!", "write it, or leave it out"),
    ("dbg!", "use tracing, or remove it"),
    ("#[ignore", "a test that is not run is not a test"),
    ("#[allow(", "use #[expect(.., reason = \"..\")], which says when it is no longer needed"),
    ("#![allow(", "use #![expect(.., reason = \"..\")], which says when it is no longer needed"),
];

/// Every file begins with what it is.
pub fn heads(tree: &Tree) -> Vec<String> {
    let without = |ending: &'static str, head: &'static str| {
        tree.with_ending(&[ending])
            .filter(move |file| !file.text.trim_start().starts_with(head))
            .map(move |file| {
                format!("{}: does not begin with a `{head}` that says what it is", file.path)
            })
            .collect::<Vec<_>>()
    };
    [without("rs", "//!"), without("py", "\"\"\"")].concat()
}

/// Files fit in the head, lines on the screen.
pub fn lengths(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for file in tree.with_ending(&["rs", "wgsl", "py"]) {
        let max = if is_test_file(&file.path) { TEST_LINES_MAX } else { LINES_MAX };
        let lines = file.text.lines().count();
        if lines > max {
            offences.push(format!("{}: {lines} lines, at most {max}: split it", file.path));
        }
        for (number, line) in (1..).zip(file.text.lines()) {
            let columns = line.chars().count();
            if columns > COLUMNS_MAX {
                offences.push(format!(
                    "{}:{number}: {columns} columns, at most {COLUMNS_MAX}",
                    file.path
                ));
            }
        }
    }
    offences
}

/// A file is named for the one thing in it.
pub fn names(tree: &Tree) -> Vec<String> {
    tree.with_ending(&["rs"])
        .filter(|file| NAMES_REFUSED.iter().any(|name| file.path.rsplit('/').next() == Some(name)))
        .map(|file| format!("{}: name it for the one thing in it", file.path))
        .collect()
}

/// Nothing unfinished, nothing switched off, no glob re-export.
pub fn code_refused(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for file in tree.with_ending(&["rs"]) {
        let code = code_of(&file.text);
        for (word, instead) in CODE_REFUSED {
            for line in lines_with(&code, word) {
                offences.push(format!("{}:{line}: `{word}`: {instead}", file.path));
            }
        }
        for (number, line) in (1..).zip(code.lines()) {
            let line = line.trim();
            if line.starts_with("pub use ") && line.ends_with("::*;") {
                offences.push(format!("{}:{number}: `{line}`: name what it exports", file.path));
            }
        }
    }
    offences
}

/// Tests wait for what they test, never for a time.
pub fn sleeps(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for file in tree.with_ending(&["rs"]) {
        let code = code_of(&file.text);
        let tests = if is_test_file(&file.path) { &code } else { tests_only(&code) };
        let lines_before = code[..code.len() - tests.len()].matches('\n').count();
        for line in lines_with(tests, "sleep(") {
            offences.push(format!(
                "{}:{}: `sleep(` in a test: wait for what is tested, with a deadline",
                file.path,
                line + lines_before
            ));
        }
    }
    offences
}

/// The project runs where it is unpacked.
pub fn machine_paths(tree: &Tree) -> Vec<String> {
    // Put together here, so that this file does not hold them.
    let roots = ["work", "root", "home", "tmp"].map(|name| format!("/{name}/"));
    let mut offences = Vec::new();
    for file in &tree.files {
        for (number, line) in (1..).zip(file.text.lines()) {
            for root in &roots {
                let is_absolute = line.match_indices(root.as_str()).any(|(at, _)| {
                    let before = line[..at].chars().next_back();
                    !before.is_some_and(|c| c.is_alphanumeric() || "._-*}".contains(c))
                });
                if is_absolute {
                    offences.push(format!("{}:{number}: a path of one machine: {root}", file.path));
                }
            }
        }
    }
    offences
}
