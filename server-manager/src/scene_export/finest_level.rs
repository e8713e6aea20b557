//! The finest level of a primitive, without the vertices that only coarser levels name.

use std::borrow::Cow;

use polyptych_scene::{IndexFormat, Primitive};

/// Vertices and indices of a finest level, as they are exported.
#[derive(Debug)]
pub(super) struct FinestLevel<'a> {
    pub vertices: Cow<'a, [u8]>,
    /// In the format of the primitive.
    pub indices: Cow<'a, [u8]>,
    pub vertex_count: u32,
}

impl<'a> FinestLevel<'a> {
    /// That of a primitive in its blob, which is as long as the primitive says.
    pub fn of(primitive: &Primitive, blob: &'a [u8]) -> Self {
        let vertices = &blob[..primitive.vertex_bytes() as usize];
        let indices = primitive.finest_indices_of(blob);
        let vertex_count = primitive.vertex_count;
        if primitive.meshlet_count == 0 {
            return Self { vertices: vertices.into(), indices, vertex_count };
        }
        let numbers: Vec<u32> = primitive.index_format.numbers(&indices).collect();
        let mut new_of = vec![0; vertex_count as usize];
        for index in &numbers {
            if let Some(new) = new_of.get_mut(*index as usize) {
                *new = 1;
            }
        }
        let rows = vertices.chunks_exact(primitive.layout.stride() as usize);
        let (mut used, mut count) = (Vec::with_capacity(vertices.len()), 0);
        for (row, new) in rows.zip(&mut new_of) {
            if std::mem::replace(new, count) == 1 {
                used.extend_from_slice(row);
                count += 1;
            }
        }
        let renumbered = numbers.iter().map(|at| new_of.get(*at as usize).copied().unwrap_or(0));
        let indices: Vec<u8> = match primitive.index_format {
            IndexFormat::U16 => renumbered.flat_map(|new| (new as u16).to_le_bytes()).collect(),
            IndexFormat::U32 => renumbered.flat_map(u32::to_le_bytes).collect(),
        };
        Self { vertices: used.into(), indices: indices.into(), vertex_count: count }
    }
}
