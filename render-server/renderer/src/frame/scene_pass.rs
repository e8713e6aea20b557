//! The render pass over a scene's surfaces.

use super::DrawContext;
use crate::pass::background::BackgroundDraw;
use crate::pass::{opaque, transparent};
use crate::target::Target;

/// The begin and the end of the pass.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SceneEnds {
    /// The colour that it begins with.
    pub sky: wgpu::Color,
    /// It begins with the colours that the target has.
    pub has_color: bool,
    /// It begins with the depth that the target has.
    pub has_depth: bool,
    /// Another pass begins with its colours.
    pub keeps_color: bool,
    /// Its depth is read later.
    pub keeps_depth: bool,
}

/// Encodes the pass: what is opaque, the surroundings, and what is drawn over them.
pub(super) fn encode_scene(
    encoder: &mut wgpu::CommandEncoder,
    target: &Target,
    ends: SceneEnds,
    context: &DrawContext<'_>,
    background: Option<&BackgroundDraw>,
) {
    let mut pass = begin(encoder, target, ends);
    opaque::encode(&mut pass, context);
    if let Some(background) = background {
        background.encode(&mut pass, context);
    }
    transparent::encode(&mut pass, context);
}

fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    target: &Target,
    SceneEnds { sky, has_color, has_depth, keeps_color, keeps_depth }: SceneEnds,
) -> wgpu::RenderPass<'a> {
    use wgpu::StoreOp::{Discard, Store};
    let (view, resolve_target) = target.scene();
    // What has been resolved need not be kept.
    let store = if resolve_target.is_some() && !keeps_color { Discard } else { Store };
    let load = if has_color { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(sky) };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("scene/pass"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target,
            ops: wgpu::Operations { load, store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: target.depth(),
            depth_ops: Some(wgpu::Operations {
                load: if has_depth { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(0.0) },
                store: if keeps_depth { Store } else { Discard },
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
