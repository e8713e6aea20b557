//! Proves a wall in numbers: real servers draw it, and every measure has a target.

mod fields;
mod geometry;
mod light;
mod marker;
mod oracle;
mod proof_page;
mod verification_report;
mod views;

use std::path::{Path, PathBuf};

use anyhow::bail;
use polyptych_client::{Bounds, Capture, orbit};
use polyptych_files::blob::BlobStore;
use polyptych_manager::import::{Baker, read_wall_files};
use polyptych_text::counted;
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};
use polyptych_wall::{Channel, MemoryBudget, Wall};
use proof_page::ProofPictures;
use verification_report::VerificationReport;

use crate::progress::Steps;
use crate::simulator::faults::FaultHooks;
use crate::simulator::local_wall::{LocalWall, LocalWallOptions};
use crate::simulator::look::Look;
use crate::simulator::orbit::HEADING_RAD;
use crate::{image_files, outputs};

pub(crate) use proof_page::ProofPage;

/// The results of a proof.
pub(crate) struct Proof {
    pub table: VerificationReport,
    pub pictures: ProofPictures,
}

/// A wall to prove.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Walls<'a> {
    /// The wall that servers draw.
    pub drawn: &'a Wall,
    /// The wall that stands, of the same channels, where somebody has measured it.
    pub built: Option<&'a Wall>,
}

/// Draws the wall on this machine, measures, and writes the pictures that it measured.
///
/// # Errors
/// A wall or scene that cannot be drawn, a wall as built that has other channels, or a folder that
/// cannot be written. A target that is missed is no error: the table says so.
pub(crate) fn verify(
    walls: Walls<'_>,
    (shown, look): (ReferenceScene, Look),
    baker: &Baker,
    out: &Path,
) -> anyhow::Result<Proof> {
    outputs::make_folder(out)?;
    let report = out.join("prove.json");
    outputs::check(&report)?;
    let wall = walls.drawn;
    walls.check()?;
    let mut table = VerificationReport::default();
    let read = |wall: &Wall| {
        let files = read_wall_files(wall, &BlobStore::new(baker.store.join("blobs")));
        files.map_err(anyhow::Error::msg)
    };
    let files = read(wall)?;
    let shapes = WallGeometry::new(wall, &files);
    let built = walls.built.unwrap_or(wall);
    let built_files = read(built)?;
    let built_shapes = WallGeometry::new(built, &built_files);
    let shaped = ResolvedWall { wall, shapes: &shapes };
    let built = ResolvedWall { wall: built, shapes: &built_shapes };
    let judged: Vec<u16> =
        (0..wall.screens.len() as u16).filter(|&index| oracle::can_judge(wall, index)).collect();
    let mut steps = Steps::new((5 + geometry::SCENES + judged.len()) as u64);
    steps.begin("computing blends and sampling of all channels");
    light::prove_sampling(shaped, &mut table)?;
    let corrections = light::corrections(shaped, &files);
    let folder = tempfile::Builder::new().prefix("polyptych-prove-").tempdir()?;
    let prover =
        Verifier { shown, look, folder: folder.path().canonicalize()?, baker: baker.clone(), out };
    let capture = {
        steps.begin(format_args!("starting {}", counted(wall.channels.len(), "channel")));
        let local = prover.start(wall)?;
        steps.begin("drawing flat fields on all channels");
        let fields = fields::Fields::draw(&local.client, wall, &prover.folder.join("fields"))?;
        light::weight_checker::verify(
            built,
            &built_files,
            &fields,
            walls.built.is_some(),
            &mut table,
        )?;
        let keep = |capture: &Capture| prover.save_all("markers", capture);
        let places = (prover.folder.as_path(), &mut steps);
        let drawn = light::Drawn { wall, corrections: &corrections };
        geometry::verify(&local.client, (built, drawn), places, &mut table, keep)?;
        steps.begin("looking for markers in views of their own");
        let keep = |capture: &Capture| prover.save_all("views", capture);
        views::prove(&local.client, (built, drawn), &prover.folder, &mut table, keep)?;
        steps.begin("drawing the scene on the wall");
        prover.show(&local, wall)?
    };
    if walls.built.is_none() {
        let why = "not known: only --as-built FILE, a wall file of what stands, can tell";
        table.add_unmeasured("displays that hang or shine otherwise", None, why);
    }
    prover.save_all("wall", &capture)?;
    let mut pictures = ProofPictures::new(wall, &capture)?;
    for index in judged {
        let name = &wall.screens[usize::from(index)].name;
        steps.begin(format_args!("drawing screen {name} by one channel, to compare with"));
        if let Some(difference) = prover.compare(wall, index, &capture, &mut table)? {
            pictures.add_difference(name, &difference)?;
        }
    }
    let json = serde_json::to_vec_pretty(&table)?;
    outputs::write(&report, &json)?;
    Ok(Proof { table, pictures })
}

impl Walls<'_> {
    /// Checks that both walls have the same channels.
    fn check(&self) -> anyhow::Result<()> {
        let Some(built) = self.built else { return Ok(()) };
        let (drawn, built) = (&self.drawn.channels, &built.channels);
        if drawn.len() != built.len() {
            let counts = [drawn, built].map(|list| counted(list.len(), "channel"));
            bail!("the wall has {}, and as built {}; give both the same", counts[0], counts[1]);
        }
        for (a, b) in drawn.iter().zip(built) {
            let shape = |of: &Channel| (of.name.clone(), of.size, of.display_size());
            if shape(a) != shape(b) {
                let text = |channel: &Channel| {
                    let (name, turn) = (&channel.name, channel.adjustment.turn);
                    format!("{name} of {} pixels, turned {turn:?}", channel.size)
                };
                let (a, b) = (text(a), text(b));
                bail!("channel {a} is {b} as built; give both files the same channels, in order");
            }
        }
        Ok(())
    }
}

/// The scene whose pictures are compared.
#[derive(Clone, Debug)]
pub(crate) struct ReferenceScene {
    /// An absolute path.
    pub file: PathBuf,
    /// The part to look at, if not the whole scene.
    pub focus: Option<Bounds>,
}

/// The context that all parts of a verification share.
struct Verifier<'a> {
    shown: ReferenceScene,
    look: Look,
    /// For scenes that it makes itself.
    folder: PathBuf,
    baker: Baker,
    out: &'a Path,
}

impl Verifier<'_> {
    fn start(&self, wall: &Wall) -> anyhow::Result<LocalWall> {
        let root = self.shown.file.parent().unwrap_or(Path::new("/")).to_owned();
        LocalWall::start(LocalWallOptions {
            // A budget leaves out detail, more of it on the wall than on one channel.
            wall: Wall { budget: MemoryBudget::default(), ..wall.clone() },
            scene_roots: [root, self.folder.clone()]
                .into_iter()
                .chain(self.look.folder())
                .collect(),
            baker: self.baker.clone(),
            windows: false,
            http: None,
            recorder: None,
            culls_occluded: true,
            needs: FaultHooks::default(),
        })
    }

    /// The scene as a wall shows it.
    fn show(&self, local: &LocalWall, wall: &Wall) -> anyhow::Result<Capture> {
        let summary = local.client.open_scene(self.shown.file.display().to_string())?;
        self.look.apply(&local.client)?;
        // Who was late for a frame is not waited for when something changes.
        local.await_channels()?;
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

    /// One channel shows the whole of a screen, seen from where the wall's camera stands. Returns
    /// the picture of what differs; `None` if that channel has no picture, as the table tells.
    fn compare(
        &self,
        wall: &Wall,
        index: u16,
        capture: &Capture,
        table: &mut VerificationReport,
    ) -> anyhow::Result<Option<image::RgbaImage>> {
        let single = oracle::single(wall, index);
        let local = self.start(&single)?;
        let summary = local.client.open_scene(self.shown.file.display().to_string())?;
        self.look.apply(&local.client)?;
        // Who was late for a frame is not waited for when something changes.
        local.await_channels()?;
        if let Some(focus) = self.shown.focus.or(summary.bounds) {
            // The camera of the whole wall, which the other screens have their part in.
            local.client.set_camera(orbit(wall, &focus, HEADING_RAD))?;
        }
        local.client.render_frame_at(None, Some(0.0))?;
        let name = &wall.screens[usize::from(index)].name;
        let drawn = local.client.capture()?;
        let Some(expected) = oracle::single_screen(&drawn, name, table)? else { return Ok(None) };
        let stitched = oracle::screen_of(capture, name)?;
        let difference = oracle::compare(wall, index, &stitched, &expected, table)?;
        self.save(&format!("single-{name}.png"), &expected)?;
        self.save(&format!("difference-{name}.png"), &difference)?;
        Ok(Some(difference))
    }

    fn save_all(&self, what: &str, capture: &Capture) -> anyhow::Result<()> {
        for picture in &capture.channels {
            let image = image_files::to_image(picture)?;
            self.save(&format!("{what}-channel-{}.png", picture.name), &image)?;
        }
        self.save(&format!("{what}.png"), &image_files::side_by_side(&capture.screens)?)
    }

    fn save(&self, name: &str, image: &image::RgbaImage) -> anyhow::Result<()> {
        image_files::save_png(&self.out.join(name), image)
    }
}
