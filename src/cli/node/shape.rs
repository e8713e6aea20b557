//! A new mesh as a person, or a file of operations, says it: a shape with its sizes and its colour.

use anyhow::{Context, bail};
use polyptych_client::glam::{Vec2, Vec3, Vec4};
use polyptych_client::{AlphaMode, Assets, Material, MeshData};
use serde_json::Value;

/// The shapes, as they stand in help and in errors.
const SHAPES: &str = "box:X,Y,Z sphere:RADIUS cylinder:RADIUS,HEIGHT cone:LOW,HIGH,HEIGHT \
                      rectangle:WIDTH,HEIGHT line:X,Y,Z,X,Y,Z,… points:X,Y,Z,…";

/// A mesh that is made for a node.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape(MeshData);

impl Shape {
    /// That of a word such as `box:1,2,3`, or of an object such as `{"box": [1, 2, 3]}` or
    /// `{"positions": [[0, 0, 0], …], "indices": […]}`. `None` where it is neither.
    ///
    /// # Errors
    /// There is no such shape, or its sizes are none.
    pub fn of(value: &Value) -> anyhow::Result<Option<Self>> {
        let (kind, sizes) = match value {
            Value::String(word) => {
                let (kind, sizes) = word
                    .split_once(':')
                    .with_context(|| format!("an index of a mesh, none, or a shape: {SHAPES}"))?;
                let sizes: Result<Vec<f32>, _> =
                    sizes.split(',').map(|size| size.trim().parse()).collect();
                (kind, sizes.ok().context("sizes are numbers with commas between them")?)
            }
            Value::Object(of) if of.contains_key("positions") => return arrays(value).map(Some),
            Value::Object(of) => {
                let mut keys = of.iter();
                let (Some((kind, sizes)), None) = (keys.next(), keys.next()) else {
                    bail!("one shape, such as {{\"box\": [1, 2, 3]}}, or \"positions\"");
                };
                (kind.as_str(), flat_numbers(sizes)?)
            }
            _ => return Ok(None),
        };
        shape(kind, &sizes).map(Self).map(Some)
    }

    /// Adds it to these, with a colour; gives the number of the mesh.
    pub fn add_to(self, assets: &mut Assets, color: Option<Vec4>) -> u32 {
        // Lines and points have no side that light could fall on.
        let unlit = self.0.topology != polyptych_client::Topology::Triangles;
        let base_color = color.unwrap_or(Vec4::ONE);
        let alpha_mode = if base_color.w < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
        let material = Material { base_color, alpha_mode, unlit, ..Assets::matt() };
        let material = assets.add_material(material);
        assets.add_mesh(self.0, Some(material))
    }
}

fn shape(kind: &str, sizes: &[f32]) -> anyhow::Result<MeshData> {
    if !sizes.iter().all(|size| size.is_finite()) {
        bail!("sizes are finite numbers");
    }
    let rows = || -> anyhow::Result<Vec<Vec3>> {
        let (rows, rest) = sizes.as_chunks::<3>();
        if !rest.is_empty() {
            bail!("{} numbers, where each point has three", sizes.len());
        }
        Ok(rows.iter().copied().map(Vec3::from_array).collect())
    };
    let is_size = |sizes: &[f32]| sizes.iter().all(|size| *size > 0.0);
    Ok(match (kind, sizes) {
        ("box", &[all]) if is_size(sizes) => MeshData::cuboid(Vec3::splat(all)),
        ("box", &[x, y, z]) if is_size(sizes) => MeshData::cuboid(Vec3::new(x, y, z)),
        ("sphere", &[radius]) if is_size(sizes) => MeshData::sphere(radius),
        ("cylinder", &[radius, height]) if is_size(sizes) => MeshData::cylinder(radius, height),
        ("cone", &[low, high, height]) if low >= 0.0 && high >= 0.0 && height > 0.0 => {
            MeshData::cone(low, high, height)
        }
        ("rectangle", &[width, height]) if is_size(sizes) => {
            MeshData::rectangle(Vec2::new(width, height))
        }
        ("line", _) if sizes.len() >= 6 => MeshData::polyline(&rows()?),
        ("points", _) if sizes.len() >= 3 => MeshData::points(&rows()?),
        _ => bail!("no such shape, or not its sizes, which are above 0: {SHAPES}"),
    })
}

/// All numbers of a list, of lists in it too; a number by itself is a list of one.
fn flat_numbers(value: &Value) -> anyhow::Result<Vec<f32>> {
    match value {
        Value::Array(all) => {
            let parts: anyhow::Result<Vec<Vec<f32>>> = all.iter().map(flat_numbers).collect();
            Ok(parts?.concat())
        }
        Value::Number(number) => Ok(vec![number.as_f64().context("a finite number")? as f32]),
        _ => bail!("numbers, or lists of numbers"),
    }
}

/// A mesh from arrays, as of [`MeshData`].
fn arrays(value: &Value) -> anyhow::Result<Shape> {
    let known = ["positions", "normals", "uvs", "colors", "indices"];
    if let Some(key) =
        value.as_object().and_then(|of| of.keys().find(|key| !known.contains(&&***key)))
    {
        bail!("a mesh has no {key}; it has {}", known.join(", "));
    }
    let numbers = |key: &str| {
        let list = value.get(key).map(flat_numbers).transpose().with_context(|| key.to_owned())?;
        Ok::<_, anyhow::Error>(list.unwrap_or_default())
    };
    let positions = rows(&numbers("positions")?).context("positions")?;
    let normals = rows(&numbers("normals")?).context("normals")?;
    let uvs = rows(&numbers("uvs")?).context("uvs")?;
    let colors = rows(&numbers("colors")?).context("colors")?;
    let index = |index: &Value| index.as_u64().and_then(|index| u32::try_from(index).ok());
    let indices = value.get("indices").map(|list| {
        let list = list.as_array()?.iter();
        list.map(index).collect::<Option<Vec<u32>>>()
    });
    let indices = match indices {
        None => Vec::new(),
        Some(indices) => indices.context("indices: a list of whole numbers")?,
    };
    Ok(Shape(MeshData {
        positions: positions.into_iter().map(Vec3::from_array).collect(),
        normals: normals
            .into_iter()
            .map(|normal| Vec3::from_array(normal).normalize_or_zero())
            .collect(),
        uvs: uvs.into_iter().map(Vec2::from_array).collect(),
        colors: colors.into_iter().map(Vec4::from_array).collect(),
        indices,
        ..MeshData::default()
    }))
}

fn rows<const N: usize>(numbers: &[f32]) -> anyhow::Result<Vec<[f32; N]>> {
    let (rows, rest) = numbers.as_chunks::<N>();
    if !rest.is_empty() {
        bail!("{} numbers, where each entry has {N}", numbers.len());
    }
    Ok(rows.to_vec())
}

/// A colour as linear RGBA: `#rrggbb` or `#rrggbbaa` in sRGB, or three or four linear numbers.
///
/// # Errors
/// It is neither.
pub(super) fn color(value: &Value) -> anyhow::Result<Vec4> {
    const WHAT: &str = "a colour is #rrggbb, or R,G,B or R,G,B,A from 0 to 1, linear";
    if let Some(digits) = value.as_str().and_then(|text| text.strip_prefix('#')) {
        let number = u32::from_str_radix(digits, 16).context(WHAT)?;
        let rgba = match digits.len() {
            6 => number << 8 | 0xff,
            8 => number,
            _ => bail!(WHAT),
        };
        let [r, g, b, a] = rgba.to_be_bytes().map(|byte| f32::from(byte) / 255.0);
        // IEC 61966-2-1.
        let linear = |c: f32| {
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        return Ok(Vec4::new(linear(r), linear(g), linear(b), a));
    }
    let color = match flat_numbers(value).context(WHAT)?[..] {
        [r, g, b] => Vec4::new(r, g, b, 1.0),
        [r, g, b, a] => Vec4::new(r, g, b, a),
        _ => bail!(WHAT),
    };
    if color.min_element() < 0.0 || color.max_element() > 1.0 {
        bail!(WHAT);
    }
    Ok(color)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn words_and_objects_say_the_same() {
        for (word, object) in [
            ("box:1,2,3", json!({"box": [1, 2, 3]})),
            ("sphere:0.5", json!({"sphere": 0.5})),
            ("line:0,0,0,1,0,0", json!({"line": [[0, 0, 0], [1, 0, 0]]})),
        ] {
            let of = |value: &Value| Shape::of(value).expect("a shape").expect("given");
            assert_eq!(of(&word.into()), of(&object), "{word}");
        }
        let triangle =
            json!({"positions": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "indices": [0, 1, 2]});
        let triangle = Shape::of(&triangle).expect("arrays").expect("given");
        assert_eq!((triangle.0.positions.len(), triangle.0.indices.len()), (3, 3));
    }

    #[test]
    fn what_is_no_shape_is_told_with_those_that_are() {
        for (value, part) in [
            (json!("cube:1"), "no such shape"),
            (json!("box:1,2"), "no such shape, or not its sizes"),
            (json!("box:0"), "above 0"),
            (json!("sphere:x"), "numbers with commas"),
            (json!("perhaps"), "an index of a mesh, none, or a shape"),
            (json!({"positions": [0, 0]}), "each entry has 3"),
            (json!({"positions": [], "faces": []}), "a mesh has no faces"),
            (json!({"box": 1, "sphere": 1}), "one shape"),
        ] {
            let error = format!("{:#}", Shape::of(&value).expect_err(part));
            assert!(error.contains(part), "{value}: {error}");
        }
        assert_eq!(Shape::of(&json!(3)).expect("an index"), None);
    }

    #[test]
    fn a_shape_is_seen_through_if_its_colour_is() {
        for (word, is_blended) in [("#ff8000", false), ("#ff800080", true)] {
            let shape = Shape::of(&json!("box:1")).expect("a shape").expect("given");
            let mut assets = Assets::default();
            shape.add_to(&mut assets, Some(color(&json!(word)).expect("a colour")));
            let file = assets.to_glb().expect("sound");
            assert_eq!(String::from_utf8_lossy(&file).contains("BLEND"), is_blended, "{word}");
        }
    }

    #[test]
    fn colours_are_linear() {
        let grey = color(&json!("#808080")).expect("a colour");
        assert!((grey.x - 0.2158).abs() < 1e-4 && grey.w == 1.0, "{grey}");
        assert_eq!(color(&json!([0, 0.5, 1])).expect("linear"), Vec4::new(0.0, 0.5, 1.0, 1.0));
        for wrong in [json!("red"), json!("#12"), json!([1, 2]), json!([2, 0, 0])] {
            assert!(format!("{:#}", color(&wrong).expect_err("none")).contains("#rrggbb"));
        }
    }
}
