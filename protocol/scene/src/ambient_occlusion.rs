//! Ambient occlusion: corners and gaps get less of the light from all around.

use serde::{Deserialize, Serialize};

/// Less light from all around where surfaces are near: in corners and gaps, and where things stand
/// on the ground. Light of lamps and suns has shadows of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AmbientOcclusion {
    /// Nothing that is farther from a place than this takes light from it, in units of the world;
    /// what is nearer takes more of it. More than 0. As seen from the eye it is no more than 7°.
    pub radius: f32,
}

impl AmbientOcclusion {
    /// Returns what is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let Self { radius } = self;
        let is_length = radius.is_normal() && *radius > 0.0;
        (!is_length).then(|| format!("ambient occlusion has a radius above 0, not {radius}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_a_radius_that_is_no_length() {
        assert_eq!(AmbientOcclusion { radius: 0.5 }.fault(), None);
        for radius in [0.0, -0.5, f32::NAN, f32::INFINITY, 1e-40] {
            let fault = AmbientOcclusion { radius }.fault();
            assert!(fault.is_some_and(|fault| fault.contains("radius")), "{radius}");
        }
    }
}
