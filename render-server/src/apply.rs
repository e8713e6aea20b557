//! What travels becomes what is drawn: the only file that knows both worlds.

use glam::{DMat3, DMat4, DVec3};
use polyptych_protocol::camera::Camera;
use polyptych_protocol::command::{Area, Frame, View};
use polyptych_protocol::ids::ChannelId;
use polyptych_protocol::limits::VIEWS_MAX;
use polyptych_protocol::scene::{
    self, Filter, IndexFormat, Scene, Texture, TextureFormat, TextureRef,
};
use polyptych_protocol::wall::{EyeOf, Wall};

use crate::renderer::{
    AlphaMode, InstanceDesc, LightDesc, LightKind, MaterialDesc, MeshDesc, MipFilter, NodeDesc,
    PrimitiveDesc, SamplerDesc, SceneDesc, TextureDesc, TextureUse, Topology, VertexLayout,
    ViewDesc, Wrap,
};

/// A manifest as the renderer takes it.
pub fn scene(scene: &Scene) -> SceneDesc {
    SceneDesc {
        nodes: scene.nodes.iter().map(node).collect(),
        meshes: scene.meshes.iter().map(mesh).collect(),
        materials: scene.materials.iter().map(material).collect(),
        textures: scene.textures.iter().map(texture).collect(),
        lights: scene.lights.iter().map(light).collect(),
        sky: scene.sky,
    }
}

fn node(node: &scene::Node) -> NodeDesc {
    let instance = |i: &scene::Instance| InstanceDesc {
        translation: i.translation,
        rotation: i.rotation,
        scale: i.scale,
    };
    NodeDesc {
        parent: node.parent,
        local: node.local,
        mesh: node.mesh,
        light: node.light,
        instances: node.instances.iter().map(instance).collect(),
    }
}

fn mesh(mesh: &scene::Mesh) -> MeshDesc {
    MeshDesc { primitives: mesh.primitives.iter().map(primitive).collect() }
}

fn primitive(primitive: &scene::Primitive) -> PrimitiveDesc {
    let layout = primitive.layout;
    PrimitiveDesc {
        content: Some(primitive.blob.0),
        layout: VertexLayout {
            tangent: layout.tangent,
            uv0: layout.uv0,
            uv1: layout.uv1,
            color: layout.color,
        },
        vertex_count: primitive.vertex_count,
        index_count: primitive.index_count,
        wide_indices: primitive.index_format == IndexFormat::U32,
        topology: match primitive.topology {
            scene::Topology::Points => Topology::Points,
            scene::Topology::Lines => Topology::Lines,
            scene::Topology::Triangles => Topology::Triangles,
        },
        material: primitive.material,
        origin: primitive.origin,
        min: primitive.min,
        max: primitive.max,
    }
}

fn material(material: &scene::Material) -> MaterialDesc {
    let used = |texture: &Option<TextureRef>| {
        texture.map(|t| TextureUse {
            texture: t.texture,
            uv_set: t.uv_set,
            uv_transform: t.uv_transform,
        })
    };
    MaterialDesc {
        base_color: material.base_color,
        metallic: material.metallic,
        roughness: material.roughness,
        emissive: material.emissive,
        normal_scale: material.normal_scale,
        occlusion_strength: material.occlusion_strength,
        alpha_mode: match material.alpha_mode {
            scene::AlphaMode::Opaque => AlphaMode::Opaque,
            scene::AlphaMode::Mask(cutoff) => AlphaMode::Mask(cutoff),
            scene::AlphaMode::Blend => AlphaMode::Blend,
        },
        double_sided: material.double_sided,
        unlit: material.unlit,
        base_color_texture: used(&material.base_color_texture),
        metallic_roughness_texture: used(&material.metallic_roughness_texture),
        normal_texture: used(&material.normal_texture),
        occlusion_texture: used(&material.occlusion_texture),
        emissive_texture: used(&material.emissive_texture),
    }
}

fn texture(texture: &Texture) -> TextureDesc {
    let wrap = |wrap| match wrap {
        scene::Wrap::Clamp => Wrap::Clamp,
        scene::Wrap::Mirror => Wrap::Mirror,
        scene::Wrap::Repeat => Wrap::Repeat,
    };
    let sampler = texture.sampler;
    TextureDesc {
        content: Some(texture.blob.0),
        srgb: texture.format == TextureFormat::Rgba8Srgb,
        width: texture.width,
        height: texture.height,
        mip_count: texture.mip_count,
        sampler: SamplerDesc {
            mag_linear: sampler.mag == Filter::Linear,
            min_linear: sampler.min == Filter::Linear,
            mip: match sampler.mip {
                scene::MipFilter::None => MipFilter::None,
                scene::MipFilter::Nearest => MipFilter::Nearest,
                scene::MipFilter::Linear => MipFilter::Linear,
            },
            wrap_u: wrap(sampler.wrap_u),
            wrap_v: wrap(sampler.wrap_v),
        },
    }
}

fn light(light: &scene::Light) -> LightDesc {
    LightDesc {
        kind: match light.kind {
            scene::LightKind::Directional => LightKind::Directional,
            scene::LightKind::Point => LightKind::Point,
            scene::LightKind::Spot { inner_rad, outer_rad } => {
                LightKind::Spot { inner_rad, outer_rad }
            }
        },
        color: light.color,
        intensity: light.intensity,
        range: light.range,
    }
}

/// From where, and onto which pixels, a channel or a part of it is seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    /// In metres of display space.
    pub eye_in_display: DVec3,
    /// Turns a vector from the eye in display space into view space.
    pub view_from_display: DMat3,
    /// As [`ViewDesc::clip_from_view`].
    pub clip_from_view: DMat4,
    /// As [`ViewDesc::viewport`].
    pub viewport: [f64; 4],
}

impl Sight {
    /// A camera's view from here.
    pub fn view(&self, camera: &Camera, scissor: Option<[u32; 4]>, exposure: f32) -> ViewDesc {
        // World to display space, the eye being the origin of both, then to the screen's axes;
        // a view is in metres, whatever the world's unit.
        let display_from_world =
            DMat3::from_quat(camera.rotation).transpose() * camera.scale.recip();
        ViewDesc {
            eye_in_world: camera.world_from_display(self.eye_in_display),
            view_from_world: self.view_from_display * display_from_world,
            clip_from_view: self.clip_from_view,
            viewport: self.viewport,
            scissor,
            exposure,
        }
    }
}

/// Says why a frame's views cannot be drawn, if they cannot.
///
/// # Errors
/// Too many of them, or what this server cannot draw.
pub(crate) fn drawable(frame: &Frame) -> Result<(), String> {
    if frame.views.len() > VIEWS_MAX {
        return Err(format!("{} views, where {VIEWS_MAX} can be", frame.views.len()));
    }
    if frame.views.iter().any(|view| view.scene_root.is_some()) {
        // Said, rather than showing more than was asked for.
        return Err("this server draws whole scenes only, not the part under a node".to_owned());
    }
    Ok(())
}

/// The views of a frame that a channel shows, as it sees them.
///
/// # Errors
/// An eye that no frustum can be made for.
pub fn views(wall: &Wall, channel: ChannelId, frame: &Frame) -> Result<Vec<ViewDesc>, String> {
    drawable(frame)?;
    let eye_of = wall.channel(channel).map_or_else(EyeOf::default, |c| c.adjustment.eye);
    let eye = frame.head.eye(eye_of);
    let frustum = wall.frustum(channel, eye).map_err(|error| error.to_string())?;
    let sight = Sight {
        eye_in_display: frustum.eye,
        view_from_display: frustum.view_from_display,
        clip_from_view: frustum.clip_from_view,
        viewport: frustum.viewport,
    };
    let views = frame.views.iter().filter_map(|view| {
        let scissor = scissor(wall, channel, view)?;
        Some(sight.view(&view.camera, scissor, frame.exposure))
    });
    Ok(views.collect())
}

/// The rectangle of a channel that a view covers: `None` where it covers nothing, `Some(None)`
/// where all of it.
#[expect(clippy::option_option, reason = "nothing, everything and a part are three things")]
pub(crate) fn scissor(wall: &Wall, id: ChannelId, view: &View) -> Option<Option<[u32; 4]>> {
    let Area::Screen { screen, rect: [x, y, width, height] } = view.area else {
        return Some(None);
    };
    let channel = wall.channel(id).filter(|channel| channel.screen == screen)?;
    let from = |start: u32, origin: u32| start.max(origin);
    let (left, top) = (from(x, channel.origin.x), from(y, channel.origin.y));
    let right = x.saturating_add(width).min(channel.origin.x + channel.size.x);
    let bottom = y.saturating_add(height).min(channel.origin.y + channel.size.y);
    let is_covered = left < right && top < bottom;
    is_covered.then(|| {
        Some([left - channel.origin.x, top - channel.origin.y, right - left, bottom - top])
    })
}

/// The view with which a new scene is drawn once before anyone sees it: from its edge, so that
/// all of its pipelines are used.
pub fn warm_up_camera(scene: &Scene) -> Camera {
    let Some(bounds) = scene.bounds else { return Camera::IDENTITY };
    let back = DVec3::new(0.0, 0.5, 2.5) * bounds.radius().max(1e-9);
    Camera::look_at(bounds.center() + back, bounds.center(), DVec3::Y)
}
