//! Files that other systems start a wall with, and the writing of them into a folder.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::plan::LaunchPlan;
use crate::outputs;

/// The folder of the sockets of X displays, on every system.
pub(super) const X_SOCKETS: &str = concat!("/tmp", "/.X11-unix");

/// A file to write.
#[derive(Debug)]
pub(crate) struct UnitFile {
    /// Its path in the folder that a person named.
    pub path: PathBuf,
    pub text: String,
    pub is_executable: bool,
}

impl UnitFile {
    pub fn new(path: impl Into<PathBuf>, text: String) -> Self {
        Self { path: path.into(), text, is_executable: false }
    }

    pub fn script(path: impl Into<PathBuf>, text: String) -> Self {
        Self { path: path.into(), text, is_executable: true }
    }
}

/// Files, and the steps in which a person uses them.
#[derive(Debug, Default)]
pub(crate) struct UnitFiles {
    pub files: Vec<UnitFile>,
    /// The steps, one a line, with `{DIR}` for the folder.
    pub steps: Vec<String>,
}

impl UnitFiles {
    /// Writes all files below a folder. Nothing is written if one of them is there already.
    ///
    /// # Errors
    /// The path of the file that is there, or that cannot be written.
    pub fn write(&self, folder: &Path, force: bool) -> anyhow::Result<()> {
        for file in &self.files {
            let path = folder.join(&file.path);
            outputs::make_folder(path.parent().unwrap_or(folder))?;
            outputs::check_source(&path, force)?;
        }
        for file in &self.files {
            let path = folder.join(&file.path);
            outputs::write(&path, file.text.as_bytes())?;
            if file.is_executable {
                std::fs::set_permissions(&path, Permissions::from_mode(0o755))
                    .with_context(|| format!("cannot make {} executable", path.display()))?;
            }
        }
        Ok(())
    }
}

/// Returns the first line of a file that the command writes, as a comment.
pub(super) fn head(plan: &LaunchPlan, kind: &str) -> String {
    let file = plan.file.file_name().unwrap_or_default().to_string_lossy();
    // A name with a line break would end the comment, and the rest would be run.
    format!("# Written by polyptych unit {kind} from {}.\n", polyptych_text::printable(&file))
}

/// Returns the folder of a machine's files: its name in letters that every file system takes. It is
/// never hidden, nor a folder above.
pub(super) fn machine_folder(host: Option<&str>) -> String {
    let Some(host) = host else { return "here".to_owned() };
    let machine = host.rsplit_once('@').map_or(host, |(_, machine)| machine);
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let folder: String = machine.trim_matches(['[', ']']).chars().map(plain).collect();
    let is_taken = folder.is_empty() || folder.starts_with('.') || folder == "here";
    if is_taken { format!("_{folder}") } else { folder }
}

/// Returns a name as a DNS label: lower-case letters, digits and "-", 40 at most. A name that had
/// to be changed ends with a number that tells it from others which become the same.
pub(super) fn dns_label(name: &str) -> String {
    const LETTERS_MAX: usize = 40;
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    let label: String = name.chars().map(plain).collect();
    let trimmed = label.trim_matches('-');
    if trimmed == name && name.len() <= LETTERS_MAX {
        return label;
    }
    // FNV-1a of 32 bits, by Fowler, Noll and Vo: the same on every machine.
    let hash = name
        .bytes()
        .fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    let cut: String = trimmed.chars().take(LETTERS_MAX - 9).collect();
    format!("{cut}-{hash:08x}").trim_start_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_labels_that_differ() {
        assert_eq!(dns_label("front-1-1"), "front-1-1");
        let odd = ["Front", "front_", "a.b", "a_b", "-", &"x".repeat(64)];
        let labels = odd.map(dns_label);
        for label in &labels {
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            assert!(label.len() <= 40 && label.chars().all(letters), "{label}");
            assert!(!label.starts_with('-') && !label.ends_with('-'), "{label}");
        }
        let distinct: std::collections::BTreeSet<_> = labels.iter().collect();
        assert_eq!(distinct.len(), odd.len(), "{labels:?}");
        assert_eq!(machine_folder(Some("me@[fe80::1%eth0]")), "fe80__1_eth0");
        for above in ["..", "me@[..]", "[]", ".", "here"] {
            let folder = machine_folder(Some(above));
            assert!(folder.starts_with('_'), "{above}: {folder}");
        }
    }

    #[test]
    fn a_file_that_is_there_is_kept_and_nothing_else_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = vec![
            UnitFile::script("a/run.sh", "#!/bin/sh\n".to_owned()),
            UnitFile::new("b.txt", "new\n".to_owned()),
        ];
        let files = UnitFiles { files, steps: Vec::new() };
        std::fs::write(folder.path().join("b.txt"), "mine").expect("written");
        let error = files.write(folder.path(), false).expect_err("it is there").to_string();
        assert!(error.contains("b.txt is there already") && error.contains("--force"), "{error}");
        assert!(!folder.path().join("a/run.sh").exists());
        files.write(folder.path(), true).expect("written");
        let script = folder.path().join("a/run.sh");
        let mode = script.metadata().expect("facts").permissions().mode();
        assert_eq!(mode & 0o111, 0o111);
        assert_eq!(std::fs::read_to_string(folder.path().join("b.txt")).expect("text"), "new\n");
    }
}
