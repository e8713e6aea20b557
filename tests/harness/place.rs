//! A folder for one test, and the command `polyptych` as a stranger with that home would run it.

use std::ffi::OsStr;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;

use super::process::{Finished, Process};
use super::wait;

/// The command that is tested.
const POLYPTYCH: &str = env!("CARGO_BIN_EXE_polyptych");

/// A folder that is gone with the test.
#[derive(Debug)]
pub struct TestDir {
    folder: TempDir,
    program: PathBuf,
    cache: PathBuf,
    shaders: PathBuf,
}

impl TestDir {
    /// An empty folder; baked scenes are shared with the other tests of this run.
    pub fn new() -> Self {
        Self { cache: of_this_run().join("cache"), ..Self::unbaked() }
    }

    /// An empty folder whose user has never baked a scene. Compiled shaders are shared with the
    /// other tests of this run: compiling them takes longer than most tests do.
    pub fn unbaked() -> Self {
        Self { shaders: of_this_run().join("shaders"), ..Self::cold() }
    }

    /// An empty folder whose user has never baked a scene nor drawn one.
    pub fn cold() -> Self {
        let folder = tempfile::Builder::new().prefix("polyptych-test-").tempdir();
        let folder = folder.expect("a temporary folder");
        let [cache, shaders] = ["cache", "shaders"].map(|name| folder.path().join(name));
        Self { folder, program: POLYPTYCH.into(), cache, shaders }
    }

    /// The same folder with a command of another name, which the test has made.
    pub fn with_program(self, program: PathBuf) -> Self {
        Self { program, ..self }
    }

    /// Returns the path of the folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file in it, which no other user can read: it may hold a token.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(&path, bytes).expect("written");
        fs::set_permissions(&path, Permissions::from_mode(0o600)).expect("its owner's alone");
        path
    }

    /// The file with the token of this place's manager.
    pub fn token_file(&self) -> PathBuf {
        self.path("state/token")
    }

    /// The command with these arguments.
    pub fn command<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Command {
        let mut command = Command::new(&self.program);
        command
            .args(arguments)
            .current_dir(self.folder())
            .env("XDG_CACHE_HOME", &self.cache)
            .env("XDG_STATE_HOME", self.path("state"))
            .env("XDG_RUNTIME_DIR", self.folder())
            // What a killed process leaves behind goes with the test.
            .env("TMPDIR", self.folder())
            .env("POLYPTYCH_TOKEN_FILE", self.token_file())
            // Drivers keep compiled shaders there.
            .env("MESA_SHADER_CACHE_DIR", &self.shaders)
            .env("NO_COLOR", "1")
            .env_remove("POLYPTYCH_LOG")
            .env_remove("POLYPTYCH_KEYS")
            .env_remove("POLYPTYCH_MANAGER")
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY");
        command
    }

    /// Starts the command.
    pub fn start<A: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = A>,
    ) -> Process {
        Process::start(name, &mut self.command(arguments))
    }

    /// Runs the command to its end.
    #[track_caller]
    pub fn run<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Finished {
        self.start("polyptych", arguments).finish(wait::LIMIT)
    }
}

/// A folder that all tests of this run share; those of earlier runs are removed.
pub fn of_this_run() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let all = Path::new(env!("CARGO_TARGET_TMPDIR"));
        for entry in fs::read_dir(all).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_over = |pid: &str| !Path::new("/proc").join(pid).exists();
            if name.strip_prefix("run-").is_some_and(is_over) {
                // Another run may remove it at the same time.
                let _ = fs::remove_dir_all(entry.path());
            }
        }
        let folder = all.join(format!("run-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder for this run");
        folder
    })
}
