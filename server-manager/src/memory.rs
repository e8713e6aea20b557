//! What a manager remembers over a restart: a small file that is there whole or not at all.
//!
//! ```text
//! PLYPSTA2 | BLAKE3 of what follows, 32 bytes | encoded Memory
//! ```
//!
//! The last letter is the form: files of 0.1 and 0.2 end their name with T, and hold less.

use std::fs;
use std::io::{self, Read, Write};
use std::path::Path;

use glam::DVec3;
use polyptych_protocol::camera::Camera;
use polyptych_protocol::codec;
use polyptych_protocol::display::DisplayMode;
use polyptych_protocol::head::Head;
use polyptych_protocol::ids::{BlobHash, Revision};
use polyptych_protocol::limits::MESSAGE_BYTES_MAX;
use polyptych_protocol::log::SceneRef;
use polyptych_protocol::request::Pace;
use polyptych_protocol::wall::EYE_SEPARATION_DEFAULT_M;
use serde::{Deserialize, Serialize};

use crate::cluster::{Further, Memory};

/// Largest file that is read: ours have a few hundred bytes, and what was tuned of the wall, whose
/// description fits into a message.
const MEMORY_BYTES_MAX: u64 = MESSAGE_BYTES_MAX as u64;

/// How the file begins: one that begins otherwise is another program's, and is not written over.
const MAGIC: [u8; 8] = *b"PLYPSTA2";

/// How files of the first form begin.
const MAGIC_FIRST: [u8; 8] = *b"PLYPSTAT";

/// What the first managers remembered.
#[derive(Debug, Serialize, Deserialize)]
struct First {
    wall: BlobHash,
    revision: Revision,
    scene: Option<SceneRef>,
    camera: Camera,
    eye: DVec3,
    exposure: f32,
    pace: Option<Pace>,
    displays: DisplayMode,
}

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
    let is_ours = [MAGIC, MAGIC_FIRST].iter().any(|magic| magic.starts_with(&begin));
    if read.is_ok() && !is_ours {
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
    let is_first = bytes.starts_with(&MAGIC_FIRST);
    let magic = if is_first { MAGIC_FIRST } else { MAGIC };
    let whole = bytes.strip_prefix(&magic).and_then(|rest| rest.split_at_checked(32));
    let Some((hash, memory)) = whole else {
        warn(&"it is cut short");
        return None;
    };
    if BlobHash::of(memory).0 != hash {
        warn(&"it was damaged");
        return None;
    }
    let memory = if is_first { decode_first(memory) } else { codec::decode(memory) };
    memory.map_err(|error| warn(&error)).ok()
}

/// What bytes of the first form say, which are known to be whole.
fn decode_first(memory: &[u8]) -> Result<Memory, codec::DecodeError> {
    let first = codec::decode::<First>(memory).or_else(|error| {
        // The very first managers remembered no display mode, which stands last.
        let normal = codec::encode(&DisplayMode::Normal);
        codec::decode(&[memory, &normal].concat()).map_err(|_| error)
    })?;
    Ok(Memory {
        wall: first.wall,
        revision: first.revision,
        scene: first.scene,
        camera: first.camera,
        head: Head::at(first.eye, EYE_SEPARATION_DEFAULT_M),
        views: Vec::new(),
        exposure: first.exposure,
        pace: first.pace,
        displays: first.displays,
        further: Further::default(),
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
    use polyptych_protocol::command::View;
    use polyptych_protocol::pattern::Pattern;
    use polyptych_protocol::scene::Bounds;
    use polyptych_protocol::wall::Adjustment;

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
            head: Head::at(DVec3::new(0.1, 1.6, 0.3), 0.06),
            views: vec![View::of_wall(Camera::IDENTITY)],
            exposure: 1.5,
            pace: Some(Pace::Rate(60.0)),
            displays: DisplayMode::Blank,
            further: Further {
                bounds: Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE }),
                pattern: Some(Pattern::Grid),
                tunings: vec![("a".into(), Adjustment { mirror: true, ..Adjustment::default() })],
                tuned_wall: Some(BlobHash([8; 32])),
                notes: vec!["animations: 1 is not played".into()],
            },
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
    fn files_of_the_first_managers_are_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        let first = First {
            wall: BlobHash([7; 32]),
            revision: Revision(9),
            scene: None,
            camera: Camera::IDENTITY,
            eye: DVec3::Y,
            exposure: 1.0,
            pace: None,
            displays: DisplayMode::Blank,
        };
        let whole = codec::encode(&first);
        // The very first had no display mode.
        for (bytes, displays) in
            [(&whole[..], DisplayMode::Blank), (&whole[..whole.len() - 1], DisplayMode::Normal)]
        {
            let hash = BlobHash::of(bytes).0;
            fs::write(&path, [&MAGIC_FIRST[..], &hash, bytes].concat()).expect("written");
            assert_eq!(check(&path), Ok(()), "it may be written over");
            let memory = load(&path).expect("remembered");
            assert_eq!((memory.revision, memory.displays), (Revision(9), displays));
            assert_eq!((memory.head.position, memory.views.len()), (DVec3::Y, 0));
        }
    }
}
