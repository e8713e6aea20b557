//! Nodes that turn towards the viewer.
//!
//! Every frame turns them anew, by what all channels share: the middle between the viewer's eyes.
//! A node turns about its own origin in world space, so its shape stays, whatever its scale.

use glam::{DAffine3, DQuat, DVec3};
use polyptych_scene::{Facing, Node};

use super::draw_item::Bounds;
use crate::view::ViewDesc;

/// A node that turns towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Billboard {
    facing: Facing,
    /// The node's origin in the world, before anything turns.
    pivot: DVec3,
    /// Its front, before anything turns.
    front: DVec3,
    /// An index into the billboards of the scene, below its own: one with which it turns.
    parent: Option<u32>,
    /// An index into the scene's nodes.
    node: u32,
}

impl Billboard {
    /// The billboards of a scene, and for each node the one with which it turns; no entries if
    /// there are none.
    pub fn all(
        nodes: &[Node],
        world: &[DAffine3],
        facings: &[Option<Facing>],
    ) -> (Vec<Self>, Vec<Option<u32>>) {
        let (mut all, mut of_nodes) = (Vec::new(), Vec::new());
        for ((node, world), facing) in nodes.iter().zip(world).zip(facings) {
            let parent = node.parent.and_then(|parent| of_nodes[parent as usize]);
            let Some(facing) = *facing else {
                of_nodes.push(parent);
                continue;
            };
            let front = world.transform_vector3(DVec3::Z);
            of_nodes.push(Some(all.len() as u32));
            let node = of_nodes.len() as u32 - 1;
            all.push(Self { facing, pivot: world.translation, front, parent, node });
        }
        (all, of_nodes)
    }

    /// It where its node has moved; `place_of` gives world space from a node's space, where the
    /// node has moved.
    pub fn moved(self, place_of: impl Fn(u32) -> Option<DAffine3>) -> Self {
        let Some(world) = place_of(self.node) else { return self };
        let front = world.transform_vector3(DVec3::Z);
        Self { pivot: world.translation, front, ..self }
    }

    /// The turn of each of these for a view, in world space.
    pub fn turns(all: &[Self], view: &ViewDesc) -> Vec<DAffine3> {
        let mut turns: Vec<DAffine3> = Vec::with_capacity(all.len());
        for one in all {
            let above = one.parent.map_or(DAffine3::IDENTITY, |parent| turns[parent as usize]);
            let (pivot, front) =
                (above.transform_point3(one.pivot), above.transform_vector3(one.front));
            let eye =
                if view.is_parallel() { -view.forward() } else { view.middle_eye_in_world - pivot };
            let turn = DAffine3::from_quat(one.facing_turn(front, eye));
            let moved = DAffine3::from_translation(pivot) * turn;
            turns.push(moved * DAffine3::from_translation(-pivot) * above);
        }
        turns
    }

    /// The turn that brings its front to the eye, both as seen from its origin: about Y first, as
    /// of Bao and Hua, *Real-Time Graphics Rendering Engine* (2011), section 3.5.5.2, and then, if
    /// it faces the eye, up or down. An eye over or below the origin leaves the first part out.
    fn facing_turn(&self, front: DVec3, eye: DVec3) -> DQuat {
        let [from, to] = [front, eye].map(|v| DVec3::new(v.x, 0.0, v.z));
        let is_turned = from.length_squared() > 0.0 && to.length_squared() > 0.0;
        let yaw = if is_turned { DVec3::Y.dot(from.cross(to)).atan2(from.dot(to)) } else { 0.0 };
        let about_y = DQuat::from_rotation_y(yaw);
        match self.facing {
            Facing::Upright => about_y,
            Facing::Eye => match (front.try_normalize(), eye.try_normalize()) {
                (Some(front), Some(eye)) => {
                    DQuat::from_rotation_arc(about_y * front, eye) * about_y
                }
                _ => about_y,
            },
        }
    }

    /// Around a box that turns with one of these, however they turn.
    pub fn bounds(all: &[Self], of: Option<u32>, bounds: Bounds) -> Bounds {
        let Some(mut at) = of.and_then(|of| all.get(of as usize)) else { return bounds };
        let far = (bounds.min - at.pivot).abs().max((bounds.max - at.pivot).abs());
        let mut radius = far.length();
        while let Some(above) = at.parent.and_then(|parent| all.get(parent as usize)) {
            radius += at.pivot.distance(above.pivot);
            at = above;
        }
        // Rounding of the turns is far below this.
        let half = DVec3::splat(radius * (1.0 + 1e-9));
        let around = Bounds { min: at.pivot - half, max: at.pivot + half };
        if around.min.is_finite() && around.max.is_finite() { around } else { Bounds::UNBOUNDED }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DMat4};
    use polyptych_scene::SceneSubset;
    use proptest::prelude::*;

    use super::*;
    use crate::view::AllowedError;

    fn view(eye: DVec3) -> ViewDesc {
        ViewDesc {
            eye_in_world: eye + DVec3::X * 0.03,
            middle_eye_in_world: eye,
            view_from_world: DMat3::IDENTITY,
            clip_from_view: DMat4::from_cols(
                glam::DVec4::X,
                glam::DVec4::Y,
                -glam::DVec4::W,
                glam::DVec4::Z,
            ),
            viewport: [0.0, 0.0, 1.0, 1.0],
            scissor: None,
            exposure: 1.0,
            fog: None,
            glow: None,
            ambient_occlusion: None,
            depth_of_field: None,
            tone: polyptych_scene::ToneMapper::default(),
            subset: SceneSubset::default(),
            allowed_error: AllowedError::NONE,
            has_shadows: true,
        }
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-50.0..50.0f64).prop_map(DVec3::from)
    }

    fn place() -> impl Strategy<Value = DAffine3> {
        (vector(), vector(), 0.0..6.0f64, prop::array::uniform3(0.1..4.0f64)).prop_map(
            |(at, axis, angle, scale)| {
                let turn = DQuat::from_axis_angle(axis.normalize_or(DVec3::X), angle);
                DAffine3::from_scale_rotation_translation(DVec3::from(scale), turn, at)
            },
        )
    }

    proptest! {
        #[test]
        fn fronts_face_the_eye_and_bounds_hold_what_turns(
            outer in place(), inner in place(), eye in vector(), corner in vector(),
            upright in any::<bool>(),
        ) {
            let nodes = [
                Node { local: outer, ..Node::default() },
                Node { local: inner, parent: Some(0), ..Node::default() },
                Node { parent: Some(1), ..Node::default() },
            ];
            let world = [outer, outer * inner, outer * inner];
            let own = if upright { Facing::Upright } else { Facing::Eye };
            let facings = [Some(Facing::Upright), Some(own), None];
            let (all, of_nodes) = Billboard::all(&nodes, &world, &facings);
            prop_assert_eq!(&of_nodes, &[Some(0), Some(1), Some(1)]);
            let turns = Billboard::turns(&all, &view(eye));
            let turned = turns[1] * world[1];
            let front = turned.transform_vector3(DVec3::Z);
            let toward = eye - turned.translation;
            let (a, b) = if upright {
                (DVec3::new(front.x, 0.0, front.z), DVec3::new(toward.x, 0.0, toward.z))
            } else {
                (front, toward)
            };
            if a.length() > 1e-6 && b.length() > 1e-6 {
                prop_assert!(a.normalize().dot(b.normalize()) > 1.0 - 1e-9, "{} {}", a, b);
            }
            // It keeps its shape.
            let [x, y] = [turns[1].matrix3.x_axis, turns[1].matrix3.y_axis];
            prop_assert!((x.length() - 1.0).abs() < 1e-9 && x.dot(y).abs() < 1e-9);
            let point = world[2].transform_point3(corner);
            let other = world[2].translation;
            let bounds = Bounds { min: point.min(other), max: point.max(other) };
            let around = Billboard::bounds(&all, of_nodes[2], bounds);
            let moved = turns[1].transform_point3(point);
            prop_assert!(moved.cmpge(around.min).all() && moved.cmple(around.max).all());
        }
    }

    #[test]
    fn an_eye_on_the_axis_leaves_what_is_upright_as_it_stands() {
        for (eye, front) in [(DVec3::Y, DVec3::Z), (DVec3::ZERO, DVec3::X), (DVec3::Z, DVec3::Y)] {
            let one = Billboard {
                facing: Facing::Upright,
                pivot: DVec3::ZERO,
                front,
                parent: None,
                node: 0,
            };
            assert_eq!(one.facing_turn(front, eye), DQuat::IDENTITY, "{eye} {front}");
        }
        let above = Billboard {
            facing: Facing::Eye,
            pivot: DVec3::ZERO,
            front: DVec3::Z,
            parent: None,
            node: 0,
        };
        let turned = above.facing_turn(DVec3::Z, DVec3::Y * 3.0) * DVec3::Z;
        assert!(turned.abs_diff_eq(DVec3::Y, 1e-12), "{turned}");
    }
}
