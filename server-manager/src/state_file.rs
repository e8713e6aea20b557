//! The state that a manager keeps over a restart: a small file that is there whole or not at all.
//!
//! ```text
//! PLYPSTA6 | BLAKE3 of what follows, 32 bytes | encoded wall without paths | encoded Memory
//! ```
//!
//! The last letter is the version of the form.

mod disk;
mod found;
pub(crate) mod keeper;
pub(crate) mod kept_copy;
mod reconcile;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::{fs, io};

use disk::{Disk, System};
pub(crate) use found::Found;
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
    /// `true` while this manager has neither found a file nor written one: one that appears
    /// meanwhile came with storage that was mounted late, and is not written over.
    expects_none: bool,
}

impl StateFile {
    /// The state file of this wall at this path; written by [`save`](Self::save) only.
    pub fn new(path: PathBuf, wall: &Wall) -> Self {
        let wall = polyptych_codec::encode(&wall.without_paths()).to_vec();
        Self { path, wall, fence: None, expects_none: false }
    }

    /// The same file, written only while this manager leads.
    pub fn with_fence(self, fence: Option<Leadership>) -> Self {
        Self { fence, ..self }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn folder(&self) -> &Path {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.unwrap_or(Path::new("."))
    }

    /// Writes what is to be remembered. The file is whole whatever happens; it is this one if the
    /// process is killed afterwards, and if `is_durable`, after a power cut too.
    ///
    /// # Errors
    /// The folder or the file can't be written, or a file is there that was not when this manager
    /// started, and that it has not written.
    pub fn save(&mut self, memory: &PersistentState, is_durable: bool) -> io::Result<()> {
        self.save_on(&mut System, memory, is_durable)
    }

    fn save_on(
        &mut self,
        disk: &mut impl Disk,
        memory: &PersistentState,
        is_durable: bool,
    ) -> io::Result<()> {
        let folder = self.folder().to_owned();
        disk.make_folder(&folder)?;
        let saved = [&self.wall[..], &polyptych_codec::encode(memory)].concat();
        let bytes = [&MAGIC[..], &BlobHash::of(&saved).0, &saved].concat();
        let new = folder.join(self.new_name(self.fence.as_ref().map(Leadership::term)));
        let mut file = disk.create(&new)?;
        disk.write(&mut file, &bytes)?;
        // Always: after a power cut a name may lead to content that was not on the disk yet, and
        // what was durable before would be lost with it.
        disk.sync(&file)?;
        let mut place = || {
            let renamed = if self.expects_none {
                disk.rename_new(&new, &self.path)
            } else {
                disk.rename(&new, &self.path)
            };
            if renamed.is_ok() {
                // Whatever fails from here on: the file is this manager's own.
                self.expects_none = false;
            }
            renamed
        };
        match &self.fence {
            Some(fence) => fence.fenced(place)?,
            None => place()?,
        }
        if is_durable {
            // The name is in the folder.
            disk.sync_names(&folder)?;
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

    /// The file as a manager finds it.
    fn found(path: &Path) -> Result<Found, String> {
        load(&mut StateFile::new(path.to_owned(), &Wall::new("w", vec![], vec![])))
    }

    fn load(state: &mut StateFile) -> Result<Found, String> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
        let found = runtime.expect("a runtime").block_on(state.load());
        found.map_err(|error| error.to_string())
    }

    #[track_caller]
    fn expect_damaged(path: &Path, reason: &str) {
        match found(path) {
            Ok(Found::Damaged(said)) => assert!(said.contains(reason), "{said}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_saved_comes_back() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("state/wall");
        assert_eq!(found(&path), Ok(Found::Nothing));
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
        assert_eq!(found(&path), Ok(Found::Saved(Box::new(saved))));
        // Much that takes more room in memory than in the file.
        let memory = PersistentState { notes: vec![String::new(); 1_000_000], ..memory };
        StateFile::new(path.clone(), &wall).save(&memory, true).expect("saved");
        let found = found(&path).expect("read");
        assert!(matches!(found, Found::Saved(saved) if saved.memory == memory));
    }

    #[test]
    fn does_not_write_over_a_file_that_appeared_after_the_start() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        let wall = Wall::new("w", vec![], vec![]);
        let memory = PersistentState::of_wall(&wall);
        let mut state = StateFile::new(path.clone(), &wall);
        assert_eq!(load(&mut state), Ok(Found::Nothing));
        let other = "a state on storage that was mounted late";
        fs::write(&path, other).expect("written");
        for _ in 0..2 {
            let refused = state.save(&memory, true).expect_err("another's").to_string();
            assert!(refused.contains("start the manager anew"), "{refused}");
            assert_eq!(fs::read_to_string(&path).expect("read"), other);
        }
        fs::remove_file(&path).expect("removed");
        for _ in 0..2 {
            state.save(&memory, true).expect("there is none but its own");
        }
        assert!(matches!(found(&path), Ok(Found::Saved(_))));
    }

    #[test]
    fn damage_is_noticed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        let wall = Wall::new("w", vec![], vec![]);
        let memory = PersistentState::of_wall(&wall);
        StateFile::new(path.clone(), &wall).save(&memory, true).expect("saved");
        let mut bytes = fs::read(&path).expect("read");
        for (cut, reason) in [(0, "cut"), (10, "cut"), (32, "cut"), (bytes.len() - 1, "damaged")] {
            fs::write(&path, &bytes[..cut]).expect("written");
            expect_damaged(&path, reason);
        }
        bytes[50] ^= 1;
        fs::write(&path, &bytes).expect("written");
        expect_damaged(&path, "damaged");
        let long = [&MAGIC[..], &vec![0; MEMORY_BYTES_MAX as usize][..]].concat();
        fs::write(&path, long).expect("written");
        expect_damaged(&path, "more than");
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
            assert!(found(path).is_err_and(|reason| reason.contains("name another")));
        }
    }

    #[test]
    fn files_of_other_versions_are_of_no_use_but_may_be_written_over() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("wall");
        for bytes in [&b"PLYPSTAT and more"[..], b"PLYPSTA3", b"PLYPSTA9", b"PLYPSTA", b"PL", b""] {
            fs::write(&path, bytes).expect("written");
            assert!(matches!(found(&path), Ok(Found::Damaged(_))), "{bytes:?}");
        }
    }
}
