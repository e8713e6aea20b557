//! The picture of a channel of a wall, without any process or socket: baked, applied and rendered
//! by the program's own code.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::UVec2;
use image::RgbaImage;
use polyptych_baker::{BakeCache, bake};
use polyptych_client::{Bounds, Camera, Presentation, Wall};
use polyptych_protocol::command::Frame;
use polyptych_protocol::ids::{Epoch, FrameId, Revision};
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_render::frame_views;
use polyptych_renderer::{GpuScene, Renderer, SceneBuilder, Target, ViewDesc, read_pixels};
use polyptych_wall::ChannelId;

use super::adapter::gpu;
use super::place::TestDir;
use crate::reference;

/// A renderer with a scene, which draws channels of walls.
pub struct RenderFixture {
    renderer: Renderer,
    scene: GpuScene,
    pub bounds: Bounds,
}

impl RenderFixture {
    pub fn new(path: &Path) -> Self {
        let place = TestDir::new();
        let store = BakeCache::open(place.path("store")).expect("a store");
        let baked = bake(path, &store, &mut |_| {}, &AtomicBool::new(false)).expect("baked");
        let blob = |hash| store.blobs().read(hash).expect("readable").expect("there");
        let manifest = polyptych_scene::decode(&blob(baked.manifest)).expect("a manifest");
        let gpu = gpu();
        let mut builder = SceneBuilder::new(gpu, manifest.clone()).expect("described");
        for (index, texture) in manifest.textures.iter().enumerate() {
            builder.upload_texture(gpu, index, &blob(texture.blob)).expect("a texture");
        }
        for (mesh, described) in manifest.meshes.iter().enumerate() {
            for (index, primitive) in described.primitives.iter().enumerate() {
                let bytes = blob(primitive.blob);
                builder.upload_primitive(gpu, mesh, index, &bytes).expect("a primitive");
            }
        }
        let scene = builder.finish(gpu).expect("a scene");
        let mut renderer = Renderer::new(gpu, 1).expect("a renderer");
        renderer.prepare(gpu, &scene);
        Self { renderer, scene, bounds: manifest.bounds.expect("something to see") }
    }

    /// Creates the fixture for a glTF made in code.
    pub fn of(gltf: &super::scenes::Gltf) -> Self {
        let place = TestDir::new();
        Self::new(&place.write("scene.glb", gltf.glb()))
    }

    pub fn draw(&mut self, size: UVec2, views: &[ViewDesc]) -> RgbaImage {
        let gpu = gpu();
        let blends = self.scene.has_transparency();
        let mut target = Target::new(gpu, size.to_array(), 1, blends).expect("a target");
        self.renderer.draw(gpu, &self.scene, &mut target, views).expect("drawn");
        let pixels = read_pixels(gpu, &target).expect("read back");
        RgbaImage::from_raw(size.x, size.y, pixels).expect("as many bytes as pixels")
    }

    /// Returns the picture of a channel.
    pub fn channel(&mut self, wall: &Wall, id: ChannelId, camera: Camera) -> RgbaImage {
        let size = wall.channel(id).expect("a channel").size;
        let views = frame_views::views(wall, id, &frame(wall, camera)).expect("views");
        self.draw(size, &views)
    }
}

/// A frame as a manager would order it.
pub fn frame(wall: &Wall, camera: Camera) -> Frame {
    Frame {
        epoch: Epoch(1),
        frame: FrameId(1),
        time_s: 0.0,
        revision: Revision(1),
        presentation: Presentation { camera, ..Presentation::new(wall.head()) },
        capture: None,
        detail: DetailBound::default(),
        clips: Vec::new(),
        is_metered: false,
    }
}

/// Returns the numbers of the wall file that the reference needs for a channel.
pub fn seat(wall: &Wall, id: ChannelId) -> reference::view::ScreenView {
    let channel = wall.channel(id).expect("a channel");
    let screen = wall.screen_of(channel);
    let plane = screen.plane().expect("a planar screen");
    reference::view::ScreenView {
        corners: [plane.lower_left, plane.lower_right, plane.upper_left],
        canvas: screen.canvas.to_array(),
        origin: channel.origin.to_array(),
        size: channel.size.to_array(),
        eye: wall.head().eye(channel.adjustment.eye),
        near_m: wall.near_m,
    }
}

/// The reference's view of a channel.
pub fn reference_view(
    wall: &Wall,
    id: ChannelId,
    camera: Camera,
) -> Result<reference::view::View, String> {
    let Camera { position, rotation, scale } = camera;
    let pose = reference::view::Pose { position, rotation, scale };
    reference::view::View::new(&seat(wall, id), &pose)
}
