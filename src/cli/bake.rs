//! `polyptych bake`: foreign files in, blobs out. The manager runs it as a child process.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use polyptych_manager::bake::{Progress, Store, bake};
use rustix::process::{Resource, Rlimit, getrlimit, nice, setrlimit};

use super::say;

/// How much less important than a frame a bake is, on the scale of nice(1).
const NICENESS: i32 = 10;

/// How long a bake that was interrupted may go on to end in order.
const CANCEL_TIME_MAX: Duration = Duration::from_millis(500);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The .gltf or .glb file
    file: PathBuf,
    /// The folder to write to; bakes of several files can share one
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Print what was baked as one line of JSON
    #[arg(long)]
    json: bool,
    /// End when standard input ends, as it does when the parent process does
    #[arg(long, hide = true)]
    with_parent: bool,
    /// End rather than use more address space than this
    #[arg(long, value_name = "MIB")]
    memory_mib: Option<u64>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(mib) = arguments.memory_mib {
        let maximum = getrlimit(Resource::As).maximum;
        let limit = Rlimit { current: Some(mib << 20), maximum };
        setrlimit(Resource::As, limit).context("the memory limit can't be set")?;
        // Frames come first on a machine that also draws; without the right to it, so be it.
        let _ = nice(NICENESS);
    }
    let cancel = Arc::new(AtomicBool::new(false));
    cancel_on_interrupt(Arc::clone(&cancel), arguments.with_parent)?;
    let store = Store::open(&arguments.output)
        .with_context(|| format!("cannot use {}", arguments.output.display()))?;
    let bar = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{msg:>10} {wide_bar} {pos}/{len}") {
        bar.set_style(style);
    }
    let mut progress = |progress: Progress| {
        bar.set_message(progress.stage);
        bar.set_length(progress.total);
        bar.set_position(progress.done);
    };
    let baked = bake(&arguments.file, &store, &mut progress, &cancel);
    bar.finish_and_clear();
    let baked = baked?;
    if arguments.json {
        say(serde_json::to_string(&baked)?)?;
        return Ok(());
    }
    let how = if baked.reused { "was baked before" } else { "baked" };
    say(format_args!(
        "{} {how}: {} nodes, {} meshes, {} textures, {} triangles, {} bytes of blobs",
        baked.name, baked.nodes, baked.meshes, baked.textures, baked.triangles, baked.bytes
    ))?;
    for warning in &baked.warnings {
        say(format_args!("note: {warning}"))?;
    }
    say(format_args!("manifest {} in {}", baked.manifest, arguments.output.display()))?;
    Ok(())
}

fn cancel_on_interrupt(cancel: Arc<AtomicBool>, with_parent: bool) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.context("cannot wait for Ctrl-C")?;
    let watch = move || {
        runtime.block_on(super::asked_to_end(with_parent));
        cancel.store(true, Ordering::Relaxed);
        // Some steps on millions of vertices take seconds and look at nothing. Blobs appear whole
        // or not at all, so the store bears an end at any moment.
        std::thread::sleep(CANCEL_TIME_MAX);
        eprintln!("error: interrupted");
        std::process::exit(1);
    };
    let watcher = std::thread::Builder::new().name("interrupt".into()).spawn(watch);
    watcher.context("cannot start a thread; does the memory limit allow one?")?;
    Ok(())
}
