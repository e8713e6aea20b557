//! One channel as a source of light: what it lights, and how its light fades towards its edges.

use std::sync::OnceLock;

use glam::{DVec2, DVec3};

use super::super::channel_mapping::ChannelMapping;
use super::super::lit_area::LitArea;
use super::super::wall_geometry::ResolvedWall;
use super::super::{Channel, ChannelCalibration, ChannelKind, Eye, StereoPacking, Surface};
use super::BlendWeight;
use crate::ChannelId;
use crate::limits::LEAK_MAX;

/// A ray of a projector that ends within this of a point has lit it, in shares of the distance.
const HIT_SHARE: f64 = 1e-6;

/// Places across and down at which the reach of a picture is looked at.
const REACH_STEPS: u32 = 8;

/// A place of the wall, with what several lamps would compute of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    /// In pixels of the canvas.
    canvas: DVec2,
    /// In metres of display space, where the screen's shape is known.
    point: Option<DVec3>,
}

/// The smoothness of the mapping of a channel's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Smoothness {
    /// Kinks at the edges of a mesh's triangles.
    Faceted,
    /// Steady in value and slope.
    Bent,
    /// Without kinks of any order.
    Smooth,
}

/// A channel as a source of light.
#[derive(Clone, Debug)]
pub(crate) struct BlendChannel<'a> {
    pub channel: &'a Channel,
    map: Option<ChannelMapping<'a>>,
    pub size: DVec2,
    /// The lit area of its picture, if a file may leave some of it dark.
    pub outline: Option<&'a LitArea>,
    /// Its black level, in light of the wall. A display with the colours C and the black level b
    /// shows C⁻¹·(b + (1 − b)·light): C makes its light that of the others.
    pub leak: DVec3,
    /// `true` if its own files share its light with others.
    is_blended_by_file: bool,
    /// A ball around all that it lights, in metres of display space; `None` where no one knows.
    reach: Option<(DVec3, f64)>,
    /// Those that may light what it lights.
    pub neighbours: Vec<ChannelId>,
    /// The widths of its ramps; computed on first use.
    pub widths: OnceLock<[Option<f64>; 4]>,
}

impl<'a> BlendChannel<'a> {
    pub fn new(of: impl Into<ResolvedWall<'a>>, channel: &'a Channel) -> Self {
        let ResolvedWall { wall, shapes } = of.into();
        let map = ChannelMapping::with_geometry(channel, wall.screen_of(channel), shapes);
        let map = map.filter(ChannelMapping::is_resolved);
        let size = channel.size.as_dvec2();
        let mut lamp = Self {
            channel,
            outline: shapes.lit_area_of(channel),
            leak: leak(channel, wall.leak_of(channel)),
            is_blended_by_file: shapes.is_blended_by_file(channel),
            map,
            size,
            reach: None,
            neighbours: Vec::new(),
            widths: OnceLock::new(),
        };
        lamp.reach = lamp.find_reach();
        lamp
    }

    /// Its share of a place that no other one lights.
    pub fn alone(&self) -> BlendWeight {
        BlendWeight { weight: 1.0, black: self.leak }
    }

    /// Returns whether the other channel is on the same screen, and some eye sees both.
    pub fn shares_screen(&self, other: &Self) -> bool {
        let (own, others) = (self.eye(), other.eye());
        let is_seen = own == others || own == Eye::Center || others == Eye::Center;
        is_seen && self.channel.screen == other.channel.screen
    }

    /// Returns the eye that it is for.
    pub fn eye(&self) -> Eye {
        match self.channel.adjustment {
            ChannelCalibration { packing: StereoPacking::None, eye, .. } => eye,
            _ => Eye::Center,
        }
    }

    /// Returns whether both may light one place, of which the weights share the light.
    pub fn may_overlap(&self, other: &Self) -> bool {
        !self.is_blended_by_file && !other.is_blended_by_file && self.may_light_same(other)
    }

    /// Returns whether both may light one place, whatever shares the light. Exact if both are tiles
    /// without a correction of their form.
    pub fn may_light_same(&self, other: &Self) -> bool {
        if !self.shares_screen(other) || self.map.is_none() || other.map.is_none() {
            return false;
        }
        if self.is_plain_tile() && other.is_plain_tile() {
            let (a, b) = (self.channel.origin.as_dvec2(), other.channel.origin.as_dvec2());
            return a.cmplt(b + other.size).all() && b.cmplt(a + self.size).all();
        }
        match (self.reach, other.reach) {
            (Some((a, near)), Some((b, far))) => a.distance(b) <= near + far,
            _ => true,
        }
    }

    /// Returns whether its pixels are the canvas's, from its origin.
    pub fn is_plain_tile(&self) -> bool {
        let adjustment = &self.channel.adjustment;
        let is_formed = adjustment.pin != [DVec2::ZERO; 4] || adjustment.bend.is_some();
        self.channel.cover == ChannelKind::Tile && !is_formed
    }

    /// The size of its screen's canvas, in pixels; zero where the places of its own are not known.
    pub fn canvas_size(&self) -> DVec2 {
        self.map.as_ref().map_or(DVec2::ZERO, |map| map.screen().screen.canvas.as_dvec2())
    }

    /// Returns whether the places of its pixels are known.
    pub fn is_known(&self) -> bool {
        self.map.is_some()
    }

    /// Returns the place on the canvas of a place of the picture.
    pub fn canvas(&self, pixel: DVec2) -> Option<DVec2> {
        self.map.as_ref()?.canvas_from_pixel(pixel)
    }

    /// Returns the place on the canvas of a place that a walk along the edges gives: if a file
    /// places the picture, that place is before pins and bends.
    pub fn canvas_from_edge(&self, place: DVec2) -> Option<DVec2> {
        match (&self.map, self.outline) {
            (Some(map), Some(_)) => self.canvas(map.pixel_from_ideal(place)?),
            _ => self.canvas(place),
        }
    }

    /// The spot that a place of the picture lights.
    pub fn spot(&self, pixel: DVec2) -> Option<Spot> {
        self.spot_on(self.canvas(pixel)?)
    }

    /// The spot at a place of the canvas of its screen; the same for all channels of the screen.
    pub fn spot_on(&self, canvas: DVec2) -> Option<Spot> {
        Some(Spot { canvas, point: self.map.as_ref()?.screen().display_from_canvas(canvas) })
    }

    /// The place of its picture, or of the plane beside it, that lights a spot.
    pub fn pixel_of(&self, spot: &Spot) -> Option<DVec2> {
        let pixel = self.map.as_ref()?.pixel_at(spot.canvas, spot.point)?;
        self.faces(spot.point).then_some(pixel)
    }

    /// The place of its picture, or of the plane beside it, that lights a place of the canvas.
    pub fn pixel(&self, canvas: DVec2) -> Option<DVec2> {
        if self.channel.cover == ChannelKind::Tile {
            // It needs no point, which takes a ray where the screen is a mesh.
            return self.map.as_ref()?.pixel_from_canvas(canvas);
        }
        self.pixel_of(&self.spot_on(canvas)?)
    }

    /// The place of its picture that lights a place of the canvas.
    pub fn lit_pixel(&self, canvas: DVec2) -> Option<DVec2> {
        if self.channel.cover == ChannelKind::Tile {
            return self.pixel(canvas).filter(|pixel| self.contains(*pixel));
        }
        self.lit_pixel_of(&self.spot_on(canvas)?)
    }

    /// The place of its picture that lights a spot.
    pub fn lit_pixel_of(&self, spot: &Spot) -> Option<DVec2> {
        // What lies beside the picture needs no ray that says what stands before it.
        let pixel = self.map.as_ref()?.pixel_at(spot.canvas, spot.point)?;
        (self.contains(pixel) && self.faces(spot.point)).then_some(pixel)
    }

    /// Metres from a projector's lens along its axis to a spot; below zero behind it.
    pub fn depth(&self, spot: &Spot) -> Option<f64> {
        let ChannelKind::Projector(projector) = &self.channel.cover else { return None };
        Some((projector.rotation.inverse() * (spot.point? - projector.position)).dot(DVec3::NEG_Z))
    }

    /// Returns the smoothness of its mapping.
    pub fn smoothness(&self) -> Smoothness {
        match &self.map {
            Some(map) if map.is_faceted() => Smoothness::Faceted,
            Some(_) if self.channel.adjustment.bend.is_some() => Smoothness::Bent,
            _ => Smoothness::Smooth,
        }
    }

    /// Returns whether a place lies in its picture.
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(self.size).all()
    }

    /// Returns whether nothing of a curved screen stands between its projector and a place.
    fn faces(&self, point: Option<DVec3>) -> bool {
        let (ChannelKind::Projector(projector), Some(map)) = (&self.channel.cover, &self.map)
        else {
            return true;
        };
        let ground = map.screen();
        if matches!(ground.screen.surface, Surface::Plane(_)) {
            return true;
        }
        let Some(point) = point else { return false };
        let ray = point - projector.position;
        let hit = map.point_along(ray);
        hit.is_some_and(|hit| hit.distance(point) <= HIT_SHARE * ray.length())
    }

    fn find_reach(&self) -> Option<(DVec3, f64)> {
        // A warp's points may lie before or behind those of the screen that they show.
        let is_on_screen = self.channel.cover != ChannelKind::Map;
        let map = self.map.as_ref().filter(|_| is_on_screen)?;
        if self.is_plain_tile() && map.screen().is_mesh() {
            // What of a tile a mesh has may lie between the places looked at.
            return None;
        }
        let places = (0..=REACH_STEPS).flat_map(|y| (0..=REACH_STEPS).map(move |x| (x, y)));
        let place = |(x, y)| DVec2::new(f64::from(x), f64::from(y)) / f64::from(REACH_STEPS);
        let lit: Vec<DVec3> =
            places.filter_map(|at| map.display_from_pixel(place(at) * self.size)).collect();
        // Where most of them miss the screen, little is known of what lies between the others.
        if 2 * lit.len() < (REACH_STEPS as usize + 1).pow(2) {
            return None;
        }
        let middle = lit.iter().sum::<DVec3>() / lit.len() as f64;
        let radius = lit.iter().map(|point| point.distance(middle)).fold(0.0, f64::max);
        // What lies between the places looked at bulges by less than the steps between them.
        Some((middle, radius * (1.0 + 4.0 / f64::from(REACH_STEPS))))
    }

    /// Returns the product of the ramps from its edges at a place of its picture, from 0 to 1.
    pub fn ramp(&self, pixel: DVec2, widths: [Option<f64>; 4]) -> f64 {
        let edges = self.distances(pixel).into_iter().zip(widths);
        edges.map(|(distance, width)| ramp(distance, width)).product()
    }

    /// By what share of it that step may change within a pixel.
    pub fn ramp_slope(&self, pixel: DVec2, widths: [Option<f64>; 4]) -> f64 {
        let edges = self.distances(pixel).into_iter().zip(widths);
        edges.map(|(distance, width)| ramp_slope(distance, width)).sum()
    }

    /// From the left, right, upper and lower edge of what is lit of it.
    fn distances(&self, pixel: DVec2) -> [f64; 4] {
        if let (Some(outline), Some(map)) = (self.outline, &self.map) {
            return map.ideal_from_pixel(pixel).map_or([0.0; 4], |meant| outline.distances(meant));
        }
        let from_end = self.size - pixel;
        [pixel.x, from_end.x, pixel.y, from_end.y]
    }
}

/// Returns a channel's black level in light of the wall; as it is if its colours cannot be
/// inverted, or only with numbers that are no black.
fn leak(channel: &Channel, own: DVec3) -> DVec3 {
    if own == DVec3::ZERO {
        return own;
    }
    let black = channel.adjustment.color.made().inverse() * own;
    // All others are lifted to the black of one channel: a gain of almost 0, or a matrix that
    // almost loses a colour, would lift the whole wall to grey or white. A little below 0 is the
    // light of a black with more colour than the wall's primaries make.
    let least = DVec3::splat(-own.max_element());
    let is_black = black.cmpge(least).all() && black.cmple(DVec3::splat(LEAK_MAX)).all();
    if is_black { black } else { own }
}

/// The slope of [`ramp`] as a share of it, for each pixel: 2/distance next to the edge. Nearer
/// than a hundredth of a pixel as there.
fn ramp_slope(distance: f64, width: Option<f64>) -> f64 {
    match width {
        Some(width) if distance < width => {
            let t = (distance.max(0.01) / width).min(1.0);
            6.0 * (1.0 - t) / (t * (3.0 - 2.0 * t) * width)
        }
        _ => 0.0,
    }
}

/// 0 at an edge, 1 from `width` on, and level at both ends; without a width, no edge.
fn ramp(distance: f64, width: Option<f64>) -> f64 {
    match width {
        Some(width) if distance < width => {
            let t = (distance / width).max(0.0);
            t * t * (3.0 - 2.0 * t)
        }
        _ => 1.0,
    }
}

/// The weight of a channel with this step among others at the same place. Where all are on their
/// edges, the first one has the place: `is_later` says that this one is not it.
pub(super) fn weight(
    own: f64,
    others: impl Iterator<Item = f64> + Clone,
    is_later: bool,
    exponent: f64,
) -> f64 {
    // Relative to the largest, so that no exponent makes all of them vanish.
    let most = others.clone().fold(own, f64::max);
    if most == 0.0 {
        return if is_later { 0.0 } else { 1.0 };
    }
    let ramp = |step: f64| {
        let share = step / most;
        if exponent == 1.0 { share } else { share.powf(exponent) }
    };
    let own = ramp(own);
    own / (own + others.map(ramp).sum::<f64>())
}
