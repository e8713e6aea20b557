//! The style of a node, as a person or a file of operations says it.

use anyhow::bail;
use polyptych_client::{Facing, Fill, Highlight, NodeStyle, Shading};
use serde_json::Value;

use super::shape::color;

/// The part of a highlight's colour in what is shown, where its colour says none.
const HIGHLIGHT_SHARE: f32 = 0.5;

/// Changes of a style: `None` for what stays as it is, `Some(None)` for what is to be as of the
/// node above.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[expect(clippy::option_option, reason = "as it is, as above, or one")]
pub(super) struct StyleChange {
    fill: Option<Option<Fill>>,
    shading: Option<Option<Shading>>,
    highlight: Option<Option<Highlight>>,
}

impl StyleChange {
    /// Sets what a key says. Returns whether it is one of a style.
    ///
    /// # Errors
    /// The values that would be right.
    pub fn set(&mut self, key: &str, value: &Value) -> anyhow::Result<bool> {
        let word = value.as_str();
        match key {
            "fill" => {
                self.fill = Some(match word {
                    Some("solid") => Some(Fill::Solid),
                    Some("wireframe") => Some(Fill::Wireframe),
                    Some("points") => Some(Fill::Points),
                    Some("none") => None,
                    _ => bail!("solid, wireframe, points, or none for that of the node above"),
                });
            }
            "shading" => {
                self.shading = Some(match word {
                    Some("material") => Some(Shading::Material),
                    Some("unlit") => Some(Shading::Unlit),
                    Some("none") => None,
                    _ => bail!("material, unlit, or none for that of the node above"),
                });
            }
            "highlight" => {
                self.highlight = Some(match word {
                    Some("off") => Some(Highlight::Off),
                    Some("none") => None,
                    _ => Some(tint(value)?),
                });
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Returns whether nothing is changed.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// A style with the changes.
    pub fn apply(&self, to: NodeStyle) -> NodeStyle {
        NodeStyle {
            fill: self.fill.unwrap_or(to.fill),
            shading: self.shading.unwrap_or(to.shading),
            highlight: self.highlight.unwrap_or(to.highlight),
        }
    }
}

fn tint(value: &Value) -> anyhow::Result<Highlight> {
    let has_share = match value {
        Value::Array(list) => list.len() == 4,
        other => other.as_str().is_some_and(|text| text.len() == "#rrggbbaa".len()),
    };
    let color = color(value).map_err(|error| error.context("a colour, off, or none"))?;
    let share = if has_share { color.w } else { HIGHLIGHT_SHARE };
    Ok(Highlight::Tint { color: color.truncate(), share })
}

/// The word for a way of turning towards the viewer.
pub(super) fn facing_name(facing: Facing) -> &'static str {
    match facing {
        Facing::Eye => "eye",
        Facing::Upright => "upright",
    }
}

/// A style as JSON: what is of the node above is null.
pub(super) fn style_in_json(style: &NodeStyle) -> Value {
    let fill = style.fill.map(|fill| match fill {
        Fill::Solid => "solid",
        Fill::Wireframe => "wireframe",
        Fill::Points => "points",
    });
    let shading = style.shading.map(|shading| match shading {
        Shading::Material => "material",
        Shading::Unlit => "unlit",
    });
    let highlight = style.highlight.map(|highlight| match highlight {
        Highlight::Off => serde_json::json!("off"),
        Highlight::Tint { color, share } => {
            serde_json::json!([color.x, color.y, color.z, share])
        }
    });
    serde_json::json!({ "fill": fill, "shading": shading, "highlight": highlight })
}
