// Group 2: a metallic-roughness material, and what of it the pipeline needs.

struct UvTransform {
    columns: vec4<f32>,
    offset: vec4<f32>,
}

struct Material {
    base_color: vec4<f32>,
    emissive: vec3<f32>,
    roughness: f32,
    metallic: f32,
    normal_scale: f32,
    occlusion_strength: f32,
    alpha_cutoff: f32,
    // Display light, and the part of it in what is shown.
    highlight: vec4<f32>,
    uv_transforms: array<UvTransform, 5>,
}

@group(2) @binding(0) var<uniform> material: Material;
@group(2) @binding(1) var base_color_texture: texture_2d<f32>;
@group(2) @binding(2) var metallic_roughness_texture: texture_2d<f32>;
@group(2) @binding(3) var normal_texture: texture_2d<f32>;
@group(2) @binding(4) var occlusion_texture: texture_2d<f32>;
@group(2) @binding(5) var emissive_texture: texture_2d<f32>;
@group(2) @binding(6) var base_color_sampler: sampler;
@group(2) @binding(7) var metallic_roughness_sampler: sampler;
@group(2) @binding(8) var normal_sampler: sampler;
@group(2) @binding(9) var occlusion_sampler: sampler;
@group(2) @binding(10) var emissive_sampler: sampler;

// Each texture: 0 none, 1 at the first coordinates, 2 at the second, 3 at the corner.
override BASE_COLOR: u32 = 0u;
override METALLIC_ROUGHNESS: u32 = 0u;
override NORMAL: u32 = 0u;
override OCCLUSION: u32 = 0u;
override EMISSIVE: u32 = 0u;
// Occlusion is the red of the metallic-roughness texture.
override OCCLUSION_PACKED: bool = false;
// Emissive factors are not all zero.
override GLOWING: bool = false;
override UV_TRANSFORMED: bool = false;
override MASKED: bool = false;
override DOUBLE_SIDED: bool = false;
override LIT: bool = true;
override HIGHLIGHTED: bool = false;

fn coordinates(v: Varyings, slot: u32, which: u32) -> vec2<f32> {
    var uv = vec2<f32>(0.0);
    if slot == 1u { uv = uv0_of(v); }
    if slot == 2u { uv = uv1_of(v); }
    if UV_TRANSFORMED {
        let transform = material.uv_transforms[which];
        uv = transform.columns.xy * uv.x + transform.columns.zw * uv.y + transform.offset.xy;
    }
    return uv;
}

// Linear colour and alpha before the alpha mode is applied.
fn base_color(v: Varyings) -> vec4<f32> {
    var color = material.base_color * color_of(v);
    if BASE_COLOR != 0u {
        let uv = coordinates(v, BASE_COLOR, 0u);
        color *= textureSample(base_color_texture, base_color_sampler, uv);
    }
    return color;
}
