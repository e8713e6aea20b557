//! Shadows of what moves: as a renderer draws them that has seen nothing else, bit for bit, and
//! without drawing what stands still.

use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};
use polyptych_scene::{
    AlphaMode, ChangedMaterial, Facing, Light, LightKind, Material, MaterialProperty, NodeTraits,
};
use polyptych_wall::ShadowFilter;
use proptest::prelude::*;

use super::harness::{MeshFixture, SceneFixture, differences, draw, gpu, look};
use super::shadows::{Stage, cube, grey, town};
use crate::{GpuScene, MovedNode, ViewDesc};

const SIZE: [u32; 2] = [160, 120];

/// Nodes of [`fixture`]: boxes of the town, and what stands behind them.
const BOX: u32 = 1;
const HIDDEN_BOX: u32 = 2;
const PANE: u32 = 6;
const SIGN: u32 = 7;
const LAMP: u32 = 9;

/// The lamp at rest.
const LAMP_AT: DVec3 = DVec3::new(1.0, 5.0, 3.0);

/// The town with a sun and a lamp, a pane with a mask, and a sign that faces the viewer.
fn fixture() -> (SceneFixture, NodeTraits) {
    let mut stage = town(DVec3::ZERO, grey(), &[DVec3::new(0.5, 0.8, 0.3).normalize()]);
    let sun = stage.desc.nodes.pop().expect("the town has a sun");
    let masked = Material {
        alpha_mode: AlphaMode::Mask(0.5),
        base_color: Vec4::new(0.6, 0.6, 0.6, 1.0),
        double_sided: true,
        ..grey()
    };
    let masked = stage.material(masked);
    let grey = stage.material(grey());
    let pane = stage.mesh(&MeshFixture::rectangle(1.0, 0.8), Some(masked));
    let sign = stage.mesh(&cube(), Some(grey));
    let at = |x, y, z| DAffine3::from_translation(DVec3::new(x, y, z));
    assert_eq!(stage.node(pane, at(2.0, 1.5, 3.0)), PANE);
    let thin = DVec3::new(0.8, 1.2, 0.1);
    assert_eq!(stage.node(sign, at(-2.0, 2.0, 3.0) * DAffine3::from_scale(thin)), SIGN);
    stage.desc.nodes.push(sun);
    let lamp =
        Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 40.0, range: Some(9.0) };
    stage.light(lamp, DAffine3::from_translation(LAMP_AT));
    let mut traits = NodeTraits::of_file(stage.desc.nodes.len());
    traits.moving.extend([BOX, HIDDEN_BOX, LAMP]);
    traits.facings = vec![None; stage.desc.nodes.len()];
    traits.facings[SIGN as usize] = Some(Facing::Eye);
    (stage, traits)
}

/// A moment of the town, and where it is seen from.
#[derive(Clone, Debug)]
struct Moment {
    /// The box may leave the floor, to where nothing is below it.
    box_at: DVec3,
    is_hidden: bool,
    alpha: f64,
    /// `None` where it is not moved.
    lamp_at: Option<DVec3>,
    eye: DVec3,
}

fn moment() -> impl Strategy<Value = Moment> {
    let near = |far: f64| prop::array::uniform3(-far..far).prop_map(DVec3::from);
    let box_at = prop_oneof![3 => near(6.0), 1 => near(90.0)];
    let eye = prop_oneof![2 => Just(DVec3::ZERO), 1 => near(4.0)];
    let lamp = prop::option::weighted(0.3, near(2.0));
    (box_at, any::<bool>(), prop::sample::select(vec![0.2, 0.8]), lamp, eye).prop_map(
        |(box_at, is_hidden, alpha, lamp_at, eye)| Moment {
            box_at,
            is_hidden,
            alpha,
            lamp_at,
            eye,
        },
    )
}

impl Moment {
    fn scene(&self, still: &GpuScene) -> GpuScene {
        let place = |at| DAffine3::from_translation(at + DVec3::Y * 2.0);
        let world = DAffine3::from_translation(DVec3::new(3.5, 2.0, -2.0));
        let hidden =
            MovedNode { is_hidden: self.is_hidden, ..MovedNode::new(HIDDEN_BOX, world, &[]) };
        let lamp = LAMP_AT + self.lamp_at.unwrap_or_default();
        let nodes = [
            MovedNode::new(BOX, place(self.box_at), &[]),
            hidden,
            MovedNode::new(LAMP, DAffine3::from_translation(lamp), &[]),
        ];
        let color = (MaterialProperty::BaseColor, vec![0.6, 0.6, 0.6, self.alpha]);
        let material = ChangedMaterial { material: 2, values: vec![color] };
        still.at_moment(gpu(), &nodes, &[], &[material]).expect("it moves")
    }

    fn view(&self) -> ViewDesc {
        let eye = DVec3::new(3.0, 5.0, 11.0) + self.eye;
        look(eye, DVec3::new(0.0, 0.5, -1.0), SIZE)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]
    #[test]
    fn maps_of_what_moves_do_not_depend_on_the_past(
        moments in prop::collection::vec(moment(), 2..6),
        soft in any::<bool>(),
    ) {
        let (fixture, traits) = fixture();
        let still = fixture.build_with(&traits);
        let filter = if soft { ShadowFilter::Soft } else { ShadowFilter::Hard };
        let mut stage = Stage::new(still.clone(), SIZE, filter);
        for moment in moments {
            let view = moment.view();
            stage.scene = moment.scene(&still);
            let got = stage.draw(&view).0;
            let wanted = Stage::new(stage.scene.clone(), SIZE, filter).draw(&view).0;
            prop_assert_eq!(differences(&got, &wanted), [0; 3], "{:?}", moment);
            // Nothing changes, so nothing is drawn.
            prop_assert_eq!(stage.draw(&view).1.shadow_maps, 0);
        }
        // All of it stands still again.
        let view = look(DVec3::new(3.0, 5.0, 11.0), DVec3::new(0.0, 0.5, -1.0), SIZE);
        stage.scene = still.at_moment(gpu(), &[], &[], &[]).expect("it moves");
        let got = stage.draw(&view).0;
        let wanted = Stage::new(stage.scene.clone(), SIZE, filter).draw(&view).0;
        prop_assert_eq!(differences(&got, &wanted), [0; 3]);
    }
}

#[test]
fn moments_are_drawn_as_scenes_that_were_laid_out_so() {
    let (fixture, traits) = fixture();
    let still = fixture.build_with(&traits);
    let mut stage = Stage::new(still.clone(), SIZE, ShadowFilter::Soft);
    for step in 0..5 {
        let at = DVec3::new(f64::from(step), 1.0, 0.0);
        let moment = Moment {
            box_at: at,
            is_hidden: step == 3,
            alpha: 1.0,
            lamp_at: None,
            eye: DVec3::ZERO,
        };
        stage.scene = moment.scene(&still);
        let got = stage.draw(&moment.view()).0;
        let (mut other, traits) = self::fixture();
        let turn = DQuat::IDENTITY;
        let at = at + DVec3::Y * 2.0;
        other.desc.nodes[BOX as usize].local =
            DAffine3::from_scale_rotation_translation(DVec3::ONE, turn, at);
        other.desc.nodes[HIDDEN_BOX as usize].local =
            DAffine3::from_translation(DVec3::new(3.5, 2.0, -2.0));
        if step == 3 {
            other.desc.nodes[HIDDEN_BOX as usize].mesh = None;
        }
        let wanted = draw(&other.build_with(&traits), SIZE, &moment.view());
        assert_eq!(differences(&got, &wanted), [0; 3], "step {step}");
    }
}

#[test]
fn lamps_whose_reach_nothing_moves_in_keep_their_maps() {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    let grey = stage.material(grey());
    let floor = stage.mesh(&MeshFixture::rectangle(60.0, 60.0), Some(grey));
    let shape = stage.mesh(&cube(), Some(grey));
    stage.node(floor, DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    let moving = stage.node(shape, DAffine3::from_translation(DVec3::new(-20.0, 1.0, 0.0)));
    for x in [-20.0, 0.0, 20.0] {
        stage.node(shape, DAffine3::from_translation(DVec3::new(x, 1.0, 4.0)));
        let kind = LightKind::Spot { inner_rad: 0.5, outer_rad: 0.7 };
        let lamp = Light { kind, color: Vec3::ONE, intensity: 60.0, range: Some(8.0) };
        let down = DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        stage.light(lamp, DAffine3::from_translation(DVec3::new(x, 6.0, 2.0)) * down);
    }
    let still = stage.build();
    let mut stage = Stage::new(still.clone(), SIZE, ShadowFilter::Soft);
    let view = look(DVec3::new(0.0, 12.0, 30.0), DVec3::ZERO, SIZE);
    let mut drawn_at = |x: f64| {
        let place = DAffine3::from_translation(DVec3::new(x, 1.0, 0.0));
        let nodes = [MovedNode::new(moving, place, &[])];
        stage.scene = still.at_moment(gpu(), &nodes, &[], &[]).expect("it moves");
        let (got, stats) = stage.draw(&view);
        assert_eq!(differences(&got, &draw(&stage.scene, SIZE, &view)), [0; 3], "at {x}");
        stats.shadow_maps
    };
    assert_eq!(drawn_at(-20.0), 3, "all of them at first");
    assert_eq!(drawn_at(-19.0), 1, "the lamp that it moves under");
    assert_eq!(drawn_at(-10.0), 1, "it has left that lamp");
    assert_eq!(drawn_at(-9.5), 0, "it is between lamps");
    assert_eq!(drawn_at(0.0), 1, "another lamp");
    assert_eq!(drawn_at(20.0), 2, "from one to the other");
}
