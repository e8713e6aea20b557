//! Files that a person asked for by name: pictures, reports, wall files, scenes.
//!
//! A file appears whole or not at all: it is written beside its place and renamed. Only regular
//! files are replaced. A rename over a device, FIFO or socket would turn it into a regular file,
//! for every program of the machine if the user is root.

use std::fs::{self, File, FileType, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Permissions of a new file, before the process's umask.
const MODE: u32 = 0o644;

/// Writes a file. One that exists keeps its permissions; a symbolic link to it stays a link.
///
/// # Errors
/// The reasons of [`check`], or the system's reason.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    place(path, bytes, |_| Ok(()))
}

/// Writes a file as [`write()`] does; its content is on the disk before its name.
///
/// # Errors
/// The reasons of [`check`], or the system's reason.
pub fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    place(path, bytes, File::sync_all)
}

fn place(
    path: &Path,
    bytes: &[u8],
    finish: impl FnOnce(&File) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = OutputFile::create(path)?;
    file.write_all(bytes)?;
    finish(file.file.as_file())?;
    file.finish()
}

/// A file that is written in parts, and appears with [`OutputFile::finish`] or not at all.
#[derive(Debug)]
pub struct OutputFile {
    file: NamedTempFile,
    path: PathBuf,
}

impl OutputFile {
    /// Begins a file as [`write()`] does.
    ///
    /// # Errors
    /// The reasons of [`check`], or the system's reason.
    pub fn create(path: &Path) -> io::Result<Self> {
        let (path, existing) = resolve(path)?;
        let mode = existing.map_or(MODE, |facts| facts.permissions().mode() & 0o777);
        let file = tempfile::Builder::new()
            .permissions(Permissions::from_mode(MODE))
            .tempfile_in(folder_of(&path))?;
        if mode != MODE {
            file.as_file().set_permissions(Permissions::from_mode(mode))?;
        }
        Ok(Self { file, path })
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// The system's reason.
    pub fn finish(self) -> io::Result<()> {
        self.file.persist(&self.path).map_err(|error| error.error)?;
        Ok(())
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Checks that a file can be written at this path: nothing is there, or a regular file, or a
/// symbolic link to one; and its folder exists.
///
/// # Errors
/// The error says what is there instead, and the fix. The path is not named.
pub fn check(path: &Path) -> io::Result<()> {
    resolve(path).map(drop)
}

/// Makes a folder for several files, with its parents. One that exists is used.
///
/// # Errors
/// The error says what is there instead, and the fix, or gives the system's reason. The path is not
/// named.
pub fn make_folder(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(facts) if facts.is_dir() => Ok(()),
        Ok(facts) => {
            let kind = kind_of(facts.file_type());
            Err(refusal(format!("it is {kind}, not a folder; name another folder")))
        }
        Err(_) => fs::create_dir_all(path),
    }
}

/// Returns what a type of file is called, with its article.
pub fn kind_of(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a FIFO"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_char_device() || kind.is_block_device() {
        "a device"
    } else if kind.is_symlink() {
        "a symbolic link"
    } else {
        "a regular file"
    }
}

/// Returns the path behind a symbolic link, and what is known of the file if it exists.
fn resolve(path: &Path) -> io::Result<(PathBuf, Option<Metadata>)> {
    let facts = match fs::symlink_metadata(path) {
        Ok(facts) => facts,
        Err(error) if error.kind() == ErrorKind::NotFound => return resolve_new(path),
        Err(error) => return Err(error),
    };
    let kind = facts.file_type();
    if kind.is_file() {
        return Ok((path.to_owned(), Some(facts)));
    }
    if !kind.is_symlink() {
        let kind = kind_of(kind);
        return Err(refusal(format!("it is {kind}, not a regular file; name another file")));
    }
    let target = fs::read_link(path)?;
    let folder = fs::canonicalize(folder_of(path))?;
    if [&target, &folder].into_iter().any(|path| path.starts_with("/proc")) {
        // Behind `> FILE` it would be that file, which others go on writing to.
        return Err(refusal("it is an open file of a process; name a file".to_owned()));
    }
    let what = match fs::metadata(path) {
        Ok(facts) if facts.is_file() => return Ok((fs::canonicalize(path)?, Some(facts))),
        Ok(facts) => format!("which is {}", kind_of(facts.file_type())),
        Err(error) if error.kind() == ErrorKind::NotFound => "which does not exist".to_owned(),
        Err(error) => format!("which cannot be followed: {error}"),
    };
    let target = target.display();
    Err(refusal(format!("it is a symbolic link to {target}, {what}; name a regular file")))
}

/// Checks that a new file has a folder.
fn resolve_new(path: &Path) -> io::Result<(PathBuf, Option<Metadata>)> {
    let folder = folder_of(path);
    let name = folder.display();
    if path.file_name().is_none() {
        return Err(refusal("it is not the name of a file; name a file".to_owned()));
    }
    match fs::metadata(folder) {
        Ok(facts) if facts.is_dir() => Ok((path.to_owned(), None)),
        Ok(facts) => {
            let kind = kind_of(facts.file_type());
            Err(refusal(format!("{name} is {kind}, not a folder; name another folder")))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            Err(refusal(format!("the folder {name} does not exist; make it first")))
        }
        Err(error) => Err(error),
    }
}

fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

fn refusal(reason: String) -> io::Error {
    io::Error::new(ErrorKind::InvalidInput, reason)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;
    use std::process::Command;

    use super::*;

    fn mode_of(path: &Path) -> u32 {
        fs::metadata(path).expect("there").permissions().mode() & 0o777
    }

    #[test]
    fn replaces_a_regular_file_and_keeps_its_permissions_and_links() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        write(&file, b"one").expect("written");
        assert_eq!(fs::read(&file).expect("read"), b"one");
        fs::set_permissions(&file, Permissions::from_mode(0o600)).expect("set");
        symlink("file", &link).expect("linked");
        write(&link, b"two").expect("written");
        assert_eq!((fs::read(&file).expect("read"), mode_of(&file)), (b"two".to_vec(), 0o600));
        assert_eq!(fs::read_link(&link).expect("still a link"), Path::new("file"));
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 2, "nothing is left");
    }

    #[test]
    fn refuses_what_is_not_a_regular_file_and_leaves_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("folder")).expect("made");
        let made = Command::new("mkfifo").arg(at("fifo")).status().expect("mkfifo");
        assert!(made.success());
        let _socket = UnixListener::bind(at("socket")).expect("bound");
        for (name, target) in [
            ("to-folder", "folder"),
            ("to-fifo", "fifo"),
            ("to-device", "/dev/full"),
            ("to-nothing", "nothing"),
            ("to-itself", "to-itself"),
        ] {
            symlink(target, at(name)).expect("linked");
        }
        for (name, reason) in [
            ("folder", "it is a folder, not a regular file"),
            ("fifo", "it is a FIFO, not a regular file"),
            ("socket", "it is a socket, not a regular file"),
            ("to-folder", "a symbolic link to folder, which is a folder"),
            ("to-fifo", "a symbolic link to fifo, which is a FIFO"),
            ("to-device", "a symbolic link to /dev/full, which is a device"),
            ("to-nothing", "a symbolic link to nothing, which does not exist"),
            ("to-itself", "a symbolic link to to-itself, which cannot be followed"),
            ("missing/file", "missing does not exist; make it first"),
            ("fifo/file", "Not a directory"),
            ("..", "it is a folder"),
        ] {
            let path = at(name);
            let before = fs::symlink_metadata(&path).map(|facts| facts.file_type()).ok();
            for refused in [check(&path), write(&path, b"lost")] {
                let said = refused.expect_err("refused").to_string();
                assert!(said.contains(reason), "{name}: {said}");
            }
            let after = fs::symlink_metadata(&path).map(|facts| facts.file_type()).ok();
            assert_eq!(before, after, "{name}");
        }
        for path in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
            let said = check(Path::new(path)).expect_err("refused").to_string();
            assert!(said.contains("it is an open file of a process"), "{path}: {said}");
        }
    }

    #[test]
    fn makes_folders_and_refuses_what_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let new = folder.path().join("a/b");
        for _ in 0..2 {
            make_folder(&new).expect("a folder");
        }
        let file = new.join("file");
        write(&file, b"").expect("written");
        let said = make_folder(&file).expect_err("refused").to_string();
        assert!(said.contains("it is a regular file, not a folder"), "{said}");
    }
}
