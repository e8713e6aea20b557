//! Meshlets: the parts of a primitive that are culled and replaced by coarser ones on their own.
//!
//! The meshlets of a primitive form a hierarchy of detail. Those of the finest level are the
//! primitive's own triangles. Neighbouring meshlets form a group, whose triangles are simplified
//! together, with its border locked where other groups meet it, and cut into coarser meshlets.
//! A meshlet is drawn where its own error is small enough and that of the meshlets that replace it
//! is not. Errors and spheres never shrink towards coarser levels, and all meshlets of a group have
//! the same ones, so that each part of the surface is drawn by exactly one level and borders meet:
//! Ponchio, "Multiresolution structures for interactive visualization of very large 3D datasets"
//! (2009), chapter 4; Karis, Stubbe and Wihlidal, "Nanite" (SIGGRAPH 2021).

use glam::Vec3;

/// A sphere around all triangles that an error speaks of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorSphere {
    /// In the primitive's space, relative to its origin.
    pub center: Vec3,
    /// In units of the primitive's space; 0 or more.
    pub radius: f32,
}

/// A run of triangles of one level of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meshlet {
    /// The place of its first index in the order in which all are drawn: the finest level first,
    /// then coarser ones. The blob has them in the order of its meshlets.
    pub first_index: u32,
    /// Number of its indices; a multiple of 3, never 0.
    pub index_count: u32,
    /// The least corner of the box around its triangles, relative to the primitive's origin.
    pub min: Vec3,
    /// The greatest corner of that box.
    pub max: Vec3,
    /// The middle of the normals of its triangles, of unit length. Zero if they point in too many
    /// directions.
    pub cone_axis: Vec3,
    /// The sine of the widest angle between a normal and the axis.
    pub cone_sine: f32,
    /// An upper bound of the distance between the surface of its level and that of the finest one,
    /// in both directions and in units of the primitive's space. 0 exactly in the finest level.
    pub error: f32,
    /// The sphere of `error`.
    pub sphere: ErrorSphere,
    /// The error of the meshlets that replace it, at least `error` and above 0; infinite in the
    /// coarsest level.
    pub coarser_error: f32,
    /// The sphere of `coarser_error`, around `sphere`.
    pub coarser_sphere: ErrorSphere,
    /// Its level of detail: 0 is the finest; what replaces it has a higher one.
    pub level: u32,
}

impl Meshlet {
    /// Bytes of a meshlet in a blob.
    pub const BYTES: usize = 92;

    /// Its 23 words in the order of the fields, little-endian.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let sphere = |of: &ErrorSphere| [of.center.x, of.center.y, of.center.z, of.radius];
        let (own, coarser) = (sphere(&self.sphere), sphere(&self.coarser_sphere));
        let floats = [
            &self.min.to_array()[..],
            &self.max.to_array(),
            &self.cone_axis.to_array(),
            &[self.cone_sine, self.error],
            &own,
            &[self.coarser_error],
            &coarser,
        ];
        let floats = floats.into_iter().flatten().map(|number| number.to_bits());
        let words = [self.first_index, self.index_count].into_iter().chain(floats);
        let words = words.chain([self.level]);
        let mut bytes = [0; Self::BYTES];
        for (to, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *to = word.to_le_bytes();
        }
        bytes
    }

    /// The meshlet of [`Self::to_bytes`]. Any bytes make one; [`fault`] says what is wrong.
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
        let words = bytes.as_chunks::<4>().0;
        let word = |at: usize| u32::from_le_bytes(words[at]);
        let float = |at: usize| f32::from_bits(word(at));
        let vector = |at: usize| Vec3::new(float(at), float(at + 1), float(at + 2));
        let sphere = |at: usize| ErrorSphere { center: vector(at), radius: float(at + 3) };
        Self {
            first_index: word(0),
            index_count: word(1),
            min: vector(2),
            max: vector(5),
            cone_axis: vector(8),
            cone_sine: float(11),
            error: float(12),
            sphere: sphere(13),
            coarser_error: float(17),
            coarser_sphere: sphere(18),
            level: word(22),
        }
    }

    /// Returns what is wrong with it, if anything. `indices` is the number of all indices of the
    /// blob.
    fn fault(&self, indices: u32) -> Option<&'static str> {
        let is_finite = |of: &ErrorSphere| of.center.is_finite() && of.radius >= 0.0;
        let end = u64::from(self.first_index) + u64::from(self.index_count);
        let triangles = self.index_count / 3;
        if triangles * 3 != self.index_count || triangles == 0 || end > u64::from(indices) {
            return Some("its indices are not whole triangles of the blob");
        }
        let is_box = self.min.is_finite() && self.max.is_finite() && self.min.cmple(self.max).all();
        if !is_box || !self.cone_axis.is_finite() || !self.cone_sine.is_finite() {
            return Some("its box or its cone is not finite");
        }
        if !is_finite(&self.sphere) || !is_finite(&self.coarser_sphere) {
            return Some("a sphere of it is not finite");
        }
        // Comparisons with NaN are false.
        let is_ordered = self.error >= 0.0 && self.coarser_error >= self.error;
        if !is_ordered || self.coarser_error <= 0.0 || self.error.is_infinite() {
            return Some("its errors are not in order");
        }
        None
    }
}

/// Returns what is wrong with the meshlets of a primitive of `fine` indices in its finest level and
/// `indices` in all, if anything.
pub fn fault(meshlets: &[Meshlet], fine: u32, indices: u32) -> Option<String> {
    let faults = meshlets.iter().map(|meshlet| meshlet.fault(indices));
    for (at, what) in faults.enumerate() {
        if let Some(what) = what {
            return Some(format!("meshlet {at}: {what}"));
        }
    }
    // What errors of 0 draw is the finest level: each of its triangles once, in their order.
    let mut next = 0;
    for meshlet in meshlets.iter().filter(|meshlet| meshlet.error == 0.0) {
        if meshlet.first_index != next {
            return Some(format!("the finest level does not go on at index {next}"));
        }
        next += meshlet.index_count;
    }
    (next != fine && !meshlets.is_empty())
        .then(|| format!("the finest level has {next} indices, where {fine} would be right"))
}

/// Puts the meshlets of a blob into the order in which they are drawn, with the indices of each
/// behind those of the one before. Returns the place of each one's first index in the blob.
pub fn put_in_draw_order(meshlets: &mut [Meshlet]) -> Vec<u64> {
    let mut next_in_blob = 0;
    let mut placed: Vec<(Meshlet, u64)> = Vec::with_capacity(meshlets.len());
    for meshlet in &*meshlets {
        placed.push((*meshlet, next_in_blob));
        next_in_blob += u64::from(meshlet.index_count);
    }
    placed.sort_by_key(|(meshlet, _)| meshlet.first_index);
    let mut next: u32 = 0;
    for (to, (meshlet, _)) in meshlets.iter_mut().zip(&placed) {
        *to = Meshlet { first_index: next, ..*meshlet };
        next = next.saturating_add(meshlet.index_count);
    }
    placed.into_iter().map(|(_, at)| at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meshlet() -> Meshlet {
        Meshlet {
            first_index: 0,
            index_count: 6,
            min: Vec3::NEG_ONE,
            max: Vec3::new(2.0, 3.0, 4.0),
            cone_axis: Vec3::Y,
            cone_sine: 0.25,
            error: 0.0,
            sphere: ErrorSphere { center: Vec3::new(5.0, 6.0, 7.0), radius: 8.0 },
            coarser_error: 0.5,
            coarser_sphere: ErrorSphere { center: Vec3::new(9.0, 10.0, 11.0), radius: 12.0 },
            level: 3,
        }
    }

    #[test]
    fn meshlets_come_back_from_their_bytes() {
        assert_eq!(Meshlet::from_bytes(&meshlet().to_bytes()), meshlet());
    }

    #[test]
    fn wrong_meshlets_are_refused() {
        let coarse = Meshlet { first_index: 6, error: 0.5, coarser_error: 1.0, ..meshlet() };
        assert_eq!(fault(&[], 6, 6), None);
        assert_eq!(fault(&[meshlet(), coarse], 6, 12), None);
        let is_fault = |wrong: Meshlet| fault(&[wrong], 6, 12).is_some();
        assert!(!is_fault(meshlet()));
        assert!(is_fault(Meshlet { index_count: 5, ..meshlet() }));
        assert!(is_fault(Meshlet { index_count: 0, ..meshlet() }));
        assert!(is_fault(Meshlet { first_index: u32::MAX, ..meshlet() }));
        assert!(is_fault(Meshlet { min: Vec3::splat(9.0), ..meshlet() }));
        assert!(is_fault(Meshlet { cone_sine: f32::NAN, ..meshlet() }));
        assert!(is_fault(Meshlet { error: f32::NAN, ..meshlet() }));
        assert!(is_fault(Meshlet { error: -1.0, ..meshlet() }));
        assert!(is_fault(Meshlet { error: 1.0, ..meshlet() }));
        assert!(is_fault(Meshlet { coarser_error: 0.0, ..meshlet() }));
        assert!(is_fault(Meshlet { index_count: 3, ..meshlet() }));
        assert!(fault(&[coarse], 6, 12).is_some());
    }
}
