//! `polyptych bake`: foreign files in, blobs out. The manager runs it as a child process.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use glam::DVec3;
use indicatif::{ProgressBar, ProgressStyle};
use polyptych_baker::environment::{EnvironmentSource, bake_environment, default_sun};
use polyptych_baker::map::{MapUse, bake_map};
use polyptych_baker::{BakeCache, Baked, Progress, bake_added, bake_scene};
use polyptych_files::blob::StoreUrl;
use polyptych_object_store::Uploaded;
use polyptych_scene::OVERVIEW_NOTE;
use polyptych_text::counted;
use rustix::process::{Resource, Rlimit, getrlimit, nice, setrlimit};

use super::remote::say_notes;
use super::say;
use super::shutdown_signal::{parent_end, watch_shutdown_signals};
use crate::{logging, progress};

mod upload;

/// How much less important than a frame a bake is, on the scale of nice(1).
const NICENESS: i32 = 10;

/// Minimum time between two lines of progress.
const PROGRESS_PERIOD: Duration = Duration::from_millis(100);

/// How long a bake that was interrupted may go on to end in order.
const CANCEL_TIME_MAX: Duration = Duration::from_millis(500);

/// How long an upload may go on that was interrupted: object stores drop the parts of blobs.
const UPLOAD_CANCEL_TIME_MAX: Duration = Duration::from_secs(10);

/// The period in which the end of an upload is looked for.
const UPLOAD_LOOK_PERIOD: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The .gltf or .glb file, or with --as a file of a wall
    file: PathBuf,
    /// The folder to write to; bakes of several files can share one
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The scene of a file that has several, by its name or its number from 0 on [default: the one
    /// that the file names, or its first]
    #[arg(long, value_name = "NAME", conflicts_with = "used_as")]
    scene: Option<String>,
    /// The file is added to an open scene
    #[arg(long, hide = true, conflicts_with_all = ["scene", "used_as"])]
    added: bool,
    /// The file is not a scene, but one that a wall file names
    #[arg(long = "as", value_name = "USE")]
    used_as: Option<Use>,
    /// With --as warp: the channel's width by its height, which Bourke meshes are measured in
    #[arg(long, value_name = "NUMBER", requires = "used_as")]
    aspect: Option<f64>,
    /// With --as warp: pixels of a PFM that lie at (0, 0, 0) are unlit
    #[arg(long, requires = "used_as")]
    dark_zeros: bool,
    /// With --as warp: positions of an OBJ are places from -1 to 1 on the channel's picture, and
    /// its UV places on the screen's canvas, as SGCT has them
    #[arg(long, requires = "used_as")]
    sgct_roles: bool,
    /// With --as sky: the direction towards the sun as X,Y,Z, where Y is up; FILE is not read
    #[arg(long, value_name = "X,Y,Z", requires = "used_as", value_parser = direction)]
    #[arg(allow_hyphen_values = true)]
    sun: Option<DVec3>,
    /// Put the blobs that are missing there into an object store too, such as
    /// s3://BUCKET/PREFIX; credentials and endpoint come from the environment
    #[arg(long, value_name = "URL")]
    upload: Option<String>,
    /// Fail if anything of a scene is not drawn as its file has it; the notes say what
    #[arg(long, conflicts_with = "used_as")]
    strict: bool,
    /// Print what was baked as one line of JSON
    #[arg(long)]
    json: bool,
    /// Print the percentage that is done as lines of JSON before the result
    #[arg(long, hide = true, requires = "json")]
    progress: bool,
    /// End when standard input ends, as it does when the parent process does
    #[arg(long, hide = true)]
    with_parent: bool,
    /// End rather than use more address space than this
    #[arg(long, value_name = "MIB", visible_alias = "bake-memory-mib")]
    memory_mib: Option<u64>,
}

/// What a wall file names a file for.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Use {
    /// Where the pixels of a channel lie: PFM, OBJ, glTF, a PNG of UV, or a Bourke mesh
    Warp,
    /// The surface of a screen: OBJ or glTF
    ScreenMesh,
    /// Light of the pixels of a channel: PNG
    Mask,
    /// What surrounds scenes: an equirectangular Radiance .hdr
    Environment,
    /// What surrounds scenes: a computed clear sky
    Sky,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let url = arguments.upload.as_deref().map(upload::store_url).transpose()?;
    arguments.memory_mib.map_or(Ok(()), limit_memory)?;
    let interruption = Arc::<Interruption>::default();
    cancel_on_interrupt(&interruption, arguments.with_parent)?;
    let store = BakeCache::open(&arguments.output)
        .with_context(|| format!("cannot use {}", arguments.output.display()))?;
    if let Some(used_as) = arguments.used_as {
        return run_map(arguments, used_as, &store, url.as_ref(), &interruption);
    }
    let bar = ProgressBar::with_draw_target(None, progress::target());
    if let Ok(style) = ProgressStyle::with_template("{msg:>10} {wide_bar} {pos}/{len}") {
        bar.set_style(style);
    }
    let mut percents = Percents::default();
    let mut progress = |progress: Progress| {
        if arguments.progress {
            percents.print(progress.percent());
        }
        bar.set_message(progress.stage);
        bar.set_length(progress.total);
        bar.set_position(progress.done);
    };
    let (file, scene) = (&arguments.file, arguments.scene.as_deref());
    let cancel = &interruption.is_asked;
    let baked = if arguments.added {
        bake_added(file, &store, &mut progress, cancel)
    } else {
        bake_scene(file, scene, &store, &mut progress, cancel)
    };
    bar.finish_and_clear();
    let baked = baked?;
    let is_drawn_otherwise = |note: &&String| !note.starts_with(OVERVIEW_NOTE);
    let of_picture = || baked.warnings.iter().filter(is_drawn_otherwise);
    if let Some(first) = of_picture().next().filter(|_| arguments.strict) {
        if arguments.json {
            say_json(&baked, None)?;
        } else {
            say_notes(&baked.warnings)?;
        }
        let (file, notes) = (arguments.file.display(), counted(of_picture().count(), "note"));
        bail!("{file} would not be drawn as it is, which --strict asks for; {notes}: {first}");
    }
    let uploaded = match &url {
        None => None,
        Some(url) => {
            let blobs = upload::blobs_of_scene(&store, baked.manifest)?;
            Some(upload::upload(url, &store, &blobs, &interruption)?)
        }
    };
    if arguments.json {
        return say_json(&baked, uploaded.as_ref());
    }
    let how = if baked.reused { "was baked before" } else { "baked" };
    say(format_args!(
        "{} {how}: {}, {}, {}, {}, {} of blobs",
        baked.name,
        counted(baked.nodes, "node"),
        counted(baked.meshes, "mesh"),
        counted(baked.textures, "texture"),
        counted(baked.triangles, "triangle"),
        counted(baked.bytes, "byte")
    ))?;
    if let Some(levels) = levels(&baked) {
        say(levels)?;
    }
    say_notes(&baked.warnings)?;
    say(format_args!("manifest {} in {}", baked.manifest, arguments.output.display()))?;
    say_uploaded(url.as_ref(), uploaded.as_ref())
}

fn say_uploaded(url: Option<&StoreUrl>, uploaded: Option<&Uploaded>) -> anyhow::Result<()> {
    url.zip(uploaded).map_or(Ok(()), |(url, uploaded)| upload::say_uploaded(url, uploaded))
}

/// Prints what was baked and uploaded as one line of JSON.
fn say_json(baked: &impl serde::Serialize, uploaded: Option<&Uploaded>) -> anyhow::Result<()> {
    let mut json = serde_json::to_value(baked)?;
    if let Some(Uploaded { sent, sent_bytes, present }) = uploaded {
        json["uploaded"] =
            serde_json::json!({ "sent": sent, "sent_bytes": sent_bytes, "present": present });
    }
    say(json)
}

/// Returns what levels of detail there are beside the finest one, or `None` if there are none.
fn levels(baked: &Baked) -> Option<String> {
    let coarser = baked.levels.get(1..).filter(|coarser| !coarser.is_empty())?;
    let each = coarser.iter().map(|level| format!("{} ({:.2e} m)", level.triangles, level.error_m));
    let each: Vec<String> = each.collect();
    let angle = baked.normal_angle_deg;
    Some(format!(
        "coarser levels, as triangles and largest error: {}; \
         normals differ by up to {angle:.0} degrees",
        each.join(", ")
    ))
}

/// Lines that tell a parent process how much is done.
#[derive(Debug, Default)]
struct Percents {
    printed: Option<(u8, Instant)>,
}

impl Percents {
    /// Prints the percentage, unless it is as before or the last one was printed just now.
    fn print(&mut self, percent: u8) {
        let is_due = |(before, at): (u8, Instant)| {
            percent > before && (at.elapsed() >= PROGRESS_PERIOD || percent == 100)
        };
        if self.printed.is_none_or(is_due) {
            self.printed = Some((percent, Instant::now()));
            // A parent that does not listen any more ends this process in another way.
            let _ = say(format_args!("{{\"percent\":{percent}}}"));
        }
    }
}

/// Makes this process one that may read foreign files: it ends rather than take more memory.
pub(super) fn limit_memory(mib: u64) -> anyhow::Result<()> {
    let maximum = getrlimit(Resource::As).maximum;
    let wanted = mib.saturating_mul(1 << 20);
    let current = maximum.map_or(wanted, |maximum| wanted.min(maximum));
    if current < wanted {
        let allowed = current >> 20;
        logging::say_warning(&format!(
            "the baker has {allowed} MiB of address space instead of {mib} MiB, as the system \
             allows this user no more (ulimit -v)"
        ));
    }
    let limit = Rlimit { current: Some(current), maximum };
    setrlimit(Resource::As, limit).context("the memory limit can't be set")?;
    // Frames come first on a machine that also draws; without the right to it, so be it.
    let _ = nice(NICENESS);
    Ok(())
}

fn run_map(
    arguments: &Arguments,
    used_as: Use,
    store: &BakeCache,
    url: Option<&StoreUrl>,
    interruption: &Interruption,
) -> anyhow::Result<()> {
    let is_shape = |aspect: &f64| aspect.is_finite() && *aspect > 0.0;
    if let Some(aspect) = arguments.aspect.filter(|aspect| !is_shape(aspect)) {
        bail!("--aspect {aspect}: a width by a height, such as 1.778, would be right");
    }
    let used_as = match used_as {
        Use::Warp => MapUse::Warp {
            aspect: arguments.aspect,
            dark_zeros: arguments.dark_zeros,
            sgct_roles: arguments.sgct_roles,
        },
        Use::ScreenMesh => MapUse::ScreenMesh,
        Use::Mask => MapUse::Mask,
        Use::Environment => {
            let source = EnvironmentSource::File(&arguments.file);
            return run_environment(arguments, source, store, url, interruption);
        }
        Use::Sky => {
            let sun = arguments.sun.unwrap_or_else(default_sun);
            let source = EnvironmentSource::Sky { sun };
            return run_environment(arguments, source, store, url, interruption);
        }
    };
    let baked = bake_map(&arguments.file, used_as, store, &interruption.is_asked)?;
    let upload = |url| upload::upload(url, store, &[baked.blob], interruption);
    let uploaded = url.map(upload).transpose()?;
    if arguments.json {
        return say_json(&baked, uploaded.as_ref());
    }
    say(&baked.what)?;
    say(format_args!("blob {} in {}", baked.blob, arguments.output.display()))?;
    say_uploaded(url, uploaded.as_ref())
}

fn run_environment(
    arguments: &Arguments,
    source: EnvironmentSource<'_>,
    store: &BakeCache,
    url: Option<&StoreUrl>,
    interruption: &Interruption,
) -> anyhow::Result<()> {
    let baked = bake_environment(source, store, &interruption.is_asked)?;
    let upload = |url| upload::upload(url, store, &[baked.blob], interruption);
    let uploaded = url.map(upload).transpose()?;
    if arguments.json {
        return say_json(&baked, uploaded.as_ref());
    }
    say(&baked.what)?;
    say_notes(&baked.warning.into_iter().collect::<Vec<_>>())?;
    say(format_args!("blob {} in {}", baked.blob, arguments.output.display()))?;
    say_uploaded(url, uploaded.as_ref())
}

/// A direction as an argument: three numbers, not all 0.
fn direction(text: &str) -> Result<DVec3, String> {
    let wrong = || format!("{text:?} is no direction; write X,Y,Z, such as 0.5,0.7,0.5");
    let numbers: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    let [x, y, z] = numbers[..] else { return Err(wrong()) };
    let direction = DVec3::new(x, y, z);
    let is_one = text.split(',').count() == 3 && direction.try_normalize().is_some();
    is_one.then_some(direction).ok_or_else(wrong)
}

/// The requests to this process to end, and the work that it must not leave undone.
#[derive(Debug, Default)]
struct Interruption {
    /// The process is to end in order.
    is_asked: AtomicBool,
    /// Blobs are on their way to an object store.
    is_uploading: AtomicBool,
}

/// Ends this process in order at the first request, and at once at the second.
fn cancel_on_interrupt(interruption: &Arc<Interruption>, with_parent: bool) -> anyhow::Result<()> {
    let interruption = Arc::clone(interruption);
    let on_request = move || {
        if interruption.is_asked.swap(true, Ordering::Relaxed) {
            end("interrupted again");
        }
        let waited = Arc::clone(&interruption);
        let wait = move || end_in_order(&waited);
        // The memory limit may allow no other thread.
        if std::thread::Builder::new().name("cancel".into()).spawn(wait).is_err() {
            end_in_order(&interruption);
        }
    };
    let parent = with_parent.then(parent_end).transpose();
    let watched = parent.and_then(|parent| watch_shutdown_signals(parent, on_request));
    watched.context("cannot wait for Ctrl-C; does the memory limit allow a thread?")
}

/// Ends this process once it has had the time to end by itself.
fn end_in_order(interruption: &Interruption) {
    let began = Instant::now();
    let is_uploading = || interruption.is_uploading.load(Ordering::Relaxed);
    while is_uploading() && began.elapsed() < UPLOAD_CANCEL_TIME_MAX {
        std::thread::sleep(UPLOAD_LOOK_PERIOD);
    }
    // Some steps on millions of vertices take seconds and look at nothing. Blobs appear whole or
    // not at all, so the store bears an end at any moment.
    std::thread::sleep(CANCEL_TIME_MAX);
    end("interrupted");
}

fn end(why: &str) -> ! {
    logging::say_failure("bake", &format!("error: {why}"));
    logging::finish();
    std::process::exit(1);
}
