//! The rules for the documents: what they must name, and that their links lead somewhere.

use super::code::lines_with;
use super::tree::Tree;

/// Longer than this, nobody reads it to the end.
const ARCHITECTURE_LINES_MAX: usize = 150;

/// The first page is short; the rest is in `docs`.
const README_LINES_MAX: usize = 100;

const ARCHITECTURE: &str = "ARCHITECTURE.md";
/// Files of numbers that both ends of a connection must agree on.
const LIMITS: &[&str] =
    &["protocol/src/limits.rs", "protocol/scene/src/limits.rs", "protocol/wall/src/limits.rs"];

/// Files that people and tools look for by name.
const REQUIRED: &[(&str, &str)] = &[
    ("README.md", "the first page"),
    (ARCHITECTURE, "the design, its invariants and limits"),
    ("CHANGELOG.md", "what changes for those who upgrade"),
    ("LICENSE-MIT", "one of the two licences"),
    ("LICENSE-APACHE", "one of the two licences"),
    ("deny.toml", "what is accepted of other people's crates"),
    ("clippy.toml", "the limits of the lints"),
    ("run", "the two commands of a fresh checkout"),
    (".ci/run", "everything that a change must pass"),
];

/// The furniture is there.
pub fn required(tree: &Tree) -> Vec<String> {
    REQUIRED.iter().filter_map(|(path, what)| tree.required(path, what).err()).collect()
}

/// README.md and ARCHITECTURE.md are short, and the latter names every folder at the top.
pub fn architecture(tree: &Tree) -> Vec<String> {
    // Where it is missing, `required` says so.
    let Ok(text) = tree.required(ARCHITECTURE, "") else { return Vec::new() };
    let mut offences = Vec::new();
    let lines = text.lines().count();
    if lines > ARCHITECTURE_LINES_MAX {
        offences.push(format!("{ARCHITECTURE}: {lines} lines, at most {ARCHITECTURE_LINES_MAX}"));
    }
    let readme = tree.required("README.md", "").map_or(0, |text| text.lines().count());
    if readme > README_LINES_MAX {
        offences.push(format!("README.md: {readme} lines, at most {README_LINES_MAX}"));
    }
    let mut folders: Vec<&str> = tree
        .files
        .iter()
        .filter_map(|file| file.path.split_once('/').map(|(folder, _)| folder))
        .filter(|folder| !folder.starts_with('.'))
        .collect();
    folders.dedup();
    for folder in folders {
        if !text.contains(&format!("`{folder}`")) && !text.contains(&format!("{folder}/")) {
            offences.push(format!("{ARCHITECTURE}: does not name the folder `{folder}`"));
        }
    }
    offences
}

/// Every number of a `limits.rs` stands in ARCHITECTURE.md's table of limits.
pub fn limits(tree: &Tree) -> Vec<String> {
    let Ok(text) = tree.required(ARCHITECTURE, "") else { return Vec::new() };
    let mut offences = Vec::new();
    for path in LIMITS {
        match tree.required(path, "numbers that both ends must agree on") {
            Err(missing) => offences.push(missing),
            Ok(limits) => {
                let names = limits.lines().filter_map(|line| line.strip_prefix("pub const "));
                let names = names.filter_map(|name| name.split(':').next());
                let lacking = names.filter(|name| lines_with(text, name).is_empty());
                offences.extend(lacking.map(|name| {
                    format!("{ARCHITECTURE}: its table of limits lacks {name} of {path}")
                }));
            }
        }
    }
    offences
}

/// Links to other files of the repository lead to one.
pub fn links(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for file in tree.with_ending(&["md"]) {
        let folder = file.path.rsplit_once('/').map_or("", |(folder, _)| folder);
        for (number, target) in relative_links(&file.text) {
            let target = target.split('#').next().unwrap_or_default();
            if !target.is_empty() && !tree.has(&joined(folder, target)) {
                offences.push(format!("{}:{number}: {target} does not exist", file.path));
            }
        }
    }
    offences
}

/// Line number and target of every link and picture that does not name a server.
fn relative_links(text: &str) -> Vec<(usize, &str)> {
    let mut links = Vec::new();
    let mut is_in_fence = false;
    for (number, line) in (1..).zip(text.lines()) {
        is_in_fence ^= line.trim_start().starts_with("```");
        if is_in_fence {
            continue;
        }
        for (opening, closing) in [("](", ')'), ("src=\"", '"'), ("href=\"", '"')] {
            for (at, _) in line.match_indices(opening) {
                let rest = &line[at + opening.len()..];
                let target = rest.split([closing, ' ']).next().unwrap_or_default();
                if !target.contains("://") && !target.starts_with("mailto:") {
                    links.push((number, target));
                }
            }
        }
    }
    links
}

/// `target` as seen from `folder`, as a path from the top.
fn joined(folder: &str, target: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.join("/")
}
