//! The store of scenes as they were edited.
//!
//! A site of many managers would put a database with transactions behind [`SceneStore`], such as
//! PostgreSQL, and its blobs into an object store: all that a scene needs beside its entry is named
//! by hash.

use std::path::PathBuf;
use std::sync::Mutex;

use polyptych_core::EditedScene;
use polyptych_protocol::saved_scene::{SavedScene, name_fault};
use polyptych_scene::limits::EDITS_BYTES_MAX;
use redb::{Database, ReadOnlyTable, ReadableDatabase, ReadableTable, TableDefinition, TableError};
use serde::{Deserialize, Serialize};

/// Most scenes that are kept: a list that a person reads.
const SCENES_MAX: usize = 1024;

/// Most bytes that an entry takes in memory.
const ENTRY_BYTES_MAX: usize = 8 * EDITS_BYTES_MAX;

/// The table of entries. Another form of them is another table, so that none is misread.
const SCENES: TableDefinition<'static, &str, &[u8]> = TableDefinition::new("scenes.1");

/// A scene as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredScene {
    pub scene: EditedScene,
    /// In seconds since 1970, UTC.
    pub saved_at_s: u64,
}

/// Scenes by name. What it says to be done is done, whatever happens to the manager afterwards; at
/// any moment there is the old entry or the new one.
pub(crate) trait SceneStore: Send + Sync {
    /// Keeps a scene in the place of what had its name.
    ///
    /// # Errors
    /// Why it is not kept; the old one is as it was.
    fn save(&self, name: &str, scene: &StoredScene) -> Result<(), String>;

    /// The scene of a name.
    ///
    /// # Errors
    /// There is none, with those that there are; or it cannot be read.
    fn load(&self, name: &str) -> Result<StoredScene, String>;

    /// Forgets a scene.
    ///
    /// # Errors
    /// Those of [`SceneStore::load`].
    fn remove(&self, name: &str) -> Result<(), String>;

    /// All that there are, by name.
    ///
    /// # Errors
    /// They cannot be read.
    fn list(&self) -> Result<Vec<SavedScene>, String>;
}

/// A file of this machine. It is opened for each call, so that it is nobody's while nothing is
/// asked of it.
#[derive(Debug)]
pub(crate) struct SceneFile {
    path: PathBuf,
    /// Who uses it now.
    turn: Mutex<()>,
}

impl SceneFile {
    pub fn new(path: PathBuf) -> Self {
        Self { path, turn: Mutex::default() }
    }

    fn with<T>(
        &self,
        work: impl FnOnce(&Database) -> Result<Result<T, String>, redb::Error>,
    ) -> Result<T, String> {
        let _turn = self.turn.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let done = Database::create(&self.path).map_err(redb::Error::from);
        let done = done.and_then(|file| work(&file));
        let path = self.path.display();
        done.map_err(|error| format!("the file of saved scenes, {path}: {error}"))?
    }
}

impl SceneStore for SceneFile {
    fn save(&self, name: &str, scene: &StoredScene) -> Result<(), String> {
        if let Some(fault) = name_fault(name) {
            return Err(fault);
        }
        self.with(|file| {
            let change = file.begin_write()?;
            {
                let mut scenes = change.open_table(SCENES)?;
                if scenes.get(name)?.is_none() && scenes.iter()?.count() >= SCENES_MAX {
                    return Ok(Err(format!(
                        "{SCENES_MAX} scenes are saved already, which is the maximum; remove one"
                    )));
                }
                scenes.insert(name, &polyptych_codec::encode(scene)[..])?;
            }
            // On the disk before it returns: redb's default durability.
            change.commit()?;
            Ok(Ok(()))
        })
    }

    fn load(&self, name: &str) -> Result<StoredScene, String> {
        self.with(|file| {
            let Some(scenes) = entries(file)? else { return Ok(Err(unknown(&[], name))) };
            let Some(entry) = scenes.get(name)? else {
                return Ok(Err(unknown(&names(&scenes)?, name)));
            };
            Ok(decode(name, entry.value()))
        })
    }

    fn remove(&self, name: &str) -> Result<(), String> {
        self.with(|file| {
            let change = file.begin_write()?;
            {
                let mut scenes = change.open_table(SCENES)?;
                if scenes.remove(name)?.is_none() {
                    return Ok(Err(unknown(&names(&scenes)?, name)));
                }
            }
            change.commit()?;
            Ok(Ok(()))
        })
    }

    fn list(&self) -> Result<Vec<SavedScene>, String> {
        self.with(|file| {
            let Some(scenes) = entries(file)? else { return Ok(Ok(Vec::new())) };
            let mut all = Vec::new();
            for entry in scenes.iter()? {
                let (name, bytes) = entry?;
                let StoredScene { scene, saved_at_s } = match decode(name.value(), bytes.value()) {
                    Ok(stored) => stored,
                    Err(reason) => return Ok(Err(reason)),
                };
                all.push(SavedScene {
                    name: name.value().to_owned(),
                    scene: scene.scene.name,
                    edited_nodes: scene.edits.nodes().count() as u64,
                    saved_at_s,
                });
            }
            Ok(Ok(all))
        })
    }
}

fn decode(name: &str, bytes: &[u8]) -> Result<StoredScene, String> {
    polyptych_codec::decode_within::<StoredScene, ENTRY_BYTES_MAX>(bytes)
        .map_err(|error| format!("the saved scene {name} cannot be read: {error}"))
}

/// Returns the entries as they are now; `None` before the first one.
fn entries(
    file: &Database,
) -> Result<Option<ReadOnlyTable<&'static str, &'static [u8]>>, redb::Error> {
    match file.begin_read()?.open_table(SCENES) {
        Ok(scenes) => Ok(Some(scenes)),
        Err(TableError::TableDoesNotExist(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Returns the first names of the entries, for an error.
fn names(
    scenes: &impl ReadableTable<&'static str, &'static [u8]>,
) -> Result<Vec<String>, redb::Error> {
    const NAMES_MAX: usize = 16;
    let entries = scenes.iter()?.take(NAMES_MAX);
    entries.map(|entry| Ok(entry?.0.value().to_owned())).collect()
}

fn unknown(names: &[String], name: &str) -> String {
    let there = if names.is_empty() { "none is".to_owned() } else { names.join(", ") };
    format!("no scene is saved as {}; saved: {there}", polyptych_text::printable(name))
}

#[cfg(test)]
mod tests {
    use polyptych_files::blob::BlobHash;
    use polyptych_protocol::state_log::SceneRef;
    use polyptych_scene::{Edit, NodeId, SceneEdits};

    use super::*;

    fn stored(name: &str, hidden: u64) -> StoredScene {
        let mut edits = SceneEdits::default();
        for node in 0..hidden {
            edits.apply(Edit::SetVisible { node: NodeId(node), visible: false });
        }
        let scene = SceneRef { name: name.into(), manifest: BlobHash::of(name.as_bytes()) };
        StoredScene { scene: EditedScene { scene, edits, next_node: 7 }, saved_at_s: 1 }
    }

    #[test]
    fn scenes_are_kept_under_their_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.scenes");
        let store = SceneFile::new(path.clone());
        assert_eq!(store.list(), Ok(Vec::new()));
        assert_eq!(store.load("a").expect_err("none"), "no scene is saved as a; saved: none is");
        store.save("evening", &stored("town", 2)).expect("saved");
        store.save("a", &stored("town", 1)).expect("saved");
        store.save("a", &stored("town", 3)).expect("saved over");
        let again = SceneFile::new(path);
        assert_eq!(again.load("a"), Ok(stored("town", 3)));
        let names: Vec<_> = again.list().expect("read").into_iter().map(|of| of.name).collect();
        assert_eq!(names, ["a", "evening"]);
        assert_eq!(again.list().expect("read")[0].edited_nodes, 3);
        again.remove("a").expect("there");
        let error = again.remove("a").expect_err("gone");
        assert_eq!(error, "no scene is saved as a; saved: evening");
        for name in ["", "a\nb", &"n".repeat(65)] {
            assert!(
                store.save(name, &stored("town", 0)).expect_err("no name").contains("64 bytes")
            );
        }
    }

    #[test]
    fn a_file_that_is_none_or_is_locked_is_told_with_its_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.scenes");
        std::fs::write(&path, b"not a database, but as long as one may be".repeat(1000))
            .expect("written");
        let error = SceneFile::new(path.clone()).list().expect_err("damaged");
        assert!(error.contains("wall.scenes"), "{error}");
        std::fs::remove_file(&path).expect("there");
        let held = Database::create(&path).expect("made");
        let error = SceneFile::new(path.clone()).save("a", &stored("t", 0)).expect_err("locked");
        assert!(error.contains("wall.scenes") && error.contains("already open"), "{error}");
        drop(held);
        let gone = SceneFile::new(folder.path().join("no/folder/wall.scenes"));
        assert!(gone.list().expect_err("no folder").contains("wall.scenes"));
    }
}
