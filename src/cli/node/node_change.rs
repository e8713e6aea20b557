//! What a person, or a file of operations, says about a node: keys and their values.

use std::path::Path;

use anyhow::{Context, anyhow, bail};
use polyptych_client::glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot, Vec4};
use polyptych_client::{
    Assets, Attribute, Facing, LABEL_KEY, NewNode, NodeId, NodeStyle, Transaction,
};
use serde_json::Value;

use super::shape::{Shape, color};
use super::style_change::StyleChange;

/// The keys, as they stand in help and in errors.
const KEYS: &str = "name, position, rotation, scale, visible, mesh, color, label, size, layer, \
                    switch, fill, shading, highlight, facing, attribute.KEY";

/// Changes of one node; `None` for what stays as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct NodeChange {
    name: Option<String>,
    position: Option<DVec3>,
    rotation: Option<DQuat>,
    scale: Option<DVec3>,
    visible: Option<bool>,
    #[expect(clippy::option_option, reason = "as it is, none, or one")]
    mesh: Option<Option<u32>>,
    /// Instead of a mesh that is there.
    shape: Option<Shape>,
    /// The colour of the shape or of the text.
    color: Option<Vec4>,
    /// A text as its mesh.
    label: Option<String>,
    /// The size of the text.
    size: Option<f32>,
    attributes: Vec<(String, Option<Attribute>)>,
    #[expect(clippy::option_option, reason = "as it is, that of the parent, or one")]
    layer: Option<Option<String>>,
    #[expect(clippy::option_option, reason = "as it is, all, or one")]
    switch: Option<Option<String>>,
    style: StyleChange,
    #[expect(clippy::option_option, reason = "as it is, none, or one")]
    facing: Option<Option<Facing>>,
}

impl NodeChange {
    /// Those of `key=value` words.
    ///
    /// # Errors
    /// Which word is wrong, and what would be right.
    pub fn from_words(words: &[String]) -> anyhow::Result<Self> {
        let mut change = Self::default();
        for word in words {
            let (key, value) =
                word.split_once('=').ok_or_else(|| anyhow!("{word}: write key=value; {KEYS}"))?;
            change.set(key, &value_of(key, value)).with_context(|| word.clone())?;
        }
        Ok(change)
    }

    /// Sets what a key says.
    ///
    /// # Errors
    /// There is no such key, or the value is not one of it.
    pub fn set(&mut self, key: &str, value: &Value) -> anyhow::Result<()> {
        if self.style.set(key, value)? {
            return Ok(());
        }
        match key {
            "name" => self.name = Some(value.as_str().context("a name is text")?.to_owned()),
            "position" => self.position = Some(three(value)?),
            "rotation" => self.rotation = Some(rotation(value)?),
            "scale" => {
                let scale = match value.as_f64() {
                    Some(all) => DVec3::splat(all),
                    None => three(value)?,
                };
                self.scale = Some(scale);
            }
            "visible" => self.visible = Some(value.as_bool().context("true or false")?),
            "label" => self.label = Some(value.as_str().context("a label is text")?.to_owned()),
            "size" => self.size = Some(value.as_f64().context("a size is a number")? as f32),
            "mesh" if value.is_null() => self.mesh = Some(None),
            "layer" if value.is_null() => self.layer = Some(None),
            "layer" => {
                let name = value.as_str().context("the name of a layer, or none")?;
                self.layer = Some(Some(name.to_owned()));
            }
            "facing" => {
                self.facing = Some(match value.as_str() {
                    Some("eye") => Some(Facing::Eye),
                    Some("upright") => Some(Facing::Upright),
                    Some("none") => None,
                    _ => bail!("eye, upright, or none"),
                });
            }
            "switch" => {
                let child = match value {
                    Value::String(child) => child.clone(),
                    Value::Number(number) if number.is_u64() => number.to_string(),
                    _ => bail!("the child that is shown, or all"),
                };
                self.switch = Some((child != "all").then_some(child));
            }
            "color" => self.color = Some(color(value)?),
            "mesh" if !value.is_number() => {
                let shape = Shape::of(value)?;
                self.shape = Some(shape.context("an index of a mesh, none, or a shape")?);
            }
            "mesh" => {
                let index = value.as_u64().and_then(|index| u32::try_from(index).ok());
                self.mesh = Some(Some(index.context("an index of a mesh, or none")?));
            }
            _ => {
                let Some(key) = key.strip_prefix("attribute.").filter(|key| !key.is_empty()) else {
                    bail!("there is no key {key}; there are {KEYS}");
                };
                self.attributes.push((key.to_owned(), attribute(value)?));
            }
        }
        Ok(())
    }

    /// Checks a label of a node that is there: the size and the colour of the one before are not
    /// kept, so that they would change unasked.
    ///
    /// # Errors
    /// The label has no size or no colour.
    pub fn check_label(&self) -> anyhow::Result<()> {
        if self.label.is_some() && (self.size.is_none() || self.color.is_none()) {
            bail!("a label is set with size and colour: label=TEXT size=SIZE color=#RRGGBB");
        }
        Ok(())
    }

    /// Puts the mesh that it asks for into these.
    ///
    /// # Errors
    /// It has a colour or a size, but no new mesh or text, or the text cannot be a mesh.
    pub fn take_shape(&mut self, assets: &mut Assets) -> anyhow::Result<()> {
        match (self.label.take(), self.size.take()) {
            (Some(_), _) if self.shape.is_some() || self.mesh.is_some() => {
                bail!("a label is a mesh of its own; leave the key mesh out")
            }
            (Some(text), size) => {
                let color = self.color.take().unwrap_or(Vec4::ONE);
                let mesh = assets.add_label(&text, size.unwrap_or(1.0), color)?;
                self.mesh = Some(Some(mesh));
                self.attributes.push((LABEL_KEY.to_owned(), Some(Attribute::Text(text))));
                return Ok(());
            }
            (None, Some(_)) => bail!("a size goes with a text: label=TEXT"),
            (None, None) => {}
        }
        match (self.shape.take(), self.color.take()) {
            (Some(shape), color) => self.mesh = Some(Some(shape.add_to(assets, color))),
            (None, None) => {}
            (None, Some(_)) => {
                bail!("a colour goes with a new mesh, such as mesh=box:1,1,1, or a label")
            }
        }
        Ok(())
    }

    /// Takes the child that its switch is to show, as a path, name or number; the inner `None`
    /// stands for all.
    #[expect(clippy::option_option, reason = "as it is, all, or one")]
    pub fn take_switch(&mut self) -> Option<Option<String>> {
        self.switch.take()
    }

    /// The node to which a file's are to hang, named by the file where it has no name.
    ///
    /// # Errors
    /// It has what such a node does not.
    pub fn new_node(self, parent: Option<NodeId>, file: &str) -> anyhow::Result<NewNode> {
        let is_plain = self.mesh.is_none()
            && self.shape.is_none()
            && self.color.is_none()
            && self.label.is_none()
            && self.size.is_none();
        let is_shown = self.visible.is_none()
            && self.layer.is_none()
            && self.switch.is_none()
            && self.facing.is_none()
            && self.style.is_empty();
        if !(is_plain && is_shown && self.attributes.is_empty()) {
            bail!("it takes name, position, rotation and scale; set the rest afterwards");
        }
        let local = self.place(&DAffine3::IDENTITY);
        let stem = || Path::new(file).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name = self.name.or_else(stem).unwrap_or_default();
        Ok(NewNode { parent, name, local, mesh: None, light: None })
    }

    /// Puts a node of this kind into a transaction.
    pub fn create(
        self,
        parent: Option<NodeId>,
        transaction: &mut Transaction,
    ) -> (NodeId, (DAffine3, NodeStyle)) {
        let local = self.place(&DAffine3::IDENTITY);
        let name = self.name.clone().unwrap_or_default();
        let mesh = self.mesh.flatten();
        let node = transaction.create(NewNode { parent, name, local, mesh, light: None });
        let rest = Self {
            visible: self.visible,
            attributes: self.attributes,
            layer: self.layer,
            style: self.style,
            facing: self.facing,
            ..Self::default()
        };
        (node, rest.edit(node, (&local, NodeStyle::default()), transaction))
    }

    /// Puts the changes of a node that stands so and has this style into a transaction; returns
    /// what it has then.
    pub fn edit(
        self,
        node: NodeId,
        (local, style): (&DAffine3, NodeStyle),
        transaction: &mut Transaction,
    ) -> (DAffine3, NodeStyle) {
        let place = self.place(local);
        if place != *local {
            transaction.set_transform(node, place);
        }
        if let Some(name) = self.name {
            transaction.set_name(node, name);
        }
        if let Some(visible) = self.visible {
            transaction.set_visible(node, visible);
        }
        if let Some(mesh) = self.mesh {
            transaction.set_mesh(node, mesh);
        }
        if let Some(layer) = self.layer {
            transaction.set_layer(node, layer.as_deref());
        }
        for (key, value) in self.attributes {
            transaction.set_attribute(node, key, value);
        }
        if let Some(facing) = self.facing {
            transaction.set_facing(node, facing);
        }
        if !self.style.is_empty() {
            transaction.set_style(node, self.style.apply(style));
        }
        (place, self.style.apply(style))
    }

    /// Where it stands with the changes. What is not given stays, shear too where it can.
    fn place(&self, local: &DAffine3) -> DAffine3 {
        let mut place = *local;
        if self.rotation.is_some() || self.scale.is_some() {
            let (scale, rotation, _) = local.to_scale_rotation_translation();
            let (scale, rotation) =
                (self.scale.unwrap_or(scale), self.rotation.unwrap_or(rotation));
            place.matrix3 = DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
        }
        place.translation = self.position.unwrap_or(place.translation);
        place
    }
}

/// What a word of the command line says for a key.
fn value_of(key: &str, text: &str) -> Value {
    let number =
        |text: &str| text.trim().parse::<f64>().ok().and_then(serde_json::Number::from_f64);
    match key {
        "mesh" | "layer" if text == "none" => Value::Null,
        "name" | "label" | "layer" | "switch" | "fill" | "shading" | "facing" => text.into(),
        "mesh" => text.parse::<u32>().map_or_else(|_| text.into(), Value::from),
        _ if key.starts_with("attribute.") && text.is_empty() => Value::Null,
        _ if text == "true" || text == "false" => Value::Bool(text == "true"),
        "position" | "rotation" | "scale" | "color" | "highlight" if text.contains(',') => {
            let numbers = text.split(',').map(|one| number(one).map_or(Value::Null, Value::Number));
            Value::Array(numbers.collect())
        }
        _ => number(text).map_or_else(|| text.into(), Value::Number),
    }
}

fn numbers(value: &Value) -> anyhow::Result<Vec<f64>> {
    let list = value.as_array().context("a list of numbers")?;
    list.iter().map(|one| one.as_f64().context("a list of numbers")).collect()
}

fn three(value: &Value) -> anyhow::Result<DVec3> {
    match numbers(value)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => bail!("three numbers: X,Y,Z"),
    }
}

/// Yaw, pitch and roll in degrees, as in wall files, or a quaternion.
///
/// # Errors
/// The values that would be right.
pub(in crate::cli) fn rotation(value: &Value) -> anyhow::Result<DQuat> {
    match numbers(value)?[..] {
        [yaw, pitch, roll] => {
            let [yaw, pitch, roll] = [yaw, pitch, roll].map(f64::to_radians);
            Ok(DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll))
        }
        [x, y, z, w] => {
            let quaternion = DQuat::from_xyzw(x, y, z, w);
            if (quaternion.length() - 1.0).abs() > 1e-3 {
                bail!("a quaternion X,Y,Z,W has the length 1, not {}", quaternion.length());
            }
            Ok(quaternion.normalize())
        }
        _ => bail!("YAW,PITCH,ROLL in degrees, or a quaternion X,Y,Z,W"),
    }
}

fn attribute(value: &Value) -> anyhow::Result<Option<Attribute>> {
    Ok(match value {
        Value::Null => None,
        Value::Bool(is) => Some(Attribute::Bool(*is)),
        Value::String(text) => Some(Attribute::Text(text.clone())),
        Value::Number(number) => {
            Some(Attribute::Number(number.as_f64().context("a finite number")?))
        }
        _ => bail!("an attribute is true, false, a number, a text, or null to forget it"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(words: &[&str]) -> anyhow::Result<NodeChange> {
        NodeChange::from_words(&words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn words_say_what_json_says() {
        let words = change(&[
            "name=7",
            "position=1,2,3",
            "rotation=90,0,0",
            "scale=2",
            "visible=false",
            "mesh=none",
            "attribute.kind=door",
            "attribute.height=2.5",
            "attribute.old=",
            "layer=7",
            "switch=all",
            "fill=wireframe",
            "highlight=0,0.5,1,0.25",
        ]);
        let mut json = NodeChange::default();
        for (key, value) in [
            ("name", serde_json::json!("7")),
            ("position", serde_json::json!([1, 2, 3])),
            ("rotation", serde_json::json!([90.0, 0.0, 0.0])),
            ("scale", serde_json::json!([2, 2, 2])),
            ("visible", serde_json::json!(false)),
            ("mesh", Value::Null),
            ("attribute.kind", serde_json::json!("door")),
            ("attribute.height", serde_json::json!(2.5)),
            ("attribute.old", Value::Null),
            ("layer", serde_json::json!("7")),
            ("switch", serde_json::json!("all")),
            ("fill", serde_json::json!("wireframe")),
            ("highlight", serde_json::json!([0, 0.5, 1, 0.25])),
        ] {
            json.set(key, &value).expect("a key");
        }
        assert_eq!(words.expect("words"), json);
        let ahead = json.rotation.expect("turned") * DVec3::NEG_Z;
        assert!(ahead.abs_diff_eq(DVec3::NEG_X, 1e-12), "a wall at the viewer's left: {ahead}");
    }

    #[test]
    fn what_is_not_given_stays_shear_too() {
        let mut local = DAffine3::from_translation(DVec3::Y);
        local.matrix3.y_axis.x = 0.5;
        let moved = change(&["position=4,5,6"]).expect("words").place(&local);
        assert_eq!((moved.matrix3, moved.translation), (local.matrix3, DVec3::new(4.0, 5.0, 6.0)));
        let grown = change(&["scale=3"]).expect("words").place(&DAffine3::from_scale(DVec3::ONE));
        assert!(grown.matrix3.abs_diff_eq(DMat3::from_diagonal(DVec3::splat(3.0)), 1e-12));
    }

    #[test]
    fn a_label_is_set_with_its_size_and_its_colour() {
        let check = |words: &[&str]| change(words).expect("words").check_label();
        for words in [&["label=a"][..], &["label=a", "size=2"], &["label=a", "color=#ff0000"]] {
            let error = check(words).expect_err("less").to_string();
            assert!(error.ends_with("label=TEXT size=SIZE color=#RRGGBB"), "{error}");
        }
        check(&["label=a", "size=2", "color=#ff0000"]).expect("all");
        check(&["visible=true"]).expect("none");
    }

    #[test]
    fn wrong_words_are_told_with_what_would_be_right() {
        for (word, part) in [
            ("position", "write key=value"),
            ("colour=red", "there is no key colour; there are name, position"),
            ("position=1,2", "X,Y,Z"),
            ("position=a,b,c", "a list of numbers"),
            ("rotation=0,0,0,2", "has the length 1, not 2"),
            ("mesh=-1", "an index of a mesh, none, or a shape"),
            ("color=red", "#rrggbb"),
            ("visible=perhaps", "true or false"),
            ("attribute.=1", "there is no key"),
            ("facing=north", "eye, upright, or none"),
            ("fill=hollow", "solid, wireframe, points, or none"),
            ("shading=dark", "material, unlit, or none"),
            ("highlight=red", "a colour, off, or none"),
            ("layers=a", "there is no key layers; there are name"),
        ] {
            let error = format!("{:#}", change(&[word]).expect_err(word));
            assert!(error.contains(part), "{error}");
        }
    }
}
