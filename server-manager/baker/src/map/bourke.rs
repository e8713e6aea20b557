//! Paul Bourke's warp mesh, <http://paulbourke.net/dataformats/meshwarp/>: a text file.
//!
//! ```text
//! 2                 the kind of picture: 2 is rectangular
//! 64 36             nodes across and down
//! x y u v i         a node for each line, row after row
//! ```
//!
//! x is −aspect to aspect and y −1 to 1 across the projector, up; u and v are 0 to 1 on the
//! picture, up; i is a factor of the stored colours, taken as encoded with gamma 2.2, and negative
//! where nothing is drawn: cells with such a corner are unlit. The diagonal of a cell begins at its
//! first node, as SGCT draws it; the format leaves it open.

use glam::{Vec2, Vec3};
use polyptych_text::counted;
use polyptych_wall::warp::{
    ImportedMesh, ImportedVertex, MAP_VERTICES_MAX, MapCoordinates, PLACE_REACH_MAX, WarpGeometry,
    WarpMap,
};

use super::super::error::BakeError;
use super::{foldover, text};

/// The factors multiply colours as a program of its time has them in memory.
const GAMMA: f64 = 2.2;

/// Reads a mesh for a channel whose width by its height is `aspect`.
pub(super) fn read(bytes: &[u8], aspect: Option<f64>) -> Result<WarpMap, BakeError> {
    let Some(aspect) = aspect else {
        let what = "channels of several shapes use it, and x is measured in the height of one";
        return Err(BakeError::at("file", what, "a file for each shape would be right"));
    };
    let mut lines = text::lines(bytes).filter(|(_, content)| !content.is_empty());
    let mut next = |right: &str| {
        let line = lines.next();
        line.ok_or_else(|| BakeError::at("file", "it is truncated", format!("{right} has to come")))
    };
    let (line, kind) = next("the kind of mesh")?;
    if kind != "2" {
        let known = match kind {
            "1" => "it is a polar mesh, of fisheye pictures".to_owned(),
            other => format!("the kind of mesh is '{}'", super::super::uri::shorten(other)),
        };
        return Err(BakeError::at(text::place(line), known, "2, rectangular, would be right"));
    }
    let (line, sizes) = next("nodes across and down")?;
    let size = |word: Option<&str>| word?.parse::<u32>().ok().filter(|&side| side >= 2);
    let mut words = sizes.split_ascii_whitespace();
    let (columns, rows) = (size(words.next()), size(words.next()));
    let count = columns.zip(rows).and_then(|(columns, rows)| columns.checked_mul(rows));
    let (Some(columns), Some(rows), Some(count)) =
        (columns, rows, count.filter(|&count| count <= MAP_VERTICES_MAX))
    else {
        let what = format!("the mesh is '{}'", super::super::uri::shorten(sizes));
        let right = format!("two numbers, 2 or more, {MAP_VERTICES_MAX} nodes at most, are right");
        return Err(BakeError::at(text::place(line), what, right));
    };
    let mut vertices = Vec::new();
    let mut is_lit = Vec::new();
    let mut places = Vec::new();
    for at in 0..count {
        let (line, content) = next(&format!("node {} of {count}", at + 1))?;
        let (vertex, lit) = node(content, line, aspect)?;
        vertices.push(vertex);
        is_lit.push(lit);
        places.push(line);
    }
    if let Some((line, _)) = lines.next() {
        let what = format!("a line follows the last of {}", counted(count, "node"));
        return Err(BakeError::at(text::place(line), what, "the end would be right"));
    }
    let triangles = cells(columns, rows, |node| is_lit[node as usize]);
    if triangles.is_empty() {
        let what = "no cell of the mesh is lit";
        return Err(BakeError::at("file", what, "intensities of 0 to 1 would be right"));
    }
    let firsts: Vec<u32> = triangles.iter().map(|[first, ..]| *first).collect();
    let mesh = ImportedMesh { vertices, triangles };
    let mesh = foldover::check(mesh, |triangle| text::place(places[firsts[triangle] as usize]))?;
    Ok(WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Mesh(mesh) })
}

/// A node, and whether it is lit.
fn node(content: &str, line: usize, aspect: f64) -> Result<(ImportedVertex, bool), BakeError> {
    let mut words = content.split_ascii_whitespace();
    let [x, y, u, v, intensity] = text::numbers(&mut words, line, "x y u v i")?;
    let reach = f64::from(PLACE_REACH_MAX);
    let is_near = [x / aspect / 2.0, y / 2.0, u, v].iter().all(|n| n.abs() < reach - 1.0);
    if !is_near || intensity > 1.0 {
        let what = format!("the node {content} is out of range");
        let right = format!("x within ±{aspect:.3}, y within ±1, u, v and i of 0 to 1 are right");
        return Err(BakeError::at(text::place(line), what, right));
    }
    let place = Vec2::new(f64::midpoint(x / aspect, 1.0) as f32, ((1.0 - y) / 2.0) as f32);
    let value = Vec3::new(u as f32, (1.0 - v) as f32, 0.0);
    let light = intensity.max(0.0).powf(GAMMA) as f32;
    Ok((ImportedVertex { place, value, light }, intensity >= 0.0))
}

/// Two triangles for each cell whose four corners are lit.
fn cells(columns: u32, rows: u32, is_lit: impl Fn(u32) -> bool) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let corner = row * columns + column;
            let corners = [corner, corner + 1, corner + columns, corner + columns + 1];
            if corners.iter().all(|&node| is_lit(node)) {
                let [a, b, c, d] = corners;
                triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
    }
    triangles
}
