//! `mpcdi.xml`: which regions there are, and which files belong to them.
//!
//! Programs disagree on capitals (`xResolution`, `Xresolution`, `XResolution`), so names are
//! compared without them. What an element that is empty would say is taken as not said, with a
//! note.

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::limits::{CANVAS_SIDE_MAX, CHANNEL_SIDE_MAX};
use roxmltree::{Node, ParsingOptions};

use super::super::super::error::BakeError;
use super::super::super::uri::{shorten, shorten_middle};
use super::{Profile, RegionFrustum};

/// Most nodes of the text: a region has fifty.
const NODES_MAX: u32 = 1 << 18;

/// Most projectors of an archive.
const REGIONS_MAX: usize = 256;

/// Maximum distance that a region may reach out of its buffer, as a share of the buffer: rounding
/// in foreign programs.
const PART_TOLERANCE: f64 = 1e-6;

/// Maximum difference of a frame's axes from unit vectors at right angles: five digits are usual.
const AXIS_TOLERANCE: f64 = 1e-3;

/// The content of `mpcdi.xml`.
pub(super) struct Document {
    pub profile: Profile,
    pub buffers: Vec<Buffer>,
    /// The regions of all buffers.
    pub regions: Vec<Region>,
}

/// A picture that projectors show parts of.
#[derive(Clone, Debug)]
pub struct Buffer {
    /// The id in the text; may be empty.
    pub id: String,
    /// In pixels; where the text has none, what the regions make of it.
    pub size: UVec2,
}

/// A projector.
pub(super) struct Region {
    pub id: String,
    /// Its place in the list of buffers.
    pub buffer: usize,
    pub size: UVec2,
    /// The lower left corner of its part of the buffer, 0 to 1, from the buffer's lower left.
    pub origin: DVec2,
    pub extent: DVec2,
    pub pyramid: Option<RegionFrustum>,
    /// The position of its lens, in the unit of its points: right, up and back.
    pub position: Option<DVec3>,
    pub files: Files,
}

/// The files of a projector.
#[derive(Default)]
pub(super) struct Files {
    pub warp: Option<WarpFile>,
    pub alpha: Option<MaskFile>,
    pub beta: Option<MaskFile>,
    /// The path of what a lens does to the picture.
    pub distortion: Option<String>,
}

/// A warp map, and what is said of it.
pub(super) struct WarpFile {
    pub path: String,
    pub interpolation: String,
    pub unit: String,
    pub origin: String,
}

/// A mask, and what is said of it.
pub(super) struct MaskFile {
    pub path: String,
    pub components: Option<f64>,
    pub bits: Option<f64>,
    pub gamma: Option<f64>,
}

fn bad(place: impl Into<String>, what: impl Into<String>, right: &str) -> BakeError {
    BakeError::at(format!("mpcdi.xml {}", place.into()), what, format!("{right} would be right"))
}

/// Reads the text; what was assumed goes to the notes.
pub(super) fn parse(text: &str, notes: &mut Vec<String>) -> Result<Document, BakeError> {
    let options = ParsingOptions { nodes_limit: NODES_MAX, ..ParsingOptions::default() };
    let tree = roxmltree::Document::parse_with_options(text, options).map_err(|error| {
        let what = format!("it is not XML: {}", shorten_middle(&error.to_string()));
        bad("", what, "XML without a DTD")
    })?;
    let root = tree.root_element();
    if !is_named(root, "MPCDI") {
        let what = format!("its first element is '{}'", shorten(root.tag_name().name()));
        return Err(bad("", what, "MPCDI"));
    }
    let profile = profile(root)?;
    let display = child(root, "display").ok_or_else(|| bad("", "it has no display", "one"))?;
    let mut document = Document { profile, buffers: Vec::new(), regions: Vec::new() };
    for node in children(display, "buffer") {
        let (index, first) = (document.buffers.len(), document.regions.len());
        for node in children(node, "region") {
            let region = Region { buffer: index, ..region(node, profile, notes)? };
            if document.regions.iter().any(|known| known.id == region.id) {
                return Err(bad(place(&region.id), "it is there twice", "each id once"));
            }
            if document.regions.len() >= REGIONS_MAX {
                return Err(bad("buffer", "there are more regions", "at most 256 of them"));
            }
            document.regions.push(region);
        }
        let id = attribute(node, "id").unwrap_or_default().trim().to_owned();
        let regions = &document.regions[first..];
        if regions.is_empty() {
            notes.push(format!("buffer '{}' has no region and was left out", shorten(&id)));
            continue;
        }
        let size = buffer_size(node, regions)?;
        document.buffers.push(Buffer { id, size });
    }
    if document.regions.is_empty() {
        return Err(bad("display", "no buffer has a region", "one for each projector"));
    }
    add_files(root, &mut document.regions, notes)?;
    Ok(document)
}

fn profile(root: Node<'_, '_>) -> Result<Profile, BakeError> {
    let version = attribute(root, "version").unwrap_or("1.0").trim();
    if !["1", "2"].contains(&version.split('.').next().unwrap_or_default()) {
        return Err(bad("MPCDI.version", format!("it is '{}'", shorten(version)), "1.0 or 2.0"));
    }
    let profile = attribute(root, "profile").unwrap_or_default().trim().to_ascii_lowercase();
    let known = match profile.as_str() {
        "2d" => return Ok(Profile::TwoD),
        "3d" => return Ok(Profile::ThreeD),
        "sl" => return Ok(Profile::ShaderLamps),
        "a3" => "it is a3, advanced 3D, which is not supported".to_owned(),
        other => format!("it is '{}'", shorten(other)),
    };
    Err(bad("MPCDI.profile", known, "2d, 3d or sl"))
}

fn region(
    node: Node<'_, '_>,
    profile: Profile,
    notes: &mut Vec<String>,
) -> Result<Region, BakeError> {
    let id = attribute(node, "id").unwrap_or_default().trim();
    if id.is_empty() {
        return Err(bad("region", "it has no id", "one"));
    }
    let number = |name: &str| {
        let text = attribute(node, name).unwrap_or_default();
        finite(text).ok_or_else(|| {
            let place = format!("{}.{name}", place(id));
            bad(place, format!("it is '{}'", shorten(text)), "a number")
        })
    };
    let origin = DVec2::new(number("x")?, number("y")?);
    let extent = DVec2::new(number("xsize")?, number("ysize")?);
    let end = (origin + extent).max_element();
    if origin.min_element() < -PART_TOLERANCE
        || extent.min_element() <= 0.0
        || end > 1.0 + PART_TOLERANCE
    {
        let what = format!("its part of the buffer, {origin} and {extent}, leaves it");
        return Err(bad(place(id), what, "x, y, xsize and ysize within 0 and 1"));
    }
    let side = |name: &str| {
        let side = number(name)?;
        if side.fract() == 0.0 && (1.0..=f64::from(CHANNEL_SIDE_MAX)).contains(&side) {
            return Ok(side as u32);
        }
        let place = format!("{}.{name}", place(id));
        Err(bad(place, format!("it is {side}"), "a whole number from 1 to 8192"))
    };
    let size = UVec2::new(side("xResolution")?, side("yResolution")?);
    let mut filled = |name: &str| {
        let child = child(node, name)?;
        let is_filled = !is_empty(child);
        if !is_filled {
            notes.push(format!("{}: its {name} is empty and was left out", place(id)));
        }
        is_filled.then_some(child)
    };
    let pyramid = match (filled("frustum"), profile) {
        (_, Profile::TwoD) => None,
        (Some(frustum), _) => Some(pyramid(frustum, id)?),
        (None, _) => {
            let right = "one, as profiles 3d and sl have it,";
            return Err(bad(place(id), "it has no frustum", right));
        }
    };
    let position = match (filled("coordinateFrame"), profile) {
        (Some(frame), Profile::ShaderLamps) => Some(position(frame, id)?),
        _ => None,
    };
    let (id, files) = (id.to_owned(), Files::default());
    Ok(Region { id, buffer: 0, size, origin, extent, pyramid, position, files })
}

/// Returns the position of a lens from the origin of the file's coordinates: right, up and back.
/// The three axes of the frame are those of an aircraft, in the coordinates of the position: yaw
/// points down, pitch to the right and roll ahead; *MPCDI 2.0*, §2.2.2 and figure 2-2.
fn position(node: Node<'_, '_>, id: &str) -> Result<DVec3, BakeError> {
    let place = format!("{} coordinateFrame", place(id));
    let vector = |name: &str| {
        let number = |axis: &str| {
            let name = format!("{name}{axis}");
            let text = child(node, &name).and_then(|child| child.text()).unwrap_or_default();
            finite(text).ok_or_else(|| {
                bad(format!("{place}.{name}"), format!("it is '{}'", shorten(text)), "a number")
            })
        };
        Ok::<_, BakeError>(DVec3::new(number("x")?, number("y")?, number("z")?))
    };
    let (at, down) = (vector("pos")?, vector("yaw")?);
    let (right, ahead) = (vector("pitch")?, vector("roll")?);
    let axes = [right, -down, -ahead];
    let is_unit = axes.iter().all(|axis| (axis.length() - 1.0).abs() < AXIS_TOLERANCE);
    let is_right_angled = right.dot(down).abs().max(down.dot(ahead).abs()) < AXIS_TOLERANCE
        && right.dot(ahead).abs() < AXIS_TOLERANCE;
    if !is_unit || !is_right_angled {
        let what = "its yaw, pitch and roll are not three unit vectors at right angles";
        return Err(bad(place, what, "axes as (0, 0, 1), (0, 1, 0) and (1, 0, 0)"));
    }
    Ok(DVec3::from_array(axes.map(|axis| axis.dot(at))))
}

fn pyramid(node: Node<'_, '_>, id: &str) -> Result<RegionFrustum, BakeError> {
    let number = |name: &str| {
        let text = child(node, name).and_then(|child| child.text()).unwrap_or_default();
        finite(text).ok_or_else(|| {
            let place = format!("{} frustum.{name}", place(id));
            bad(place, format!("it is '{}'", shorten(text)), "an angle in degrees")
        })
    };
    let angles =
        [number("leftAngle")?, number("rightAngle")?, number("downAngle")?, number("upAngle")?];
    let [left, right, down, up] = angles;
    let is_open = left < right && down < up;
    if !is_open || angles.iter().any(|angle| angle.abs() >= 89.0) {
        let what = format!("its angles are {angles:?}: left, right, down, up");
        let right = "left below right, down below up, each within ±89 degrees,";
        return Err(bad(format!("{} frustum", place(id)), what, right));
    }
    let turn = [number("yaw")?, number("pitch")?, number("roll")?];
    Ok(RegionFrustum { turn, angles })
}

fn add_files(
    root: Node<'_, '_>,
    regions: &mut [Region],
    notes: &mut Vec<String>,
) -> Result<(), BakeError> {
    let sets = child(root, "files").into_iter().flat_map(|files| children(files, "fileset"));
    for set in sets {
        let id = attribute(set, "region").unwrap_or_default().trim();
        let Some(region) = regions.iter_mut().find(|region| region.id == id) else {
            let what = format!("it belongs to region '{}', which is not there", shorten(id));
            return Err(bad("fileset", what, "the id of a region"));
        };
        let files = &mut region.files;
        let name = |kind: &str| format!("fileset of {} {kind}", place(id));
        for node in set.children().filter(Node::is_element) {
            let kind = node.tag_name().name().to_ascii_lowercase();
            let is_known = ["geometrywarpfile", "alphamap", "betamap", "distortionmap"]
                .contains(&kind.as_str());
            let path = text_of(node, "path").unwrap_or_default();
            if is_known && path.is_empty() {
                let kind = node.tag_name().name();
                notes.push(format!("{}: its {kind} names no file: left out", place(id)));
                continue;
            }
            let is_again = match kind.as_str() {
                "geometrywarpfile" => files.warp.replace(warp_file(node)).is_some(),
                "alphamap" => files.alpha.replace(mask_file(node, &name(&kind))?).is_some(),
                "betamap" => files.beta.replace(mask_file(node, &name(&kind))?).is_some(),
                "distortionmap" => files.distortion.replace(path).is_some(),
                _ => false,
            };
            if is_again {
                return Err(bad(name(&kind), "it is there twice", "one"));
            }
        }
    }
    Ok(())
}

fn warp_file(node: Node<'_, '_>) -> WarpFile {
    let text = |name: &str| text_of(node, name).unwrap_or_default();
    WarpFile {
        path: text("path"),
        interpolation: text("interpolation").to_ascii_lowercase(),
        unit: text("geometricUnit").to_ascii_lowercase(),
        origin: text("originOf3DData"),
    }
}

fn mask_file(node: Node<'_, '_>, place: &str) -> Result<MaskFile, BakeError> {
    let number = |name: &str| {
        let Some(text) = text_of(node, name).filter(|text| !text.is_empty()) else {
            return Ok(None);
        };
        let positive = finite(&text).filter(|number| (0.01..=100.0).contains(number));
        let what = || bad(format!("{place}.{name}"), format!("it is '{}'", shorten(&text)), "1");
        positive.map(Some).ok_or_else(what)
    };
    Ok(MaskFile {
        path: text_of(node, "path").unwrap_or_default(),
        components: number("componentDepth")?,
        bits: number("bitDepth")?,
        gamma: number("gammaEmbedded")?,
    })
}

/// Returns the size of the buffer in pixels: the one in the text or, without it, the one that the
/// regions imply.
fn buffer_size(node: Node<'_, '_>, regions: &[Region]) -> Result<UVec2, BakeError> {
    let given = |name: &str| finite(attribute(node, name)?).filter(|side| *side >= 1.0);
    let whole = |region: &Region| region.size.as_dvec2() / region.extent;
    let made = regions.iter().map(whole).fold(DVec2::ONE, DVec2::max);
    let size = DVec2::new(
        given("xResolution").unwrap_or(made.x).round(),
        given("yResolution").unwrap_or(made.y).round(),
    );
    if size.max_element() > f64::from(CANVAS_SIDE_MAX) {
        return Err(bad("buffer", format!("it has {size} pixels"), "131072 at most"));
    }
    Ok(size.as_uvec2())
}

impl Document {
    /// A region's part of its buffer in whole pixels, from the upper left: origin and size.
    pub fn part(&self, region: &Region) -> (UVec2, UVec2) {
        let size = self.buffers[region.buffer].size;
        let buffer = size.as_dvec2();
        let top = DVec2::new(region.origin.x, 1.0 - region.origin.y - region.extent.y);
        let last = size - UVec2::ONE;
        let from = (top * buffer).round().max(DVec2::ZERO).as_uvec2().min(last);
        let part = (region.extent * buffer).round().as_uvec2().max(UVec2::ONE);
        (from, part.min(size - from))
    }
}

/// Returns the name of a region in messages.
pub(super) fn place(id: &str) -> String {
    format!("region '{}'", shorten(id))
}

fn is_named(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name().eq_ignore_ascii_case(name)
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| is_named(*child, name))
}

fn children<'a, 'i>(node: Node<'a, 'i>, name: &str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| is_named(*child, name))
}

fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    let mut attributes = node.attributes();
    let found = attributes.find(|attribute| attribute.name().eq_ignore_ascii_case(name));
    found.map(|attribute| attribute.value())
}

/// Returns whether an element holds nothing.
fn is_empty(node: Node<'_, '_>) -> bool {
    let is_blank = |child: Node<'_, '_>| child.text().is_none_or(|text| text.trim().is_empty());
    node.children().all(|child| !child.is_element() && is_blank(child))
}

fn text_of(node: Node<'_, '_>, name: &str) -> Option<String> {
    Some(child(node, name)?.text()?.trim().to_owned())
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}
