// Depth of field, from a picture with a guard band and its depths: `split` tells what is in front
// of the distance that is sharp from all else, `halve` makes levels of both, `gather` finds what
// each texel gets of the discs around it, and `compose` lays that over the pixels of the frame. A
// line that ends in `//? many` is there where pixels have several samples, and one with
// `//? single` where they have one.
//
// Radii of discs are in texels of the middle of the canvas, which are angles: away from it a disc
// covers more of them. So discs of displays that face elsewhere agree.

const SAMPLES: i32 = 1; //? single
const SAMPLES: i32 = 4; //? many
// Rings of texels that are looked at in a disc, of 6, 12 ... around one in the middle.
const RINGS: u32 = 2u;
// The steps between rings that a disc's radius is: each texel stands for as much of its area.
const RING_STEPS: f32 = 2.5;
// The part of a ring's texel that the middle one stands for, and all of them together.
const MIDDLE_PART: f32 = 0.75;
const ALL_PARTS: f32 = 18.75;
// The weight of what is sharp where something else is to be seen through a blurred edge.
const SHARP_WEIGHT: f32 = 0.001;
// Halvings of the layers; twin of `LEVELS` in `guarded_region.rs`.
const LEVELS: u32 = 6u;

struct Lens {
    // Homogeneous places relative to the eye, from a texel of the picture and its depth, and from
    // a pixel of the frame.
    eye_from_texel: mat4x4<f32>,
    eye_from_pixel: mat4x4<f32>,
    // To a texel of the picture.
    texel_from_eye: mat4x4<f32>,
    // The first and the last texel of the view's part of the picture.
    part: vec4<i32>,
    // From a texel of the map to that of the picture.
    to_picture: vec2<i32>,
    // From a pixel of the frame, times `texels_per_pixel`, to a texel of the map.
    offset: vec2<f32>,
    texels_per_pixel: f32,
    // One over the distance that is sharp, and half of the lens's width; 0 without any blur.
    focus_inverse: f32,
    aperture_half: f32,
    texels_per_radian: f32,
    // The greatest radius of a disc, as an angle and in texels anywhere.
    radius_max: f32,
    texels_max: f32,
    pad: vec2<f32>,
}

// What `split` and `halve` make: colours times a weight, that weight; then the part of colours
// that is light and the disc's radius, both times the weight. Of what is in front also the largest
// radius, and the largest of what is not.
struct Layers {
    @location(0) behind: vec4<f32>,
    @location(1) behind_more: vec2<f32>,
    @location(2) front: vec4<f32>,
    @location(3) front_more: vec4<f32>,
}

// What a texel gets of all discs: colour and the part of it that is light, for what is not in
// front; the same times its cover, and that cover, for what is.
struct Gathered {
    @location(0) behind: vec4<f32>,
    @location(1) front: vec4<f32>,
    @location(2) front_light: vec4<f32>,
}

// Colours times weights, the sum of those; the part of colours that is light, times weights.
struct Sum {
    color: vec4<f32>,
    lit: f32,
}

@group(1) @binding(0) var<uniform> lens: Lens;
@group(1) @binding(1) var pictures: sampler;
// The picture, or the frame.
@group(1) @binding(2) var picture: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d; //? single
@group(1) @binding(3) var depths: texture_depth_multisampled_2d; //? many
// The layers, or what was gathered.
@group(1) @binding(4) var behind: texture_2d<f32>;
@group(1) @binding(5) var behind_more: texture_2d<f32>;
@group(1) @binding(6) var front: texture_2d<f32>;
@group(1) @binding(7) var front_more: texture_2d<f32>;
@group(1) @binding(8) var widest: texture_2d<f32>;

// The radius of the disc that a place is blurred to; below 0 in front of what is sharp.
fn radius_at(at: vec2<f32>, depth: f32, eye_from: mat4x4<f32>) -> f32 {
    let place = eye_from * vec4<f32>(at, depth, 1.0);
    let inverse = abs(place.w) / max(length(place.xyz), 1e-30);
    let angle = lens.aperture_half * (lens.focus_inverse - inverse);
    return clamp(angle, -lens.radius_max, lens.radius_max) * lens.texels_per_radian;
}

// The part of a place that is blurred: a disc smaller than a texel is none.
fn blurred(radius: f32) -> f32 {
    return smoothstep(0.5, 1.5, abs(radius));
}

@fragment
fn split(@builtin(position) position: vec4<f32>) -> Layers {
    let texel = vec2<i32>(position.xy);
    let color = textureLoad(picture, texel, 0);
    var nearest = lens.radius_max * lens.texels_per_radian;
    var farthest = -nearest;
    for (var i = 0; i < SAMPLES; i++) {
        let depth = textureLoad(depths, texel, i);
        let radius = radius_at(position.xy, depth, lens.eye_from_texel);
        nearest = min(nearest, radius);
        farthest = max(farthest, radius);
    }
    let near_radius = max(-nearest, 0.0);
    let far_radius = max(nearest, 0.0);
    let near_weight = blurred(near_radius);
    let far_weight = max(blurred(far_radius), SHARP_WEIGHT * (1.0 - near_weight));
    var layers: Layers;
    layers.behind = vec4<f32>(color.rgb, 1.0) * far_weight;
    layers.behind_more = vec2<f32>(color.a, far_radius) * far_weight;
    layers.front = vec4<f32>(color.rgb, 1.0) * near_weight;
    let front_more = vec2<f32>(color.a, near_radius) * near_weight;
    layers.front_more = vec4<f32>(front_more, near_radius, max(farthest, 0.0));
    return layers;
}

fn mean_of_four(layer: texture_2d<f32>, corner: vec2<i32>) -> vec4<f32> {
    let upper = textureLoad(layer, corner, 0) + textureLoad(layer, corner + vec2(1, 0), 0);
    let lower = textureLoad(layer, corner + vec2(0, 1), 0) + textureLoad(layer, corner + 1, 0);
    return (upper + lower) * 0.25;
}

@fragment
fn halve(@builtin(position) position: vec4<f32>) -> Layers {
    let corner = vec2<i32>(position.xy) * 2;
    var layers: Layers;
    layers.behind = mean_of_four(behind, corner);
    layers.behind_more = mean_of_four(behind_more, corner).xy;
    layers.front = mean_of_four(front, corner);
    let mean = mean_of_four(front_more, corner);
    var most = textureLoad(front_more, corner, 0);
    most = max(most, textureLoad(front_more, corner + vec2(1, 0), 0));
    most = max(most, textureLoad(front_more, corner + vec2(0, 1), 0));
    most = max(most, textureLoad(front_more, corner + 1, 0));
    layers.front_more = vec4<f32>(mean.xy, most.zw);
    return layers;
}

// The largest radius in front of a coarsest texel and those around it.
@fragment
fn widen(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let first = lens.part.xy >> vec2<u32>(LEVELS);
    let last = lens.part.zw >> vec2<u32>(LEVELS);
    var most = 0.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let cell = clamp(vec2<i32>(position.xy) + vec2<i32>(x, y), first, last);
            most = max(most, textureLoad(front_more, cell, 0).z);
        }
    }
    return vec4<f32>(most, 0.0, 0.0, 0.0);
}

// How far texels move with the direction: along two directions at right angles, for an angle that
// is a texel in the middle of the canvas.
fn steps_of(at: vec2<f32>) -> mat2x2<f32> {
    let place = lens.eye_from_texel * vec4<f32>(at, 0.5, 1.0);
    let toward = normalize(place.xyz) * sign(place.w);
    let least = select(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), abs(toward.x) > 0.6);
    let right = normalize(cross(toward, least));
    let up = cross(right, toward);
    let seen = lens.texel_from_eye * vec4<f32>(toward, 1.0);
    let across = lens.texel_from_eye * vec4<f32>(right, 0.0);
    let upward = lens.texel_from_eye * vec4<f32>(up, 0.0);
    let texel = seen.xy / seen.w;
    let scale = 1.0 / (seen.w * lens.texels_per_radian);
    let moved = mat2x2<f32>(across.xy - texel * across.w, upward.xy - texel * upward.w);
    return moved * scale;
}

// What is seen behind all that is in front, times its weight, and the sum of weights. `is_hidden`:
// the texel's own surface is in front, and whatever is around it stands for what is behind.
fn gather_behind(at: vec2<f32>, radius: f32, steps: mat2x2<f32>, is_hidden: bool) -> Sum {
    let size = vec2<f32>(textureDimensions(behind));
    let step = radius / RING_STEPS;
    let level = round(max(log2(step * sqrt(abs(determinant(steps)))) - 1.0, 0.0));
    var sum = vec4<f32>(0.0);
    var lit = 0.0;
    for (var ring = 0u; ring <= RINGS; ring++) {
        let count = max(ring * 6u, 1u);
        let away = f32(ring) * step;
        for (var i = 0u; i < count; i++) {
            let angle = (f32(i) + 0.5 * f32(ring & 1u)) * 6.2831853 / f32(count);
            let place = (at + steps * (away * vec2<f32>(cos(angle), sin(angle)))) / size;
            let color = textureSampleLevel(behind, pictures, place, level);
            let more = textureSampleLevel(behind_more, pictures, place, level).xy;
            let reaches = clamp((more.y / max(color.a, 1e-6) - away) / step + 0.5, 0.0, 1.0);
            let part = select(reaches, 1.0, is_hidden) * select(1.0, MIDDLE_PART, ring == 0u);
            sum += color * part;
            lit += more.x * part;
        }
    }
    return Sum(sum, lit);
}

// The discs that cover a texel from in front.
fn gather_front(at: vec2<f32>, radius: f32, steps: mat2x2<f32>) -> Sum {
    let size = vec2<f32>(textureDimensions(front));
    let step = radius / RING_STEPS;
    let level = round(max(log2(step * sqrt(abs(determinant(steps)))) - 1.0, 0.0));
    var sum = vec4<f32>(0.0);
    var lit = 0.0;
    for (var ring = 0u; ring <= RINGS; ring++) {
        let count = max(ring * 6u, 1u);
        let away = f32(ring) * step;
        for (var i = 0u; i < count; i++) {
            let angle = (f32(i) + 0.5 * f32(ring & 1u)) * 6.2831853 / f32(count);
            let place = (at + steps * (away * vec2<f32>(cos(angle), sin(angle)))) / size;
            let color = textureSampleLevel(front, pictures, place, level);
            let more = textureSampleLevel(front_more, pictures, place, level).xy;
            let own = more.y / max(color.a, 1e-6);
            let reaches = clamp((own - away) / step + 0.5, 0.0, 1.0);
            // A disc of half the radius is four times as dense.
            let dense = radius / max(own, 0.5 * step);
            let part = reaches * dense * dense * select(1.0, MIDDLE_PART, ring == 0u) / ALL_PARTS;
            sum += color * part;
            lit += more.x * part;
        }
    }
    return Sum(sum, lit);
}

@fragment
fn gather(@builtin(position) position: vec4<f32>) -> Gathered {
    let texel = vec2<i32>(position.xy) + lens.to_picture;
    let at = vec2<f32>(texel) + 0.5;
    let near_radius = textureLoad(front_more, texel, 0).z;
    var far_radius = near_radius;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            far_radius = max(far_radius, textureLoad(front_more, texel + vec2(x, y), 0).w);
        }
    }
    let cell = at / vec2<f32>(textureDimensions(widest) << vec2<u32>(LEVELS));
    let front_radius = textureSampleLevel(widest, pictures, cell, 0.0).x;
    let steps = steps_of(at);
    let widening = length(vec2<f32>(length(steps[0]), length(steps[1])));
    let radius_max = lens.texels_max / max(widening, 1e-6);
    var gathered: Gathered;
    var all = Sum(textureLoad(behind, texel, 0), textureLoad(behind_more, texel, 0).x);
    if far_radius > 0.5 {
        let found = gather_behind(at, min(far_radius, radius_max), steps, near_radius > 0.0);
        if found.color.a > 1e-4 {
            all = found;
        }
    }
    if all.color.a <= 1e-4 {
        // Nothing but what is in front, as far as one sees.
        all = Sum(textureLoad(front, texel, 0), textureLoad(front_more, texel, 0).x);
    }
    gathered.behind = vec4<f32>(all.color.rgb, all.lit) / max(all.color.a, 1e-6);
    if front_radius > 0.5 {
        let found = gather_front(at, min(front_radius, radius_max), steps);
        let cover = min(found.color.a, 1.0) / max(found.color.a, 1e-6);
        gathered.front = found.color * cover;
        gathered.front_light = vec4<f32>(found.lit * cover, 0.0, 0.0, 0.0);
    }
    return gathered;
}

@fragment
fn compose(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = vec2<i32>(position.xy);
    let pixel = textureLoad(picture, at, 0);
    if lens.aperture_half == 0.0 {
        return pixel;
    }
    var share = 0.0;
    for (var i = 0; i < SAMPLES; i++) {
        let depth = textureLoad(depths, at, i);
        share += blurred(radius_at(position.xy, depth, lens.eye_from_pixel));
    }
    let size = vec2<f32>(textureDimensions(behind));
    let place = (position.xy * lens.texels_per_pixel + lens.offset) / size;
    let around = textureSampleLevel(behind, pictures, place, 0.0);
    let before = textureSampleLevel(front, pictures, place, 0.0);
    let before_light = textureSampleLevel(front_more, pictures, place, 0.0).x;
    let all = mix(pixel, around, share / f32(SAMPLES));
    return vec4<f32>(before.rgb, before_light) + all * (1.0 - before.a);
}
