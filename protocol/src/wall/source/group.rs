//! Triangles of a warp that one plane shows, and how dense it must be.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::{
    BACK_SHARE_MAX, SOURCE_DISTANCE_MIN_M, SOURCE_PLANES_MAX, SOURCE_SPAN_MAX, SourceError,
    WarpMesh,
};

/// Of a triangle seen more obliquely than this, the direction along the line of sight is left out
/// of account: it has as good as no picture.
const OBLIQUE_MAX: f64 = 64.0;

/// A triangle as the eye sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    /// From the eye to its corners, in metres.
    rays: [DVec3; 3],
    /// By what the point moves from pixel to pixel, across and down, in metres.
    slope: [DVec3; 2],
    /// Its middle, in pixels of the channel.
    middle: DVec2,
    /// In pixels of the channel.
    pub area: f64,
}

/// The triangles of one plane.
#[derive(Clone, Debug)]
pub(super) struct Group {
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

/// The triangles of a mesh, checked against the eye.
pub(super) fn facets(mesh: &WarpMesh, eye: DVec3) -> Result<Vec<Facet>, SourceError> {
    let mut facets = Vec::with_capacity(mesh.triangles.len());
    // Areas that the eye sees from either side, and where.
    let mut sides = [(0.0, DVec2::ZERO); 2];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|index| mesh.vertices[index as usize]);
        let (ab, ac) = (b.pixel - a.pixel, c.pixel - a.pixel);
        let doubled = ab.perp_dot(ac);
        if doubled == 0.0 {
            continue;
        }
        let rays = [a, b, c].map(|vertex| vertex.point - eye);
        let on_surface = rays.iter().position(|ray| ray.length() < SOURCE_DISTANCE_MIN_M);
        if let Some(pixel) = on_surface.map(|corner| [a, b, c][corner].pixel) {
            return Err(SourceError::EyeOnSurface { eye, pixel });
        }
        let (p, q) = (b.point - a.point, c.point - a.point);
        let slope = [(p * ac.y - q * ab.y) / doubled, (q * ab.x - p * ac.x) / doubled];
        let middle = (a.pixel + b.pixel + c.pixel) / 3.0;
        let area = doubled.abs() / 2.0;
        let (seen, middle_of) =
            &mut sides[usize::from(slope[0].cross(slope[1]).dot(rays[0]) < 0.0)];
        *seen += area;
        *middle_of = middle;
        facets.push(Facet { rays, slope, middle, area });
    }
    let [front, back] = sides;
    let (few, many) = if front.0 < back.0 { (front, back) } else { (back, front) };
    if facets.is_empty() {
        return Err(SourceError::Nothing);
    }
    if few.0 > BACK_SHARE_MAX * many.0 {
        // By where a viewer stands who sees the picture unmirrored.
        return Err(SourceError::EyeBehind { eye, pixel: back.1 });
    }
    Ok(facets)
}

/// All facets in groups of one plane each.
pub(super) fn groups(facets: &[Facet]) -> Result<Vec<Group>, SourceError> {
    let mut waiting = vec![facets.to_vec()];
    let mut done = Vec::new();
    while let Some(part) = waiting.pop() {
        if let Some(group) = Group::around(&part) {
            done.push(group);
        } else {
            let (first, second) = halves(part)?;
            waiting.extend([second, first]);
        }
        if done.len() + waiting.len() > SOURCE_PLANES_MAX {
            return Ok(cube(facets));
        }
    }
    Ok(done)
}

/// Divides facets by the side of the channel along which they span more.
fn halves(facets: Vec<Facet>) -> Result<(Vec<Facet>, Vec<Facet>), SourceError> {
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
    let is_first = |facet: &Facet| {
        if sides.x >= sides.y { facet.middle.x < middle.x } else { facet.middle.y < middle.y }
    };
    let (first, second): (Vec<_>, Vec<_>) = facets.into_iter().partition(is_first);
    if first.is_empty() || second.is_empty() {
        return Err(SourceError::Coarse(coarse));
    }
    Ok((first, second))
}

/// Axes of a view that looks along the middle of the rays, with the channel's rows across.
fn axes(facets: &[Facet]) -> Option<DMat3> {
    let (mut forward, mut right, mut below) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    let mut area = 0.0;
    for facet in facets {
        let ray = facet.rays.iter().sum::<DVec3>() / 3.0;
        let distance = ray.length();
        forward += ray / distance * facet.area;
        right += facet.slope[0] / distance * facet.area;
        below += facet.slope[1] / distance * facet.area;
        area += facet.area;
    }
    if forward.length() < 0.1 * area {
        return None;
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
    Some(DMat3::from_cols(x, back.cross(x), back).transpose())
}

impl Group {
    /// The plane around all facets, where one suffices.
    fn around(facets: &[Facet]) -> Option<Self> {
        let view_from_display = axes(facets)?;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for ray in facets.iter().flat_map(|facet| facet.rays) {
            let tangent = tangent(view_from_display * ray)?;
            (low, high) = (low.min(tangent), high.max(tangent));
        }
        let span = |low: f64, high: f64| high.atan() - low.atan();
        let is_narrow =
            span(low.x, high.x) <= SOURCE_SPAN_MAX && span(low.y, high.y) <= SOURCE_SPAN_MAX;
        is_narrow.then(|| Self::new(view_from_display, low, high, facets))
    }

    fn new(view_from_display: DMat3, low: DVec2, high: DVec2, facets: &[Facet]) -> Self {
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
        Self { view_from_display, low, high, steps }
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

    /// How dense a picture of these sides in pixels is; `None` where nothing of it is seen.
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
    (view.z < -1e-3 * view.length()).then(|| view.truncate() / -view.z)
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
fn cube(facets: &[Facet]) -> Vec<Group> {
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
    let side =
        |(view, facets): (DMat3, Vec<Facet>)| Group::new(view, DVec2::NEG_ONE, DVec2::ONE, &facets);
    views.into_iter().zip(owned).map(side).collect()
}
