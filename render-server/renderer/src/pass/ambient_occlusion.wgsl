// Ambient occlusion: the part of the light from all around that gets to a place, from the depths
// around it. Horizons are searched along lines of the picture, and the light between them is summed
// in closed form: Jiménez et al., "Practical Real-Time Strategies for Accurate Indirect Occlusion"
// (2016). Angles and lengths are those of the world, so that they do not depend on the screen.

const PI: f32 = 3.14159265359;
// Lines through each texel, and texels that are looked at to both sides of it. The 16 texels of a
// square search along other lines and at other distances each; `smoothed` joins them.
const LINES: u32 = 2u;
const STEPS: u32 = 6u;
// What rises by this above the surface, as a sine, occludes in full; what is in its plane not at
// all, since texels lie up to half a texel beside their line.
const BIAS: f32 = 0.05;

// What a search along a line starts from.
struct Around {
    toward_eye: vec3<f32>,
    normal: vec3<f32>,
    // Cosine and sine of the angle of the normal, seen along the line, from the eye's direction to
    // its one side.
    lean: vec2<f32>,
    // 1, or −1 for the other side.
    side: f32,
    radius: f32,
    texels: f32,
    shift: f32,
}

struct Occlusion {
    // Homogeneous places relative to the eye, from the middle of a texel here and its depth.
    eye_from_texel: mat4x4<f32>,
    // Homogeneous: the origin, or with w = 0 the direction to it where all rays are parallel.
    eye: vec4<f32>,
    // The first and the last texel of the view's depths.
    depths: vec4<i32>,
    // From a texel here to that of its depth.
    to_depth: vec2<i32>,
    // Nothing beyond this length occludes; nor beyond this share of the distance from the eye, and
    // so many texels.
    radius: f32,
    share: f32,
    texels: f32,
    // Depths that differ by more than this are of two surfaces: as a share of the depth, and where
    // rays are parallel.
    relative: f32,
    absolute: f32,
    pad: f32,
}

// Depths of the views; for `smoothed` what was found, and the depth that it is of.
@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var<uniform> occlusion: Occlusion;

fn depth_at(texel: vec2<i32>) -> f32 {
    let at = clamp(texel + occlusion.to_depth, occlusion.depths.xy, occlusion.depths.zw);
    return textureLoad(picture, at, 0).x;
}

// A place relative to the eye.
fn place(texel: vec2<f32>, depth: f32) -> vec3<f32> {
    let at = occlusion.eye_from_texel * vec4<f32>(texel, depth, 1.0);
    return at.xyz / at.w;
}

// The change of depth to the next texel, from the two before and the two after it. Depth is linear
// along a plane, so the side where it bends less is more likely the same surface.
fn slope(before: vec2<f32>, depth: f32, after: vec2<f32>) -> f32 {
    let bent_before = abs(before.x - 2.0 * before.y + depth);
    let bent_after = abs(after.y - 2.0 * after.x + depth);
    return select(after.x - depth, depth - before.y, bent_before < bent_after);
}

// The angle of a cosine, off by up to 7e-5 radians: Abramowitz and Stegun, 4.4.45.
fn angle_of(cosine: f32) -> f32 {
    let x = abs(cosine);
    let angle = (((-0.0187293 * x + 0.0742610) * x - 0.2121144) * x + 1.5707288) * sqrt(1.0 - x);
    return select(angle, PI - angle, cosine < 0.0);
}

// Light between the eye's direction and a horizon of this cosine, to one side of the line.
fn arc(cosine: f32, side: f32, lean: vec2<f32>) -> f32 {
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    // The cosine and the sine of twice the angle.
    let doubled = vec2<f32>(2.0 * cosine * cosine - 1.0, 2.0 * side * sine * cosine);
    return 0.25 * (lean.x + 2.0 * side * angle_of(cosine) * lean.y - dot(doubled, lean));
}

// Light that is lost to one side of a line; `along` is the step from texel to texel. Where a texel
// raises the horizon, what is between is lost by as much as it is near.
fn lost(at: vec2<f32>, origin: vec3<f32>, along: vec2<f32>, around: Around) -> f32 {
    var highest = -around.side * around.lean.y;
    var left = arc(highest, around.side, around.lean);
    var before = -1.0;
    var sum = 0.0;
    for (var step = 0u; step < STEPS; step++) {
        let part = (f32(step) + around.shift) / f32(STEPS);
        let far = max(part * part * around.texels, f32(step) + 1.0);
        let texel = floor(at + along * far);
        let depth = depth_at(vec2<i32>(texel));
        if depth > 0.0 {
            let away = place(texel + 0.5, depth) - origin;
            let length_squared = max(dot(away, away), 1e-30);
            let direction = away * inverseSqrt(length_squared);
            let cosine = dot(direction, around.toward_eye);
            if cosine > highest {
                let rise = smoothstep(0.0, BIAS, dot(direction, around.normal));
                let near = 1.0 - length_squared / (around.radius * around.radius);
                let share = clamp(near, 0.0, 1.0) * rise;
                let here = arc(min(cosine, 1.0), around.side, around.lean);
                sum += (left - here) * select(0.5 * (share + before), share, before < 0.0);
                left = here;
                highest = cosine;
                before = share;
            }
        }
    }
    return sum;
}

// The visible part, and the depth.
@fragment
fn search(@builtin(position) position: vec4<f32>) -> @location(0) vec2<f32> {
    let texel = vec2<i32>(position.xy);
    let depth = depth_at(texel);
    if depth <= 0.0 {
        return vec2<f32>(1.0, 0.0);
    }
    let right = vec2<i32>(1, 0);
    let down = vec2<i32>(0, 1);
    let across_before = vec2<f32>(depth_at(texel - 2 * right), depth_at(texel - right));
    let across_after = vec2<f32>(depth_at(texel + right), depth_at(texel + 2 * right));
    let down_before = vec2<f32>(depth_at(texel - 2 * down), depth_at(texel - down));
    let down_after = vec2<f32>(depth_at(texel + down), depth_at(texel + 2 * down));
    let across = slope(across_before, depth, across_after);
    let downward = slope(down_before, depth, down_after);
    let at = position.xy;
    let origin = place(at, depth);
    let side = place(at + vec2<f32>(1.0, 0.0), depth + across) - origin;
    let below = place(at + vec2<f32>(0.0, 1.0), depth + downward) - origin;
    let turned = cross(below, side);
    let normal_length = length(turned);
    let distance = max(length(origin), 1e-30);
    let toward_eye = select(-origin / distance, occlusion.eye.xyz, occlusion.eye.w == 0.0);
    if !(normal_length > 0.0) {
        return vec2<f32>(1.0, depth);
    }
    var normal = turned / normal_length;
    normal = select(normal, -normal, dot(normal, toward_eye) < 0.0);
    let far = select(occlusion.share * distance, occlusion.radius, occlusion.eye.w == 0.0);

    // Of the 16 texels of a square: each line and each distance once, neighbours far apart.
    let cell = vec2<u32>(texel) & vec2<u32>(3u);
    let mixed = cell.x ^ cell.y;
    let fine = ((mixed & 1u) << 3u) | ((cell.y & 1u) << 2u);
    let order = fine | (mixed & 2u) | (cell.y >> 1u);
    let turn = (f32(order) + 0.5) / 16.0;
    let shift = (f32((order * 7u) & 15u) + 0.5) / 16.0;
    var taken = 0.0;
    var whole = 0.0;
    for (var line = 0u; line < LINES; line++) {
        let angle = (f32(line) + turn) * PI / f32(LINES);
        let along = vec2<f32>(cos(angle), sin(angle));
        let next = place(at + along, depth) - origin;
        let beside = next - toward_eye * dot(next, toward_eye);
        let per_texel = max(length(beside), 1e-30);
        let tangent = beside / per_texel;
        let axis = cross(tangent, toward_eye);
        let in_plane = normal - axis * dot(normal, axis);
        let weight = length(in_plane);
        let unit = in_plane / max(weight, 1e-30);
        let lean = vec2<f32>(dot(unit, toward_eye), dot(unit, tangent));
        let radius = min(min(occlusion.radius, far), occlusion.texels * per_texel);
        let texels = radius / per_texel;
        var around = Around(toward_eye, normal, lean, 1.0, radius, texels, shift);
        taken += weight * lost(at, origin, along, around);
        around.side = -1.0;
        taken += weight * lost(at, origin, -along, around);
        whole += weight * (lean.x + angle_of(clamp(lean.x, -1.0, 1.0)) * abs(lean.y));
    }
    return vec2<f32>(clamp(1.0 - taken / max(whole, 1e-6), 0.0, 1.0), depth);
}

fn found_at(texel: vec2<i32>) -> vec2<f32> {
    return textureLoad(picture, texel, 0).xy;
}

// The mean over a square of 4 × 4 texels around a texel's middle: 5 × 5 of which the outermost
// count half. Those of other surfaces do not count.
@fragment
fn smoothed(@builtin(position) position: vec4<f32>) -> @location(0) vec2<f32> {
    let texel = vec2<i32>(position.xy);
    let own = found_at(texel);
    if own.y <= 0.0 {
        return own;
    }
    let right = vec2<i32>(1, 0);
    let down = vec2<i32>(0, 1);
    let across_before = vec2<f32>(found_at(texel - 2 * right).y, found_at(texel - right).y);
    let across_after = vec2<f32>(found_at(texel + right).y, found_at(texel + 2 * right).y);
    let down_before = vec2<f32>(found_at(texel - 2 * down).y, found_at(texel - down).y);
    let down_after = vec2<f32>(found_at(texel + down).y, found_at(texel + 2 * down).y);
    let across = slope(across_before, own.y, across_after);
    let downward = slope(down_before, own.y, down_after);
    let tolerance = own.y * occlusion.relative + occlusion.absolute;
    var sum = 0.0;
    var weights = 0.0;
    for (var y = -2; y <= 2; y++) {
        for (var x = -2; x <= 2; x++) {
            let other = found_at(texel + vec2<i32>(x, y));
            let expected = own.y + across * f32(x) + downward * f32(y);
            let apart = (other.y - expected) / tolerance;
            var weight = 1.0 / ((1.0 + apart * apart) * (1.0 + apart * apart));
            weight *= select(1.0, 0.5, abs(x) == 2) * select(1.0, 0.5, abs(y) == 2);
            sum += other.x * weight;
            weights += weight;
        }
    }
    return vec2<f32>(sum / weights, own.y);
}
