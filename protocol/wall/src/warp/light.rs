//! The light that a mesh says at its corners, for each pixel of a channel.

use glam::{DVec2, UVec2};

use super::{Mask, WarpGeometry, WarpMap};
use crate::channel_mapping::ChannelMapping;
use crate::mesh_bvh::MeshBvh;
use crate::warp_mesh::{WarpMesh, WarpVertex};

impl WarpMap {
    /// Factors of the pixels of a channel of this size, linear in the picture between the corners
    /// of triangles and zero beside them; `pixels` has its corner pins and bends. `None` where
    /// every corner has all of its light.
    pub fn light_mask(&self, size: UVec2, pixels: &ChannelMapping<'_>) -> Option<Mask> {
        let WarpGeometry::Mesh(mesh) = &self.shape else { return None };
        if mesh.vertices.iter().all(|vertex| vertex.light >= 1.0) {
            return None;
        }
        // A relief over the picture, as high as it is light.
        let vertex = |vertex: &super::ImportedVertex| {
            let pixel = vertex.place.as_dvec2();
            WarpVertex { pixel, point: pixel.extend(f64::from(vertex.light)) }
        };
        let vertices = mesh.vertices.iter().map(vertex).collect();
        let relief = MeshBvh::new(WarpMesh { vertices, triangles: mesh.triangles.clone() });
        let texel = |x: u32, y: u32| {
            let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let place = pixels.ideal_from_pixel(pixel).map(|meant| meant / size.as_dvec2());
            let light = place.and_then(|place| relief.point_at(place)).map_or(0.0, |at| at.z);
            (light.clamp(0.0, 1.0) * f64::from(u16::MAX)).round() as u16
        };
        let all = (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y)));
        let texels = all.map(|(x, y)| texel(x, y)).collect();
        Some(Mask { size, components: 1, texels })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec2};

    use super::super::{ImportedMesh as Mesh, ImportedVertex as Vertex, MapCoordinates};
    use super::*;
    use crate::surface::Plane;
    use crate::{Channel, Screen, Surface};

    /// A ramp from dark at the left to light in the middle, and nothing in the right third.
    fn ramp() -> WarpMap {
        let vertex = |u: f32, v: f32, light: f32| Vertex {
            place: Vec2::new(u, v),
            value: Vec2::new(u, v).extend(0.0),
            light,
        };
        let mut vertices = Vec::new();
        for (u, light) in [(0.0, 0.0), (1.0 / 3.0, 1.0), (2.0 / 3.0, 0.5)] {
            vertices.extend([vertex(u, 0.0, light), vertex(u, 1.0, light)]);
        }
        let triangles = vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]];
        let mesh = Mesh { vertices, triangles };
        WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Mesh(mesh) }
    }

    fn stage() -> (Channel, Screen) {
        let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0));
        let screen = Screen::new("s", Surface::Plane(plane), UVec2::new(90, 30));
        (Channel::tile("c", 0, UVec2::ZERO, UVec2::new(90, 30)), screen)
    }

    fn light(mask: &Mask, x: u32, y: u32) -> f64 {
        f64::from(mask.at(x, y)[0]) / 65535.0
    }

    #[test]
    fn light_is_linear_between_corners_and_none_beside_them() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("a picture");
        let mask = ramp().light_mask(channel.size, &pixels).expect("a mask");
        for (x, y) in (0..90).flat_map(|x| (0..30).map(move |y| (x, y))) {
            let place = (f64::from(x) + 0.5) / 30.0;
            let due = match x {
                0..30 => place,
                30..60 => 1.5 - place / 2.0,
                _ => 0.0,
            };
            let found = light(&mask, x, y);
            assert!((found - due).abs() < 1.0 / 65535.0, "{x}, {y}: {found}, {due}");
        }
    }

    #[test]
    fn light_moves_with_the_pins() {
        let (mut channel, screen) = stage();
        channel.adjustment.pin = [DVec2::X * 6.0; 4];
        let pixels = ChannelMapping::new(&channel, &screen).expect("a picture");
        let mask = ramp().light_mask(channel.size, &pixels).expect("a mask");
        assert_eq!(mask.at(5, 3), [0; 3], "beside it");
        assert!((light(&mask, 16, 3) - 10.5 / 30.0).abs() < 1.0 / 65535.0);
    }

    #[test]
    fn full_light_is_no_mask() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("a picture");
        let mut map = ramp();
        let WarpGeometry::Mesh(mesh) = &mut map.shape else { panic!("a mesh") };
        mesh.vertices.iter_mut().for_each(|vertex| vertex.light = 1.0);
        assert_eq!(map.light_mask(channel.size, &pixels), None);
    }
}
