//! Proves a wall in numbers: real servers draw it, and every measure has a target.

mod geometry;
mod light;
mod marker;
mod oracle;
mod table;

use std::path::{Path, PathBuf};

use anyhow::bail;
use polyptych_client::{Bounds, Capture, orbit};
use polyptych_manager::import::{Baker, read_wall_files};
use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::wall::Wall;
use polyptych_protocol::wall::shapes::{Shaped, Shapes};

use crate::faults::Needs;
use crate::local_wall::{LocalWall, LocalWallOptions};
use crate::progress::Steps;
use crate::{outputs, pictures};
use polyptych_protocol::words::counted;
use table::Table;

/// Where the camera looks from when pictures are compared, in radians around the vertical.
const HEADING_RAD: f64 = 0.52;

/// Draws the wall on this machine, measures, and writes the pictures that it measured.
///
/// # Errors
/// A wall or scene that cannot be drawn, or a folder that cannot be written. A target that is
/// missed is no error: the table says so.
pub(crate) fn prove(wall: &Wall, shown: Shown, baker: Baker, out: &Path) -> anyhow::Result<Table> {
    outputs::make_folder(out)?;
    let report = out.join("prove.json");
    outputs::check(&report)?;
    let mut table = Table::default();
    let files = read_wall_files(wall, &BlobFolder::new(baker.store.join("blobs")));
    let files = files.map_err(anyhow::Error::msg)?;
    let shapes = Shapes::new(wall, &files);
    let shaped = Shaped { wall, shapes: &shapes };
    let judged: Vec<u16> =
        (0..wall.screens.len() as u16).filter(|&index| oracle::can_judge(wall, index)).collect();
    let mut steps = Steps::new((3 + geometry::SCENES + judged.len()) as u64);
    steps.begin("computing blends and sampling of all channels");
    light::prove(shaped, &mut table)?;
    let maps = light::maps(shaped, &files);
    let folder = tempfile::Builder::new().prefix("polyptych-prove-").tempdir()?;
    let prover = Prover { shown, folder: folder.path().canonicalize()?, baker, out };
    let capture = {
        steps.begin(format_args!("starting {}", counted(wall.channels.len(), "channel")));
        let local = prover.start(wall)?;
        let keep = |capture: &Capture| prover.save_all("markers", capture);
        let places = (prover.folder.as_path(), &mut steps);
        geometry::prove(&local.client, (shaped, &maps), places, &mut table, keep)?;
        steps.begin("drawing the scene on the wall");
        prover.show(&local, wall)?
    };
    prover.save_all("wall", &capture)?;
    for index in judged {
        let name = &wall.screens[usize::from(index)].name;
        steps.begin(format_args!("drawing screen {name} by one channel, to compare with"));
        prover.compare(wall, index, &capture, &mut table)?;
    }
    let json = serde_json::to_vec_pretty(&table)?;
    outputs::write(&report, &json)?;
    Ok(table)
}

/// The scene whose pictures are compared.
#[derive(Debug)]
pub(crate) struct Shown {
    /// An absolute path.
    pub file: PathBuf,
    /// What to look at, where it is not the whole scene.
    pub focus: Option<Bounds>,
}

/// What all parts of a proof are made with.
struct Prover<'a> {
    shown: Shown,
    /// For scenes that it makes itself.
    folder: PathBuf,
    baker: Baker,
    out: &'a Path,
}

impl Prover<'_> {
    fn start(&self, wall: &Wall) -> anyhow::Result<LocalWall> {
        let root = self.shown.file.parent().unwrap_or(Path::new("/")).to_owned();
        LocalWall::start(LocalWallOptions {
            wall: wall.clone(),
            scene_roots: vec![root, self.folder.clone()],
            baker: self.baker.clone(),
            windows: false,
            recorder: None,
            needs: Needs::default(),
        })
    }

    /// The scene as a wall shows it.
    fn show(&self, local: &LocalWall, wall: &Wall) -> anyhow::Result<Capture> {
        let summary = local.client.open_scene(self.shown.file.display().to_string())?;
        if let Some(focus) = self.shown.focus.or(summary.bounds) {
            local.client.set_camera(orbit(wall, &focus, HEADING_RAD))?;
        }
        local.client.render_frame_at(None, Some(0.0))?;
        let capture = local.client.capture()?;
        if let Some((channel, why)) = capture.missing.first() {
            bail!("channel {channel} has no picture: {why}");
        }
        Ok(capture)
    }

    /// One channel shows the whole of a screen, seen from where the wall's camera stands.
    fn compare(
        &self,
        wall: &Wall,
        index: u16,
        capture: &Capture,
        table: &mut Table,
    ) -> anyhow::Result<()> {
        let single = oracle::single(wall, index);
        let local = self.start(&single)?;
        let summary = local.client.open_scene(self.shown.file.display().to_string())?;
        if let Some(focus) = self.shown.focus.or(summary.bounds) {
            // The camera of the whole wall, which the other screens have their part in.
            local.client.set_camera(orbit(wall, &focus, HEADING_RAD))?;
        }
        local.client.render_frame_at(None, Some(0.0))?;
        let name = &wall.screens[usize::from(index)].name;
        let expected = oracle::screen_of(&local.client.capture()?, name)?;
        let stitched = oracle::screen_of(capture, name)?;
        let difference = oracle::compare(wall, index, &stitched, &expected, table)?;
        self.save(&format!("single-{name}.png"), &expected)?;
        self.save(&format!("difference-{name}.png"), &difference)
    }

    fn save_all(&self, what: &str, capture: &Capture) -> anyhow::Result<()> {
        for picture in &capture.channels {
            let image = pictures::to_image(picture)?;
            self.save(&format!("{what}-channel-{}.png", picture.name), &image)?;
        }
        self.save(&format!("{what}.png"), &pictures::side_by_side(&capture.screens)?)
    }

    fn save(&self, name: &str, image: &image::RgbaImage) -> anyhow::Result<()> {
        pictures::save_png(&self.out.join(name), image)
    }
}
