//! What a manager remembers over a restart: a small file that is there whole or not at all.
//!
//! ```text
//! PLYPSTA3 | BLAKE3 of what follows, 32 bytes | encoded wall without paths | encoded Memory
//! ```
//!
//! The last letter is the form. Files of earlier forms, T and 2, do not hold the wall.

pub(crate) mod keeper;
mod reconcile;

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use polyptych_protocol::camera::Camera;
use polyptych_protocol::codec;
use polyptych_protocol::command::View;
use polyptych_protocol::display::DisplayMode;
use polyptych_protocol::head::Head;
use polyptych_protocol::ids::{BlobHash, Revision};
use polyptych_protocol::limits::MESSAGE_BYTES_MAX;
use polyptych_protocol::log::SceneRef;
use polyptych_protocol::pattern::Pattern;
use polyptych_protocol::request::Pace;
use polyptych_protocol::wall::{Adjustment, EYE_SEPARATION_DEFAULT_M, Wall};
use serde::{Deserialize, Serialize};

use crate::cluster::{Further, Memory};
pub(crate) use reconcile::{Reconciled, reconcile};

/// Maximum size of a file that is read: a few hundred bytes, the wall, and what was tuned of it.
/// A wall fits into a message, tuned or not.
const MEMORY_BYTES_MAX: u64 = 2 * MESSAGE_BYTES_MAX as u64;

/// How the file begins: one that begins otherwise is another program's, and is not written over.
const MAGIC: [u8; 8] = *b"PLYPSTA3";

/// How files of the second form begin.
const MAGIC_SECOND: [u8; 8] = *b"PLYPSTA2";

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

/// The second form: a hash of the wall, with the paths as they were typed, instead of the wall.
#[derive(Debug, Serialize, Deserialize)]
struct Second {
    wall: BlobHash,
    revision: Revision,
    scene: Option<SceneRef>,
    camera: Camera,
    head: Head,
    views: Vec<View>,
    exposure: f32,
    pace: Option<Pace>,
    displays: DisplayMode,
    pattern: Option<Pattern>,
    tunings: Vec<(String, Adjustment)>,
    tuned_wall: Option<BlobHash>,
}

/// The content of a state file.
#[derive(Debug, PartialEq)]
pub(crate) struct Saved {
    /// The wall of the wall file at that time, without paths; `None` in files of earlier forms.
    pub wall: Option<Wall>,
    /// The state of this wall.
    pub memory: Memory,
}

/// Writes the state of one wall.
#[derive(Clone, Debug)]
pub(crate) struct StateFile {
    path: PathBuf,
    /// The wall without paths, encoded.
    wall: Vec<u8>,
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
    let is_ours = [MAGIC, MAGIC_SECOND, MAGIC_FIRST].iter().any(|magic| magic.starts_with(&begin));
    if read.is_ok() && !is_ours {
        return foreign("another file");
    }
    Ok(())
}

/// What was remembered in this file, or `None` where there is none, or nothing of use: a manager
/// that begins afresh is better than one that does not begin.
pub(crate) fn load(path: &Path) -> Option<Saved> {
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
    let form = [MAGIC, MAGIC_SECOND, MAGIC_FIRST].into_iter().find(|m| bytes.starts_with(m));
    let whole = form.and_then(|magic| {
        let (hash, saved) = bytes.strip_prefix(&magic)?.split_at_checked(32)?;
        Some((magic, hash, saved))
    });
    let Some((form, hash, saved)) = whole else {
        warn(&"it is cut short");
        return None;
    };
    if BlobHash::of(saved).0 != hash {
        warn(&"it was damaged");
        return None;
    }
    let saved = match form {
        MAGIC => codec::decode(saved).map(|(wall, memory)| Saved { wall: Some(wall), memory }),
        MAGIC_SECOND => codec::decode(saved).map(from_second),
        _ => decode_first(saved),
    };
    saved.map_err(|error| warn(&error)).ok()
}

fn from_second(second: Second) -> Saved {
    let further =
        Further { pattern: second.pattern, tunings: second.tunings, ..Further::default() };
    let memory = Memory {
        revision: second.revision,
        scene: second.scene,
        camera: second.camera,
        head: second.head,
        views: second.views,
        exposure: second.exposure,
        pace: second.pace,
        displays: second.displays,
        further,
    };
    Saved { wall: None, memory }
}

/// What bytes of the first form say, which are known to be whole.
fn decode_first(memory: &[u8]) -> Result<Saved, codec::DecodeError> {
    let first = codec::decode::<First>(memory).or_else(|error| {
        // The very first managers remembered no display mode, which stands last.
        let normal = codec::encode(&DisplayMode::Normal);
        codec::decode(&[memory, &normal].concat()).map_err(|_| error)
    })?;
    let memory = Memory {
        revision: first.revision,
        scene: first.scene,
        camera: first.camera,
        head: Head::at(first.eye, EYE_SEPARATION_DEFAULT_M),
        views: Vec::new(),
        exposure: first.exposure,
        pace: first.pace,
        displays: first.displays,
        further: Further::default(),
    };
    Ok(Saved { wall: None, memory })
}

impl StateFile {
    /// The state file of this wall at this path; written by [`save`](Self::save) only.
    pub fn new(path: PathBuf, wall: &Wall) -> Self {
        Self { path, wall: codec::encode(&wall.without_paths()).to_vec() }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what is to be remembered. The file is whole whatever happens; it is this one if the
    /// process is killed afterwards, and if `is_durable`, after a power cut too.
    ///
    /// # Errors
    /// The folder or the file can't be written.
    pub fn save(&self, memory: &Memory, is_durable: bool) -> io::Result<()> {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        fs::create_dir_all(folder)?;
        let bytes = [&self.wall[..], &codec::encode(memory)].concat();
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(&MAGIC)?;
        file.write_all(&BlobHash::of(&bytes).0)?;
        file.write_all(&bytes)?;
        // Always: after a power cut a name may lead to content that was not on the disk yet, and
        // what was durable before would be lost with it.
        file.as_file().sync_all()?;
        file.persist(&self.path).map_err(|error| error.error)?;
        if is_durable {
            // The name is in the folder.
            fs::File::open(folder)?.sync_all()?;
        }
        Ok(())
    }

    /// Keeps the file as it is under a name of its own, in the place of an older such copy.
    ///
    /// # Errors
    /// The file cannot be copied.
    pub fn keep_copy(&self) -> io::Result<PathBuf> {
        let mut copy = self.path.clone().into_os_string();
        copy.push(".old");
        let copy = PathBuf::from(copy);
        fs::copy(&self.path, &copy)?;
        Ok(copy)
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::scene::Bounds;

    use super::*;

    #[test]
    fn what_is_saved_comes_back_and_damage_is_noticed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("state/wall");
        assert_eq!(load(&path), None);
        let memory = Memory {
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
                notes: vec!["animations: 1 is not played".into()],
            },
        };
        let wall = Wall { scenes: vec!["../here".into()], ..Wall::new("w", vec![], vec![]) };
        StateFile::new(path.clone(), &wall).save(&memory, true).expect("saved");
        let saved = Saved { wall: Some(wall.without_paths()), memory };
        assert_eq!(load(&path), Some(saved));
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
            let Saved { wall, memory } = load(&path).expect("remembered");
            assert_eq!(wall, None);
            assert_eq!((memory.revision, memory.displays), (Revision(9), displays));
            assert_eq!((memory.head.position, memory.views.len()), (DVec3::Y, 0));
        }
    }

    #[test]
    fn files_of_the_second_form_are_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        let tunings = vec![("a".to_owned(), Adjustment { mirror: true, ..Adjustment::default() })];
        let second = Second {
            wall: BlobHash([7; 32]),
            revision: Revision(9),
            scene: None,
            camera: Camera::IDENTITY,
            head: Head::at(DVec3::Y, 0.06),
            views: Vec::new(),
            exposure: 1.0,
            pace: None,
            displays: DisplayMode::Blank,
            pattern: Some(Pattern::Grid),
            tunings: tunings.clone(),
            tuned_wall: None,
        };
        let bytes = codec::encode(&second);
        let file = [&MAGIC_SECOND[..], &BlobHash::of(&bytes).0, &bytes].concat();
        fs::write(&path, file).expect("written");
        assert_eq!(check(&path), Ok(()), "it may be written over");
        let memory = load(&path).expect("remembered").memory;
        assert_eq!((memory.revision, memory.head), (second.revision, second.head));
        let pattern = Some(Pattern::Grid);
        assert_eq!(memory.further, Further { pattern, tunings, ..Further::default() });
    }
}
