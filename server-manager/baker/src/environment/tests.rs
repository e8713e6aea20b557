//! Prepared surroundings against integrals that were computed otherwise.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec3};
use polyptych_scene::EnvironmentMap;
use polyptych_scene::environment_map::HARMONICS;
use tempfile::TempDir;

use super::cube_light::CubeLight;
use super::cube_map::{CubeMap, through};
use super::equirect::Equirect;
use super::*;

/// A dim gradient with a bright, soft spot that has a colour.
fn surroundings(width: u32) -> Equirect {
    let spot = DVec3::new(0.6, 0.5, -0.62).normalize();
    Equirect::of(width, |from| {
        let bright = (8.0 * (from.dot(spot) - 1.0)).exp();
        let dim = DVec3::new(0.3, 0.4, 0.6) * (0.6 + 0.4 * from.y);
        (dim + DVec3::new(4.0, 3.0, 2.0) * bright).as_vec3()
    })
}

fn directions() -> impl Iterator<Item = DVec3> {
    // A spiral over the sphere.
    (0..60).map(|index| {
        let y = 1.0 - (f64::from(index) + 0.5) / 30.0;
        let around = f64::from(index) * 2.399_963;
        let level = (1.0 - y * y).sqrt();
        DVec3::new(level * around.cos(), y, level * around.sin())
    })
}

/// The mean over all pixels by solid angle and a weight of the direction.
fn mean(picture: &Equirect, weight: impl Fn(DVec3) -> f64) -> (DVec3, f64) {
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (index as u32 % picture.width, index as u32 / picture.width);
        let v = (f64::from(y) + 0.5) / height;
        let from = Equirect::direction((f64::from(x) + 0.5) / width, v);
        let solid_angle = (v * PI).sin() * PI / height * 2.0 * PI / width;
        let weight = weight(from) * solid_angle;
        sum += pixel.as_dvec3() * weight;
        whole += weight;
    }
    (sum, whole)
}

fn evaluate(terms: &[DVec3; 9], n: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = n;
    let polynomials = [1.0, y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y];
    terms.iter().zip(polynomials).map(|(term, polynomial)| *term * polynomial).sum()
}

#[test]
fn diffuse_light_is_the_cosine_weighted_integral() {
    let picture = surroundings(256);
    let terms = irradiance::diffuse(&picture);
    let (mut worst, mut largest) = (0f64, 0f64);
    for n in directions() {
        let expected = mean(&picture, |from| from.dot(n).max(0.0)).0 / PI;
        worst = worst.max((evaluate(&terms, n) - expected).abs().max_element());
        largest = largest.max(expected.max_element());
    }
    // The fourth order, which is left out, has an eighth of the cosine's second one.
    assert!(worst < 0.02 * largest, "{worst} of {largest}");
    println!("diffuse: {worst:.4} of {largest:.4}");
}

#[test]
fn rough_reflections_are_the_integral_over_ggx() {
    let picture = surroundings(256);
    let side = 64;
    let cube = CubeMap::of(&picture, side);
    let count = EnvironmentMap::levels_of(side);
    for (level, texels) in prefilter::levels(&cube, count).into_iter().enumerate().skip(1) {
        let roughness = level as f64 / f64::from(count - 1);
        let alpha_squared = roughness.powi(4);
        let filtered = CubeMap::of_texels(side >> level, texels);
        let (mut worst, mut largest) = (0f64, 0f64);
        for n in directions() {
            // Brute force: every pixel of the picture, by D of the half vector and the cosine.
            let (sum, whole) = mean(&picture, |from| {
                let h = (from + n).normalize_or(n).dot(n);
                let f = h * h * (alpha_squared - 1.0) + 1.0;
                // The density of l is D n·h / (4 v·h), and n·h and v·h are the same.
                alpha_squared / (f * f) * from.dot(n).max(0.0)
            });
            let expected = sum / whole;
            let got = filtered.radiance(n, 0.0).as_dvec3();
            worst = worst.max((got - expected).abs().max_element());
            largest = largest.max(expected.max_element());
        }
        // The roughest level has 4 × 4 texels for each face, and is read between them.
        assert!(worst < 0.04 * largest, "roughness {roughness}: {worst} of {largest}");
        println!("roughness {roughness}: {worst:.4} of {largest:.4}");
    }
}

#[test]
fn uniform_surroundings_are_uniform_at_every_roughness() {
    let uniform = Vec3::new(0.25, 0.5, 1.0);
    let picture = Equirect::checked(256, 128, vec![uniform; 256 * 128]).expect("radiance");
    let map = environment_map(&picture, &AtomicBool::new(false)).expect("a map");
    for (term, of) in map.diffuse.iter().enumerate() {
        let expected = if term == 0 { uniform } else { Vec3::ZERO };
        assert!((Vec3::from(*of) - expected).abs().max_element() < 1e-4, "{term}: {of:?}");
    }
    let expected = texel(uniform);
    assert!(map.texels.chunks_exact(8).all(|got| got == expected));
    assert_eq!(EnvironmentMap::decode(&map.encode()), Ok(map));
}

#[test]
fn halves_are_the_nearest() {
    let known = [(1.0, 0x3c00), (0.25, 0x3400), (1.0 / 3.0, 0x3555), (60000.0, 0x7b53)];
    for (number, bits) in known {
        assert_eq!(half(number), bits, "{number}");
    }
    assert_eq!((half(1e9), half(0.0), half(6e-8)), (half(RADIANCE_MAX), 0, 1));
}

/// A place of a face as `EXT_lights_image_based` has it: as it is seen from inside, where right is
/// ahead × up.
fn of_text(face: usize, right: f64, down: f64) -> DVec3 {
    let ahead = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z][face];
    let up = [DVec3::Y, DVec3::Y, DVec3::NEG_Z, DVec3::Z, DVec3::Y, DVec3::Y][face];
    ahead + ahead.cross(up) * right - up * down
}

/// A place of a face as Babylon.js has it in a right-handed scene: z is looked up as −z.
fn of_babylon(face: usize, right: f64, down: f64) -> DVec3 {
    through(face, right, down) * DVec3::new(1.0, 1.0, -1.0)
}

/// A light whose faces have the radiance of a picture in the directions of their places.
fn cube_light(picture: &Equirect, place: impl Fn(usize, f64, f64) -> DVec3) -> CubeLight {
    let side = 64;
    let at = |index: usize| (2.0 * index as f64 + 1.0) / f64::from(side) - 1.0;
    let count = (side * side) as usize;
    let texel = |index: usize| {
        let (face, of) = (index / count, index % count);
        let place = place(face, at(of % side as usize), at(of / side as usize));
        picture.radiance(place.normalize())
    };
    let texels = (0..6 * count).map(texel).collect();
    CubeLight { side, texels, irradiance: None, rotation: DQuat::IDENTITY, intensity: 1.0 }
}

/// The largest level of a map as radiance by direction.
fn largest_level(map: &EnvironmentMap) -> Vec<(DVec3, Vec3)> {
    let side = map.side as usize;
    let at = |index: usize| (2.0 * index as f64 + 1.0) / side as f64 - 1.0;
    let texel = |(index, of): (usize, [f32; 3])| {
        let (face, place) = (index / (side * side), index % (side * side));
        let from = through(face, at(place % side), at(place / side)).normalize();
        (from, Vec3::from(of))
    };
    map.radiance().take(6 * side * side).enumerate().map(texel).collect()
}

#[test]
fn lights_of_files_are_found_in_both_orders_of_faces_and_turned() {
    let picture = surroundings(512);
    let never = AtomicBool::new(false);
    let turn = DQuat::from_axis_angle(DVec3::new(0.2, 0.9, -0.3).normalize(), 1.1);
    for (is_babylon, rotation) in
        [(false, DQuat::IDENTITY), (true, DQuat::IDENTITY), (false, turn), (true, turn)]
    {
        let place = if is_babylon { of_babylon } else { of_text };
        let light = CubeLight { rotation, intensity: 2.0, ..cube_light(&picture, place) };
        let map = light.map(&never).expect("a map");
        // Where nothing is turned, texels are those of the faces, but for what halves cannot hold.
        let bound = if rotation == DQuat::IDENTITY { 2e-3 } else { 2e-2 };
        for (from, got) in largest_level(&map) {
            let expected = picture.radiance(rotation.inverse() * from) * 2.0;
            let off = (got - expected).abs().max_element();
            assert!(off < bound * expected.max_element(), "{from}: {got}, not {expected}");
        }
        // The same light by its irradiance, in the axes of the faces.
        let lambert = irradiance::diffuse(&picture);
        let terms = std::array::from_fn(|term| {
            let is_mirrored = is_babylon && matches!(term, 2 | 5 | 7);
            lambert[term] / HARMONICS[term] * if is_mirrored { -PI } else { PI }
        });
        let said = CubeLight { irradiance: Some(terms), ..light }.map(&never).expect("a map");
        for n in directions() {
            let of = |map: &EnvironmentMap| {
                evaluate(&map.diffuse.map(|term| Vec3::from(term).as_dvec3()), n)
            };
            let expected = evaluate(&lambert, rotation.inverse() * n) * 2.0;
            let [computed, said] = [&map, &said].map(of);
            assert!(
                (said - expected).length() < 1e-5 * expected.length(),
                "{said}, not {expected}"
            );
            let off = (computed - expected).length();
            assert!(off < 0.01 * expected.length(), "{computed}, not {expected}");
        }
    }
}

/// A Radiance file without compression.
fn hdr(width: u32, height: u32, rgbe: [u8; 4]) -> Vec<u8> {
    let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n");
    let pixels = rgbe.repeat((width * height) as usize);
    [head.as_bytes(), &pixels].concat()
}

#[test]
fn files_by_the_name_of_rgbe_are_read_as_those_of_radiance() {
    let file = hdr(8, 4, [128, 64, 32, 129]);
    let renamed = [&b"#?RGBE"[..], &file["#?RADIANCE".len()..]].concat();
    let expected = Equirect::decode(&file).expect("a picture");
    assert_eq!(Equirect::decode(&renamed).expect("a picture"), expected);
}

#[test]
fn a_file_is_baked_once_and_the_same_bytes_have_the_same_blob() {
    let folder = TempDir::new().expect("a folder");
    let store = BakeCache::open(folder.path().join("store")).expect("a store");
    let path = folder.path().join("grey.hdr");
    std::fs::write(&path, hdr(8, 4, [128, 128, 128, 129])).expect("written");
    let bake = || {
        let source = EnvironmentSource::File(&path);
        bake_environment(source, &store, &AtomicBool::new(false)).expect("baked")
    };
    let (first, second) = (bake(), bake());
    assert_eq!((first.blob, first.warning.as_ref()), (second.blob, None));
    let bytes = store.blobs().read(first.blob).expect("read").expect("there");
    let map = EnvironmentMap::decode(&bytes).expect("a map");
    // 128 at an exponent of 129 is 1, or half a step more, as readers have it.
    assert!((map.diffuse[0][0] - 1.0).abs() < 0.01, "{:?}", map.diffuse[0]);
    assert!(map.has_sun, "a picture has all light");
    let sky = EnvironmentSource::Sky { sun: default_sun() };
    let sky = bake_environment(sky, &store, &AtomicBool::new(false)).expect("baked");
    assert_eq!(sky.what, "clear sky with the sun 49° high");
    let bytes = store.blobs().read(sky.blob).expect("read").expect("there");
    assert!(!EnvironmentMap::decode(&bytes).expect("a map").has_sun, "a light of the scene is it");
}

#[test]
fn what_is_no_environment_is_refused_by_name() {
    let whole = hdr(64, 32, [90, 80, 70, 128]);
    let with_size =
        |size: &str| format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n").into_bytes();
    let cases: [(&[u8], &str); 7] = [
        (&whole[..whole.len() - 100], "cannot be read"),
        (&whole[..20], "cannot be read"),
        (b"\x89PNG\r\n", "not a Radiance .hdr"),
        (b"", "not a Radiance .hdr"),
        (&with_size("-Y 100000 +X 200000"), "200000 × 100000"),
        (&with_size("-Y 4294967295 +X 4294967295"), "too large"),
        (&hdr(32, 32, [1, 1, 1, 128]), "not equirectangular"),
    ];
    let folder = TempDir::new().expect("a folder");
    let store = BakeCache::open(folder.path().join("store")).expect("a store");
    for (at, (bytes, part)) in cases.into_iter().enumerate() {
        let path = folder.path().join(format!("case-{at}.hdr"));
        std::fs::write(&path, bytes).expect("written");
        let source = EnvironmentSource::File(&path);
        let refused = bake_environment(source, &store, &AtomicBool::new(false));
        let reason = refused.expect_err(part).to_string();
        assert!(reason.contains(part) && reason.contains(&format!("case-{at}.hdr")), "{reason}");
    }
}

#[test]
fn numbers_that_are_no_radiance_are_refused_with_their_pixel() {
    for wrong in [f32::NAN, f32::INFINITY, -0.5] {
        let mut pixels = vec![Vec3::ONE; 32];
        pixels[13].y = wrong;
        let reason = Equirect::checked(8, 4, pixels).expect_err("refused").to_string();
        assert!(reason.contains("pixel 5, 1") && reason.contains("finite"), "{reason}");
    }
}

#[test]
fn a_sun_that_texels_cannot_hold_is_noted_and_still_lights() {
    let folder = TempDir::new().expect("a folder");
    let store = BakeCache::open(folder.path().join("store")).expect("a store");
    let path = folder.path().join("sun.hdr");
    let mut bytes = hdr(8, 4, [0, 0, 0, 0]);
    let at = bytes.len() - 4 * (8 * 4 - 11);
    bytes[at..at + 4].copy_from_slice(&[200, 200, 200, 150]);
    std::fs::write(&path, bytes).expect("written");
    let source = EnvironmentSource::File(&path);
    let baked = bake_environment(source, &store, &AtomicBool::new(false)).expect("baked");
    assert!(baked.warning.is_some_and(|warning| warning.contains("60000")));
    let bytes = store.blobs().read(baked.blob).expect("read").expect("there");
    let map = EnvironmentMap::decode(&bytes).expect("finite");
    assert!(map.diffuse[0][0] > 60000.0, "{:?}", map.diffuse[0]);
}
