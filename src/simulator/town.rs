//! The generated scene: a harbour town on a hill, as glTF 2.0 binary.
//!
//! ```text
//!   random ── ground ── terrain ─┐
//!   canvas ── facade, cover ── material ─┤
//!   surface ── wall, roof ── building, landmark, tree, lamp, boat ─┤── block, quay, water ── glb
//! ```
//!
//! Equal blocks and an equal seed give equal bytes on every machine: the stream of random numbers
//! is written here, angles are summed from series, and positions are multiples of 1/1024 m. Lengths
//! are metres, +Y is up, the sea lies towards +Z and is y = 0.
//!
//! **Invariant:** this module knows no other module of the package.

mod block;
mod boat;
mod bobbing;
mod building;
mod canvas;
mod color;
mod facade;
mod facade_wall;
mod glb;
mod ground_textures;
mod heightfield;
mod lamp;
mod landmark;
mod material;
mod quay;
mod random;
mod roof;
mod surface;
mod terrain;
#[cfg(test)]
mod tests;
mod tree;
mod trig;
mod water;

use std::error::Error;
use std::fmt;

use block::{Block, Shared};
use glam::{DVec3, Vec3};
use glb::{Glb, Node, Placement};
use heightfield::{Heightfield, rim_cells};
use terrain::GroundCover;
use tree::Tree;

/// The largest town: 128 × 128 blocks are five kilometres wide.
pub const BLOCKS_MAX: u32 = 128;

/// A church stands in every square of this many blocks.
const PARISH: i32 = 8;

/// The options of a town.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TownOptions {
    /// Blocks of 40 m along each side, 1 to [`BLOCKS_MAX`].
    pub blocks: u32,
    /// Another seed is another town.
    pub seed: u64,
    /// Its optional parts.
    pub extras: TownExtras,
}

/// The optional parts of a town.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TownExtras {
    /// The sea reaches to the horizon.
    pub has_open_sea: bool,
    /// Boats ride on the waves: an animation.
    pub has_waves: bool,
    /// The sun is about to set, and lamps burn along the quay too.
    pub is_dusk: bool,
}

impl TownOptions {
    /// The box around the houses and the quay, in metres: what to look at. Around them lie the
    /// rim of the island and the sea.
    pub fn focus(&self) -> (DVec3, DVec3) {
        let side = 40.0 * f64::from(self.blocks);
        (DVec3::new(-0.5 * side, 0.0, -0.8 * side), DVec3::new(0.5 * side, 16.0, 0.2 * side))
    }
}

/// Why there is no town.
#[derive(Debug)]
pub enum TownError {
    /// The number of blocks is out of range.
    Blocks {
        /// The number that was given.
        blocks: u32,
    },
    /// A texture could not be encoded.
    Texture(image::ImageError),
    /// The JSON could not be encoded.
    Json(serde_json::Error),
    /// The file would be larger than its format allows.
    TooLarge {
        /// The length that does not fit.
        bytes: usize,
    },
}

impl fmt::Display for TownError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Blocks { blocks } => {
                write!(f, "a town of {blocks} blocks: --blocks takes 1 to {BLOCKS_MAX}")
            }
            Self::Texture(_) => write!(f, "a texture of the town cannot be written as PNG"),
            Self::Json(_) => write!(f, "the town's JSON cannot be written"),
            Self::TooLarge { bytes } => {
                write!(f, "the town takes {bytes} bytes, a GLB at most 4 GiB: take fewer blocks")
            }
        }
    }
}

impl Error for TownError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Texture(error) => Some(error),
            Self::Json(error) => Some(error),
            Self::Blocks { .. } | Self::TooLarge { .. } => None,
        }
    }
}

/// Builds a town and gives the bytes of its GLB file.
///
/// # Errors
///
/// [`TownError::Blocks`] where `blocks` is not 1 to [`BLOCKS_MAX`]; the others say that the file
/// could not be encoded.
pub fn generate(options: &TownOptions) -> Result<Vec<u8>, TownError> {
    let TownOptions { blocks, seed, extras } = *options;
    if !(1..=BLOCKS_MAX).contains(&blocks) {
        return Err(TownError::Blocks { blocks });
    }
    let ground = Heightfield::new(blocks, seed);
    let mut file = Glb::default();
    material::write_all(&mut file)?;
    let shared = share(&mut file, extras);
    let mut roots = vec![sun(&mut file, extras)];
    let (size, rim) = (blocks as i32, rim_cells(blocks));
    for row in -1..size + rim {
        for column in -rim..size + rim {
            let is_before = row < 0 && (0..size).contains(&column);
            let is_town = (0..size).contains(&row) && (0..size).contains(&column);
            if is_before {
                continue;
            }
            let place = [column, row];
            let cover = match is_town {
                true if has_church(size, place) => GroundCover::Square,
                true => GroundCover::Lot,
                false => GroundCover::Wild,
            };
            let mut block = Block::new(&mut file, &ground, &shared, seed, place, cover);
            match cover {
                GroundCover::Lot => block.populate(),
                GroundCover::Square => block.church(),
                GroundCover::Wild => block.plant_trees(),
            }
            roots.extend(block.finish());
        }
    }
    let lamp = extras.is_dusk.then_some((shared.lamp, shared.lamp_light));
    roots.push(quay::write(&mut file, &ground, &quay::Harbour { blocks, seed, extras, lamp }));
    roots.push(water::write(&mut file, &ground, extras.has_open_sea));
    file.finish(&roots)
}

/// Returns whether a block is a church's square: one in every parish, a little right of its middle.
fn has_church(size: i32, [column, row]: [i32; 2]) -> bool {
    let parish = size.min(PARISH);
    let middle = [parish / 2, parish - 1 - parish / 4];
    size > 1 && column % parish == middle[0] && row % parish == middle[1]
}

fn share(file: &mut Glb, extras: TownExtras) -> Shared {
    let houses = building::CATALOGUE.iter().enumerate();
    Shared {
        houses: houses.map(|(n, d)| file.add_mesh(&format!("house-{n}"), &d.model())).collect(),
        trees: Tree::ALL.map(|tree| file.add_mesh(tree.name(), &tree.model())),
        lamp: file.add_mesh("lamp", &lamp::model()),
        lamp_light: file.add_light(lamp::light(extras.is_dusk)),
        church: file.add_mesh("church", &landmark::church()),
    }
}

/// A sun over the sea, to the left of one who looks at the town, 40° high; 5° at dusk.
fn sun(file: &mut Glb, extras: TownExtras) -> usize {
    let light = file.add_light(lamp::sun(extras.is_dusk));
    let mut node = Node::new("sun", Placement::at(Vec3::new(0.0, 200.0, 0.0)));
    node.light = Some(light);
    node.placement.turn = -0.115;
    node.tilt = if extras.is_dusk { -0.014 } else { -0.11 };
    file.add_node(&node)
}
