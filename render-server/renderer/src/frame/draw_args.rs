//! The arguments of draws that the GPU reads by itself: one command of the processor draws all that
//! follow each other and have pipeline, material and buffers in common.

use wgpu::util::DrawIndexedIndirectArgs;

use crate::draw_list::{Draw, DrawList};
use crate::scene::{Geometry, GpuScene};

/// Bytes of the arguments of a draw.
pub(super) const ARGS_BYTES: u64 = size_of::<DrawIndexedIndirectArgs>() as u64;

/// The arguments of a draw of at most so many indices of a geometry.
pub(super) fn args(geometry: &Geometry, draw: &Draw, count_max: u32) -> DrawIndexedIndirectArgs {
    let [start, count] = draw.indices;
    DrawIndexedIndirectArgs {
        index_count: count.min(count_max),
        instance_count: draw.count,
        first_index: if draw.ordered { 0 } else { geometry.first_index } + start,
        base_vertex: geometry.first_vertex as i32,
        first_instance: draw.first,
    }
}

/// The arguments of the draws of lists, those of what is opaque first in each; `first` gets the
/// number of those before each list.
pub(super) fn of_lists(scene: &GpuScene, lists: &[DrawList], first: &mut Vec<u32>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for list in lists {
        first.push((bytes.len() as u64 / ARGS_BYTES) as u32);
        for draw in list.opaque.iter().chain(&list.transparent) {
            let args = args(scene.geometry_of(draw.batch), draw, u32::MAX);
            bytes.extend_from_slice(args.as_bytes());
        }
    }
    bytes
}
