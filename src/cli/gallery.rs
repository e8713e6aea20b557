//! `polyptych gallery`: one sheet with the pictures of many models.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use polyptych_text::{counted, printable};

use super::bake_arguments::BakeArguments;
use super::progress::ProgressReport;
use super::say;
use super::simulate::scene_time;
use crate::simulator::ending::Ending;
use crate::simulator::gallery::{Gallery, ModelReport, Sheet, find_models};
use crate::simulator::local_wall::INTERRUPTED;
use crate::{image_files, logging, outputs};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The .gltf or .glb files, or folders in and below which they lie
    #[arg(value_name = "DIR", required = true)]
    models: Vec<PathBuf>,
    /// The .png file to write
    #[arg(short, long, value_name = "FILE", default_value = "sheet.png")]
    output: PathBuf,
    /// Pixels of each picture
    #[arg(long, value_name = "WxH", value_parser = super::wall::pixels)]
    #[arg(default_value = "320x180")]
    size: [u32; 2],
    /// Pictures beside each other [default: as many as make the sheet as wide as high]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    columns: Option<u32>,
    /// Scene time of the pictures, in seconds: animations are at that time
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = scene_time)]
    time: f64,
    /// Print JSON: for each model what it needs, what of it is not drawn, and its times
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    bake: BakeArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let is_png = arguments.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    if !is_png {
        let file = arguments.output.display();
        bail!("{file}: pictures are PNG; write a name that ends in .png");
    }
    outputs::check(&arguments.output)?;
    let files = find_models(&arguments.models)?;
    let mut sheet = Sheet::new(files.len(), arguments.size, arguments.columns)?;
    let baker = arguments.bake.baker()?;
    let mut gallery = Gallery::new(roots(&files), arguments.size, arguments.time, baker)?;
    let mut models: Vec<ModelReport> = Vec::new();
    let mut ended = None;
    let progress = ProgressReport::start();
    for (index, file) in files.iter().enumerate() {
        let percent = u8::try_from(index * 100 / files.len()).ok();
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = printable(&name);
        let place = format!("model {} of {}: {name}", index + 1, files.len());
        progress.say(&place, percent);
        match gallery.show(file) {
            Ok(mut model) => {
                let picture = model.picture.take();
                let reason = model.error.as_deref().unwrap_or_default();
                sheet.place(index, &name, picture.as_ref().ok_or(reason));
                models.push(model);
            }
            Err(error) => match Ending::of(&error) {
                Some(ending) => {
                    ended = Some(ending);
                    break;
                }
                None => return Err(error.context(place)),
            },
        }
    }
    drop((progress, gallery));
    conclude(&models, files.len(), sheet, ended, arguments)
}

/// Writes the sheet, says what was found, and returns the exit code.
fn conclude(
    models: &[ModelReport],
    all: usize,
    sheet: Sheet,
    ended: Option<Ending>,
    arguments: &Arguments,
) -> anyhow::Result<ExitCode> {
    if let Some(ending) = ended {
        let shown = models.len();
        logging::say_failure("gallery", &format!("{ending}; {shown} of {all} models were shown"));
    }
    if !models.is_empty() {
        image_files::save_png(&arguments.output, &sheet.into_image())?;
    }
    if arguments.json {
        say(serde_json::to_string_pretty(models)?)?;
    } else {
        models.iter().try_for_each(say_model)?;
    }
    if ended == Some(Ending::Interrupted) {
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let refused: Vec<&ModelReport> = models.iter().filter(|model| model.error.is_some()).collect();
    let output = arguments.output.display();
    if let [first, ..] = refused[..] {
        let (count, all) = (refused.len(), counted(all, "model"));
        let reason = first.error.as_deref().unwrap_or_default();
        bail!(
            "{count} of {all} could not be shown, the first for this reason: {}; the others are \
             in {output}",
            printable(reason)
        );
    }
    if !arguments.json {
        say(format_args!("{output}: {}", counted(models.len(), "model")))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn say_model(model: &ModelReport) -> anyhow::Result<()> {
    let file = printable(&model.file);
    if let Some(error) = &model.error {
        return say(format_args!("{file}: not shown: {}", printable(error)));
    }
    let ms = |time: Option<f64>| time.map_or_else(String::new, |ms| format!("{ms:.1} ms"));
    let (open, frame) = (ms(model.open_ms), ms(model.frame_ms));
    let triangles = counted(model.triangles, "triangle");
    say(format_args!("{file}: {triangles}, opened in {open}, a frame takes {frame}"))?;
    model.notes.iter().try_for_each(|note| say(format_args!("  note: {}", printable(note))))
}

/// The folders of these files, each once.
fn roots(files: &[PathBuf]) -> Vec<PathBuf> {
    let folder = |file: &PathBuf| {
        let file = file.canonicalize().unwrap_or_else(|_| file.clone());
        file.parent().unwrap_or(Path::new("/")).to_owned()
    };
    let mut roots: Vec<PathBuf> = files.iter().map(folder).collect();
    roots.sort();
    roots.dedup();
    roots
}
