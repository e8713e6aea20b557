//! `polyptych bake --upload`: puts the blobs of a bake into an object store.

use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use polyptych_baker::BakeCache;
use polyptych_files::blob::{BlobHash, StoreUrl};
use polyptych_object_store::{RemoteStore, Uploaded};
use polyptych_text::counted;

use super::Interruption;
use crate::cli::say;
use crate::progress;

/// The period in which an upload looks whether it was interrupted.
const CANCEL_PERIOD: Duration = Duration::from_millis(50);

/// Returns the object store that an argument names.
///
/// # Errors
/// It names none, or holds a secret; the text itself is not repeated.
pub(super) fn store_url(text: &str) -> anyhow::Result<StoreUrl> {
    match StoreUrl::from_text(text) {
        Ok(Some(url)) => Ok(url),
        Ok(None) => bail!(
            "--upload: it is no URL; write s3://BUCKET/PREFIX, or copy the folder `blobs` of a bake"
        ),
        Err(error) => bail!("--upload: {error}"),
    }
}

/// Returns the blobs of a scene that was baked, its manifest behind all others.
pub(super) fn blobs_of_scene(
    store: &BakeCache,
    manifest: BlobHash,
) -> anyhow::Result<Vec<BlobHash>> {
    let bytes =
        store.blobs().read(manifest)?.context("the manifest is gone; bake the file again")?;
    let scene: polyptych_scene::Scene = polyptych_scene::decode(&bytes)?;
    let mut blobs: Vec<BlobHash> = scene.blobs().filter(|hash| *hash != manifest).collect();
    blobs.sort_unstable();
    blobs.dedup();
    blobs.push(manifest);
    Ok(blobs)
}

/// Sends the blobs that are missing in the object store, and shows how far that is. An upload that
/// is interrupted leaves no parts of blobs there.
pub(super) fn upload(
    url: &StoreUrl,
    from: &BakeCache,
    blobs: &[BlobHash],
    interruption: &Interruption,
) -> anyhow::Result<Uploaded> {
    let bar = ProgressBar::with_draw_target(Some(blobs.len() as u64), progress::target());
    if let Ok(style) = ProgressStyle::with_template("{msg:>10} {wide_bar} {pos}/{len}") {
        bar.set_style(style);
    }
    bar.set_message("uploading");
    let mut threads = tokio::runtime::Builder::new_multi_thread();
    let runtime = threads.worker_threads(1).enable_all().build();
    let runtime = runtime.context("the upload can't be started")?;
    let store = RemoteStore::open(url.clone())?;
    let interrupted = async {
        while !interruption.is_asked.load(Ordering::Relaxed) {
            tokio::time::sleep(CANCEL_PERIOD).await;
        }
    };
    let tell = |so_far: &Uploaded| bar.set_position(so_far.done());
    interruption.is_uploading.store(true, Ordering::Relaxed);
    let uploaded = runtime.block_on(polyptych_object_store::upload(
        &store,
        from.blobs(),
        blobs,
        interrupted,
        tell,
    ));
    interruption.is_uploading.store(false, Ordering::Relaxed);
    bar.finish_and_clear();
    runtime.shutdown_background();
    uploaded?.context("interrupted; another upload goes on from here")
}

/// Says what an upload came to.
pub(super) fn say_uploaded(url: &StoreUrl, uploaded: &Uploaded) -> anyhow::Result<()> {
    let Uploaded { sent, sent_bytes, present } = *uploaded;
    let (sent, bytes) = (counted(sent, "blob"), counted(sent_bytes, "byte"));
    say(format_args!("uploaded to {url}: {sent} of {bytes} sent, {present} there before"))
}
