//! The repository as a list of paths and texts.

use std::fs;
use std::path::Path;

/// Build output and pictures; everything else is looked at.
const FOLDERS_SKIPPED: &[&str] =
    &["target", "out", "tests/fuzz/target", "tests/fuzz/corpus", "tests/fuzz/artifacts"];

/// Names that begin with a dot and are part of the project.
const HIDDEN_READ: &[&str] = &[".ci"];

/// Files whose text the rules may ask for.
const TEXT_ENDINGS: &[&str] = &["rs", "wgsl", "toml", "md", "json", "html", "py", "sh"];

/// One file.
pub struct File {
    /// From the top of the repository, with `/`.
    pub path: String,
    /// Empty where it is not text.
    pub text: String,
}

/// All files, sorted by path.
pub struct Tree {
    pub files: Vec<File>,
}

impl Tree {
    /// The repository that this test was built from.
    pub fn of_repository() -> Self {
        let mut files = Vec::new();
        read_folder(Path::new(env!("CARGO_MANIFEST_DIR")), "", &mut files);
        files.sort_by(|a, b| a.path.cmp(&b.path));
        Self { files }
    }

    /// A repository made for a test of the rules themselves.
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file =
            |(path, text): &(&str, &str)| File { path: (*path).into(), text: (*text).into() };
        Self { files: files.iter().map(file).collect() }
    }

    /// The files whose names end in one of `endings`.
    pub fn with_ending(&self, endings: &[&str]) -> impl Iterator<Item = &File> {
        self.files.iter().filter(move |file| has_ending(&file.path, endings))
    }

    /// The text of a file that must exist.
    ///
    /// # Errors
    /// The offence that it does not.
    pub fn required(&self, path: &str, what: &str) -> Result<&str, String> {
        let file = self.files.iter().find(|file| file.path == path);
        file.map(|file| file.text.as_str()).ok_or(format!("{path} is missing: it holds {what}"))
    }

    /// Returns whether a file or folder is at this path.
    pub fn has(&self, path: &str) -> bool {
        self.files.iter().any(|file| {
            file.path
                .strip_prefix(path)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        })
    }
}

/// Returns whether the path ends in a dot and one of `endings`.
fn has_ending(path: &str, endings: &[&str]) -> bool {
    path.rsplit_once('.').is_some_and(|(_, ending)| endings.contains(&ending))
}

/// Returns whether the file contains only tests.
pub fn is_test_file(path: &str) -> bool {
    path.starts_with("tests/") || path.contains("/tests/") || path.ends_with("/tests.rs")
}

fn read_folder(folder: &Path, prefix: &str, files: &mut Vec<File>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries.flatten() {
        let Ok(name) = entry.file_name().into_string() else { continue };
        let is_hidden = name.starts_with('.') && !HIDDEN_READ.contains(&name.as_str());
        let path = format!("{prefix}{name}");
        if entry.path().is_dir() {
            if !is_hidden && !FOLDERS_SKIPPED.contains(&path.as_str()) {
                read_folder(&entry.path(), &format!("{path}/"), files);
            }
        } else {
            let is_text = has_ending(&path, TEXT_ENDINGS) || name == "run";
            let text = if is_text { fs::read_to_string(entry.path()) } else { Ok(String::new()) };
            files.push(File { text: text.unwrap_or_default(), path });
        }
    }
}
