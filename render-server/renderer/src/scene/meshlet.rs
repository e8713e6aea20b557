//! Parts of a large primitive that are culled on their own: what a channel does not see of a mesh
//! should cost it no vertex work.
//!
//! A cluster is a run of triangles in the order of the blob, so leaving one out changes neither
//! the order nor the pixels of the others. It is culled where its box lies outside the channel's
//! rectangle, and where all of its triangles face away from the eye, whom all channels share.

use glam::{DVec3, Vec3};
use polyptych_scene::{IndexFormat, Primitive, Topology};

/// Triangles of a cluster: few enough to be compact, enough that testing one costs a thousandth
/// of drawing it.
const CLUSTER_TRIANGLES: usize = 256;

/// Primitives below this many clusters are drawn whole: they are small, or many instances.
const CLUSTERS_MIN: usize = 8;

/// A run of triangles and what bounds it, in the primitive's space.
#[derive(Clone, Debug)]
pub(crate) struct Meshlet {
    pub first_index: u32,
    pub index_count: u32,
    pub center: DVec3,
    pub half: DVec3,
    /// The middle of the triangles' normals, and the sine of the widest angle to it; `None` where
    /// they point in too many directions.
    pub cone: Option<(DVec3, f64)>,
}

impl Meshlet {
    /// Whether all triangles face away from an eye in the primitive's space, by a margin that
    /// rounding does not reach.
    ///
    /// As in Olano and others, and Zeux's meshoptimizer: with the eye at distance d from the
    /// middle, no triangle faces it where `toward · axis ≥ sine · d + radius`.
    pub fn faces_away_from(&self, eye: DVec3) -> bool {
        /// A share of the distance: triangles seen edge-on are left to the GPU.
        const MARGIN: f64 = 1e-3;
        let Some((axis, sine)) = self.cone else { return false };
        let away = self.center - eye;
        let distance = away.length();
        away.dot(axis) >= (sine + MARGIN) * distance + self.half.length()
    }

    /// The same for rays in one direction, of unit length: from infinitely far the cluster has no
    /// extent.
    pub fn faces_along(&self, rays: DVec3) -> bool {
        const MARGIN: f64 = 1e-3;
        self.cone.is_some_and(|(axis, sine)| rays.dot(axis) >= sine + MARGIN)
    }
}

/// The clusters of a primitive's checked bytes; none where it is small, or not of triangles.
pub(crate) fn meshlets(desc: &Primitive, bytes: &[u8]) -> Vec<Meshlet> {
    let triangles = desc.index_count as usize / 3;
    if desc.topology != Topology::Triangles || triangles < CLUSTERS_MIN * CLUSTER_TRIANGLES {
        return Vec::new();
    }
    let (vertices, indices) = bytes.split_at(desc.vertex_bytes() as usize);
    let stride = desc.layout.stride() as usize;
    let position = |index: u32| {
        let start = index as usize * stride;
        let (words, _) = vertices[start..start + 12].as_chunks::<4>();
        let [x, y, z] = [0, 1, 2].map(|axis| f32::from_le_bytes(words[axis]));
        Vec3::new(x, y, z)
    };
    let index = |at: usize| {
        if desc.index_format == IndexFormat::U32 {
            let (words, _) = indices.as_chunks::<4>();
            u32::from_le_bytes(words[at])
        } else {
            let (words, _) = indices.as_chunks::<2>();
            u32::from(u16::from_le_bytes(words[at]))
        }
    };
    let corner = |triangle: usize| [0, 1, 2].map(|i| position(index(triangle * 3 + i)));
    let starts = (0..triangles).step_by(CLUSTER_TRIANGLES);
    starts
        .map(|start| {
            let end = (start + CLUSTER_TRIANGLES).min(triangles);
            let corners: Vec<[Vec3; 3]> = (start..end).map(corner).collect();
            cluster(start as u32 * 3, &corners)
        })
        .collect()
}

fn cluster(first_index: u32, triangles: &[[Vec3; 3]]) -> Meshlet {
    let points = || triangles.iter().flatten().map(|point| point.as_dvec3());
    let min = points().fold(DVec3::MAX, DVec3::min);
    let max = points().fold(DVec3::MIN, DVec3::max);
    // A triangle without area is not drawn, wherever it faces.
    let normals = || {
        triangles.iter().filter_map(|[a, b, c]| {
            let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
            (b - a).cross(c - a).try_normalize()
        })
    };
    let axis = normals().sum::<DVec3>().try_normalize();
    let cone = axis.and_then(|axis| {
        let cosine = normals().map(|normal| normal.dot(axis)).fold(1.0, f64::min);
        // Beyond 80 degrees hardly any eye sees none of them.
        (cosine > 0.17).then(|| (axis, (1.0 - cosine * cosine).max(0.0).sqrt()))
    });
    Meshlet {
        first_index,
        index_count: triangles.len() as u32 * 3,
        center: (min + max) * 0.5,
        half: (max - min) * 0.5,
        cone,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use polyptych_files::blob::BlobHash;
    use polyptych_scene::VertexLayout;

    /// A sphere of triangles around the origin, counter-clockwise from outside.
    fn sphere(rows: u32) -> (Primitive, Vec<u8>) {
        let mut vertices = Vec::new();
        for row in 0..=rows {
            for column in 0..=rows {
                let turn = f64::from(column) / f64::from(rows) * std::f64::consts::TAU;
                let down = f64::from(row) / f64::from(rows) * std::f64::consts::PI;
                let (sin_t, cos_t) = turn.sin_cos();
                let (sin_d, cos_d) = down.sin_cos();
                let point = DVec3::new(sin_d * sin_t, cos_d, sin_d * cos_t).as_vec3();
                vertices.extend_from_slice(bytemuck::bytes_of(&[point.to_array(); 2]));
            }
        }
        let mut indices: Vec<u32> = Vec::new();
        for row in 0..rows {
            for column in 0..rows {
                let a = row * (rows + 1) + column;
                let b = a + rows + 1;
                indices.extend([a, b, a + 1, a + 1, b, b + 1]);
            }
        }
        let desc = Primitive {
            blob: BlobHash([0; 32]),
            layout: VertexLayout::default(),
            vertex_count: (rows + 1) * (rows + 1),
            index_count: indices.len() as u32,
            coarser_index_count: 0,
            meshlet_count: 0,
            index_format: IndexFormat::U32,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::ZERO,
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        };
        vertices.extend_from_slice(bytemuck::cast_slice(&indices));
        (desc, vertices)
    }

    #[test]
    fn clusters_that_face_away_hold_no_triangle_that_faces_the_eye() {
        let (desc, bytes) = sphere(64);
        let all = meshlets(&desc, &bytes);
        assert_eq!(all.iter().map(|c| c.index_count).sum::<u32>(), desc.index_count);
        let (vertices, indices) = bytes.split_at(desc.vertex_bytes() as usize);
        let indices: &[u32] = bytemuck::cast_slice(indices);
        let position = |index: u32| {
            let vertex: [f32; 6] = *bytemuck::from_bytes(&vertices[index as usize * 24..][..24]);
            Vec3::new(vertex[0], vertex[1], vertex[2]).as_dvec3()
        };
        let mut away = 0;
        for eye in [DVec3::new(0.0, 0.0, 4.0), DVec3::new(3.0, 1.0, -2.0), DVec3::Y * 1.05] {
            for cluster in all.iter().filter(|cluster| cluster.faces_away_from(eye)) {
                away += 1;
                let first = cluster.first_index as usize;
                for triangle in indices[first..first + cluster.index_count as usize].chunks(3) {
                    let [a, b, c] = [0, 1, 2].map(|i| position(triangle[i]));
                    assert!((b - a).cross(c - a).dot(eye - a) <= 0.0, "it faces {eye}");
                }
            }
        }
        assert!(away > 10, "only {away} clusters were found to face away");
    }

    #[test]
    fn triangles_without_area_or_bounds_hide_nothing() {
        let flat = cluster(0, &[[Vec3::ZERO; 3]]);
        assert!(!flat.faces_away_from(DVec3::Z));
        let wild = cluster(0, &[[Vec3::ZERO, Vec3::NAN, Vec3::X]]);
        assert!(!wild.faces_away_from(DVec3::Z));
    }
}
