//! Tests that draw. They need a Vulkan or GL driver, software ones included, and fail without.

mod ambient_occlusion;
mod anisotropy;
mod changed_looks;
mod correction;
mod diffuse_transmission;
mod environment;
mod extension_textures;
mod extensions;
mod fog;
mod furnace;
mod glow;
mod gpu_faults;
#[expect(dead_code, reason = "the render server's tests use the rest")]
mod harness;
mod iridescence;
mod labels;
mod lamp_grid;
mod lamp_shadows;
mod level_choice;
mod levels;
mod light_meter;
mod moved;
mod moving_shadows;
mod occlusion;
mod order;
mod parallel;
mod robustness;
mod shaders;
mod shading;
mod shadows;
mod targets_together;
mod terrain;
mod tiles;
mod transmission;
mod triangle_order;
mod unlit;
