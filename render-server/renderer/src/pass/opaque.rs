//! Opaque and masked surfaces, near to far.

use crate::frame::DrawContext;

/// The fragment stage.
pub(crate) const SOURCE: &str = include_str!("opaque.wgsl");

/// Draws the opaque draws of all views.
pub(crate) fn encode(pass: &mut wgpu::RenderPass<'_>, context: &DrawContext<'_>) {
    for (view, list) in context.lists.iter().enumerate() {
        context.draw(pass, view, &list.opaque);
    }
}
