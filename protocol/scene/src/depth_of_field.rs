//! Depth of field: what is nearer or farther than what one looks at is blurred.

use serde::{Deserialize, Serialize};

/// Blur of all that is nearer or farther than a distance, as a lens as wide as `aperture` makes it:
/// a point at a distance d from the eye becomes a disc that is `aperture` × |1 / `focus` − 1 / d|
/// radians wide. As seen from the eye no disc is wider than 4°.
///
/// Distances count from the eye, not along one axis, so that displays that face elsewhere agree.
/// What blends is blurred as what is behind it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthOfField {
    /// What is at this distance from the eye is sharp, in units of the world. More than 0.
    pub focus: f32,
    /// The width of the lens, in units of the world. More than 0.
    pub aperture: f32,
}

impl DepthOfField {
    /// The blur of a lens a fiftieth of this distance wide: what is very far becomes discs of 1.1°.
    pub fn new(focus: f32) -> Self {
        Self { focus, aperture: focus / 50.0 }
    }

    /// Returns what is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let Self { focus, aperture } = self;
        let is_length = |length: f32| length.is_normal() && length > 0.0;
        if !is_length(*focus) {
            return Some(format!("depth of field has a focus above 0, not {focus}"));
        }
        (!is_length(*aperture))
            .then(|| format!("depth of field has an aperture above 0, not {aperture}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_the_number_that_is_no_length() {
        assert_eq!(DepthOfField { focus: 5.0, aperture: 0.1 }.fault(), None);
        for wrong in [0.0, -0.5, f32::NAN, f32::INFINITY, 1e-40] {
            let [focus, aperture] = [(wrong, 0.1), (5.0, wrong)]
                .map(|(focus, aperture)| DepthOfField { focus, aperture }.fault());
            assert!(focus.is_some_and(|fault| fault.contains("focus")), "{wrong}");
            assert!(aperture.is_some_and(|fault| fault.contains("aperture")), "{wrong}");
        }
    }
}
