// Group 1, in scenes whose point and spot lights cast shadows: which part of their light reaches a
// point. See `lamp_map.rs`; the filters of `shadow_filter.wgsl` are here once more, for these maps.

struct LampShadow {
    // The axes of the first map: it looks against the third one.
    right: vec3<f32>,
    // Its maps: 0 if it casts no shadow, 1 of a spot light, else faces of a cube.
    count: u32,
    up: vec3<f32>,
    // Of the first map.
    layer: u32,
    // Depth is this over the distance along the map's axis.
    near: f32,
    // Of a map's side, to the tangent of an angle.
    scale: f32,
    // At a distance of 1, in units of the world.
    texel: f32,
    // See `penumbra_radius`.
    spread: f32,
}

// In the order of the lamps.
@group(1) @binding(3) var<storage, read> lamp_shadows: array<LampShadow>;
// 1 at the near plane, 0 where nothing is.
@group(1) @binding(4) var lamp_maps: texture_depth_2d_array;

// The part of a distance that f32 rounds away.
const DISTANCE_ROUNDING: f32 = 2e-6;
// Of a lamp, in units of the world; twin in `lamp_map.rs`.
const LAMP_RADIUS: f32 = 0.05;
// Sides of a map in which blockers are looked for: its border, as `lamp_map.rs` has it.
const LAMP_SEARCH_MAX: f32 = 1.0 / 32.0;

// A vector in the axes of the first map in those of another face: across, up, and along the way
// that it looks. `sign` is the sign of the face's side along each axis.
fn in_face(v: vec3<f32>, sign: vec3<f32>, is_x: bool, is_y: bool) -> vec3<f32> {
    let beside = vec3<f32>(v.z, v.y, v.x) * vec3<f32>(sign.x, 1.0, sign.x);
    let above = vec3<f32>(v.x, v.z, v.y) * vec3<f32>(1.0, sign.y, sign.y);
    let before = vec3<f32>(v.x, v.y, v.z) * vec3<f32>(-sign.z, 1.0, sign.z);
    return select(select(before, above, is_y), beside, is_x);
}

// From a map, for a point that was moved off its surface by what the filter reaches, measured in
// the map's plane: there all taps have one depth, and lie before the surface. Both sides of a
// border between faces have the texels beyond it, so neither filters nor the move need another
// face than that of the surface.
fn lamp_map_visibility(
    lamp: LampShadow,
    toward_lamp: vec3<f32>,
    position: vec3<f32>,
    normal: vec3<f32>,
) -> f32 {
    let axes = transpose(mat3x3<f32>(lamp.right, lamp.up, cross(lamp.right, lamp.up)));
    // A receiver that is drawn coarser is off by as much.
    let error = shadows.error.x * length(position - shadows.middle) + shadows.error.y;
    let p = axes * (normal * error - toward_lamp);
    let size = abs(p);
    let is_cube = lamp.count > 1u;
    let is_x = is_cube && size.x > size.y && size.x > size.z;
    let is_y = is_cube && !is_x && size.y > size.z;
    let is_back = is_cube && p.z > 0.0;
    let sign = select(vec3<f32>(-1.0), vec3<f32>(1.0), vec3<bool>(p.x >= 0.0, p.y >= 0.0, is_back));
    let at = in_face(p, sign, is_x, is_y);
    let n = in_face(axes * normal, sign, is_x, is_y);
    let reach = (select(HARD_REACH, SOFT_REACH, SOFT) + LEVEL_TEXELS) * lamp.texel * at.z;
    let off_surface = reach * sqrt(max(1.0 - n.z * n.z, 0.0));
    // Towards the light where penumbras are to be exact, as for suns.
    let height = max(dot(normal, toward_lamp), 2.0 * off_surface);
    let beside = at * (1.0 - off_surface / height);
    let moved = select(at + n * off_surface, beside, CONTACT_HARDENING);
    // Along its ray towards the lamp a point keeps its texel.
    let closer = 1.0 + TOWARD_TEXELS * lamp.texel + DISTANCE_ROUNDING;
    let inverse = 1.0 / max(moved.z, lamp.near);
    let across = moved.xy * (inverse * lamp.scale);
    let place = vec3<f32>(0.5 + across.x, 0.5 - across.y, lamp.near * inverse * closer);
    // The first one, right, left, above, below, behind.
    let side = select(select(0.0, 5.0, is_back), 3.5 - 0.5 * sign.y, is_y);
    let face = u32(select(side, 1.5 - 0.5 * sign.x, is_x));
    let layer = lamp.layer + min(face, lamp.count - 1u);
    if CONTACT_HARDENING {
        let above = dot(normal, toward_lamp);
        let spread = lamp.spread * min(1.0, GRAZING / LAMP_RADIUS * above);
        let slant = vec2<f32>(moved.x, -moved.y) * inverse;
        // A disc is as much longer in the map as its place is farther away than the map's middle.
        let most = LAMP_SEARCH_MAX / sqrt(1.0 + dot(slant, slant));
        let radius = lamp_penumbra_radius(place, layer, spread, slant, most);
        return area_lamp_visibility(place, layer, spread, slant, min(radius, most));
    }
    if SOFT {
        return soft_lamp_visibility(place, layer);
    }
    return hard_lamp_visibility(place, layer);
}

// The part of a lamp's light that reaches a point of a surface; `is_lit` unless none would arrive
// there anyway. There is one loop and no branch, as for suns.
fn lamp_visibility(at: u32, position: vec3<f32>, normal: vec3<f32>, is_lit: bool) -> f32 {
    let toward_lamp = lamps[at].position - position;
    let has_maps = lamp_shadows[at].count > 0u;
    let is_used = has_maps && is_lit && dot(normal, toward_lamp) > 0.0;
    let end = select(0u, 1u, is_used);
    var visible = select(1.0, 0.0, has_maps);
    for (var map = 0u; map < end; map += 1u) {
        visible = lamp_map_visibility(lamp_shadows[at], toward_lamp, position, normal);
    }
    return visible;
}
