//! The scene of a frame where clips move it.

use std::rc::Rc;
use std::time::Instant;

use polyptych_renderer::{GpuScene, MovedNode};
use polyptych_scene::{ClipTime, Motion};

use super::RenderThread;

/// A scene as clips moved it: frames that show the same again find it here.
#[derive(Debug)]
pub(super) struct DrawnMoment {
    still: Rc<GpuScene>,
    clips: Vec<ClipTime>,
    moved: Rc<GpuScene>,
}

impl RenderThread {
    /// Returns a scene as these clips move it. One that cannot be moved is shown at rest, and the
    /// log says why.
    pub(super) fn scene_at(
        &mut self,
        still: Rc<GpuScene>,
        motion: Option<&Motion>,
        clips: &[ClipTime],
    ) -> Rc<GpuScene> {
        #[cfg(test)]
        {
            let earlier = self.frame_began.checked_sub(self.moving_takes);
            self.frame_began = earlier.expect("an instant so long ago");
        }
        let Some(motion) = motion.filter(|motion| motion.is_moved_by(clips)) else {
            self.moment = None;
            return still;
        };
        let is_it = |of: &&DrawnMoment| Rc::ptr_eq(&of.still, &still) && of.clips == clips;
        if let Some(drawn) = self.moment.as_ref().filter(is_it) {
            return Rc::clone(&drawn.moved);
        }
        let start = Instant::now();
        let moment = motion.at(clips);
        let of_file = &motion.base().nodes;
        let nodes: Vec<MovedNode<'_>> = moment
            .places
            .iter()
            .map(|(index, node, world)| {
                // Those that were made since have none.
                let file = usize::try_from(node.0).ok().and_then(|at| of_file.get(at));
                let instances = file.map_or(&[][..], |node| &node.instances);
                let light = moment.lights.binary_search_by_key(index, |(lit, _)| *lit);
                MovedNode {
                    is_hidden: moment.hidden.binary_search(index).is_ok(),
                    light: light.ok().map(|at| &moment.lights[at].1),
                    ..MovedNode::new(*index, *world, instances)
                }
            })
            .collect();
        let shapes = motion.deformations().iter().zip(&moment.shapes);
        let shapes: Vec<_> = shapes.map(|(of, shape)| (of.mesh, shape)).collect();
        let moved = match still.at_moment(&self.gpu, &nodes, &shapes, &moment.materials) {
            Ok(moved) => Rc::new(moved),
            Err(error) => {
                tracing::error!(%error, "the scene is shown at rest: its clips cannot move it");
                Rc::clone(&still)
            }
        };
        let move_us = start.elapsed().as_micros() as u64;
        tracing::debug!(nodes = nodes.len(), shapes = shapes.len(), move_us, "clips moved");
        self.moment = Some(DrawnMoment { still, clips: clips.to_vec(), moved: Rc::clone(&moved) });
        moved
    }
}
