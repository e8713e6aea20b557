//! The steps in which a state file is written, so that a test can cut the power between them.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

/// The reason why a file is left as it is that was not there when this manager started.
const APPEARED: &str = "it has appeared since this manager started without one, and is not written \
                        over; start the manager anew to go on with it, or move it away to keep \
                        this manager's state";

/// A file system. Nothing is durable before it was synced; each step may fail.
pub(super) trait Disk {
    /// An open file.
    type File;

    /// Makes a folder with its parents, all durable. One that exists is used.
    fn make_folder(&mut self, folder: &Path) -> io::Result<()>;

    /// Makes an empty file, in the place of one with this name.
    fn create(&mut self, path: &Path) -> io::Result<Self::File>;

    /// Writes all bytes.
    fn write(&mut self, file: &mut Self::File, bytes: &[u8]) -> io::Result<()>;

    /// Makes the content durable.
    fn sync(&mut self, file: &Self::File) -> io::Result<()>;

    /// Gives a file another name, in the place of one that has it.
    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()>;

    /// Gives a file another name, which no file has.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] if one has it, or the system's reason.
    fn rename_new(&mut self, from: &Path, to: &Path) -> io::Result<()>;

    /// Makes the names in a folder durable.
    fn sync_names(&mut self, folder: &Path) -> io::Result<()>;
}

/// The machine's own file system.
pub(super) struct System;

impl Disk for System {
    type File = File;

    fn make_folder(&mut self, folder: &Path) -> io::Result<()> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        fs::create_dir_all(folder)?;
        for parent in missing.into_iter().filter_map(Path::parent) {
            let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
            self.sync_names(parent)?;
        }
        Ok(())
    }

    fn create(&mut self, path: &Path) -> io::Result<File> {
        match fs::remove_file(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        // Only its owner reads what an operator has tuned.
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)
    }

    fn write(&mut self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        file.write_all(bytes)
    }

    fn sync(&mut self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn rename_new(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        // Storage that is mounted between the two steps does not have the file that is renamed.
        match fs::symlink_metadata(to) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let own = fs::symlink_metadata(from)?.ino();
                let renamed = fs::rename(from, to);
                // A network file system that missed the answer asks again, and has nothing to
                // rename any more.
                match fs::symlink_metadata(to) {
                    Ok(there) if there.ino() == own => Ok(()),
                    _ => renamed,
                }
            }
            Err(error) => Err(error),
            Ok(_) => Err(io::Error::new(ErrorKind::AlreadyExists, APPEARED)),
        }
    }

    fn sync_names(&mut self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use fastrand::Rng;
    use polyptych_protocol::ids::Revision;
    use polyptych_wall::Wall;

    use super::*;
    use crate::state_file::StateFile;
    use crate::state_file::found::decode;
    use polyptych_core::PersistentState;

    /// States that are acknowledged in an ordinary run.
    const ACKNOWLEDGED: u64 = 100_000;

    type Names = BTreeMap<PathBuf, usize>;

    /// The content of a file.
    #[derive(Clone, Debug, Default)]
    struct Content {
        in_memory: Vec<u8>,
        on_disk: Vec<u8>,
    }

    /// A file system that keeps what was synced, and of the rest what chance wants.
    struct Model {
        files: Vec<Content>,
        names: Names,
        /// The names as they were after each step since they were synced: any may be on the disk.
        names_on_disk: Vec<Names>,
        steps_left: u32,
    }

    impl Model {
        fn new() -> Self {
            let names_on_disk = vec![Names::new()];
            Self { files: Vec::new(), names: Names::new(), names_on_disk, steps_left: 0 }
        }

        fn step(&mut self) -> io::Result<()> {
            let left = self.steps_left.checked_sub(1);
            self.steps_left = left.ok_or_else(|| io::Error::other("the process has ended"))?;
            Ok(())
        }

        fn cut_power(&mut self, random: &mut Rng) {
            let at = random.usize(0..self.names_on_disk.len());
            self.names = self.names_on_disk.swap_remove(at);
            // Files without a name are gone.
            self.files = self.names.values().map(|&file| self.files[file].clone()).collect();
            for (file, at) in self.names.values_mut().enumerate() {
                *at = file;
            }
            self.names_on_disk = vec![self.names.clone()];
            for file in &mut self.files {
                let length = file.in_memory.len();
                if file.on_disk != file.in_memory {
                    file.on_disk = match random.u8(0..4) {
                        0 => file.on_disk.clone(),
                        1 => file.in_memory[..random.usize(0..=length)].to_vec(),
                        2 => vec![0; length],
                        _ => file.in_memory.clone(),
                    };
                }
                file.in_memory.clone_from(&file.on_disk);
            }
        }

        fn read(&self, path: &Path) -> Option<&[u8]> {
            Some(&self.files[*self.names.get(path)?].in_memory)
        }
    }

    impl Disk for Model {
        type File = usize;

        fn make_folder(&mut self, _: &Path) -> io::Result<()> {
            Ok(())
        }

        fn create(&mut self, path: &Path) -> io::Result<usize> {
            self.step()?;
            self.files.push(Content::default());
            self.names.insert(path.to_owned(), self.files.len() - 1);
            self.names_on_disk.push(self.names.clone());
            Ok(self.files.len() - 1)
        }

        fn write(&mut self, file: &mut usize, bytes: &[u8]) -> io::Result<()> {
            if let Err(error) = self.step() {
                self.files[*file].in_memory = bytes[..bytes.len() / 2].to_vec();
                return Err(error);
            }
            self.files[*file].in_memory = bytes.to_vec();
            Ok(())
        }

        fn sync(&mut self, file: &usize) -> io::Result<()> {
            self.step()?;
            let file = &mut self.files[*file];
            file.on_disk.clone_from(&file.in_memory);
            Ok(())
        }

        fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()> {
            self.step()?;
            let file = self.names.remove(from).ok_or(ErrorKind::NotFound)?;
            self.names.insert(to.to_owned(), file);
            self.names_on_disk.push(self.names.clone());
            Ok(())
        }

        fn rename_new(&mut self, from: &Path, to: &Path) -> io::Result<()> {
            if self.names.contains_key(to) {
                return Err(ErrorKind::AlreadyExists.into());
            }
            self.rename(from, to)
        }

        fn sync_names(&mut self, _: &Path) -> io::Result<()> {
            self.step()?;
            self.names_on_disk = vec![self.names.clone()];
            Ok(())
        }
    }

    fn memory(revision: u64) -> PersistentState {
        PersistentState {
            revision: Revision(revision),
            ..PersistentState::of_wall(&Wall::new("w", vec![], vec![]))
        }
    }

    /// Kills lose nothing that was acknowledged, and power cuts nothing that was to be durable.
    #[test]
    fn no_kill_and_no_power_cut_loses_what_was_acknowledged() {
        let mut random = Rng::with_seed(1);
        let path = PathBuf::from("state/wall");
        let mut state = StateFile::new(path.clone(), &Wall::new("w", vec![], vec![]));
        let mut disk = Model::new();
        // The last revision that was tried, acknowledged, and acknowledged as durable.
        let (mut tried, mut kept, mut durable) = (0, 0, 0);
        let (mut acknowledged, mut cuts) = (0, 0);
        while acknowledged < ACKNOWLEDGED {
            disk.steps_left = random.u32(0..60);
            // The process that is started now may find no file.
            state.expects_none = disk.read(&path).is_none();
            loop {
                tried += 1;
                let is_durable = random.bool();
                if let Err(error) = state.save_on(&mut disk, &memory(tried), is_durable) {
                    assert_ne!(error.kind(), ErrorKind::AlreadyExists, "the file is its own");
                    break;
                }
                acknowledged += 1;
                kept = tried;
                if is_durable {
                    durable = tried;
                }
            }
            let is_cut = random.bool();
            if is_cut {
                disk.cut_power(&mut random);
                cuts += 1;
            }
            let expected = if is_cut { durable } else { kept };
            let found = disk.read(&path).map(|bytes| decode(bytes).expect("whole"));
            let found = found.map_or(0, |saved| saved.memory.revision.0);
            assert!((expected..=tried).contains(&found), "{found} of {expected} to {tried}");
            kept = found;
            if is_cut {
                durable = found;
            }
        }
        println!("{acknowledged} states acknowledged, {cuts} power cuts");
    }
}
