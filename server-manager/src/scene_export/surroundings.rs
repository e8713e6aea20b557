//! The surroundings of a scene, as `EXT_lights_image_based` has them.

use std::f64::consts::PI;
use std::io::Write;

use polyptych_scene::EnvironmentMap;
use polyptych_scene::environment_map::HARMONICS;
use polyptych_scene::glb::{GlbWriter, JsonList};

use super::picture::{png, srgb_of_linear};
use super::{ExportError, Lists, SceneWriter};

/// The extension's name.
pub(super) const NAME: &str = "EXT_lights_image_based";

/// The largest radiance that RGBD holds.
const RADIANCE_MAX: f32 = 255.0;

impl SceneWriter<'_> {
    /// Writes the surroundings that the scene brings along, if any.
    pub(super) fn surroundings(&mut self, lists: &mut Lists) -> Result<(), ExportError> {
        let Some(hash) = self.scene.surroundings else { return Ok(()) };
        let map = EnvironmentMap::decode(&self.stored(hash)?).map_err(ExportError::Other)?;
        let (light, is_whole) = light_json(&map, &mut self.file, &mut lists.images)?;
        lists.image_based_lights.push(&light);
        self.file.use_extension(NAME);
        if !is_whole {
            let note = format!("surroundings: radiance above {RADIANCE_MAX} is that in the file");
            self.notes.push(note);
        }
        Ok(())
    }
}

/// Writes a map's images. Returns its light, and whether all of its radiance is in it.
fn light_json<W: Write>(
    map: &EnvironmentMap,
    file: &mut GlbWriter<W>,
    images: &mut JsonList,
) -> Result<(String, bool), ExportError> {
    let mut texels = map.radiance();
    let (mut levels, mut is_whole) = (Vec::new(), true);
    for level in 0..map.levels() {
        let side = map.side >> level;
        let mut faces = Vec::new();
        for _ in 0..6 {
            let mut face: Vec<[u8; 4]> = Vec::with_capacity((side * side) as usize);
            for texel in texels.by_ref().take((side * side) as usize) {
                is_whole &= texel.iter().all(|of| *of <= RADIANCE_MAX);
                face.push(rgbd(texel));
            }
            // Seen from inside, where ours are as graphics libraries have them.
            face.chunks_exact_mut(side as usize).for_each(<[_]>::reverse);
            let picture = file.picture(&png(side, side, face.as_flattened())?)?;
            faces.push(images.push(&picture));
        }
        levels.push(format!("{faces:?}"));
    }
    let irradiance = map.diffuse.iter().zip(HARMONICS).map(|(term, factor)| {
        let numbers = term.map(|of| f64::from(of) * PI / factor);
        format!("{numbers:?}")
    });
    let irradiance = irradiance.collect::<Vec<_>>().join(",");
    let light = format!(
        r#"{{"irradianceCoefficients":[{irradiance}],"specularImageSize":{},{}}}"#,
        map.side,
        format_args!(r#""specularImages":[{}]"#, levels.join(",")),
    );
    Ok((light, is_whole))
}

/// A radiance as sRGB that is divided by alpha; the largest alpha that no colour is cut by.
fn rgbd(radiance: [f32; 3]) -> [u8; 4] {
    let largest = radiance.iter().fold(1f32, |most, of| most.max(*of));
    let alpha = (255.0 / largest).floor().max(1.0);
    let code = |of: f32| (srgb_of_linear((of * alpha / 255.0).min(1.0)) * 255.0).round() as u8;
    let [r, g, b] = radiance.map(code);
    [r, g, b, alpha as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_is_kept_within_what_rgbd_holds() {
        let linear = |code: u8| {
            let srgb = f32::from(code) / 255.0;
            if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
        };
        for largest in [0.0f32, 0.003, 0.2, 1.0, 1.01, 3.7, 40.0, 254.0, 255.0] {
            let [r, g, b, a] = rgbd([largest, largest * 0.5, 0.0]);
            let read = |code: u8| linear(code) * 255.0 / f32::from(a);
            // Half a code of sRGB at white, and of what is half as bright.
            assert!(
                (read(r) - largest).abs() <= 0.0046 * largest.max(1.0),
                "{largest}: {}",
                read(r)
            );
            assert!((read(g) - largest * 0.5).abs() <= 0.0046 * largest.max(1.0), "{largest}");
            assert_eq!(b, 0);
        }
        assert_eq!(rgbd([6e4, 0.0, 1.0])[..2], [255, 0]);
    }
}
