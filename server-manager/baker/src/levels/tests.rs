//! Levels of surfaces made in code, and of the assets that may lie beside.

mod colors;
mod cut;
pub(crate) mod distance;
mod hostile;
mod mirrored;
mod order;
mod parts;
mod shapes;

use std::sync::atomic::AtomicBool;

use glam::DVec3;
use polyptych_scene::meshlet::Meshlet;

use super::{Levels, build};
use shapes::Shape;

/// The levels of a shape, which has some.
fn levels(shape: &Shape) -> Levels {
    let levels = build(&[shape.surface()], &AtomicBool::new(false)).expect("not cancelled");
    let levels = levels.into_iter().next().flatten();
    levels.unwrap_or_else(|| panic!("{} has no levels", shape.name))
}

/// Meshlets that are drawn together.
struct Drawn {
    /// The vertices of the shape and of its levels.
    vertices: Vec<f32>,
    indices: Vec<u32>,
    triangles: Vec<[DVec3; 3]>,
    /// The largest error of any of them.
    error: f64,
}

impl Drawn {
    fn new(shape: &Shape, levels: &Levels, meshlets: &[Meshlet]) -> Self {
        let run = |meshlet: &Meshlet| {
            let first = meshlet.first_index as usize;
            levels.indices[first..first + meshlet.index_count as usize].to_vec()
        };
        let indices: Vec<u32> = meshlets.iter().flat_map(run).collect();
        let vertices = [&shape.vertices[..], &levels.added].concat();
        let position = |vertex: u32| {
            let row = &vertices[vertex as usize * 8..][..3];
            DVec3::new(row[0].into(), row[1].into(), row[2].into())
        };
        let triangles = indices.as_chunks::<3>().0.iter();
        let triangles = triangles.map(|corners| corners.map(position)).collect();
        let errors = meshlets.iter().map(|meshlet| f64::from(meshlet.error));
        Self { vertices, indices, triangles, error: errors.fold(0.0, f64::max) }
    }

    /// Those of which the error is within a limit and that of what replaces them is not.
    fn within(shape: &Shape, levels: &Levels, limit: f32) -> Self {
        let is_drawn = |meshlet: &&Meshlet| meshlet.error <= limit && meshlet.coarser_error > limit;
        let drawn: Vec<Meshlet> = levels.meshlets.iter().filter(is_drawn).copied().collect();
        Self::new(shape, levels, &drawn)
    }

    fn points(&self) -> impl Iterator<Item = DVec3> {
        self.triangles.iter().flatten().copied()
    }
}
