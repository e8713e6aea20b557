//! The canvas of a screen, unrolled, as one eye sees it: channels, what they share and its shares,
//! and what none of them covers.

use std::collections::BTreeMap;

use glam::DVec2;
use polyptych_text::counted;
use polyptych_wall::blend::BlendModel;
use polyptych_wall::{ChannelId, Eye, Screen};
use polyptych_wall_file::check_report::{ChannelRow, CoverageRow, OverlapRow, ScreenRow};
use polyptych_wall_file::coverage::is_seen_by;

use super::contour::contours;
use super::label::{Label, Labels, shortened};
use super::lit_shape::LitShape;
use super::polygon::{self, simplified};
use super::{Drawing, color_class, scale};
use crate::report_page::markup::{add, escaped, number, path};

/// Height of the texts above a canvas.
pub(super) const HEAD: f64 = 36.0;

/// Maximum distance from their line of points that are left out, in pixels of the drawing.
const TOLERANCE_PX: f64 = 0.05;

/// Maximum number of pairs of channels whose overlap is hatched on one canvas.
const PAIRS_MAX: usize = 4096;

/// Maximum number of overlaps with a label.
const LABELS_MAX: usize = 64;

/// Maximum number of channels of a canvas with lines of equal shares: each asks all others.
const SHARED_MAX: usize = 32;

/// Cells along a side of a channel for these lines.
const SHARE_CELLS: usize = 32;

/// The shares of the light that have lines.
const SHARES: [f64; 3] = [0.25, 0.5, 0.75];

/// Share of the rectangle around an overlap from which on it is a strip with a width.
const STRIP_SHARE: f64 = 0.8;

/// Sizes of the letters of a channel's name, of which the largest that fits is taken. The smallest
/// ones are for walls of a thousand channels, of which a part is looked at.
const NAME_SIZES: [f64; 8] = [12.0, 11.0, 9.5, 8.0, 6.5, 5.5, 4.5, 3.8];

/// A canvas on paper.
pub(super) struct CanvasPanel<'a, 'b> {
    pub drawing: &'a Drawing<'b>,
    /// The index of its screen.
    pub screen: usize,
    /// The eye that sees it.
    pub eye: Eye,
    /// Upper left and size on paper, without the texts above.
    pub at: DVec2,
    pub size: DVec2,
    /// Width of the texts above.
    pub width: f64,
}

impl CanvasPanel<'_, '_> {
    fn surface(&self) -> &Screen {
        &self.drawing.of.wall.screens[self.screen]
    }

    fn row(&self) -> &ScreenRow {
        &self.drawing.report.screens[self.screen]
    }

    fn coverage(&self) -> Option<&CoverageRow> {
        self.row().coverage.iter().find(|row| row.eye == self.eye)
    }

    /// Returns the pixels of the drawing for each pixel of the canvas.
    fn scale(&self) -> DVec2 {
        self.size / self.surface().canvas.as_dvec2()
    }

    fn place(&self, canvas: DVec2) -> DVec2 {
        self.at + canvas * self.scale()
    }

    /// Returns the channels on it that the eye sees.
    fn shapes(&self) -> impl Iterator<Item = &LitShape> {
        let channels = &self.drawing.of.wall.channels;
        self.drawing.lit.iter().filter(move |shape| {
            let channel = &channels[shape.channel];
            usize::from(channel.screen) == self.screen && is_seen_by(channel, self.eye)
        })
    }

    fn id(&self, channel: usize) -> String {
        format!("w{}{:?}-{channel}", self.screen, self.eye)
    }

    /// Returns the path of outlines on the canvas.
    fn outlines(&self, outlines: &[Vec<DVec2>]) -> String {
        let outline = |points: &Vec<DVec2>| {
            let places: Vec<DVec2> = points.iter().map(|at| self.place(*at)).collect();
            path(&simplified(&places, TOLERANCE_PX), true)
        };
        outlines.iter().map(outline).collect()
    }

    pub fn add_to(&self, svg: &mut String) {
        let (name, DVec2 { x, y }, scale) = (escaped(&self.row().name), self.at, self.scale());
        let (width, height) = (self.size.x, self.size.y);
        let eye = format!("{:?}", self.eye).to_lowercase();
        add(
            svg,
            format_args!(
                "<g class=\"w-canvas\" data-screen=\"{name}\" data-eye=\"{eye}\" \
                 data-origin=\"{x:.3} {y:.3}\" data-scale=\"{} {}\">\n",
                scale.x, scale.y
            ),
        );
        self.add_head(svg);
        let rect =
            format!("<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\"");
        let frame = format!("w{}{:?}-frame", self.screen, self.eye);
        let is_shared = self.coverage().is_none_or(|row| row.blends);
        let below = if is_shared { "w-gap" } else { "w-hidden" };
        add(
            svg,
            format_args!(
                "<clipPath id=\"{frame}\">{rect}/></clipPath>\n{rect} class=\"{below}\"/>\n\
                 <g clip-path=\"url(#{frame})\">\n<defs>\n"
            ),
        );
        for shape in self.shapes().filter(|shape| !shape.canvas.is_empty()) {
            let name = escaped(&self.drawing.of.wall.channels[shape.channel].name);
            let (id, data) = (self.id(shape.channel), self.outlines(&shape.canvas));
            add(
                svg,
                format_args!(
                    "<path id=\"{id}\" data-channel=\"{name}\" clip-rule=\"evenodd\" \
                     d=\"{data}\"/>\n"
                ),
            );
        }
        svg.push_str("</defs>\n");
        self.add_channels(svg);
        self.add_overlaps(svg);
        self.add_shares(svg);
        add(svg, format_args!("</g>\n{rect} class=\"w-frame\"/>\n"));
        self.add_labels(svg);
        svg.push_str("</g>\n");
    }

    fn add_head(&self, svg: &mut String) {
        let row = self.row();
        let eye = match self.eye {
            Eye::Center => String::new(),
            eye => format!(", {} eye", format!("{eye:?}").to_lowercase()),
        };
        let [columns, rows] = row.pixels;
        let mut facts = vec![row.surface.to_owned()];
        facts.push(row.size_m.map_or("size unknown".to_owned(), scale::extent));
        facts.push(format!("{columns} × {rows} px"));
        if let Some(coverage) = self.coverage() {
            facts.push(format!("{} % covered", number(percent(coverage.covered))));
            if coverage.layers_max > 1 {
                facts.push(format!("up to {} layers", coverage.layers_max));
            }
        }
        let texts = [
            ("w-title", 13.0, 22.0, format!("{}{eye}", row.name)),
            ("w-fact", 11.0, 7.0, facts.join(", ")),
        ];
        for (class, size, above, text) in texts {
            let short = escaped(&shortened(&text, size, self.width));
            let (x, y, text) = (self.at.x, self.at.y - above, escaped(&text));
            add(
                svg,
                format_args!(
                    "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{short}<title>{text}\
                     </title></text>\n"
                ),
            );
        }
    }

    /// Adds the covered part, and then each channel in its colour, so that overlaps are darker.
    fn add_channels(&self, svg: &mut String) {
        let shapes = || self.shapes().filter(|shape| !shape.canvas.is_empty());
        for shape in shapes() {
            let id = self.id(shape.channel);
            add(svg, format_args!("<use href=\"#{id}\" class=\"w-cover\"/>\n"));
        }
        for shape in shapes() {
            let row = &self.drawing.report.channels[shape.channel];
            let (id, color) = (self.id(shape.channel), color_class(self.drawing, shape.channel));
            let text = escaped(&facts(row).join(", "));
            add(
                svg,
                format_args!(
                    "<use href=\"#{id}\" class=\"w-share {color}\"><title>{text}</title></use>\n"
                ),
            );
        }
    }

    /// Adds a hatching on each channel, cut to the part that earlier ones light too.
    fn add_overlaps(&self, svg: &mut String) {
        let Some(coverage) = self.coverage() else { return };
        let mut pairs: BTreeMap<usize, Vec<(usize, &OverlapRow)>> = BTreeMap::new();
        for overlap in coverage.overlaps.iter().take(PAIRS_MAX) {
            let [first, second] = &overlap.channels;
            if let (Some(&first), Some(&second)) =
                (self.drawing.indices.get(first), self.drawing.indices.get(second))
            {
                pairs.entry(second).or_default().push((first, overlap));
            }
        }
        for (second, others) in pairs {
            let (id, mut uses, mut texts) = (self.id(second), String::new(), Vec::new());
            for (first, overlap) in others {
                add(&mut uses, format_args!("<use href=\"#{}\"/>", self.id(first)));
                texts.push(escaped(&overlap_text(overlap)));
            }
            texts.truncate(8);
            add(
                svg,
                format_args!(
                    "<clipPath id=\"{id}-shared\">{uses}</clipPath><use href=\"#{id}\" \
                     class=\"w-overlap\" clip-path=\"url(#{id}-shared)\"><title>{}</title></use>\n",
                    texts.join("; ")
                ),
            );
        }
    }

    /// Adds the lines at which a channel has equal shares of the light.
    fn add_shares(&self, svg: &mut String) {
        let Some(blend) = &self.drawing.blend else { return };
        let shared: Vec<&LitShape> = self
            .shapes()
            .filter(|shape| !blend.neighbours(ChannelId(shape.channel as u16)).is_empty())
            .collect();
        if shared.len() > SHARED_MAX {
            return;
        }
        for shape in shared {
            let id = ChannelId(shape.channel as u16);
            let Some([low, high]) = polygon::bounds(shape.canvas.iter().flatten().copied()) else {
                continue;
            };
            // A little within, so that the corners of a picture are its own.
            let ends = [low + 0.01, high - 0.01];
            let share = |at: DVec2| weight_at(blend, id, at);
            let lines = SHARES
                .map(|least| self.outlines(&contours(ends, SHARE_CELLS, |at| share(at) >= least)));
            let color = color_class(self.drawing, shape.channel);
            let lines = lines.concat();
            add(svg, format_args!("<path class=\"w-iso {color}\" d=\"{lines}\"/>\n"));
        }
    }

    fn add_labels(&self, svg: &mut String) {
        let mut labels = Labels::default();
        let bounds = [self.at, self.at + self.size];
        for shape in self.shapes() {
            if let Some(room) = self.label_room(shape) {
                self.add_channel_label(svg, &mut labels, shape.channel, room);
            }
        }
        let Some(coverage) = self.coverage() else { return };
        for overlap in coverage.overlaps.iter().take(LABELS_MAX) {
            let (origin, size) =
                (DVec2::from(overlap.patch.origin), DVec2::from(overlap.patch.pixels));
            let is_strip = overlap.patch.area > STRIP_SHARE * size.x * size.y;
            let across = is_strip.then(|| format!("{} px", number(size.min_element().round())));
            let lines: Vec<String> =
                across.into_iter().chain(self.shares_at(overlap, origin + size / 2.0)).collect();
            if lines.is_empty() {
                continue;
            }
            let label = Label::new(lines, 9.0);
            let along = if size.x < size.y { DVec2::Y } else { DVec2::X };
            let middles = [0.0, 0.25, -0.25, 0.4, -0.4]
                .map(|part| self.place(origin + size / 2.0 + along * size * part));
            if let Some(at) = labels.place(&label, bounds, middles) {
                label.add_to(svg, at);
            }
        }
        for hole in coverage.uncovered.iter().filter(|_| coverage.blends).take(LABELS_MAX) {
            let (origin, size) = (DVec2::from(hole.origin), DVec2::from(hole.pixels));
            let area = hole.area_m2.map(|area| format!("{} m²", number(area)));
            let area = area.unwrap_or_else(|| format!("{} px", number(hole.area)));
            let label = Label::new([format!("not covered: {area}")], 10.0);
            let middle = self.place(origin + size / 2.0);
            if let Some(at) = labels.place(&label, bounds, [middle]) {
                label.add_to(svg, at);
            }
        }
    }

    /// Returns a rectangle of the paper for the label of a channel: all of it, or, if it is no
    /// rectangle, one around a place that is far from its borders.
    fn label_room(&self, shape: &LitShape) -> Option<[DVec2; 2]> {
        let on_paper = |outline: &Vec<DVec2>| outline.iter().map(|at| self.place(*at)).collect();
        let outlines: Vec<Vec<DVec2>> = shape.canvas.iter().map(on_paper).collect();
        let [low, high] = polygon::bounds(outlines.iter().flatten().copied())?;
        let area = outlines.iter().map(|outline| polygon::area(outline)).sum::<f64>().abs();
        if area > STRIP_SHARE * (high - low).element_product() {
            return Some([low, high]);
        }
        let (middle, clear) = polygon::inner_place(&outlines)?;
        let half = DVec2::new(clear, clear * 0.8);
        Some([(middle - half).max(self.at), (middle + half).min(self.at + self.size)])
    }

    /// Adds the name of a channel and its numbers, as many as fit; upwards if it is narrow.
    fn add_channel_label(
        &self,
        svg: &mut String,
        labels: &mut Labels,
        channel: usize,
        [low, high]: [DVec2; 2],
    ) {
        let row = &self.drawing.report.channels[channel];
        let (room, middle) = (high - low - 3.0, low.midpoint(high));
        let facts = facts(row);
        let fits = |label: &Label, room: DVec2| label.extent().cmple(room).all();
        for (count, size) in [(facts.len(), 11.0), (2, 11.0), (2, 9.0)] {
            let label = Label::new(facts.iter().take(count).cloned(), size);
            if fits(&label, room)
                && let Some(at) = labels.place(&label, [low, high], [middle])
            {
                return label.add_to(svg, at);
            }
        }
        let sizes = NAME_SIZES.map(|size| Label::new([row.name.clone()], size));
        if let Some(label) = sizes.iter().find(|label| fits(label, room)) {
            let near = [middle, low.lerp(high, 0.35), low.lerp(high, 0.65)];
            if let Some(at) = labels.place(label, [low, high], near) {
                label.add_to(svg, at);
            }
        } else if let Some(label) =
            sizes.iter().find(|label| fits(label, DVec2::new(room.y, room.x)))
        {
            let (x, y) = (middle.x, middle.y);
            add(svg, format_args!("<g transform=\"rotate(-90 {x:.1} {y:.1})\">"));
            label.add_to(svg, middle);
            svg.push_str("</g>\n");
        }
    }

    /// Returns the shares that two channels have of the light of a place; `None` if others light it
    /// too.
    fn shares_at(&self, overlap: &OverlapRow, canvas: DVec2) -> Option<String> {
        let blend = self.drawing.blend.as_ref().filter(|_| overlap.is_blended)?;
        let share = |name: &String| {
            let id = ChannelId(*self.drawing.indices.get(name)? as u16);
            Some(weight_at(blend, id, canvas) * 100.0)
        };
        let (first, second) = (share(&overlap.channels[0])?, share(&overlap.channels[1])?);
        // Elsewhere, others light the middle too, or it is beside the overlap.
        let is_theirs = first + second > 99.5 && first.min(second) > 0.5;
        is_theirs.then(|| format!("{first:.0} : {second:.0} %"))
    }
}

/// Returns a channel's share of the light of a place of its canvas, from 0 to 1.
fn weight_at(blend: &BlendModel<'_>, id: ChannelId, canvas: DVec2) -> f64 {
    let weights = blend.weights(id, canvas);
    weights.into_iter().find(|(of, _)| *of == id).map_or(0.0, |(_, weight)| weight)
}

fn percent(share: f64) -> f64 {
    (share * 1e4).round() / 1e2
}

/// Returns what two channels share, in words.
fn overlap_text(overlap: &OverlapRow) -> String {
    let [first, second] = &overlap.channels;
    let [width, height] = overlap.patch.pixels.map(|pixels| number(pixels.round()));
    let size = overlap.patch.size_m.map(|size| format!(", {}", scale::extent(size)));
    let blend = if overlap.is_blended { "" } else { ", not blended" };
    let size = size.unwrap_or_default();
    format!("{first} and {second} share {width} × {height} px{size}{blend}")
}

/// Returns the facts about a channel in short lines, its name first.
fn facts(row: &ChannelRow) -> Vec<String> {
    let [width, height] = row.pixels;
    let mut facts = vec![row.name.clone(), format!("{width} × {height} px")];
    facts.extend(row.size_m.map(scale::extent));
    let angle = |[across, down]: [f64; 2]| format!("{across:.1}° × {down:.1}°");
    facts.extend(row.degrees.map(angle));
    if row.server != row.name {
        facts.push(format!("server {}", row.server));
    }
    if let Some(spill) = row.spill.filter(|spill| *spill >= 0.001) {
        facts.push(format!("{} % beside the screen", number(percent(spill))));
    }
    if let Some(planes) = row.stereo_planes {
        facts.push(counted(planes, "flat picture"));
    }
    facts
}
