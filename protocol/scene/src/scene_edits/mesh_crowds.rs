//! The crowds of nodes to which edits gave their mesh, made or not: see [`Node::crowd`].
//!
//! The bake finds crowds where nodes stand in a file. Where edits put a node says nothing of its
//! crowd: it may be moved while servers keep what they laid out, and one that joins then has to
//! draw the same. So a node gets the largest crowd that its mesh is in anywhere in its own file,
//! and one that had another mesh before stays in its crowd too. Both are drawn where they might be
//! left out, rather than left out of a surface that is seen. A mesh that stands nowhere in its
//! file, such as one that a client made of arrays, may stand anywhere: it is never left out by
//! itself.

use glam::DVec3;

use crate::{Mesh, Node, Scene};

/// The largest crowd of each mesh in its file, by the number of the mesh.
#[derive(Debug, Default)]
pub(super) struct MeshCrowds(Vec<f32>);

impl MeshCrowds {
    /// No crowds: so many meshes, each of which stands alone.
    pub fn new(meshes: usize) -> Self {
        Self(vec![0.0; meshes])
    }

    /// Those of the meshes of a file, by their indices in it; endless if no node has the mesh.
    pub fn of_file(file: &Scene) -> Self {
        let mut crowds = vec![None; file.meshes.len()];
        for node in &file.nodes {
            let Some(mesh) = node.mesh else { continue };
            if let Some(largest) = crowds.get_mut(mesh as usize) {
                *largest = Some(largest.unwrap_or(0.0_f32).max(node.crowd));
            }
        }
        Self(crowds.into_iter().map(|largest| largest.unwrap_or(f32::INFINITY)).collect())
    }

    /// Adds those of a file, whose first mesh has this number.
    pub fn add(&mut self, first_mesh: u32, of_file: &Self) {
        let own = self.0.iter_mut().skip(first_mesh as usize);
        for (own, of_file) in own.zip(&of_file.0) {
            *own = own.max(*of_file);
        }
    }

    /// Gives a node another mesh, with its crowds. `meshes` are those of the scene.
    pub fn give_mesh(&self, node: &mut Node, mesh: Option<u32>, meshes: &[Mesh]) {
        if node.mesh == mesh {
            return;
        }
        let largest = mesh.and_then(|mesh| self.0.get(mesh as usize)).copied().unwrap_or(0.0);
        let sphere = |mesh: Option<u32>| Sphere::around(meshes.get(mesh? as usize)?);
        let spheres = sphere(node.mesh).zip(sphere(mesh));
        let crowd = |before: f32| {
            let kept = spheres.map_or(0.0, |(old, new)| kept_crowd(before, old, new));
            kept.max(largest)
        };
        node.crowd = crowd(node.crowd);
        for copy in &mut node.instances {
            copy.crowd = crowd(copy.crowd);
        }
        node.mesh = mesh;
    }
}

/// A sphere around a mesh, in its own space.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: DVec3,
    radius: f64,
}

impl Sphere {
    /// Around the box of a mesh; `None` if it is empty.
    fn around(mesh: &Mesh) -> Option<Self> {
        let corners = mesh.primitives.iter().map(|of| {
            let (min, max) = (of.min.as_dvec3(), of.max.as_dvec3());
            (of.origin + min, of.origin + max)
        });
        let (min, max) = corners.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some(Self { center: (min + max) / 2.0, radius: (max - min).length() / 2.0 })
    }
}

/// The crowd of a node that had another mesh before, in radii of the new one: it reaches as far as
/// before. 0 of a node that stood alone.
fn kept_crowd(before: f32, old: Sphere, new: Sphere) -> f32 {
    if before <= 1.0 {
        return 0.0;
    }
    if before.is_infinite() {
        return before;
    }
    let reach = f64::from(before) * old.radius + old.center.distance(new.center);
    let crowd = ((reach / new.radius) as f32).next_up();
    if crowd.is_finite() { crowd } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};
    use polyptych_files::blob::BlobHash;

    use super::*;
    use crate::{IndexFormat, Instance, Primitive, Topology, VertexLayout};

    /// A cube of this side around a point.
    fn cube(center: f32, side: f32) -> Mesh {
        let half = Vec3::splat(side / 2.0);
        let primitive = Primitive {
            blob: BlobHash([0; 32]),
            layout: VertexLayout::default(),
            vertex_count: 3,
            index_count: 3,
            coarser_index_count: 0,
            meshlet_count: 0,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
            index_format: IndexFormat::U16,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::X * f64::from(center),
            min: -half,
            max: half,
        };
        Mesh { primitives: vec![primitive], ..Mesh::default() }
    }

    fn node(mesh: Option<u32>, crowd: f32) -> Node {
        Node { mesh, crowd, ..Node::default() }
    }

    /// Crowds of a file of six meshes: a wall of the first, others that stand alone, and the last
    /// one nowhere.
    fn crowds() -> MeshCrowds {
        let alone = (1..5).map(|mesh| node(Some(mesh), 0.0));
        let nodes = [node(Some(0), 8.0), node(Some(0), 20.0)].into_iter().chain(alone).collect();
        MeshCrowds::of_file(&Scene { nodes, meshes: vec![Mesh::default(); 6], ..Scene::default() })
    }

    #[test]
    fn a_node_is_in_the_largest_crowd_of_its_new_mesh_or_stays_in_its_own() {
        let meshes = [cube(0.0, 1.0), cube(0.0, 1.0), cube(0.0, 2.0), cube(3.0, 0.5)];
        let given = |before: Option<u32>, crowd: f32, mesh: u32| {
            let mut node = node(before, crowd);
            crowds().give_mesh(&mut node, Some(mesh), &meshes);
            assert_eq!(node.mesh, Some(mesh));
            node.crowd
        };
        assert_eq!([given(None, 0.0, 0), given(None, 0.0, 1)], [20.0, 0.0], "a node that is made");
        assert_eq!(given(Some(1), 0.0, 0), 20.0);
        assert_eq!(given(Some(1), 0.0, 2), 0.0, "alone before and now");
        assert_eq!(given(Some(0), 8.0, 0), 8.0, "its own mesh again");
        // It reaches as far as before, from the middle of the new mesh.
        let close = |crowd: f32, to: f32| (to..to * 1.001).contains(&crowd);
        assert!(close(given(Some(0), 8.0, 1), 8.0) && close(given(Some(0), 8.0, 2), 4.0));
        let aside = (8.0 * 0.75_f32.sqrt() + 3.0) / (0.25 * 3.0_f32.sqrt());
        assert!(close(given(Some(0), 8.0, 3), aside * 0.9999), "{aside}");
        assert!(close(given(Some(2), 1000.0, 0), 2000.0));
    }

    #[test]
    fn a_mesh_without_a_place_in_its_file_is_in_an_endless_crowd() {
        let meshes = vec![cube(0.0, 1.0); 6];
        let mut node = node(None, 0.0);
        crowds().give_mesh(&mut node, Some(5), &meshes);
        assert_eq!(node.crowd, f32::INFINITY);
        crowds().give_mesh(&mut node, Some(1), &meshes);
        assert_eq!(node.crowd, f32::INFINITY, "it may be part of what it was part of");
    }

    #[test]
    fn each_copy_has_its_own_and_broken_meshes_are_borne() {
        let meshes = [cube(0.0, 1.0), cube(0.0, 1.0), cube(0.0, 0.0), Mesh::default()];
        let copy = |crowd: f32| Instance {
            translation: Vec3::ZERO,
            rotation: Quat::IDENTITY,
            scale: Vec3::ONE,
            crowd,
        };
        let mut row = node(Some(0), 8.0);
        row.instances = [0.0, 8.0, 1.0].map(copy).into();
        crowds().give_mesh(&mut row, Some(1), &meshes);
        let of_copies: Vec<f32> = row.instances.iter().map(|copy| copy.crowd).collect();
        assert!(of_copies[1] > 7.9 && row.crowd == of_copies[1], "{of_copies:?}");
        assert_eq!([of_copies[0], of_copies[2]], [0.0; 2]);
        for mesh in [Some(2), Some(3), Some(4), Some(99), None] {
            let mut node = node(Some(0), 8.0);
            crowds().give_mesh(&mut node, mesh, &meshes);
            assert_eq!((node.mesh, node.crowd), (mesh, 0.0));
        }
    }
}
