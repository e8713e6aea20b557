//! Opaque and masked surfaces, near to far.

use crate::frame::{DrawContext, ListPart};

/// The fragment stage.
pub(crate) const SOURCE: &str = include_str!("opaque.wgsl");

/// Draws the opaque draws of all views.
pub(crate) fn encode(pass: &mut wgpu::RenderPass<'_>, context: &DrawContext<'_>) {
    for view in 0..context.lists.len() {
        context.draw(pass, view, ListPart::Opaque);
    }
}
