//! The room from above or from its right side, to scale: screens, channels, projectors, frusta, the
//! eyes, and places at which no head can be.

use glam::{DVec2, DVec3};
use polyptych_wall::head::HeadPose;
use polyptych_wall::head_limits::HeadError;
use polyptych_wall::{ChannelKind, Eye, Wall};

use super::contour::contours;
use super::label::{Label, Labels};
use super::polygon::{self, hull, simplified};
use super::scale::{self, add_bar, length, round_below};
use super::screen_shape::ScreenShape;
use super::{Drawing, color_class};
use crate::report_page::markup::{add, escaped, path};

/// Space around the room, for labels.
const MARGIN: DVec2 = DVec2::new(74.0, 66.0);

/// Height of the title above a view, and of the numbers and the bar below it.
const TITLE: f64 = 20.0;
const FOOT: f64 = 40.0;

/// Minimum distance of grid lines, in pixels of the drawing.
const GRID_PX: f64 = 44.0;

/// Maximum number of channels of a wall whose frusta from the eye are drawn.
const FRUSTA_MAX: usize = 48;

/// Maximum distance from their line of points that are left out, in pixels of the drawing.
const TOLERANCE_PX: f64 = 0.05;

/// Maximum number of checks of a channel for a head somewhere: half a second of work.
const HEADS_MAX: usize = 1 << 20;

/// Length of a ray that lights nothing, in metres.
const DARK_RAY_M: f64 = 1.0;

/// The side from which a room is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    /// The viewer looks up on paper.
    Above,
    /// The viewer looks to the right on paper.
    Right,
}

impl Side {
    fn name(self) -> &'static str {
        match self {
            Self::Above => "plan",
            Self::Right => "side",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Above => "Plan, from above",
            Self::Right => "Side view, from the right",
        }
    }

    /// Returns the names of the axes of display space to the right and down on paper.
    fn axes(self) -> [&'static str; 2] {
        match self {
            Self::Above => ["x", "z"],
            Self::Right => ["z", "y"],
        }
    }

    /// Returns the place on paper of a point, in metres, down positive.
    pub fn flat(self, point: DVec3) -> DVec2 {
        match self {
            Self::Above => DVec2::new(point.x, point.z),
            Self::Right => DVec2::new(-point.z, -point.y),
        }
    }

    /// Returns the point of the room at a place of the paper, in the plane of the wall's eye.
    fn point(self, at: DVec2, eye: DVec3) -> DVec3 {
        match self {
            Self::Above => DVec3::new(at.x, eye.y, at.y),
            Self::Right => DVec3::new(eye.x, -at.y, -at.x),
        }
    }
}

/// A view of the room on paper.
pub(super) struct RoomView<'a, 'b> {
    drawing: &'a Drawing<'b>,
    side: Side,
    scale: f64,
    /// The origin of display space on paper.
    origin: DVec2,
    /// Low and high corner on paper.
    bounds: [DVec2; 2],
}

/// Returns the rectangle around all that is drawn, in metres on paper.
pub(super) fn reach(drawing: &Drawing<'_>, side: Side) -> [DVec2; 2] {
    let wall = drawing.of.wall;
    let lenses = wall.channels.iter().filter_map(|channel| match &channel.cover {
        ChannelKind::Projector(projector) => Some(projector.position),
        _ => None,
    });
    let screens = drawing.screens.iter().flat_map(ScreenShape::points);
    let lit = drawing.lit.iter().flat_map(|shape| shape.room.iter().flatten().copied());
    let all = screens.chain(lit).chain(lenses).chain([wall.eye]);
    let flat = all.map(|point| side.flat(point));
    let [low, high] = polygon::bounds(flat).unwrap_or([DVec2::ZERO; 2]);
    // A wall that is looked at along its plane has a thickness on paper too.
    let least = DVec2::splat((high - low).max_element().max(0.1) * 0.12);
    let missing = (least - (high - low)).max(DVec2::ZERO) / 2.0;
    [low - missing, high + missing]
}

/// Returns width and height of a view on paper, at so many pixels a metre.
pub(super) fn size(reach: [DVec2; 2], scale: f64) -> DVec2 {
    (reach[1] - reach[0]) * scale + MARGIN * 2.0
}

impl<'a, 'b> RoomView<'a, 'b> {
    /// Returns a view whose upper left is at a place of the paper.
    pub fn new(drawing: &'a Drawing<'b>, side: Side, at: DVec2, scale: f64) -> Self {
        let reach = reach(drawing, side);
        let origin = at + MARGIN - reach[0] * scale;
        Self { drawing, side, scale, origin, bounds: [at, at + size(reach, scale)] }
    }

    fn place(&self, point: DVec3) -> DVec2 {
        self.origin + self.side.flat(point) * self.scale
    }

    fn places(&self, points: &[DVec3]) -> Vec<DVec2> {
        points.iter().map(|point| self.place(*point)).collect()
    }

    /// Returns the rectangle in which things are, without title and foot.
    fn paper(&self) -> [DVec2; 2] {
        [self.bounds[0] + DVec2::Y * TITLE, self.bounds[1] - DVec2::Y * FOOT]
    }

    /// Returns the path of an outline that is closed.
    fn closed(&self, points: &[DVec3]) -> String {
        path(&simplified(&self.places(points), TOLERANCE_PX), true)
    }

    pub fn add_to(&self, svg: &mut String) {
        let (name, DVec2 { x, y }) = (self.side.name(), self.origin);
        add(
            svg,
            format_args!(
                "<g class=\"w-view\" data-view=\"{name}\" data-origin=\"{x:.3} {y:.3}\" \
                 data-scale=\"{}\">\n",
                self.scale
            ),
        );
        let [low, high] = self.bounds;
        add(
            svg,
            format_args!(
                "<text class=\"w-title\" x=\"{:.1}\" y=\"{:.1}\">{}</text>\n",
                low.x,
                low.y + 12.0,
                self.side.title()
            ),
        );
        let mut labels = Labels::default();
        self.add_grid(svg);
        self.add_no_heads(svg);
        self.add_screens(svg);
        self.add_frusta(svg);
        self.add_projectors(svg);
        self.add_channels(svg);
        self.add_eyes(svg, &mut labels);
        add_bar(svg, DVec2::new(low.x, high.y - 4.0), self.scale, 160.0);
        self.add_labels(svg, &mut labels);
        svg.push_str("</g>\n");
    }

    /// Adds lines at round metres of display space.
    fn add_grid(&self, svg: &mut String) {
        let step = round_below(GRID_PX * 2.5 / self.scale);
        let [low, high] = self.paper();
        let mut lines = String::new();
        for (axis, name) in self.side.axes().into_iter().enumerate() {
            let from = ((low[axis] - self.origin[axis]) / self.scale / step).ceil();
            let to = ((high[axis] - self.origin[axis]) / self.scale / step).floor();
            let sign = if self.side == Side::Right { -1.0 } else { 1.0 };
            let mut at = from;
            while at <= to {
                let place = self.origin[axis] + at * step * self.scale;
                // Adding 0 makes 0 of -0.
                let text = format!("{name} {}", length(at * step * sign + 0.0));
                let (line, x, y, class) = if axis == 0 {
                    let line = format!("M{place:.2} {:.2}V{:.2}", low.y, high.y);
                    (line, place, high.y + 9.0, "w-mark w-middle")
                } else {
                    let line = format!("M{:.2} {place:.2}H{:.2}", low.x, high.x);
                    (line, low.x + 2.0, place - 2.0, "w-mark")
                };
                lines.push_str(&line);
                // Not across the numbers of the other axis.
                if axis == 0 || place < high.y - 12.0 {
                    add(
                        svg,
                        format_args!(
                            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>\n"
                        ),
                    );
                }
                at += 1.0;
            }
        }
        add(svg, format_args!("<path class=\"w-grid\" d=\"{lines}\"/>\n"));
    }

    /// Adds the part of the paper at which a channel cannot be drawn for a head there.
    fn add_no_heads(&self, svg: &mut String) {
        let wall = self.drawing.of.wall;
        if head_fault(wall).is_some() {
            return;
        }
        let eyes: usize = wall.channels.iter().map(|channel| places_asked(wall, channel)).sum();
        let cells = (HEADS_MAX / eyes.max(1)).isqrt().clamp(16, 72);
        let ends = self.paper().map(|corner| (corner - self.origin) / self.scale);
        let is_refused = |at: DVec2| {
            let place = self.side.point(at, wall.eye);
            let head = HeadPose::facing_forward(place, wall.eye_separation_m);
            wall.check_head(&head).is_err()
        };
        let parts = contours(ends, cells, is_refused);
        let paper = |at: &DVec2| self.origin + *at * self.scale;
        let outline =
            |part: &Vec<DVec2>| simplified(&part.iter().map(paper).collect::<Vec<_>>(), 0.2);
        let data: String = parts.iter().map(|part| path(&outline(part), true)).collect();
        if !data.is_empty() {
            add(svg, format_args!("<path class=\"w-no-head\" d=\"{data}\"/>\n"));
        }
    }

    fn add_screens(&self, svg: &mut String) {
        for (screen, shape) in self.drawing.of.wall.screens.iter().zip(&self.drawing.screens) {
            let name = escaped(&screen.name);
            add(svg, format_args!("<g class=\"w-screen\" data-screen=\"{name}\">"));
            add(svg, format_args!("<title>screen {name}</title>"));
            let cells = shape.cells().map(|corners| {
                let mut corners = self.places(&corners);
                // All one way round, so that none takes another one away.
                if polygon::area(&corners) < 0.0 {
                    corners.reverse();
                }
                path(&corners, true)
            });
            add(svg, format_args!("<path class=\"w-area\" d=\"{}\"/>", cells.collect::<String>()));
            for (class, lines) in [("w-line", shape.lines()), ("w-edge", shape.edges())] {
                let lines: String =
                    lines.iter().map(|line| path(&self.places(line), false)).collect();
                if !lines.is_empty() {
                    add(svg, format_args!("<path class=\"{class}\" d=\"{lines}\"/>"));
                }
            }
            svg.push_str("</g>\n");
        }
    }

    /// Returns the outline around an eye and points that it sees; `None` if they lie all around it.
    fn frustum(&self, seen: impl Iterator<Item = DVec3>) -> Option<String> {
        let eye = self.place(self.drawing.of.wall.eye);
        let outline = hull(seen.map(|point| self.place(point)).chain([eye]));
        outline.contains(&eye).then(|| path(&simplified(&outline, TOLERANCE_PX), true))
    }

    fn add_frusta(&self, svg: &mut String) {
        for (screen, shape) in self.drawing.of.wall.screens.iter().zip(&self.drawing.screens) {
            if let Some(data) = self.frustum(shape.points()) {
                let name = escaped(&screen.name);
                add(
                    svg,
                    format_args!(
                        "<path class=\"w-sight\" d=\"{data}\"><title>from the eye to screen \
                         {name}</title></path>\n"
                    ),
                );
            }
        }
        if self.drawing.lit.len() > FRUSTA_MAX {
            return;
        }
        for shape in &self.drawing.lit {
            if let Some(data) = self.frustum(shape.room.iter().flatten().copied()) {
                add(svg, format_args!("<path class=\"w-sight w-of-channel\" d=\"{data}\"/>\n"));
            }
        }
    }

    /// Adds the light of projectors, with their lenses.
    fn add_projectors(&self, svg: &mut String) {
        for shape in &self.drawing.lit {
            let channel = &self.drawing.of.wall.channels[shape.channel];
            let ChannelKind::Projector(projector) = &channel.cover else { continue };
            let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
            let ray =
                |at: DVec2| projector.position + projector.direction(at).normalize() * DARK_RAY_M;
            let mut ends: Vec<DVec3> = shape.room.iter().flatten().copied().collect();
            if ends.is_empty() {
                ends.extend(corners.map(ray));
            }
            let lens = self.place(projector.position);
            let beam = hull(ends.iter().map(|end| self.place(*end)).chain([lens]));
            let (color, name) = (color_class(self.drawing, shape.channel), escaped(&channel.name));
            let data = path(&simplified(&beam, TOLERANCE_PX), true);
            let (x, y) = (lens.x, lens.y);
            add(
                svg,
                format_args!(
                    "<g class=\"w-beam {color}\" data-channel=\"{name}\"><title>projector of \
                     channel {name}</title><path d=\"{data}\"/><circle cx=\"{x:.2}\" \
                     cy=\"{y:.2}\" r=\"3.5\"/></g>\n"
                ),
            );
        }
    }

    /// Adds the light of channels, on their screens.
    fn add_channels(&self, svg: &mut String) {
        for shape in &self.drawing.lit {
            let parts: String = shape.room.iter().map(|part| self.closed(part)).collect();
            if parts.is_empty() {
                continue;
            }
            let edge =
                |line: &Vec<DVec3>| path(&simplified(&self.places(line), TOLERANCE_PX), false);
            let edges: String = shape.edges.iter().map(edge).collect();
            let channel = &self.drawing.of.wall.channels[shape.channel];
            let (color, name) = (color_class(self.drawing, shape.channel), escaped(&channel.name));
            add(
                svg,
                format_args!(
                    "<g class=\"w-lit {color}\" data-channel=\"{name}\"><title>channel {name}\
                     </title><path class=\"w-fill\" d=\"{parts}\"/>"
                ),
            );
            if !edges.is_empty() {
                add(svg, format_args!("<path class=\"w-border\" d=\"{edges}\"/>"));
            }
            svg.push_str("</g>\n");
        }
    }

    fn add_eyes(&self, svg: &mut String, labels: &mut Labels) {
        let wall = self.drawing.of.wall;
        let head = wall.head();
        let is_for_one = wall.channels.iter().any(|channel| *channel.eyes() != [Eye::Center]);
        let eyes = if is_for_one { &[Eye::Left, Eye::Right][..] } else { &[] };
        let middle = self.place(wall.eye);
        let (x, y) = (middle.x, middle.y);
        let ahead = self.place(wall.eye + DVec3::NEG_Z * (16.0 / self.scale));
        add(
            svg,
            format_args!(
                "<g class=\"w-eye\"><title>eye at {}</title><path d=\"{}\"/><circle \
                 cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"4.5\"/>",
                wall.eye,
                path(&[middle, ahead], false)
            ),
        );
        for eye in eyes {
            let at = self.place(head.eye(*eye));
            add(svg, format_args!("<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"1.5\"/>", at.x, at.y));
        }
        svg.push_str("</g>\n");
        labels.take(middle - 7.0, middle + 7.0);
        let label = Label::new(["eye".to_owned()], 11.0);
        let offsets = [[18.0, 8.0], [-18.0, 8.0], [0.0, 16.0], [0.0, -24.0]].map(DVec2::from);
        if let Some(at) = labels.place(&label, self.paper(), offsets.map(|by| middle + by)) {
            label.add_to(svg, at);
        }
    }

    fn add_labels(&self, svg: &mut String, labels: &mut Labels) {
        let wall = self.drawing.of.wall;
        let eye = self.place(wall.eye);
        let rows = &self.drawing.report.screens;
        for (row, shape) in rows.iter().zip(&self.drawing.screens) {
            let Some(middle) = shape.middle().map(|point| self.place(point)) else { continue };
            let size = row.size_m.map(scale::extent);
            let distance = row.eye_distance_m.map(|metres| format!("eye {metres:.2} m"));
            let lines = std::iter::once(row.name.clone()).chain(size).chain(distance);
            self.add_label(svg, labels, &Label::new(lines, 11.0), middle, middle - eye);
        }
        for channel in &wall.channels {
            if let ChannelKind::Projector(projector) = &channel.cover {
                let label = Label::new([channel.name.clone()], 10.0);
                let lens = self.place(projector.position);
                self.add_label(svg, labels, &label, lens, lens - eye);
            }
        }
    }

    /// Adds a label beside a place, outwards if there is room.
    fn add_label(
        &self,
        svg: &mut String,
        labels: &mut Labels,
        label: &Label,
        at: DVec2,
        outwards: DVec2,
    ) {
        let outwards = outwards.try_normalize().unwrap_or(DVec2::NEG_Y);
        let half = label.extent() / 2.0;
        let beside = |turn: DVec2, gap: f64| {
            let way = turn.rotate(outwards);
            let reach = (half.x * way.x.abs() + half.y * way.y.abs()) + gap;
            at + way * reach
        };
        let turns = [[1.0, 0.0], [-1.0, 0.0], [0.7, 0.7], [0.7, -0.7], [0.0, 1.0], [0.0, -1.0]];
        let middles = [7.0, 22.0, 40.0]
            .into_iter()
            .flat_map(|gap| turns.map(|turn| beside(DVec2::from(turn), gap)));
        if let Some(at) = labels.place(label, self.paper(), middles) {
            label.add_to(svg, at);
        }
    }
}

/// Returns the number of places of the eyes of a channel that a check looks at.
fn places_asked(wall: &Wall, channel: &polyptych_wall::Channel) -> usize {
    wall.viewpoints(channel).iter().map(|viewpoint| viewpoint.places().len()).sum()
}

/// Returns the reason why the head cannot move at all; `None` if it can.
pub(super) fn head_fault(wall: &Wall) -> Option<String> {
    let beside = wall.eye + DVec3::X * 1e-6;
    let moved = HeadPose::facing_forward(beside, wall.eye_separation_m);
    match wall.check_head(&moved) {
        Err(error @ HeadError::OneEye { .. }) => Some(error.to_string()),
        _ => None,
    }
}
