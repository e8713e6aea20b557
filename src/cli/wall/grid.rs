//! `polyptych wall grid`: displays in columns and rows on one plane, or projectors that light it.

use std::fmt::Write;

use anyhow::bail;
use glam::{DVec2, DVec3};
use polyptych_wall::limits::CHANNELS_MAX;
use polyptych_wall::surface::{Plane, Surface};

use super::pose::{Pose, Room, Stand, Target, Trouble, solve};
use super::projectors::{self, OVERLAP_DEFAULT, SURFACE_COMMENT, THROW_DEFAULT, overlaps};
use super::{Common, drawing, gaps, head, metres, pixels, round};

/// By how much a projector's part is exceeded, as a share of it.
const MARGIN: f64 = 0.004;

/// How much higher projectors of a row hang than those of the row above, in metres: they look
/// past each other.
const ROW_STEP_M: f64 = 0.45;

/// Times the screen's longer side that its room is deep.
const ROOM_SIDES: f64 = 6.0;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many side by side
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    columns: u32,
    /// How many above each other
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    rows: u32,
    /// Pixels of each
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
    /// How wide each is, in metres; pixels are square
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "1.2")]
    width: f64,
    /// From the eye to the plane, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "2.5")]
    distance: f64,
    /// Gaps between displays in metres, behind which the picture goes on
    #[arg(long, value_name = "AxD", value_parser = gaps, conflicts_with = "overlap")]
    bezel: Option<[f64; 2]>,
    /// Pixels that neighbours share [default: none]; with --projectors percent of a picture's
    /// sides [default: 15x15]
    #[arg(long, value_name = "AxD", value_parser = overlaps)]
    overlap: Option<[u32; 2]>,
    /// Light the screen by projectors that hang in the room, and write their poses
    #[arg(long, conflicts_with = "bezel")]
    projectors: bool,
    #[command(flatten)]
    lenses: projectors::Options,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        // Before poses are looked for: so many would take hours, and no wall has them.
        let count = u64::from(self.columns) * u64::from(self.rows);
        if count > CHANNELS_MAX as u64 {
            bail!(
                "{} columns of {} are {count} channels; a wall has {CHANNELS_MAX} at most",
                self.columns,
                self.rows
            );
        }
        if self.projectors {
            return self.projected();
        }
        self.lenses.refuse()?;
        let Self { columns, rows, pixels, .. } = *self;
        let pitch = self.width / f64::from(pixels[0].max(1));
        let counts = [columns, rows].map(f64::from);
        let [bezel, overlap] =
            [self.bezel.unwrap_or_default(), self.overlap.unwrap_or_default().map(f64::from)];
        let side = |axis: usize| {
            let between = counts[axis] - 1.0;
            let lit = counts[axis] * f64::from(pixels[axis]) - between * overlap[axis];
            round(lit * pitch + between * bezel[axis])
        };
        let mut comments = vec![format!(
            "{columns} x {rows} displays of {} x {} pixels and {:.3} m width on one plane.",
            pixels[0], pixels[1], self.width
        )];
        comments.extend(SURFACE_COMMENT.map(str::to_owned));
        comments.push(String::new());
        comments.extend(drawing(columns, rows));
        let mut text = head(&self.common, "grid", &comments, [0.0, self.common.eye_height, 0.0]);
        write!(
            text,
            "[[screen]]\nname = \"front\"\nsize = [{:?}, {:?}]   # metres\n\
             center = [0.0, {:?}, {:?}]\n\n[screen.tiles]\ncolumns = {columns}\nrows = {rows}\n\
             pixels = [{}, {}]\n",
            side(0),
            side(1),
            round(self.common.eye_height),
            round(-self.distance),
            pixels[0],
            pixels[1]
        )?;
        if let Some([across, down]) = self.bezel {
            writeln!(text, "bezel = [{across:?}, {down:?}]   # metres")?;
        }
        if let Some([across, down]) = self.overlap {
            writeln!(text, "overlap = [{across}, {down}]   # pixels")?;
        }
        Ok(text)
    }

    /// The wall file of a screen that projectors light.
    fn projected(&self) -> anyhow::Result<String> {
        let Self { columns, rows, pixels: [width_px, height_px], .. } = *self;
        let overlap = self.overlap.unwrap_or([OVERLAP_DEFAULT; 2]);
        let shares = DVec2::new(projectors::share(overlap[0])?, projectors::share(overlap[1])?);
        let eye_m = self.common.eye_height;
        let size = self.lit_size(columns, shares);
        let mount_m = self.lenses.height_m(eye_m + size.y / 2.0, eye_m)?;
        let distance_m = self.lenses.distance_m(size.max_element() * ROOM_SIDES)?;
        let attempt =
            |throw: f64, columns: u32| self.poses((throw, columns), shares, mount_m, distance_m);
        let throw = self.lenses.throw.unwrap_or(THROW_DEFAULT);
        let poses = projectors::poses((throw, columns), Some("--columns"), attempt)?;
        let mut comments = vec![format!(
            "{columns} x {rows} projectors of {width_px} x {height_px} pixels on one plane of \
             {:.3} x {:.3} m.",
            size.x, size.y
        )];
        comments.extend(projectors::comment(overlap[0].min(overlap[1])));
        comments.push(String::new());
        comments.extend(drawing(columns, rows));
        let mut text = head(&self.common, "grid", &comments, [0.0, eye_m, 0.0]);
        let canvas = (size / self.width * f64::from(width_px)).round().max(DVec2::ONE);
        write!(
            text,
            "[blend]\nleak = 0.002   # of a projector's white, in its black\n\n\
             [[screen]]\nname = \"front\"\nsize = [{:?}, {:?}]   # metres\n\
             center = [0.0, {:?}, {:?}]\npixels = [{:.0}, {:.0}]\n",
            round(size.x),
            round(size.y),
            round(eye_m),
            round(-self.distance),
            canvas.x,
            canvas.y
        )?;
        projectors::write_channels(&mut text, &poses, self.pixels);
        let pixels = f64::from(width_px) * f64::from(height_px);
        projectors::verify(&text, &beside(&poses, columns as usize, shares * pixels))?;
        Ok(text)
    }

    /// Width and height of one picture on the screen, in metres.
    fn picture(&self) -> DVec2 {
        let [width, height] = self.pixels.map(|side| f64::from(side.max(1)));
        DVec2::new(1.0, height / width) * self.width
    }

    /// Width and height of the screen that so many columns of pictures light.
    fn lit_size(&self, columns: u32, shares: DVec2) -> DVec2 {
        let more = DVec2::new(columns.into(), self.rows.into()) - 1.0;
        self.picture() * (1.0 + more * (1.0 - shares))
    }

    fn poses(
        &self,
        (throw, columns): (f64, u32),
        shares: DVec2,
        mount_m: f64,
        distance_m: [f64; 2],
    ) -> Result<Vec<Pose>, Trouble> {
        let (eye_m, picture) = (self.common.eye_height, self.picture());
        let size = self.lit_size(columns, shares);
        let plane = Plane::upright(DVec3::new(0.0, eye_m, -self.distance), size);
        let room = Room {
            eye: DVec3::new(0.0, eye_m, 0.0),
            surfaces: vec![Surface::Plane(plane)],
            distance_m,
            may_raise: self.lenses.may_raise(),
        };
        let target = |index: u32| {
            let (column, row) = (index % columns, index / columns);
            let at = DVec2::new(column.into(), row.into());
            let from = at * picture * (1.0 - shares) - size / 2.0;
            let point = |x: f64, y: f64| {
                let place = from + picture * (0.5 + DVec2::new(x, y) * (1.0 + MARGIN));
                DVec3::new(place.x, eye_m - place.y, -self.distance)
            };
            let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
            Target {
                name: format!("front-{}-{}", column + 1, row + 1),
                points: corners.map(|(x, y)| point(x, y)).to_vec(),
                stand: Stand::Before {
                    point: point(0.0, 0.0),
                    inward: DVec3::Z,
                    height_m: mount_m + f64::from(row) * ROW_STEP_M,
                },
            }
        };
        let targets: Vec<Target> = (0..columns * self.rows).map(target).collect();
        solve(self.lenses.lens(throw, self.pixels), &targets, &room)
    }
}

/// Pairs of neighbours across and down, with the pixels that they share.
fn beside(poses: &[Pose], columns: usize, pixels: DVec2) -> Vec<([String; 2], f64)> {
    let name = |index: usize| poses[index].name.clone();
    let pairs = (0..poses.len()).flat_map(|index| {
        let right = (index + 1) % columns != 0;
        let right = right.then(|| ([name(index), name(index + 1)], pixels.x));
        let below = index + columns < poses.len();
        [right, below.then(|| ([name(index), name(index + columns)], pixels.y))]
    });
    pairs.flatten().filter(|(_, shared)| *shared > 0.0).collect()
}
