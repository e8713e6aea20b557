//! Meshes of bytes: SCISS files and float maps.

use anyhow::{Context, bail};
use glam::{DQuat, DVec2, DVec3};

use super::{Frustum, Mesh, VERTICES_MAX, Vertex, strip};

/// Bytes that are read in little-endian order.
struct Reader<'b>(&'b [u8]);

impl Reader<'_> {
    fn four(&mut self) -> anyhow::Result<[u8; 4]> {
        let (four, rest) = self.0.split_first_chunk().context("it is truncated; copy it again")?;
        self.0 = rest;
        Ok(*four)
    }

    fn float(&mut self) -> anyhow::Result<f64> {
        Ok(f64::from(f32::from_le_bytes(self.four()?)))
    }

    fn count(&mut self) -> anyhow::Result<usize> {
        Ok(u32::from_le_bytes(self.four()?) as usize)
    }
}

/// SCISS's: the letters SGC, a version, the kind of mapping, a frustum, vertices and indices.
/// Places are down, texture coordinates up.
pub(super) fn sciss(bytes: &[u8]) -> anyhow::Result<Mesh> {
    let mut reader = Reader(bytes);
    let [b'S', b'G', b'C', version] = reader.four()? else {
        bail!("it does not begin with SGC; give a mesh of SCISS");
    };
    let is_second = version == 2 || version == b'2';
    if reader.count()? != 0 {
        bail!("its mapping is a cube's; a planar one would be right");
    }
    let mut floats = [0.0; 11];
    for float in &mut floats {
        *float = reader.float()?;
    }
    let [qx, qy, qz, qw, x, y, z, up, down, left, right] = floats;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    if !floats.iter().all(|float| float.is_finite()) || rotation.length() < 1e-6 {
        bail!("its frustum has a number that is none; export the mesh again");
    }
    let (across, down_count) = (reader.count()?, reader.count()?);
    let count = if is_second { down_count } else { across.saturating_mul(down_count) };
    if count > VERTICES_MAX {
        bail!("it has {count} vertices; {VERTICES_MAX} at most would be right");
    }
    let mut vertices = Vec::new();
    for _ in 0..count {
        let mut six = [0.0; 6];
        for float in &mut six {
            *float = reader.float()?;
        }
        let [x, y, _, u, v, _] = six.map(|float| float.clamp(0.0, 1.0));
        let place = DVec2::new(x, 1.0 - y);
        vertices.push(Vertex { place, uv: DVec2::new(u, v), light: 1.0 });
    }
    let count = reader.count()?;
    if count > 6 * VERTICES_MAX {
        bail!("it has {count} indices; {} at most would be right", 6 * VERTICES_MAX);
    }
    let mut indices = Vec::new();
    for _ in 0..count {
        indices.push(reader.count()? as u32);
    }
    let triangles = if is_second && across == 4 {
        indices.chunks_exact(3).map(|three| [three[0], three[1], three[2]]).collect()
    } else {
        strip(&indices)
    };
    // Angles have signs; a file that gives both without one means the same.
    let signed = |low: f64, high: f64| if low < high { low } else { -low };
    let frustum = Frustum {
        up,
        down: signed(down, up),
        left: signed(left, right),
        right,
        rotation: rotation.normalize(),
        offset: DVec3::ZERO,
        eye: Some(DVec3::new(x, y, z)),
    };
    Ok(Mesh { vertices, triangles, frustum: Some(frustum) })
}

/// A float map, whose first row SGCT takes for the upper one. As a texture, a value is the place in
/// the picture that a node of the display shows; else it is the place on the display where a point
/// of the picture goes, left eye and right eye side by side.
pub(super) fn pfm(bytes: &[u8], is_texture: bool) -> anyhow::Result<Mesh> {
    let mut rest = bytes;
    let mut line = || -> Option<&str> {
        let end = rest.iter().take(64).position(|byte| *byte == b'\n')?;
        let (line, behind) = rest.split_at(end);
        rest = &behind[1..];
        std::str::from_utf8(line).ok().map(str::trim)
    };
    let (kind, size, scale) = (line(), line().unwrap_or_default(), line().unwrap_or_default());
    let mut sides = size.split_whitespace().map(|side| side.parse::<usize>().ok());
    let (Some("PF"), Some(Some(all)), Some(Some(rows))) = (kind, sides.next(), sides.next()) else {
        bail!("its head is wrong; PF, a line of width and height and one of -1.0 would be right");
    };
    let is_little = scale.parse::<f64>().is_ok_and(|scale| scale < 0.0);
    let columns = if is_texture { all } else { all / 2 };
    let count = all.saturating_mul(rows);
    if columns < 2 || rows < 2 || count > VERTICES_MAX || rest.len() < count * 12 {
        bail!("{all} × {rows} pixels are too few or many, or it is truncated; export it again");
    }
    let float = |at: usize| {
        let four = rest[at * 4..at * 4 + 4].try_into().unwrap_or([0; 4]);
        f64::from(if is_little { f32::from_le_bytes(four) } else { f32::from_be_bytes(four) })
    };
    let mut vertices = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let at = (row * all + column) * 3;
            let value = DVec2::new(float(at), float(at + 1));
            let light = if value.is_finite() { 1.0 } else { -1.0 };
            let value = if value.is_finite() { value } else { DVec2::ZERO };
            let share = |index: usize, of: usize, half: f64| {
                (index as f64 + half) / (of as f64 - 1.0 + 2.0 * half)
            };
            let half = if is_texture { 0.0 } else { 0.5 };
            let node = DVec2::new(share(column, columns, half), 1.0 - share(row, rows, half));
            let (place, uv) = if is_texture { (node, value) } else { (value, node) };
            vertices.push(Vertex { place, uv, light });
        }
    }
    Ok(Mesh::grid(columns, vertices))
}
