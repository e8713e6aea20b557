//! The data that all parts of a mesh share while its levels are made.

use foldhash::{HashMap, HashMapExt};
use glam::{DVec2, DVec3, DVec4};
use meshopt::VertexDataAdapter;
use polyptych_scene::VertexLayout;

use super::clustering::MovedVertex;
use super::surface::{Surface, VertexRow, uv_places};

/// Tangents are alike if the cosine between them is at least this: that of 60°.
const TANGENT_COSINE_MIN: f64 = 0.5;

/// The vertices of the surfaces of a mesh, which are numbered one after another, and behind them
/// those that only coarser levels have.
#[derive(Clone, Debug)]
pub(super) struct Source<'a> {
    surfaces: &'a [Surface<'a>],
    /// The attributes that any of them has.
    attributes: VertexLayout,
    /// `true` for a part, which has none of the surfaces' own vertices in their place.
    is_part: bool,
    /// The surfaces that vertices may be of: all, or those of a part's vertices alone, since a mesh
    /// may have a million.
    numbers: Vec<u32>,
    /// For each of `numbers`, the vertices behind the surface's own, as its blob holds them.
    added: Vec<Vec<f32>>,
    /// The place of each vertex's surface in `numbers`.
    list_of: Vec<u32>,
    /// The number of each vertex in its surface.
    row_of: Vec<u32>,
    /// The positions times a power of two, which makes the largest coordinate about 1: exact, and
    /// far from where f32 ends.
    pub scaled: Vec<[f32; 3]>,
    /// The first vertex at the position of each.
    pub welded: Vec<u32>,
    /// See [`Self::origin`], of those that only coarser levels have.
    origins: HashMap<u32, u32>,
}

impl<'a> Source<'a> {
    /// Looks at all surfaces of a mesh.
    pub fn new(surfaces: &'a [Surface<'a>]) -> Self {
        let (mut list_of, mut row_of) = (Vec::new(), Vec::new());
        for (number, surface) in (0..).zip(surfaces) {
            row_of.extend(0..surface.vertex_count() as u32);
            list_of.resize(row_of.len(), number);
        }
        let any = |has: fn(&VertexLayout) -> bool| surfaces.iter().any(|of| has(&of.layout));
        let attributes = VertexLayout {
            tangent: any(|of| of.tangent),
            uv0: any(|of| of.uv0),
            uv1: any(|of| of.uv1),
            color: any(|of| of.color),
        };
        let mut source = Self {
            surfaces,
            attributes,
            is_part: false,
            numbers: (0..surfaces.len() as u32).collect(),
            added: vec![Vec::new(); surfaces.len()],
            list_of,
            row_of,
            scaled: Vec::new(),
            welded: Vec::new(),
            origins: HashMap::new(),
        };
        source.weld();
        source
    }

    /// Finds the vertices that have one position.
    fn weld(&mut self) {
        let vertices = 0..self.vertex_count() as u32;
        let magnitude = vertices.clone().map(|vertex| self.position(vertex).abs().max_element());
        let magnitude = magnitude.fold(0.0, f64::max);
        let factor = if magnitude > 0.0 { (-magnitude.log2().floor()).exp2() } else { 1.0 };
        let scaled = |vertex| (self.position(vertex) * factor).as_vec3().to_array();
        self.scaled = vertices.clone().map(scaled).collect();
        // By the positions as they are: two that only the factor made one remain two.
        let mut first_at = HashMap::with_capacity(self.scaled.len());
        let weld = |vertex| {
            // Adding zero makes -0 and 0 one.
            let position = (self.position(vertex) + DVec3::ZERO).to_array().map(f64::to_bits);
            *first_at.entry(position).or_insert(vertex)
        };
        self.welded = vertices.map(weld).collect();
    }

    /// Returns these vertices alone, numbered in the order of the list, which rises.
    pub fn part(&self, vertices: &[u32]) -> Self {
        let mut part = Self {
            surfaces: self.surfaces,
            attributes: self.attributes,
            is_part: true,
            numbers: Vec::new(),
            added: Vec::new(),
            list_of: Vec::with_capacity(vertices.len()),
            row_of: Vec::with_capacity(vertices.len()),
            scaled: vertices.iter().map(|vertex| self.scaled[*vertex as usize]).collect(),
            welded: Vec::with_capacity(vertices.len()),
            origins: HashMap::new(),
        };
        let mut first_at = HashMap::with_capacity(vertices.len());
        let mut list_at = HashMap::new();
        for (number, vertex) in (0..).zip(vertices) {
            let (row, surface) = (self.row(*vertex), self.surface_of(*vertex));
            let list = *list_at.entry(surface).or_insert_with(|| {
                part.numbers.push(surface);
                part.added.push(Vec::new());
                part.added.len() as u32 - 1
            });
            part.list_of.push(list);
            let rows = &mut part.added[list as usize];
            part.row_of.push((rows.len() / row.floats.len()) as u32);
            rows.extend_from_slice(row.floats);
            let at = self.welded[*vertex as usize];
            part.welded.push(*first_at.entry(at).or_insert(number));
            let origin = self.origins.get(vertex).map(|origin| vertices.binary_search(origin));
            if let Some(Ok(origin)) = origin {
                part.origins.insert(number, origin as u32);
            }
        }
        part
    }

    /// Adds a vertex; returns its number.
    pub fn add(&mut self, moved: &MovedVertex) -> u32 {
        let row = self.row(moved.from);
        let mut floats = row.floats.to_vec();
        floats[..3].copy_from_slice(&self.row(moved.at).floats[..3]);
        for (at, uv) in uv_places(row.layout).into_iter().zip(moved.uvs) {
            if let Some(at) = at {
                floats[at..at + 2].copy_from_slice(&uv.as_vec2().to_array());
            }
        }
        let list = self.list_of[moved.from as usize];
        let own = self.own_vertices(self.surface_of(moved.from) as usize).len();
        let rows = &mut self.added[list as usize];
        self.row_of.push(((own + rows.len()) / floats.len()) as u32);
        rows.extend(floats);
        self.list_of.push(list);
        self.scaled.push(self.scaled[moved.at as usize]);
        self.welded.push(self.welded[moved.at as usize]);
        let number = self.vertex_count() as u32 - 1;
        self.origins.insert(number, self.origin(moved.origin));
        number
    }

    /// Returns the vertex of the finest level of whose chart a vertex is; itself, if it is of that
    /// level, or a part has not that vertex.
    pub fn origin(&self, vertex: u32) -> u32 {
        self.origins.get(&vertex).copied().unwrap_or(vertex)
    }

    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.list_of.len()
    }

    /// Returns the vertices of a surface that only coarser levels have, of a source of all.
    pub fn added_to(&self, surface: usize) -> &[f32] {
        &self.added[surface]
    }

    /// Returns the surfaces.
    pub fn surfaces(&self) -> &'a [Surface<'a>] {
        self.surfaces
    }

    /// Returns the attributes that any surface has.
    pub fn attributes(&self) -> VertexLayout {
        self.attributes
    }

    /// Returns whether the triangles of all levels are drawn in the order of the file, which then
    /// are those of one surface. A surface that is drawn so beside others that are not has no
    /// coarser levels.
    pub fn keeps_order(&self) -> bool {
        matches!(self.surfaces, [surface] if surface.keeps_order)
    }

    /// Gives the triangles of each surface in turn, as the mesh numbers vertices.
    pub fn triangles(&self) -> impl Iterator<Item = Vec<u32>> + use<'a> {
        self.surfaces.iter().scan(0_u32, |first, surface| {
            let before = *first;
            *first += surface.vertex_count() as u32;
            Some(surface.indices.iter().map(|vertex| before + vertex).collect::<Vec<u32>>())
        })
    }

    /// Returns for each vertex whether it stays in all levels, at the first one at its position.
    pub fn locked(&self) -> Vec<bool> {
        let mut locked = vec![false; self.vertex_count()];
        let mut first = 0;
        for surface in self.surfaces {
            for vertex in surface.locked {
                locked[self.welded[(first + vertex) as usize] as usize] = true;
            }
            first += surface.vertex_count() as u32;
        }
        locked
    }

    /// Returns the number of a vertex in its surface.
    pub fn vertex_in_surface(&self, vertex: u32) -> u32 {
        self.row_of[vertex as usize]
    }

    /// Returns the surface of a vertex.
    pub fn surface_of(&self, vertex: u32) -> u32 {
        self.numbers[self.list_of[vertex as usize] as usize]
    }

    fn row(&self, vertex: u32) -> VertexRow<'_> {
        let surface = self.surface_of(vertex) as usize;
        let layout = self.surfaces[surface].layout;
        let stride = layout.stride() as usize / 4;
        let first = self.row_of[vertex as usize] as usize * stride;
        let own = self.own_vertices(surface);
        let floats = match first.checked_sub(own.len()) {
            None => &own[first..first + stride],
            Some(first) => {
                let list = self.list_of[vertex as usize] as usize;
                &self.added[list][first..first + stride]
            }
        };
        VertexRow { layout, floats }
    }

    /// The vertices of a surface that stand before those of `added`.
    fn own_vertices(&self, surface: usize) -> &'a [f32] {
        if self.is_part { &[] } else { self.surfaces[surface].vertices }
    }

    /// Returns the position of a vertex.
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.row(vertex).position()
    }

    /// Returns the normal of a vertex, of unit length.
    pub fn normal(&self, vertex: u32) -> DVec3 {
        self.row(vertex).normal()
    }

    /// Returns whether a texture is mirrored at one of two vertices and not at the other one, as
    /// their tangents say.
    pub fn is_mirrored(&self, one: u32, other: u32) -> bool {
        let is_left = |vertex| self.row(vertex).tangent().is_some_and(|of| of.w < 0.0);
        is_left(one) != is_left(other)
    }

    /// Returns whether two vertices have tangents of nearly one direction; `true` without tangents.
    pub fn has_tangents_alike(&self, one: u32, other: u32) -> bool {
        let [one, other] = [one, other].map(|vertex| self.row(vertex).tangent());
        let (Some(one), Some(other)) = (one, other) else { return true };
        let [one, other] = [one, other].map(DVec4::truncate);
        one.dot(other) >= TANGENT_COSINE_MIN * one.length() * other.length()
    }

    /// Returns the texture coordinates of a vertex; see [`VertexRow::uvs`].
    pub fn uvs(&self, vertex: u32) -> [DVec2; 2] {
        self.row(vertex).uvs()
    }

    /// Returns the linear RGBA of a vertex; white if it has none.
    pub fn color(&self, vertex: u32) -> [f64; 4] {
        let color: Option<[f32; 4]> = self.row(vertex).color().and_then(|of| of.try_into().ok());
        color.map_or([1.0; 4], |color| color.map(f64::from))
    }
}

/// Returns positions as meshoptimizer takes them.
pub(super) fn adapter(positions: &[[f32; 3]]) -> Option<VertexDataAdapter<'_>> {
    VertexDataAdapter::new(meshopt::typed_to_bytes(positions), size_of::<[f32; 3]>(), 0).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part of few surfaces takes no memory for all others, and has their vertices.
    #[test]
    fn a_part_holds_only_the_surfaces_of_its_vertices() {
        let layout = |at: usize| VertexLayout {
            tangent: at.is_multiple_of(3),
            uv0: at.is_multiple_of(2),
            uv1: at.is_multiple_of(5),
            color: at.is_multiple_of(7),
        };
        // Three vertices each, of which a number says where it stands.
        let rows = |at: usize| -> Vec<f32> {
            let stride = layout(at).stride() as usize / 4;
            (0..3 * stride).map(|number| (1000 * at + number) as f32).collect()
        };
        let vertices: Vec<Vec<f32>> = (0..500).map(rows).collect();
        let mut surfaces = Vec::new();
        for (at, vertices) in vertices.iter().enumerate() {
            surfaces.push(Surface {
                layout: layout(at),
                vertices,
                indices: &[0, 1, 2],
                keeps_order: false,
                locked: &[],
            });
        }
        let source = Source::new(&surfaces);
        let all = VertexLayout { tangent: true, uv0: true, uv1: true, color: true };
        assert_eq!(source.attributes(), all);
        // One of surface 7 and 11 each, and two of surface 210.
        let chosen = [21, 35, 630, 632];
        let mut part = source.part(&chosen);
        assert_eq!((part.added.len(), part.numbers.len()), (3, 3));
        let is_same = |own: u32, vertex: u32| {
            assert_eq!(part.surface_of(own), source.surface_of(vertex));
            assert_eq!(part.row(own).floats, source.row(vertex).floats);
            assert_eq!(part.row(own).layout, source.row(vertex).layout);
        };
        (0..).zip(chosen).for_each(|(own, vertex)| is_same(own, vertex));
        let uvs = [DVec2::new(0.5, 0.25), DVec2::new(2.0, 4.0)];
        let added = part.add(&MovedVertex { from: 2, at: 0, uvs, origin: 3 });
        assert_eq!((part.origin(added), part.origin(3)), (3, 3));
        assert_eq!((added, part.surface_of(added)), (4, 210));
        assert_eq!(part.position(added), source.position(21));
        assert_eq!((part.uvs(added), part.color(added)), (uvs, source.color(630)));
    }
}
