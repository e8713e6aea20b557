// The vertex stage of everything that stands in the scene. A line that ends in `//? name` is
// there only where the vertices have, or the material needs, what it names; `!` negates.

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>, //? lit
    @location(2) tangent: vec4<f32>, //? tangent
    @location(3) uv0: vec2<f32>, //? uv0
    @location(4) uv1: vec2<f32>, //? uv1
    @location(5) color: vec4<f32>, //? color
    @location(6) row0: vec4<f32>,
    @location(7) row1: vec4<f32>,
    @location(8) row2: vec4<f32>,
    @location(9) normal_row0: vec3<f32>, //? lit
    @location(10) normal_row1: vec3<f32>, //? lit
    @location(11) normal_row2: vec3<f32>, //? lit
    @location(12) lamps: vec2<u32>, //? lamps
    @location(13) near: vec3<f32>,
    @location(14) clip_offset: vec4<f32>,
}

struct Varyings {
    @invariant @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>, //? placed
    @location(1) normal: vec3<f32>, //? lit
    @location(2) tangent: vec4<f32>, //? tangent
    @location(3) uv0: vec2<f32>, //? uv0
    @location(4) uv1: vec2<f32>, //? uv1
    @location(5) color: vec4<f32>, //? color
    @location(6) @interpolate(flat) lamps: vec2<u32>, //? lamps
    // Units of the world to one of the mesh, along the normal.
    @location(7) stretch: f32, //? volume
}

// A transform that mirrors turns the bitangent around.
override MIRRORED: bool = false;

// Zero stays zero instead of becoming NaN.
fn unit(v: vec3<f32>) -> vec3<f32> {
    return v * inverseSqrt(max(dot(v, v), 1e-30));
}

@vertex
fn vertex(in: VertexIn) -> Varyings {
    // Exact for what is near the eye: see `relative_to`.
    let l = in.position - in.near;
    let away = vec3<f32>(dot(in.row0.xyz, l), dot(in.row1.xyz, l), dot(in.row2.xyz, l));
    var out: Varyings;
    // The offset was brought to clip space in f64, so that what is far is rounded once.
    out.clip = frame.clip_from_eye * vec4<f32>(away, 0.0) + in.clip_offset;
    out.position = away + vec3<f32>(in.row0.w, in.row1.w, in.row2.w); //? placed
    let n = in.normal; //? lit
    let n0 = dot(in.normal_row0, n); //? lit
    let n1 = dot(in.normal_row1, n); //? lit
    let n2 = dot(in.normal_row2, n); //? lit
    out.normal = unit(vec3<f32>(n0, n1, n2)); //? lit
    let t = in.tangent.xyz; //? tangent
    let w = select(in.tangent.w, -in.tangent.w, MIRRORED); //? tangent
    let t0 = dot(in.row0.xyz, t); //? tangent
    let t1 = dot(in.row1.xyz, t); //? tangent
    let t2 = dot(in.row2.xyz, t); //? tangent
    out.tangent = vec4<f32>(unit(vec3<f32>(t0, t1, t2)), w); //? tangent
    out.uv0 = in.uv0; //? uv0
    out.uv1 = in.uv1; //? uv1
    out.color = in.color; //? color
    out.lamps = in.lamps; //? lamps
    let deep = vec3<f32>(dot(in.row0.xyz, n), dot(in.row1.xyz, n), dot(in.row2.xyz, n)); //? volume
    out.stretch = length(deep); //? volume
    return out;
}

fn position_of(v: Varyings) -> vec3<f32> {
    return v.position; //? placed
    return vec3<f32>(0.0); //? !placed
}

fn normal_of(v: Varyings) -> vec3<f32> {
    return v.normal; //? lit
    return vec3<f32>(0.0); //? !lit
}

fn tangent_of(v: Varyings) -> vec4<f32> {
    return v.tangent; //? tangent
    return vec4<f32>(0.0); //? !tangent
}

fn uv0_of(v: Varyings) -> vec2<f32> {
    return v.uv0; //? uv0
    return vec2<f32>(0.0); //? !uv0
}

fn uv1_of(v: Varyings) -> vec2<f32> {
    return v.uv1; //? uv1
    return vec2<f32>(0.0); //? !uv1
}

fn color_of(v: Varyings) -> vec4<f32> {
    return v.color; //? color
    return vec4<f32>(1.0); //? !color
}

fn lamps_of(v: Varyings) -> vec2<u32> {
    return v.lamps; //? lamps
    return vec2<u32>(0u); //? !lamps
}
