//! A proof as one HTML page: targets, points on the wall's picture, errors by channel, the wall.

use std::collections::BTreeMap;

use glam::DVec2;
use image::RgbaImage;
use polyptych_client::{Capture, Quantiles};
use polyptych_text::counted;
use polyptych_wall::Wall;
use polyptych_wall::light_composite::StereoEye;

use super::light::side_of;
use super::verification_report::{HEADINGS, MeasuredPoint, Measurement, VerificationReport};
use crate::image_files;
use crate::report_page::embedded_image::{EmbeddedImage, Mark};
use crate::report_page::markup::{add, escaped, number};
use crate::report_page::spread_plot::{Spread, SpreadPlot};
use crate::report_page::{self, add_facts, add_row, begin_table, end_table};

/// Maximum number of points that are marked and listed.
const POINTS_MAX: usize = 16;

/// Maximum number of screens whose difference is shown.
const DIFFERENCES_MAX: usize = 8;

/// The pictures of a proof.
pub(crate) struct ProofPictures {
    wall: EmbeddedImage,
    /// The pictures of screens in the wall's picture, from its left.
    places: Vec<ScreenPlace>,
    /// The names of screens, each with the picture of its difference.
    differences: Vec<(String, EmbeddedImage)>,
}

/// The place of a screen's picture, as one eye sees it, in the picture of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ScreenPlace {
    /// The index of the screen.
    screen: usize,
    side: StereoEye,
    /// Its left side, in pixels.
    left: f64,
}

/// The contents of a page.
pub(crate) struct ProofPage<'a> {
    pub wall: &'a Wall,
    /// The scene's file.
    pub scene: String,
    /// The wall file by which points are judged, if it is another one.
    pub as_built: Option<String>,
    pub table: &'a VerificationReport,
    pub pictures: ProofPictures,
    /// The wall as an SVG element.
    pub drawing: String,
}

impl ProofPictures {
    /// Returns the picture of a wall in a capture of it.
    ///
    /// # Errors
    /// A picture without pixels.
    pub(super) fn new(wall: &Wall, capture: &Capture) -> anyhow::Result<Self> {
        let whole = image_files::side_by_side(&capture.screens)?;
        // A capture has a picture for each eye that sees something else of a screen.
        let sides = (0..wall.screens.len() as u16).flat_map(|screen| {
            StereoEye::of(wall, screen).iter().map(move |side| (usize::from(screen), *side))
        });
        let mut left = 0.0;
        let mut places = Vec::with_capacity(capture.screens.len());
        for ((screen, side), picture) in sides.zip(&capture.screens) {
            places.push(ScreenPlace { screen, side, left });
            left += f64::from(picture.width);
        }
        let wall = EmbeddedImage::photograph(&whole)?;
        Ok(Self { wall, places, differences: Vec::new() })
    }

    /// Returns the place of a point in the picture of the wall, in pixels; NaN if it is not in it.
    fn place_of(&self, point: &MeasuredPoint) -> DVec2 {
        let (screen, side) = (point.screen, side_of(point.eye));
        let is_shown = |of: &&ScreenPlace| of.screen == screen && of.side == side;
        let left = self.places.iter().find(is_shown).map_or(f64::NAN, |of| of.left);
        point.canvas + DVec2::X * left
    }

    /// Adds the difference of a screen from the picture of one channel.
    ///
    /// # Errors
    /// A picture without pixels.
    pub(super) fn add_difference(&mut self, screen: &str, image: &RgbaImage) -> anyhow::Result<()> {
        if self.differences.len() < DIFFERENCES_MAX {
            self.differences.push((screen.to_owned(), EmbeddedImage::exact(image)?));
        }
        Ok(())
    }
}

impl ProofPage<'_> {
    /// Returns the page, which is well-formed XML below its first line.
    pub fn html(&self) -> String {
        let (kept, judged) = self.table.kept();
        let name = escaped(&self.wall.name);
        let class = if self.table.is_met() { "note" } else { "failure" };
        let mut body = format!(
            "<h1>Proof of wall {name}</h1>\n<p class=\"{class}\">Targets kept: {kept} of \
             {judged}.</p>\n"
        );
        let judge = self.as_built.clone().unwrap_or_else(|| "the wall file itself".into());
        let channels = counted(self.wall.channels.len(), "channel");
        let screens = counted(self.wall.screens.len(), "screen");
        add_facts(
            &mut body,
            &[
                ("Wall", format!("{}: {channels} on {screens}", self.wall.name)),
                ("Scene", self.scene.clone()),
                ("Judged by", judge),
                ("Points measured", self.table.points.len().to_string()),
                ("Program", format!("polyptych {}", env!("CARGO_PKG_VERSION"))),
            ],
        );
        self.add_targets(&mut body);
        self.add_points(&mut body);
        self.add_spreads(&mut body);
        self.add_differences(&mut body);
        body.push_str("<h2>The wall</h2>\n");
        body.push_str(&self.drawing);
        report_page::page(&format!("Proof of wall {}", self.wall.name), &body)
    }

    fn add_targets(&self, body: &mut String) {
        body.push_str("<h2>Targets</h2>\n");
        begin_table(body, "Those that were missed stand out", &HEADINGS);
        for row in &self.table.rows {
            add_target(body, row);
        }
        end_table(body);
        body.push_str("<details>\n<summary>What the rows mean</summary>\n<dl>\n");
        for (name, meaning) in self.table.meanings() {
            add(body, format_args!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(meaning)));
        }
        body.push_str("</dl>\n</details>\n");
    }

    /// Adds the picture of the wall with the worst points, and a list of them.
    fn add_points(&self, body: &mut String) {
        body.push_str("<h2>The wall's picture</h2>\n");
        let worst = worst_points(&self.table.points);
        let mark = |(index, point): (usize, &&MeasuredPoint)| {
            let class = if point.error_px <= point.bound_px { "s0" } else { "s1" };
            let (at, text) = (self.pictures.place_of(point), (index + 1).to_string());
            Mark { at, text, class }
        };
        let marks: Vec<Mark> = worst.iter().enumerate().map(mark).collect();
        body.push_str(&self.pictures.wall.svg("the wall with the worst points", &marks));
        if worst.is_empty() {
            body.push_str("<p class=\"note\">No point could be measured.</p>\n");
            return;
        }
        let headings = ["Point", "Channel", "Pixel", "Off by, px", "At most, px", "Scene at, m"];
        begin_table(body, "The points that are farthest off, by their bounds", &headings);
        for (index, point) in worst.iter().enumerate() {
            let is_found = point.error_px.is_finite();
            let error =
                if is_found { format!("{:.5}", point.error_px) } else { "not found".into() };
            let cells = [
                (index + 1).to_string(),
                point.label(),
                format!("{:.1}, {:.1}", point.pixel.x, point.pixel.y),
                error,
                number(point.bound_px),
                number(point.offset_m),
            ];
            add_row(body, &cells);
        }
        end_table(body);
    }

    fn add_spreads(&self, body: &mut String) {
        let mut by_channel: BTreeMap<&str, (Vec<f64>, f64)> = BTreeMap::new();
        for point in self.table.points.iter().filter(|point| point.error_px.is_finite()) {
            let (errors, bound) = by_channel.entry(&point.channel).or_default();
            errors.push(point.error_px);
            *bound = bound.max(point.bound_px);
        }
        let row = |name: &str| {
            let (errors, bound) = by_channel.remove(name)?;
            let values = Quantiles::from_samples(errors);
            Some(Spread { name: name.to_owned(), values, bound: Some(bound) })
        };
        let names = self.wall.channels.iter().map(|channel| channel.name.as_str());
        let rows: Vec<Spread> = names.filter_map(row).collect();
        if !rows.is_empty() {
            body.push_str("<h2>Errors of points, by channel</h2>\n");
            let title = "How far points are off: median / 95 % / maximum".to_owned();
            body.push_str(&SpreadPlot { title, unit: "px", rows }.svg());
        }
    }

    fn add_differences(&self, body: &mut String) {
        for (screen, picture) in &self.pictures.differences {
            let name = escaped(screen);
            add(
                body,
                format_args!(
                    "<h2>Screen {name} against one channel</h2>\n<p class=\"note\">Black is equal; \
                     a level of difference is 31 of 255.</p>\n"
                ),
            );
            body.push_str(&picture.svg(&format!("difference of screen {screen}"), &[]));
        }
    }
}

fn add_target(body: &mut String, row: &Measurement) {
    let class = if row.is_kept { "" } else { " class=\"missed\"" };
    let [what, measured, target, kept, note] = row.cells().map(|cell| escaped(&cell));
    add(
        body,
        format_args!(
            "<tr{class}><th scope=\"row\">{what}</th><td>{measured}</td><td>{target}</td>\
             <td>{kept}</td><td class=\"words\">{note}</td></tr>\n"
        ),
    );
}

/// Returns the points that are farthest off in shares of their bounds, those that were not found
/// first; each place of a channel once.
fn worst_points(points: &[MeasuredPoint]) -> Vec<&MeasuredPoint> {
    let mut sorted: Vec<&MeasuredPoint> = points.iter().collect();
    // NaN is larger than all numbers.
    let share = |point: &MeasuredPoint| (point.error_px / point.bound_px).abs();
    sorted.sort_by(|a, b| share(b).total_cmp(&share(a)));
    let mut worst: Vec<&MeasuredPoint> = Vec::new();
    for point in sorted {
        let is_same = |other: &&MeasuredPoint| {
            (&other.channel, other.eye) == (&point.channel, point.eye)
                && other.pixel.distance(point.pixel) < 2.0
        };
        if !worst.iter().any(is_same) {
            worst.push(point);
        }
        if worst.len() == POINTS_MAX {
            break;
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::super::verification_report::Bound;
    use super::*;
    use glam::UVec2;
    use polyptych_client::{FrameId, Image};
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{Channel, Eye, Screen, StereoPacking, Surface};

    fn point(channel: &str, x: f64, error_px: f64) -> MeasuredPoint {
        let pixel = DVec2::new(x, 8.0);
        MeasuredPoint {
            channel: channel.to_owned(),
            eye: Eye::Center,
            screen: 0,
            pixel,
            canvas: pixel,
            error_px,
            bound_px: 0.01,
            offset_m: 0.0,
        }
    }

    #[test]
    fn marks_lie_on_the_picture_of_their_screen_and_eye() {
        let plane = Plane::upright(glam::DVec3::NEG_Z, DVec2::ONE);
        let size = UVec2::new(64, 32);
        let screens = ["front", "side"].map(|name| Screen::new(name, Surface::Plane(plane), size));
        let channels = [0, 1].map(|screen| Channel::tile("c", screen, UVec2::ZERO, size));
        let mut wall = Wall::new("w", screens.to_vec(), channels.to_vec());
        let picture = |name: &str| Image {
            name: name.to_owned(),
            width: 64,
            height: 32,
            rgba: vec![0; 4 * 64 * 32],
        };
        let place = |wall: &Wall, names: &[&str], (screen, eye): (usize, Eye)| {
            let screens = names.iter().map(|name| picture(name)).collect();
            let (channels, missing) = (Vec::new(), Vec::new());
            let capture = Capture { frame: FrameId(1), screens, channels, missing };
            let pictures = ProofPictures::new(wall, &capture).expect("pictures");
            pictures.place_of(&MeasuredPoint { eye, screen, ..point("c", 10.0, 0.0) })
        };
        let mono = ["front", "side"];
        assert_eq!(place(&wall, &mono, (0, Eye::Center)), DVec2::new(10.0, 8.0));
        assert_eq!(place(&wall, &mono, (1, Eye::Center)), DVec2::new(74.0, 8.0));
        // The right eye's picture of the first screen lies between both screens.
        wall.channels[0].adjustment.packing = StereoPacking::SideBySide;
        let stereo = ["front", "front-right", "side"];
        assert_eq!(place(&wall, &stereo, (0, Eye::Left)), DVec2::new(10.0, 8.0));
        assert_eq!(place(&wall, &stereo, (0, Eye::Right)), DVec2::new(74.0, 8.0));
        assert_eq!(place(&wall, &stereo, (1, Eye::Center)), DVec2::new(138.0, 8.0));
    }

    #[test]
    fn the_worst_points_are_marked_and_a_missed_target_stands_out() {
        let plane = Plane::upright(glam::DVec3::NEG_Z, DVec2::ONE);
        let size = UVec2::new(64, 32);
        let screen = Screen::new("front", Surface::Plane(plane), size);
        let channel = Channel::tile("<left>", 0, UVec2::ZERO, size);
        let wall = Wall::new("a & b", vec![screen], vec![channel]);
        let mut table = VerificationReport::default();
        table.add("points", 0.02, "px", Some(Bound::AtMost(0.01)), "<left>");
        table.points = vec![
            point("<left>", 10.0, 0.001),
            point("<left>", 20.0, 0.02),
            point("<left>", 20.5, 0.019),
            point("<left>", 40.0, f64::NAN),
        ];
        let worst: Vec<f64> = worst_points(&table.points).iter().map(|p| p.pixel.x).collect();
        assert_eq!(worst, [40.0, 20.0, 10.0]);
        let picture = EmbeddedImage::photograph(&RgbaImage::new(64, 32)).expect("a picture");
        let places = vec![ScreenPlace { screen: 0, side: StereoEye::Left, left: 0.0 }];
        let pictures = ProofPictures { wall: picture, places, differences: Vec::new() };
        let (scene, drawing) = ("town.glb".to_owned(), "<svg/>".to_owned());
        let page =
            ProofPage { wall: &wall, scene, as_built: None, table: &table, pictures, drawing };
        let html = page.html();
        let xml = html.split_once('\n').expect("a first line").1;
        let document = roxmltree::Document::parse(xml).unwrap_or_else(|e| panic!("{e}"));
        let of_class = |name: &str| {
            let nodes = document.descendants().filter_map(|node| node.attribute("class"));
            nodes.filter(|class| class.split(' ').any(|word| word == name)).count()
        };
        assert_eq!(of_class("mark-ring"), 3);
        assert_eq!(of_class("missed"), 1);
        assert!(html.contains("Targets kept: 0 of 1") && html.contains("not found"));
    }
}
