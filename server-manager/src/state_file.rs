//! The state that a manager keeps over a restart: a small file that is there whole or not at all.
//!
//! ```text
//! PLYPSTA6 | BLAKE3 of what follows, 32 bytes | encoded wall without paths | encoded Memory
//! ```
//!
//! The last letter is the version of the form.

mod disk;
pub(crate) mod keeper;
mod reconcile;

use std::ffi::OsString;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use disk::{Disk, System};
use polyptych_core::PersistentState;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::ids::Term;
use polyptych_protocol::limits::MESSAGE_BYTES_MAX;
use polyptych_wall::Wall;
pub(crate) use reconcile::{Reconciled, reconcile};

use crate::leadership::Leadership;

/// Maximum size of a file that is read: a few hundred bytes, the wall, and what was tuned of it.
/// A wall fits into a message, tuned or not.
const MEMORY_BYTES_MAX: u64 = 2 * MESSAGE_BYTES_MAX as u64;

/// Maximum memory in bytes that its values may claim: what a byte stands for takes eight at most.
const VALUES_BYTES_MAX: usize = 8 * MEMORY_BYTES_MAX as usize;

/// The first bytes of a file of this version.
const MAGIC: [u8; 8] = *b"PLYPSTA6";

/// The first bytes of files of all versions: a file that begins otherwise is another program's, and
/// is not written over.
const MAGIC_OF_ALL: [u8; 7] = *b"PLYPSTA";

/// The content of a state file.
#[derive(Debug, PartialEq)]
pub(crate) struct Saved {
    /// The wall of the wall file at that time, without paths.
    pub wall: Wall,
    /// The state of this wall.
    pub memory: PersistentState,
}

/// Writes the state of one wall.
#[derive(Clone, Debug)]
pub(crate) struct StateFile {
    path: PathBuf,
    /// The wall without paths, encoded.
    wall: Vec<u8>,
    /// The lease without which nothing is written, if managers share this state.
    fence: Option<Leadership>,
}

/// Checks that this may be the file of a manager, or become it.
///
/// # Errors
/// Says what is there instead.
pub(crate) fn check_writable(path: &Path) -> Result<(), String> {
    let foreign = |what: &str| {
        let path = path.display();
        Err(format!("{path}: {what}, not a state file of a manager; name another or remove it"))
    };
    match fs::metadata(path) {
        Ok(facts) if facts.is_dir() => return foreign("a folder"),
        // Opening a pipe waits for its writer.
        Ok(facts) if !facts.is_file() => return foreign("a pipe or a device"),
        Ok(_) | Err(_) => {}
    }
    let mut begin = Vec::new();
    let read = fs::File::open(path).and_then(|file| file.take(8).read_to_end(&mut begin));
    // What is not there, or was torn before it was whole, is made anew.
    begin.truncate(MAGIC_OF_ALL.len());
    let is_ours = MAGIC_OF_ALL.starts_with(&begin);
    if read.is_ok() && !is_ours {
        return foreign("another file");
    }
    Ok(())
}

/// Returns the content of this file; `None` if there is no file, or nothing of use in it: a manager
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
    decode(&bytes).map_err(|reason| warn(&reason)).ok()
}

/// The content of these bytes of a state file.
///
/// # Errors
/// The reason why they are of no use.
fn decode(bytes: &[u8]) -> Result<Saved, String> {
    let is_other = bytes.starts_with(&MAGIC_OF_ALL) && bytes.len() >= MAGIC.len();
    let whole = bytes.strip_prefix(&MAGIC).and_then(|bytes| bytes.split_at_checked(32));
    let Some((hash, saved)) = whole else {
        let is_other = is_other && !bytes.starts_with(&MAGIC);
        let reason = if is_other { "another version has written it" } else { "it is cut short" };
        return Err(reason.to_owned());
    };
    if BlobHash::of(saved).0 != hash {
        return Err("it was damaged".to_owned());
    }
    let decoded = polyptych_codec::decode_within::<_, VALUES_BYTES_MAX>(saved);
    let (wall, memory) = decoded.map_err(|error| error.to_string())?;
    Ok(Saved { wall, memory })
}

impl StateFile {
    /// The state file of this wall at this path; written by [`save`](Self::save) only.
    pub fn new(path: PathBuf, wall: &Wall) -> Self {
        let wall = polyptych_codec::encode(&wall.without_paths()).to_vec();
        Self { path, wall, fence: None }
    }

    /// The same file, written only while this manager leads.
    pub fn with_fence(self, fence: Option<Leadership>) -> Self {
        Self { fence, ..self }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what is to be remembered. The file is whole whatever happens; it is this one if the
    /// process is killed afterwards, and if `is_durable`, after a power cut too.
    ///
    /// # Errors
    /// The folder or the file can't be written.
    pub fn save(&self, memory: &PersistentState, is_durable: bool) -> io::Result<()> {
        self.save_on(&mut System, memory, is_durable)
    }

    fn save_on(
        &self,
        disk: &mut impl Disk,
        memory: &PersistentState,
        is_durable: bool,
    ) -> io::Result<()> {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        disk.make_folder(folder)?;
        let saved = [&self.wall[..], &polyptych_codec::encode(memory)].concat();
        let bytes = [&MAGIC[..], &BlobHash::of(&saved).0, &saved].concat();
        let new = folder.join(self.new_name(self.fence.as_ref().map(Leadership::term)));
        let mut file = disk.create(&new)?;
        disk.write(&mut file, &bytes)?;
        // Always: after a power cut a name may lead to content that was not on the disk yet, and
        // what was durable before would be lost with it.
        disk.sync(&file)?;
        match &self.fence {
            Some(fence) => fence.fenced(|| disk.rename(&new, &self.path))?,
            None => disk.rename(&new, &self.path)?,
        }
        if is_durable {
            // The name is in the folder.
            disk.sync_names(folder)?;
        }
        Ok(())
    }

    /// The name of a file that is being written. It is always the same, so that a killed manager
    /// leaves one such file at most; leaders of one wall have a name each, since one that was
    /// stopped may go on writing.
    fn new_name(&self, term: Option<Term>) -> OsString {
        let mut name = OsString::from(".");
        name.push(self.path.file_name().unwrap_or_default());
        if let Some(term) = term {
            name.push(format!(".{term}"));
        }
        name.push(".new");
        name
    }

    /// Removes what the leader before this one may have left half written.
    pub fn remove_abandoned(&self) {
        let Some(fence) = &self.fence else { return };
        let before = Term(fence.term().0.saturating_sub(1));
        // Most leaders leave none.
        let _ = fs::remove_file(self.path.with_file_name(self.new_name(Some(before))));
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
    use glam::DVec3;
    use polyptych_core::{FollowedNode, PlayedClips, PlayedTour, TourClock};
    use polyptych_protocol::follow::Follow;
    use polyptych_protocol::ids::Revision;
    use polyptych_protocol::output_mode::OutputMode;
    use polyptych_protocol::pattern::TestPattern;
    use polyptych_protocol::presentation::Presentation;
    use polyptych_protocol::request::Pacing;
    use polyptych_protocol::screen_rest::RestRules;
    use polyptych_protocol::stored_view::StoredView;
    use polyptych_scene::{Bounds, NodeId, SceneEdits};
    use polyptych_wall::ChannelCalibration;
    use polyptych_wall::camera::Camera;
    use polyptych_wall::head::HeadPose;
    use polyptych_wall::tour::{Tour, TourStop};
    use polyptych_wall::view::View;

    use super::*;

    #[test]
    fn what_is_saved_comes_back_and_damage_is_noticed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("state/wall");
        assert_eq!(load(&path), None);
        let memory = PersistentState {
            revision: Revision(9),
            scene: None,
            presentation: Presentation {
                bounds: polyptych_protocol::quality_bounds::QualityBounds::FINEST,
                camera: Camera { scale: 0.1, ..Camera::IDENTITY },
                head: HeadPose::facing_forward(DVec3::new(0.1, 1.6, 0.3), 0.06),
                views: vec![View::of_wall(Camera::IDENTITY)],
                exposure: 1.5,
                output_mode: OutputMode::Blank,
                pattern: Some(TestPattern::Grid),
                tone: polyptych_scene::ToneMapper::Aces,
                is_exposure_automatic: true,
                fog: Some(polyptych_scene::Fog::even(300.0)),
                glow: Some(polyptych_scene::Glow::new(0.25)),
                ambient_occlusion: Some(polyptych_scene::AmbientOcclusion { radius: 0.5 }),
                depth_of_field: Some(polyptych_scene::DepthOfField::new(12.0)),
                marker: None,
            },
            pace: Some(Pacing::Rate(60.0)),
            tunings: vec![(
                "a".into(),
                ChannelCalibration { mirror: true, ..ChannelCalibration::default() },
            )],
            notes: vec!["animations: 1 is not played".into()],
            bounds: Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE }),
            edits: SceneEdits::default(),
            next_node: 17,
            temporary: Vec::new(),
            stored_views: vec![StoredView { name: "quay".into(), camera: Camera::IDENTITY }],
            tour: Some(PlayedTour {
                tour: Tour { stops: vec![TourStop::new(Camera::IDENTITY, 2.0)], is_loop: true },
                from: Camera::IDENTITY,
                clock: TourClock::Waiting { at_s: 1.5 },
            }),
            environment: Some(polyptych_protocol::environment::Environment {
                name: "sky".into(),
                blob: BlobHash([7; 32]),
            }),
            following: Some(FollowedNode {
                follow: Follow {
                    node: NodeId(3),
                    camera: Some(Camera::IDENTITY),
                    is_turning: true,
                    orbit_rad_per_s: 0.5,
                },
                clock: TourClock::Waiting { at_s: 2.5 },
            }),
            clips: PlayedClips::default(),
            rest: RestRules { idle_s: Some(600.0), hours: None },
            is_head_tracked: true,
        };
        let wall = Wall { scenes: vec!["../here".into()], ..Wall::new("w", vec![], vec![]) };
        StateFile::new(path.clone(), &wall).save(&memory, true).expect("saved");
        let saved = Saved { wall: wall.without_paths(), memory: memory.clone() };
        assert_eq!(load(&path), Some(saved));
        let mut bytes = fs::read(&path).expect("read");
        for cut in [0, 10, 32, bytes.len() - 1] {
            fs::write(&path, &bytes[..cut]).expect("written");
            assert_eq!(load(&path), None, "cut to {cut} bytes");
        }
        bytes[50] ^= 1;
        fs::write(&path, &bytes).expect("written");
        assert_eq!((load(&path), check_writable(&path)), (None, Ok(())));

        // Much that takes more room in memory than in the file.
        let memory = PersistentState { notes: vec![String::new(); 1_000_000], ..memory };
        StateFile::new(path.clone(), &wall).save(&memory, true).expect("saved");
        assert!(load(&path).is_some_and(|saved| saved.memory == memory));
    }

    #[test]
    fn what_is_no_state_file_is_not_written_over() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let foreign = folder.path().join("wall.toml");
        fs::write(&foreign, "[wall]").expect("written");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
        assert!(made.success());
        for path in [folder.path(), &foreign, &pipe] {
            assert!(check_writable(path).is_err_and(|reason| reason.contains("name another")));
        }
    }

    #[test]
    fn files_of_other_versions_are_of_no_use_but_may_be_written_over() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        for bytes in [&b"PLYPSTAT and more"[..], b"PLYPSTA3", b"PLYPSTA9", b"PLYPSTA", b"PL", b""] {
            fs::write(&path, bytes).expect("written");
            assert_eq!((load(&path), check_writable(&path)), (None, Ok(())), "{bytes:?}");
        }
    }
}
