//! The files of a wall: baked before anything uses the wall, which then names their blobs.

use std::path::Path;
use std::sync::Arc;

use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::warp::CalibrationMap;
use polyptych_wall::{CalibrationFileKind, Wall};

use super::{Baker, bake};

/// Maximum difference between the width-to-height ratios of channels that share a Bourke mesh.
const ASPECT_TOLERANCE: f64 = 1e-3;

/// Has the baker read every file of a wall, one after the other, and stores their blobs in the
/// wall. Returns warnings about what may not be meant. `folder` is the wall file's, from which
/// paths begin. Files are read at every start: the name of a blob is that of the file's present
/// content.
///
/// # Errors
/// One line: the key that names the file in the wall file, the file, what is wrong with it and
/// what would be right.
pub fn bake_wall_files(
    wall: &mut Wall,
    folder: &Path,
    baker: &Baker,
) -> Result<Vec<String>, String> {
    let mut warnings = Vec::new();
    if wall.files.is_empty() {
        return Ok(warnings);
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| format!("the baker could not be awaited: {error}"))?;
    for index in 0..wall.files.len() {
        let (file, options) = (&wall.files[index], options(wall, index));
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let about = |what: String| format!("{}: {what}", wall.key_of_file(index));
        let baked = runtime.block_on(bake(&folder.join(&file.path), baker, &options, |_| {}));
        let baked = baked.map_err(about)?;
        let hash = baked.pointer("/blob").and_then(|hash| hash.as_str());
        let hash = hash.and_then(BlobHash::from_hex);
        let about = |what: &str| format!("{}: {}: {what}", wall.key_of_file(index), file.path);
        let hash = hash.ok_or_else(|| about("the baker named no blob"))?;
        tracing::debug!(file = file.path, what = %baked["what"], "a file of the wall was read");
        if let Some(warning) = baked.get("warning").and_then(serde_json::Value::as_str) {
            warnings.push(about(warning));
        }
        let is_for_one_eye = baked.pointer("/is_for_one_eye").and_then(serde_json::Value::as_bool);
        let front = baked.get("front").cloned().unwrap_or_default();
        let front =
            serde_json::from_value(front).map_err(|_| about("the baker named no places"))?;
        let file = &mut wall.files[index];
        (file.blob, file.front) = (Some(hash), front);
        file.is_for_one_eye = is_for_one_eye == Some(true);
    }
    Ok(warnings)
}

/// The files of a wall as the baker left them in a folder of blobs.
///
/// # Errors
/// The key and the file whose blob is gone or damaged.
pub fn read_wall_files(wall: &Wall, blobs: &BlobStore) -> Result<CalibrationMaps, String> {
    CalibrationMaps::load(wall, |hash| {
        let bytes = blobs.read(hash).map_err(|error| error.to_string())?;
        let bytes = bytes.ok_or_else(|| "its blob is not in the store any more".to_owned())?;
        CalibrationMap::decode(&bytes).map(Arc::new)
    })
}

/// Returns the options that tell the baker what a file is.
fn options(wall: &Wall, index: usize) -> Vec<String> {
    let used_as = match wall.files[index].kind {
        CalibrationFileKind::Warp
        | CalibrationFileKind::WarpDarkZeros
        | CalibrationFileKind::WarpSgct => "warp",
        CalibrationFileKind::ScreenMesh => "screen-mesh",
        CalibrationFileKind::Alpha | CalibrationFileKind::Beta => "mask",
    };
    let mut options = vec!["--as".to_owned(), used_as.to_owned()];
    match wall.files[index].kind {
        CalibrationFileKind::WarpDarkZeros => options.push("--dark-zeros".to_owned()),
        CalibrationFileKind::WarpSgct => options.push("--sgct-roles".to_owned()),
        _ => {}
    }
    if let Some(aspect) = aspect(wall, index) {
        options.extend(["--aspect".to_owned(), aspect.to_string()]);
    }
    options
}

/// Width by height of the channels that a warp file is for, where they have one shape.
fn aspect(wall: &Wall, index: usize) -> Option<f64> {
    let uses = |file: Option<u16>| file.is_some_and(|file| usize::from(file) == index);
    let channels = wall.channels.iter().filter(|channel| uses(channel.adjustment.warp));
    let mut shapes = channels.map(|channel| f64::from(channel.size.x) / f64::from(channel.size.y));
    let first = shapes.next()?;
    shapes.all(|shape| (shape - first).abs() < ASPECT_TOLERANCE).then_some(first)
}

#[cfg(test)]
mod tests {
    use glam::UVec2;
    use polyptych_wall::{CalibrationFile, Channel};

    use super::*;

    #[test]
    fn the_baker_hears_what_a_file_is_and_for_which_shape() {
        let mut wall = Wall::new("w", Vec::new(), Vec::new());
        for (name, size) in [("a", [1920, 1080]), ("b", [1280, 720]), ("c", [1024, 768])] {
            let mut channel = Channel::tile(name, 0, UVec2::ZERO, UVec2::from(size));
            channel.adjustment.warp = Some(u16::from(name == "c"));
            channel.adjustment.alpha = Some(2);
            wall.channels.push(channel);
        }
        for kind in [
            CalibrationFileKind::Warp,
            CalibrationFileKind::Warp,
            CalibrationFileKind::Alpha,
            CalibrationFileKind::ScreenMesh,
        ] {
            wall.files.push(CalibrationFile {
                path: "x".into(),
                kind,
                blob: None,
                is_for_one_eye: false,
                front: Vec::new(),
            });
        }
        assert_eq!(options(&wall, 0), ["--as", "warp", "--aspect", "1.7777777777777777"]);
        assert_eq!(options(&wall, 2), ["--as", "mask"]);
        assert_eq!(options(&wall, 3), ["--as", "screen-mesh"]);
        wall.channels[2].adjustment.warp = Some(0);
        assert_eq!(options(&wall, 0), ["--as", "warp"], "of several shapes");
    }
}
