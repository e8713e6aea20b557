//! The manager's secret: a file that only its owner reads.
//!
//! One user of a machine has one token, so that manager, servers and clients may start in any
//! order. Other machines are given a copy.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use polyptych_files::private_file;

/// Names the token's file, where it is not to lie in the user's state folder.
pub const TOKEN_FILE_VARIABLE: &str = "POLYPTYCH_TOKEN_FILE";

/// Largest token that is read: ours have 32 characters.
const TOKEN_BYTES_MAX: u64 = 256;

/// The reason why there is no token.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The manager makes it when it starts.
    #[error(
        "{path} is not there, or is empty; the manager makes it when it starts as the same user, \
         without --keys"
    )]
    NotThere {
        /// The file.
        path: PathBuf,
    },
    /// The file system says so.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Other users can read it, or own it.
    #[error("{0}")]
    Open(String),
    /// The file holds something else.
    #[error("{path} holds no token of 16 to 256 characters; remove it and start the manager")]
    Malformed {
        /// The file.
        path: PathBuf,
    },
    /// There is no folder to put it in.
    #[error("neither {TOKEN_FILE_VARIABLE}, XDG_STATE_HOME nor HOME says where the token lies")]
    Nowhere,
}

/// Returns the token's path: `POLYPTYCH_TOKEN_FILE`, or `polyptych/token` in the user's state
/// folder.
///
/// # Errors
/// [`TokenError::Nowhere`] where the environment names no folder.
pub fn default_path() -> Result<PathBuf, TokenError> {
    let from = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(path) = from(TOKEN_FILE_VARIABLE) {
        return Ok(path);
    }
    let state = from("XDG_STATE_HOME").or_else(|| from("HOME").map(|h| h.join(".local/state")));
    state.map(|folder| folder.join("polyptych/token")).ok_or(TokenError::Nowhere)
}

/// The token in this file. An empty one, as a power cut may leave it, counts as not there.
///
/// # Errors
/// [`TokenError`] where it is not there or no token.
pub fn read(path: &Path) -> Result<String, TokenError> {
    let io_error = |source| TokenError::Io { path: path.to_owned(), source };
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(TokenError::NotThere { path: path.to_owned() });
        }
        Err(error) => return Err(io_error(error)),
        // A device has no length and no end either.
        Ok(facts) if !facts.is_file() || facts.len() > TOKEN_BYTES_MAX => {
            return Err(TokenError::Malformed { path: path.to_owned() });
        }
        Ok(facts) => {
            if let Some(fault) = private_file::fault(path, &facts) {
                return Err(TokenError::Open(fault));
            }
            if facts.len() == 0 {
                return Err(TokenError::NotThere { path: path.to_owned() });
            }
        }
    }
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(io_error)?;
    file.take(TOKEN_BYTES_MAX).read_to_end(&mut bytes).map_err(io_error)?;
    let text = String::from_utf8_lossy(&bytes).trim().to_owned();
    let is_token = text.len() >= 16 && text.chars().all(|c| c.is_ascii_alphanumeric());
    is_token.then_some(text).ok_or_else(|| TokenError::Malformed { path: path.to_owned() })
}

/// The token in this file, which is made from `secret` where it is not there.
///
/// # Errors
/// [`TokenError`] where it can't be read or made.
pub fn read_or_create(path: &Path, secret: [u8; 16]) -> Result<String, TokenError> {
    match read(path) {
        Err(TokenError::NotThere { .. }) => {}
        other => return other,
    }
    let text = format!("{:032x}", u128::from_be_bytes(secret));
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let io_error = |source| TokenError::Io { path: path.to_owned(), source };
    fs::create_dir_all(folder).map_err(io_error)?;
    // A temporary file has mode 0600 from its first byte; persisting keeps it.
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(io_error)?;
    file.write_all(text.as_bytes()).map_err(io_error)?;
    // The bytes are on the disk before the name is: after a power cut no name is without them.
    file.as_file().sync_all().map_err(io_error)?;
    let Err(taken) = file.persist_noclobber(path) else { return Ok(text) };
    // Managers look at it one after the other, so that only the first replaces an empty one. If
    // the file system has no locks, two that start at the same moment may differ.
    let present = fs::File::open(path).map_err(io_error)?;
    let _ = present.lock();
    match read(path) {
        Err(TokenError::NotThere { .. }) => {
            taken.file.persist(path).map_err(|failed| io_error(failed.error))?;
            Ok(text)
        }
        // Another manager was faster: its token holds for both.
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_made_once_and_only_its_owner_reads_it() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("state/token");
        assert!(matches!(read(&path), Err(TokenError::NotThere { .. })));
        let made = read_or_create(&path, [0xab; 16]).expect("made");
        assert_eq!(read_or_create(&path, [0xcd; 16]).expect("read"), made);
        let mode = fs::metadata(&path).expect("facts").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("changed");
        let open = read(&path).expect_err("others can read it").to_string();
        assert!(open.contains("run: chmod 600"), "{open}");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("changed");
        fs::write(&path, "short").expect("overwritten");
        assert!(matches!(read(&path), Err(TokenError::Malformed { .. })));
    }

    #[test]
    fn an_empty_file_is_replaced_by_one_with_a_token() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("token");
        fs::write(&path, "").expect("made");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("changed");
        assert!(matches!(read(&path), Err(TokenError::NotThere { .. })));
        let made = read_or_create(&path, [0xab; 16]).expect("made");
        assert_eq!(made, "ab".repeat(16));
        assert_eq!(read_or_create(&path, [0xcd; 16]).expect("read"), made);
        let mode = fs::metadata(&path).expect("facts").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }
}
