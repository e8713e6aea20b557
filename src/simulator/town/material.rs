//! The materials of the town, and how each is written.

use serde_json::{Map, Value, json};

use super::canvas::Canvas;
use super::glb::Glb;
use super::{TownError, facade, ground_textures};

/// The materials of surfaces, in the order of the file's materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Material {
    /// Tinted walls.
    Plaster,
    /// Red walls.
    Brick,
    /// Quay, plinths, churches.
    Stone,
    /// Roofs.
    Tile,
    /// Doors, shutters, trunks, hulls.
    Timber,
    /// Glass with its frame.
    Window,
    /// Streets.
    Cobble,
    /// The hill.
    Grass,
    /// The sea.
    Water,
    /// Crowns of closed geometry.
    Foliage,
    /// Leaves cut out of cards.
    LeafCard,
    /// Sails and awnings, seen from both sides.
    Canvas,
    /// Lamp posts, bollards.
    Iron,
    /// Glowing glass.
    Lantern,
}

impl Material {
    const ALL: [Self; 14] = [
        Self::Plaster,
        Self::Brick,
        Self::Stone,
        Self::Tile,
        Self::Timber,
        Self::Window,
        Self::Cobble,
        Self::Grass,
        Self::Water,
        Self::Foliage,
        Self::LeafCard,
        Self::Canvas,
        Self::Iron,
        Self::Lantern,
    ];

    /// Its place in the file.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Returns whether vertices tint it.
    pub fn is_tinted(self) -> bool {
        !matches!(self, Self::Window | Self::Iron | Self::Lantern)
    }

    /// Returns whether it has a texture, so that vertices need coordinates.
    pub fn is_textured(self) -> bool {
        !matches!(self, Self::Canvas | Self::Iron | Self::Lantern)
    }

    /// Metres that one copy of its texture covers.
    pub fn repeat(self) -> f32 {
        match self {
            Self::Plaster | Self::Grass => 4.0,
            Self::Brick | Self::Cobble => 2.0,
            Self::Stone => 3.0,
            Self::Tile | Self::Foliage => 2.5,
            Self::Water => 16.0,
            _ => 1.0,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Plaster => "plaster",
            Self::Brick => "brick",
            Self::Stone => "stone",
            Self::Tile => "roof-tile",
            Self::Timber => "timber",
            Self::Window => "window",
            Self::Cobble => "cobble",
            Self::Grass => "grass",
            Self::Water => "water",
            Self::Foliage => "foliage",
            Self::LeafCard => "leaf-card",
            Self::Canvas => "canvas",
            Self::Iron => "iron",
            Self::Lantern => "lantern",
        }
    }

    /// Roughness where no texture says it, metalness, and the factor of the base colour.
    fn factors(self) -> (f32, f32, [f32; 3]) {
        match self {
            // The texture holds them, and factors multiply it.
            _ if self.has_roughness() => (1.0, 1.0, [1.0; 3]),
            Self::Timber => (0.7, 0.0, [1.0; 3]),
            Self::Water => (0.25, 0.0, [1.0; 3]),
            Self::Iron => (0.5, 0.75, [0.03125, 0.03125, 0.03125]),
            Self::Lantern => (0.5, 0.0, [1.0, 0.75, 0.5]),
            _ => (0.9375, 0.0, [1.0; 3]),
        }
    }

    /// Returns its painted texture; `None` if it has none.
    fn canvas(self) -> Option<Canvas> {
        match self {
            Self::Plaster => Some(facade::plaster()),
            Self::Brick => Some(facade::brick()),
            Self::Stone => Some(facade::stone()),
            Self::Tile => Some(facade::tiles()),
            Self::Timber => Some(facade::timber()),
            Self::Window => Some(facade::window()),
            Self::Cobble => Some(ground_textures::cobbles()),
            Self::Grass => Some(ground_textures::grass()),
            Self::Water => Some(ground_textures::waves()),
            Self::Foliage => Some(ground_textures::foliage()),
            Self::LeafCard => Some(ground_textures::leaves()),
            Self::Canvas | Self::Iron | Self::Lantern => None,
        }
    }

    fn has_base_color(self) -> bool {
        self != Self::Water
    }

    fn has_normals(self) -> bool {
        !matches!(self, Self::Window | Self::Grass | Self::LeafCard)
    }

    fn has_roughness(self) -> bool {
        use Material::{Brick, Cobble, Plaster, Stone, Tile, Window};
        matches!(self, Plaster | Brick | Stone | Tile | Window | Cobble)
    }
}

/// Paints every texture and adds every material to the file.
pub(super) fn write_all(file: &mut Glb) -> Result<(), TownError> {
    for material in Material::ALL {
        let described = describe(file, material)?;
        file.add_material(described);
    }
    Ok(())
}

fn describe(file: &mut Glb, material: Material) -> Result<Value, TownError> {
    let (roughness, metal, [red, green, blue]) = material.factors();
    let name = material.name();
    let mut pbr = Map::new();
    let mut whole = Map::new();
    pbr.insert("baseColorFactor".into(), json!([red, green, blue, 1.0]));
    pbr.insert("metallicFactor".into(), json!(metal));
    pbr.insert("roughnessFactor".into(), json!(roughness));
    if material == Material::LeafCard {
        whole.insert("alphaCutoff".into(), json!(0.5));
        whole.insert("alphaMode".into(), json!("MASK"));
    }
    if matches!(material, Material::LeafCard | Material::Canvas) {
        whole.insert("doubleSided".into(), json!(true));
    }
    if material == Material::Lantern {
        whole.insert("emissiveFactor".into(), json!([1.0, 0.75, 0.375]));
    }
    if let Some(canvas) = material.canvas() {
        if material.has_base_color() {
            let png = match material {
                Material::LeafCard => canvas.base_color_alpha()?,
                _ => canvas.base_color()?,
            };
            let texture = file.add_texture(&format!("{name}-base-color"), png);
            pbr.insert("baseColorTexture".into(), json!({ "index": texture }));
        }
        if material.has_normals() {
            let texture = file.add_texture(&format!("{name}-normal"), canvas.normals()?);
            whole.insert("normalTexture".into(), json!({ "index": texture }));
        }
        if material.has_roughness() {
            let png = canvas.occlusion_roughness_metal()?;
            let texture = file.add_texture(&format!("{name}-occlusion-roughness-metal"), png);
            pbr.insert("metallicRoughnessTexture".into(), json!({ "index": texture }));
            whole.insert("occlusionTexture".into(), json!({ "index": texture }));
        }
    }
    whole.insert("name".into(), json!(name));
    whole.insert("pbrMetallicRoughness".into(), Value::Object(sorted(pbr)));
    Ok(Value::Object(sorted(whole)))
}

/// Keys in the order of the alphabet, whichever map serde_json was built with.
fn sorted(map: Map<String, Value>) -> Map<String, Value> {
    let ordered: std::collections::BTreeMap<String, Value> = map.into_iter().collect();
    ordered.into_iter().collect()
}
