//! Items of a layout that stand elsewhere than where they were laid out.
//!
//! A layout of a million items takes seconds. Where only nodes were moved, it stays as it is, and
//! what moved lies over it: the items in their new places, and a tree of their own. What is drawn
//! is as after a new layout, bit for bit: items keep their indices and batches, which decide every
//! order, and the boxes of batches are those of a new layout.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

use glam::{DAffine3, Vec3};
use polyptych_scene::{Instance, Light};

use super::billboard::Billboard;
use super::bvh::Bvh;
use super::draw_item::{Bounds, DrawItem, PlacedMesh, Stance};
use super::lamp_grid::IN_CELLS;
use super::layout::SceneLayout;
use super::light::{LAMP_INDICES_MAX, MovedLights};
use crate::cull::FrustumPlanes;

/// Inverse of the largest share of items that may be moved: beyond it a new layout costs little
/// more, and culling looks at one tree instead of two.
const MOVED_FRACTION: usize = 2;

/// A node in another place than in the layout. Its mesh, if any, is the same, but may be bent.
#[derive(Clone, Copy, Debug)]
pub struct MovedNode<'a> {
    /// Its index among those of the layout's description.
    pub node: u32,
    /// World space from its space.
    pub world_from_node: DAffine3,
    /// The places of its mesh, as in the description.
    pub instances: &'a [Instance],
    /// `true` if neither its mesh nor its light is seen.
    pub is_hidden: bool,
    /// Its light, if that is another one than in the layout.
    pub light: Option<&'a Light>,
}

impl<'a> MovedNode<'a> {
    /// A node that is shown, with its own light.
    pub fn new(node: u32, world_from_node: DAffine3, instances: &'a [Instance]) -> Self {
        Self { node, world_from_node, instances, is_hidden: false, light: None }
    }
}

/// The items of a layout that were moved since it was made.
#[derive(Debug)]
pub struct MovedItems {
    /// Those of the layout that are moved or hidden: a bit for each.
    is_moved: Arc<[u64]>,
    /// Their indices in the layout, rising.
    indices: Vec<u32>,
    items: Vec<DrawItem>,
    /// Named by these items.
    stances: Vec<Stance>,
    bounds: Vec<Bounds>,
    tree: Bvh,
    /// Around all items of each batch that are not hidden, moved or not.
    batch_bounds: Vec<Bounds>,
    /// Lists of lamps, which follow those of the layout.
    lamp_indices: Vec<u32>,
    /// `None` where no light was moved.
    lights: Option<MovedLights>,
    billboards: Vec<Billboard>,
}

/// The boxes of bent primitives, by the index of their mesh.
pub(super) type BentBoxes = HashMap<u32, Vec<(Vec3, Vec3)>>;

impl MovedItems {
    /// Places nodes of a layout, in the order of their indices. `None` where the scene must be laid
    /// out anew: too much was moved, or an item was turned inside out that no clip turns.
    pub fn new<'a>(
        layout: &SceneLayout,
        nodes: impl Iterator<Item = MovedNode<'a>>,
    ) -> Option<Self> {
        let nodes: Vec<MovedNode<'a>> = nodes.collect();
        let items_max = layout.items.len() / MOVED_FRACTION;
        Self::with_boxes(layout, &nodes, &BentBoxes::new(), items_max)
    }

    /// Places nodes of a layout, some of which have meshes that are bent; `None` too where more
    /// items than `items_max` are moved.
    pub(super) fn with_boxes(
        layout: &SceneLayout,
        nodes: &[MovedNode<'_>],
        boxes: &BentBoxes,
        items_max: usize,
    ) -> Option<Self> {
        let find = |node: u32| {
            let at = nodes.binary_search_by_key(&node, |moved| moved.node).ok()?;
            Some(&nodes[at])
        };
        let place_of = |node: u32| find(node).map(|moved| moved.world_from_node);
        let billboards = layout.billboards.iter().map(|of| of.moved(place_of)).collect();
        let mut moved = Self {
            is_moved: vec![0; layout.items.len().div_ceil(64)].into(),
            indices: Vec::new(),
            items: Vec::new(),
            stances: Vec::new(),
            bounds: Vec::new(),
            tree: Bvh::default(),
            batch_bounds: Vec::new(),
            lamp_indices: Vec::new(),
            lights: layout.lights.moved(find),
            billboards,
        };
        let mut known_lamps = HashMap::new();
        for node in nodes {
            moved.add(layout, node, boxes, &mut known_lamps)?;
            if moved.items.len() > items_max {
                return None;
            }
        }
        moved.tree = Bvh::new(&moved.bounds, &|| false)?;
        let by_batch = layout.items_by_batch();
        let known = layout.batches.iter().map(|batch| batch.bounds);
        let hidden = nodes.iter().filter(|node| node.is_hidden);
        let hidden = hidden.filter_map(|node| layout.items_of(node.node)).flatten();
        let changed: Vec<u32> = moved.indices.iter().copied().chain(hidden).collect();
        // The box of a batch holds nothing of what is hidden, or was turned inside out and left it.
        let bounds = |item: usize| match moved.slot(item as u32) {
            Some(at) if moved.items[at].batch == layout.items[item].batch => moved.bounds[at],
            None if !moved.holds(item as u32) => layout.bounds[item],
            _ => Bounds::EMPTY,
        };
        let mut batch_bounds = by_batch.moved(&layout.items, known, &changed, bounds);
        // Those that were turned inside out are counted in the batch that they came to.
        for (item, bounds) in moved.items.iter().zip(&moved.bounds) {
            let of_batch = &mut batch_bounds[item.batch as usize];
            *of_batch = of_batch.union(*bounds);
        }
        moved.batch_bounds = batch_bounds;
        Some(moved)
    }

    /// Adds the items of a node behind those of all nodes before it.
    fn add(
        &mut self,
        layout: &SceneLayout,
        node: &MovedNode<'_>,
        boxes: &BentBoxes,
        known_lamps: &mut HashMap<Vec<u32>, [u32; 2]>,
    ) -> Option<()> {
        let at = node.node as usize;
        let std::ops::Range { start: first, end } = layout.items_of(node.node)?;
        let Some(one) = layout.items[first as usize..end as usize].first() else {
            return Some(());
        };
        if node.is_hidden {
            // They are in no tree now, so that nothing finds them.
            (first..end).for_each(|item| self.take_out(item));
            return Some(());
        }
        // The first primitive of a mesh that has any is where the next mesh's begins.
        let starts = &layout.first_primitive;
        let mesh =
            starts.partition_point(|&start| start <= one.mesh_box as usize).checked_sub(1)?;
        let mut primitives = Cow::Borrowed(&layout.desc.meshes[mesh].primitives);
        if let Some(boxes) = boxes.get(&(mesh as u32)) {
            for (primitive, (min, max)) in primitives.to_mut().iter_mut().zip(boxes) {
                (primitive.min, primitive.max) = (*min, *max);
            }
        }
        let billboard = layout.stances[one.stance as usize].billboard;
        let shape = PlacedMesh {
            node: at,
            billboard,
            mesh: mesh as u32,
            primitives: &primitives,
            instances: node.instances,
        };
        let (mut next, mut stances) = (first, std::mem::take(&mut self.stances));
        let placed = shape.place(&node.world_from_node, &mut stances, |mut placed| {
            placed.bounds = Billboard::bounds(&self.billboards, billboard, placed.bounds);
            let index = next;
            next += 1;
            let known = layout.items.get(index as usize).filter(|_| index < end).ok_or(())?;
            let was_mirrored = layout.stances[known.stance as usize].is_mirrored();
            // What is flat counts as not mirrored, and is drawn in either.
            let is_turned = was_mirrored != placed.is_mirrored;
            let twin = layout.twins.get(&known.batch).filter(|_| is_turned);
            let batch = match twin {
                Some(twin) => *twin,
                None if is_turned && !placed.is_flat => return Err(()),
                None => known.batch,
            };
            let lamps = self.lamps(layout, known, &placed.bounds, known_lamps).ok_or(())?;
            let (origin, stance) = (placed.origin, placed.stance);
            self.items.push(DrawItem { origin, stance, lamps, batch, ..known.clone() });
            self.bounds.push(placed.bounds);
            self.take_out(index);
            self.indices.push(index);
            Ok::<_, ()>(())
        });
        self.stances = stances;
        placed.ok().filter(|()| next == end)
    }

    /// Takes an item out of the tree of the layout.
    fn take_out(&mut self, item: u32) {
        Arc::make_mut(&mut self.is_moved)[item as usize / 64] |= 1 << (item % 64);
    }

    /// Start and count of the list of the lamps that reach a box. Where it is that of the item
    /// where it was, or of another that was moved, it is shared.
    fn lamps(
        &mut self,
        layout: &SceneLayout,
        item: &DrawItem,
        bounds: &Bounds,
        known: &mut HashMap<Vec<u32>, [u32; 2]>,
    ) -> Option<[u32; 2]> {
        let lights = &layout.lights;
        let (list, in_cells) = lights.lamps_reaching(bounds);
        let [start, count] = [item.lamps[0], item.lamps[1] & !IN_CELLS];
        let [start, count] = [start, count].map(|number| number as usize);
        if lights.indices.get(start..start + count) == Some(&list[..]) {
            return Some([item.lamps[0], list.len() as u32 | in_cells]);
        }
        if let Some(&[start, count]) = known.get(&list) {
            return Some([start, count | in_cells]);
        }
        let start = lights.indices.len() + self.lamp_indices.len();
        if start + list.len() > LAMP_INDICES_MAX {
            return None;
        }
        let [start, count] = [start as u32, list.len() as u32];
        self.lamp_indices.extend_from_slice(&list);
        known.insert(list, [start, count]);
        Some([start, count | in_cells])
    }

    /// Returns the place of an item among those that were moved, if it was.
    fn slot(&self, item: u32) -> Option<usize> {
        if !self.holds(item) {
            return None;
        }
        self.indices.binary_search(&item).ok()
    }

    /// Returns whether an item was moved or hidden.
    pub(super) fn holds(&self, item: u32) -> bool {
        self.is_moved[item as usize / 64] >> (item % 64) & 1 == 1
    }

    /// Returns whether an item is hidden.
    pub(super) fn hides(&self, item: u32) -> bool {
        self.holds(item) && self.slot(item).is_none()
    }

    /// A bit for each item of the layout: 1 if it was moved or hidden.
    pub(super) fn bits(&self) -> &Arc<[u64]> {
        &self.is_moved
    }

    /// An item in its new place, with its stance and its box, if it was moved.
    pub(super) fn item(&self, item: u32) -> Option<(&DrawItem, &Stance, &Bounds)> {
        let slot = self.slot(item)?;
        let item = &self.items[slot];
        Some((item, &self.stances[item.stance as usize], &self.bounds[slot]))
    }

    /// The box around all items of a batch that are not hidden, moved or not.
    pub(super) fn batch_bounds(&self, batch: u32) -> Bounds {
        self.batch_bounds[batch as usize]
    }

    /// Appends the moved items that may be visible, in no particular order.
    pub(super) fn visible(&self, planes: &FrustumPlanes, found: &mut Vec<u32>) {
        let from = found.len();
        self.tree.visible(planes, found);
        for slot in &mut found[from..] {
            *slot = self.indices[*slot as usize];
        }
    }

    /// The lights as they shine now, if one was moved.
    pub(super) fn lights(&self) -> Option<&MovedLights> {
        self.lights.as_ref()
    }

    /// The nodes that turn towards the viewer, as they stand now.
    pub(super) fn billboards(&self) -> &[Billboard] {
        &self.billboards
    }

    /// Lists of lamps, which follow those of the layout.
    pub(super) fn lamp_indices(&self) -> &[u32] {
        &self.lamp_indices
    }

    /// Returns the number of items that were moved.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Returns whether nothing was moved.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }
}
