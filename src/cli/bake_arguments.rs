//! Arguments of commands that bake: scenes, and the files of walls.

use std::path::PathBuf;

use anyhow::Context;
use polyptych_baker::BakeCache;
use polyptych_manager::import::Baker;

use super::cache_folder;

/// Address space of one bake, in MiB: enough for scenes of several gigabytes, not for a bomb.
pub(super) const BAKE_MEMORY_MIB_DEFAULT: u64 = 8192;

/// The way to more memory for a command whose bakes end with it.
const COMMAND_REMEDY: &str = "give this command --bake-memory-mib N to allow more";

/// The program that runs, also once an upgrade has put another file in its place: this release
/// cannot read what the next one bakes. Each process finds its own behind this link; one that is
/// about to become a baker still has that of its parent.
const RUNNING_PROGRAM: &str = "/proc/self/exe";

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct BakeArguments {
    /// Memory that one bake may use
    #[arg(long, value_name = "MIB", default_value_t = BAKE_MEMORY_MIB_DEFAULT)]
    bake_memory_mib: u64,
}

impl BakeArguments {
    /// Returns the baker of a command whose bakes end with it, and stay in this user's cache
    /// folder.
    ///
    /// # Errors
    /// The user's cache folder or the path of this program is not known.
    pub fn baker(self) -> anyhow::Result<Baker> {
        self.baker_in(cache_folder()?.join("store"), COMMAND_REMEDY)
    }

    /// Returns the baker that writes to a folder; `memory_remedy` is that of [`Baker`]. The baker
    /// is this program as it runs.
    ///
    /// # Errors
    /// The path of this program is not known.
    pub fn baker_in(self, store: PathBuf, memory_remedy: &'static str) -> anyhow::Result<Baker> {
        let mut program = PathBuf::from(RUNNING_PROGRAM);
        if !program.exists() {
            program = std::env::current_exe().context("this program's own file is not known")?;
        }
        // A store that can't be opened is told to who opens a scene.
        if let Ok(store) = BakeCache::open(&store) {
            store.remove_abandoned();
        }
        Ok(Baker { program, memory_mib: self.bake_memory_mib, memory_remedy, store })
    }
}
