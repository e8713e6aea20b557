//! `polyptych open` and `shot`: one request to a running manager each.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::bail;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{ClientError, SCENE_FOLDERS, SceneFile, SceneSummary, fit_bounds};
use polyptych_text::{counted, printable};

use super::progress::ProgressReport;
use super::seen::{Seen, await_displays};
use super::surroundings::factor;
use super::{ManagerAddress, say, seconds};
use crate::{image_files, outputs};

#[derive(Debug, clap::Args)]
pub(super) struct OpenArguments {
    /// A .gltf or .glb file in one of the manager's scene folders
    file: String,
    /// The scene of a file that has several, by its name or its number from 0 on [default: the one
    /// that the file names, or its first]
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Leave the camera where it is, instead of placing it so that the whole scene is seen
    #[arg(long)]
    keep_camera: bool,
    /// Where the camera looks from, in degrees around the vertical; 0 is the scene's +Z side
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, conflicts_with = "keep_camera")]
    heading: f64,
    /// Multiply all light by this [default: 1, or what suits lights in real units]
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    exposure: Option<f32>,
    /// Wait at most this long for displays that are not there or not ready [default: 60 for those
    /// that get ready, 5 for servers that may be on their way]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// The path of a scene as the manager is to resolve it: one that is meant from here must say where
/// here is.
fn path_from_here(file: &str) -> String {
    let from_here = std::path::absolute(file).ok().filter(|path| path.is_file());
    from_here.map_or_else(|| file.to_owned(), |path| path.display().to_string())
}

/// Asks for a file that is here, and where that is none of the manager's, for the one of this name
/// in its folders. Whatever else becomes of a request, it is made once.
///
/// # Errors
/// The manager has neither, or the request for the one that it has failed.
pub(super) fn here_or_there<T>(
    file: &str,
    mut ask: impl FnMut(&str) -> Result<T, ClientError>,
) -> Result<T, ClientError> {
    let here = path_from_here(file);
    match ask(&here) {
        Err(refused) if here != file && is_elsewhere(&refused) => {
            ask(file).map_err(|other| if is_elsewhere(&other) { refused } else { other })
        }
        asked => asked,
    }
}

/// Returns whether a file was refused because it is in none of the manager's folders.
fn is_elsewhere(error: &ClientError) -> bool {
    matches!(error, ClientError::Failed { reason, .. } if reason.contains(SCENE_FOLDERS))
}

pub(super) fn open(arguments: &OpenArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let progress = ProgressReport::start();
    let scene = here_or_there(&arguments.file, |path| {
        open_scene(&client, (path, arguments.scene.as_deref()), &progress)
    })?;
    if !arguments.keep_camera
        && let Some(bounds) = &scene.bounds
    {
        let camera = fit_bounds(&client.wall()?, bounds, arguments.heading.to_radians());
        client.set_camera(camera)?;
    }
    if let Some(exposure) = arguments.exposure {
        client.set_exposure(exposure)?;
    }
    await_displays(&client, arguments.wait, &progress)?;
    drop(progress);
    let seen = Seen::of(&client, &client.render_frame()?)?;
    let (name, revision) = (printable(&scene.name), scene.revision);
    let triangles = counted(scene.triangles, "triangle");
    say(format_args!("{name}: {triangles}, revision {revision}, {}", seen.in_words()))?;
    say_notes(&scene.notes)?;
    Ok(seen.conclude())
}

/// Opens a file, or the scene of it that is named, and says how far it has come.
pub(super) fn open_scene(
    client: &Client,
    (path, scene): (&str, Option<&str>),
    progress: &ProgressReport,
) -> Result<SceneSummary, ClientError> {
    let stem = Path::new(path).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let stem = stem.unwrap_or_default();
    let name = printable(&stem);
    progress.say(&format!("opening {name}"), None);
    let mut file = SceneFile::from(path);
    if let Some(scene) = scene {
        file = file.scene(scene);
    }
    client.open_scene_with(file, |come| {
        progress.say(&format!("opening {name}: {come}"), Some(come.percent));
    })
}

/// Says what of a scene is not drawn as its file has it.
pub(super) fn say_notes(notes: &[String]) -> anyhow::Result<()> {
    notes.iter().try_for_each(|note| say(format_args!("note: {}", printable(note))))
}

#[derive(Debug, clap::Args)]
pub(super) struct ShotArguments {
    /// The .png file to write
    file: PathBuf,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn capture(arguments: &ShotArguments) -> anyhow::Result<ExitCode> {
    let is_png = arguments.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    if !is_png {
        bail!("{}: pictures are PNG; write a name that ends in .png", arguments.file.display());
    }
    outputs::check(&arguments.file)?;
    let client = arguments.manager.connect()?;
    let capture = client.capture()?;
    let picture = image_files::side_by_side(&capture.screens)?;
    image_files::save_png(&arguments.file, &picture)?;
    say(format_args!(
        "{}: frame {}, {} × {} pixels",
        arguments.file.display(),
        capture.frame,
        picture.width(),
        picture.height()
    ))?;
    Ok(Seen::in_pictures(&capture).conclude())
}

pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parsed: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let is_finite = |list: &Vec<f64>| list.iter().all(|number| number.is_finite());
    let Some(parsed) = parsed.ok().filter(is_finite) else {
        return Err(format!("{text:?}: write {N} finite numbers, with commas between"));
    };
    parsed.try_into().map_err(|list: Vec<f64>| {
        format!("{text:?} has {} numbers, where {N} are needed, with commas between", list.len())
    })
}

/// A number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let [number] = numbers::<1>(text)?;
    if number > 0.0 { Ok(number) } else { Err(format!("{text:?}: write a number above 0")) }
}

/// The angle of a picture, in degrees.
pub(super) fn field_of_view(text: &str) -> Result<f64, String> {
    let [degrees] = numbers::<1>(text)?;
    if degrees > 0.0 && degrees < 180.0 {
        return Ok(degrees);
    }
    Err(format!("{text:?}: write an angle between 0 and 180 degrees"))
}

pub(super) fn point(text: &str) -> Result<DVec3, String> {
    numbers::<3>(text).map(DVec3::from_array)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_in_no_folder_is_asked_for_again() {
        let elsewhere = format!("x: not found in {SCENE_FOLDERS} (none)");
        let cases: [(&[&str], &str, usize); 3] = [
            (&["another scene was opened before this one was ready"], "another scene", 1),
            (&[&elsewhere, "it is no glTF"], "it is no glTF", 2),
            (&[&elsewhere, &elsewhere], "not found", 2),
        ];
        for (reasons, said, count) in cases {
            let mut asked = Vec::new();
            // A file that is here.
            let ended = here_or_there("Cargo.toml", |path| {
                let reason = reasons[asked.len()].to_owned();
                asked.push(path.to_owned());
                Err::<(), _>(ClientError::Failed { request: "open the scene", reason })
            });
            assert!(ended.expect_err("refused").to_string().contains(said), "{said}");
            assert_eq!(asked.len(), count, "{asked:?}");
            assert!(asked[0].ends_with("/Cargo.toml"), "{asked:?}");
            assert!(count == 1 || asked[1] == "Cargo.toml", "{asked:?}");
        }
    }
}
