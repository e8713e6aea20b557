//! Warp meshes of other systems: where the triangles of a viewport's picture go on its display.
//!
//! | ending | format | source |
//! |---|---|---|
//! | `.data` | Paul Bourke's mesh | <http://paulbourke.net/dataformats/meshwarp/> |
//! | `.obj` | Wavefront, position −1 to 1 on the window, UV in its picture | SGCT |
//! | `.csv` | domeprojection | as SGCT's reader documents it |
//! | `.simcad` | Barco SimCAD | the same |
//! | `.skyskan`, `.txt` | Sky-Skan, with its own frustum | the same |
//! | `.ol` | Scalable's OpenMesh 1.1, with its own frustum | the same |
//! | `.sgc` | SCISS, planar, with its own frustum | the same |
//! | `.pfm` | a place for each pixel of a float map | the same |

mod binary;
mod lines;
mod simcad;
#[cfg(test)]
mod tests;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use glam::{DQuat, DVec2, DVec3};

use super::tree::At;

/// Largest mesh file that is read, in bytes.
const MESH_BYTES_MAX: u64 = 256 << 20;

/// Most vertices of a mesh: one for each second pixel of a large projector, both ways.
const VERTICES_MAX: usize = 1 << 21;

/// How often triangles may cover the display.
const LAYERS_MAX: f64 = 256.0;

/// A place in a viewport's picture and a factor of its codes; `None` where nothing is drawn.
pub(super) type Sample = Option<(DVec2, f64)>;

/// Triangles of a picture and where they are drawn.
#[derive(Clone, Debug, Default)]
pub(super) struct Mesh {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<[u32; 3]>,
    /// The frustum of the picture, in formats that have one.
    pub frustum: Option<Frustum>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertex {
    /// On the display of the viewport, 0 to 1, up.
    pub place: DVec2,
    /// In the viewport's picture, 0 to 1, up.
    pub uv: DVec2,
    /// Factor of its codes; negative where nothing is drawn.
    pub light: f64,
}

/// Signed angles from an axis to the edges of a picture, in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frustum {
    pub up: f64,
    pub down: f64,
    pub left: f64,
    pub right: f64,
    pub rotation: DQuat,
    /// Added to the plane, in metres.
    pub offset: DVec3,
    /// Where the eye is moved, if the format says it.
    pub eye: Option<DVec3>,
}

/// Where a viewport lies, which meshes are measured in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Its lower left corner and its size in shares of the window.
    pub position: DVec2,
    pub size: DVec2,
    /// Its width by its height on the window, which shows it once for each eye where two pictures
    /// lie side by side or above each other.
    pub aspect: f64,
    /// The file maps places of the display to the picture, not the other way round.
    pub is_texture: bool,
}

/// Reads a mesh that a configuration names; its path begins at the configuration's folder.
pub(super) fn read(at: &At<'_>, frame: &Frame) -> anyhow::Result<Mesh> {
    let path = path_of(at)?;
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let bytes = fs::read(&path).map_err(|error| {
        at.error(format!("cannot read {}: {error}", path.display()), "check the file")
    })?;
    let mesh = match ending.as_str() {
        "data" => lines::bourke(&bytes, frame.aspect),
        "obj" => lines::obj(&bytes, frame),
        "csv" => lines::domeprojection(&bytes),
        "skyskan" | "txt" => lines::skyskan(&bytes),
        "ol" => lines::scalable(&bytes),
        "simcad" => simcad::read(&path, &bytes),
        "sgc" => binary::sciss(&bytes),
        "pfm" => binary::pfm(&bytes, frame.is_texture),
        _ => {
            let what = format!("meshes that end in .{ending} are not known");
            let remedy = "data, obj, csv, simcad, skyskan, txt, ol, sgc and pfm are read";
            return Err(at.error(what, remedy));
        }
    };
    let mesh = mesh.with_context(|| path.display().to_string())?;
    mesh.check().with_context(|| path.display().to_string())?;
    Ok(mesh)
}

/// The path of a file that a configuration names: a file that is there and not too large.
pub(super) fn path_of(at: &At<'_>) -> anyhow::Result<PathBuf> {
    let name = at.text()?.replace('\\', "/");
    let folder = at.tree.path.parent().unwrap_or(Path::new(""));
    let path = folder.join(&name);
    let remedy = format!("put it at {}, or correct the path", path.display());
    let found =
        fs::metadata(&path).map_err(|error| at.error(format!("{name}: {error}"), &remedy))?;
    if !found.is_file() {
        return Err(at.error(format!("{name} is no file"), &remedy));
    }
    if found.len() > MESH_BYTES_MAX {
        let what = format!("{name} has {} bytes", found.len());
        return Err(at.error(what, format!("{MESH_BYTES_MAX} bytes at most are read")));
    }
    at.tree.inputs.borrow_mut().push(path.clone());
    Ok(path)
}

impl Mesh {
    /// A grid, rows of vertices one after another; cells with a corner that is not drawn are left
    /// out.
    fn grid(columns: usize, vertices: Vec<Vertex>) -> Self {
        let rows = vertices.len() / columns.max(1);
        let mut triangles = Vec::new();
        for y in 1..rows {
            for x in 1..columns {
                let [a, b] = [(y - 1) * columns + x - 1, y * columns + x - 1].map(|at| at as u32);
                triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            }
        }
        Self { vertices, triangles, frustum: None }
    }

    fn check(&self) -> anyhow::Result<()> {
        let count = self.vertices.len();
        if count > VERTICES_MAX {
            bail!("it has {count} vertices; {VERTICES_MAX} at most would be right");
        }
        if self.triangles.is_empty() {
            bail!("it has no triangle; give a mesh of 2 by 2 nodes or more");
        }
        if let Some(corner) = self.triangles.iter().flatten().find(|c| **c as usize >= count) {
            bail!("a triangle names vertex {corner} of {count}; export the mesh again");
        }
        let is_sound = |v: &Vertex| v.place.is_finite() && v.uv.is_finite() && v.light.is_finite();
        if !self.vertices.iter().all(is_sound) {
            bail!("a vertex has a number that is none; export the mesh again");
        }
        Ok(())
    }

    /// For the centre of each pixel, row by row from the upper left, its place in the picture and
    /// its light: linear in each triangle, of several over each other the last.
    ///
    /// # Errors
    /// The triangles lie over each other so often that it would take minutes.
    pub fn sample(&self, size: [u32; 2]) -> anyhow::Result<Vec<Sample>> {
        let [width, height] = size.map(f64::from);
        let mut samples = vec![None; size[0] as usize * size[1] as usize];
        let mut visits = 0.0;
        for corners in &self.triangles {
            let corners = corners.map(|corner| self.vertices[corner as usize]);
            if corners.iter().any(|vertex| vertex.light < 0.0) {
                continue;
            }
            let at = corners.map(|v| DVec2::new(v.place.x * width, (1.0 - v.place.y) * height));
            let area = (at[1] - at[0]).perp_dot(at[2] - at[0]);
            if area == 0.0 {
                continue;
            }
            let low = at[0].min(at[1]).min(at[2]).ceil() - 1.0;
            let high = at[0].max(at[1]).max(at[2]).ceil();
            let (low, high) = (low.max(DVec2::ZERO), high.min(DVec2::new(width, height)));
            visits += (high - low).max(DVec2::ZERO).element_product();
            if visits > LAYERS_MAX * width * height {
                bail!("its triangles cover the display {LAYERS_MAX} times; export the mesh again");
            }
            for y in low.y as u32..high.y as u32 {
                for x in low.x as u32..high.x as u32 {
                    let point = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let b = (point - at[0]).perp_dot(at[2] - at[0]) / area;
                    let c = (at[1] - at[0]).perp_dot(point - at[0]) / area;
                    let shares = [1.0 - b - c, b, c];
                    if shares.iter().all(|share| *share >= -1e-9) {
                        let uv = (0..3).map(|i| corners[i].uv * shares[i]).sum();
                        let light = (0..3).map(|i| corners[i].light * shares[i]).sum();
                        samples[y as usize * size[0] as usize + x as usize] = Some((uv, light));
                    }
                }
            }
        }
        Ok(samples)
    }
}

/// Triangles of a strip: each vertex makes one with the two before it.
fn strip(indices: &[u32]) -> Vec<[u32; 3]> {
    indices.windows(3).map(|three| [three[0], three[1], three[2]]).collect()
}

fn fault(line: usize, what: &str, remedy: &str) -> anyhow::Error {
    anyhow!("line {line}: {what}; {remedy}")
}
