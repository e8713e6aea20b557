// Group 0: what one view of one frame shares. Positions are relative to the eye, in world axes.

struct Sun {
    toward: vec3<f32>,
    pad0: f32,
    irradiance: vec3<f32>,
    pad1: f32,
}

// Where a view has its ambient occlusion.
struct OcclusionPlace {
    // From a pixel of the target, times this, to a texel of the map; 0 if it has none.
    offset: vec2<f32>,
    texels_per_pixel: f32,
    // Depths that differ by more than this are of two surfaces: as a share of the depth, and where
    // rays are parallel.
    relative: f32,
    absolute: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}

struct Frame {
    clip_from_eye: mat4x4<f32>,
    sky: vec3<f32>,
    exposure: f32,
    ground: vec3<f32>,
    // The exponent by which fog thins per unit of height.
    fog_fall: f32,
    // Homogeneous: the origin, or with w = 0 the direction to it where all rays are parallel.
    eye: vec4<f32>,
    // Radiance of fog; w is the logarithm of its density at the eye.
    fog: vec4<f32>,
    // The least corner of the grid of lamps, and its cells along each axis; see `lamp_grid.rs`.
    lamp_origin: vec3<f32>,
    cells_per_unit: f32,
    lamp_cells: vec3<u32>,
    // The radiance of a map of the surroundings is times this.
    surroundings: f32,
    occlusion: OcclusionPlace,
    // The number of a `ToneMapper`.
    tone_mapper: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
    suns: array<Sun, 4>,
}

struct Lamp {
    position: vec3<f32>,
    inverse_range: f32,
    intensity: vec3<f32>,
    directional: u32,
    direction: vec3<f32>,
    pad: f32,
    cone: vec2<f32>,
    pad2: vec2<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(2) var<storage, read> lamp_indices: array<u32>;
// See `albedo.rs`.
@group(0) @binding(3) var albedo_table: texture_2d<f32>;
@group(0) @binding(4) var albedo_sampler: sampler;
