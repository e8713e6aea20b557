//! One primitive as lists of attributes, read, checked and repaired.

use glam::{DVec3, Vec3};
use polyptych_scene::Topology;
use polyptych_text::counted;

use super::accessor::{self, Accessor};
use super::error::BakeError;
use super::material::VertexRequirements;
use super::pose::{Pose, Vertices};
use super::{BakeJob, document, topology};

/// A primitive before it is split and interleaved.
#[derive(Debug)]
pub(super) struct Geometry {
    pub topology: Topology,
    /// Indices below `positions.len()`; [`topology::arity`] of them make one element.
    pub indices: Vec<u32>,
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors; where `None`, every triangle has its own.
    pub normals: Option<Vec<[f32; 3]>>,
    pub tangents: Tangents,
    pub uvs: [Option<Vec<[f32; 2]>>; 2],
    pub colors: Option<Vec<[f32; 4]>>,
}

/// The tangents of a primitive, by their source.
#[derive(Debug)]
pub(super) enum Tangents {
    /// Nothing needs them.
    None,
    /// From the file, one for each vertex.
    Vertex(Vec<[f32; 4]>),
    /// Made here, one for each index.
    Corner(Vec<[f32; 4]>),
}

/// Reads a primitive, shaped by a pose if it has one; `None` where it draws nothing.
pub(super) fn read(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    needs: &VertexRequirements,
    pose: Option<&Pose>,
    place: &str,
) -> Result<Option<Geometry>, BakeError> {
    let Some(topology) = topology::of_mode(json.mode) else {
        let what = format!("mode {} does not exist", json.mode);
        return Err(BakeError::at(place, what, "0 to 6 would be right"));
    };
    if lacks_data(job, json, place) {
        return Ok(None);
    }
    let Some(mut positions) = attribute::<3>(job, json, "POSITION", None, place)? else {
        job.leave_out(place, "it has no POSITION", "one would be right");
        return Ok(None);
    };
    check_finite(json, &positions)?;
    let mut indices = indices(job, json, positions.len(), place)?;
    if indices.is_empty() {
        job.leave_out(place, "it has no vertices to draw", "at least one element would be right");
        return Ok(None);
    }
    let count = Some(positions.len());
    let is_surface = topology == Topology::Triangles;
    let mut normals = attribute::<3>(job, json, "NORMAL", count, place)?;
    let mut tangents = None;
    // glTF: tangents without normals are to be ignored.
    if needs.tangents.is_some() && is_surface && normals.is_some() {
        tangents = attribute::<4>(job, json, "TANGENT", count, place)?;
    }
    if let Some(pose) = pose {
        let vertices = Vertices {
            positions: &mut positions,
            normals: normals.as_deref_mut(),
            tangents: tangents.as_deref_mut(),
        };
        let mirrored = pose.apply(job, json, vertices, place)?;
        turn(&mut indices, &mirrored, topology);
    }
    if let Some(normals) = &mut normals {
        repair_normals(normals, &positions, &indices, is_surface);
    } else if !is_surface {
        normals = Some(vec![[0.0, 0.0, 1.0]; positions.len()]);
    }
    let mut uvs = [None, None];
    for (slot, set) in uvs.iter_mut().zip(needs.uv_sets) {
        let Some(set) = set else { continue };
        *slot = Some(coordinates(job, json, set, pose, positions.len(), place)?);
    }
    if needs.tangents.is_some_and(|(set, _)| uvs[set as usize].is_none()) && tangents.is_none() {
        uvs[0] = tangent_coordinates(job, json, pose, (positions.len(), is_surface), place)?;
    }
    if let (Some(tangents), Some(normals)) = (&mut tangents, &normals) {
        for (tangent, normal) in tangents.iter_mut().zip(normals) {
            *tangent = clean_tangent(*tangent, *normal);
        }
    }
    let tangents = tangents.map_or(Tangents::None, Tangents::Vertex);
    let colors = colors(job, json, pose, count, place)?;
    Ok(Some(Geometry { topology, indices, positions, normals, tangents, uvs, colors }))
}

/// Leaves a primitive out whose positions or indices have no data: drawn as glTF says, all zeros,
/// it would be one point.
fn lacks_data(job: &mut BakeJob<'_>, json: &document::Primitive, place: &str) -> bool {
    let positions = json.attributes.get("POSITION").copied();
    let has_data = |index: Option<u32>| index.is_none_or(|i| accessor::has_data(job.source, i));
    let missing = match (has_data(positions), has_data(json.indices)) {
        (true, true) => return false,
        (false, _) => "POSITION",
        _ => "indices",
    };
    let fault = json.extensions.draco.as_ref().and_then(|draco| draco.fault.as_ref());
    let what = match fault {
        Some(fault) => format!("it is compressed with Draco: {fault}"),
        None => format!("the accessor of its {missing} has no data"),
    };
    job.leave_out(place, &what, "uncompressed data in a bufferView would be right");
    true
}

/// Turns the triangles of which most corners were mirrored.
pub(super) fn turn(indices: &mut [u32], mirrored: &[bool], topology: Topology) {
    if topology != Topology::Triangles || !mirrored.contains(&true) {
        return;
    }
    for corners in indices.chunks_exact_mut(3) {
        let is_mirrored = |corner: &&u32| mirrored.get(**corner as usize) == Some(&true);
        if corners.iter().filter(is_mirrored).count() >= 2 {
            corners.swap(1, 2);
        }
    }
}

/// `TEXCOORD_0` of a surface of which no texture has a set of coordinates, but whose tangents must
/// be made; `None`, with a note, where there is none.
fn tangent_coordinates(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    pose: Option<&Pose>,
    (count, is_surface): (usize, bool),
    place: &str,
) -> Result<Option<Vec<[f32; 2]>>, BakeError> {
    if !is_surface {
        return Ok(None);
    }
    if !json.attributes.contains_key("TEXCOORD_0") {
        job.warn(&format!(
            "{place}: its material is anisotropic, and it has neither TANGENT nor TEXCOORD_0; the \
             direction of its highlights is arbitrary"
        ));
        return Ok(None);
    }
    coordinates(job, json, 0, pose, count, place).map(Some)
}

/// `TEXCOORD_set`, finite; zeros, with a note, where there are none.
fn coordinates(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    set: u32,
    pose: Option<&Pose>,
    count: usize,
    place: &str,
) -> Result<Vec<[f32; 2]>, BakeError> {
    let name = format!("TEXCOORD_{set}");
    let Some(mut values) = attribute::<2>(job, json, &name, Some(count), place)? else {
        job.warn(&format!("{place}: its material uses {name}, which it has not"));
        return Ok(vec![[0.0; 2]; count]);
    };
    morph(job, json, &name, pose, &mut values, place)?;
    for uv in values.iter_mut().filter(|uv| !finite(uv)) {
        *uv = [0.0; 2];
    }
    Ok(values)
}

/// Adds what morph targets change of an attribute that skins leave alone.
fn morph<const N: usize>(
    job: &BakeJob<'_>,
    json: &document::Primitive,
    name: &str,
    pose: Option<&Pose>,
    values: &mut [[f32; N]],
    place: &str,
) -> Result<(), BakeError> {
    let Some(pose) = pose else { return Ok(()) };
    add(values, pose.deltas::<N>(job, json, name, values.len(), place)?);
    Ok(())
}

fn add<const N: usize>(values: &mut [[f32; N]], deltas: Option<Vec<[f64; N]>>) {
    for (value, delta) in values.iter_mut().zip(deltas.into_iter().flatten()) {
        for (value, delta) in value.iter_mut().zip(delta) {
            *value = (f64::from(*value) + delta) as f32;
        }
    }
}

pub(super) fn attribute<const N: usize>(
    job: &BakeJob<'_>,
    json: &document::Primitive,
    name: &str,
    count: Option<usize>,
    place: &str,
) -> Result<Option<Vec<[f32; N]>>, BakeError> {
    let accessor = open(job, json, name, count, place)?;
    accessor.map(|accessor| accessor.floats::<N>()).transpose()
}

/// The accessor of an attribute, if the primitive has it, with so many elements.
fn open<'a>(
    job: &BakeJob<'a>,
    json: &document::Primitive,
    name: &str,
    count: Option<usize>,
    place: &str,
) -> Result<Option<Accessor<'a>>, BakeError> {
    let Some(&index) = json.attributes.get(name) else { return Ok(None) };
    job.check()?;
    let accessor = Accessor::open(job.source, index, &format!("{place}.attributes.{name}"))?;
    if let Some(count) = count.filter(|&count| count != accessor.count) {
        let what = format!("{name} has {}, POSITION {count}", counted(accessor.count, "element"));
        return Err(BakeError::at(place, what, "equal counts would be right"));
    }
    Ok(Some(accessor))
}

/// `COLOR_0` as its morph targets change it, which may have an alpha where it has none.
fn colors(
    job: &BakeJob<'_>,
    json: &document::Primitive,
    pose: Option<&Pose>,
    count: Option<usize>,
    place: &str,
) -> Result<Option<Vec<[f32; 4]>>, BakeError> {
    let Some(accessor) = open(job, json, "COLOR_0", count, place)? else { return Ok(None) };
    let mut colors = accessor.colors(1.0)?;
    if let Some(pose) = pose {
        add(&mut colors, pose.color_deltas(job, json, accessor.count, place)?);
    }
    for value in colors.as_flattened_mut() {
        *value = if value.is_finite() { value.clamp(0.0, 1.0) } else { 1.0 };
    }
    Ok(Some(colors))
}

pub(super) fn indices(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    count: usize,
    place: &str,
) -> Result<Vec<u32>, BakeError> {
    let Ok(count) = u32::try_from(count) else {
        let what = format!("it has {}", counted(count, "vertex"));
        return Err(BakeError::at(place, what, "fewer than 2^32 would be right"));
    };
    let Some(index) = json.indices else {
        return Ok(topology::to_list(json.mode, (0..count).collect(), None));
    };
    let accessor = Accessor::open(job.source, index, &format!("{place}.indices"))?;
    let read = accessor.indices()?;
    let is_strip = !matches!(json.mode, 0 | 1 | 4);
    let restart = Some(read.restart).filter(|_| is_strip);
    let is_wrong = |&index: &u32| index >= count && Some(index) != restart;
    if let Some(at) = read.values.iter().position(is_wrong) {
        let vertices = counted(count, "vertex");
        let what = format!("index {at} is {}, the primitive has {vertices}", read.values[at]);
        let right = match count {
            0 => "a POSITION with vertices would be right".to_owned(),
            _ => format!("below {count} would be right"),
        };
        return Err(BakeError::at(accessor.place, what, right));
    }
    let given = read.values.len();
    let list = topology::to_list(json.mode, read.values, restart);
    if (json.mode == 1 || json.mode == 4) && list.len() != given {
        job.warn(&format!("{place}: its last element is not complete and is left out"));
    }
    if u32::try_from(list.len()).is_err() {
        let what = format!("it draws {} indices", list.len());
        return Err(BakeError::at(place, what, "fewer than 2^32 would be right"));
    }
    Ok(list)
}

fn finite<const N: usize>(values: &[f32; N]) -> bool {
    values.iter().all(|value| value.is_finite())
}

fn check_finite(json: &document::Primitive, positions: &[[f32; 3]]) -> Result<(), BakeError> {
    let Some(at) = positions.iter().position(|position| !finite(position)) else {
        return Ok(());
    };
    let index = json.attributes.get("POSITION").copied().unwrap_or_default();
    let what = format!("POSITION {at} is {:?}", positions[at]);
    Err(BakeError::at(format!("accessors[{index}]"), what, "finite numbers would be right"))
}

/// The unit normal of a triangle times twice its area, counter-clockwise from its front.
pub(super) fn area_normal(positions: &[[f32; 3]], corners: &[u32]) -> DVec3 {
    let &[a, b, c] = corners else { return DVec3::ZERO };
    let at = |index: u32| Vec3::from(positions[index as usize]).as_dvec3();
    (at(b) - at(a)).cross(at(c) - at(a))
}

/// The unit normal of a triangle, or +Z where it has no area.
pub(super) fn flat_normal(positions: &[[f32; 3]], corners: &[u32]) -> [f32; 3] {
    unit_or_z(area_normal(positions, corners))
}

fn unit_or_z(vector: DVec3) -> [f32; 3] {
    // The squares of vectors as long as 1e77 still fit f64, so areas of any f32 triangle do.
    vector.try_normalize().unwrap_or(DVec3::Z).as_vec3().to_array()
}

/// Makes every normal a unit vector; one that has no direction becomes the mean of its triangles.
fn repair_normals(
    normals: &mut [[f32; 3]],
    positions: &[[f32; 3]],
    indices: &[u32],
    is_surface: bool,
) {
    const UNIT_TOLERANCE: f64 = 1e-3;
    let mut broken = Vec::new();
    for (i, normal) in normals.iter_mut().enumerate() {
        let vector = Vec3::from(*normal).as_dvec3();
        let length = vector.length();
        if !length.is_finite() || length < 1e-12 {
            broken.push(i);
        } else if (length - 1.0).abs() > UNIT_TOLERANCE {
            *normal = unit_or_z(vector);
        }
    }
    if broken.is_empty() {
        return;
    }
    let mut sums = vec![DVec3::ZERO; if is_surface { normals.len() } else { 0 }];
    if is_surface {
        for corners in indices.chunks_exact(3) {
            let normal = area_normal(positions, corners);
            for &corner in corners {
                sums[corner as usize] += normal;
            }
        }
    }
    for i in broken {
        normals[i] = unit_or_z(sums.get(i).copied().unwrap_or(DVec3::Z));
    }
}

/// A tangent that can be used: unit length, a sign, and some direction where it had none.
pub(super) fn clean_tangent(tangent: [f32; 4], normal: [f32; 3]) -> [f32; 4] {
    let vector = Vec3::new(tangent[0], tangent[1], tangent[2]);
    let length = vector.length();
    let unit = if length.is_finite() && length > 1e-6 {
        if (length - 1.0).abs() > 1e-3 { vector / length } else { vector }
    } else {
        Vec3::from(normal).any_orthonormal_vector()
    };
    [unit.x, unit.y, unit.z, if tangent[3] < 0.0 { -1.0 } else { 1.0 }]
}
