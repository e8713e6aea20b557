//! Readers of float maps, OBJ and Bourke's meshes in f64, from the formats' descriptions.

use glam::{DVec2, DVec3};

/// The values of a file at the middle of each pixel of a channel, rows from the top.
pub struct Reading {
    pub size: [u32; 2],
    /// Points in metres that the pixels show; `None` where nothing is lit.
    pub points: Vec<Option<DVec3>>,
    /// Factors of light, and the light that is there anyway, in red, green and blue.
    pub light: Vec<[DVec3; 2]>,
}

/// All of the light, and none anyway.
pub const FULL: [DVec3; 2] = [DVec3::ONE, DVec3::ZERO];

impl Reading {
    /// Reads a float map that is stretched over the channel, bilinear between the middles of its
    /// cells. Beyond the outermost middles it is extrapolated from the last two.
    pub fn of_map(
        map: &FloatMap,
        size: [u32; 2],
        point: impl Fn([f64; 3]) -> Option<DVec3>,
    ) -> Self {
        let points = middles(size).map(|place| point(map.at(place)?)).collect();
        Self { size, points, light: vec![FULL; (size[0] * size[1]) as usize] }
    }
}

/// The middles of a channel's pixels, from 0 to 1 and from the upper left, row by row.
pub fn middles([width, height]: [u32; 2]) -> impl Iterator<Item = DVec2> {
    let size = DVec2::new(f64::from(width), f64::from(height));
    (0..height).flat_map(move |y| {
        (0..width).map(move |x| (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / size)
    })
}

/// Numbers of a picture, rows from the top.
pub struct FloatMap {
    pub size: [usize; 2],
    pub values: Vec<[f64; 3]>,
}

impl FloatMap {
    /// The values at a place from 0 to 1, from the upper left; `None` beside ones that are no
    /// numbers. A third number that is none is left alone.
    pub fn at(&self, place: DVec2) -> Option<[f64; 3]> {
        let sides = [place.x, place.y];
        let spans: [(usize, f64); 2] = std::array::from_fn(|axis| {
            let at = sides[axis] * self.size[axis] as f64 - 0.5;
            let low = at.floor().clamp(0.0, self.size[axis].saturating_sub(2) as f64);
            (low as usize, at - low)
        });
        let [(x, across), (y, down)] = spans;
        let value = |x: usize, y: usize| self.values[y * self.size[0] + x];
        let corners = [value(x, y), value(x + 1, y), value(x, y + 1), value(x + 1, y + 1)];
        let mixed = std::array::from_fn(|i| {
            let [a, b, c, d] = corners.map(|corner| corner[i]);
            (a * (1.0 - across) + b * across) * (1.0 - down)
                + (c * (1.0 - across) + d * across) * down
        });
        let [u, v, _] = mixed;
        (u.is_finite() && v.is_finite()).then_some(mixed)
    }
}

/// PFM: three lines of text, then rows of three floats from the bottom.
pub fn float_map(bytes: &[u8]) -> FloatMap {
    let mut lines = bytes.splitn(4, |byte| *byte == b'\n');
    let mut line = || std::str::from_utf8(lines.next().expect("a line")).expect("text").trim();
    assert_eq!(line(), "PF");
    let sides: Vec<usize> = line().split(' ').map(|side| side.parse().expect("a side")).collect();
    let scale: f64 = line().parse().expect("a scale");
    assert!(scale < 0.0, "little-endian");
    let numbers = lines.next().expect("numbers");
    let float = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().expect("four")));
    let row_bytes = sides[0] * 12;
    let rows = numbers[..row_bytes * sides[1]].chunks(row_bytes).rev();
    let values = rows.flat_map(|row| {
        row.chunks(12).map(|cell| [float(&cell[..4]), float(&cell[4..8]), float(&cell[8..])])
    });
    FloatMap { size: [sides[0], sides[1]], values: values.collect() }
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// On the channel's picture, from 0 to 1, to the right and up.
    place: DVec2,
    value: DVec3,
    /// Factor of codes that are stored with gamma 2.2.
    intensity: f64,
}

/// Triangles on a channel's picture.
pub struct Mesh {
    triangles: Vec<[Corner; 3]>,
}

impl Mesh {
    /// Returns the values at the middle of each pixel: linear in each triangle.
    pub fn reading(&self, size: [u32; 2], point: impl Fn(DVec3) -> DVec3) -> Reading {
        let sides = DVec2::new(f64::from(size[0]), f64::from(size[1]));
        let count = (size[0] * size[1]) as usize;
        let mut reading = Reading { size, points: vec![None; count], light: vec![FULL; count] };
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|c| DVec2::new(c.place.x, 1.0 - c.place.y) * sides);
            let area = (b - a).perp_dot(c - a);
            let low = (a.min(b).min(c) - 1.0).max(DVec2::ZERO).as_uvec2();
            let high = (a.max(b).max(c) + 1.0).min(sides).max(DVec2::ZERO).as_uvec2();
            for (x, y) in (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (x, y))) {
                let at = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let second = (at - a).perp_dot(c - a) / area;
                let third = (b - a).perp_dot(at - a) / area;
                let shares = [1.0 - second - third, second, third];
                if !shares.iter().all(|share| *share >= -1e-9) {
                    continue;
                }
                let index = (y * size[0] + x) as usize;
                let value = (0..3).map(|i| corners[i].value * shares[i]).sum::<DVec3>();
                let light = (0..3).map(|i| corners[i].intensity.powf(2.2) * shares[i]).sum();
                reading.points[index] = Some(point(value));
                reading.light[index] = [DVec3::splat(light), DVec3::ZERO];
            }
        }
        reading
    }
}

fn numbers(words: &str) -> Vec<f64> {
    words.split_whitespace().map(|word| word.parse().expect("a number")).collect()
}

/// OBJ of triangles, whose positions are points in metres at the places of its UV.
pub fn obj(text: &str) -> Mesh {
    let of = |word: &'static str| {
        text.lines().filter_map(move |line| line.trim().strip_prefix(word)?.strip_prefix(' '))
    };
    let positions: Vec<DVec3> = of("v").map(|line| DVec3::from_slice(&numbers(line))).collect();
    let uvs: Vec<DVec2> = of("vt").map(|line| DVec2::from_slice(&numbers(line))).collect();
    let corner = |word: &str| {
        let mut parts = word.split('/').map(|part| part.parse::<usize>().expect("an index") - 1);
        let position = positions[parts.next().expect("a position")];
        let uv = uvs[parts.next().expect("a texture coordinate")];
        Corner { place: uv, value: position, intensity: 1.0 }
    };
    let triangle = |line: &str| {
        let corners: Vec<Corner> = line.split_whitespace().map(corner).collect();
        corners.try_into().expect("a triangle")
    };
    Mesh { triangles: of("f").map(triangle).collect() }
}

/// Paul Bourke's mesh for a channel of this width by its height; cells are two triangles, divided
/// from their first node on, as SGCT draws them.
pub fn bourke(text: &str, aspect: f64) -> Mesh {
    let mut lines = text.lines();
    assert_eq!(lines.next().map(str::trim), Some("2"));
    let size = numbers(lines.next().expect("a size"));
    let (columns, rows) = (size[0] as usize, size[1] as usize);
    let node = |line: &str| {
        let [x, y, u, v, intensity] = numbers(line)[..] else { panic!("no node: {line}") };
        let place = (DVec2::new(x / aspect, y) + 1.0) / 2.0;
        Corner { place, value: DVec3::new(u, v, 0.0), intensity }
    };
    let nodes: Vec<Corner> = lines.filter(|line| !line.trim().is_empty()).map(node).collect();
    assert_eq!(nodes.len(), columns * rows);
    let cells = (0..rows - 1).flat_map(|row| (0..columns - 1).map(move |x| row * columns + x));
    let triangles = cells.flat_map(|at| {
        let [a, b, c, d] = [at, at + 1, at + columns + 1, at + columns].map(|node| nodes[node]);
        [[a, b, c], [a, c, d]]
    });
    let is_lit = |corners: &[Corner; 3]| corners.iter().all(|corner| corner.intensity >= 0.0);
    Mesh { triangles: triangles.filter(is_lit).collect() }
}
