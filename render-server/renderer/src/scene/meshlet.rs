//! The meshlets of a geometry: which of them are drawn, and which cannot show.
//!
//! A meshlet is a run of triangles in the order of the blob, so leaving one out changes neither
//! the order nor the pixels of the others. It is left out where its box lies outside the channel's
//! rectangle, and where all of its triangles face away from the eye. Which levels are drawn does
//! not depend on the channel: see [`ItemErrors`].

use std::borrow::Cow;

use glam::{DMat3, DVec3};
use polyptych_scene::Primitive;
use polyptych_scene::meshlet::{self, Meshlet};

use super::draw_item::{Bounds, is_flat};
use crate::cull::FrustumPlanes;
use crate::error_tolerance::{BoundingSphere, ItemErrors};

/// Meshlets that are tested together first: 20,000 of them cost 600 such tests.
const BLOCK_MESHLETS: usize = 32;

/// A share of the distance by which cones are wider than they say: triangles seen edge-on are left
/// to the GPU, and f32 rounds what cones say by less.
const CONE_MARGIN: f64 = 1e-3;

/// Meshlets that follow each other in the blob, and what bounds them.
#[derive(Debug)]
struct Block {
    first: u32,
    count: u32,
    /// The centre of the box around their boxes.
    center: DVec3,
    half: DVec3,
    /// Around the spheres of all their errors.
    around: BoundingSphere,
    /// The least of their own errors.
    error_min: f32,
    /// The greatest of the errors of what replaces them.
    coarser_error_max: f32,
}

impl Block {
    fn new(first: usize, meshlets: &[Meshlet]) -> Self {
        let all = meshlets.iter().map(box_of).fold(Bounds::EMPTY, Bounds::union);
        Self {
            first: first as u32,
            count: meshlets.len() as u32,
            center: all.center(),
            half: all.half(),
            around: around(meshlets),
            error_min: meshlets.iter().map(|of| of.error).fold(f32::INFINITY, f32::min),
            coarser_error_max: meshlets.iter().map(|of| of.coarser_error).fold(0.0, f32::max),
        }
    }

    /// Returns whether the errors alone say that none of its meshlets is drawn.
    fn is_left_out(&self, errors: &ItemErrors) -> bool {
        let [least, most] = errors.allowed_within(&self.around);
        let is_replaced = errors.compared(self.coarser_error_max, least).is_some()
            && self.coarser_error_max.is_finite();
        let is_too_coarse = self.error_min > 0.0 && errors.compared(self.error_min, most).is_none();
        is_replaced || is_too_coarse
    }
}

fn around(meshlets: &[Meshlet]) -> BoundingSphere {
    BoundingSphere::around(meshlets.iter().flat_map(|of| [&of.sphere, &of.coarser_sphere]))
}

/// A run of a geometry's indices that is all of one level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelRun {
    /// Its first index and the number of its indices.
    pub indices: [u32; 2],
    /// Its largest error as a share of what is allowed, 0 to 1.
    pub error_share: f64,
}

/// All meshlets of a geometry.
#[derive(Debug)]
pub(crate) struct Meshlets {
    all: Vec<Meshlet>,
    blocks: Vec<Block>,
    /// Around the spheres of all errors.
    around: BoundingSphere,
    /// The least error above 0.
    error_min: f32,
    /// The greatest finite error.
    error_max: f32,
    finest: [u32; 2],
    /// The indices of all that nothing replaces, if they follow each other.
    coarsest: Option<[u32; 2]>,
    /// The greatest error of these.
    coarsest_error: f32,
    /// The places of the first index of each in the blob; empty if they are those of the GPU.
    in_blob: Vec<u64>,
    held: HeldDetail,
}

/// The true errors of what is drawn as the finest level where finer ones are not held.
#[derive(Clone, Debug)]
struct HeldDetail {
    largest: f32,
    /// The box around all these meshlets.
    bounds: Bounds,
    /// By meshlet in the order of drawing, in which these are the first ones.
    errors: Vec<f32>,
}

impl HeldDetail {
    fn add(&mut self, error: f32, meshlet: &Meshlet) {
        self.errors.push(error);
        self.largest = self.largest.max(error);
        self.bounds = self.bounds.union(box_of(meshlet));
    }

    /// The share of one in what is drawn: see [`ItemErrors::held_share`].
    fn share(&self, (at, meshlet): (u32, &Meshlet), errors: &ItemErrors) -> f64 {
        let error = self.errors.get(at as usize).copied().unwrap_or(0.0);
        if error > 0.0 { errors.held_share(error, &near(box_of(meshlet), error)) } else { 0.0 }
    }

    fn largest_share(&self, errors: &ItemErrors) -> f64 {
        let around = near(self.bounds, self.largest);
        if self.largest > 0.0 { errors.held_share(self.largest, &around) } else { 0.0 }
    }
}

impl Default for HeldDetail {
    fn default() -> Self {
        Self { largest: 0.0, bounds: Bounds::EMPTY, errors: Vec::new() }
    }
}

fn box_of(meshlet: &Meshlet) -> Bounds {
    Bounds { min: meshlet.min.into(), max: meshlet.max.into() }
}

/// A sphere around all that is no farther than an error from a box.
fn near(bounds: Bounds, error: f32) -> BoundingSphere {
    BoundingSphere { center: bounds.center(), radius: bounds.half().length() + f64::from(error) }
}

impl Meshlets {
    /// Reads them from the bytes of a primitive, which are as many as it says; `None` if it has
    /// none.
    ///
    /// # Errors
    /// They are not those of its indices, or a number of theirs is out of bounds.
    pub fn parse(desc: &Primitive, bytes: &[u8]) -> Result<Option<Self>, String> {
        let mut all = desc.meshlets_of(bytes);
        if all.is_empty() {
            return Ok(None);
        }
        let indices = desc.index_count_of_all();
        let of_all = u32::try_from(indices).map_err(|error| error.to_string())?;
        // Else a small blob could ask for any amount of work.
        let named: u64 = all.iter().map(|of| u64::from(of.index_count)).sum();
        if named > indices {
            return Err(format!("its meshlets have {named} indices, where {indices} can be"));
        }
        let is_beyond =
            |of: &Meshlet| u64::from(of.first_index) + u64::from(of.index_count) > indices;
        if let Some(at) = all.iter().position(is_beyond).filter(|_| desc.finest_level == 0) {
            return Err(format!("meshlet {at}: its indices are not whole triangles of the blob"));
        }
        let in_blob = meshlet::put_in_draw_order(&mut all);
        let mut held = HeldDetail::default();
        if desc.finest_level > 0 {
            // What nothing finer replaces is drawn whatever its error is.
            for (at, meshlet) in all.iter_mut().enumerate().filter(|(_, of)| desc.is_finest(of)) {
                let error = std::mem::take(&mut meshlet.error);
                if !(0.0..=meshlet.coarser_error).contains(&error) || error.is_infinite() {
                    return Err(format!("meshlet {at}: its errors are not in order"));
                }
                held.add(error, meshlet);
            }
        }
        if let Some(fault) = meshlet::fault(&all, desc.index_count, of_all) {
            return Err(fault);
        }
        let is_moved =
            (0..).zip(&in_blob).any(|(at, of): (usize, _)| u64::from(all[at].first_index) != *of);
        let in_blob = if is_moved { in_blob } else { Vec::new() };
        Ok(Some(Self { in_blob, held, ..Self::new(all, desc.index_count) }))
    }

    /// Puts the bytes of indices, as a blob has them, into the order in which they are drawn.
    pub fn in_draw_order<'a>(&self, indices: &'a [u8], width: usize) -> Cow<'a, [u8]> {
        if self.in_blob.is_empty() {
            return indices.into();
        }
        let mut ordered = Vec::with_capacity(indices.len());
        for (meshlet, at) in self.all.iter().zip(&self.in_blob) {
            let first = *at as usize * width;
            let of = indices.get(first..first + meshlet.index_count as usize * width);
            ordered.extend_from_slice(of.unwrap_or_default());
        }
        ordered.into()
    }

    fn new(all: Vec<Meshlet>, fine: u32) -> Self {
        let blocks = all.chunks(BLOCK_MESHLETS).enumerate();
        let blocks = blocks.map(|(at, some)| Block::new(at * BLOCK_MESHLETS, some)).collect();
        let errors = || all.iter().flat_map(|of| [of.error, of.coarser_error]);
        let positive = errors().filter(|error| *error > 0.0);
        let finite = errors().filter(|error| error.is_finite());
        let coarsest = || all.iter().filter(|of| of.coarser_error.is_infinite());
        Self {
            around: around(&all),
            error_min: positive.fold(f32::INFINITY, f32::min),
            error_max: finite.fold(0.0, f32::max),
            finest: [0, fine],
            coarsest: joined(coarsest()),
            coarsest_error: coarsest().map(|of| of.error).fold(0.0, f32::max),
            blocks,
            all,
            in_blob: Vec::new(),
            held: HeldDetail::default(),
        }
    }

    /// Returns whether its finest level is the source itself, and not one that is held for want of
    /// finer ones.
    pub fn is_held_whole(&self) -> bool {
        self.held.largest <= 0.0
    }

    /// Returns what is drawn, if that is quickly seen to be all of one level.
    pub fn one_level(&self, errors: &ItemErrors) -> Option<LevelRun> {
        let [least, most] = errors.allowed_within(&self.around);
        if errors.compared(self.error_min, most).is_none() {
            return Some(LevelRun {
                indices: self.finest,
                error_share: self.held.largest_share(errors),
            });
        }
        let indices = self.coarsest?;
        errors.compared(self.error_max, least)?;
        let error_share = errors.compared(self.coarsest_error, least)?;
        Some(LevelRun { indices, error_share })
    }

    /// Appends those that are drawn, by their places, and returns the largest share of their errors
    /// in what is allowed. Leaves out some that cannot show, if it is given what can.
    pub fn choose(
        &self,
        errors: &ItemErrors,
        cull: Option<&MeshletCull>,
        chosen: &mut Vec<u32>,
    ) -> f64 {
        let mut largest: f64 = 0.0;
        for block in &self.blocks {
            let is_seen = cull.is_none_or(|cull| cull.may_show(block.center, block.half));
            if !is_seen || block.is_left_out(errors) {
                continue;
            }
            for at in block.first..block.first + block.count {
                let meshlet = &self.all[at as usize];
                if let Some(share) = errors.share_if_drawn(meshlet) {
                    largest = largest.max(share).max(self.held.share((at, meshlet), errors));
                    chosen.push(at);
                }
            }
        }
        largest
    }

    /// The meshlet in a place.
    pub fn get(&self, at: u32) -> &Meshlet {
        &self.all[at as usize]
    }
}

/// The first index of meshlets and the number of their indices, if these follow each other.
pub(crate) fn joined<'a>(mut meshlets: impl Iterator<Item = &'a Meshlet>) -> Option<[u32; 2]> {
    let first = meshlets.next()?;
    let run = [first.first_index, first.index_count];
    meshlets.try_fold(run, |[first, count], of| {
        (of.first_index == first + count).then_some([first, count + of.index_count])
    })
}

/// The eye, or the direction of parallel rays, in a geometry's own space.
#[derive(Clone, Copy, Debug)]
enum CullView {
    From(DVec3),
    Along(DVec3),
}

/// The culling test of an item's meshlets.
#[derive(Debug)]
pub(crate) struct MeshletCull {
    /// In the item's space.
    planes: FrustumPlanes,
    /// `None` where both sides are drawn.
    view: Option<CullView>,
}

impl MeshletCull {
    /// Creates the test for an item with its origin in world space. `culls_back`: back faces are
    /// not drawn.
    pub fn new(planes: &FrustumPlanes, linear: &DMat3, origin: DVec3, culls_back: bool) -> Self {
        // A flat item has no side that an eye could be on.
        let view = (culls_back && !is_flat(linear)).then(|| match planes.view_direction() {
            Some(rays) => CullView::Along((linear.inverse() * rays).normalize_or_zero()),
            None => CullView::From(linear.inverse() * (planes.eye() - origin)),
        });
        Self { planes: planes.in_space_of(linear, origin), view }
    }

    /// Returns whether a box may show.
    fn may_show(&self, center: DVec3, half: DVec3) -> bool {
        self.planes.test(center, half, FrustumPlanes::ALL).is_some()
    }

    /// Returns whether the box of a meshlet may show.
    pub fn may_show_meshlet(&self, meshlet: &Meshlet) -> bool {
        let (min, max) = (meshlet.min.as_dvec3(), meshlet.max.as_dvec3());
        self.may_show((min + max) * 0.5, (max - min) * 0.5)
    }

    /// Returns whether only backs of a meshlet can be seen, which are not drawn.
    pub fn hides(&self, meshlet: &Meshlet) -> bool {
        match self.view {
            Some(CullView::From(eye)) => eye.is_finite() && faces_away_from(meshlet, eye),
            Some(CullView::Along(rays)) => rays.is_finite() && faces_along(meshlet, rays),
            None => false,
        }
    }
}

/// Returns whether all triangles face away from an eye in the primitive's space, by a margin that
/// rounding does not reach.
///
/// The test is that of Olano and others, and of Zeux's meshoptimizer: with the eye at distance d
/// from the middle, no triangle faces it if `away · axis ≥ sine · d + radius`.
fn faces_away_from(meshlet: &Meshlet, eye: DVec3) -> bool {
    let axis = meshlet.cone_axis.as_dvec3();
    let (min, max) = (meshlet.min.as_dvec3(), meshlet.max.as_dvec3());
    let away = (min + max) * 0.5 - eye;
    let sine = f64::from(meshlet.cone_sine) + CONE_MARGIN;
    let reach = sine * away.length() + (max - min).length() * 0.5;
    axis != DVec3::ZERO && away.dot(axis) >= reach
}

/// Returns whether all triangles face away from rays in one direction, of unit length: from
/// infinitely far the meshlet has no extent.
fn faces_along(meshlet: &Meshlet, rays: DVec3) -> bool {
    let axis = meshlet.cone_axis.as_dvec3();
    axis != DVec3::ZERO && rays.dot(axis) >= f64::from(meshlet.cone_sine) + CONE_MARGIN
}
