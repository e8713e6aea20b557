//! Weights of channels at places where channels of one eye meet channels of both.
//!
//! Each eye must see weights that add up to 1, and what is for both eyes is seen by each with one
//! weight. So the channels of both are given theirs first, as much as the eye that needs it more
//! asks for, and each eye's own channels share what is left:
//!
//! ```text
//! w_e    weights as if eye e alone were there, among its own channels and those of both
//! W      max(W_left, W_right), W_e = Σ w_e over the channels of both
//! both   W · (w_left + w_right) / (W_left + W_right)
//! own    w_e · (1 − W) / (1 − W_e)
//! ```
//!
//! If both groups are alike, the weight is w_e; where only the channels of both reach, they have
//! all of the light. Black is raised alike: the channels of both add what the eye that sees more of
//! it needs, and the other eye's own channels add the rest.

use glam::DVec3;

use super::BlendWeight;
use super::blend_channel::{self, BlendChannel};
use crate::Eye;

/// A channel that lights a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct EyeContribution {
    /// The eye that sees it.
    pub eye: Eye,
    /// The ramp, from [`BlendChannel::ramp`]; `None` if it lights only another part of the queried
    /// pixel.
    pub step: Option<f64>,
    /// `true` if it comes before the queried channel.
    pub is_before: bool,
    /// The part of the pixel that it lights: 0 to 1.
    pub part: f64,
    /// Its black level, from [`BlendChannel::leak`].
    pub leak: DVec3,
}

impl EyeContribution {
    /// Returns the contribution of a channel that lights all of a pixel and is not before the
    /// queried one.
    pub fn full_pixel(lamp: &BlendChannel<'_>, step: f64) -> Self {
        let (eye, leak) = (lamp.eye(), lamp.leak);
        Self { eye, step: Some(step), is_before: false, part: 1.0, leak }
    }

    fn black(&self) -> DVec3 {
        self.leak * self.part
    }

    fn is_seen_by(&self, eye: Eye) -> bool {
        self.eye == Eye::Center || self.eye == eye
    }
}

/// The share of a channel among others that light the same pixel.
pub(super) fn blend_weight(
    own: EyeContribution,
    others: &[EyeContribution],
    exponent: f64,
) -> BlendWeight {
    let is_for_both = own.eye == Eye::Center;
    let lit = || others.iter().filter(|other| other.step.is_some());
    let has = |is: fn(&EyeContribution) -> bool| is(&own) || lit().any(is);
    let is_mixed = has(|light| light.eye == Eye::Center) && has(|light| light.eye != Eye::Center);
    if !is_mixed {
        let is_seen = |other: &&EyeContribution| is_for_both || other.is_seen_by(own.eye);
        let is_later = lit().filter(is_seen).any(|other| other.is_before);
        let steps = lit().filter(is_seen).filter_map(|other| other.step);
        let weight = blend_channel::weight(own.step.unwrap_or(0.0), steps, is_later, exponent);
        let black = others.iter().filter(is_seen).map(EyeContribution::black);
        return BlendWeight { weight, black: own.black() + black.sum::<DVec3>() };
    }
    let all: Vec<EyeContribution> = std::iter::once(own).chain(others.iter().copied()).collect();
    let [left, right] = [Eye::Left, Eye::Right].map(|eye| Group::new(&all, eye, exponent));
    let most = left.both.max(right.both);
    if is_for_both {
        let (sum, parts) = (left.both + right.both, left.own + right.own);
        let weight = if sum > 0.0 { most * parts / sum } else { 0.0 };
        return BlendWeight { weight, black: left.black.max(right.black) };
    }
    let group = if own.eye == Eye::Left { left } else { right };
    let rest = 1.0 - group.both;
    if most >= 1.0 || rest <= 0.0 {
        return BlendWeight { weight: 0.0, black: group.black };
    }
    let black = (group.black - most * left.black.max(right.black)) / (1.0 - most);
    BlendWeight { weight: group.own * (1.0 - most) / rest, black }
}

/// The weights and the black that one eye sees at a place.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// The weight of the channel that is asked about, as if this eye alone were there.
    own: f64,
    /// The weights of the channels of both eyes together.
    both: f64,
    /// The sum of the black levels of the channels that it sees.
    black: DVec3,
}

impl Group {
    fn new(all: &[EyeContribution], eye: Eye, exponent: f64) -> Self {
        let seen = all.iter().enumerate().filter(|(_, light)| light.is_seen_by(eye));
        let black = seen.clone().map(|(_, light)| light.black()).sum();
        let lit: Vec<(usize, f64)> = seen.filter_map(|(at, one)| Some((at, one.step?))).collect();
        // The order of channels is that of the wall: before the first one stand those that are so.
        let rank = |at: usize| (!all[at].is_before, at);
        let weight = |(at, step): (usize, f64)| {
            let others = lit.iter().filter(|(other, _)| *other != at);
            let is_later = others.clone().any(|(other, _)| rank(*other) < rank(at));
            blend_channel::weight(step, others.map(|(_, step)| *step), is_later, exponent)
        };
        let of_both = lit.iter().filter(|(at, _)| all[*at].eye == Eye::Center);
        let own = lit.first().filter(|(at, _)| *at == 0);
        Self {
            own: own.map_or(0.0, |own| weight(*own)),
            both: of_both.map(|one| weight(*one)).sum(),
            black,
        }
    }
}
