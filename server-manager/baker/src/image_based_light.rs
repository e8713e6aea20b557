//! Light from all around that a file brings along: `EXT_lights_image_based` of the shown scene.

use glam::{DQuat, DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_scene::environment_map::SIDE_MAX;
use serde::Deserialize;

use super::BakeJob;
use super::environment::cube_light::CubeLight;
use super::error::BakeError;
use super::json::{JsonError, from_value};
use super::mip::{Rgba8Image, linear_of_srgb};
use super::texture::{self, PixelBudget};

/// The extension's name.
pub(super) const NAME: &str = "EXT_lights_image_based";

/// The largest number of a light: what is computed with it stays far from the end of f32.
const NUMBER_MAX: f64 = 1e6;

/// The extension of a scene.
#[derive(Debug, Deserialize)]
struct SceneJson {
    light: usize,
}

/// The extension of the file.
#[derive(Debug, Deserialize)]
struct FileJson {
    lights: Vec<LightJson>,
}

/// A light; `specularImageSize` is that of its images.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct LightJson {
    rotation: Option<DQuat>,
    intensity: Option<f64>,
    irradiance_coefficients: Option<[DVec3; 9]>,
    specular_images: Vec<[usize; 6]>,
}

/// Writes the surroundings of the shown scene, if it names any. Those that cannot be read are left
/// out, with a note.
pub(super) fn write(job: &mut BakeJob<'_>) -> Result<Option<BlobHash>, BakeError> {
    let scene = job.choice.index.and_then(|at| job.source.document.scenes.get(at as usize));
    let Some(of_scene) = scene.and_then(|scene| scene.extensions.get(NAME)) else {
        return Ok(None);
    };
    let light = match light(of_scene, &job.source.document.extensions.image_based_lights) {
        Ok(light) => read(job, &light)?,
        Err(reason) => Err(reason),
    };
    match light {
        Ok(light) => {
            let map = light.map(job.cancel)?;
            job.write(&map.encode(), NAME).map(Some)
        }
        Err(reason) => {
            job.warn(&format!("{NAME}: its light is not drawn, since {reason}"));
            Ok(None)
        }
    }
}

fn light(of_scene: &serde_json::Value, of_file: &serde_json::Value) -> Result<LightJson, String> {
    let fault = |JsonError { path, error }: JsonError| match path.as_str() {
        "" => format!("it cannot be read: {error}"),
        path => format!("it cannot be read: {path}: {error}"),
    };
    let SceneJson { light } = from_value::<SceneJson>(of_scene).map_err(fault)?;
    let mut file = from_value::<FileJson>(of_file).map_err(fault)?;
    if light >= file.lights.len() {
        return Err(format!("lights[{light}] is not there; the file has {}", file.lights.len()));
    }
    let light = file.lights.swap_remove(light);
    let is_beyond = |of: &&DVec3| of.abs().max_element() > NUMBER_MAX;
    if let Some(of) = light.irradiance_coefficients.iter().flatten().find(is_beyond) {
        let right = format!("numbers of at most {NUMBER_MAX} would be right");
        return Err(format!("its irradianceCoefficients have {:?}; {right}", of.to_array()));
    }
    if let Some(intensity) = light.intensity.filter(|of| !(0.0..=NUMBER_MAX).contains(of)) {
        return Err(format!("its intensity is {intensity:?}; 0 to {NUMBER_MAX} would be right"));
    }
    if let Some(rotation) = light.rotation
        && rotation.normalize().is_nan()
    {
        return Err(format!("its rotation is {rotation}; a quaternion would be right"));
    }
    Ok(light)
}

/// Reads the images of the largest level; those of the others are blurred forms of these, which
/// are made anew.
fn read(job: &mut BakeJob<'_>, light: &LightJson) -> Result<Result<CubeLight, String>, BakeError> {
    let Some(&images) = light.specular_images.first() else {
        return Ok(Err("it has no specularImages".into()));
    };
    let mut budget = PixelBudget::new(job);
    let linear = linear_of_srgb();
    let (mut texels, mut size, mut side) = (Vec::new(), None, 0);
    for index in images {
        job.check()?;
        let there = job.source.document.images.len();
        if index >= there {
            return Ok(Err(format!("images[{index}] is not there; the file has {there}")));
        }
        let picture = match texture::decoded(job, index, &mut budget)? {
            Ok(picture) => picture,
            Err(reason) => return Ok(Err(format!("images[{index}]: {reason}"))),
        };
        let (width, height) = (picture.width, picture.height);
        if width != height || !width.is_power_of_two() || size.is_some_and(|of| of != width) {
            return Ok(Err(format!(
                "images[{index}] has {width} × {height} pixels; six squares of one size would be \
                 right, a power of two"
            )));
        }
        (size, side) = (Some(width), width.min(SIDE_MAX));
        texels.extend(radiance(&picture, side, &linear));
    }
    Ok(Ok(CubeLight {
        side,
        texels,
        irradiance: light.irradiance_coefficients,
        rotation: light.rotation.unwrap_or(DQuat::IDENTITY).normalize(),
        intensity: light.intensity.unwrap_or(1.0),
    }))
}

/// The radiance of a face with this side, by rows: each texel is the mean of as many pixels as lie
/// in it. Colours are divided by alpha (RGBD), which is 1 where an image has none.
fn radiance(picture: &Rgba8Image, side: u32, linear: &[f32; 256]) -> Vec<Vec3> {
    let step = (picture.width / side) as usize;
    let pixel = |x: usize, y: usize| {
        let at = 4 * (y * picture.width as usize + x);
        let [r, g, b, a] = std::array::from_fn(|part| picture.rgba[at + part]);
        Vec3::from([r, g, b].map(|of| linear[of as usize])) * (255.0 / f32::from(a.max(1)))
    };
    let texel = |at: u32| {
        let (x, y) = ((at % side) as usize * step, (at / side) as usize * step);
        let pixels = (0..step * step).map(|part| pixel(x + part % step, y + part / step));
        pixels.sum::<Vec3>() / (step * step) as f32
    };
    (0..side * side).map(texel).collect()
}
