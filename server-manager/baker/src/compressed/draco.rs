//! Parts of meshes that are compressed by `KHR_draco_mesh_compression`.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex,
};

use super::super::check;
use super::super::document::{Accessor, DracoStream};
use super::super::error::BakeError;
use super::super::source::GltfSource;
use super::Room;

/// The extension's name, for messages.
const NAME: &str = "KHR_draco_mesh_compression";

/// glTF's numbers of component types.
const UNSIGNED_INT: u32 = 5125;

/// glTF's number of lists of triangles.
const TRIANGLES: u32 = 4;

/// Unpacks the parts of all meshes of which an accessor has no values of its own. A part that
/// cannot be unpacked keeps the reason.
pub(super) fn unpack(
    source: &mut GltfSource,
    room: &mut Room,
    cancel: &AtomicBool,
) -> Result<(), BakeError> {
    // Parts that share a stream share what it unpacks to, until the last one has it.
    let mut streams: BTreeMap<u32, Result<Unpacked, String>> = BTreeMap::new();
    let mut parts_left: BTreeMap<u32, usize> = BTreeMap::new();
    let parts = source.document.meshes.iter().flat_map(|mesh| &mesh.primitives);
    for draco in parts.filter_map(|part| part.extensions.draco.as_ref()) {
        *parts_left.entry(draco.buffer_view).or_default() += 1;
    }
    for mesh in 0..source.document.meshes.len() {
        for part in 0..source.document.meshes[mesh].primitives.len() {
            let primitive = &source.document.meshes[mesh].primitives[part];
            let Some(draco) = primitive.extensions.draco.clone() else { continue };
            let stream = draco.buffer_view;
            let lacks_view = |index: &u32| {
                let json = source.document.accessors.get(*index as usize);
                json.is_some_and(|json| json.buffer_view.is_none())
            };
            let named = draco.attributes.keys().filter_map(|name| primitive.attributes.get(name));
            let is_packed = named.chain(&primitive.indices).any(lacks_view);
            check(cancel)?;
            if is_packed
                && let Err(reason) = unpack_part(source, &mut streams, (mesh, part), &draco, room)
            {
                // The others can be drawn; who reads the part says why it is not.
                let primitive = source.document.primitive_mut(mesh, part);
                let fault = Some(reason.fault());
                primitive.extensions.draco = Some(DracoStream { fault, ..draco });
            }
            let left = parts_left.entry(stream).or_default();
            *left = left.saturating_sub(1);
            if *left == 0 {
                streams.remove(&stream);
            }
        }
    }
    Ok(())
}

fn unpack_part(
    source: &mut GltfSource,
    streams: &mut BTreeMap<u32, Result<Unpacked, String>>,
    (mesh, part): (usize, usize),
    draco: &DracoStream,
    room: &mut Room,
) -> Result<(), BakeError> {
    let place = format!("meshes[{mesh}].primitives[{part}].extensions.{NAME}");
    // A broken one is read once too: a small file may name a large view many times.
    let unpacked = streams.entry(draco.buffer_view).or_insert_with(|| {
        let unpacked = Unpacked::new(source, draco.buffer_view, room, &place);
        unpacked.map_err(|error| error.fault())
    });
    let unpacked = unpacked.as_mut().map_err(|fault| {
        BakeError::at(&place, fault.as_str(), "a whole stream of Draco would be right")
    })?;
    unpacked.put(source, (mesh, part), &draco.attributes, room, &place)
}

/// A stream that was unpacked, and what of it the document has already.
#[derive(Debug)]
struct Unpacked {
    mesh: Mesh,
    /// The view of its indices.
    indices: Option<u32>,
    /// Views by the number of the attribute.
    attributes: BTreeMap<u32, u32>,
}

impl Unpacked {
    fn new(
        source: &GltfSource,
        view: u32,
        room: &mut Room,
        place: &str,
    ) -> Result<Self, BakeError> {
        let bytes = source.packed(source.view(view, place)?.1, place)?;
        // A corner takes 12 bytes here, a vertex at least as many.
        let limits = DecodeLimits::default()
            .with_max_decoded_bytes(room.left)
            .with_max_points(room.left / 12)
            .with_max_faces(room.left / 12);
        let (mut mesh, mut stream) = (Mesh::new(), DecoderBuffer::new(&bytes).with_limits(limits));
        MeshDecoder::new().decode(&mut stream, &mut mesh).map_err(|error| {
            let what = format!("it can't be unpacked: {error}");
            BakeError::at(place, what, "a whole stream of Draco would be right")
        })?;
        Ok(Self { mesh, indices: None, attributes: BTreeMap::new() })
    }

    /// Makes a part of a mesh name what this holds of it.
    fn put(
        &mut self,
        source: &mut GltfSource,
        (mesh, part): (usize, usize),
        attributes: &BTreeMap<String, u32>,
        room: &mut Room,
        place: &str,
    ) -> Result<(), BakeError> {
        let mut found = Vec::new();
        for (name, number) in attributes {
            let before = source.document.meshes[mesh].primitives[part].attributes.get(name);
            let Some(&before) = before else { continue };
            let place = format!("{place}.attributes.{name}");
            let accessor = self.attribute(source, *number, before, room, &place)?;
            found.push((name.clone(), source.document.accessors.push(accessor)));
        }
        let indices = self.corners(source, room, place)?;
        let indices = source.document.accessors.push(indices);
        let primitive = source.document.primitive_mut(mesh, part);
        primitive.attributes.extend(found);
        // A stream holds triangles, also where the part was a strip.
        (primitive.indices, primitive.mode) = (Some(indices), TRIANGLES);
        Ok(())
    }

    /// An attribute of the stream as an accessor, in place of one that had no values.
    fn attribute(
        &mut self,
        source: &mut GltfSource,
        number: u32,
        before: u32,
        room: &mut Room,
        place: &str,
    ) -> Result<Accessor, BakeError> {
        let Some(attribute) = self.mesh.attribute_by_unique_id(number) else {
            let what = format!("the stream has no attribute {number}");
            return Err(BakeError::at(place, what, "one of the stream's would be right"));
        };
        let (component_type, kind) = kind(attribute, place)?;
        let points = self.mesh.num_points();
        let view = if let Some(known) = self.attributes.get(&number) {
            *known
        } else {
            let bytes = values(attribute, points);
            room.take(bytes.len() as u64, place)?;
            source.add_view(bytes)
        };
        self.attributes.insert(number, view);
        let json = source.document.accessors.at(before, place)?;
        let sparse = json.sparse.clone();
        let (normalized, count) = (json.normalized, points as u64);
        let (buffer_view, kind) = (Some(view), kind.to_owned());
        Ok(Accessor {
            buffer_view,
            byte_offset: 0,
            component_type,
            normalized,
            count,
            kind,
            sparse,
        })
    }

    /// The corners of all triangles as an accessor.
    fn corners(
        &mut self,
        source: &mut GltfSource,
        room: &mut Room,
        place: &str,
    ) -> Result<Accessor, BakeError> {
        let faces = self.mesh.faces();
        let view = if let Some(known) = self.indices {
            known
        } else {
            let corners = faces.iter().flatten();
            let bytes: Vec<u8> = corners.flat_map(|corner| corner.0.to_le_bytes()).collect();
            room.take(bytes.len() as u64, place)?;
            source.add_view(bytes)
        };
        self.indices = Some(view);
        Ok(Accessor {
            buffer_view: Some(view),
            byte_offset: 0,
            component_type: UNSIGNED_INT,
            normalized: false,
            count: faces.len() as u64 * 3,
            kind: "SCALAR".to_owned(),
            sparse: None,
        })
    }
}

/// The component type and the type of an attribute, as glTF calls them.
fn kind(attribute: &PointAttribute, place: &str) -> Result<(u32, &'static str), BakeError> {
    let component = match attribute.data_type() {
        DataType::Int8 => 5120,
        DataType::Uint8 => 5121,
        DataType::Int16 => 5122,
        DataType::Uint16 => 5123,
        DataType::Uint32 => UNSIGNED_INT,
        DataType::Float32 => 5126,
        other => {
            let what = format!("its components are {other:?}");
            return Err(BakeError::at(place, what, "a type that glTF has would be right"));
        }
    };
    match attribute.num_components() {
        1 => Ok((component, "SCALAR")),
        2 => Ok((component, "VEC2")),
        3 => Ok((component, "VEC3")),
        4 => Ok((component, "VEC4")),
        other => {
            let what = format!("it has {other} components");
            Err(BakeError::at(place, what, "1 to 4 would be right"))
        }
    }
}

/// The values of all points, one after the other; zeros where the stream has none.
fn values(attribute: &PointAttribute, points: usize) -> Vec<u8> {
    let size = attribute.data_type().byte_length() * usize::from(attribute.num_components());
    let stride = usize::try_from(attribute.byte_stride()).unwrap_or(size);
    let data = attribute.buffer().data();
    let mut values = vec![0; points * size];
    for (point, value) in (0u32..).zip(values.chunks_exact_mut(size.max(1))) {
        let at = attribute.mapped_index(PointIndex(point)).0 as usize;
        let start = at.checked_mul(stride);
        let bytes = start.and_then(|start| data.get(start..)?.get(..size));
        if let Some(bytes) = bytes {
            value.copy_from_slice(bytes);
        }
    }
    values
}
