//! Barco SimCAD's geometry files: XML with a square grid of moves, in shares of the picture.

use std::path::Path;

use anyhow::{anyhow, bail};
use glam::DVec2;

use super::super::tree::At;
use super::super::xml;
use super::{Mesh, VERTICES_MAX, Vertex};

pub(super) fn read(path: &Path, bytes: &[u8]) -> anyhow::Result<Mesh> {
    let (tree, root) = xml::parse(path, std::str::from_utf8(bytes)?)?;
    if root != "geometryfile" {
        bail!("its root is {root}; GeometryFile would be right");
    }
    let definition = tree.at().need("geometrydefinition")?;
    let [x, y] = ["x-flatparameters", "y-flatparameters"].map(|name| moves(&definition, name));
    let (x, y) = (x?, y?);
    let side = (x.len() as f64).sqrt().round() as usize;
    if side < 2 || side * side != x.len() || x.len() != y.len() || x.len() > VERTICES_MAX {
        let counts = (x.len(), y.len());
        bail!(
            "it has {} and {} moves; as many for a square grid would be right",
            counts.0,
            counts.1
        );
    }
    let vertex = |at: usize| {
        let of = |index: usize| index as f64 / (side - 1) as f64;
        let uv = DVec2::new(of(at % side), 1.0 - of(at / side));
        Vertex { place: uv + DVec2::new(x[at], -y[at]), uv, light: 1.0 }
    };
    Ok(Mesh::grid(side, (0..x.len()).map(vertex).collect()))
}

/// Moves in shares of the picture: the element's numbers by its `range`.
fn moves(definition: &At<'_>, name: &str) -> anyhow::Result<Vec<f64>> {
    let element = definition.need(name)?;
    let range = element.need("range")?.number()?;
    if range == 0.0 {
        return Err(element.error("its range is 0", "another would be right"));
    }
    let text = element.need("#text")?;
    let number = |word: &str| {
        let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
        number.map(|number| number / range).ok_or_else(|| anyhow!("{word:?} is no number"))
    };
    text.text()?.split_whitespace().map(number).collect()
}
