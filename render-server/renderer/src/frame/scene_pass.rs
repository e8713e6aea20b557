//! The render pass over a scene's surfaces.

use crate::target::Target;

/// Begins the pass over the scene, with the depth that the target has or with none.
pub(super) fn begin<'a>(
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
