// Group 3: what extensions of glTF add to a material. Their textures may hold several things each.

struct Extension {
    uv_transforms: array<UvTransform, 5>,
    // Reflectance from the front, and the part of the reflection that is there.
    specular: vec4<f32>,
    // Part, roughness, scale of the normal map; the intensity of baked light.
    clearcoat: vec4<f32>,
    // Colour, roughness.
    sheen: vec4<f32>,
    // Part, thickness, inverse of the index of refraction, 20 over the Abbe number.
    transmission: vec4<f32>,
    // Of the volume per unit of the world; w is the factor of roughness for light that passes.
    absorption: vec4<f32>,
    // Strength, and cosine and sine of the direction's angle. //? further
    anisotropy: vec4<f32>, //? further
    // Part, index of refraction, thickness in nanometres from and to. //? further
    film: vec4<f32>, //? further
    // Colour of what passes diffusely, and its part. //? further
    through: vec4<f32>, //? further
}

@group(3) @binding(0) var<uniform> extension: Extension;
@group(3) @binding(1) var further_texture_1: texture_2d<f32>;
@group(3) @binding(2) var further_texture_2: texture_2d<f32>;
@group(3) @binding(3) var further_texture_3: texture_2d<f32>;
@group(3) @binding(4) var further_texture_4: texture_2d<f32>;
@group(3) @binding(5) var further_texture_5: texture_2d<f32>;
@group(3) @binding(6) var further_sampler_1: sampler;
@group(3) @binding(7) var further_sampler_2: sampler;
@group(3) @binding(8) var further_sampler_3: sampler;
@group(3) @binding(9) var further_sampler_4: sampler;
@group(3) @binding(10) var further_sampler_5: sampler;

// The coordinates of each texture, as those of `BASE_COLOR`.
override FURTHER_1: u32 = 0u;
override FURTHER_2: u32 = 0u;
override FURTHER_3: u32 = 0u;
override FURTHER_4: u32 = 0u;
override FURTHER_5: u32 = 0u;

// The texture in which each factor has its texels, from 1; 0 none.
override SPECULAR: u32 = 0u; //? specular
override SPECULAR_COLOR: u32 = 0u; //? specular
override CLEARCOAT: u32 = 0u; //? clearcoat
override CLEARCOAT_ROUGHNESS: u32 = 0u; //? clearcoat
override CLEARCOAT_NORMAL: u32 = 0u; //? clearcoat
override SHEEN_COLOR: u32 = 0u; //? sheen
override SHEEN_ROUGHNESS: u32 = 0u; //? sheen
override TRANSMISSION: u32 = 0u; //? transmission
override THICKNESS: u32 = 0u; //? volume
override ANISOTROPY: u32 = 0u; //? anisotropy
override IRIDESCENCE: u32 = 0u; //? iridescence
override IRIDESCENCE_THICKNESS: u32 = 0u; //? iridescence
override THROUGH: u32 = 0u; //? diffuse_transmission
override THROUGH_COLOR: u32 = 0u; //? diffuse_transmission
override BAKED_LIGHT: u32 = 0u; //? baked_light

fn further_coordinates(v: Varyings, slot: u32, which: u32) -> vec2<f32> {
    var uv = vec2<f32>(0.0);
    if slot == 1u { uv = uv0_of(v); }
    if slot == 2u { uv = uv1_of(v); }
    let transform = extension.uv_transforms[which];
    return transform.columns.xy * uv.x + transform.columns.zw * uv.y + transform.offset.xy;
}

// The texels of all textures; 1 for none, which stands first.
fn further_texels(v: Varyings) -> array<vec4<f32>, 6> {
    var texels: array<vec4<f32>, 6>;
    texels[0] = vec4<f32>(1.0);
    if FURTHER_1 != 0u {
        let uv = further_coordinates(v, FURTHER_1, 0u);
        texels[1] = textureSample(further_texture_1, further_sampler_1, uv);
    }
    if FURTHER_2 != 0u {
        let uv = further_coordinates(v, FURTHER_2, 1u);
        texels[2] = textureSample(further_texture_2, further_sampler_2, uv);
    }
    if FURTHER_3 != 0u {
        let uv = further_coordinates(v, FURTHER_3, 2u);
        texels[3] = textureSample(further_texture_3, further_sampler_3, uv);
    }
    if FURTHER_4 != 0u {
        let uv = further_coordinates(v, FURTHER_4, 3u);
        texels[4] = textureSample(further_texture_4, further_sampler_4, uv);
    }
    if FURTHER_5 != 0u {
        let uv = further_coordinates(v, FURTHER_5, 4u);
        texels[5] = textureSample(further_texture_5, further_sampler_5, uv);
    }
    return texels;
}

fn largest(color: vec3<f32>) -> f32 {
    return max(color.r, max(color.g, color.b));
}

// KHR_materials_ior and KHR_materials_specular: `Surface::reflectance`.
fn reflectance(texels: array<vec4<f32>, 6>) -> vec4<f32> { //? specular
    let color = extension.specular.rgb * texels[SPECULAR_COLOR].rgb; //? specular
    let part = extension.specular.a * texels[SPECULAR].a; //? specular
    return vec4<f32>(min(color, vec3<f32>(1.0)), part); //? specular
} //? specular
