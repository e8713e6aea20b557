//! Pictures that stand for images that are missing or cannot be read.
//!
//! A surface without its colours shows a checker of two greys. All other textures become neutral,
//! so that lighting stays as it would be without them.

use std::collections::BTreeSet;

use glam::Vec3;
use polyptych_scene::{MaterialExtensions, MaterialProperty, PropertyKind, Scene, TextureRef};

use super::material::TextureKind;
use super::mip::Rgba8Image;

/// Pixels of the placeholder's sides, and of the sides of its squares.
const SIDE: u32 = 64;
const SQUARE: u32 = 8;

/// The greys of the checker, as sRGB: 18 % and 50 % of the light.
const DARK: u8 = 118;
const LIGHT: u8 = 188;

/// The picture that stands for an image of this content.
pub(super) fn picture(content: TextureKind) -> Rgba8Image {
    let pixel = |x: u32, y: u32| match content {
        TextureKind::Color | TextureKind::ColorAlpha | TextureKind::ColorMask(_) => {
            let grey = if (x / SQUARE + y / SQUARE).is_multiple_of(2) { LIGHT } else { DARK };
            [grey, grey, grey, 255]
        }
        // No occlusion, as rough as the factor says, no metal.
        TextureKind::Data | TextureKind::Glossiness(_) => [255, 255, 0, 255],
        TextureKind::Tint => [255; 4],
        TextureKind::Normal => [128, 128, 255, 255],
    };
    let rows = (0..SIDE).flat_map(|y| (0..SIDE).flat_map(move |x| pixel(x, y)));
    Rgba8Image { width: SIDE, height: SIDE, rgba: rows.collect() }
}

/// Takes the emission from materials whose emissive texture is one of these placeholders, and
/// baked light likewise: a surface that glows all over would be worse than one that does not. Clips
/// change the emission of other materials only.
pub(super) fn darken(scene: &mut Scene, placeholders: &BTreeSet<u32>) {
    let is_one =
        |used: Option<TextureRef>| used.is_some_and(|of| placeholders.contains(&of.texture));
    let mut darkened = BTreeSet::new();
    for (index, material) in (0_u32..).zip(&mut scene.materials) {
        if is_one(material.emissive_texture) {
            material.emissive = Vec3::ZERO;
            material.emissive_texture = None;
            darkened.insert(index);
        }
        if let Some(of) = &mut material.extensions {
            of.baked_light = of.baked_light.take().filter(|of| !is_one(of.texture));
        }
        if material.extensions.as_deref() == Some(&MaterialExtensions::default()) {
            material.extensions = None;
        }
    }
    for property in &mut scene.animations.properties {
        if let PropertyKind::Material(
            MaterialProperty::EmissiveColor | MaterialProperty::EmissiveStrength,
        ) = property.kind
        {
            // Channels name it by its place, so it stays even without a target.
            property.targets.retain(|material| !darkened.contains(material));
        }
    }
}
