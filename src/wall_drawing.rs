//! A wall as one SVG: plan and side view of the room, and the canvas of each screen, unrolled. All
//! in one scale each, from the model that servers draw by.
//!
//! Numbers of the drawing can be read back: groups of views have `data-origin`, the place of
//! display space's origin (or of a canvas's upper left), and `data-scale`, pixels of the drawing
//! for each metre (or each pixel of the canvas).

mod canvas_panel;
mod contour;
mod label;
mod legend;
mod lit_shape;
mod polygon;
mod room_view;
mod scale;
mod screen_shape;

use std::collections::BTreeMap;

use glam::DVec2;
use polyptych_text::counted;
use polyptych_wall::blend::BlendModel;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{ChannelKind, Eye, Wall};
use polyptych_wall_file::check_report::CheckReport;

use crate::report_page::markup::{add, escaped, number};
use canvas_panel::{CanvasPanel, HEAD};
use lit_shape::{LitShape, lit_shapes};
use room_view::{RoomView, Side};
use screen_shape::ScreenShape;

const STYLE: &str = include_str!("wall_drawing/wall.css");

/// Width of a drawing.
const WIDTH: f64 = 1240.0;

/// Space around everything.
const MARGIN: f64 = 30.0;

/// Maximum height of both views of the room together, and of all canvases.
const ROOM_HEIGHT: f64 = 860.0;
const CANVASES_HEIGHT: f64 = 1100.0;

/// Maximum height of a single canvas.
const CANVAS_HEIGHT: f64 = 560.0;

/// Space between canvases, and the minimum width of the texts above one.
const GAP: f64 = 26.0;
const TEXT_WIDTH: f64 = 190.0;

/// Number of colours of channels.
const COLORS: usize = 8;

/// Channels that are nearer to each other on their canvas than this have different colours, in
/// shares of their size: bezels are narrower.
const NEAR: f64 = 0.06;

/// A wall with all that its drawing needs.
struct Drawing<'a> {
    of: ResolvedWall<'a>,
    report: &'a CheckReport,
    /// The index of each channel by its name.
    indices: BTreeMap<String, usize>,
    screens: Vec<ScreenShape>,
    lit: Vec<LitShape>,
    colors: Vec<usize>,
    /// `None` where no channel shares its light.
    blend: Option<BlendModel<'a>>,
}

/// Returns the drawing of a wall as an SVG element with its own style, which is well-formed XML
/// and can stand alone or in a page. `report` is the wall's own.
pub(crate) fn svg(of: ResolvedWall<'_>, report: &CheckReport) -> String {
    let drawing = Drawing::new(of, report);
    let mut body = String::new();
    let mut top = drawing.add_head(&mut body, MARGIN);
    top = drawing.add_room(&mut body, top + 14.0);
    top = drawing.add_canvases(&mut body, top + 30.0);
    let height = legend::add(&mut body, &drawing, DVec2::new(MARGIN, top + 30.0), WIDTH - MARGIN);
    let name = escaped(&report.name);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"wall-drawing\" width=\"{WIDTH}\" \
         height=\"{height:.0}\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" \
         aria-label=\"wall {name}\">\n<title>wall {name}</title>\n<style>\n{STYLE}</style>\n\
         {}\n<rect class=\"w-paper\" width=\"{WIDTH}\" height=\"{height:.0}\"/>\n{body}</svg>\n",
        legend::PATTERNS
    )
}

/// Returns the class that gives a channel its colour.
fn color_class(drawing: &Drawing<'_>, channel: usize) -> String {
    format!("c{}", drawing.colors[channel])
}

impl<'a> Drawing<'a> {
    fn new(of: ResolvedWall<'a>, report: &'a CheckReport) -> Self {
        let wall = of.wall;
        let lit = lit_shapes(of);
        let blend = BlendModel::new(of);
        let is_shared = wall.channel_ids().any(|id| !blend.neighbours(id).is_empty());
        let names = wall.channels.iter().map(|channel| channel.name.clone());
        let ground = |screen| ScreenShape::new(of.shapes.screen(screen), wall.screens.len());
        Self {
            of,
            report,
            indices: names.zip(0..).collect(),
            screens: wall.screens.iter().map(ground).collect(),
            colors: colors(wall, &lit),
            lit,
            blend: is_shared.then_some(blend),
        }
    }

    /// Adds the wall's name and its numbers. Returns the lower end of them.
    fn add_head(&self, svg: &mut String, top: f64) -> f64 {
        let (wall, report) = (self.of.wall, self.report);
        let [x, y, z] = report.eye_m;
        let stereo = format!("{:?}", report.stereo).to_lowercase();
        let facts = [
            counted(wall.channels.len(), "channel"),
            counted(wall.screens.len(), "screen"),
            format!("{} pixels", number(report.pixels_total as f64)),
            format!("eye at x {x:.2}, y {y:.2}, z {z:.2} m"),
            format!("stereo: {stereo}"),
        ];
        let lines = [("w-head", 18.0, report.name.clone()), ("w-fact", 38.0, facts.join(" · "))];
        for (class, below, text) in lines {
            let text = escaped(&label::shortened(&text, 20.0, 1.6 * WIDTH));
            let y = top + below;
            add(
                svg,
                format_args!("<text class=\"{class}\" x=\"{MARGIN}\" y=\"{y:.1}\">{text}</text>\n"),
            );
        }
        top + 44.0
    }

    /// Adds plan and side view in one scale, beside or below each other, whichever is larger.
    /// Returns their lower end.
    fn add_room(&self, svg: &mut String, top: f64) -> f64 {
        let reaches = [Side::Above, Side::Right].map(|side| room_view::reach(self, side));
        let extents = reaches.map(|[low, high]| high - low);
        let margins = room_view::size([DVec2::ZERO; 2], 0.0);
        let width = WIDTH - 2.0 * MARGIN;
        let beside = ((width - 2.0 * margins.x - GAP) / (extents[0].x + extents[1].x))
            .min((ROOM_HEIGHT * 0.7 - margins.y) / extents[0].y.max(extents[1].y));
        let below = ((width - margins.x) / extents[0].x.max(extents[1].x))
            .min((ROOM_HEIGHT - 2.0 * margins.y - GAP) / (extents[0].y + extents[1].y));
        let is_beside = beside >= below * 0.8;
        let scale = if is_beside { beside } else { below };
        let sizes = reaches.map(|reach| room_view::size(reach, scale));
        let first = DVec2::new(MARGIN, top);
        let (second, height) = if is_beside {
            (DVec2::new(sizes[0].x + GAP, 0.0), sizes[0].y.max(sizes[1].y))
        } else {
            (DVec2::new(0.0, sizes[0].y + GAP), sizes[0].y + GAP + sizes[1].y)
        };
        RoomView::new(self, Side::Above, first, scale).add_to(svg);
        RoomView::new(self, Side::Right, first + second, scale).add_to(svg);
        top + height
    }

    /// Adds the canvases of all screens in one scale, row by row. Returns their lower end.
    fn add_canvases(&self, svg: &mut String, top: f64) -> f64 {
        let sizes = self.canvases();
        let scale = canvas_scale(&sizes);
        add(
            svg,
            format_args!(
                "<text class=\"w-title\" x=\"{MARGIN}\" y=\"{top:.1}\">Canvases, unrolled, as the \
                 viewer sees them</text>\n"
            ),
        );
        scale::add_bar(svg, DVec2::new(WIDTH - MARGIN - 180.0, top + 4.0), scale, 160.0);
        let (places, height) = shelves(&sizes, scale);
        for ((screen, eye, size_m), place) in sizes.iter().zip(places) {
            let size = *size_m * scale;
            CanvasPanel {
                drawing: self,
                screen: *screen,
                eye: *eye,
                at: DVec2::new(MARGIN, top + 12.0) + place,
                size,
                width: size.x.max(TEXT_WIDTH),
            }
            .add_to(svg);
        }
        top + 12.0 + height
    }

    /// Returns the canvases: a screen, an eye, and width and height in metres. Pixels of a screen
    /// without a known size are a millimetre.
    fn canvases(&self) -> Vec<(usize, Eye, DVec2)> {
        let rows = (0..).zip(&self.report.screens);
        rows.flat_map(|(index, row)| {
            let pixels = self.of.wall.screens[index].canvas.as_dvec2() / 1000.0;
            let known = row.size_m.map(DVec2::from).filter(|size| size.min_element() > 0.0);
            let size_m = known.unwrap_or(pixels);
            let eyes: Vec<Eye> = row.coverage.iter().map(|coverage| coverage.eye).collect();
            let eyes = if eyes.is_empty() { vec![Eye::Center] } else { eyes };
            eyes.into_iter().map(move |eye| (index, eye, size_m))
        })
        .collect()
    }
}

/// Returns the upper left corners of canvases in rows, and the height of all rows.
fn shelves(sizes: &[(usize, Eye, DVec2)], scale: f64) -> (Vec<DVec2>, f64) {
    let (mut places, mut pen, mut row_height) = (Vec::new(), DVec2::ZERO, 0.0_f64);
    for (_, _, size_m) in sizes {
        let size = *size_m * scale;
        let width = size.x.max(TEXT_WIDTH);
        if pen.x > 0.0 && pen.x + width > WIDTH - 2.0 * MARGIN {
            pen = DVec2::new(0.0, pen.y + row_height + GAP);
            row_height = 0.0;
        }
        places.push(pen + DVec2::Y * HEAD);
        pen.x += width + GAP;
        row_height = row_height.max(size.y + HEAD);
    }
    (places, pen.y + row_height)
}

/// Returns the pixels of the drawing for each metre with which all canvases fit.
fn canvas_scale(sizes: &[(usize, Eye, DVec2)]) -> f64 {
    let largest = sizes.iter().fold(DVec2::splat(1e-6), |most, (_, _, size)| most.max(*size));
    let mut scale = ((WIDTH - 2.0 * MARGIN) / largest.x).min(CANVAS_HEIGHT / largest.y);
    let texts = shelves(sizes, 0.0).1;
    while shelves(sizes, scale).1 > CANVASES_HEIGHT.max(texts * 1.5) {
        scale *= 0.95;
    }
    scale
}

/// Returns the colours of channels: none like that of a neighbour, if there are enough.
fn colors(wall: &Wall, lit: &[LitShape]) -> Vec<usize> {
    let rect = |shape: &LitShape| {
        let [low, high] = polygon::bounds(shape.canvas.iter().flatten().copied())?;
        let margin = (high - low) * NEAR;
        Some([low - margin, high + margin])
    };
    let rects: Vec<Option<[DVec2; 2]>> = lit.iter().map(rect).collect();
    let mut colors: Vec<usize> = Vec::with_capacity(lit.len());
    for (index, own) in rects.iter().enumerate() {
        let screen = wall.channels[index].screen;
        let is_near = |other: &usize| {
            let Some(([a, b], [c, d])) = own.zip(rects[*other]) else { return false };
            wall.channels[*other].screen == screen && a.cmple(d).all() && c.cmple(b).all()
        };
        let mut is_taken = [false; COLORS];
        for near in (0..index).filter(is_near) {
            is_taken[colors[near]] = true;
        }
        let first = usize::from(screen) * 3;
        let color = (first..first + COLORS).map(|color| color % COLORS);
        colors.push(color.clone().find(|color| !is_taken[*color]).unwrap_or(index % COLORS));
    }
    colors
}

/// Returns whether any channel has a projector with a pose.
fn has_projectors(wall: &Wall) -> bool {
    wall.channels.iter().any(|channel| matches!(channel.cover, ChannelKind::Projector(_)))
}

#[cfg(test)]
mod tests;
