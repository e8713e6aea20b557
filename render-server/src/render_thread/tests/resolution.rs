//! Channels of fewer pixels than the wall's: where their pictures are, and what of a border is
//! seen.

use glam::{DAffine3, DQuat, Vec4};
use polyptych_renderer::read_picture;
use polyptych_scene::{AlphaMode, Light, LightKind, Material};
use polyptych_wall::view::{Area, View, ViewProjection};
use polyptych_wall::{FrustumMode, StereoPacking};

use super::*;
use crate::correction::tests::harness::{MeshFixture, SceneFixture, gpu, matt};

/// Pixels of the screen; of odd sides, so that no resolution divides them.
const CANVAS: UVec2 = UVec2::new(322, 181);

/// A picture with its size.
struct Drawn {
    size: [usize; 2],
    pixels: Vec<[u8; 4]>,
}

impl Drawn {
    fn at(&self, x: usize, y: usize) -> [u8; 4] {
        self.pixels[y * self.size[0] + x]
    }

    /// The largest difference of a level, and the mean of all.
    fn difference(&self, other: &Self, shift: usize) -> (u8, f64) {
        assert_eq!(self.size, other.size);
        let [width, height] = self.size;
        let (mut most, mut sum) = (0, 0u64);
        for y in 0..height {
            for x in 0..width - shift {
                for (a, b) in self.at(x, y).iter().zip(other.at(x + shift, y)) {
                    most = most.max(a.abs_diff(b));
                    sum += u64::from(a.abs_diff(b));
                }
            }
        }
        (most, sum as f64 / (4 * height * (width - shift)) as f64)
    }
}

impl Drawn {
    fn off_by_more_than_one(&self, other: &Self) -> usize {
        let off = |(a, b): &(&[u8; 4], &[u8; 4])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 1);
        self.pixels.iter().zip(&other.pixels).filter(off).count()
    }
}

/// Balls before and behind each other, some of glass if wanted.
fn balls(has_glass: bool) -> SceneFixture {
    let mut stage = SceneFixture::new();
    stage.light(
        Light { kind: LightKind::Directional, color: Vec3::ONE, intensity: 2.0, range: None },
        DAffine3::from_rotation_x(-0.7),
    );
    let glass = Material {
        alpha_mode: AlphaMode::Blend,
        base_color: Vec4::new(0.3, 0.7, 0.9, 0.4),
        ..matt(0.3, 0.7, 0.9)
    };
    let materials = [matt(0.8, 0.2, 0.1), matt(0.2, 0.7, 0.3), glass];
    let shape = MeshFixture::sphere(16);
    let meshes: Vec<u32> = materials
        .into_iter()
        .map(|material| {
            let material = stage.material(material);
            stage.mesh(&shape, Some(material))
        })
        .collect();
    let kinds = if has_glass { 3 } else { 2 };
    for at in 0..120 {
        let (column, row) = (f64::from(at % 15) - 7.0, f64::from(at / 15) - 3.5);
        let place = DVec3::new(column * 0.7, row * 0.7, -4.0 - f64::from(at % 4));
        let place = DAffine3::from_translation(place);
        let mesh = meshes[at as usize % kinds];
        stage.node(mesh, place * DAffine3::from_scale(DVec3::splat(0.3)));
    }
    stage
}

/// A screen cut into so many columns.
fn tiles(columns: u32) -> Wall {
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(3.22, 1.81));
    let screens = vec![Screen::new("front", Surface::Plane(plane), CANVAS)];
    let width = CANVAS.x / columns;
    let channels = (0..columns).map(|column| {
        let (at, size) = (UVec2::new(column * width, 0), UVec2::new(width, CANVAS.y));
        Channel::tile(&format!("tile-{column}"), 0, at, size)
    });
    Wall { near_m: 0.1, ..Wall::new("test", screens, channels.collect()) }
}

/// Changes all channels of a wall.
fn with(mut wall: Wall, change: impl Fn(&mut Channel)) -> Wall {
    wall.channels.iter_mut().for_each(change);
    wall
}

/// Draws a frame of a wall by the thread, with the resolution lowered by so many steps after each
/// other, and returns the pictures of all channels for each of these.
fn drawn(wall: &Wall, scene: &SceneFixture, views: &[View], steps: &[u8]) -> Vec<Vec<Drawn>> {
    let names: Vec<String> = wall.channels.iter().map(|channel| channel.name.clone()).collect();
    let outputs = names.iter().map(|name| ChannelOutput::new(name.clone(), None, None)).collect();
    let (_jobs, waiting_jobs) = bounded(1);
    let (_uploads, waiting_uploads) = bounded(1);
    let (reporter, mut reports) = mpsc::channel(100);
    let queues = Queues {
        jobs: waiting_jobs,
        uploads: waiting_uploads,
        reports: reporter,
        monitor_names: None,
    };
    let identity = ServerInfo { server: "left".into(), adapter: "a pencil".into() };
    let (present_delay, slowness) = (Duration::ZERO, DrawDelay::new(None));
    let drawing = DrawOptions { present_delay, slowness, culls_occluded: true };
    let clock = Arc::new(Clock::default());
    let thread = RenderThread::new(gpu().clone(), outputs, queues, clock, identity, drawing);
    let mut thread = thread.expect("a renderer");
    let maps = CalibrationMaps::default();
    let plans = correction::correction_plans(wall, &maps, &names, None).expect("plans");
    let operations = vec![Operation::SetWall(Box::new(wall.clone()))];
    let replica = Replica::from_snapshot(Revision(1), operations);
    let state = Arc::new(LoadedState {
        environment: None,
        epoch: EPOCH,
        digest: replica.digest(),
        replica,
        scene: None,
        warm_up: Camera::IDENTITY,
        plans: Arc::new(plans),
        maps,
        shapes: Arc::default(),
        motion: None,
    });
    finish(&mut thread, Arc::clone(&state));
    let scene = Rc::new(scene.build());
    thread.prepare(&state, &scene);
    thread.states.back_mut().expect("a state").scene = scene;
    let head = HeadPose::facing_forward(DVec3::ZERO, 0.06);
    let presentation = Presentation { views: views.to_vec(), ..Presentation::new(head) };
    let mut all = Vec::new();
    for (number, &resolution_steps) in (1..).zip(steps) {
        let frame = Frame {
            epoch: EPOCH,
            frame: FrameId(number),
            time_s: 0.0,
            revision: Revision(1),
            presentation: presentation.clone(),
            capture: None,
            detail: DetailBound { resolution_steps, ..DetailBound::default() },
            clips: Vec::new(),
            is_metered: false,
        };
        thread.draw(&frame);
        for _ in &names {
            match reports.try_recv().expect("a report") {
                RenderEvent::Status(ServerMessage::Drawn(_)) => {}
                other => panic!("{other:?}"),
            }
        }
        let pictures = thread.outputs.iter().map(|output| {
            let picture = output.picture().expect("a picture");
            let bytes = read_picture(gpu(), picture).expect("read back");
            let size = picture.size().map(|side| side as usize);
            Drawn { size, pixels: bytes.as_chunks::<4>().0.to_vec() }
        });
        all.push(pictures.collect());
    }
    all
}

/// Pictures beside each other.
fn stitched(all: &[Drawn]) -> Drawn {
    let height = all[0].size[1];
    let width = all.iter().map(|drawn| drawn.size[0]).sum();
    let rows = (0..height).flat_map(|y| {
        all.iter().flat_map(move |drawn| (0..drawn.size[0]).map(move |x| drawn.at(x, y)))
    });
    Drawn { size: [width, height], pixels: rows.collect() }
}

#[test]
fn tiles_of_fewer_pixels_have_no_seam() {
    let steps = [1, 2, 3, 4, 5, 8];
    for (has_glass, samples) in [(false, 1), (false, 4), (true, 1), (true, 4)] {
        let scene = balls(has_glass);
        let whole = drawn(&Wall { samples, ..tiles(1) }, &scene, &[], &steps);
        for columns in [2, 7] {
            let tiled = drawn(&Wall { samples, ..tiles(columns) }, &scene, &[], &steps);
            for ((whole, tiled), steps) in whole.iter().zip(&tiled).zip(steps) {
                let tiled = stitched(tiled);
                let (most, mean) = whole[0].difference(&tiled, 0);
                let off = whole[0].off_by_more_than_one(&tiled);
                let case = format!("{columns} tiles, {steps} steps, {samples} samples");
                println!("{case}: at most {most} levels, mean {mean:.5}, {off} pixels by over one");
                // As with all pixels, f32 may round an edge to another sample in another tile.
                assert!(off <= 12 && mean < 0.002, "{case}");
                if samples == 1 {
                    // 1 by a software driver; 3 by an H200, which filters with fractions of 1/256.
                    assert!(most <= 3, "{case}: {most}");
                }
            }
        }
    }
}

#[test]
fn channels_of_fewer_pixels_show_the_same_at_the_same_place() {
    let bright = |channel: &mut Channel| channel.adjustment.color.gain = DVec3::splat(0.8);
    let packed = |packing| move |channel: &mut Channel| channel.adjustment.packing = packing;
    let cylinder = Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-0.8, 0.8],
        height_m: [-0.9, 0.9],
    };
    let curved = Wall {
        screens: vec![Screen::new("front", Surface::Cylinder(cylinder), CANVAS)],
        ..tiles(1)
    };
    let inset = View {
        area: Area::Screen { screen: 0, rect: [190, 20, 101, 73] },
        projection: ViewProjection::Perspective { fov_y_rad: 0.8 },
        ..View::of_wall(Camera::IDENTITY)
    };
    let walls = [
        ("plain", tiles(1), vec![]),
        ("with a view in it", tiles(1), vec![inset]),
        (
            "with a frustum of its own",
            with(tiles(1), |it| it.projection = FrustumMode::Own),
            vec![],
        ),
        ("corrected", with(tiles(1), bright), vec![]),
        ("two tiles, corrected", with(tiles(2), bright), vec![]),
        ("both eyes", with(tiles(1), packed(StereoPacking::SideBySide)), vec![]),
        ("both eyes above each other", with(tiles(1), packed(StereoPacking::TopBottom)), vec![]),
        ("curved", curved, vec![]),
    ];
    for (name, wall, views) in walls {
        let scene = balls(name == "plain");
        // And all pixels again, bit for bit.
        let all = drawn(&wall, &scene, &views, &[0, 4, 8, 2, 0]);
        for (index, full) in all[0].iter().enumerate() {
            let off = |frame: usize, shift| full.difference(&all[frame][index], shift);
            assert!(off(0, 9).1 > 1.0, "{name}: something is seen");
            assert_eq!(off(4, 0), (0, 0.0), "{name}: all pixels again");
            let [fine, half, quarter] = [3, 1, 2].map(|frame| off(frame, 0).1);
            assert!(0.0 < fine && fine < half && half < quarter, "{name}: no fewer pixels");
            // A picture that is beside its place by two pixels differs more.
            assert!(half < off(1, 2).1 && fine < off(3, 2).1, "{name}: beside its place");
        }
    }
}
