//! Nodes, lights and samplers in glTF's terms.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::io::{self, Write};

use glam::{DAffine3, DMat3, DMat4};
use polyptych_scene::glb::{GlbWriter, quoted};
use polyptych_scene::{
    Attribute, Filter, Instance, Light, LightKind, MipFilter, Sampler, Scene, Topology, Wrap,
};
use polyptych_text::counted;

/// Notes of what moves in a scene, which a file does not have.
pub(super) fn left_out(scene: &Scene) -> Vec<String> {
    let mut notes = Vec::new();
    if !scene.animations.clips.is_empty() {
        let clips = counted(scene.animations.clips.len() as u64, "clip");
        notes.push(format!("animations are not in the file: {clips}"));
    }
    if !scene.deformations.is_empty() {
        let note = "what skins and morph targets bend is in the file as it stands without them";
        notes.push(note.to_owned());
    }
    notes
}

/// The number of a topology.
pub(super) fn mode(of: Topology) -> u8 {
    match of {
        Topology::Points => 0,
        Topology::Lines => 1,
        Topology::Triangles => 4,
    }
}

/// A node of the file.
#[derive(Clone, Debug, Default)]
pub(super) struct NodeJson<'a> {
    pub name: &'a str,
    pub local: DAffine3,
    pub mesh: Option<u32>,
    pub light: Option<u32>,
    /// The attributes of `EXT_mesh_gpu_instancing`.
    pub instances: Option<String>,
    pub is_hidden: bool,
    pub attributes: Option<&'a BTreeMap<String, Attribute>>,
}

impl NodeJson<'_> {
    /// The node's value in the list of nodes.
    pub fn to_json<W: Write>(&self, children: &[u32], file: &mut GlbWriter<W>) -> String {
        let mut members = Vec::new();
        if !self.name.is_empty() {
            members.push(format!(r#""name":{}"#, quoted(self.name)));
        }
        if !children.is_empty() {
            members.push(format!(r#""children":{children:?}"#));
        }
        if self.local.matrix3 != DMat3::IDENTITY {
            let matrix = DMat4::from(self.local).to_cols_array();
            members.push(format!(r#""matrix":{matrix:?}"#));
        } else if self.local != DAffine3::IDENTITY {
            members.push(format!(r#""translation":{:?}"#, self.local.translation.to_array()));
        }
        if let Some(mesh) = self.mesh {
            members.push(format!(r#""mesh":{mesh}"#));
        }
        let mut extensions = Vec::new();
        if let Some(light) = self.light {
            extensions.push(format!(r#""KHR_lights_punctual":{{"light":{light}}}"#));
        }
        if let Some(instances) = &self.instances {
            let name = file.use_extension("EXT_mesh_gpu_instancing");
            extensions.push(format!(r#""{name}":{{"attributes":{instances}}}"#));
        }
        if self.is_hidden {
            let name = file.use_extension("KHR_node_visibility");
            extensions.push(format!(r#""{name}":{{"visible":false}}"#));
        }
        if !extensions.is_empty() {
            members.push(format!(r#""extensions":{{{}}}"#, extensions.join(",")));
        }
        if let Some(attributes) = self.attributes.filter(|all| !all.is_empty()) {
            let attribute = |(key, value): (&String, &Attribute)| {
                let value = match value {
                    Attribute::Bool(value) => value.to_string(),
                    Attribute::Number(number) => format!("{number:?}"),
                    Attribute::Text(text) => quoted(text),
                };
                format!("{}:{value}", quoted(key))
            };
            let all: Vec<String> = attributes.iter().map(attribute).collect();
            members.push(format!(r#""extras":{{{}}}"#, all.join(",")));
        }
        format!("{{{}}}", members.join(","))
    }
}

/// Writes copies of a mesh; returns the attributes of `EXT_mesh_gpu_instancing`.
pub(super) fn instances<W: Write>(
    file: &mut GlbWriter<W>,
    instances: &[Instance],
) -> io::Result<String> {
    let rows = instances.iter();
    let translation = file.floats(false, rows.clone().map(|of| of.translation.to_array()), None)?;
    let rotation = file.floats(false, rows.clone().map(|of| of.rotation.to_array()), None)?;
    let scale = file.floats(false, rows.map(|of| of.scale.to_array()), None)?;
    Ok(format!(r#"{{"TRANSLATION":{translation},"ROTATION":{rotation},"SCALE":{scale}}}"#))
}

/// A light of `KHR_lights_punctual`.
pub(super) fn light_json(of: &Light) -> String {
    // Colours end at 1 there; by a power of two, so that the product is what it was. JSON has no
    // infinity: the brightest lights are as bright as numbers go.
    let excess = of.color.max_element().max(1.0).log2().ceil().exp2().min(f32::MAX);
    let color = (of.color / excess).to_array();
    let intensity = (of.intensity * excess).min(f32::MAX);
    let mut more = String::new();
    if let Some(range) = of.range {
        let _ = write!(more, r#","range":{range:?}"#);
    }
    let kind = match of.kind {
        LightKind::Directional => "directional",
        LightKind::Point => "point",
        LightKind::Spot { inner_rad, outer_rad } => {
            // The nearest f32 of a right angle is above it.
            let [inner, outer] = [inner_rad, outer_rad].map(|rad| f64::from(rad).min(FRAC_PI_2));
            let _ = write!(
                more,
                r#","spot":{{"innerConeAngle":{inner:?},"outerConeAngle":{outer:?}}}"#
            );
            "spot"
        }
    };
    format!(r#"{{"type":"{kind}","color":{color:?},"intensity":{intensity:?}{more}}}"#)
}

/// A sampler, by the numbers of OpenGL.
pub(super) fn sampler_json(of: Sampler) -> String {
    let mag = match of.mag {
        Filter::Nearest => 9728,
        Filter::Linear => 9729,
    };
    let min = match (of.min, of.mip) {
        (Filter::Nearest, MipFilter::None) => 9728,
        (Filter::Linear, MipFilter::None) => 9729,
        (Filter::Nearest, MipFilter::Nearest) => 9984,
        (Filter::Linear, MipFilter::Nearest) => 9985,
        (Filter::Nearest, MipFilter::Linear) => 9986,
        (Filter::Linear, MipFilter::Linear) => 9987,
    };
    let [u, v] = [of.wrap_u, of.wrap_v].map(|wrap| match wrap {
        Wrap::Clamp => 33071,
        Wrap::Mirror => 33648,
        Wrap::Repeat => 10497,
    });
    format!(r#"{{"magFilter":{mag},"minFilter":{min},"wrapS":{u},"wrapT":{v}}}"#)
}
