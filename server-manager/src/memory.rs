//! What a manager remembers over a restart: a small file that is there whole or not at all.
//!
//! ```text
//! PLYPSTAT | BLAKE3 of what follows, 32 bytes | encoded Memory
//! ```

use std::fs;
use std::io::{self, Read, Write};
use std::path::Path;

use polyptych_protocol::codec;
use polyptych_protocol::display::DisplayMode;
use polyptych_protocol::ids::BlobHash;

use crate::cluster::Memory;

/// Largest file that is read; ours have a few hundred bytes.
const MEMORY_BYTES_MAX: u64 = 64 << 10;

/// How the file begins: one that begins otherwise is another program's, and is not written over.
const MAGIC: [u8; 8] = *b"PLYPSTAT";

/// Whether this may be the file of a manager, or become it.
///
/// # Errors
/// What stands there instead.
pub(crate) fn check(path: &Path) -> Result<(), String> {
    let foreign = |what: &str| {
        let path = path.display();
        Err(format!("{path}: {what}, not a state file of a manager; name another or remove it"))
    };
    if path.is_dir() {
        return foreign("a folder");
    }
    let mut begin = Vec::new();
    let read = fs::File::open(path).and_then(|file| file.take(8).read_to_end(&mut begin));
    // What is not there, or was torn before it was whole, is made anew.
    if read.is_ok() && !MAGIC.starts_with(&begin) {
        return foreign("another file");
    }
    Ok(())
}

/// What was remembered in this file, or `None` where there is none, or nothing of use: a manager
/// that begins afresh is better than one that does not begin.
pub(crate) fn load(path: &Path) -> Option<Memory> {
    let warn = |reason: &dyn std::fmt::Display| {
        tracing::warn!(path = %path.display(), %reason, "what was remembered is of no use");
    };
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
        Err(error) => {
            warn(&error);
            return None;
        }
        Ok(facts) if facts.len() > MEMORY_BYTES_MAX || !facts.is_file() => {
            warn(&"it is not a file that a manager has written");
            return None;
        }
        Ok(_) => {}
    }
    let bytes = fs::read(path).map_err(|error| warn(&error)).ok()?;
    let whole = bytes.strip_prefix(&MAGIC).and_then(|rest| rest.split_at_checked(32));
    let Some((hash, memory)) = whole else {
        warn(&"it is cut short");
        return None;
    };
    if BlobHash::of(memory).0 != hash {
        warn(&"it was damaged");
        return None;
    }
    decode(memory).map_err(|error| warn(&error)).ok()
}

/// What the bytes say, which are known to be whole.
fn decode(memory: &[u8]) -> Result<Memory, codec::DecodeError> {
    codec::decode(memory).or_else(|error| {
        // The first managers remembered no display mode, which stands last.
        let normal = codec::encode(&DisplayMode::Normal);
        codec::decode(&[memory, &normal].concat()).map_err(|_| error)
    })
}

/// Writes what is to be remembered.
///
/// # Errors
/// The folder or the file can't be written.
pub(crate) fn save(path: &Path, memory: &Memory) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let bytes = codec::encode(memory);
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(&MAGIC)?;
    file.write_all(&BlobHash::of(&bytes).0)?;
    file.write_all(&bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::camera::Camera;
    use polyptych_protocol::ids::Revision;
    use polyptych_protocol::request::Pace;

    use super::*;

    #[test]
    fn what_is_saved_comes_back_and_damage_is_noticed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("state/wall");
        assert_eq!(load(&path), None);
        let memory = Memory {
            wall: BlobHash([7; 32]),
            revision: Revision(9),
            scene: None,
            camera: Camera { scale: 0.1, ..Camera::IDENTITY },
            eye: glam::DVec3::new(0.1, 1.6, 0.3),
            exposure: 1.5,
            pace: Some(Pace::Rate(60.0)),
            displays: DisplayMode::Blank,
        };
        save(&path, &memory).expect("saved");
        assert_eq!(load(&path).as_ref(), Some(&memory));
        let mut bytes = fs::read(&path).expect("read");
        for cut in [0, 10, 32, bytes.len() - 1] {
            fs::write(&path, &bytes[..cut]).expect("written");
            assert_eq!(load(&path), None, "cut to {cut} bytes");
        }
        bytes[50] ^= 1;
        fs::write(&path, &bytes).expect("written");
        assert_eq!((load(&path), check(&path)), (None, Ok(())));
        let foreign = folder.path().join("wall.toml");
        fs::write(&foreign, "[wall]").expect("written");
        for path in [folder.path(), &foreign] {
            assert!(check(path).is_err_and(|reason| reason.contains("name another")));
        }
    }

    #[test]
    fn a_file_of_a_manager_that_knew_no_display_modes_is_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        let memory = Memory {
            wall: BlobHash([7; 32]),
            revision: Revision(9),
            scene: None,
            camera: Camera::IDENTITY,
            eye: glam::DVec3::ZERO,
            exposure: 1.0,
            pace: None,
            displays: DisplayMode::Normal,
        };
        let now = codec::encode(&memory);
        let before = &now[..now.len() - 1];
        let hash = BlobHash::of(before).0;
        fs::write(&path, [&MAGIC[..], &hash, before].concat()).expect("written");
        assert_eq!(load(&path), Some(memory));
    }
}
