//! The placement of each primitive: everything about it that does not change from frame to frame.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use polyptych_scene::{Instance, Node, Primitive, Scene};

use super::light::LocalLight;

/// A box with its sides along the world's axes; unbounded where the source was not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

/// Steps of a grid on a length that is a power of two; see [`Bounds::rounded_out`].
const ROUNDED_STEPS: f64 = 32.0;

/// Volume of what a transform makes of a cube, as a share of that of the box with the same edges,
/// up to which it is rounding.
const FLAT_MAX: f64 = 1e-12;

impl Bounds {
    /// Holds nothing; the neutral element of [`Self::union`].
    pub const EMPTY: Self =
        Self { min: DVec3::splat(f64::INFINITY), max: DVec3::splat(f64::NEG_INFINITY) };

    /// Holds everything.
    pub const UNBOUNDED: Self =
        Self { min: DVec3::splat(f64::NEG_INFINITY), max: DVec3::splat(f64::INFINITY) };

    /// The box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The middle; NaN where unbounded.
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Half of the sides.
    pub fn half(&self) -> DVec3 {
        (self.max - self.min) * 0.5
    }

    /// The box whose sides stand on the steps of a grid, 32 to 64 on its longest side: while what
    /// moves stays between two of them, it is the same. A function of this box alone.
    pub fn rounded_out(self) -> Self {
        let longest = (self.max - self.min).max_element();
        // A power of two: the exponent alone is left.
        let power = f64::from_bits(longest.to_bits() & (0x7ff << 52));
        let step = power / ROUNDED_STEPS;
        if !(step.is_normal() && self.min.is_finite() && self.max.is_finite()) {
            return self;
        }
        Self { min: (self.min / step).floor() * step, max: (self.max / step).ceil() * step }
    }

    /// Square of the distance from a point to the nearest point of the box; 0 inside.
    pub fn distance_squared(&self, point: DVec3) -> f64 {
        point.clamp(self.min, self.max).distance_squared(point)
    }

    /// The box around all that a lamp reaches; not finite where that is everything.
    pub fn of_lamp(lamp: &LocalLight) -> Self {
        let reach = lamp.bounded_reach().unwrap_or(f64::INFINITY);
        Self { min: lamp.position - reach, max: lamp.position + reach }
    }

    /// The box around a primitive in its mesh's space.
    fn of(primitive: &Primitive) -> Self {
        let (a, b) = (primitive.min.as_dvec3(), primitive.max.as_dvec3());
        Self { min: a.min(b) + primitive.origin, max: a.max(b) + primitive.origin }
    }

    /// The world box around a primitive's box; `|M|·h` as in Arvo, "Transforming Axis-Aligned
    /// Bounding Boxes", Graphics Gems (1990).
    fn around(world_from_mesh: &DAffine3, primitive: &Primitive) -> Self {
        let Self { min, max } = Self::of(primitive);
        let center = world_from_mesh.transform_point3((min + max) * 0.5);
        let half_local = (max - min) * 0.5;
        let m = world_from_mesh.matrix3;
        let half = m.x_axis.abs() * half_local.x
            + m.y_axis.abs() * half_local.y
            + m.z_axis.abs() * half_local.z;
        let bounds = Self { min: center - half, max: center + half };
        if bounds.min.is_finite() && bounds.max.is_finite() { bounds } else { Self::UNBOUNDED }
    }
}

/// The properties that all primitives of a mesh in one place share.
#[derive(Clone, Debug)]
pub(crate) struct Stance {
    /// The linear part of world from mesh, and so of world from primitive.
    pub linear: DMat3,
    /// Rows of the matrix that takes normals to the world; any length.
    pub normal_rows: [[f32; 3]; 3],
    /// No length becomes longer in the world than by this factor, and few reach it.
    pub stretch: f64,
    /// An index into the scene's billboards, if it turns with one.
    pub billboard: Option<u32>,
}

impl Stance {
    fn new(linear: DMat3, billboard: Option<u32>) -> Self {
        let normal_rows = rows(normal_matrix(linear));
        Self { linear, normal_rows, stretch: stretch(linear), billboard }
    }

    /// It and an item's origin, as a billboard turns them in world space.
    pub fn turned(&self, origin: DVec3, turn: &DAffine3) -> (Self, DVec3) {
        let linear = turn.matrix3 * self.linear;
        let stretch = self.stretch;
        (Self { stretch, ..Self::new(linear, None) }, turn.transform_point3(origin))
    }

    /// Returns whether the transform turns the winding around.
    pub fn is_mirrored(&self) -> bool {
        is_mirrored(&self.linear)
    }

    /// Returns whether the transform leaves no volume, and so no winding to turn around; what an
    /// animation hides is often scaled to 0.
    pub fn is_flat(&self) -> bool {
        is_flat(&self.linear)
    }
}

/// Returns whether a transform turns the winding around. The sign of a flat one is rounding.
fn is_mirrored(linear: &DMat3) -> bool {
    linear.determinant() < 0.0 && !is_flat(linear)
}

/// See [`Stance::is_flat`].
pub(crate) fn is_flat(linear: &DMat3) -> bool {
    let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
    linear.determinant().abs() <= FLAT_MAX * x.length() * y.length() * z.length()
}

/// One primitive in one place. Its index in the scene's list is the tie-break of every order:
/// it grows with the node, then the instance, then the primitive.
#[derive(Clone, Debug)]
pub(crate) struct DrawItem {
    /// The primitive's zero in the world.
    pub origin: DVec3,
    /// An index into the scene's stances.
    pub stance: u32,
    /// Start and count of its lamps in the scene's list of lamp indices.
    pub lamps: [u32; 2],
    /// An index into the scene's batches.
    pub batch: u32,
    /// An index into the scene's boxes of meshes.
    pub mesh_box: u32,
    /// The place of its node in the scene's tree.
    pub place: u32,
    /// See [`polyptych_scene::Node::crowd_of`]; 1 at least.
    pub crowd: f32,
}

/// An item as the vertex stage takes it: `p` stands at `rows · (p − near) + offset` from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EyeRelativeTransform {
    /// The point of the mesh's box that is nearest to the eye, about, in the primitive's space.
    pub near: [f32; 3],
    /// Rows of the linear part, and the offset: `near` as seen from the eye, in world axes.
    pub rows: [[f32; 4]; 3],
    /// The offset of `rows` in f64.
    pub offset: DVec3,
}

/// An item as seen from the eye, of which `origin` is the zero of its primitive and `linear` its
/// stance's, both in world space.
///
/// The large part of all positions is subtracted before anything is rounded to f32. Vertices near
/// the eye are near `near` too, so their difference is exact (Sterbenz); and the offset, taken in
/// f64, is as short as the eye's distance to the mesh. All f32 rounding is in proportion to the
/// distance from the eye, whatever the size of the mesh. `near` may be any point; the nearest one
/// only keeps the numbers small. All parts of a mesh have the same `near`, so that they meet in
/// equal bits.
pub(crate) fn relative_to(
    origin: DVec3,
    linear: DMat3,
    eye: DVec3,
    mesh_box: &Bounds,
) -> EyeRelativeTransform {
    let eye_in_primitive = linear.inverse() * (eye - origin);
    let near = if eye_in_primitive.is_finite() {
        eye_in_primitive.max(mesh_box.min).min(mesh_box.max)
    } else {
        // A flat item: there is no telling where in its box the eye would be.
        mesh_box.center()
    };
    let near = Some(near.as_vec3()).filter(|near| near.is_finite()).unwrap_or(Vec3::ZERO);
    let offset = (origin - eye) + linear * near.as_dvec3();
    let row = |i: usize| linear.row(i).extend(offset[i]).as_vec4().to_array();
    EyeRelativeTransform { near: near.to_array(), rows: [0, 1, 2].map(row), offset }
}

/// A primitive in one place, before it is sorted into a batch.
pub(crate) struct PrimitiveInstance<'a> {
    /// An index into the scene's nodes.
    pub node: usize,
    /// The index of the copy; 0 if the node has none.
    pub copy: usize,
    pub mesh: u32,
    /// An index into the mesh's primitives.
    pub primitive: u32,
    pub origin: DVec3,
    pub stance: u32,
    pub is_mirrored: bool,
    /// See [`Stance::is_flat`].
    pub is_flat: bool,
    pub desc: &'a Primitive,
    pub bounds: Bounds,
}

/// For each primitive, in the order of the description, the box around all of its mesh in the
/// primitive's own space.
pub(crate) fn mesh_boxes(desc: &Scene) -> Vec<Bounds> {
    let mut boxes = Vec::new();
    for mesh in &desc.meshes {
        let whole = mesh.primitives.iter().map(Bounds::of).fold(Bounds::EMPTY, Bounds::union);
        boxes.extend(mesh.primitives.iter().map(|primitive| Bounds {
            min: whole.min - primitive.origin,
            max: whole.max - primitive.origin,
        }));
    }
    boxes
}

/// World space from each node's space.
pub(crate) fn world_from_nodes(nodes: &[Node]) -> Vec<DAffine3> {
    let mut world: Vec<DAffine3> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let parent = node.parent.and_then(|parent| world.get(parent as usize));
        world.push(parent.map_or(node.local, |parent| *parent * node.local));
    }
    world
}

/// Gives every primitive in every place, in the order of the nodes, and returns the stances that
/// they name; `None` before those of each node. Ends early where `give` fails.
pub(crate) fn instantiate<'a, E>(
    desc: &'a Scene,
    world: &[DAffine3],
    billboard_of: &[Option<u32>],
    mut give: impl FnMut(Option<PrimitiveInstance<'a>>) -> Result<(), E>,
) -> Result<Vec<Stance>, E> {
    let mut stances = Vec::new();
    for (index, (node, world_from_node)) in desc.nodes.iter().zip(world).enumerate() {
        give(None)?;
        let Some(mesh) = node.mesh else { continue };
        let primitives = &desc.meshes[mesh as usize].primitives;
        let billboard = billboard_of.get(index).copied().flatten();
        let shape =
            PlacedMesh { node: index, mesh, primitives, instances: &node.instances, billboard };
        shape.place(world_from_node, &mut stances, |placed| give(Some(placed)))?;
    }
    Ok(stances)
}

/// The mesh of a node, with the places that it has in the node's space.
pub(crate) struct PlacedMesh<'a, 'b> {
    /// An index into the scene's nodes.
    pub node: usize,
    pub mesh: u32,
    pub primitives: &'a [Primitive],
    /// Empty for one place: that of the node.
    pub instances: &'b [Instance],
    /// The billboard with which it turns, if it does.
    pub billboard: Option<u32>,
}

impl<'a> PlacedMesh<'a, '_> {
    /// Gives every primitive in every place, and appends the stances that they name. Ends early
    /// where `give` fails.
    pub fn place<E>(
        &self,
        world_from_node: &DAffine3,
        stances: &mut Vec<Stance>,
        mut give: impl FnMut(PrimitiveInstance<'a>) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut stand = |copy: usize, world_from_mesh: &DAffine3| {
            let stance = Stance::new(world_from_mesh.matrix3, self.billboard);
            for (primitive, desc) in (0..).zip(self.primitives) {
                give(PrimitiveInstance {
                    node: self.node,
                    copy,
                    mesh: self.mesh,
                    primitive,
                    origin: world_from_mesh.transform_point3(desc.origin),
                    stance: stances.len() as u32,
                    is_mirrored: stance.is_mirrored(),
                    is_flat: stance.is_flat(),
                    desc,
                    bounds: Bounds::around(world_from_mesh, desc),
                })?;
            }
            stances.push(stance);
            Ok(())
        };
        if self.instances.is_empty() {
            stand(0, world_from_node)?;
        }
        for (copy, instance) in self.instances.iter().enumerate() {
            let node_from_instance = DAffine3::from_scale_rotation_translation(
                instance.scale.as_dvec3(),
                instance.rotation.as_dquat(),
                instance.translation.as_dvec3(),
            );
            stand(copy, &(*world_from_node * node_from_instance))?;
        }
        Ok(())
    }
}

/// Normals go with the cofactors, which exist for singular matrices too: the inverse transpose
/// is the cofactor matrix over the determinant, so only the determinant's sign is needed.
/// Scaled to a largest element of 1, so that tiny and huge scales stay within f32.
fn normal_matrix(linear: DMat3) -> DMat3 {
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let largest = cofactors.to_cols_array().into_iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return DMat3::ZERO;
    }
    let sign = if is_mirrored(&linear) { -1.0 } else { 1.0 };
    cofactors * (sign / largest)
}

/// An upper bound of the largest singular value, which is exact where a turn follows a scale: the
/// root of the largest row sum of MᵀM, which bounds its eigenvalues (Gershgorin, 1931).
fn stretch(linear: DMat3) -> f64 {
    /// More than the sums round.
    const ROUNDING: f64 = 1e-14;
    let gram = linear.transpose() * linear;
    let sums = [gram.x_axis, gram.y_axis, gram.z_axis].map(|of| of.abs().element_sum());
    sums.into_iter().fold(0.0, f64::max).sqrt() * (1.0 + ROUNDING)
}

fn rows(matrix: DMat3) -> [[f32; 3]; 3] {
    [0, 1, 2].map(|row| matrix.row(row).as_vec3().to_array())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_stay_upright_under_any_scale() {
        let check = |linear: DMat3| {
            let (a, b) = (linear * DVec3::X, linear * DVec3::Y);
            let wanted = a.cross(b).normalize() * linear.determinant().signum();
            let got = (normal_matrix(linear) * DVec3::Z).normalize();
            assert!(got.distance(wanted) < 1e-12, "{linear:?}: {got} instead of {wanted}");
        };
        check(DMat3::IDENTITY);
        check(DMat3::from_diagonal(DVec3::new(2.0, 0.5, 30.0)));
        check(DMat3::from_diagonal(DVec3::new(-2.0, 0.5, 30.0)));
        check(DMat3::from_diagonal(DVec3::new(1e-9, 3e-9, 1e-9)));
        check(DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.0, 0.3, -1.0)));
    }

    /// Returns the position that the vertex stage computes for a point: f32 throughout.
    fn emulated(relative: &EyeRelativeTransform, point: Vec3) -> Vec3 {
        let local = (point - Vec3::from(relative.near)).extend(1.0);
        Vec3::from(relative.rows.map(|row| glam::Vec4::from(row).dot(local)))
    }

    #[test]
    fn what_is_left_to_f32_is_in_proportion_to_the_distance() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 0.7);
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z * 2.0);
        let mut worst: f64 = 0.0;
        for half in [1.0, 50.0, 2e4, 1e6] {
            let mesh_box = Bounds { min: DVec3::splat(-half), max: DVec3::splat(half) };
            for linear in [DMat3::IDENTITY, turn, turn * shear, turn * 1e-4] {
                let origin = DVec3::new(6_378_137.123_456, -1e7, 3.0);
                for step in 0..1000u32 {
                    let along = |by: u32| f64::from(step * by % 997) / 498.5 - 1.0;
                    let point = DVec3::new(along(7), along(31), along(101)) * half;
                    let point = point.as_vec3();
                    let world = origin + linear * point.as_dvec3();
                    // From 2 cm to ten times the mesh away.
                    let distance = 0.02 * (10.0 * half / 0.02).powf(f64::from(step) / 1000.0);
                    let eye = world - DVec3::new(along(11), along(13), along(17)) * distance;
                    let relative = relative_to(origin, linear, eye, &mesh_box);
                    let error = emulated(&relative, point).as_dvec3().distance(world - eye);
                    // A nanometre is what f64 itself has 10 000 km from the origin.
                    worst = worst.max((error - 4e-9) / (world - eye).length());
                }
            }
        }
        println!("largest error: {worst:.2e} of the distance");
        // A tenth of this turns a point by less than 0.001 px where a pixel is 1/4000 rad.
        assert!(worst < 1e-6, "{worst:e} of the distance");
    }

    #[test]
    fn flat_and_boundless_items_are_seen_from_a_finite_point() {
        for linear in [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0))] {
            for mesh_box in [Bounds::EMPTY, Bounds::UNBOUNDED] {
                let relative = relative_to(DVec3::ONE, linear, DVec3::ZERO, &mesh_box);
                assert!(relative.rows.iter().flatten().all(|number| number.is_finite()));
                assert!(relative.near.iter().all(|number| number.is_finite()));
            }
        }
    }

    #[test]
    fn singular_matrices_give_finite_normals() {
        for scale in [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0)] {
            assert!(normal_matrix(DMat3::from_diagonal(scale)).is_finite());
        }
        let flat = normal_matrix(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)));
        assert_eq!(flat * DVec3::Z, DVec3::Z);
    }
}
