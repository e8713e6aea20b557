//! Calibration files that other systems wrote, drawn by real servers and compared point by point
//! with a reading of the same files that shares no code with the program's.
//!
//! The files lie beside the repository; without them these tests are ignored.

mod archive;
mod reading;
mod waves;

use std::path::Path;

use glam::{DMat2, DVec2, DVec3};
use image::RgbaImage;
use polyptych_client::Wall;
use reading::Reading;
use waves::{Pattern, Seat};

use crate::harness::local_wall::{self, LocalWall};
use crate::harness::maps::{self, Entry, Png, png};
use crate::harness::pictures;
use crate::harness::place::TestDir;
use crate::harness::scenes::foreign_wall;
use crate::reference::tone;

/// Maximum error of points in pixels of the channel: of half of them, and of 99.9 % of them. Larger
/// errors lie where maps are so steep that a wave is longer than the picture.
const MEDIAN_MAX_PX: f64 = 0.1;
const MOST_MAX_PX: f64 = 0.6;

/// Maximum error of a code, in levels of 255; the expected code is not rounded.
const LEVELS_MAX: f64 = 1.0;

/// Share of the pixels whose codes may be off by more, by some of the sky's light: of float maps
/// that jump or are noisy, 200 in a million were found.
const BEYOND_MAX: f64 = 5e-4;

/// Minimum fraction of its length by which a step from pixel to pixel changes at an edge of a map.
const EDGE_CHANGE: f64 = 0.25;

/// Maximum uncertainty of a judged place, from rounding to codes, in pixels.
const UNSURE_MAX_PX: f64 = 0.2;

/// Least share of the lit pixels whose place is told: masks leave some of them dark.
const TOLD_MIN: f64 = 0.05;

/// The pictures of all patterns on the wall's only channel.
struct Shown {
    seat: Seat,
    patterns: Vec<(Pattern, RgbaImage)>,
}

/// Draws all patterns on the wall of this file.
fn show(place: &TestDir, path: &Path) -> Shown {
    let mut wall = polyptych_wall_file::load(path).unwrap_or_else(|error| panic!("{error}"));
    let folder = path.parent().expect("a folder");
    for file in &mut wall.files {
        file.path = folder.join(&file.path).display().to_string();
    }
    let wall: Wall = local_wall::patient(wall);
    let seat = Seat::of(&wall);
    let patterns = seat.patterns();
    let scene = place.write("scenes/patterns.glb", seat.model(&patterns).gltf().glb());
    let local = LocalWall::start(&wall, &[scene.parent().expect("a folder")]);
    let client = local.client();
    client.open_scene("patterns.glb").expect("opened");
    let shot = |(index, pattern): (usize, Pattern)| {
        let capture = local_wall::shot(&client, Seat::camera(index));
        let [picture] = &capture.channels[..] else { panic!("channels of {}", path.display()) };
        (pattern, pictures::image_of(picture))
    };
    let patterns = patterns.into_iter().enumerate().map(shot).collect();
    Shown { seat, patterns }
}

/// The result of a comparison at a pixel.
struct Found {
    /// The error of its point, in pixels of the channel.
    error_px: f64,
    /// The map bends there.
    is_edge: bool,
}

impl Shown {
    /// The place on the canvas of each pixel by a reading, in pixels of the canvas.
    fn due(&self, reading: &Reading) -> Vec<Option<DVec2>> {
        reading.points.iter().map(|point| self.seat.place(point.as_ref().copied()?)).collect()
    }

    /// Compares every pixel's place and light with a reading, and says what it came to.
    fn compare(&self, name: &str, reading: &Reading) {
        let light = self.compare_light(name, reading);
        let due = self.due(reading);
        let [width, height] = reading.size;
        let at = |x: u32, y: u32| due[(y * width + x) as usize];
        let (mut found, mut lit) = (Vec::new(), 0);
        for (x, y) in (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y))) {
            let around = [at(x - 1, y), at(x + 1, y), at(x, y - 1), at(x, y + 1)];
            let Some(here) = at(x, y) else { continue };
            let [Some(left), Some(right), Some(above), Some(below)] = around else { continue };
            lit += 1;
            let slope = DMat2::from_cols((right - left) / 2.0, (below - above) / 2.0);
            let bent =
                (right + left - here * 2.0).length().max((above + below - here * 2.0).length());
            let is_edge = bent > EDGE_CHANGE * slope.x_axis.length().min(slope.y_axis.length());
            let light = reading.light[(y * width + x) as usize];
            let Some((off, unsure)) = self.offset((x, y), light, here, slope) else { continue };
            if in_pixels(slope, unsure) <= UNSURE_MAX_PX {
                found.push(Found { error_px: in_pixels(slope, off), is_edge });
            }
        }
        let worst = |is_edge: bool| {
            let of_kind = found.iter().filter(|found| found.is_edge == is_edge);
            of_kind.map(|found| found.error_px).fold(0.0, f64::max)
        };
        let mut errors: Vec<f64> = found.iter().map(|found| found.error_px).collect();
        errors.sort_by(f64::total_cmp);
        assert!(!errors.is_empty(), "{name}: no pixel is light enough to be measured");
        let median = errors[errors.len() / 2];
        let most = errors[errors.len() * 999 / 1000];
        let edges = found.iter().filter(|found| found.is_edge).count();
        println!(
            "{name}: {} of {lit} places told: median {median:.4} px, \
             99.9 % {most:.4} px, worst {:.4} px, at {edges} edges {:.4} px",
            found.len(),
            worst(false),
            worst(true)
        );
        assert!(median <= MEDIAN_MAX_PX, "{name}: median {median} px");
        assert!(most <= MOST_MAX_PX, "{name}: 99.9 % within {most} px");
        let share = found.len() as f64 / f64::from(lit);
        assert!(share >= TOLD_MIN, "{name}: only {share} of the places are told");
        assert!(light <= BEYOND_MAX, "{name}: the light of {light} of the pixels is off");
    }

    /// Returns the offset of a pixel's drawn place from `due`, and its uncertainty, in pixels of
    /// the canvas: by the finest waves that its neighbours tell apart, which coarser ones confirm.
    /// `None` if no wave tells the place.
    fn offset(
        &self,
        (x, y): (u32, u32),
        light: [DVec3; 2],
        due: DVec2,
        slope: DMat2,
    ) -> Option<(DVec2, DVec2)> {
        let (mut offset, mut unsure) = (DVec2::ZERO, DVec2::ZERO);
        for axis in 0..2 {
            let per_pixel = slope.row(axis).length();
            let mut finest = None;
            for (pattern, picture) in &self.patterns {
                let Pattern::Wave { axis: of, period } = *pattern else { continue };
                if of != axis || period < waves::PIXELS_PER_PERIOD * per_pixel {
                    continue;
                }
                let codes = picture.get_pixel(x, y).0;
                let Some(told) = waves::place(codes, light, period, due[axis]) else { continue };
                finest = Some(told);
                // The largest that is too far off to be chance is what tells.
                if (told.place - due[axis]).abs() > period / 8.0 {
                    break;
                }
            }
            let told = finest?;
            (offset[axis], unsure[axis]) = (told.place - due[axis], told.unsure);
        }
        Some((offset, unsure))
    }

    /// The share of pixels whose light of flat fields is off by more than it may be.
    fn compare_light(&self, name: &str, reading: &Reading) -> f64 {
        let [width, height] = reading.size;
        let is_lit = |x: u32, y: u32| reading.points[(y * width + x) as usize].is_some();
        let (mut worst, mut at) = (0.0_f64, String::new());
        let (mut count, mut beyond) = (0_u64, 0_u64);
        for (pattern, picture) in &self.patterns {
            let Pattern::Flat(grey) = *pattern else { continue };
            assert_eq!(picture.dimensions(), (width, height), "{name}");
            for (x, y, drawn) in picture.enumerate_pixels() {
                let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
                let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
                let mut around = columns.flat_map(|x| rows.clone().map(move |y| (x, y)));
                let here = is_lit(x, y);
                // Where a map ends, pixels are lit in part.
                if around.any(|(x, y)| is_lit(x, y) != here) {
                    continue;
                }
                count += 1;
                let [alpha, beta] = reading.light[(y * width + x) as usize];
                let light = if here { alpha * grey * (1.0 - beta) + beta } else { DVec3::ZERO };
                let due = tone::unlit_codes(light);
                let levels = (0..3).map(|i| (due[i] - f64::from(drawn.0[i])).abs());
                let levels = levels.fold(0.0, f64::max);
                beyond += u64::from(levels > LEVELS_MAX);
                if levels > worst {
                    worst = levels;
                    at = format!("{grey} at ({x}, {y}): {:?} for {due:.2}", &drawn.0[..3]);
                }
            }
        }
        println!(
            "{name}: light of {count} pixels, {beyond} by more than {LEVELS_MAX} level, at most \
             {worst:.3}, {at}"
        );
        beyond as f64 / count as f64
    }
}

/// The length in pixels of the channel of a way on the canvas.
fn in_pixels(slope: DMat2, off: DVec2) -> f64 {
    let (across, down) = (slope.x_axis.length(), slope.y_axis.length());
    // Where a map is folded flat, in its longer direction.
    if slope.determinant().abs() < 0.02 * across * down {
        return off.length() / across.max(down);
    }
    (slope.inverse() * off).length()
}

/// A wall of one channel whose warp is a file, on a plane.
fn wall_of(
    place: &TestDir,
    (name, bytes): (&str, &[u8]),
    [pixels, canvas]: [[u32; 2]; 2],
    [eye, screen]: [f64; 2],
    keys: &str,
) -> std::path::PathBuf {
    place.write(name, bytes);
    let height = 2.0 * f64::from(canvas[1]) / f64::from(canvas[0]);
    place.write(
        "wall.toml",
        format!(
            "[wall]\nname = \"foreign\"\neye = [0.0, 0.0, {eye:?}]\n[[screen]]\n\
             name = \"screen\"\nsize = [2.0, {height:?}]\ncenter = [0.0, 0.0, {screen:?}]\n\
             pixels = {canvas:?}\n[[screen.channel]]\nname = \"one\"\npixels = {pixels:?}\n\
             [channel.one]\nwarp = \"{name}\"\n{keys}"
        ),
    )
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn float_maps_show_what_they_say() {
    let maps = [("sgct-dome-channel1_warp.pfm", [320, 160]), ("sgct-surface1.pfm", [240, 180])];
    for (name, pixels) in maps {
        let path = foreign_wall(name);
        let place = TestDir::new();
        let bytes = std::fs::read(path).expect("read");
        let wall = wall_of(&place, (name, &bytes), [pixels, [320, 200]], [0.0, -1.5], "");
        let shown = show(&place, &wall);
        let map = reading::float_map(&bytes);
        let reading = Reading::of_map(&map, pixels, |[u, v, _]| Some(shown.seat.point(u, v)));
        shown.compare(name, &reading);
    }
}

/// An OBJ by both of its roles: its positions as points in the room are drawn; as places, which
/// SGCT takes them for, some at a corner of this mesh are folded, and refused by their line.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn a_mesh_of_sgct_shows_its_points_and_is_refused_where_it_is_folded() {
    let name = "sgct-top_warp2.obj";
    let path = foreign_wall(name);
    let whole = std::fs::read_to_string(path).expect("read");
    let sgct = "warp_obj = \"sgct\"\n";
    let (sizes, depths) = ([[240, 240], [300, 300]], [2.0, -0.5]);
    let place = TestDir::new();
    let wall = wall_of(&place, (name, whole.as_bytes()), sizes, depths, sgct);
    let wall = wall.display().to_string();
    place.run(["check", &wall]).failed(&["channel.one.warp", "line 9461", "turned over"]);
    let place = TestDir::new();
    let wall = wall_of(&place, (name, whole.as_bytes()), sizes, depths, "");
    let shown = show(&place, &wall);
    let reading = reading::obj(&whole).reading(sizes[0], |value| value);
    shown.compare(name, &reading);
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn a_mesh_of_bourke_shows_what_it_says() {
    let name = "bourke-standard_16x9.data";
    let path = foreign_wall(name);
    let place = TestDir::new();
    let pixels = [480, 270];
    let text = std::fs::read_to_string(path).expect("read");
    let wall = wall_of(&place, (name, text.as_bytes()), [pixels; 2], [0.0, -2.0], "");
    let shown = show(&place, &wall);
    let mesh = reading::bourke(&text, 480.0 / 270.0);
    let reading = mesh.reading(pixels, |value| shown.seat.point(value.x, value.y));
    shown.compare(name, &reading);
}

/// Imports an archive, draws it, and compares it with a reading of the archive's own bytes.
fn compare_archive(name: &str, path: &Path) {
    let place = TestDir::new();
    let out = place.path("imported").display().to_string();
    let file = path.display().to_string();
    place.run(["wall", "import", &file, "-o", &out]).succeeded();
    let shown = show(&place, &place.path("imported/wall.toml"));
    let archive = archive::Archive::read(path);
    shown.compare(name, &archive.reading(&shown.seat));
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn archives_of_the_reference_library_show_what_they_say() {
    for name in ["Media2D.mpcdi", "Sim3D.mpcdi", "ShaderLamp.mpcdi"] {
        let path = foreign_wall(name);
        compare_archive(name, &path);
    }
}

/// The reference library's beta is black: this one is not, and of another size and gamma.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn an_archive_with_beta_shows_light_by_the_standard() {
    let path = foreign_wall("Media2D.mpcdi");
    let place = TestDir::new();
    let archive = archive::Archive::read(&path);
    let texels: Vec<u16> = (0..40 * 30).map(|i| i % 40 + i / 40).collect();
    let beta = png(&Png { size: [40, 30], color: 0, bits: 8, gamma: None, texels: &texels });
    let entries: Vec<Entry> = archive
        .entries
        .iter()
        .map(|(name, bytes)| match name.as_str() {
            "BetaMap-proj1.png" => Entry::new(name, &beta),
            "mpcdi.xml" => {
                let text = String::from_utf8(bytes.clone()).expect("text");
                let gamma = "</componentDepth><gammaEmbedded>1.8</gammaEmbedded>\n</betaMap>";
                let end = text.find("</betaMap>").expect("a beta");
                let head = text[..end].trim_end().trim_end_matches("</componentDepth>");
                let text = [head, gamma, &text[end + "</betaMap>".len()..]].concat();
                Entry::new(name, text.as_bytes())
            }
            _ => Entry::new(name, bytes),
        })
        .collect();
    let path = place.write("beta.mpcdi", maps::zip(&entries));
    compare_archive("Media2D.mpcdi with beta", &path);
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn an_archive_of_profile_a3_is_refused_by_name_and_leaves_nothing() {
    let path = foreign_wall("Advanced3D.mpcdi");
    let place = TestDir::new();
    let out = place.path("a3").display().to_string();
    let file = path.display().to_string();
    place.run(["wall", "import", &file, "-o", &out]).failed(&["MPCDI.profile", "a3"]);
    assert!(!place.path("a3").exists(), "an empty folder is left");
}
