//! Text as meshes: the outlines of its letters, filled with triangles, so that edges are as sharp
//! as those of any mesh, near and far.
//!
//! The font is `DejaVu Sans`, of which `fonts/` has the Latin, Greek and Cyrillic letters with
//! their licence.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3, Vec4};
use lyon_tessellation::math::{Point, point};
use lyon_tessellation::path::Path;
use lyon_tessellation::path::path::Builder;
use lyon_tessellation::{
    BuffersBuilder, FillOptions, FillRule, FillTessellator, FillVertex, VertexBuffers,
};
use polyptych_scene::{AlphaMode, Material};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

use crate::assets::{AssetError, Assets};
use crate::mesh_data::MeshData;

/// Maximum length of a label, in bytes: half a page. A letter takes 1 to 2 KiB, and a transaction
/// at most 2 MiB.
pub const LABEL_BYTES_MAX: usize = 512;

/// The key of the attribute that keeps the text of a node that is a label.
pub const LABEL_KEY: &str = "label";

/// Largest size of letters: far beyond any unit.
const SIZE_MAX: f32 = 1e12;

/// Distance between the outline of a letter and its triangles, as a share of the size: less than a
/// pixel for letters of 500 pixels.
const TOLERANCE: f32 = 0.002;

const FONT: &[u8] = include_bytes!("../fonts/DejaVuSans-subset.ttf");

impl Assets {
    /// Adds a text with a material of its own, in this colour, linear RGBA, which is shown as it
    /// is, without light. See [`MeshData::text`]; returns its number as [`Assets::add_mesh`] does.
    ///
    /// ```
    /// use polyptych_client::glam::Vec4;
    /// use polyptych_client::{Assets, Facing, NewNode, Transaction};
    ///
    /// let mut assets = Assets::default();
    /// let sign = assets.add_label("Harbour", 2.0, Vec4::ONE)?;
    /// let mut transaction = Transaction::default().with_assets(assets.to_source()?);
    /// let sign = transaction.create(NewNode { mesh: Some(sign), ..NewNode::default() });
    /// transaction.set_facing(sign, Some(Facing::Upright));
    /// # Ok::<(), polyptych_client::AssetError>(())
    /// ```
    ///
    /// # Errors
    /// [`AssetError::Label`].
    pub fn add_label(&mut self, text: &str, size: f32, color: Vec4) -> Result<u32, AssetError> {
        let mesh = MeshData::text(text, size)?;
        let alpha_mode = if color.w < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
        let material = self.add_material(Material {
            base_color: color,
            alpha_mode,
            unlit: true,
            double_sided: true,
            ..Self::matt()
        });
        Ok(self.add_mesh(mesh, Some(material)))
    }
}

impl MeshData {
    /// The letters of a text in the plane of X and Y, seen from +Z, its lines centred around the
    /// origin. `size` is the distance between two lines; capitals are 0.63 times as high.
    ///
    /// # Errors
    /// [`AssetError::Label`] if it is longer than [`LABEL_BYTES_MAX`], has nothing to see, or has a
    /// letter that the font lacks.
    pub fn text(text: &str, size: f32) -> Result<Self, AssetError> {
        let fault = |what: String| AssetError::Label { what };
        if text.len() > LABEL_BYTES_MAX {
            let bytes = text.len();
            return Err(fault(format!(
                "its text has {bytes} bytes, where {LABEL_BYTES_MAX} can be; use several labels"
            )));
        }
        if !(size > 0.0 && size <= SIZE_MAX) {
            return Err(fault(format!("its size is above 0 and at most {SIZE_MAX:e}, not {size}")));
        }
        let face = Face::parse(FONT, 0).map_err(|error| fault(error.to_string()))?;
        let line_height = f32::from(face.height() + face.line_gap());
        let scale = size / line_height;
        let (mut mesh, mut letters) = (Self::default(), BTreeMap::new());
        let lines: Vec<&str> = text.lines().collect();
        // From the first base line down: the middle of all capitals is at the origin.
        let capital = face.glyph_index('H').and_then(|glyph| face.glyph_bounding_box(glyph));
        let capital = capital.map_or(0.0, |bounds| f32::from(bounds.y_max));
        let top = (lines.len().saturating_sub(1) as f32 * line_height - capital) / 2.0;
        for (row, line) in (0u16..).zip(&lines) {
            let (places, width) = places(&face, line).map_err(fault)?;
            for (glyph, x) in places {
                let letter = letters.entry(glyph.0);
                let letter: &VertexBuffers<Point, u32> = match letter {
                    std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
                    std::collections::btree_map::Entry::Vacant(free) => {
                        free.insert(filled(&face, glyph).map_err(fault)?)
                    }
                };
                let at = Vec2::new(x - width / 2.0, top - f32::from(row) * line_height);
                mesh.add_letter(letter, at, scale);
            }
        }
        if mesh.indices.is_empty() {
            return Err(fault("its text has nothing to see".to_owned()));
        }
        Ok(mesh)
    }

    fn add_letter(&mut self, letter: &VertexBuffers<Point, u32>, at: Vec2, scale: f32) {
        let first = self.positions.len() as u32;
        let place = |point: &Point| ((Vec2::new(point.x, point.y) + at) * scale).extend(0.0);
        self.positions.extend(letter.vertices.iter().map(place));
        for [a, b, c] in letter.indices.as_chunks::<3>().0.iter().copied() {
            let [a, b, c] = [first + a, first + b, first + c];
            let corner = |index: u32| self.positions[index as usize];
            let normal: Vec3 = (corner(b) - corner(a)).cross(corner(c) - corner(a));
            self.indices.extend(if normal.z < 0.0 { [a, c, b] } else { [a, b, c] });
        }
    }
}

/// The letters of a line with the place of each along it, and the length of the line, in units of
/// the font.
fn places(face: &Face<'_>, line: &str) -> Result<(Vec<(GlyphId, f32)>, f32), String> {
    let (mut places, mut x, mut before) = (Vec::new(), 0.0, None);
    for letter in line.chars() {
        let glyph = face.glyph_index(letter).ok_or_else(|| {
            format!("the font has no letter {letter:?}; it has Latin, Greek and Cyrillic ones")
        })?;
        if let Some(before) = before {
            x += kerning(face, before, glyph);
        }
        places.push((glyph, x));
        x += f32::from(face.glyph_hor_advance(glyph).unwrap_or(0));
        before = Some(glyph);
    }
    Ok((places, x))
}

/// The distance by which two letters stand further apart than usual.
fn kerning(face: &Face<'_>, left: GlyphId, right: GlyphId) -> f32 {
    let tables = face.tables().kern.into_iter().flat_map(|kern| kern.subtables);
    let mut plain = tables.filter(|table| table.horizontal && !table.variable);
    plain.find_map(|table| table.glyphs_kerning(left, right)).map_or(0.0, f32::from)
}

/// The outline of a letter as triangles.
fn filled(face: &Face<'_>, glyph: GlyphId) -> Result<VertexBuffers<Point, u32>, String> {
    let mut outline = Outline(Path::builder());
    let mut letter = VertexBuffers::new();
    if face.outline_glyph(glyph, &mut outline).is_none() {
        // A space.
        return Ok(letter);
    }
    let tolerance = TOLERANCE * f32::from(face.units_per_em());
    let options = FillOptions::tolerance(tolerance).with_fill_rule(FillRule::NonZero);
    let mut buffers = BuffersBuilder::new(&mut letter, |vertex: FillVertex<'_>| vertex.position());
    let path = outline.0.build();
    FillTessellator::new()
        .tessellate_path(&path, &options, &mut buffers)
        .map_err(|error| format!("a letter cannot be filled: {error}"))?;
    Ok(letter)
}

/// From one crate's outlines to the other's.
struct Outline(Builder);

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.0.begin(point(x, y));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.0.line_to(point(x, y));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.0.quadratic_bezier_to(point(x1, y1), point(x, y));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.0.cubic_bezier_to(point(x1, y1), point(x2, y2), point(x, y));
    }

    fn close(&mut self) {
        self.0.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &MeshData) -> f32 {
        let corner = |index: &u32| mesh.positions[*index as usize];
        let triangles = mesh.indices.chunks_exact(3);
        let area =
            |t: &[u32]| (corner(&t[1]) - corner(&t[0])).cross(corner(&t[2]) - corner(&t[0])).z;
        triangles.map(area).inspect(|area| assert!(*area >= 0.0, "seen from +Z")).sum::<f32>() / 2.0
    }

    fn bounds(mesh: &MeshData) -> (Vec3, Vec3) {
        let positions = || mesh.positions.iter().copied();
        (positions().reduce(Vec3::min).expect("some"), positions().reduce(Vec3::max).expect("some"))
    }

    #[test]
    fn letters_have_their_areas_and_stand_around_the_origin() {
        // A dash has no curves.
        let dash = MeshData::text("\u{2014}", 1.0).expect("a dash");
        let (min, max) = bounds(&dash);
        let full = (max - min).x * (max - min).y;
        assert!((area(&dash) - full).abs() < 1e-6 * full, "{} of {full}", area(&dash));
        // A ring of the outlines of an o is not filled inside.
        let ring = MeshData::text("o", 1.0).expect("an o");
        let (min, max) = bounds(&ring);
        let share = area(&ring) / ((max - min).x * (max - min).y);
        assert!((0.3..0.6).contains(&share), "{share}");
        let (one, two) = (MeshData::text("HH", 2.0), MeshData::text("HH\nHH", 2.0));
        let [one, two] = [one, two].map(|mesh| bounds(&mesh.expect("text")));
        for (min, max) in [one, two] {
            let middle = (min + max) / 2.0;
            assert!(middle.x.abs() < 0.05 && middle.y.abs() < 1e-5, "{middle}");
        }
        assert!(((two.1 - two.0).y - (one.1 - one.0).y - 2.0).abs() < 1e-5, "2 between lines");
        assert!(((one.1 - one.0).y / 2.0 - 0.63).abs() < 0.01, "{}", (one.1 - one.0).y / 2.0);
        let [apart, together] = ["A\u{a0}V", "AV"].map(|text| {
            let (min, max) = bounds(&MeshData::text(text, 1.0).expect("text"));
            max.x - min.x
        });
        assert!(together < apart);
        let many = "Müßiggänger ĄŻ Ωμέγα Щёкин".repeat(8);
        let many = MeshData::text(&many, 1.0).expect("half a page");
        let bytes = many.positions.len() * 12 + many.indices.len() * 4;
        println!("208 letters take {bytes} bytes");
        assert!(bytes < 512 << 10);
    }

    #[test]
    fn a_label_is_seen_through_if_its_colour_is() {
        for (alpha, is_blended) in [(1.0, false), (0.5, true)] {
            let mut assets = Assets::default();
            assets.add_label("a", 1.0, Vec4::new(1.0, 1.0, 1.0, alpha)).expect("a label");
            let file = assets.to_glb().expect("sound");
            assert_eq!(String::from_utf8_lossy(&file).contains("BLEND"), is_blended);
        }
    }

    #[test]
    fn labels_that_cannot_be_are_refused() {
        for (text, size, part) in [
            ("a".repeat(1_000_000), 1.0, "1000000 bytes, where 512 can be"),
            (String::new(), 1.0, "nothing to see"),
            (" \n ".to_owned(), 1.0, "nothing to see"),
            ("港".to_owned(), 1.0, "no letter '港'"),
            ("a".to_owned(), 0.0, "above 0"),
            ("a".to_owned(), f32::NAN, "above 0"),
            ("a\u{7}".to_owned(), 1.0, "no letter"),
        ] {
            let error = MeshData::text(&text, size).expect_err(part).to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
