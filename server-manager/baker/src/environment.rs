//! Light from all around: an equirectangular picture or a computed sky in, one blob out that
//! servers shade with.
//!
//! | part | of what | how |
//! |---|---|---|
//! | [`equirect`] | Radiance .hdr files | linear RGB radiance, its sizes and numbers checked |
//! | [`sky`] | a clear sky | Preetham's model for a direction of the sun |
//! | [`irradiance`] | diffuse light | 9 coefficients of spherical harmonics |
//! | [`cube_light`] | light of a glTF file | the six faces of a cube, and their irradiance |
//! | [`cube_map`], [`prefilter`] | reflections | levels of a cube map, ever rougher |

pub(super) mod cube_light;
mod cube_map;
mod equirect;
mod irradiance;
mod prefilter;
mod sky;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_scene::EnvironmentMap;
use polyptych_scene::environment_map::{RADIANCE_MAX, SIDE_MAX, SIDE_MIN};
use serde::{Deserialize, Serialize};

use super::error::BakeError;
use super::{BakeCache, check, hex};
use cube_map::CubeMap;
use equirect::Equirect;
pub use sky::{SUN_HEIGHT_MIN, default_sun};

/// The surroundings of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnvironmentSource<'a> {
    /// An equirectangular picture of radiance: a Radiance .hdr file.
    File(&'a Path),
    /// A clear sky, with the sun in this direction of the world.
    Sky {
        /// Towards the sun; of any length but 0. Below [`SUN_HEIGHT_MIN`] it is raised to that.
        sun: DVec3,
    },
}

/// A baked environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakedEnvironment {
    /// Its blob; 64 hexadecimal digits in JSON.
    #[serde(with = "hex")]
    pub blob: BlobHash,
    /// Its name, for people.
    pub what: String,
    /// The part of it that is not shown as it is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
}

/// Prepares surroundings for shading and writes their blob into the store.
///
/// # Errors
/// [`BakeError`], which names the file, the place in it, what is wrong and what would be right.
pub fn bake_environment(
    source: EnvironmentSource<'_>,
    store: &BakeCache,
    cancel: &AtomicBool,
) -> Result<BakedEnvironment, BakeError> {
    let (picture, what) = match source {
        EnvironmentSource::File(path) => {
            let picture = Equirect::read(path, cancel).map_err(|error| error.about(path))?;
            let what = format!("environment of {} × {} pixels", picture.width, picture.height);
            (picture, what)
        }
        EnvironmentSource::Sky { sun } => {
            let sun = sky::raised(sun);
            let height_deg = sun.y.asin().to_degrees();
            (sky::picture(sun), format!("clear sky with the sun {height_deg:.0}° high"))
        }
    };
    let brightest = picture.pixels.iter().fold(0f32, |most, pixel| most.max(pixel.max_element()));
    let warning = (brightest > RADIANCE_MAX).then(|| {
        format!(
            "radiance up to {brightest:.3e} is reflected and shown as at most {RADIANCE_MAX}; \
             diffuse light has all of it"
        )
    });
    let has_sun = matches!(source, EnvironmentSource::File(_));
    let map = EnvironmentMap { has_sun, ..environment_map(&picture, cancel)? };
    let blob = store.blobs().write(&map.encode())?;
    // A manager remembers it from its answer on, which must not outlive it.
    store.sync()?;
    Ok(BakedEnvironment { blob, what, warning })
}

fn environment_map(picture: &Equirect, cancel: &AtomicBool) -> Result<EnvironmentMap, BakeError> {
    let diffuse = irradiance::diffuse(picture);
    check(cancel)?;
    // A face covers a quarter of the picture's width.
    let side = (picture.width / 4).next_power_of_two().clamp(SIDE_MIN, SIDE_MAX);
    prefiltered(&CubeMap::of(picture, side), diffuse, cancel)
}

fn prefiltered(
    cube: &CubeMap,
    diffuse: [DVec3; 9],
    cancel: &AtomicBool,
) -> Result<EnvironmentMap, BakeError> {
    let side = cube.side;
    let mut texels = Vec::with_capacity(EnvironmentMap::texel_bytes_of(side));
    for level in prefilter::levels(cube, EnvironmentMap::levels_of(side)) {
        check(cancel)?;
        texels.extend(level.into_iter().flat_map(texel));
    }
    let diffuse = diffuse.map(|term| term.as_vec3().to_array());
    Ok(EnvironmentMap { side, diffuse, texels, has_sun: true })
}

/// Red, green, blue and 1 as halves.
fn texel(radiance: Vec3) -> [u8; 8] {
    let [r, g, b] = radiance.to_array().map(|number| half(number).to_le_bytes());
    let one = half(1.0).to_le_bytes();
    [r[0], r[1], g[0], g[1], b[0], b[1], one[0], one[1]]
}

/// Bits of the IEEE 754 binary16 that is nearest to a radiance, which is clamped to what texels
/// have.
fn half(radiance: f32) -> u16 {
    let number = radiance.clamp(0.0, RADIANCE_MAX);
    if number < (-14f32).exp2() {
        return (number * 24f32.exp2()).round() as u16;
    }
    // Half of the last bit is added; what carries goes into the exponent, as it should.
    let rounded = number.to_bits() + 0xfff + (number.to_bits() >> 13 & 1);
    ((rounded >> 13) - (112 << 10)) as u16
}
