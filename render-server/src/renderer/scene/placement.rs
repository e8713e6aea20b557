//! Where each primitive stands: everything about it that does not change from frame to frame.

use glam::{DAffine3, DMat3, DVec3};

use super::description::{NodeDesc, PrimitiveDesc, SceneDesc};

/// A box with its sides along the world's axes; unbounded where the source was not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::renderer) struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    /// Holds nothing; the neutral element of [`Self::union`].
    pub const EMPTY: Self =
        Self { min: DVec3::splat(f64::INFINITY), max: DVec3::splat(f64::NEG_INFINITY) };

    const UNBOUNDED: Self =
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

    /// Square of the distance from a point to the nearest point of the box; 0 inside.
    pub fn distance_squared(&self, point: DVec3) -> f64 {
        point.clamp(self.min, self.max).distance_squared(point)
    }

    /// The world box around a primitive's box; `|M|·h` as in Arvo, "Transforming Axis-Aligned
    /// Bounding Boxes", Graphics Gems (1990).
    fn around(world_from_mesh: &DAffine3, primitive: &PrimitiveDesc) -> Self {
        let (a, b) = (primitive.min.as_dvec3(), primitive.max.as_dvec3());
        let (min, max) = (a.min(b) + primitive.origin, a.max(b) + primitive.origin);
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

/// One primitive in one place. Its index in the scene's list is the tie-break of every order:
/// it grows with the node, then the instance, then the primitive.
#[derive(Clone, Debug)]
pub(in crate::renderer) struct Item {
    /// The primitive's zero in the world.
    pub origin: DVec3,
    /// Rows of the linear part of world from primitive.
    pub rows: [[f32; 3]; 3],
    /// Rows of the matrix that takes normals to the world; any length.
    pub normal_rows: [[f32; 3]; 3],
    /// Start and count of its lamps in the scene's list of lamp indices.
    pub lamps: [u32; 2],
    /// An index into the scene's batches.
    pub batch: u32,
}

/// A primitive in one place, before it is sorted into a batch.
pub(in crate::renderer) struct Placement {
    pub mesh: u32,
    pub primitive: u32,
    pub origin: DVec3,
    pub linear: DMat3,
    pub bounds: Bounds,
}

impl Placement {
    /// Whether the transform turns the winding around.
    pub fn mirrored(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    /// The item of this placement in a batch.
    pub fn item(&self, batch: u32, lamps: [u32; 2]) -> Item {
        Item {
            origin: self.origin,
            rows: rows(self.linear),
            normal_rows: rows(normal_matrix(self.linear)),
            lamps,
            batch,
        }
    }
}

/// World space from each node's space.
pub(in crate::renderer) fn world_from_nodes(nodes: &[NodeDesc]) -> Vec<DAffine3> {
    let mut world: Vec<DAffine3> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let parent = node.parent.and_then(|parent| world.get(parent as usize));
        world.push(parent.map_or(node.local, |parent| *parent * node.local));
    }
    world
}

/// Every primitive in every place, in the order of the nodes.
pub(in crate::renderer) fn place(desc: &SceneDesc, world: &[DAffine3]) -> Vec<Placement> {
    let mut placements = Vec::new();
    for (node, world_from_node) in desc.nodes.iter().zip(world) {
        let Some(mesh) = node.mesh else { continue };
        let primitives = &desc.meshes[mesh as usize].primitives;
        let mut stand = |world_from_mesh: &DAffine3| {
            for (index, primitive) in primitives.iter().enumerate() {
                placements.push(Placement {
                    mesh,
                    primitive: index as u32,
                    origin: world_from_mesh.transform_point3(primitive.origin),
                    linear: world_from_mesh.matrix3,
                    bounds: Bounds::around(world_from_mesh, primitive),
                });
            }
        };
        if node.instances.is_empty() {
            stand(world_from_node);
        }
        for instance in &node.instances {
            let node_from_instance = DAffine3::from_scale_rotation_translation(
                instance.scale.as_dvec3(),
                instance.rotation.as_dquat(),
                instance.translation.as_dvec3(),
            );
            stand(&(*world_from_node * node_from_instance));
        }
    }
    placements
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
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    cofactors * (sign / largest)
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

    #[test]
    fn singular_matrices_give_finite_normals() {
        for scale in [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0)] {
            assert!(normal_matrix(DMat3::from_diagonal(scale)).is_finite());
        }
        let flat = normal_matrix(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)));
        assert_eq!(flat * DVec3::Z, DVec3::Z);
    }
}
