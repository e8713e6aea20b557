//! The textures of what covers ground and branches: cobbles, grass, leaves, waves.

use glam::{Vec2, Vec3, vec2, vec3};

use super::canvas::{Canvas, Texel, cloud, noise, pebble};
use super::heightfield::smooth;
use super::random::{Random, lattice};
use super::trig::sin_cos;

const SIDE: u32 = 256;

/// Rounded setts with sand between them; to be tinted by vertices.
pub(super) fn cobbles() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let (cell, near, border) = pebble(u, v, 14, 101);
        let crown = smooth(border / 0.16);
        let grain = cloud(u, v, 32, 103);
        let tone = 0.78 + 0.16 * lattice(104, cell[0], cell[1]) + 0.10 * (grain - 0.5);
        let hue = vec3(1.0, 0.97, 0.92 + 0.06 * lattice(105, cell[0], cell[1]));
        Texel {
            height: 5.0 * crown - 2.0 * near + grain,
            roughness: 0.9 - 0.2 * crown,
            occlusion: 0.55 + 0.45 * crown,
            ..Texel::flat(hue * tone * (0.66 + 0.34 * crown))
        }
    })
}

/// Short grass, nearly grey: vertices give it its green.
pub(super) fn grass() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let blades = noise(u, v, 128, 111) * 0.6 + noise(u, v, 64, 112) * 0.4;
        let tufts = cloud(u, v, 6, 113);
        let tone = 0.80 + 0.10 * (tufts - 0.5) + 0.18 * (blades - 0.5);
        Texel::flat(vec3(tone, tone, tone * 0.94))
    })
}

/// A leaf of a spray: where it sits, where it points, how light it is.
struct Leaf {
    centre: Vec2,
    along: Vec2,
    tone: f32,
}

impl Leaf {
    fn random(random: &mut Random, reach: f32) -> Self {
        let (sine, cosine) = sin_cos(random.unit());
        let far = reach * random.unit().sqrt();
        let (turn_sine, turn_cosine) = sin_cos(random.unit());
        Self {
            centre: vec2(0.5 + far * cosine, 0.5 + far * sine),
            along: vec2(turn_cosine, turn_sine),
            tone: random.between(0.55, 0.95),
        }
    }

    /// 1 on the midrib, 0 at the edge, negative outside.
    fn cover(&self, at: Vec2, length: f32) -> f32 {
        let offset = at - self.centre;
        let (s, t) = (offset.dot(self.along) / length, offset.perp_dot(self.along) / length);
        1.0 - s * s - t * t * 7.0
    }
}

/// A spray of leaves on nothing: the card of a masked tree.
pub(super) fn leaves() -> Canvas {
    let mut random = Random::new(0, 121);
    let leaves: Vec<Leaf> = (0..110).map(|_| Leaf::random(&mut random, 0.42)).collect();
    Canvas::paint(SIDE, |u, v| {
        let at = vec2(u, v);
        // Transparent texels are green too: mip maps would draw a seam of black.
        let mut texel = Texel { alpha: 0.0, ..Texel::flat(vec3(0.62, 0.70, 0.50)) };
        for leaf in &leaves {
            let cover = leaf.cover(at, 0.085);
            if cover > 0.0 {
                let tone = leaf.tone * (0.86 + 0.14 * smooth(cover * 1.4));
                texel.color = vec3(tone * 0.93, tone, tone * 0.72);
                texel.alpha = 1.0;
            }
        }
        texel
    })
}

/// Foliage without gaps, for crowns that are geometry.
pub(super) fn foliage() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let (cell, near, border) = pebble(u, v, 22, 131);
        let tone = 0.52 + 0.30 * lattice(132, cell[0], cell[1]);
        let depth = smooth(border / 0.22) * (1.0 - 0.3 * near);
        let color = vec3(tone * 0.95, tone, tone * 0.78) * (0.62 + 0.38 * depth);
        Texel { height: 5.0 * depth, occlusion: 0.6 + 0.4 * depth, ..Texel::flat(color) }
    })
}

/// Small waves; only the relief is used.
pub(super) fn waves() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        // Crests run across the wind, so noise is stretched along u.
        let swell = noise(u, v, 9, 141) + 0.6 * noise(u, v, 19, 142) + 0.3 * noise(u, v, 41, 143);
        Texel { height: 4.0 * swell, ..Texel::flat(Vec3::ONE) }
    })
}
