//! A tour as a JSON file.

use anyhow::{Context, bail};
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, Easing, StoredView, Tour, TourStop};
use serde::Deserialize;
use serde_json::{Value, json};

use super::super::node::rotation;
use super::super::stored_view;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TourText {
    #[serde(default)]
    r#loop: bool,
    stops: Vec<Value>,
}

/// A stop: a stored view, or a place with a target or a rotation.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct StopText {
    view: Option<String>,
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    rotation: Option<Value>,
    scale: Option<f64>,
    travel: f64,
    #[serde(default)]
    stay: f64,
    #[serde(default)]
    easing: EasingText,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum EasingText {
    #[default]
    Smooth,
    Linear,
}

/// A tour whose stored views are not known yet.
#[derive(Debug)]
pub(super) struct TourDraft {
    is_loop: bool,
    stops: Vec<StopText>,
}

/// Reads the text of a file.
///
/// # Errors
/// The stop that is wrong, by its index from 0, and why.
pub(super) fn parse(text: &[u8]) -> anyhow::Result<TourDraft> {
    const WHAT: &str = "not a tour, which is {\"loop\": false, \"stops\": [{…}, …]}";
    let file: Value = serde_json::from_slice(text).context(WHAT)?;
    // A list is its stops.
    let file = if file.is_array() { json!({ "stops": file }) } else { file };
    let TourText { r#loop: is_loop, stops } = serde_json::from_value(file).context(WHAT)?;
    let stops = stops
        .into_iter()
        .enumerate()
        .map(|(index, stop)| serde_json::from_value(stop).with_context(|| format!("stop {index}")));
    Ok(TourDraft { is_loop, stops: stops.collect::<anyhow::Result<_>>()? })
}

impl TourDraft {
    /// The tour with the cameras of these stored views.
    ///
    /// # Errors
    /// The stop that is wrong, by its index from 0, and why.
    pub fn resolve(&self, views: &[StoredView]) -> anyhow::Result<Tour> {
        let stops = self.stops.iter().enumerate().map(|(index, stop)| {
            let camera = stop.camera(views).with_context(|| format!("stop {index}"))?;
            let easing = match stop.easing {
                EasingText::Smooth => Easing::Smooth,
                EasingText::Linear => Easing::Linear,
            };
            Ok(TourStop { camera, travel_s: stop.travel, stay_s: stop.stay, easing })
        });
        Ok(Tour { stops: stops.collect::<anyhow::Result<_>>()?, is_loop: self.is_loop })
    }
}

impl StopText {
    fn camera(&self, views: &[StoredView]) -> anyhow::Result<Camera> {
        let Self { view, position, target, up, rotation: turned, scale, .. } = self;
        if let Some(name) = view {
            let is_plain = [position, target, up].iter().all(|of| of.is_none());
            if !is_plain || turned.is_some() || scale.is_some() {
                bail!("a stop at a view has no position, target, up, rotation or scale of its own");
            }
            return stored_view::find(views, name);
        }
        let Some(position) = position.map(DVec3::from_array) else {
            bail!("name a stored view by \"view\", or give a \"position\"");
        };
        let camera = match (target.map(DVec3::from_array), turned) {
            (Some(target), None) if target == position => {
                bail!("the camera stands at {position} and cannot look at itself");
            }
            (Some(target), None) => {
                Camera::look_at(position, target, up.map_or(DVec3::Y, DVec3::from_array))
            }
            (None, Some(value)) if up.is_none() => {
                Camera { position, rotation: rotation(value).context("rotation")?, scale: 1.0 }
            }
            _ => bail!("give a \"target\", with or without \"up\", or else a \"rotation\""),
        };
        Ok(camera.with_scale(scale.unwrap_or(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views() -> Vec<StoredView> {
        vec![StoredView { name: "quay".into(), camera: Camera::IDENTITY.with_scale(3.0) }]
    }

    #[test]
    fn stops_are_views_and_cameras() {
        let text = br#"{ "loop": true, "stops": [
            { "view": "quay", "travel": 2, "stay": 1.5 },
            { "position": [1, 2, 3], "target": [0, 0, 0], "travel": 4, "easing": "linear" },
            { "position": [1, 2, 3], "rotation": [90, 0, 0], "scale": 0.5, "travel": 0 }
        ] }"#;
        let tour = parse(text).and_then(|draft| draft.resolve(&views())).expect("a tour");
        assert_eq!(tour.validate(), Ok(()));
        let at = DVec3::new(1.0, 2.0, 3.0);
        let looking = Camera::look_at(at, DVec3::ZERO, DVec3::Y);
        assert_eq!(tour.stops[0], TourStop::new(views()[0].camera, 2.0).with_stay(1.5));
        assert_eq!(tour.stops[1], TourStop::new(looking, 4.0).with_easing(Easing::Linear));
        let ahead = tour.stops[2].camera.rotation * DVec3::NEG_Z;
        assert!(ahead.distance(DVec3::NEG_X) < 1e-12 && tour.is_loop);
    }

    #[test]
    fn a_wrong_stop_is_named() {
        for (stop, said) in [
            (r#"{ "view": "pier", "travel": 1 }"#, "there is no stored view pier; there are quay"),
            (r#"{ "view": "quay" }"#, "missing field `travel`"),
            (r#"{ "view": "quay", "travel": 1, "speed": 2 }"#, "unknown field `speed`"),
            (r#"{ "view": "quay", "travel": 1, "scale": 2 }"#, "of its own"),
            (r#"{ "view": "quay", "travel": "long" }"#, "invalid type"),
            (r#"{ "view": "quay", "travel": 1, "easing": "fast" }"#, "unknown variant `fast`"),
            (r#"{ "travel": 1 }"#, "name a stored view"),
            (r#"{ "position": [0, 0, 0], "travel": 1 }"#, "give a \"target\""),
            (r#"{ "position": [0, 0], "target": [0, 0, 1], "travel": 1 }"#, "invalid length"),
            (r#"{ "position": [0, 0, 0], "target": [0, 0, 0], "travel": 1 }"#, "look at itself"),
            (r#"{ "position": [0, 0, 0], "rotation": [1], "travel": 1 }"#, "YAW,PITCH,ROLL"),
            ("7", "invalid type"),
        ] {
            let text = format!(r#"{{ "stops": [{{ "view": "quay", "travel": 1 }}, {stop}] }}"#);
            let tour = parse(text.as_bytes()).and_then(|draft| draft.resolve(&views()));
            let error = format!("{:#}", tour.expect_err(stop));
            assert!(error.starts_with("stop 1: ") && error.contains(said), "{error}");
        }
        let list = parse(br#"[{ "view": "quay", "travel": 1 }]"#).expect("a list of stops");
        assert_eq!((list.is_loop, list.stops.len()), (false, 1));
        for text in ["7", "{}", r#"{ "stops": [], "name": "x" }"#, "stops"] {
            let error = format!("{:#}", parse(text.as_bytes()).expect_err(text));
            assert!(error.starts_with("not a tour, which is"), "{error}");
        }
    }
}
