//! The scene files that can be opened: a walk through the scene folders, with limits.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use polyptych_protocol::scene_file_list::{SCENE_FILES_MAX, SceneFileInfo, SceneFileList};

/// Maximum number of entries of folders that are looked at: a folder of a whole disk is cut short.
const ENTRIES_MAX: usize = 65_536;

/// Maximum depth of folders below a scene folder.
const DEPTH_MAX: usize = 8;

/// Lists the glTF files below these folders. Links are not followed, since what they lead to may
/// lie elsewhere; hidden folders are left out. Of two files of one path the first one is opened.
pub(crate) fn list(roots: &[PathBuf]) -> SceneFileList {
    let mut walk = Walk::default();
    for root in roots {
        walk.folder(root, root, 0);
    }
    let Walk { files, is_cut, .. } = walk;
    SceneFileList { files: files.into_values().collect(), is_cut }
}

#[derive(Default)]
struct Walk {
    files: BTreeMap<String, SceneFileInfo>,
    looked_at: usize,
    is_cut: bool,
}

impl Walk {
    /// A folder that cannot be read has no files for this manager.
    fn folder(&mut self, root: &Path, folder: &Path, depth: usize) {
        let Ok(entries) = fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            self.looked_at += 1;
            if self.looked_at > ENTRIES_MAX {
                self.is_cut = true;
                return;
            }
            let Ok(kind) = entry.file_type() else { continue };
            let path = entry.path();
            if kind.is_dir() && !entry.file_name().to_string_lossy().starts_with('.') {
                if depth < DEPTH_MAX {
                    self.folder(root, &path, depth + 1);
                } else {
                    self.is_cut = true;
                }
            } else if kind.is_file() {
                self.file(root, &path, &entry);
            }
        }
    }

    fn file(&mut self, root: &Path, path: &Path, entry: &fs::DirEntry) {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let is_scene = ["glb", "gltf"].iter().any(|of| ending.eq_ignore_ascii_case(of));
        // A name that is no text could not be asked for.
        let name = path.strip_prefix(root).ok().and_then(Path::to_str).filter(|_| is_scene);
        let Some(name) = name.filter(|name| polyptych_text::printable(name) == *name) else {
            return;
        };
        let Ok(facts) = entry.metadata() else { return };
        let changed = facts.modified().ok();
        let since = changed.and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        let info = SceneFileInfo {
            path: name.to_owned(),
            bytes: facts.len(),
            changed_at_s: since.map_or(0, |since| since.as_secs()),
        };
        self.files.entry(name.to_owned()).or_insert(info);
        if self.files.len() > SCENE_FILES_MAX {
            self.is_cut = true;
            self.files.pop_last();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_scenes_by_path_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        for (root, file) in [
            (&one, "town.glb"),
            (&one, "deep/er/Boat.GLTF"),
            (&one, ".git/hidden.glb"),
            (&one, "notes.txt"),
            (&other, "town.glb"),
            (&other, "a b.glb"),
        ] {
            let path = root.join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(&path, "x".repeat(root.as_os_str().len())).expect("written");
        }
        std::os::unix::fs::symlink("/etc", one.join("link")).expect("linked");
        std::os::unix::fs::symlink("/etc/passwd", one.join("passwd.glb")).expect("linked");
        let list = list(&[one.clone(), other, folder.path().join("absent")]);
        let paths: Vec<_> = list.files.iter().map(|of| of.path.as_str()).collect();
        assert_eq!(paths, ["a b.glb", "deep/er/Boat.GLTF", "town.glb"]);
        assert_eq!(list.files[2].bytes, one.as_os_str().len() as u64, "of the first folder");
        assert!(list.files[0].changed_at_s > 1_600_000_000 && !list.is_cut);
    }

    #[test]
    fn a_folder_of_many_files_is_cut_in_their_order() {
        let folder = tempfile::tempdir().expect("a folder");
        for number in 0..SCENE_FILES_MAX + 3 {
            fs::write(folder.path().join(format!("{number:05}.glb")), "").expect("written");
        }
        let list = list(&[folder.path().to_owned()]);
        assert_eq!((list.files.len(), list.is_cut), (SCENE_FILES_MAX, true));
        assert_eq!(list.files[SCENE_FILES_MAX - 1].path, format!("{:05}.glb", SCENE_FILES_MAX - 1));
    }
}
