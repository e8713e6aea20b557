//! Maps of shadows that are kept from frame to frame: in sets, which are layers of one texture, and
//! drawn where they are not those of a frame before.
//!
//! They are drawn as a frame is submitted, after those that were submitted before: the queue does
//! one after the other, so a map that is drawn anew is read by no frame before.

use polyptych_scene::FramePass;

use super::begun_frame::ShownView;
use super::draw_context::FrameBindings;
use super::map_set::{MapSet, MapWork, Subject};
use super::shadow_map::ShadowMap;
use super::{FrameResources, ListPart, check_records};
use crate::DrawError;
use crate::draw_list::{DrawList, ShadowItems};
use crate::gpu::Gpu;
use crate::pass::shadow::{self, CasterPass, Sides};
use crate::scene::{Bounds, GpuScene};
use crate::view::ViewDesc;

/// Maps that were not used in so many frames of channels leave their memory.
const KEPT_FRAMES: u64 = 256;

/// Bytes of all maps of one kind, as many as those of one camera, beyond which maps that a round of
/// frames does not use leave their memory, those of the earliest frame first.
const BYTES_MAX: u64 = 256 << 20;

/// Bytes of the maps of one kind of a round, as many as those of four cameras, beyond which its
/// frames take maps from each other, and draw them anew each time.
const ROUND_BYTES_MAX: u64 = 4 * BYTES_MAX;

/// Maximum number of passes of one submission: each has the uniforms of a view, and a map has up
/// to [`PASSES_OF_MAP`].
const PASSES_TOGETHER_MAX: usize = 16;

/// What stands still, and what moves.
const PASSES_OF_MAP: usize = 2;

/// Primitives from which on a submission takes no further map: a quarter of what a frame may have,
/// and a map has no more than half of that.
const RECORDS_TOGETHER: usize = super::RECORDS_MAX / 4;

/// A map that is to be drawn.
struct Order {
    /// The view that it is drawn for.
    view: usize,
    set: usize,
    layer: usize,
    map: ShadowMap,
    work: MapWork,
}

/// A step of drawing a map.
enum Step {
    /// The pass of this list over this map, which begins with what the map has if `true`.
    Pass(usize, wgpu::TextureView, bool),
    /// Copies what stands still into this layer of this set.
    Copy(usize, usize),
}

/// The passes of a submission.
#[derive(Default)]
struct Passes {
    lists: Vec<DrawList>,
    /// By list.
    views: Vec<ViewDesc>,
    steps: Vec<Step>,
}

/// All sets of one kind of lights.
#[derive(Debug, Default)]
pub(super) struct MapSets {
    sets: Vec<MapSet>,
    /// The number of the frame of a channel.
    frame: u64,
    /// That of the first frame of the round: of all channels of a server.
    round: u64,
}

/// Maps that a frame must draw.
#[derive(Default)]
pub(super) struct MapOrders(Vec<Order>);

impl MapOrders {
    /// Returns the number of maps.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

impl MapSets {
    /// Begins a frame: leaves what was not used for long, or is of a scene that is gone.
    pub fn begin_frame(&mut self, begins_round: bool) {
        self.frame += 1;
        if begins_round {
            self.round = self.frame;
        }
        let kept = self.frame.saturating_sub(KEPT_FRAMES);
        let is_kept = |set: &MapSet| set.used >= kept && !set.is_empty();
        self.sets.retain(|set| is_kept(set) && !set.subject().scene.is_gone());
    }

    /// The box of all that a view of a subject may show, if a set knows it.
    pub fn extent_of(&self, subject: &Subject) -> Option<Bounds> {
        self.sets.iter().find_map(|set| set.extent_of(subject))
    }

    pub fn get(&self, set: usize) -> &MapSet {
        &self.sets[set]
    }

    pub fn get_mut(&mut self, set: usize) -> &mut MapSet {
        &mut self.sets[set]
    }

    /// The set that has most of these maps already, by layer, and is not used in this round for
    /// others. Those that it lacks are ordered for a view.
    pub fn find(
        &mut self,
        (gpu, scene): (&Gpu, &GpuScene),
        (subject, extent): (&Subject, Bounds),
        (wanted, side): (&[ShadowMap], u32),
        (view, camera, orders): (usize, &ViewDesc, &mut MapOrders),
    ) -> usize {
        let set = self.set_of(gpu, (subject, extent), (wanted, side));
        for (layer, map) in wanted.iter().enumerate() {
            let work = self.sets[set].work_on(scene, camera, (layer, map));
            orders.0.extend(work.map(|work| Order { view, set, layer, map: *map, work }));
        }
        set
    }

    fn set_of(
        &mut self,
        gpu: &Gpu,
        (subject, extent): (&Subject, Bounds),
        (wanted, side): (&[ShadowMap], u32),
    ) -> usize {
        let in_use = self.in_use_from(side, wanted.len());
        let fitting = self.sets.iter().enumerate().filter_map(|(at, set)| {
            let equal = set.equal_to(subject, (wanted, side))?;
            let is_free = set.used < in_use || equal[0] == wanted.len();
            is_free.then_some((equal, at))
        });
        let found = fitting.max().map(|(_, at)| at);
        // Of another place of the same camera, or of another scene: its memory is used again.
        let has_room = |set: &MapSet| set.used < in_use && set.has_size(side, wanted.len());
        let at = found.or_else(|| self.sets.iter().position(has_room));
        let size = (side, wanted.len());
        let at = at.unwrap_or_else(|| self.add(gpu, (subject, extent), size, in_use));
        self.sets[at].set_subject(subject, extent);
        self.sets[at].used = self.frame;
        at
    }

    /// The number of the frame from which on sets are in use, where one of this size is wanted.
    fn in_use_from(&self, side: u32, count: usize) -> u64 {
        let of_round = self.sets.iter().filter(|set| set.used >= self.round);
        let bytes = of_round.map(MapSet::bytes).sum::<u64>() + MapSet::bytes_of(side, count);
        if bytes <= ROUND_BYTES_MAX { self.round } else { self.frame }
    }

    /// Adds a set of so many maps, and makes room for it: sets keep their places while a frame is
    /// drawn, so what leaves its memory is empty until the next one begins.
    fn add(
        &mut self,
        gpu: &Gpu,
        of: (&Subject, Bounds),
        (side, count): (u32, usize),
        in_use: u64,
    ) -> usize {
        let mut all = self.bytes() + MapSet::bytes_of(side, count);
        let is_free = |at: &usize| self.sets[*at].used < in_use;
        let mut free: Vec<usize> = (0..self.sets.len()).filter(is_free).collect();
        free.sort_by_key(|at| self.sets[*at].used);
        for at in free {
            if all <= BYTES_MAX {
                break;
            }
            all -= self.sets[at].bytes();
            self.sets[at] = MapSet::empty(gpu, of);
        }
        self.sets.push(MapSet::new(gpu, of, side, count));
        self.sets.len() - 1
    }

    /// Bytes of all maps, without those of what stands still.
    pub fn bytes(&self) -> u64 {
        self.sets.iter().map(MapSet::bytes).sum()
    }

    /// Draws the maps that were ordered.
    ///
    /// # Errors
    /// One map has more than is held for one frame.
    pub fn draw(
        &mut self,
        (frames, pass): (&mut FrameResources, &CasterPass),
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &MapOrders),
    ) -> Result<(), DrawError> {
        let mut left = &orders.0[..];
        while !left.is_empty() {
            match self.encode((frames, pass), gpu, scene, (shown, left)) {
                Ok(count) => left = &left[count..],
                Err(error) => {
                    for of in left {
                        self.sets[of.set].forget(of.layer);
                    }
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Draws some of these maps, at least one, from the first on, and returns their number.
    fn encode(
        &mut self,
        (frames, pass): (&mut FrameResources, &CasterPass),
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &[Order]),
    ) -> Result<usize, DrawError> {
        frames.clear_lists();
        let (mut passes, mut count) = (Passes::default(), 0);
        while count < orders.len()
            && passes.lists.len() + PASSES_OF_MAP <= PASSES_TOGETHER_MAX
            && frames.records.len() < RECORDS_TOGETHER
        {
            let order = &orders[count];
            self.plan(&mut *frames, (gpu, scene), (&shown[order.view].0, order), &mut passes);
            check_records(gpu, frames.records.len())
                .map_err(|reason| DrawError::View { index: order.view, reason })?;
            count += 1;
        }
        let Passes { lists, views, steps } = passes;
        let timer = frames.timer.clone();
        let pipelines = pass.pipelines(&scene.layout.keys, Sides::Both);
        let bindings = FrameBindings { pipelines, ..FrameBindings::default() };
        let context = frames.context(gpu, bindings, scene, views.iter().collect(), &lists);
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("shadows") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        timer.begin(&mut encoder);
        for step in &steps {
            match step {
                Step::Pass(list, map, keeps) => {
                    let mut pass = shadow::begin(&mut encoder, map, *keeps);
                    context.draw(&mut pass, *list, ListPart::Opaque);
                }
                Step::Copy(set, layer) => self.sets[*set].copy_still(&mut encoder, *layer),
            }
        }
        timer.end(&mut encoder, FramePass::Shadows);
        gpu.queue.submit([encoder.finish()]);
        Ok(count)
    }

    /// Adds the passes of a map.
    fn plan(
        &mut self,
        frames: &mut FrameResources,
        (gpu, scene): (&Gpu, &GpuScene),
        (camera, order): (&ViewDesc, &Order),
        passes: &mut Passes,
    ) {
        let Order { set, layer, map, work, .. } = order;
        let light = map.view(camera);
        let of_set = &mut self.sets[*set];
        let still = of_set.still(*layer, map).is_some();
        let of = (ShadowItems::Still, &of_set.subject().turns[..]);
        let still = (!still).then(|| map.casting(scene, camera, of));
        let mut add = |casting: &_, items: &[u32], map, keeps| {
            let (scratch, records) = (&mut frames.scratch, &mut frames.records);
            let list = DrawList::new(scene, &light, (casting, items), scratch, records);
            passes.steps.push(Step::Pass(passes.lists.len(), map, keeps));
            passes.lists.push(list);
            passes.views.push(light.clone());
        };
        match (work, still) {
            (MapWork::Still, Some((casting, receives))) => {
                // Nothing is looked up in a map that nothing receives shadows from.
                let items = if receives { &casting.items[..] } else { &[] };
                add(&casting, items, of_set.map(*layer).clone(), false);
            }
            (MapWork::Still, None) => passes.steps.push(Step::Copy(*set, *layer)),
            (MapWork::Moving(moving), still) => {
                let is_copied = !gpu.is_gl();
                let onto = of_set.map(*layer).clone();
                if let Some((casting, receives)) = still {
                    // A map that cannot be copied is drawn where it is read.
                    let still = is_copied.then(|| of_set.begin_still(gpu, (*layer, map, receives)));
                    add(&casting, &casting.items, still.unwrap_or_else(|| onto.clone()), false);
                }
                add(moving, &moving.items, onto, true);
                if is_copied {
                    let at = passes.steps.len() - 1;
                    passes.steps.insert(at, Step::Copy(*set, *layer));
                }
            }
        }
    }
}
