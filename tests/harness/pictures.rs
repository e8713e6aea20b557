//! Pictures are compared by three numbers, and written where they fail.

use std::fmt;
use std::path::{Path, PathBuf};

use image::{Rgba, RgbaImage};
use polyptych_client::Image;

/// The difference between two pictures of the same size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Difference {
    pub pixels: u64,
    /// Pixels that are not the same bytes.
    pub differing: u64,
    /// Pixels of which a colour is more than one level of 255 off.
    pub above_1: u64,
    /// Pixels of which a colour is more than eight levels off.
    pub above_8: u64,
    /// The furthest that any colour is off.
    pub levels_max: u8,
}

/// The limits of a difference between two pictures.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    pub identical_share_min: f64,
    pub within_1_share_min: f64,
    pub above_8_ppm_max: f64,
}

/// Every byte is the same: twins, and the scissor oracle.
pub const IDENTICAL: Policy =
    Policy { identical_share_min: 1.0, within_1_share_min: 1.0, above_8_ppm_max: 0.0 };

/// Tiles against the one-channel picture on one driver: about ten times what was measured for a
/// shared matrix with shifted viewports (0.31 %, 4 ppm and 3 ppm), and a tenth of what an odd
/// tile origin gives (4 %, 480 ppm).
pub const SEAMS: Policy =
    Policy { identical_share_min: 0.995, within_1_share_min: 0.9999, above_8_ppm_max: 20.0 };

impl Difference {
    /// Between two pictures of the same size.
    pub fn of(actual: &RgbaImage, expected: &RgbaImage) -> Self {
        assert_eq!(actual.dimensions(), expected.dimensions(), "pictures of other sizes");
        let mut sum = Self::default();
        for (a, b) in actual.pixels().zip(expected.pixels()) {
            let levels = a.0.iter().zip(b.0).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0);
            sum.pixels += 1;
            sum.differing += u64::from(levels > 0);
            sum.above_1 += u64::from(levels > 1);
            sum.above_8 += u64::from(levels > 8);
            sum.levels_max = sum.levels_max.max(levels);
        }
        sum
    }

    fn share(&self, count: u64) -> f64 {
        count as f64 / self.pixels.max(1) as f64
    }

    /// Returns whether the difference keeps this policy.
    pub fn holds(&self, policy: &Policy) -> bool {
        1.0 - self.share(self.differing) >= policy.identical_share_min
            && 1.0 - self.share(self.above_1) >= policy.within_1_share_min
            && self.share(self.above_8) * 1e6 <= policy.above_8_ppm_max
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.3} % differ, {:.1} ppm by more than 1 level, {:.1} ppm by more than 8, at most {}",
            self.share(self.differing) * 100.0,
            self.share(self.above_1) * 1e6,
            self.share(self.above_8) * 1e6,
            self.levels_max
        )
    }
}

/// A picture of a capture as an image.
pub fn image_of(picture: &Image) -> RgbaImage {
    let image = RgbaImage::from_raw(picture.width, picture.height, picture.rgba.clone());
    image.expect("as many bytes as pixels")
}

/// A PNG file as an image.
pub fn read(path: &Path) -> RgbaImage {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    image.into_rgba8()
}

/// Compares two pictures; where they are too far apart, leaves both and their difference in a
/// folder that the message names.
#[track_caller]
pub fn check(name: &str, actual: &RgbaImage, expected: &RgbaImage, policy: &Policy) -> Difference {
    let difference = Difference::of(actual, expected);
    if !difference.holds(policy) {
        let folder = write(name, actual, expected);
        panic!("{name}: {difference}, where {policy:?}; see {}", folder.display());
    }
    difference
}

/// Returns the number of colours: a scene has hundreds, an empty picture one.
pub fn color_count(image: &RgbaImage) -> usize {
    image.pixels().map(|pixel| pixel.0).collect::<std::collections::BTreeSet<_>>().len()
}

fn write(name: &str, actual: &RgbaImage, expected: &RgbaImage) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures").join(name);
    std::fs::create_dir_all(&folder).expect("a folder for pictures");
    let difference = RgbaImage::from_fn(actual.width(), actual.height(), |x, y| {
        let (a, b) = (actual.get_pixel(x, y).0, expected.get_pixel(x, y).0);
        // One level must be seen.
        let [r, g, b, _] = std::array::from_fn(|i| a[i].abs_diff(b[i]).saturating_mul(16));
        Rgba([r, g, b, 255])
    });
    let pictures = [("actual", actual), ("expected", expected), ("difference", &difference)];
    for (what, picture) in pictures {
        picture.save(folder.join(format!("{what}.png"))).expect("a picture is written");
    }
    folder
}
