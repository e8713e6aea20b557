//! Lets nodes of a scene sail in circles around their places, those whose names begin so:
//! `sail SCENE.glb NAME [SECONDS] [HOST:PORT]`, such as `sail town.glb boat`.
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use polyptych_client::glam::{DAffine3, DVec3};
use polyptych_client::{NodeQuery, Transaction, blocking::Client, fit_bounds};

/// One circle in this many seconds.
const CIRCLE_S: f64 = 12.0;

fn sail() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, name, rest @ ..] = &arguments[..] else {
        return Err("usage: sail SCENE.glb NAME [SECONDS] [HOST:PORT]".into());
    };
    let seconds: f64 = rest.first().map_or(Ok(10.0), |text| text.parse())?;
    let wall = Client::connect(rest.get(1).map_or("127.0.0.1:7878", String::as_str))?;
    let scene = wall.open_scene(path)?;
    if let Some(bounds) = scene.bounds {
        wall.set_camera(fit_bounds(&wall.wall()?, &bounds, 0.6))?;
    }
    let mut fleet = wall.find_all_nodes(NodeQuery::default())?;
    fleet.retain(|node| node.name.starts_with(name.as_str()));
    if fleet.is_empty() {
        return Err(format!("no node of {path} has a name that begins with {name}").into());
    }

    let length = Duration::try_from_secs_f64(seconds)?;
    let (start, mut waits) = (Instant::now(), Vec::new());
    while start.elapsed() < length {
        let (sin, cos) = (start.elapsed().as_secs_f64() / CIRCLE_S * TAU).sin_cos();
        let mut transaction = Transaction::default();
        for node in &fleet {
            let away = DVec3::new(cos - 1.0, 0.0, sin) * 8.0;
            let turn = DAffine3::from_rotation_y(-sin.atan2(cos));
            let here = DAffine3::from_translation(away) * node.local;
            transaction.set_transform(node.id, here * turn);
        }
        let asked = Instant::now();
        // It is seen once this returns: a paused wall draws a frame for it.
        wall.commit(transaction)?;
        waits.push(asked.elapsed());
    }
    waits.sort_unstable();
    let (median, count) = (waits[waits.len() / 2], waits.len());
    println!("{} nodes, {count} transactions, {median:?} each until it was seen", fleet.len());
    Ok(())
}

fn main() {
    if let Err(error) = sail() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}
