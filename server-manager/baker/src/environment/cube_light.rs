//! Surroundings that a glTF file brings along as the faces of a cube (`EXT_lights_image_based`).
//!
//! The extension's text has each face as it is seen from inside, in the axes of glTF. Babylon.js
//! and what is made with it have the faces of graphics libraries, whose images are the mirrored
//! ones of a right-handed world, and look into them with −z for z. Neither says which it is: the
//! faces of one do not hang together as those of the other, so their borders tell.

use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use glam::{DQuat, DVec3, Vec3};
use polyptych_scene::EnvironmentMap;
use polyptych_scene::environment_map::SIDE_MIN;

use super::cube_map::{CubeMap, fill};
use super::equirect::Equirect;
use super::{irradiance, prefiltered};
use crate::error::BakeError;

/// Faces of Babylon.js differ at their borders by less than this part of what they would differ by
/// as the extension's text has them.
const OTHER_ORDER_PART: f64 = 0.5;

/// A light as a file has it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CubeLight {
    /// The side of a face in texels: a power of two, at most [`SIDE_MAX`].
    ///
    /// [`SIDE_MAX`]: polyptych_scene::environment_map::SIDE_MAX
    pub side: u32,
    /// Radiance by face in the order +X −X +Y −Y +Z −Z, row from the top, and column.
    pub texels: Vec<Vec3>,
    /// Irradiance as factors of the real spherical harmonics; that of the faces if it is not given.
    pub irradiance: Option<[DVec3; 9]>,
    /// The world from the light's own axes.
    pub rotation: DQuat,
    /// A factor of all its light, 0 or more.
    pub intensity: f64,
}

/// The directions of a light's faces from those of glTF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Faces {
    /// Those of the extension's text.
    OfText,
    /// Those of Babylon.js.
    OfBabylon,
}

impl Faces {
    fn direction(self, of: DVec3) -> DVec3 {
        match self {
            Self::OfText => of,
            Self::OfBabylon => DVec3::new(of.x, of.y, -of.z),
        }
    }
}

impl CubeLight {
    /// Prepares the light for shading.
    ///
    /// # Errors
    /// Nobody wants it any more.
    pub fn map(&self, cancel: &AtomicBool) -> Result<EnvironmentMap, BakeError> {
        let (source, faces) = self.source();
        let from = self.rotation.inverse();
        let toward = |of: DVec3| faces.direction(from * of);
        let side = self.side.max(SIDE_MIN);
        let intensity = self.intensity as f32;
        let texels = fill(side, |of| source.radiance(toward(of), 0.0) * intensity);
        let cube = CubeMap::of_texels(side, texels);
        let diffuse = match &self.irradiance {
            Some(terms) => irradiance::expand(|of| {
                irradiance::evaluate(terms, toward(of)) * (self.intensity / PI)
            }),
            None => irradiance::diffuse(&Equirect::of(4 * SIDE_MIN, |of| cube.radiance(of, 0.0))),
        };
        prefiltered(&cube, diffuse, cancel)
    }

    /// The faces as graphics libraries have them, and how they are looked into.
    fn source(&self) -> (CubeMap, Faces) {
        let as_they_are = CubeMap::of_texels(self.side, self.texels.clone());
        let mut mirrored = self.texels.clone();
        mirrored.chunks_exact_mut(self.side as usize).for_each(<[Vec3]>::reverse);
        let mirrored = CubeMap::of_texels(self.side, mirrored);
        let [other, text] = [&as_they_are, &mirrored].map(CubeMap::border_difference);
        if other < OTHER_ORDER_PART * text {
            (as_they_are, Faces::OfBabylon)
        } else {
            (mirrored, Faces::OfText)
        }
    }
}
