//! Puts a clock tower into a scene, whose hands show the time (UTC), for as long as it runs:
//! `clock SCENE.glb [SECONDS] [HOST:PORT]`, such as `clock town.glb 60`.
use std::f64::consts::{FRAC_PI_2, TAU};
use std::time::{Duration, Instant, SystemTime};

use polyptych_client::glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_client::{
    Assets, Bounds, Material, MeshData, NewNode, NodeId, Transaction, blocking::Client, fit_bounds,
};

/// Time between two moves of the hands.
const STEP: Duration = Duration::from_millis(50);

fn placed(parent: Option<NodeId>, local: DAffine3, mesh: Option<u32>) -> NewNode {
    NewNode { parent, local, mesh, ..NewNode::default() }
}

fn clock() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, rest @ ..] = &arguments[..] else {
        return Err("usage: clock SCENE.glb [SECONDS] [HOST:PORT]".into());
    };
    let seconds: f64 = rest.first().map_or(Ok(10.0), |text| text.parse())?;
    let wall = Client::connect(rest.get(1).map_or("127.0.0.1:7878", String::as_str))?;
    let bounds = wall.open_scene(path)?.bounds.ok_or("the scene is empty")?;
    let (foot, size) = (bounds.center(), bounds.radius() * 0.06);
    let (min, max) = (DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 4.0, 1.0));
    let around = Bounds { min: foot + min * size, max: foot + max * size };
    wall.set_camera(fit_bounds(&wall.wall()?, &around, 0.3))?;

    let mut assets = Assets::default();
    let paint = |assets: &mut Assets, r: f32, g: f32, b: f32| {
        let base_color = Vec4::new(r, g, b, 1.0);
        assets.add_material(Material { base_color, ..Assets::matt() })
    };
    let [stone, white, black] = [(0.4, 0.35, 0.3), (0.9, 0.9, 0.85), (0.02, 0.02, 0.02)]
        .map(|(r, g, b)| paint(&mut assets, r, g, b));
    let tower = assets.add_mesh(MeshData::cuboid(Vec3::new(1.0, 4.0, 1.0)), Some(stone));
    let face = assets.add_mesh(MeshData::cylinder(0.45, 0.05), Some(white));
    let hands = [(0.08, 0.25), (0.05, 0.38), (0.02, 0.42)].map(|(width, length)| {
        assets.add_mesh(MeshData::cuboid(Vec3::new(width, length, 0.02)), Some(black))
    });

    // All of it ends with this client.
    let mut build = Transaction::temporary().with_assets(assets.to_source()?);
    let place = DAffine3::from_translation(foot) * DAffine3::from_scale(DVec3::splat(size));
    let root = build.create(placed(None, place, None));
    build.create(placed(Some(root), DAffine3::from_translation(DVec3::Y * 2.0), Some(tower)));
    let front = DAffine3::from_translation(DVec3::new(0.0, 3.5, 0.5));
    let turned = front * DAffine3::from_rotation_x(FRAC_PI_2);
    build.create(placed(Some(root), turned, Some(face)));
    let hands = [(0, 0.125), (1, 0.19), (2, 0.21)].map(|(index, up)| {
        let axis = build.create(placed(Some(root), front, None));
        let ahead = DVec3::new(0.0, up, 0.04 + 0.02 * f64::from(index));
        let mesh = Some(hands[index as usize]);
        build.create(placed(Some(axis), DAffine3::from_translation(ahead), mesh));
        axis
    });
    let built = wall.commit(build)?;
    let hands = hands.map(|hand| built.node(hand).expect("it was made"));

    let (start, mut moves) = (Instant::now(), 0);
    while start.elapsed().as_secs_f64() < seconds {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_secs_f64();
        let mut tick = Transaction::default();
        for (hand, period_s) in hands.into_iter().zip([43_200.0, 3_600.0, 60.0]) {
            let angle = -TAU * (now / period_s).fract();
            tick.set_transform(hand, front * DAffine3::from_rotation_z(angle));
        }
        // It is seen once this returns: a paused wall draws a frame for it.
        wall.commit(tick)?;
        moves += 1;
        std::thread::sleep(STEP);
    }
    println!("{} nodes were made, and moved {moves} times", built.created.len());
    Ok(())
}

fn main() {
    if let Err(error) = clock() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}
