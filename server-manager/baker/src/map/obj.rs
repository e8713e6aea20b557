//! OBJ meshes: `v`, `vt` and `f`; all else is left alone.
//!
//! Positions are metres of display space. `vt` is a place on the channel's picture (a screen mesh:
//! on the screen's canvas), u to the right and v up, as OBJ means it. Polygons become fans.
//!
//! SGCT has it the other way round: positions are places on the window, −1 to 1, and `vt` is what
//! is shown there. A corner without a UV has the one of its position's number.
//!
//! Read here and not by a crate, because the known ones keep no lines, and a message about a mesh
//! of a million faces that names none helps nobody.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use polyptych_wall::warp::{
    ImportedMesh, ImportedVertex, MAP_TRIANGLES_MAX, MAP_VERTICES_MAX, MapCoordinates,
    WARP_REACH_M_MAX, WarpGeometry, WarpMap,
};

use super::super::error::BakeError;
use super::super::uri::shorten;
use super::{foldover, text};

/// The meaning of positions and UV in an OBJ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Roles {
    /// Points in metres, and places of a picture.
    #[default]
    Room,
    /// Places of a picture, and places of the canvas.
    Sgct,
}

/// The data that is read so far.
#[derive(Default)]
struct Reader {
    roles: Roles,
    positions: Vec<Vec3>,
    /// v down.
    uvs: Vec<Vec2>,
    vertices: Vec<ImportedVertex>,
    /// By position and UV, both as counted in the file.
    known: HashMap<(u32, u32), u32>,
    triangles: Vec<[u32; 3]>,
    /// The line of each triangle.
    lines: Vec<usize>,
}

/// Reads a mesh.
pub(super) fn read(bytes: &[u8], roles: Roles) -> Result<WarpMap, BakeError> {
    let mut reader = Reader { roles, ..Reader::default() };
    for (line, content) in text::lines(bytes) {
        let mut words = content.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let [x, y, z] = text::numbers(&mut words, line, "v X Y Z")?;
                reader.positions.push(point([x, y, z], line)?);
            }
            Some("vt") => {
                let [u, v] = text::numbers(&mut words, line, "vt U V")?;
                reader.uvs.push(Vec2::new(u as f32, (1.0 - v) as f32));
            }
            Some("f") => reader.face(words, line)?,
            _ => {}
        }
    }
    if reader.triangles.is_empty() {
        let right = "lines of v, vt and f would be right";
        return Err(BakeError::at("file", "it has no faces", right));
    }
    let lines = reader.lines;
    let mesh = ImportedMesh { vertices: reader.vertices, triangles: reader.triangles };
    let mesh = foldover::check(mesh, |triangle| text::place(lines[triangle]))?;
    let space = if roles == Roles::Sgct { MapCoordinates::Canvas } else { MapCoordinates::Display };
    Ok(WarpMap { space, shape: WarpGeometry::Mesh(mesh) })
}

fn point(point: [f64; 3], line: usize) -> Result<Vec3, BakeError> {
    if point.iter().all(|number| number.abs() <= f64::from(WARP_REACH_M_MAX)) {
        return Ok(Vec3::from_array(point.map(|number| number as f32)));
    }
    let what = format!("the point {point:?} is too far away");
    let right = format!("metres, at most {WARP_REACH_M_MAX} of them, would be right");
    Err(BakeError::at(text::place(line), what, right))
}

impl Reader {
    fn face<'a>(
        &mut self,
        words: impl Iterator<Item = &'a str>,
        line: usize,
    ) -> Result<(), BakeError> {
        let mut corners = [0u32; 2];
        let mut count = 0;
        for word in words {
            let corner = self.corner(word, line)?;
            match count {
                0 | 1 => corners[count] = corner,
                _ => {
                    if self.triangles.len() >= MAP_TRIANGLES_MAX as usize {
                        let right = format!("{MAP_TRIANGLES_MAX} triangles would be right");
                        return Err(BakeError::at(text::place(line), "there are more", right));
                    }
                    self.triangles.push([corners[0], corners[1], corner]);
                    self.lines.push(line);
                    corners[1] = corner;
                }
            }
            count += 1;
        }
        if count < 3 {
            let what = format!("the face has {count} corners");
            return Err(BakeError::at(text::place(line), what, "three or more would be right"));
        }
        Ok(())
    }

    fn corner(&mut self, word: &str, line: usize) -> Result<u32, BakeError> {
        let bad = |what: String| {
            let right = "POSITION/UV, counted from 1, would be right";
            BakeError::at(text::place(line), what, right)
        };
        let mut parts = word.split('/');
        let position = parts.next().unwrap_or_default();
        let mut uv = parts.next().unwrap_or_default();
        if uv.is_empty() && self.roles == Roles::Sgct {
            uv = position;
        }
        if uv.is_empty() {
            return Err(bad(format!("the corner '{}' has no UV", shorten(word))));
        }
        let index = |text: &str, count: usize| {
            let number: i64 = text.parse().ok()?;
            // Negative numbers count back from the last one.
            let index = if number < 0 { count as i64 + number } else { number - 1 };
            u32::try_from(index).ok().filter(|&index| (index as usize) < count)
        };
        let missing = |list: &str, count: usize| {
            bad(format!("the corner '{}' names a {list} of {count}", shorten(word)))
        };
        let position = index(position, self.positions.len())
            .ok_or_else(|| missing("position", self.positions.len()))?;
        let uv = index(uv, self.uvs.len()).ok_or_else(|| missing("UV", self.uvs.len()))?;
        if let Some(&known) = self.known.get(&(position, uv)) {
            return Ok(known);
        }
        if self.vertices.len() >= MAP_VERTICES_MAX as usize {
            let right = format!("{MAP_VERTICES_MAX} vertices would be right");
            return Err(BakeError::at(text::place(line), "there are more", right));
        }
        let index = self.vertices.len() as u32;
        let (at, uv_there) = (self.positions[position as usize], self.uvs[uv as usize]);
        let (place, value) = match self.roles {
            Roles::Room => (uv_there, at),
            Roles::Sgct => {
                (Vec2::new(1.0 + at.x, 1.0 - at.y) / 2.0, Vec3::new(uv_there.x, uv_there.y, 0.0))
            }
        };
        self.vertices.push(ImportedVertex { place, value, light: 1.0 });
        self.known.insert((position, uv), index);
        Ok(index)
    }
}
