//! Triangles of a warp that one plane shows, and how dense it must be.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::{
    AtlasError, BACK_SHARE_MAX, MeshPart, SOURCE_DISTANCE_MIN_M, SOURCE_PLANES_MAX,
    SOURCE_SHARE_MAX, SOURCE_SPAN_MAX, WarpMesh,
};

/// The obliqueness of a triangle beyond which the direction along the line of sight is ignored: the
/// triangle has as good as no picture.
const OBLIQUE_MAX: f64 = 64.0;

/// A plane that takes more than this many pixels for each of its part of the channel is divided:
/// before all of them are cut. One that spans [`SOURCE_SPAN_MAX`] of a cylinder from its axis takes
/// 2.6, and a picture more costs a pass over the scene.
const WASTE_MAX: f64 = 0.75 * SOURCE_SHARE_MAX;

/// Halves that take more than this share of the whole's pixels are not worth a second picture.
const HALVES_SHARE_MAX: f64 = 0.75;

/// A ray whose cosine with the axis of a view is less than this is not in its picture.
const FRONT_MIN: f64 = 1e-3;

/// A triangle as the eye sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewTriangle {
    /// Its index in the mesh.
    pub triangle: u32,
    /// From the eye to its corners, in metres.
    pub rays: [DVec3; 3],
    /// By what the point moves from pixel to pixel, across and down, in metres.
    pub slope: [DVec3; 2],
    /// Its middle, in pixels of the channel.
    pub middle: DVec2,
    /// In pixels of the channel.
    pub area: f64,
}

/// The triangles of one plane.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// In metres of display space.
    pub eye: DVec3,
    pub view_from_display: DMat3,
    /// Tangents of its left and lower edges.
    pub low: DVec2,
    /// Tangents of its right and upper edges.
    pub high: DVec2,
    /// Tangents that a pixel of the channel spans, at every corner: columns across and down.
    steps: Vec<DMat2>,
}

/// Source pixels per pixel of the channel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// In the worst direction of the worst pixel.
    pub least: f64,
    /// In the best direction of the best pixel.
    pub most: f64,
    /// Between neighbours across and down, at most.
    pub across_down: DVec2,
}

/// The triangles of a mesh, checked against the eye: of a whole channel, few may show their backs.
pub(super) fn view_triangles(
    mesh: &WarpMesh,
    eye: DVec3,
    part: MeshPart,
) -> Result<Vec<ViewTriangle>, AtlasError> {
    let mut facets = Vec::with_capacity(mesh.triangles.len());
    // Areas that the eye sees from either side, and where.
    let mut sides = [(0.0, DVec2::ZERO); 2];
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        let [a, b, c] = triangle.map(|index| mesh.vertices[index as usize]);
        let (ab, ac) = (b.pixel - a.pixel, c.pixel - a.pixel);
        let doubled = ab.perp_dot(ac);
        if doubled == 0.0 {
            continue;
        }
        let rays = [a, b, c].map(|vertex| vertex.point - eye);
        let on_surface = rays.iter().position(|ray| ray.length() < SOURCE_DISTANCE_MIN_M);
        if let Some(pixel) = on_surface.map(|corner| [a, b, c][corner].pixel) {
            return Err(AtlasError::EyeOnSurface { eye, pixel });
        }
        let (p, q) = (b.point - a.point, c.point - a.point);
        let slope = [(p * ac.y - q * ab.y) / doubled, (q * ab.x - p * ac.x) / doubled];
        let middle = (a.pixel + b.pixel + c.pixel) / 3.0;
        let area = doubled.abs() / 2.0;
        let facing = slope[0].cross(slope[1]).dot(rays[0]);
        if facing == 0.0 {
            // Pixels that all show one point, or a line, have no side and no size.
            continue;
        }
        let (seen, middle_of) = &mut sides[usize::from(facing < 0.0)];
        *seen += area;
        *middle_of = middle;
        facets.push(ViewTriangle { triangle: index, rays, slope, middle, area });
    }
    let [front, back] = sides;
    let (few, many) = if front.0 < back.0 { (front, back) } else { (back, front) };
    if facets.is_empty() {
        return Err(AtlasError::Nothing);
    }
    if part == MeshPart::Whole && few.0 > BACK_SHARE_MAX * many.0 {
        // By where a viewer stands who sees the picture unmirrored.
        return Err(AtlasError::EyeBehind { eye, pixel: back.1 });
    }
    Ok(facets)
}

/// All facets, seen by this eye, in groups of one plane each, divided further where a plane takes
/// many more pixels than the channel has there.
pub(super) fn groups(facets: &[ViewTriangle], eye: DVec3) -> Result<Vec<Group>, AtlasError> {
    let mut waiting = vec![facets.to_vec()];
    let mut done = Vec::new();
    while let Some(part) = waiting.pop() {
        if let Some(group) = Group::around(&part, eye) {
            done.push((part, group));
        } else {
            let (first, second) = halves(part)?;
            waiting.extend([second, first]);
        }
        if done.len() + waiting.len() > SOURCE_PLANES_MAX {
            return Ok(cube(facets, eye));
        }
    }
    let mut at = 0;
    while at < done.len() && done.len() < SOURCE_PLANES_MAX {
        match cheaper_halves(&done[at]) {
            Some(both) => drop(done.splice(at..=at, both)),
            None => at += 1,
        }
    }
    Ok(done.into_iter().map(|(_, group)| group).collect())
}

/// Both halves of a group that takes too many pixels, where they take fewer.
fn cheaper_halves(
    (facets, group): &(Vec<ViewTriangle>, Group),
) -> Option<[(Vec<ViewTriangle>, Group); 2]> {
    let own = facets.iter().map(|facet| facet.area).sum::<f64>();
    let pixels = group.sides().element_product();
    if pixels <= WASTE_MAX * own {
        return None;
    }
    let (first, second) = halves(facets.clone()).ok()?;
    let both = [Group::around(&first, group.eye)?, Group::around(&second, group.eye)?];
    let halved = both.iter().map(|half| half.sides().element_product()).sum::<f64>();
    let [a, b] = both;
    (halved < HALVES_SHARE_MAX * pixels).then_some([(first, a), (second, b)])
}

/// Divides facets by the side of the channel along which they span more.
fn halves(facets: Vec<ViewTriangle>) -> Result<(Vec<ViewTriangle>, Vec<ViewTriangle>), AtlasError> {
    let mut span = DVec2::ZERO;
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for facet in &facets {
        let [right, below] = facet.slope.map(|slope| slope.length() / facet.rays[0].length());
        span += DVec2::new(right, below) * facet.area;
        (low, high) = (low.min(facet.middle), high.max(facet.middle));
    }
    let coarse = facets.first().map_or(DVec2::ZERO, |facet| facet.middle);
    let sides = span * (high - low);
    let middle = (low + high) / 2.0;
    let is_first = |facet: &ViewTriangle| {
        if sides.x >= sides.y { facet.middle.x < middle.x } else { facet.middle.y < middle.y }
    };
    let (first, second): (Vec<_>, Vec<_>) = facets.into_iter().partition(is_first);
    if first.is_empty() || second.is_empty() {
        return Err(AtlasError::Coarse(coarse));
    }
    Ok((first, second))
}

/// Axes of a view that looks along the middle of the rays, with the channel's rows across.
fn axes(facets: &[ViewTriangle]) -> Option<DMat3> {
    let mut forward = DVec3::ZERO;
    let mut area = 0.0;
    for facet in facets {
        forward += facet.middle_ray().normalize() * facet.area;
        area += facet.area;
    }
    (forward.length() >= 0.1 * area).then(|| {
        let slope = |facet: &ViewTriangle| facet.slope.map(|s| s / facet.middle_ray().length());
        view_along(forward, facets, slope)
    })
}

/// Axes of the view that the channel's pixels fill most evenly. A plane whose axis is n has
/// 1/(n·r)³ of its area in the solid angle around a ray r of length 1, so that all pixels are as
/// dense where n·r is as the cube root of what a pixel spans. Least squares over all pixels find
/// that n: for a projector at the eye, the axis of the projector.
fn even_axes(facets: &[ViewTriangle]) -> Option<DMat3> {
    let (mut normal, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    for facet in facets {
        let ray = facet.middle_ray();
        let toward = ray.normalize();
        let [right, below] = facet.slope;
        let solid_angle = right.cross(below).dot(toward).abs() / ray.length_squared();
        let weighted = toward * facet.area;
        normal += DMat3::from_cols(weighted * toward.x, weighted * toward.y, weighted * toward.z);
        sum += weighted * solid_angle.cbrt();
    }
    let forward = (normal.inverse() * sum).try_normalize()?;
    let is_in_front = |facet: &ViewTriangle| {
        facet.rays.iter().all(|ray| ray.dot(forward) > FRONT_MIN * ray.length())
    };
    facets.iter().all(is_in_front).then(|| {
        // By what a point on the plane moves from pixel to pixel.
        let slope = |facet: &ViewTriangle| {
            let ray = facet.middle_ray();
            let depth = ray.dot(forward);
            facet.slope.map(|s| (s - ray * (s.dot(forward) / depth)) / depth)
        };
        view_along(forward, facets, slope)
    })
}

/// A view along a direction whose rows run as the channel's do, or as its columns say, by what a
/// place moves from pixel to pixel.
fn view_along(
    forward: DVec3,
    facets: &[ViewTriangle],
    slope: impl Fn(&ViewTriangle) -> [DVec3; 2],
) -> DMat3 {
    let (mut right, mut below) = (DVec3::ZERO, DVec3::ZERO);
    for facet in facets {
        let [across, down] = slope(facet);
        right += across * facet.area;
        below += down * facet.area;
    }
    let back = -forward.normalize();
    let across = |v: DVec3| v - back * v.dot(back);
    // Where rows run around the axis of sight and cancel, columns may not.
    let (right, below) = (across(right), across(below));
    let x = if right.length() >= 0.5 * below.length() {
        right
    } else {
        let sign = facets[0].slope[0].cross(facets[0].slope[1]).dot(facets[0].rays[0]).signum();
        below.cross(back) * -sign
    };
    let x = x.normalize_or(back.any_orthonormal_vector());
    DMat3::from_cols(x, back.cross(x), back).transpose()
}

impl ViewTriangle {
    /// From the eye to its middle, in metres.
    pub fn middle_ray(&self) -> DVec3 {
        self.rays.iter().sum::<DVec3>() / 3.0
    }

    /// Returns the triangle of an eye at `from`, as seen by an eye at `to`.
    pub fn seen_from(&self, from: DVec3, to: DVec3) -> Self {
        Self { rays: self.rays.map(|ray| ray + (from - to)), ..*self }
    }
}

impl Group {
    /// The plane around all facets, where one suffices: the one that takes fewer pixels of the
    /// one along their middle and the one that they fill most evenly.
    pub fn around(facets: &[ViewTriangle], eye: DVec3) -> Option<Self> {
        let along = |axes: Option<DMat3>| Self::along(axes?, facets, eye);
        match (along(axes(facets)), along(even_axes(facets))) {
            (Some(middle), Some(even)) => {
                let [a, b] = [&middle, &even].map(|group| group.sides().element_product());
                Some(if b < a { even } else { middle })
            }
            (middle, even) => middle.or(even),
        }
    }

    /// The plane with these axes around all facets, where it is narrow enough.
    fn along(view_from_display: DMat3, facets: &[ViewTriangle], eye: DVec3) -> Option<Self> {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for ray in facets.iter().flat_map(|facet| facet.rays) {
            let tangent = tangent(view_from_display * ray)?;
            (low, high) = (low.min(tangent), high.max(tangent));
        }
        let span = |low: f64, high: f64| high.atan() - low.atan();
        let is_narrow =
            span(low.x, high.x) <= SOURCE_SPAN_MAX && span(low.y, high.y) <= SOURCE_SPAN_MAX;
        is_narrow.then(|| Self::new((eye, view_from_display), (low, high), facets))
    }

    /// The plane of these lower and upper edges around facets, seen from an eye along its −Z.
    pub fn new(
        (eye, view_from_display): (DVec3, DMat3),
        (low, high): (DVec2, DVec2),
        facets: &[ViewTriangle],
    ) -> Self {
        let mut steps = Vec::with_capacity(facets.len() * 3);
        for facet in facets {
            let slope = facet.slope.map(|slope| view_from_display * slope);
            for ray in facet.rays.map(|ray| view_from_display * ray) {
                let Some(tangent) = tangent(ray) else { continue };
                // The derivative of x/−z and y/−z.
                let [across, down] = slope.map(|s| (s.truncate() + tangent * s.z) / -ray.z);
                steps.push(DMat2::from_cols(across, down));
            }
        }
        Self { eye, view_from_display, low, high, steps }
    }

    /// The least sides in pixels for which no pixel of the channel is undersampled in any
    /// direction.
    pub fn sides(&self) -> DVec2 {
        let rows = |step: &DMat2| DVec2::new(step.row(0).length(), step.row(1).length());
        let is_seen = |rows: &DVec2| rows.min_element() > rows.max_element() / OBLIQUE_MAX;
        let least = self.steps.iter().map(rows).filter(is_seen).fold(DVec2::INFINITY, DVec2::min);
        let span = self.high - self.low;
        if !least.is_finite() {
            return DVec2::ONE;
        }
        let sides = span / least;
        // Rows that are not parallel to the channel's leave a direction that is sampled less.
        sides / self.density(sides).map_or(1.0, |density| density.least.min(1.0))
    }

    /// Returns the density of a picture with these sides in pixels; `None` if nothing of it is
    /// seen.
    pub fn density(&self, sides: DVec2) -> Option<Density> {
        let scale = sides / (self.high - self.low);
        let mut density = Density { least: f64::INFINITY, most: 0.0, across_down: DVec2::ZERO };
        for step in &self.steps {
            let [across, down] = [step.x_axis * scale, step.y_axis * scale];
            let [least, most] = singular(across, down);
            if least * OBLIQUE_MAX > most {
                density.least = density.least.min(least);
            }
            density.most = density.most.max(most);
            let lengths = DVec2::new(across.length(), down.length());
            density.across_down = density.across_down.max(lengths);
        }
        density.least.is_finite().then_some(density)
    }
}

/// x/−z and y/−z of a point in view space; `None` where it is not well in front of the eye.
fn tangent(view: DVec3) -> Option<DVec2> {
    (view.z < -FRONT_MIN * view.length()).then(|| view.truncate() / -view.z)
}

/// Least and largest singular value of a matrix with these columns.
fn singular(a: DVec2, b: DVec2) -> [f64; 2] {
    let (sum, product) = (a.length_squared() + b.length_squared(), a.perp_dot(b).abs());
    let root = (sum * sum - 4.0 * product * product).max(0.0).sqrt();
    let most = f64::midpoint(sum, root).sqrt();
    // Without the cancellation that the difference would have.
    [if most > 0.0 { product / most } else { 0.0 }, most]
}

/// The sides of a cube, the first one along the middle of the rays where there is one.
fn cube(facets: &[ViewTriangle], eye: DVec3) -> Vec<Group> {
    let first = axes(facets).unwrap_or(DMat3::IDENTITY);
    let turns = [0.0, 1.0, 2.0, 3.0].map(|quarters| DMat3::from_rotation_y(quarters * FRAC_PI_2));
    let poles = [FRAC_PI_2, -FRAC_PI_2].map(DMat3::from_rotation_x);
    let views = [turns.as_slice(), poles.as_slice()].concat();
    let views: Vec<DMat3> = views.into_iter().map(|turn| turn * first).collect();
    let mut owned = vec![Vec::new(); views.len()];
    for facet in facets {
        let middle = facet.rays.iter().sum::<DVec3>();
        let depth = |view: &DMat3| -(*view * middle).z;
        let nearest =
            (0..views.len()).max_by(|a, b| depth(&views[*a]).total_cmp(&depth(&views[*b])));
        owned[nearest.unwrap_or(0)].push(*facet);
    }
    let side = |(view, facets): (DMat3, &Vec<ViewTriangle>)| {
        Group::new((eye, view), (DVec2::NEG_ONE, DVec2::ONE), facets)
    };
    views.into_iter().zip(&owned).map(side).collect()
}
