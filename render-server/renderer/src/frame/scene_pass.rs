//! The render pass over a scene's surfaces.

use super::DrawContext;
use crate::pass::background::BackgroundDraw;
use crate::pass::{opaque, transparent};
use crate::target::Target;

/// Encodes the pass: what is opaque, the surroundings, and what is drawn over them. It begins with
/// a colour, and with the depth that the target has if so given.
pub(super) fn encode_scene(
    encoder: &mut wgpu::CommandEncoder,
    target: &Target,
    (sky, has_depth): (wgpu::Color, bool),
    context: &DrawContext<'_>,
    background: Option<&BackgroundDraw>,
) {
    let mut pass = begin(encoder, target, sky, has_depth);
    opaque::encode(&mut pass, context);
    if let Some(background) = background {
        background.encode(&mut pass, context);
    }
    transparent::encode(&mut pass, context);
}

/// Begins the pass over the scene, with the depth that the target has or with none.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    target: &Target,
    sky: wgpu::Color,
    has_depth: bool,
) -> wgpu::RenderPass<'a> {
    let (view, resolve_target) = target.scene();
    // What has been resolved need not be kept.
    let store =
        if resolve_target.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("scene/pass"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(sky), store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: target.depth(),
            depth_ops: Some(wgpu::Operations {
                load: if has_depth { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(0.0) },
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
