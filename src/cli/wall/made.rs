//! A wall of few kinds of screens, each with one channel, and the files that it goes into: what
//! importers and warp makers have in common.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use glam::{DVec3, Vec3};
use image::{ImageFormat, Luma};
use polyptych_text::counted;
use polyptych_wall::warp::WARP_REACH_M_MAX;

use super::super::say;
use super::round;
use crate::outputs;

/// A wall that is written as `wall.toml` with its maps beside it.
#[derive(Debug, Default)]
pub(super) struct Made {
    pub name: String,
    /// In metres.
    pub eye: DVec3,
    /// In metres; the wall file's default where it is not known.
    pub eye_separation: Option<f64>,
    /// Several samples per pixel.
    pub is_smooth: bool,
    /// Files that it was made of, which it never replaces.
    pub inputs: Vec<PathBuf>,
    /// Lines for people at the head of the file.
    pub comments: Vec<String>,
    pub screens: Vec<MadeScreen>,
    /// More screens as text, and how many channels they have.
    pub raw: String,
    pub raw_channels: usize,
    /// Tables of channels of those screens.
    pub tail: String,
}

/// A screen with one channel of the same name.
#[derive(Debug)]
pub(super) struct MadeScreen {
    pub name: String,
    pub shape: Shape,
    /// Pixels of the channel.
    pub size: [u32; 2],
    /// The server that drives it, where it is not the channel's own name.
    pub server: Option<String>,
    /// A point of the room in metres for each pixel, row by row from the upper left.
    pub warp: Option<Vec<Option<DVec3>>>,
    /// Factors of its codes, row by row from the upper left.
    pub alpha: Option<Vec<f64>>,
    /// Codes that it shows of black, row by row from the upper left.
    pub beta: Option<Vec<f64>>,
    /// More lines of `[channel.NAME]`.
    pub adjust: Vec<String>,
    /// For one eye alone; a screen needs channels for both.
    pub eye: Option<OneEye>,
}

/// Whose eye a channel is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum OneEye {
    Left,
    Right,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// Lower left, lower right and upper left corner.
    Plane([DVec3; 3]),
    /// Upright; degrees from −z to +x, heights in metres from the center.
    Cylinder { center: DVec3, radius: f64, degrees: [f64; 2], height: [f64; 2] },
    /// Degrees of azimuth and elevation; by the tilt its upper pole goes forward.
    Sphere { center: DVec3, radius: f64, azimuth: [f64; 2], elevation: [f64; 2], tilt: f64 },
}

impl Shape {
    /// The whole sphere around a point.
    pub fn all_around(center: DVec3, radius: f64) -> Self {
        Self::cap(center, radius, 360.0, 0.0)
    }

    /// So many degrees of a sphere, from rim to rim over its upper pole, which is tilted forward.
    pub fn cap(center: DVec3, radius: f64, degrees: f64, tilt: f64) -> Self {
        let elevation = [90.0 - degrees / 2.0, 90.0];
        Self::Sphere { center, radius, azimuth: [-180.0, 180.0], elevation, tilt }
    }
}

impl MadeScreen {
    /// A screen whose channel has nothing special.
    pub fn new(name: impl Into<String>, shape: Shape, size: [u32; 2]) -> Self {
        let name = name.into();
        Self {
            name,
            shape,
            size,
            server: None,
            warp: None,
            alpha: None,
            beta: None,
            adjust: Vec::new(),
            eye: None,
        }
    }
}

impl Made {
    /// Writes the wall file and its maps into a folder, after the wall's own check. Nothing is
    /// written if one of them may not be.
    pub fn write(&self, folder: &Path, force: bool) -> anyhow::Result<()> {
        self.screens.iter().try_for_each(MadeScreen::check_reach)?;
        let wall_file = folder.join("wall.toml");
        outputs::make_folder(folder)?;
        outputs::check_made(&wall_file, force, &self.inputs)?;
        let text = self.text();
        check_text(&text, &wall_file)?;
        for screen in &self.screens {
            for key in screen.maps() {
                let file = folder.join(format!("{}{}", screen.name, ending(key)));
                outputs::check_made(&file, force, &self.inputs)?;
            }
        }
        for screen in &self.screens {
            for (ending, bytes) in screen.files()? {
                outputs::write(&folder.join(format!("{}{ending}", screen.name)), &bytes)?;
            }
        }
        outputs::write(&wall_file, text.as_bytes())?;
        let channels = counted(self.screens.len() + self.raw_channels, "channel");
        say(format_args!("{}: {channels}", wall_file.display()))
    }

    /// The channel for the other eye on the same screen: the first left one belongs to the first
    /// right one, and so on.
    fn partner(&self, at: usize) -> Option<usize> {
        let one = &self.screens[at];
        let is_same = |other: &MadeScreen, eye: Option<OneEye>| {
            other.shape == one.shape && other.size == one.size && other.eye == eye
        };
        let nth = self.screens[..at].iter().filter(|other| is_same(other, one.eye)).count();
        let other = match one.eye? {
            OneEye::Left => OneEye::Right,
            OneEye::Right => OneEye::Left,
        };
        let others = (0..self.screens.len()).filter(|at| is_same(&self.screens[*at], Some(other)));
        others.into_iter().nth(nth)
    }

    /// Shows both eyes' middle where there is no channel for the other eye; returns the names of
    /// those channels.
    pub fn pair_eyes(&mut self) -> Vec<String> {
        let count = self.screens.len();
        let is_alone = |at: &usize| self.screens[*at].eye.is_some() && self.partner(*at).is_none();
        let alone: Vec<usize> = (0..count).filter(is_alone).collect();
        for at in &alone {
            self.screens[*at].eye = None;
        }
        alone.into_iter().map(|at| self.screens[at].name.clone()).collect()
    }

    /// The wall file.
    pub fn text(&self) -> String {
        let mut text = String::from("#:schema ./wall.schema.json\n#\n");
        for line in &self.comments {
            let plain: String = line.chars().filter(|c| !c.is_control()).collect();
            let _ = writeln!(text, "{}", format!("# {plain}").trim_end());
        }
        let eye = list(self.eye.to_array());
        let _ = write!(text, "\n[wall]\nname = {:?}\neye = {eye}   # metres\n", self.name);
        if let Some(metres) = self.eye_separation {
            let _ = writeln!(text, "eye_separation = {:?}", round(metres));
        }
        if self.is_smooth {
            text.push_str("samples = 4\n");
        }
        for (at, screen) in self.screens.iter().enumerate() {
            match screen.eye {
                None => screen.put(&mut text, None),
                // The right eye's channel stands on the left eye's screen.
                Some(OneEye::Left) => {
                    let right = self.partner(at).map(|right| &self.screens[right]);
                    screen.put(&mut text, right);
                }
                Some(OneEye::Right) => {}
            }
        }
        text.push_str(&self.raw);
        text.push_str(&self.tail);
        text
    }
}

impl MadeScreen {
    /// Writes it, and on the same screen the channel for the other eye.
    fn put(&self, text: &mut String, other: Option<&Self>) {
        let name = &self.name;
        let _ = write!(text, "\n[[screen]]\nname = {name:?}\n");
        match self.shape {
            Shape::Plane(corners) => {
                for (key, at) in ["lower_left", "lower_right", "upper_left"].iter().zip(corners) {
                    let _ = writeln!(text, "{key} = {}", exact(at.to_array()));
                }
            }
            Shape::Cylinder { center, radius, degrees, height } => {
                let center = list(center.to_array());
                let [degrees, height] = [degrees, height].map(list);
                let _ = writeln!(
                    text,
                    "cylinder = {{ center = {center}, radius = {radius:?}, degrees = {degrees}, \
                     height = {height} }}"
                );
            }
            Shape::Sphere { center, radius, azimuth, elevation, tilt } => {
                let rotation = list([0.0, -tilt, 0.0]);
                let center = list(center.to_array());
                let [azimuth, elevation] = [azimuth, elevation].map(list);
                let _ = writeln!(
                    text,
                    "sphere = {{ center = {center}, radius = {radius:?}, azimuth = {azimuth}, \
                     elevation = {elevation}, rotation = {rotation} }}"
                );
            }
        }
        let _ = writeln!(text, "pixels = {:?}", self.canvas());
        let channels = [Some(self), other];
        channels.into_iter().flatten().for_each(|channel| channel.put_channel(text));
        channels.into_iter().flatten().for_each(|channel| channel.put_adjustment(text));
    }

    fn put_channel(&self, text: &mut String) {
        let Self { name, size, .. } = self;
        let _ = write!(
            text,
            "[[screen.channel]]\nname = {name:?}\norigin = [0, 0]\npixels = {size:?}\n"
        );
        if let Some(server) = &self.server {
            let _ = writeln!(text, "server = {server:?}");
        }
    }

    fn put_adjustment(&self, text: &mut String) {
        let name = &self.name;
        let is_plain = self.adjust.is_empty() && self.eye.is_none();
        if is_plain && self.maps().next().is_none() {
            return;
        }
        let _ = write!(text, "\n[channel.{name:?}]\n");
        for key in self.maps() {
            let _ = writeln!(text, "{key} = \"{name}{}\"", ending(key));
        }
        match self.eye {
            Some(OneEye::Left) => text.push_str("eye = \"left\"\n"),
            Some(OneEye::Right) => text.push_str("eye = \"right\"\n"),
            None => {}
        }
        for line in &self.adjust {
            let _ = writeln!(text, "{line}");
        }
    }

    /// The canvas holds the channel; where a map says what it shows, around a sphere.
    fn canvas(&self) -> [u32; 2] {
        let [width, height] = self.size;
        match (&self.warp, self.shape) {
            (Some(_), Shape::Sphere { elevation: [low, high], .. }) => {
                let canvas = height.max(width) * 2;
                [canvas.min(16_384), (f64::from(canvas) * (high - low) / 360.0).ceil() as u32]
            }
            _ => [width, height],
        }
    }

    /// Refuses points that lie further away than those of any map that is read.
    fn check_reach(&self) -> anyhow::Result<()> {
        let is_far = |point: &&DVec3| point.as_vec3().abs().max_element() > WARP_REACH_M_MAX;
        match self.warp.iter().flatten().flatten().find(is_far) {
            None => Ok(()),
            Some(point) => bail!(
                "screen {}: a pixel's point would be {point} m; maps are read up to \
                 {WARP_REACH_M_MAX} m from the origin along each axis, so a smaller radius or \
                 distance, or an eye nearer to the origin, would be right",
                self.name
            ),
        }
    }

    /// The keys of its maps in the wall file.
    fn maps(&self) -> impl Iterator<Item = &'static str> {
        let maps = [
            ("warp", self.warp.is_some()),
            ("alpha", self.alpha.is_some()),
            ("beta", self.beta.is_some()),
        ];
        maps.into_iter().filter_map(|(key, is_there)| is_there.then_some(key))
    }

    /// The maps, each with the end of its name.
    fn files(&self) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
        let mut files = Vec::new();
        if let Some(points) = &self.warp {
            files.push((ending("warp"), pfm(self.size, points)));
        }
        for (key, codes) in [("alpha", &self.alpha), ("beta", &self.beta)] {
            if let Some(codes) = codes {
                files.push((ending(key), png(self.size, codes)?));
            }
        }
        Ok(files)
    }
}

fn ending(key: &str) -> &'static str {
    match key {
        "warp" => ".pfm",
        "alpha" => "-alpha.png",
        _ => "-beta.png",
    }
}

/// A portable float map of points in metres, rows from the bottom; NaN where unlit.
fn pfm([width, height]: [u32; 2], points: &[Option<DVec3>]) -> Vec<u8> {
    // Points that all lie in a square metre of z = 0 would be read as places of the canvas.
    let is_flat = points.iter().flatten().all(|point| point.z as f32 == 0.0);
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    bytes.reserve(points.len() * 12);
    for point in points.chunks_exact(width as usize).rev().flatten() {
        let mut point = point.map_or(Vec3::NAN, DVec3::as_vec3);
        point.z = if is_flat && point.z == 0.0 { 1e-9 } else { point.z };
        point.to_array().iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
    }
    bytes
}

/// Factors of codes as a grey picture of 16 bits, which is read as sRGB: what they leave of a code
/// is what they leave of its light.
fn png([width, height]: [u32; 2], factors: &[f64]) -> anyhow::Result<Vec<u8>> {
    let code = |factor: &f64| (factor.clamp(0.0, 1.0) * f64::from(u16::MAX)).round() as u16;
    let codes: Vec<u16> = factors.iter().map(code).collect();
    let image = image::ImageBuffer::<Luma<u16>, _>::from_raw(width, height, codes);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.context("a mask has another size")?.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn list<const N: usize>(numbers: [f64; N]) -> String {
    exact(numbers.map(round))
}

fn exact<const N: usize>(numbers: [f64; N]) -> String {
    format!("{:?}", numbers.map(|number| number + 0.0))
}

/// Checks the text of a wall file before it is written.
pub(super) fn check_text(text: &str, wall_file: &Path) -> anyhow::Result<()> {
    polyptych_wall_file::parse(text, wall_file).map(drop).map_err(|error| {
        anyhow!("these make no wall: {}: {}; {}", error.key(), error.what(), error.remedy())
    })
}

/// A name in the letters that those of a wall may have, at most 40 of them; `otherwise` if the text
/// has no ASCII letter or digit.
pub(super) fn plain_name(text: &str, otherwise: &str) -> String {
    const LETTERS_MAX: usize = 40;
    let letter = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    let name: String = text.to_ascii_lowercase().chars().take(LETTERS_MAX).map(letter).collect();
    // No name of a wall file begins with these.
    let name = name.trim_start_matches(['-', '.']);
    let is_plain = name.contains(|c: char| c.is_ascii_alphanumeric());
    if is_plain { name.to_owned() } else { otherwise.to_owned() }
}
