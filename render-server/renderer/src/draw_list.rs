//! What is drawn and in which order: a function of the scene and the eye, never of the channel.
//!
//! What a channel does not see is left out, but never reorders what stays. So where two surfaces
//! have one depth, the same one wins in every channel.

use std::borrow::Cow;
use std::collections::BTreeSet;

use glam::{DAffine3, DMat4, DVec3};

use super::cull::FrustumPlanes;
use super::pipeline::{Cull, InstanceRecord};
use super::scene::{
    Billboard, Bounds, DrawItem, EyeRelativeTransform, GpuScene, Meshlet, Selection, Stance,
    relative_to,
};
use super::view::ViewDesc;

/// Beyond so many visible items it costs more to find what of the target they touch than it
/// saves.
const TOUCH_ITEMS_MAX: usize = 2048;
/// Pixels by which the touched rectangle is wider, for lines, points and rounding.
const TOUCH_MARGIN: f64 = 2.0;

/// One draw call: items of one batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Draw {
    pub batch: u32,
    /// An index into the scene's pipeline keys.
    pub pipeline: u32,
    /// Into the instance records of the frame.
    pub first: u32,
    pub count: u32,
    /// A part of the geometry's indices; `None`: all of them.
    pub part: Option<[u32; 2]>,
}

/// What one view draws.
#[derive(Clone, Debug, Default)]
pub(crate) struct DrawList {
    /// Pixels of the target that the view may touch: x, y, width, height.
    pub rectangle: [u32; 4],
    /// Near to far, by batch.
    pub opaque: Vec<Draw>,
    /// Far to near, by item.
    pub transparent: Vec<Draw>,
    /// Within the rectangle, whichever way they face.
    pub triangles: u64,
    pub visible: u32,
    /// Pixels that visible items may touch; `None` where there are none.
    pub touched: Option<[u32; 4]>,
}

/// Room that is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    visible: Vec<u32>,
    /// Rank of the batch, bits of the distance, item.
    opaque: Vec<(u32, u64, u32)>,
    blended: Vec<(u64, u32)>,
    ranks: Vec<u32>,
}

impl DrawList {
    /// Culls and sorts; appends the instance records.
    pub fn new(
        scene: &GpuScene,
        view: &ViewDesc,
        rectangle: [u32; 4],
        scratch: &mut Scratch,
        instances: &mut Vec<InstanceRecord>,
    ) -> Self {
        scratch.visible.clear();
        let planes = view.planes(rectangle);
        scene.visible(&planes, &mut scratch.visible);
        let part = scene.layout.tree.select(&view.subset);
        if !part.is_whole() {
            let layout = &scene.layout;
            scratch.visible.retain(|&index| {
                let item = &layout.items[index as usize];
                part.has_place(item.place)
                    && part.has_layer(layout.batches[item.batch as usize].layer)
            });
        }
        let mut list = Self {
            rectangle,
            visible: scratch.visible.len() as u32,
            touched: touched(scene, view, rectangle, &scratch.visible),
            ..Self::default()
        };
        sort(scene, view, part, scratch);
        let turns = Billboard::turns(&scene.layout.billboards, view);
        let seen_from =
            SeenFrom { eye: view.eye_in_world, clip_from_eye: view.scaled_clip_from_eye(), turns };
        for &(_, _, index) in &scratch.opaque {
            let batch = scene.layout.items[index as usize].batch;
            let pipeline = scene.layout.batches[batch as usize].pipeline;
            let first = push(scene, index, &seen_from, instances);
            let whole = Draw { batch, pipeline, first, count: 1, part: None };
            if scene.clusters_of(batch).is_empty() {
                list.triangles += scene.layout.batches[batch as usize].triangles;
                extend(&mut list.opaque, whole);
            } else {
                list.triangles +=
                    draw_parts(scene, (index, &seen_from), &planes, whole, &mut list.opaque);
            }
        }
        for &(_, index) in &scratch.blended {
            let batch_index = scene.layout.items[index as usize].batch;
            let batch = &scene.layout.batches[batch_index as usize];
            let first = push(scene, index, &seen_from, instances);
            let draw =
                Draw { batch: batch_index, pipeline: batch.pipeline, first, count: 1, part: None };
            if let Some(pipeline) = batch.back_pipeline {
                list.triangles += batch.triangles;
                list.transparent.push(Draw { pipeline, ..draw });
                list.transparent.push(draw);
            } else if scene.clusters_of(batch_index).is_empty() {
                list.triangles += batch.triangles;
                extend(&mut list.transparent, draw);
            } else {
                list.triangles +=
                    draw_parts(scene, (index, &seen_from), &planes, draw, &mut list.transparent);
            }
        }
        list
    }
}

/// One draw of each pipeline with each material: all that a driver may have to compile.
pub(crate) fn samples_of(scene: &GpuScene) -> Vec<Draw> {
    let mut known = BTreeSet::new();
    let mut draws = Vec::new();
    for (batch, b) in (0u32..).zip(&scene.layout.batches) {
        for pipeline in [b.back_pipeline, Some(b.pipeline)].into_iter().flatten() {
            if known.insert((pipeline, b.material)) {
                draws.push(Draw { batch, pipeline, first: 0, count: 1, part: None });
            }
        }
    }
    draws
}

/// Lengthens the last draw by an item that follows it, or begins another.
fn extend(draws: &mut Vec<Draw>, draw: Draw) {
    match draws.last_mut() {
        Some(last)
            if last.batch == draw.batch
                && last.pipeline == draw.pipeline
                && last.part.is_none()
                && last.first + last.count == draw.first =>
        {
            last.count += 1;
        }
        _ => draws.push(draw),
    }
}

/// From where, or along what, an item is seen, in its own space.
#[derive(Clone, Copy, Debug)]
enum CullView {
    From(DVec3),
    Along(DVec3),
}

impl CullView {
    /// Whether only backs of the cluster are seen.
    fn misses(self, cluster: &Meshlet) -> bool {
        match self {
            Self::From(eye) => eye.is_finite() && cluster.faces_away_from(eye),
            Self::Along(rays) => rays.is_finite() && cluster.faces_along(rays),
        }
    }
}

/// Draws the clusters of an item that the rectangle may show and that may face the eye, joined
/// where they follow each other. Gives the triangles within the rectangle.
fn draw_parts(
    scene: &GpuScene,
    (index, seen_from): (u32, &SeenFrom),
    planes: &FrustumPlanes,
    whole: Draw,
    draws: &mut Vec<Draw>,
) -> u64 {
    let (_, stance, origin) = seen_from.place(scene, index);
    let linear = stance.linear;
    let local = planes.in_space_of(&linear, origin);
    let culls_back = scene.layout.keys[whole.pipeline as usize].cull == Cull::Back;
    // A flat item has no side that an eye could be on.
    let is_solid = linear.determinant().abs() > f64::MIN_POSITIVE;
    let sight = (culls_back && is_solid).then(|| match planes.view_direction() {
        Some(rays) => CullView::Along((linear.inverse() * rays).normalize_or_zero()),
        None => CullView::From(linear.inverse() * (planes.eye() - origin)),
    });
    let mut triangles = 0;
    let mut part: Option<[u32; 2]> = None;
    for cluster in scene.clusters_of(whole.batch) {
        if local.test(cluster.center, cluster.half, FrustumPlanes::ALL).is_none() {
            continue;
        }
        triangles += u64::from(cluster.index_count / 3);
        if sight.is_some_and(|sight| sight.misses(cluster)) {
            continue;
        }
        match &mut part {
            Some([first, count]) if *first + *count == cluster.first_index => {
                *count += cluster.index_count;
            }
            _ => {
                draws.extend(part.map(|part| Draw { part: Some(part), ..whole }));
                part = Some([cluster.first_index, cluster.index_count]);
            }
        }
    }
    draws.extend(part.map(|part| Draw { part: Some(part), ..whole }));
    triangles
}

/// The viewpoint that records are relative to.
#[derive(Debug)]
struct SeenFrom {
    eye: DVec3,
    clip_from_eye: DMat4,
    /// The turn of each billboard of the scene, in world space.
    turns: Vec<DAffine3>,
}

impl SeenFrom {
    /// An item, how it stands, and its origin, in world space.
    fn place<'a>(&self, scene: &'a GpuScene, index: u32) -> (&'a DrawItem, Cow<'a, Stance>, DVec3) {
        let (item, stance, _) = scene.item(index);
        let turn = stance.billboard.and_then(|billboard| self.turns.get(billboard as usize));
        match turn {
            None => (item, Cow::Borrowed(stance), item.origin),
            Some(turn) => {
                let (stance, origin) = stance.turned(item.origin, turn);
                (item, Cow::Owned(stance), origin)
            }
        }
    }
}

/// Writes an item's record, relative to the eye; returns its index.
fn push(
    scene: &GpuScene,
    index: u32,
    seen_from: &SeenFrom,
    instances: &mut Vec<InstanceRecord>,
) -> u32 {
    let (item, stance, origin) = seen_from.place(scene, index);
    let SeenFrom { eye, clip_from_eye, .. } = seen_from;
    let mesh_box = &scene.layout.mesh_boxes[item.mesh_box as usize];
    let EyeRelativeTransform { near, rows, offset } =
        relative_to(origin, stance.linear, *eye, mesh_box);
    instances.push(InstanceRecord {
        rows,
        normal_rows: stance.normal_rows,
        lamps: item.lamps,
        near,
        clip_offset: (*clip_from_eye * offset.extend(1.0)).as_vec4().to_array(),
    });
    instances.len() as u32 - 1
}

/// Opaque: by batch, nearest batch first, and within it the nearest item first. Blended: the
/// farthest item first. Ties go by index, that is by node, instance, primitive.
///
/// Batches are as near as those of their items that the view shows: what it does not show must not
/// decide which of two surfaces of one depth wins.
fn sort(scene: &GpuScene, view: &ViewDesc, part: Selection, scratch: &mut Scratch) {
    let own = (!part.has_all_places()).then(|| scene.batch_bounds_of(part));
    let mut batches: Vec<(f64, u32)> = (0u32..)
        .zip(&scene.layout.batches)
        .map(|(index, _)| {
            let bounds =
                own.as_ref().map_or_else(|| scene.batch_bounds(index), |own| own[index as usize]);
            let is_empty = bounds == Bounds::EMPTY;
            (if is_empty { f64::INFINITY } else { view.sort_depth(&bounds, true) }, index)
        })
        .collect();
    batches.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    scratch.ranks.clear();
    scratch.ranks.resize(batches.len(), 0);
    for (rank, (_, batch)) in (0u32..).zip(batches) {
        scratch.ranks[batch as usize] = rank;
    }
    scratch.opaque.clear();
    scratch.blended.clear();
    for &index in &scratch.visible {
        let (item, _, bounds) = scene.item(index);
        let distance = view.sort_depth(bounds, false);
        if scene.layout.batches[item.batch as usize].blended {
            scratch.blended.push((!rising(distance), index));
        } else {
            let near = rising(f64::from(distance as f32));
            scratch.opaque.push((scratch.ranks[item.batch as usize], near, index));
        }
    }
    scratch.opaque.sort_unstable();
    scratch.blended.sort_unstable();
}

/// Bits in the order of the numbers: those of negative ones turned around, below all others. A
/// box without bounds counts as farthest.
fn rising(number: f64) -> u64 {
    let number = if number.is_nan() { f64::INFINITY } else { number };
    let bits = number.to_bits();
    if number.is_sign_negative() { !bits } else { bits | 1 << 63 }
}

/// The rectangle around the corners of all visible boxes, or all that the view may touch where
/// a box reaches behind the near plane.
fn touched(
    scene: &GpuScene,
    view: &ViewDesc,
    rectangle: [u32; 4],
    visible: &[u32],
) -> Option<[u32; 4]> {
    if visible.is_empty() {
        return None;
    }
    if visible.len() > TOUCH_ITEMS_MAX {
        return Some(rectangle);
    }
    let clip_from_eye = view.clip_from_eye();
    let mut span = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for &index in visible {
        if !widen(&mut span, view, &clip_from_eye, scene.item(index).2) {
            return Some(rectangle);
        }
    }
    let [x, y, width, height] = rectangle;
    let clamp = |pixel: f64, from: u32, length: u32| {
        pixel.clamp(f64::from(from), f64::from(from + length)) as u32
    };
    let (x0, y0) = (
        clamp((span[0] - TOUCH_MARGIN).floor(), x, width),
        clamp((span[1] - TOUCH_MARGIN).floor(), y, height),
    );
    let (x1, y1) = (
        clamp((span[2] + TOUCH_MARGIN).ceil(), x, width),
        clamp((span[3] + TOUCH_MARGIN).ceil(), y, height),
    );
    (x0 < x1 && y0 < y1).then(|| [x0, y0, x1 - x0, y1 - y0])
}

/// Widens a span of pixels to hold a box; false where a corner cannot be projected.
fn widen(span: &mut [f64; 4], view: &ViewDesc, clip_from_eye: &DMat4, bounds: &Bounds) -> bool {
    (0..8).all(|corner| {
        let pick = |bit: usize, axis: usize| {
            if corner >> bit & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] }
        };
        let point = DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2));
        let Some([x, y]) = view.project(clip_from_eye, point) else { return false };
        *span = [span[0].min(x), span[1].min(y), span[2].max(x), span[3].max(y)];
        x.is_finite() && y.is_finite()
    })
}
