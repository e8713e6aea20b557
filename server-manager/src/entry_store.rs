//! The store of what clients keep under names: scenes as they were edited, and sessions.
//!
//! A site of many managers would put a database with transactions behind [`EntryStore`], such as
//! PostgreSQL, and its blobs into an object store: all that an entry needs beside itself is named
//! by hash.

use std::fs::OpenOptions;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use polyptych_scene::limits::EDITS_BYTES_MAX;
use redb::{Database, ReadOnlyTable, ReadableDatabase, ReadableTable, TableDefinition, TableError};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Maximum number of entries of a kind: a list that a person reads.
const ENTRIES_MAX: usize = 1024;

/// Maximum number of bytes that an entry takes in memory.
const ENTRY_BYTES_MAX: usize = 8 * EDITS_BYTES_MAX;

/// Bytes of the magic number with which redb's files begin.
const MAGIC_BYTES: usize = 9;

/// A kind of entries.
pub(crate) trait Entry: Serialize + DeserializeOwned + Send + 'static {
    /// A line of the list of all.
    type Summary: Serialize + DeserializeOwned;
    /// Its table. Another form of entries is another table, so that none is misread.
    const TABLE: &'static str;
    /// One of them, in messages.
    const NOUN: &'static str;

    /// Returns what is wrong with a name, if anything.
    fn name_fault(name: &str) -> Option<String>;

    /// Returns the line of the list under this name.
    fn summary(&self, name: &str) -> Self::Summary;
}

/// A store of entries of a kind by name. A call that returned `Ok` is on the disk, whatever happens
/// to the manager afterwards; at any moment there is the old entry or the new one.
pub(crate) trait EntryStore<E: Entry>: Send + Sync {
    /// Keeps an entry in the place of what had its name.
    ///
    /// # Errors
    /// The reason why it is not kept; the old one is as it was.
    fn save(&self, name: &str, entry: &E) -> Result<(), String>;

    /// Returns the entry of a name.
    ///
    /// # Errors
    /// There is none, with those that there are; or it cannot be read.
    fn load(&self, name: &str) -> Result<E, String>;

    /// Forgets an entry.
    ///
    /// # Errors
    /// Those of [`EntryStore::load`].
    fn remove(&self, name: &str) -> Result<(), String>;

    /// Returns the lines of all entries, by name.
    ///
    /// # Errors
    /// They cannot be read.
    fn list(&self) -> Result<Vec<E::Summary>, String>;
}

/// A store in a file of this machine. It is opened for each call, so that between calls no process
/// holds it.
#[derive(Debug)]
pub(crate) struct StoreFile {
    path: PathBuf,
    /// Held by the call that uses it now.
    turn: Mutex<()>,
}

/// Encoded summaries and entries by name.
type Table = TableDefinition<'static, &'static str, (&'static [u8], &'static [u8])>;
type Rows = ReadOnlyTable<&'static str, (&'static [u8], &'static [u8])>;

/// The result of a call, unless the file failed.
type Done<T> = Result<Result<T, String>, redb::Error>;

const fn table<E: Entry>() -> Table {
    TableDefinition::new(E::TABLE)
}

impl StoreFile {
    pub fn new(path: PathBuf) -> Self {
        Self { path, turn: Mutex::default() }
    }

    /// Works with the file, which is made if it is missing.
    fn with<T>(&self, work: impl FnOnce(&Database) -> Done<T>) -> Result<T, String> {
        self.in_turn(|_| {
            let file = Database::create(&self.path)?;
            work(&file)
        })
    }

    /// Works with the file; if nothing was ever saved, with `None`, and none is made.
    fn with_saved<T>(&self, work: impl FnOnce(Option<&Database>) -> Done<T>) -> Result<T, String> {
        self.in_turn(|is_begun| {
            let file = is_begun.then(|| Database::create(&self.path)).transpose()?;
            work(file.as_ref())
        })
    }

    /// Waits for other calls to end, and then tells this one whether the file has a database.
    fn in_turn<T>(&self, call: impl FnOnce(bool) -> Done<T>) -> Result<T, String> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let done = is_begun(&self.path).map_err(redb::Error::from).and_then(call);
        let path = self.path.display();
        done.map_err(|error| format!("the file of saved scenes and sessions, {path}: {error}"))?
    }
}

impl<E: Entry> EntryStore<E> for StoreFile {
    fn save(&self, name: &str, entry: &E) -> Result<(), String> {
        if let Some(fault) = E::name_fault(name) {
            return Err(fault);
        }
        let bytes = polyptych_codec::encode(entry);
        if bytes.len() > ENTRY_BYTES_MAX {
            let (noun, bytes) = (E::NOUN, bytes.len());
            return Err(format!("the {noun} takes {bytes} bytes; at most {ENTRY_BYTES_MAX} do"));
        }
        // Values may take more room in memory than in the file: one that could not be read again
        // is not kept, and does not replace the old one.
        polyptych_codec::decode_within::<E, ENTRY_BYTES_MAX>(&bytes[..]).map_err(|error| {
            let noun = E::NOUN;
            format!("the {noun} could not be read again ({error}); the old one is kept")
        })?;
        self.with(|file| {
            let change = file.begin_write()?;
            {
                let mut rows = change.open_table(table::<E>())?;
                if rows.get(name)?.is_none() && rows.iter()?.count() >= ENTRIES_MAX {
                    let noun = E::NOUN;
                    return Ok(Err(format!(
                        "{ENTRIES_MAX} {noun}s are saved already, which is the maximum; remove one"
                    )));
                }
                let summary = polyptych_codec::encode(&entry.summary(name));
                rows.insert(name, (&summary[..], &bytes[..]))?;
            }
            // On the disk before it returns: redb's default durability.
            change.commit()?;
            Ok(Ok(()))
        })
    }

    fn load(&self, name: &str) -> Result<E, String> {
        self.with_saved(|file| {
            let Some(rows) = rows::<E>(file)? else { return Ok(Err(unknown::<E>(&[], name))) };
            let Some(row) = rows.get(name)? else {
                return Ok(Err(unknown::<E>(&names(&rows)?, name)));
            };
            Ok(decode::<E, E>(name, row.value().1))
        })
    }

    fn remove(&self, name: &str) -> Result<(), String> {
        self.with_saved(|file| {
            let Some(file) = file else { return Ok(Err(unknown::<E>(&[], name))) };
            let change = file.begin_write()?;
            {
                let mut rows = change.open_table(table::<E>())?;
                if rows.remove(name)?.is_none() {
                    return Ok(Err(unknown::<E>(&names(&rows)?, name)));
                }
            }
            change.commit()?;
            Ok(Ok(()))
        })
    }

    fn list(&self) -> Result<Vec<E::Summary>, String> {
        self.with_saved(|file| {
            let Some(rows) = rows::<E>(file)? else { return Ok(Ok(Vec::new())) };
            let mut all = Vec::new();
            for row in rows.iter()? {
                let (name, row) = row?;
                match decode::<E, E::Summary>(name.value(), row.value().0) {
                    Ok(summary) => all.push(summary),
                    Err(reason) => return Ok(Err(reason)),
                }
            }
            Ok(Ok(all))
        })
    }
}

fn decode<E: Entry, T: DeserializeOwned>(name: &str, bytes: &[u8]) -> Result<T, String> {
    let noun = E::NOUN;
    polyptych_codec::decode_within::<T, ENTRY_BYTES_MAX>(bytes)
        .map_err(|error| format!("the saved {noun} {name} cannot be read: {error}"))
}

/// Returns whether a file holds a database; `false` if it is missing or empty.
///
/// A full disk, or a kill, while redb makes a file leaves one of some length that does not begin
/// with the magic number, which redb writes last. Nothing was saved in such a file, and redb would
/// refuse it from then on, so it is emptied here.
///
/// # Errors
/// The file cannot be read or emptied, or its folder is missing.
fn is_begun(path: &Path) -> io::Result<bool> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let file = match OpenOptions::new().read(true).write(true).open(path) {
        Ok(file) => file,
        // In a folder that is missing, no file can be made.
        Err(error) if error.kind() == ErrorKind::NotFound && folder.is_none_or(Path::is_dir) => {
            return Ok(false);
        }
        Err(error) => return Err(error),
    };
    let is_unfinished = || {
        let mut magic = [0; MAGIC_BYTES];
        file.read_exact_at(&mut magic, 0).is_ok() && magic == [0; MAGIC_BYTES]
    };
    // Another process that makes the file at this moment holds the same lock.
    if is_unfinished() && file.try_lock().is_ok() {
        if is_unfinished() {
            file.set_len(0)?;
        }
        // Closing is not enough: a process that starts at this moment has the handle, too.
        file.unlock()?;
    }
    Ok(file.metadata()?.len() > 0)
}

/// Returns the entries as they are now; `None` before the first one.
fn rows<E: Entry>(file: Option<&Database>) -> Result<Option<Rows>, redb::Error> {
    let Some(file) = file else { return Ok(None) };
    match file.begin_read()?.open_table(table::<E>()) {
        Ok(rows) => Ok(Some(rows)),
        Err(TableError::TableDoesNotExist(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Returns the first names of the entries, for an error.
fn names(
    rows: &impl ReadableTable<&'static str, (&'static [u8], &'static [u8])>,
) -> Result<Vec<String>, redb::Error> {
    const NAMES_MAX: usize = 16;
    let rows = rows.iter()?.take(NAMES_MAX);
    rows.map(|row| Ok(row?.0.value().to_owned())).collect()
}

fn unknown<E: Entry>(names: &[String], name: &str) -> String {
    let there = if names.is_empty() { "none is".to_owned() } else { names.join(", ") };
    format!("no {} is saved as {}; saved: {there}", E::NOUN, polyptych_text::printable(name))
}

#[cfg(test)]
mod tests {
    use polyptych_core::EditedScene;
    use polyptych_files::blob::BlobHash;
    use polyptych_protocol::state_log::SceneRef;
    use polyptych_scene::{Edit, NodeId, SceneEdits};
    use serde::Deserialize;

    use super::*;
    use crate::stored_scene::StoredScene;

    type Store = dyn EntryStore<StoredScene>;

    fn stored(name: &str, hidden: u64) -> StoredScene {
        let mut edits = SceneEdits::default();
        for node in 0..hidden {
            edits.apply(Edit::SetVisible { node: NodeId(node), visible: false });
        }
        let scene = SceneRef { name: name.into(), manifest: BlobHash::of(name.as_bytes()) };
        let scene = EditedScene { scene, edits, next_node: 7 };
        StoredScene { scene, edited_nodes: hidden, saved_at_s: 1 }
    }

    #[test]
    fn scenes_are_kept_under_their_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.scenes");
        let file = StoreFile::new(path.clone());
        let store: &Store = &file;
        assert_eq!(store.list(), Ok(Vec::new()));
        assert_eq!(store.load("a").expect_err("none"), "no scene is saved as a; saved: none is");
        store.save("evening", &stored("town", 2)).expect("saved");
        store.save("a", &stored("town", 1)).expect("saved");
        store.save("a", &stored("town", 3)).expect("saved over");
        let again = StoreFile::new(path);
        let again: &Store = &again;
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

    /// An entry of small numbers, each of which takes eight times its bytes in memory.
    #[derive(Debug, Serialize, Deserialize)]
    struct Numbers(Vec<u64>);

    impl Entry for Numbers {
        type Summary = u64;
        const TABLE: &'static str = "numbers.1";
        const NOUN: &'static str = "list";

        fn name_fault(_: &str) -> Option<String> {
            None
        }

        fn summary(&self, _: &str) -> u64 {
            self.0.len() as u64
        }
    }

    #[test]
    fn keeps_the_old_entry_if_the_new_one_could_not_be_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = StoreFile::new(folder.path().join("wall.scenes"));
        let store: &dyn EntryStore<Numbers> = &file;
        store.save("a", &Numbers(vec![7])).expect("saved");
        let wide = Numbers(vec![7; ENTRY_BYTES_MAX / 8 + 1]);
        let error = store.save("a", &wide).expect_err("too much memory");
        assert!(error.contains("the list could not be read again"), "{error}");
        assert_eq!(store.load("a").expect("the old one").0, [7]);
    }

    #[test]
    fn a_file_that_redb_has_not_finished_is_begun_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.scenes");
        let file = StoreFile::new(path.clone());
        let store: &Store = &file;
        assert_eq!(store.list(), Ok(Vec::new()));
        let none = "no scene is saved as a; saved: none is";
        assert_eq!(store.load("a").expect_err("none"), none);
        assert_eq!(store.remove("a").expect_err("none"), none);
        assert!(!path.exists(), "only saving makes the file");
        // A full disk gives a file its length, and then takes no byte of it.
        let unfinished = || std::fs::File::create(&path).and_then(|file| file.set_len(1 << 20));
        unfinished().expect("made");
        assert_eq!(store.list(), Ok(Vec::new()));
        unfinished().expect("made");
        store.save("a", &stored("town", 1)).expect("saved");
        assert_eq!(store.load("a"), Ok(stored("town", 1)));
    }

    #[test]
    fn a_file_that_is_none_or_is_locked_is_told_with_its_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.scenes");
        std::fs::write(&path, b"not a database, but as long as one may be".repeat(1000))
            .expect("written");
        let damaged = StoreFile::new(path.clone());
        let damaged: &Store = &damaged;
        let error = damaged.list().expect_err("damaged");
        assert!(error.contains("wall.scenes"), "{error}");
        std::fs::remove_file(&path).expect("there");
        let held = Database::create(&path).expect("made");
        let error = StoreFile::new(path.clone()).save("a", &stored("t", 0)).expect_err("locked");
        assert!(error.contains("wall.scenes") && error.contains("already open"), "{error}");
        drop(held);
        let gone = StoreFile::new(folder.path().join("no/folder/wall.scenes"));
        let gone: &Store = &gone;
        assert!(gone.list().expect_err("no folder").contains("wall.scenes"));
    }
}
