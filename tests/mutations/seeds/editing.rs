//! Edits of a scene, and questions about it, as messages carry them.

use glam::{DAffine3, DVec2, DVec3, Vec3};
use polyptych_protocol::clip::{ClipStatus, ClipSummary};
use polyptych_protocol::follow::Follow;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{
    LayerInfo, NearestPoint, NodeInfo, NodePage, NodeQuery, RayHit, RegionQuery,
};
use polyptych_protocol::request::{RequestError, Response};
use polyptych_protocol::transaction::{AssetSource, Transaction};
use polyptych_protocol::variant::VariantList;
use polyptych_protocol::walk_query::{Touched, WalkEnd, WalkQuery, WalkedWay, Walker};
use polyptych_scene::{
    Attribute, Bounds, Facing, Fill, Highlight, Light, LightKind, Material, NewNode, NodeId,
    NodeStyle, SceneEdits, Shading,
};
use polyptych_wall::camera::Camera;
use polyptych_wall::region::{HalfSpace, Region, Relation};

/// A camera that goes around a node.
pub fn follow() -> Follow {
    let camera = Some(Camera::IDENTITY);
    Follow { node: NodeId(3), camera, is_turning: true, orbit_rad_per_s: 0.5 }
}

/// A way for a person.
pub fn way() -> WalkQuery {
    let walker = Walker { eye_height: Some(1.7), radius: Some(0.3), step_height: 0.4 };
    WalkQuery { way: vec![DVec3::ZERO, DVec3::X, DVec3::Z], walker }
}

/// A way up to a wall.
pub fn walked() -> WalkedWay {
    let wall = Touched { node: NodeId(4), name: "wall".into(), position: DVec3::X };
    let points = vec![DVec3::ZERO, DVec3::X];
    WalkedWay { revision: Revision(3), points, end: WalkEnd::Obstacle(wall) }
}

/// One edit of each kind.
pub fn transaction() -> Transaction {
    let mut transaction = Transaction::based_on(Revision(1));
    let light = Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 1.0, range: None };
    let new = NewNode { name: "lamp".into(), light: Some(light.clone()), ..NewNode::default() };
    let lamp = transaction.create(new);
    transaction.set_parent(NodeId(1), Some(lamp));
    transaction.set_transform(NodeId(1), DAffine3::from_translation(DVec3::X));
    transaction.set_visible(NodeId(1), false);
    transaction.set_name(NodeId(1), "arm");
    transaction.set_mesh(NodeId(1), Some(0));
    transaction.set_light(lamp, None);
    transaction.set_attribute(NodeId(1), "kind", Some(Attribute::Text("pointer".into())));
    transaction.set_attribute(NodeId(1), "old", Some(Attribute::Bool(true)));
    transaction.set_material(0, Material::default());
    transaction.set_layer(NodeId(1), Some("plan-a"));
    transaction.set_layer_visible("plan-a", false);
    transaction.set_switch(NodeId(1), Some(lamp));
    transaction.set_style(NodeId(1), style());
    transaction.set_facing(NodeId(1), Some(Facing::Eye));
    transaction.set_variant(Some("Day"));
    transaction.remove(NodeId(0));
    transaction.with_scene(AssetSource::Glb(b"glTF".as_slice().into()), NewNode::default())
}

fn style() -> NodeStyle {
    NodeStyle {
        fill: Some(Fill::Wireframe),
        shading: Some(Shading::Unlit),
        highlight: Some(Highlight::Tint { color: Vec3::X, share: 0.5 }),
    }
}

pub fn scene_edits() -> SceneEdits {
    let mut edits = SceneEdits::default();
    for edit in transaction().edits {
        edits.apply(edit);
    }
    edits
}

pub fn node() -> NodeInfo {
    NodeInfo {
        id: NodeId(1),
        parent: Some(NodeId(0)),
        name: "arm".into(),
        depth: 1,
        local: DAffine3::IDENTITY,
        world: DAffine3::from_translation(DVec3::X),
        visible: true,
        mesh: Some(0),
        light: None,
        attributes: [("kind".to_owned(), Attribute::Number(1.5))].into(),
        bounds: Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE }),
        own_layer: None,
        layer: Some("plan-a".into()),
        switch: Some(NodeId(2)),
        style: style(),
        facing: Some(Facing::Upright),
    }
}

pub fn regions() -> impl Iterator<Item = RegionQuery> {
    let half = |normal| HalfSpace { normal, offset: 1.5 };
    let regions = [
        Region::Box { min: DVec3::ZERO, max: DVec3::ONE },
        Region::Sphere { center: DVec3::X, radius: 3.0 },
        Region::Prism { polygon: vec![DVec2::ZERO, DVec2::X, DVec2::Y], low: -1.0, high: 2.0 },
        Region::Convex(vec![half(DVec3::X), half(DVec3::Y), half(DVec3::NEG_Z)]),
    ];
    let relations = [Relation::Inside, Relation::Touches, Relation::Contains, Relation::Disjoint];
    let nodes = NodeQuery { name: Some("arm".into()), count: 10, ..NodeQuery::default() };
    regions.into_iter().zip(relations).map(move |(region, relation)| RegionQuery {
        region,
        relation,
        nodes: nodes.clone(),
    })
}

pub fn answers_about_space() -> Vec<Result<Response, RequestError>> {
    vec![
        Ok(Response::Ray(Some(RayHit {
            revision: Revision(3),
            node: NodeId(1),
            name: "arm".into(),
            position: DVec3::ZERO,
            normal: DVec3::Z,
            distance: 1.0,
            is_front: true,
            material: Some(0),
        }))),
        Ok(Response::Layers(vec![LayerInfo { name: "plan-a".into(), nodes: 3, visible: false }])),
        Ok(Response::Clips(vec![ClipStatus {
            clip: ClipSummary { name: "walk".into(), duration_s: 2.5, is_played: true },
            is_running: true,
            is_looping: false,
            time_s: 0.5,
            speed: -1.0,
            weight: 0.5,
        }])),
        Ok(Response::Variants(VariantList { names: vec!["Day".into()], chosen: Some(0) })),
        Ok(Response::Nodes(NodePage { revision: Revision(3), found: 1, nodes: vec![node()] })),
        Ok(Response::Nearest(Some(NearestPoint {
            revision: Revision(3),
            node: NodeId(1),
            name: "arm".into(),
            position: DVec3::ZERO,
            distance: 1.0,
        }))),
    ]
}
