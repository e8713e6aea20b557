//! The light of a channel, as outlines on its canvas and in the room.

use glam::{DVec2, DVec3};
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::wall_geometry::{ResolvedWall, ScreenGeometry};
use polyptych_wall::{Channel, ChannelKind, Screen};
use polyptych_wall_file::coverage::Footprint;

use super::contour::contours;
use super::polygon;

/// Places along each side of a channel's picture.
const SIDE_STEPS: usize = 16;

/// Maximum part of a canvas between two neighbouring places of an outline: more, and it goes on at
/// the other side of the canvas.
const JUMP_MAX: f64 = 0.25;

/// Minimum number of points of a line from one side of a canvas to the other.
const STEPS_MIN: f64 = 64.0;

/// Maximum number of places that searches of outlines look at together: half a second of work.
const PLACES_MAX: usize = 1 << 18;

/// Minimum and maximum number of cells along a side of such a search.
const CELLS: (usize, usize) = (16, 160);

/// The light of a channel.
#[derive(Clone, Debug)]
pub(super) struct LitShape {
    /// An index into the wall's channels.
    pub channel: usize,
    /// Outlines in pixels of the canvas, holes among them.
    pub canvas: Vec<Vec<DVec2>>,
    /// The outlines of `canvas` in metres of display space.
    pub room: Vec<Vec<DVec3>>,
    /// The lines of the outlines, without those at which a closed surface was cut to be a canvas.
    pub edges: Vec<Vec<DVec3>>,
}

/// Returns the shapes of all channels, in their order; empty ones if their files were not read.
pub(super) fn lit_shapes(of: ResolvedWall<'_>) -> Vec<LitShape> {
    let count = of.wall.channels.len();
    let (low, high) = CELLS;
    let cells = (PLACES_MAX / count.max(1)).isqrt().clamp(low, high);
    (0..count).map(|channel| LitShape::new(of, channel, cells)).collect()
}

impl LitShape {
    fn new(of: ResolvedWall<'_>, index: usize, cells: usize) -> Self {
        let channel = &of.wall.channels[index];
        let screen = of.wall.screen_of(channel);
        let footprint = Footprint::shaped(channel, screen, of.shapes);
        let nothing =
            Self { channel: index, canvas: Vec::new(), room: Vec::new(), edges: Vec::new() };
        let Some(map) = footprint.map().filter(|_| footprint.is_known()) else { return nothing };
        let ground = of.shapes.screen(screen);
        // What a mesh hides of a projector's light has no outline of its own.
        let is_hidden = ground.is_mesh() && matches!(channel.cover, ChannelKind::Projector(_));
        let whole = [DVec2::ZERO, screen.canvas.as_dvec2()];
        let mut canvas = None;
        if !is_hidden && let Some((outline, room)) = outline(channel, screen, map) {
            let part = polygon::clipped(&outline, whole);
            if part.len() == outline.len() && room.len() == outline.len() {
                let edges = vec![room.iter().chain(room.first()).copied().collect()];
                return Self { canvas: vec![outline], room: vec![room], edges, ..nothing };
            }
            canvas = Some(vec![divided(&part, whole[1] / STEPS_MIN)]);
        }
        let search = || contours(reach(channel, screen, map), cells, |at| footprint.covers(at));
        let canvas = canvas.unwrap_or_else(search);
        let point = |outline: &Vec<DVec2>| {
            outline.iter().filter_map(|at| ground.display_from_canvas(*at)).collect()
        };
        let room = canvas.iter().map(point).collect();
        let edges = canvas.iter().flat_map(|outline| edges(outline, ground)).collect();
        Self { canvas, room, edges, ..nothing }
    }
}

/// Returns the outline of the whole picture, if all of it lies on the canvas in one piece.
fn outline(
    channel: &Channel,
    screen: &Screen,
    map: &ChannelMapping<'_>,
) -> Option<(Vec<DVec2>, Vec<DVec3>)> {
    let size = channel.size.as_dvec2();
    let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|at| at * size);
    let steps = (0..4 * SIDE_STEPS).map(|step| {
        let (from, to) = (corners[step / SIDE_STEPS], corners[(step / SIDE_STEPS + 1) % 4]);
        from.lerp(to, (step % SIDE_STEPS) as f64 / SIDE_STEPS as f64)
    });
    let canvas: Vec<DVec2> =
        steps.clone().map(|at| map.canvas_from_pixel(at)).collect::<Option<_>>()?;
    let jump_max = screen.canvas.as_dvec2() * JUMP_MAX;
    let is_jump = |(a, b): (&DVec2, &DVec2)| (*a - *b).abs().cmpgt(jump_max).any();
    let is_torn = canvas.iter().zip(canvas.iter().skip(1).chain(&canvas[..1])).any(is_jump);
    // Around a pole, the outline is a line across the canvas, and its middle lies elsewhere.
    let middle = map.canvas_from_pixel(size / 2.0)?;
    if !canvas.iter().all(|at| at.is_finite()) || is_torn || !polygon::is_within([&canvas], middle)
    {
        return None;
    }
    let room = steps.filter_map(|at| map.display_from_pixel(at)).collect();
    Some((canvas, room))
}

/// Returns an outline with more points, so that none of its lines is longer than `step` along an
/// axis: a line on the canvas may be curved in the room.
fn divided(outline: &[DVec2], step: DVec2) -> Vec<DVec2> {
    let sides = outline.iter().zip(outline.iter().skip(1).chain(outline.first()));
    let parts = sides.flat_map(|(a, b)| {
        let count = ((*b - *a).abs() / step).max_element().ceil().clamp(1.0, 2.0 * STEPS_MIN);
        (0..count as u32).map(move |part| a.lerp(*b, f64::from(part) / count))
    });
    parts.collect()
}

/// Returns an outline in pieces, without the parts along a side of the canvas at which its surface
/// closes: there the light goes on at the other side.
fn edges(outline: &[DVec2], ground: ScreenGeometry<'_>) -> Vec<Vec<DVec3>> {
    let width = f64::from(ground.screen.canvas.x);
    let point = |at: DVec2| ground.display_from_canvas(at);
    let is_at = |at: DVec2| at.x < 1e-6 * width || at.x > width * (1.0 - 1e-6);
    let is_closed = |y: f64| {
        let ends = point(DVec2::new(0.0, y)).zip(point(DVec2::new(width, y)));
        ends.is_some_and(|(a, b)| a.distance(b) < 1e-6 * (1.0 + a.length()))
    };
    let mut pieces: Vec<Vec<DVec3>> = vec![Vec::new()];
    for (a, b) in outline.iter().zip(outline.iter().skip(1).chain(outline.first())) {
        let is_seam = is_at(*a) && is_at(*b) && is_closed(f64::midpoint(a.y, b.y));
        match (point(*a), point(*b), pieces.last_mut()) {
            (Some(a), Some(b), Some(piece)) if !is_seam => {
                if piece.is_empty() {
                    piece.push(a);
                }
                piece.push(b);
            }
            _ => pieces.push(Vec::new()),
        }
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// Returns a rectangle of the canvas that holds all the light of the channel.
fn reach(channel: &Channel, screen: &Screen, map: &ChannelMapping<'_>) -> [DVec2; 2] {
    let whole = [DVec2::ZERO, screen.canvas.as_dvec2()];
    let part = |step: usize| step as f64 / SIDE_STEPS as f64;
    let size = channel.size.as_dvec2();
    let places = (0..=SIDE_STEPS)
        .flat_map(|y| (0..=SIDE_STEPS).map(move |x| DVec2::new(part(x), part(y)) * size));
    let found: Option<Vec<DVec2>> = places.map(|at| map.canvas_from_pixel(at)).collect();
    let Some([low, high]) = found.and_then(polygon::bounds) else { return whole };
    let margin = (high - low) / 8.0;
    if (high - low).cmpgt(whole[1] / 2.0).any() {
        return whole;
    }
    [(low - margin).max(whole[0]), (high + margin).min(whole[1])]
}
