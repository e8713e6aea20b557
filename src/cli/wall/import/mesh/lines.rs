//! Meshes of lines of text.

use std::collections::BTreeMap;

use anyhow::bail;
use glam::{DQuat, DVec2, DVec3, EulerRot};

use super::{Frame, Frustum, Mesh, VERTICES_MAX, Vertex, fault};

/// The lines that say anything, each with its number.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &str)> {
    bytes.split(|byte| *byte == b'\n').enumerate().filter_map(|(at, line)| {
        let text = std::str::from_utf8(line).ok()?.trim();
        (!text.is_empty()).then_some((at + 1, text))
    })
}

/// All numbers of a line; `None` if a word is none.
fn numbers<const N: usize>(text: &str, split: impl Fn(char) -> bool) -> Option<[f64; N]> {
    let words = text.split(split).filter(|word| !word.is_empty());
    let numbers: Option<Vec<f64>> = words.map(|word| word.trim().parse().ok()).collect();
    numbers?.get(..N)?.try_into().ok()
}

/// Columns and rows of a grid.
fn grid_size(size: Option<[f64; 2]>, line: usize) -> anyhow::Result<[usize; 2]> {
    let is_side = |side: &f64| side.fract() == 0.0 && (2.0..=1e6).contains(side);
    let size = size.filter(|size| size.iter().all(is_side)).map(|size| size.map(|s| s as usize));
    let fits = size.filter(|[columns, rows]| columns * rows <= VERTICES_MAX);
    let remedy = format!("columns and rows, 2 or more, {VERTICES_MAX} nodes at most, are right");
    fits.ok_or_else(|| fault(line, "the size of the grid is wrong", &remedy))
}

/// Paul Bourke's: x is −aspect to aspect, y −1 to 1; nodes of negative light are not drawn.
pub(super) fn bourke(bytes: &[u8], aspect: f64) -> anyhow::Result<Mesh> {
    let mut lines = lines(bytes);
    let Some((_, "2" | "1")) = lines.next() else {
        bail!("line 1: the kind of mesh is missing; 1 or 2 would be right");
    };
    let (line, text) = lines.next().unwrap_or((2, ""));
    let [columns, rows] = grid_size(numbers(text, char::is_whitespace), line)?;
    let mut vertices = Vec::new();
    for (line, text) in lines.take(columns * rows) {
        let Some([x, y, u, v, light]) = numbers(text, char::is_whitespace) else {
            return Err(fault(line, "this is no node", "write x y u v intensity"));
        };
        let place = (DVec2::new(x / aspect, y) + 1.0) / 2.0;
        vertices.push(Vertex { place, uv: DVec2::new(u, v), light });
    }
    whole(columns, rows, vertices)
}

fn whole(columns: usize, rows: usize, vertices: Vec<Vertex>) -> anyhow::Result<Mesh> {
    if vertices.len() != columns * rows {
        let due = columns * rows;
        bail!("it has {} nodes of {columns} × {rows}; {due} would be right", vertices.len());
    }
    Ok(Mesh::grid(columns, vertices))
}

/// SGCT's OBJ: positions −1 to 1 on the window, texture coordinates in its picture, one of each by
/// the same number.
pub(super) fn obj(bytes: &[u8], frame: &Frame) -> anyhow::Result<Mesh> {
    let (mut places, mut uvs, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let local = |at: DVec2| (at - frame.position) / frame.size;
    for (line, text) in lines(bytes) {
        let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let pair = || numbers::<2>(rest, char::is_whitespace).map(DVec2::from_array);
        match word {
            "v" => {
                let at = pair().ok_or_else(|| fault(line, "this is no vertex", "write v x y z"))?;
                places.push(local((at + 1.0) / 2.0));
            }
            "vt" => {
                let uv = pair().ok_or_else(|| fault(line, "this is no UV", "write vt u v"))?;
                uvs.push(local(uv));
            }
            "f" => {
                let corner = |word: &str| {
                    let number = word.split('/').next()?.parse::<u32>().ok()?;
                    number.checked_sub(1)
                };
                let corners: Option<Vec<u32>> = rest.split_whitespace().map(corner).collect();
                let Some([first, others @ ..]) = corners.as_deref() else {
                    let remedy = "write f and numbers of vertices, from 1";
                    return Err(fault(line, "this is no face", remedy));
                };
                triangles.extend(others.windows(2).map(|two| [*first, two[0], two[1]]));
            }
            _ => {}
        }
    }
    if places.len() != uvs.len() {
        let counts = (places.len(), uvs.len());
        bail!("it has {} v and {} vt; as many of each would be right", counts.0, counts.1);
    }
    let vertex = |(place, uv)| Vertex { place, uv, light: 1.0 };
    let vertices = places.into_iter().zip(uvs).map(vertex).collect();
    Ok(Mesh { vertices, triangles, frustum: None })
}

/// domeprojection's: `x;y;u;v;column;row`, y and v down.
pub(super) fn domeprojection(bytes: &[u8]) -> anyhow::Result<Mesh> {
    let mut nodes = BTreeMap::new();
    for (line, text) in lines(bytes) {
        let Some([x, y, u, v, column, row]) = numbers(text, |c| c == ';') else {
            // The first line names the columns.
            if nodes.is_empty() {
                continue;
            }
            return Err(fault(line, "this is no node", "write x;y;u;v;column;row"));
        };
        if column.min(row) < 0.0 || column.max(row) > 1e6 || column.fract() + row.fract() != 0.0 {
            return Err(fault(line, "column and row are wrong", "count them from 0"));
        }
        let place = DVec2::new(x.clamp(0.0, 1.0), 1.0 - y.clamp(0.0, 1.0));
        let vertex = Vertex { place, uv: DVec2::new(u, 1.0 - v), light: 1.0 };
        nodes.insert((row as usize, column as usize), vertex);
    }
    let columns = nodes.keys().map(|(_, column)| column + 1).max().unwrap_or(0);
    let rows = nodes.keys().map(|(row, _)| row + 1).max().unwrap_or(0);
    if columns.saturating_mul(rows) != nodes.len() {
        bail!("it has {} nodes of {columns} × {rows}; each once would be right", nodes.len());
    }
    Ok(Mesh::grid(columns, nodes.into_values().collect()))
}

/// Sky-Skan's: a direction and angles of the picture, then nodes of x y u v, all down; −1 is not
/// drawn.
pub(super) fn skyskan(bytes: &[u8]) -> anyhow::Result<Mesh> {
    let mut head = BTreeMap::new();
    let mut size = None;
    let mut vertices = Vec::new();
    let tweak = |head: &BTreeMap<String, f64>, name: &str, low: f64| {
        head.get(name).copied().filter(|tweak| *tweak > low).unwrap_or(1.0)
    };
    for (line, text) in lines(bytes) {
        if let Some((name, number)) = text.split_once('=') {
            let number = number.trim().parse::<f64>().ok().filter(|number| number.is_finite());
            let number = number.ok_or_else(|| fault(line, "this is no number", "write one"))?;
            head.insert(name.trim().to_lowercase(), number);
        } else if size.is_none() {
            size = numbers(text, char::is_whitespace);
            if size.is_some() {
                grid_size(size, line)?;
            }
        } else if let Some([x, y, u, v]) = numbers(text, char::is_whitespace) {
            let [u, v] = [u * tweak(&head, "u tweak", -1.0), v * tweak(&head, "v tweak", -1.0)];
            let light = if x == -1.0 || y == -1.0 { -1.0 } else { 1.0 };
            let place = DVec2::new(x, 1.0 - y);
            vertices.push(Vertex { place, uv: DVec2::new(u, 1.0 - v), light });
        }
    }
    let need = |name: &str| {
        let number = head.get(name).copied();
        number.ok_or_else(|| fault(1, &format!("{name} is missing"), "write NAME=DEGREES"))
    };
    let (azimuth, elevation) = (need("dome azimuth")?, need("dome elevation")?);
    let across = need("horizontal fov")?;
    // Sky-Skan's projectors of that time: 2048 × 1200 pixels.
    let usual = || 2.0 * (1200.0 / 2048.0 * (across.to_radians() / 2.0).tan()).atan().to_degrees();
    let up = head.get("vertical fov").copied().filter(|fov| *fov > 0.0).unwrap_or_else(usual);
    let across = across * tweak(&head, "horizontal tweak", 0.0) / 2.0;
    let up = up * tweak(&head, "vertical tweak", 0.0) / 2.0;
    let [columns, rows] = grid_size(size, 1)?;
    let mut mesh = whole(columns, rows, vertices)?;
    let rotation = DQuat::from_rotation_y(-azimuth.to_radians())
        * DQuat::from_rotation_x(elevation.to_radians());
    mesh.frustum = Some(Frustum {
        up,
        down: -up,
        left: -across,
        right: across,
        rotation,
        offset: DVec3::ZERO,
        eye: Some(DVec3::ZERO),
    });
    Ok(mesh)
}

/// Scalable's OpenMesh: keys, then vertices of x y intensity and two coordinates of the picture,
/// then faces `[ a b c ]`.
pub(super) fn scalable(bytes: &[u8]) -> anyhow::Result<Mesh> {
    let mut keys: BTreeMap<&str, &str> = BTreeMap::new();
    let (mut rows, mut triangles) = (Vec::new(), Vec::new());
    for (line, text) in lines(bytes) {
        let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        if word == "[" {
            let corners = numbers::<3>(rest.trim_end_matches(']'), char::is_whitespace);
            let Some(corners) = corners.filter(|c| c.iter().all(|n| *n >= 0.0 && *n < 1e9)) else {
                return Err(fault(line, "this is no face", "write [ a b c ]"));
            };
            triangles.push(corners.map(|corner| corner as u32));
        } else if word.parse::<f64>().is_ok() {
            let numbers = numbers::<5>(text, char::is_whitespace);
            let Some(numbers) = numbers else {
                return Err(fault(line, "this is no vertex", "write x y intensity s t"));
            };
            rows.push(numbers);
        } else {
            keys.insert(word, rest.trim());
        }
    }
    let number = |name: &str, default: f64| -> anyhow::Result<f64> {
        let Some(text) = keys.get(name) else { return Ok(default) };
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| fault(1, &format!("{name} is {text:?}"), "write a number"))
    };
    for (name, wrong) in
        [("USE_SPHERE_SAMPLE_COORDINATE_SYSTEM", "1"), ("FRUSTUM_EULER_ANGLES", "1")]
    {
        if keys.get(name) == Some(&wrong) {
            bail!("{name} is on, and no document says what it means; export the mesh without it");
        }
    }
    let pixels = DVec2::new(number("NATIVEXRES", 0.0)?, number("NATIVEYRES", 0.0)?);
    if pixels.min_element() < 1.0 {
        bail!("NATIVEXRES and NATIVEYRES are missing; the projector's pixels would be right");
    }
    let low = DVec2::new(number("ORTHO_LEFT", 0.0)?, number("ORTHO_BOTTOM", 0.0)?);
    let high = DVec2::new(number("ORTHO_RIGHT", 1.0)?, number("ORTHO_TOP", 1.0)?);
    let vertex = |[x, y, light, s, t]: [f64; 5]| Vertex {
        place: (DVec2::new(x, y) / pixels - low) / (high - low),
        uv: DVec2::new(1.0 - t, 1.0 - s),
        light: light / 255.0,
    };
    let vertices: Vec<Vertex> = rows.into_iter().map(vertex).collect();
    for (name, count) in [("VERTICES", vertices.len()), ("FACES", triangles.len())] {
        let said = number(name, count as f64)?;
        if said != count as f64 {
            bail!("{name} says {said}, and {count} follow; export the mesh again");
        }
    }
    let angle = |name: &str| number(&format!("PERSPECTIVE_{name}"), 0.0);
    let turn = [angle("ROLL")?, angle("YAW")?, angle("PITCH")?].map(f64::to_radians);
    let frustum = Frustum {
        up: angle("TOP")?,
        down: angle("BOTTOM")?,
        left: angle("LEFT")?,
        right: angle("RIGHT")?,
        rotation: DQuat::from_euler(EulerRot::ZYX, turn[0], turn[1], turn[2]),
        offset: DVec3::new(angle("XOFFSET")?, angle("YOFFSET")?, angle("ZOFFSET")?),
        eye: None,
    };
    let has_angles = keys.keys().any(|key| {
        matches!(key.strip_prefix("PERSPECTIVE_"), Some("TOP" | "BOTTOM" | "LEFT" | "RIGHT"))
    });
    Ok(Mesh { vertices, triangles, frustum: has_angles.then_some(frustum) })
}
