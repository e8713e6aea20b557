//! Opens a scene: finds the file, has it baked by a child process, reads the manifest. The files of
//! a wall go the same way: [`bake_wall_files`].

mod wall_files;

pub use wall_files::{bake_wall_files, read_wall_files};

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::clip::ClipSummary;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::request::SceneSummary;
use polyptych_protocol::scene_file_list::SCENE_FOLDERS;
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{Animations, Clip, Scene, SceneFeatures, SceneOutline};
use tokio::io::{AsyncBufReadExt, AsyncReadExt, BufReader};
use tokio::process::Command;

use polyptych_core::{EditedScene, ImportedScene};

/// Maximum time of a bake; a scene of ten gigabytes takes a few minutes.
const BAKE_TIME_MAX: Duration = Duration::from_mins(30);

/// Maximum time between two reports of a bake's progress: who waits can tell a long step from a
/// manager that hangs.
pub(crate) const SILENCE_MAX: Duration = Duration::from_secs(5);

/// Maximum bytes of a baker's output that are read: a line, or its reason for failing.
const BAKE_OUTPUT_BYTES_MAX: u64 = 64 << 10;

/// The baker, as the manager starts it.
#[derive(Clone, Debug)]
pub struct Baker {
    /// The program; it is given `bake FILE -o DIR --json --memory-mib N`.
    pub program: PathBuf,
    /// Address space that it may use, in MiB.
    pub memory_mib: u64,
    /// The way to allow it more, as an instruction for errors of bakes that ran out of it.
    pub memory_remedy: &'static str,
    /// The folder that it writes to.
    pub store: PathBuf,
}

/// An imported scene and the blobs that servers may now ask for.
pub(crate) struct Import {
    pub scene: ImportedScene,
    pub blobs: Vec<BlobHash>,
}

/// The file that a client means, which must lie in one of the scene folders after all links and
/// `..` are resolved.
///
/// # Errors
/// The reason why there is no such file.
pub fn resolve(path: &str, roots: &[PathBuf]) -> Result<PathBuf, String> {
    let asked = Path::new(path);
    let candidates: Vec<PathBuf> = if asked.is_absolute() {
        vec![asked.to_owned()]
    } else {
        roots.iter().map(|root| root.join(asked)).collect()
    };
    let list = || {
        let roots: Vec<_> = roots.iter().map(|root| root.display().to_string()).collect();
        if roots.is_empty() { "none".to_owned() } else { roots.join(", ") }
    };
    let mut is_outside = false;
    for candidate in candidates {
        let Ok(found) = candidate.canonicalize() else { continue };
        let is_inside = roots
            .iter()
            .filter_map(|root| root.canonicalize().ok())
            .any(|root| found.starts_with(root));
        match (is_inside, found.is_file()) {
            (true, true) => return Ok(found),
            (true, false) => return Err(format!("{path}: not a file; name a .gltf or .glb file")),
            (false, _) => is_outside = true,
        }
    }
    Err(if is_outside {
        format!("{path}: outside {SCENE_FOLDERS} ({})", list())
    } else {
        format!("{path}: not found in {SCENE_FOLDERS} ({})", list())
    })
}

/// Bakes a scene of a file, or the one that the file names, and reads what came of it.
///
/// `tell` is given the percentage of the bake that is done, at least every [`SILENCE_MAX`].
pub(crate) async fn import(
    (path, scene): (&str, Option<&str>),
    roots: &[PathBuf],
    baker: &Baker,
    tell: impl Fn(u8),
) -> Result<Import, String> {
    let file = resolve(path, roots)?;
    tell(0);
    let hash = bake_scene(&file, scene, baker, tell).await?;
    let folder = BlobStore::new(baker.store.join("blobs"));
    let read = tokio::task::spawn_blocking(move || read_manifest(&folder, hash)).await;
    read.map_err(|error| error.to_string())?.map_err(|reason| format!("{path}: {reason}"))
}

/// Bakes a scene of a file, or the one that the file names; gives the hash of its manifest.
async fn bake_scene(
    file: &Path,
    scene: Option<&str>,
    baker: &Baker,
    tell: impl Fn(u8),
) -> Result<BlobHash, String> {
    // One argument, as a name may begin with a hyphen.
    let scene = scene.map(|scene| format!("--scene={scene}"));
    let options: Vec<&str> = std::iter::once("--progress").chain(scene.as_deref()).collect();
    let baked = bake(file, baker, &options, tell).await?;
    manifest_of(&baked, file)
}

/// Bakes a file that is added to an open scene; gives the hash of its manifest.
pub(crate) async fn bake_added(file: &Path, baker: &Baker) -> Result<BlobHash, String> {
    let baked = bake(file, baker, &["--added"], |_| {}).await?;
    manifest_of(&baked, file)
}

/// The hash of the manifest in what a baker says of a file.
fn manifest_of(baked: &serde_json::Value, file: &Path) -> Result<BlobHash, String> {
    let hash = baked.pointer("/manifest").and_then(|hash| hash.as_str());
    let hash = hash.and_then(BlobHash::from_hex);
    hash.ok_or_else(|| format!("{}: the baker named no manifest", file.display()))
}

/// Bakes a file that becomes one blob. Returns its hash, and what the baker says of it.
pub(crate) async fn bake_blob(
    file: &Path,
    baker: &Baker,
    options: &[&str],
) -> Result<(BlobHash, Option<String>), String> {
    let baked = bake(file, baker, options, |_| {}).await?;
    let hash = baked.pointer("/blob").and_then(|hash| hash.as_str());
    let hash = hash.and_then(BlobHash::from_hex);
    let hash = hash.ok_or_else(|| format!("{}: the baker named no blob", file.display()))?;
    let warning = baked.get("warning").and_then(serde_json::Value::as_str);
    Ok((hash, warning.map(str::to_owned)))
}

/// Reads a manifest that was baked.
pub(crate) fn read_scene(folder: &BlobStore, manifest: BlobHash) -> Result<Scene, String> {
    let bytes = folder.read(manifest).map_err(|error| error.to_string())?;
    let bytes = bytes.ok_or("the scene's manifest is not in the store")?;
    let scene: Scene = polyptych_scene::decode(&bytes).map_err(|error| error.to_string())?;
    scene.fault().map_or(Ok(scene), Err)
}

/// The animations of a scene, as clients are told of them.
fn clips(animations: &Animations) -> Vec<ClipSummary> {
    let played = animations.played_unasked();
    let summary = |(index, clip): (u32, &Clip)| ClipSummary {
        name: clip.name.clone(),
        duration_s: clip.duration_s(),
        is_played: played.binary_search(&index).is_ok(),
    };
    (0..).zip(&animations.clips).map(summary).collect()
}

pub(crate) fn read_manifest(folder: &BlobStore, hash: BlobHash) -> Result<Import, String> {
    let scene = read_scene(folder, hash)?;
    let summary = SceneSummary {
        name: scene.name.clone(),
        revision: Revision(0),
        bounds: scene.bounds,
        triangles: scene.triangles(),
        features: SceneFeatures::from_scene(&scene),
        notes: scene.notes.clone(),
        exposure: scene.exposure.unwrap_or(1.0),
        clips: clips(&scene.animations),
    };
    let blobs = std::iter::once(hash).chain(scene.blobs()).collect();
    let outline = Arc::new(SceneOutline::from(&scene));
    let edits = scene.first_edits();
    let scene = SceneRef { name: scene.name, manifest: hash };
    let scene = ImportedScene { edits, ..ImportedScene::of_file(scene, summary, outline) };
    Ok(Import { scene, blobs })
}

/// A scene with all that was changed of it, under the name that it has now.
pub(crate) fn read_edited(
    folder: &BlobStore,
    EditedScene { scene, edits, next_node }: EditedScene,
) -> Result<Import, String> {
    let mut import = read_manifest(folder, scene.manifest)?;
    for manifest in edits.asset_manifests() {
        import.blobs.extend(read_manifest(folder, manifest)?.blobs);
    }
    import.scene.summary.name.clone_from(&scene.name);
    import.scene.scene.name = scene.name;
    (import.scene.edits, import.scene.next_node) = (edits, next_node);
    Ok(import)
}

/// Runs the baker on a file, which is a scene unless `options` say otherwise. Gives its progress in
/// percent to `tell`, and returns the JSON that it prints.
async fn bake(
    file: &Path,
    baker: &Baker,
    options: &[&str],
    tell: impl Fn(u8),
) -> Result<serde_json::Value, String> {
    let mut command = Command::new(&baker.program);
    command
        // The program may be a link by which no list of processes should name it.
        .arg0("polyptych")
        .arg("bake")
        .arg(file)
        .arg("-o")
        .arg(&baker.store)
        .arg("--json")
        .args(options)
        .args(["--memory-mib", &baker.memory_mib.to_string()])
        .arg("--with-parent")
        // Each thread that allocates reserves 64 MiB of the address space that it may take.
        .env("MALLOC_ARENA_MAX", "8")
        // Its last line is read below, whatever form this process's own log has.
        .args(["--log", "text,warn"])
        // Held until the baker has ended: should this process end, the baker's input does too.
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        // Ctrl-C in a terminal goes to a whole group: were the baker in this one, its death could
        // be taken for a failure before this process has heard the same signal.
        .process_group(0)
        .kill_on_drop(true);
    let cannot = |error| format!("the baker {} could not run: {error}", baker.program.display());
    let mut child = command.spawn().map_err(cannot)?;
    let _input = child.stdin.take();
    let stdout = child.stdout.take();
    let stderr = child.stderr.take();
    let work = async {
        let (last, err) = tokio::join!(read_lines(stdout, SILENCE_MAX, tell), read_some(stderr));
        (last, err, child.wait().await)
    };
    let (last, err, status) = tokio::time::timeout(BAKE_TIME_MAX, work).await.map_err(|_| {
        let (file, store, time) = (file.display(), baker.store.display(), BAKE_TIME_MAX.as_secs());
        format!(
            "{file}: not baked within {time} s; `polyptych bake {file} -o {store}` takes as long \
             as it needs, and what it has made is found here"
        )
    })?;
    let status = status.map_err(cannot)?;
    if std::os::unix::process::ExitStatusExt::signal(&status).is_some() {
        // An allocation that fails aborts: the limit did its work.
        let (file, mib, remedy) = (file.display(), baker.memory_mib, baker.memory_remedy);
        return Err(format!(
            "{file}: the baker ended ({status}); it may use {mib} MiB of memory: {remedy}"
        ));
    }
    if !status.success() {
        let reason = err.lines().rev().find(|line| !line.trim().is_empty());
        let reason = reason.map_or_else(
            || format!("{}: the baker ended ({status})", file.display()),
            |line| line.trim_start_matches("error: ").to_owned(),
        );
        return Err(reason);
    }
    serde_json::from_str(&last).map_err(|error| format!("{}: {error}", file.display()))
}

/// Reads what a baker writes to its standard output, and returns its last line of JSON that is
/// not about its progress. Passes on the percentage of each of those, again after each `silence`.
async fn read_lines<R: tokio::io::AsyncRead + Unpin>(
    stream: Option<R>,
    silence: Duration,
    tell: impl Fn(u8),
) -> String {
    let mut last = String::new();
    let Some(stream) = stream else { return last };
    let mut stream = BufReader::new(stream);
    let (mut line, mut percent) = (Vec::new(), 0);
    loop {
        let room = BAKE_OUTPUT_BYTES_MAX.saturating_sub(line.len() as u64);
        // What was read before a silence stays in `line`.
        let mut limited = (&mut stream).take(room);
        let read = tokio::time::timeout(silence, limited.read_until(b'\n', &mut line)).await;
        match read {
            Err(_) => tell(percent),
            // A stream that breaks off has said all that it will say.
            Ok(Ok(0) | Err(_)) => return last,
            Ok(Ok(_)) => {
                let text = String::from_utf8_lossy(&line).into_owned();
                line.clear();
                if let Some(done) = percent_of(&text) {
                    percent = done;
                    tell(percent);
                } else if text.starts_with('{') {
                    last = text;
                }
            }
        }
    }
}

/// The percentage of a line such as `{"percent":40}`.
fn percent_of(line: &str) -> Option<u8> {
    let number = line.trim_end().strip_prefix("{\"percent\":")?.strip_suffix('}')?;
    number.parse().ok().filter(|percent| *percent <= 100)
}

/// The beginning of what a child writes; the rest is read and dropped, so that it never blocks.
async fn read_some<R: tokio::io::AsyncRead + Unpin>(stream: Option<R>) -> String {
    let Some(mut stream) = stream else { return String::new() };
    let mut bytes = Vec::new();
    // A stream that breaks off has said all that it will say.
    let _ = (&mut stream).take(BAKE_OUTPUT_BYTES_MAX).read_to_end(&mut bytes).await;
    let _ = tokio::io::copy(&mut stream, &mut tokio::io::sink()).await;
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use tokio::io::AsyncWriteExt;

    use super::*;

    async fn read(text: &str) -> (String, Vec<u8>) {
        let told = RefCell::new(Vec::new());
        let tell = |percent| told.borrow_mut().push(percent);
        let last = read_lines(Some(text.as_bytes()), SILENCE_MAX, tell);
        (last.await, told.into_inner())
    }

    #[tokio::test]
    async fn progress_of_a_baker_is_passed_on_and_its_result_is_the_last_line_of_json() {
        let text = "{\"percent\":4}\nwords\n{\"percent\":101}\n{\"a\":1}\n{\"percent\":100}\n";
        let (last, told) = read(text).await;
        // What is no percentage is no progress either.
        assert_eq!((last.trim_end(), told), ("{\"a\":1}", vec![4, 100]));
        let (last, told) = read("{\"percent\":-1}").await;
        assert_eq!((last.as_str(), told), ("{\"percent\":-1}", Vec::new()));
    }

    #[tokio::test]
    async fn a_line_without_end_is_not_kept() {
        let endless = "x".repeat(BAKE_OUTPUT_BYTES_MAX as usize * 3);
        assert_eq!(read(&endless).await, (String::new(), Vec::new()));
    }

    #[tokio::test]
    async fn a_silent_baker_is_said_to_be_where_it_was() {
        let (mut write, stream) = tokio::io::duplex(64);
        let told = RefCell::new(Vec::new());
        let tell = |percent| told.borrow_mut().push(percent);
        let reading = read_lines(Some(stream), Duration::from_millis(1), tell);
        let writing = async {
            write.write_all(b"{\"percent\":7}\n{\"perc").await.expect("written");
            while told.borrow().len() < 3 {
                tokio::task::yield_now().await;
            }
            write.write_all(b"ent\":8}\n").await.expect("written");
            drop(write);
        };
        tokio::join!(reading, writing);
        let told = told.into_inner();
        assert_eq!((&told[..3], told.last()), (&[7, 7, 7][..], Some(&8)));
    }
}
