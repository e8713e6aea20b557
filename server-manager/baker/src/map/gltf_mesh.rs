//! glTF meshes: POSITION and TEXCOORD_0 of all nodes that are shown.
//!
//! Positions, through the nodes' transforms, are metres of display space. TEXCOORD_0 is a place on
//! the channel's picture (a screen mesh: on the screen's canvas), u to the right and v down, as
//! glTF means it.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, Vec2, Vec3};
use polyptych_files::blob::BlobStore;
use polyptych_scene::{Scene, Topology};
use polyptych_text::counted;
use polyptych_wall::warp::{
    ImportedMesh, ImportedVertex, MAP_TRIANGLES_MAX, MAP_VERTICES_MAX, MapCoordinates,
    WARP_REACH_M_MAX, WarpGeometry, WarpMap,
};

use super::super::animation::ClipTargets;
use super::super::error::BakeError;
use super::super::pose::{Pose, Vertices};
use super::super::scene_choice::SceneChoice;
use super::super::source::GltfSource;
use super::super::{BakeJob, document, geometry, node, topology};
use super::foldover;

/// Reads a mesh whose TEXCOORD_0 are places. Nothing is written to `blobs`.
pub(super) fn read(
    path: &Path,
    blobs: &BlobStore,
    cancel: &AtomicBool,
) -> Result<WarpMap, BakeError> {
    let source = GltfSource::open(path, cancel)?;
    let mut progress = |_| {};
    let choice = SceneChoice::of(&source.document, None)?;
    let mut job = BakeJob::new(&source, choice, blobs, &mut progress, cancel);
    let clips = ClipTargets::default();
    let node::Placed { nodes, meshes, .. } = node::read(&mut job, &clips, false)?;
    let scene = Scene { nodes, ..Scene::default() };
    let mut mesh = ImportedMesh { vertices: Vec::new(), triangles: Vec::new() };
    let mut origins = Vec::new();
    for (node, world) in scene.nodes.iter().zip(scene.world_from_nodes()) {
        let used = node.mesh.and_then(|used| meshes.uses.get(used as usize));
        let Some(&used) = used else { continue };
        let index = used.mesh;
        let primitives = &source.document.meshes.at(index, "nodes")?.primitives;
        for (i, primitive) in primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{i}]");
            let before = mesh.triangles.len();
            let pose = meshes.pose(used, primitive).map(|(_, pose)| pose);
            append(&mut job, primitive, pose, world, &mut mesh, &place)?;
            origins.push((before, place));
        }
    }
    if mesh.triangles.is_empty() {
        let right = "a mesh of triangles would be right";
        return Err(BakeError::at("scenes", "no node shows a triangle", right));
    }
    let place_of = |triangle: usize| {
        let part = origins.partition_point(|(first, _)| *first <= triangle);
        let (first, place) = &origins[part.saturating_sub(1)];
        format!("{place} triangle {}", triangle - first)
    };
    let mesh = foldover::check(mesh, place_of)?;
    Ok(WarpMap { space: MapCoordinates::Display, shape: WarpGeometry::Mesh(mesh) })
}

fn append(
    job: &mut BakeJob<'_>,
    primitive: &document::Primitive,
    pose: Option<&Pose>,
    world: DAffine3,
    mesh: &mut ImportedMesh,
    place: &str,
) -> Result<(), BakeError> {
    if topology::of_mode(primitive.mode) != Some(Topology::Triangles) {
        let what = format!("mode {} draws no triangles", primitive.mode);
        return Err(BakeError::at(place, what, "4, 5 or 6 would be right"));
    }
    let positions = geometry::attribute::<3>(job, primitive, "POSITION", None, place)?;
    let count = positions.as_ref().map(Vec::len);
    let places = geometry::attribute::<2>(job, primitive, "TEXCOORD_0", count, place)?;
    let (Some(mut positions), Some(places)) = (positions, places) else {
        let what = "it has no POSITION or no TEXCOORD_0";
        return Err(BakeError::at(place, what, "both would be right"));
    };
    let mut indices = geometry::indices(job, primitive, positions.len(), place)?;
    if let Some(pose) = pose {
        let vertices = Vertices { positions: &mut positions, normals: None, tangents: None };
        let mirrored = pose.apply(job, primitive, vertices, place)?;
        geometry::turn(&mut indices, &mirrored, Topology::Triangles);
    }
    let vertices = mesh.vertices.len() + positions.len();
    let triangles = mesh.triangles.len() + indices.len() / 3;
    if vertices > MAP_VERTICES_MAX as usize || triangles > MAP_TRIANGLES_MAX as usize {
        let what = format!(
            "{} and {} are too many",
            counted(vertices, "vertex"),
            counted(triangles, "triangle")
        );
        let right = format!("{MAP_VERTICES_MAX} and {MAP_TRIANGLES_MAX} would be right");
        return Err(BakeError::at(place, what, right));
    }
    let base = mesh.vertices.len() as u32;
    for (i, (position, uv)) in positions.iter().zip(&places).enumerate() {
        let value = world.transform_point3(Vec3::from(*position).as_dvec3());
        let is_near = value.abs().max_element() <= f64::from(WARP_REACH_M_MAX);
        let at = Vec2::from(*uv);
        if !is_near || !value.is_finite() || !at.is_finite() {
            let what = format!("vertex {i} is at {value} with UV {at}");
            let right = format!("finite metres, at most {WARP_REACH_M_MAX}, would be right");
            return Err(BakeError::at(place, what, right));
        }
        mesh.vertices.push(ImportedVertex { place: at, value: value.as_vec3(), light: 1.0 });
    }
    let corners = indices.chunks_exact(3).map(|c| [base + c[0], base + c[1], base + c[2]]);
    mesh.triangles.extend(corners);
    Ok(())
}
