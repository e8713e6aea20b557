//! The draws of a view and their order: a function of the scene and the eye, never of the channel.
//!
//! Culling for a channel leaves draws out, but never reorders the others. So if two surfaces have
//! one depth, the same one wins in every channel.

use std::collections::BTreeSet;

use glam::{DAffine3, DMat4, DVec3};
use rayon::prelude::*;

use super::cull::FrustumPlanes;
use super::error_tolerance::ErrorTolerance;
use super::item_draws::{self, ItemDraws};
use super::lamp_map::LampMap;
use super::many_items;
use super::pass::shadow::casts_shadows;
use super::pipeline::InstanceRecord;
use super::scene::{Billboard, Bounds, DrawItem, GpuScene, Stance};
use super::seen_from::SeenFrom;
use super::view::ViewDesc;

/// Beyond so many visible items it costs more to find what of the target they touch than it
/// saves.
const TOUCH_ITEMS_MAX: usize = 2048;
/// Pixels by which the touched rectangle is wider, for lines, points and rounding.
const TOUCH_MARGIN: f64 = 2.0;

/// So many batches are drawn nearest first; more of them by shells of distances.
const NEAR_FIRST_BATCHES_MAX: usize = 256;
/// Low bits of a square of a distance that do not count: a shell is twice as far as the one before.
const SHELL_BITS: u32 = f64::MANTISSA_DIGITS;

/// One draw call: items of one batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Draw {
    pub batch: u32,
    /// An index into the scene's pipeline keys.
    pub pipeline: u32,
    /// Into the instance records of the frame.
    pub first: u32,
    pub count: u32,
    /// The first of the geometry's indices, and their number.
    pub indices: [u32; 2],
    /// The indices are those of the frame, in the order of distances.
    pub ordered: bool,
}

/// The draws of one view.
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
    /// See [`DrawStats::error_share`](crate::DrawStats::error_share).
    pub error_share: f32,
    /// Pixels that visible items may touch; `None` where there are none.
    pub touched: Option<[u32; 4]>,
}

/// Room that is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Rank of the batch, bits of the distance, item, batch.
    opaque: Vec<(u32, u64, u32, u32)>,
    /// Bits of the distance, item, batch.
    blended: Vec<(u64, u32, u32)>,
    ranks: Vec<u32>,
    /// Indices of all triangles of a frame that are drawn in the order of their distances.
    pub ordered_indices: Vec<u32>,
}

/// The items of which a map of shadows has some.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ShadowItems {
    /// Those that look the same in each frame.
    Still,
    /// All others; see [`GpuScene::is_moving`].
    Moving,
}

/// The items that a view may show.
#[derive(Debug)]
pub(crate) struct VisibleItems {
    /// Pixels of the target that the view may touch: x, y, width, height.
    pub rectangle: [u32; 4],
    pub items: Vec<u32>,
    planes: FrustumPlanes,
    tolerance: ErrorTolerance,
    /// The turn of each billboard of the scene, in world space.
    turns: Vec<DAffine3>,
    /// Triangles hide what is behind them whichever way they face.
    both_sides: bool,
    /// The largest size of what was left out as too small, as a share of what is allowed.
    error_share: f32,
}

impl VisibleItems {
    /// Finds the items of the part of the scene that a view shows, within a rectangle of the
    /// target; rising.
    pub fn new(scene: &GpuScene, view: &ViewDesc, rectangle: [u32; 4]) -> Self {
        let turns = Billboard::turns(scene.billboards(), view);
        let mut found = Self::found(scene, view, rectangle, (ErrorTolerance::new(view), turns));
        // What is known of items is read in the order in which it lies in memory.
        found.items.par_sort_unstable();
        found.error_share = leave_out_small(scene, &found.tolerance, &mut found.items);
        found
    }

    /// Finds those of these items of which a map has what casts shadows, in its view; levels of
    /// detail and the turns of billboards are those of the camera that sees the shadows. Returns
    /// also whether any of these items, casting or not, receives shadows from the map.
    /// `receivers`: a sphere around all places that the map is for, in world space.
    pub fn casting(
        scene: &GpuScene,
        (light, of): (&ViewDesc, ShadowItems),
        (tolerance, turns): (ErrorTolerance, Vec<DAffine3>),
        (center, radius): (DVec3, f64),
    ) -> (Self, bool) {
        let [_, _, width, height] = light.viewport.map(|number| number as u32);
        let planes = light.planes([0, 0, width, height]);
        let mut items = Vec::new();
        match of {
            ShadowItems::Still => {
                scene.visible(&planes, &mut items);
                if scene.has_moving() {
                    items.retain(|item| !scene.is_moving(*item));
                }
            }
            ShadowItems::Moving => scene.visible_moving(&planes, &mut items),
        }
        let mut found = Self::of_part(scene, light, (planes, items), (tolerance, turns));
        found.both_sides = true;
        let reach = radius * radius;
        let receives = found.items.iter().any(|item| {
            // Written so that a box that is not finite receives.
            let is_beyond = scene.item(*item).2.distance_squared(center) > reach;
            !is_beyond
        });
        found.items.retain(|&item| {
            let batch = scene.batch_of(item);
            !batch.is_sky && casts_shadows(&scene.layout.keys[batch.pipeline as usize])
        });
        leave_out_small(scene, &found.tolerance, &mut found.items);
        (found, receives)
    }

    /// Removes the items that cast no shadow of a lamp with this reach, in world space: those that
    /// are beyond it, and those that glow around it and are small, such as its bulb or the glass of
    /// its lantern. What has a place that glows and is larger, such as a room, casts shadows.
    pub fn keep_casting(&mut self, scene: &GpuScene, map: &LampMap) {
        let (lamp, radius) = map.reached();
        let (reach, lantern) = (radius * radius, map.lantern_radius());
        self.items.retain(|&item| {
            let around = scene.item(item).2;
            let distance = around.distance_squared(lamp);
            let key = &scene.layout.keys[scene.batch_of(item).pipeline as usize];
            // Written so that a box that is not finite stays.
            let is_beyond = distance > reach;
            let is_small = around.half().length() <= lantern;
            let is_of_lamp = distance == 0.0 && key.material.glowing && is_small;
            !is_beyond && !is_of_lamp
        });
    }

    fn found(
        scene: &GpuScene,
        view: &ViewDesc,
        rectangle: [u32; 4],
        of_camera: (ErrorTolerance, Vec<DAffine3>),
    ) -> Self {
        let planes = view.planes(rectangle);
        let mut items = Vec::new();
        scene.visible(&planes, &mut items);
        Self { rectangle, ..Self::of_part(scene, view, (planes, items), of_camera) }
    }

    /// Those of the items within these planes that are in the part of the scene that a view shows.
    fn of_part(
        scene: &GpuScene,
        view: &ViewDesc,
        (planes, mut items): (FrustumPlanes, Vec<u32>),
        (tolerance, turns): (ErrorTolerance, Vec<DAffine3>),
    ) -> Self {
        let [_, _, width, height] = view.viewport.map(|number| number as u32);
        let part = scene.layout.tree.select(&view.subset);
        if !part.is_whole() {
            let layout = &scene.layout;
            items.retain(|&index| {
                let item = &layout.items[index as usize];
                part.has_place(item.place)
                    && part.has_layer(layout.batches[item.batch as usize].layer)
            });
        }
        let (both_sides, error_share) = (false, 0.0);
        let rectangle = [0, 0, width, height];
        Self { rectangle, items, planes, tolerance, turns, both_sides, error_share }
    }
}

impl DrawList {
    /// Sorts some of the items that a view shows; appends their instance records.
    pub fn new(
        scene: &GpuScene,
        view: &ViewDesc,
        (of, items): (&VisibleItems, &[u32]),
        scratch: &mut Scratch,
        instances: &mut Vec<InstanceRecord>,
    ) -> Self {
        let VisibleItems { rectangle, planes, tolerance, turns, both_sides, error_share, .. } = of;
        let mut list = Self {
            rectangle: *rectangle,
            visible: items.len() as u32,
            touched: touched(scene, view, *rectangle, items),
            error_share: *error_share,
            ..Self::default()
        };
        sort(scene, view, items, scratch);
        let clip_from_eye = view.scaled_clip_from_eye();
        let seen_from = SeenFrom { scene, eye: view.eye_in_world, clip_from_eye, turns };
        let (tolerance, both_sides) = (*tolerance, *both_sides);
        let item_draws = ItemDraws { view, seen_from, planes, tolerance, both_sides };
        let Scratch { opaque, blended, ordered_indices, .. } = scratch;
        let opaque: Vec<_> = opaque.iter().map(|&(_, _, item, batch)| (item, batch)).collect();
        let blended: Vec<_> = blended.iter().map(|&(_, item, batch)| (item, batch)).collect();
        list.opaque = list.add(&item_draws, &opaque, (instances, ordered_indices));
        list.transparent = list.add(&item_draws, &blended, (instances, ordered_indices));
        list
    }

    /// Appends the records of items, given with their batches, and the indices of what of them is
    /// drawn in the order of distances. Returns their draws.
    fn add(
        &mut self,
        item_draws: &ItemDraws<'_>,
        items: &[(u32, u32)],
        (instances, indices): (&mut Vec<InstanceRecord>, &mut Vec<u32>),
    ) -> Vec<Draw> {
        let first = instances.len();
        let record = |&(item, _): &(u32, u32)| item_draws.seen_from.record(item);
        if many_items::are_many(items) {
            instances.par_extend(items.par_iter().map(record));
        } else {
            instances.extend(items.iter().map(record));
        }
        let mut draws = Vec::new();
        for part in many_items::parts(items, |at, some| item_draws.of(some, (first + at) as u32)) {
            let before = indices.len() as u32;
            for mut draw in part.draws {
                draw.indices[0] += if draw.ordered { before } else { 0 };
                item_draws::extend(&mut draws, draw);
            }
            indices.extend(part.ordered_indices);
            self.triangles += part.triangles;
            self.error_share = self.error_share.max(part.error_share as f32);
        }
        draws
    }
}

/// One draw of each pipeline with each material: all that a driver may have to compile.
pub(crate) fn samples_of(scene: &GpuScene, of: u32) -> Vec<Draw> {
    let mut known = BTreeSet::new();
    let mut draws = Vec::new();
    for (batch, b) in (0u32..).zip(&scene.layout.batches) {
        let pipelines = [b.back_pipeline, Some(b.pipeline), b.ordered_pipeline];
        for pipeline in pipelines.into_iter().flatten().filter(|pipeline| *pipeline == of) {
            if known.insert((pipeline, b.material)) {
                let indices = [0, scene.geometry_of(batch).index_count];
                let first_draw =
                    Draw { batch, pipeline, first: 0, count: 1, indices, ordered: false };
                draws.push(first_draw);
            }
        }
    }
    draws
}

/// Removes the items whose meshes are too small for the allowed error, and returns the largest of
/// their sizes as a share of it. Lines and points stay: they are one pixel wide at any distance.
fn leave_out_small(scene: &GpuScene, tolerance: &ErrorTolerance, visible: &mut Vec<u32>) -> f32 {
    if tolerance.is_zero() {
        return 0.0;
    }
    let share_of = |index: u32| {
        let (item, stance, bounds) = scene.item(index);
        if scene.layout.batches[item.batch as usize].triangles == 0 {
            return None;
        }
        let own = (bounds.center(), bounds.half().length());
        let share = tolerance.share_if_small(own)?;
        if stance.billboard.is_some() {
            return Some(share);
        }
        tolerance.share_if_small(sphere_of_crowd(scene, item, stance))
    };
    let shares = many_items::find(visible, |item| Some(share_of(item)));
    let mut of_each = shares.iter();
    visible.retain(|_| of_each.next().is_none_or(Option::is_none));
    shares.into_iter().flatten().fold(0.0, f64::max) as f32
}

/// A sphere around all parts of an item's mesh in its place, and around what is beside it: many
/// small parts may make up a surface that is not small.
fn sphere_of_crowd(scene: &GpuScene, item: &DrawItem, stance: &Stance) -> (DVec3, f64) {
    let mesh_box = &scene.layout.mesh_boxes[item.mesh_box as usize];
    let center = item.origin + stance.linear * mesh_box.center();
    (center, stance.stretch * mesh_box.half().length() * f64::from(item.crowd))
}

/// Opaque: by batch, nearest batch first, and within it the nearest item first. Of many batches,
/// those that are about as near go by pipeline and material, so that one command draws many of
/// them. Blended: the farthest item first. Ties go by index, that is by node, instance, primitive.
///
/// Batches are as near as those of their items that the view shows: what it does not show must not
/// decide which of two surfaces of one depth wins.
fn sort(scene: &GpuScene, view: &ViewDesc, items: &[u32], scratch: &mut Scratch) {
    scratch.opaque.clear();
    scratch.blended.clear();
    if items.is_empty() {
        return;
    }
    let own = scene.batch_bounds_of(scene.layout.tree.select(&view.subset));
    let is_grouped = scene.layout.batches.len() > NEAR_FIRST_BATCHES_MAX;
    // A map of shadows may show some items of a scene of 100,000 batches.
    let (all, none) = (scene.layout.batches.len(), u32::MAX);
    scratch.ranks.clear();
    scratch.ranks.resize(all, none);
    let mut batches: Vec<(u64, [u32; 2], f64, u32)> = Vec::new();
    for &item in items {
        let index = scene.item(item).0.batch;
        if std::mem::replace(&mut scratch.ranks[index as usize], 0) != none {
            continue;
        }
        let bounds =
            own.as_ref().map_or_else(|| scene.batch_bounds(index), |own| own[index as usize]);
        let is_empty = bounds == Bounds::EMPTY;
        let near = if is_empty { f64::INFINITY } else { view.sort_depth(&bounds, true) };
        let batch = &scene.layout.batches[index as usize];
        batches.push(if is_grouped {
            (rising(near) >> SHELL_BITS, [batch.pipeline, batch.material], near, index)
        } else {
            (0, [0; 2], near, index)
        });
    }
    let key = |of: &(u64, [u32; 2], f64, u32)| (of.0, of.1, rising(of.2), of.3);
    batches.sort_unstable_by_key(key);
    for (rank, (.., batch)) in (0u32..).zip(batches) {
        scratch.ranks[batch as usize] = rank;
    }
    let ranks = &scratch.ranks;
    let keys = |_, some: &[u32]| {
        let (mut opaque, mut blended) = (Vec::with_capacity(some.len()), Vec::new());
        for &index in some {
            let (item, _, bounds) = scene.item(index);
            let distance = view.sort_depth(bounds, false);
            if scene.layout.batches[item.batch as usize].blended {
                blended.push((!rising(distance), index, item.batch));
            } else {
                let near = rising(f64::from(distance as f32));
                opaque.push((ranks[item.batch as usize], near, index, item.batch));
            }
        }
        (opaque, blended)
    };
    for (opaque, blended) in many_items::parts(items, keys) {
        scratch.opaque.extend(opaque);
        scratch.blended.extend(blended);
    }
    scratch.opaque.par_sort_unstable();
    scratch.blended.par_sort_unstable();
}

/// Bits in the order of the numbers: those of negative ones turned around, below all others. A
/// box without bounds counts as farthest.
pub(crate) fn rising(number: f64) -> u64 {
    let number = if number.is_nan() { f64::INFINITY } else { number };
    let bits = number.to_bits();
    if number.is_sign_negative() { !bits } else { bits | 1 << 63 }
}

/// The rectangle around the corners of all visible boxes, or all that the view may touch where
/// a box reaches behind the near plane.
pub(crate) fn touched(
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
