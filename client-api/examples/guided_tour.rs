//! Goes round a scene through places that it stores, and captures the way:
//! `guided_tour SCENE.glb [HOST:PORT]`.
//!
//! The manager moves the camera as a function of scene time. This program gives that time with
//! every frame, so the pictures are a film, however long each takes.

use std::error::Error;
use std::f64::consts::TAU;

use polyptych_client::blocking::Client;
use polyptych_client::{Tour, TourStop, orbit};

/// Sides from which the scene is seen.
const SIDES: [&str; 4] = ["south", "east", "north", "west"];

/// Seconds from one side to the next.
const TRAVEL_S: f64 = 2.0;

/// Pictures of the whole way.
const PICTURES: u32 = 5;

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: guided_tour SCENE.glb [HOST:PORT]")?;
    let wall = Client::connect(arguments.next().as_deref().unwrap_or("127.0.0.1:7878"))?;

    let bounds = wall.open_scene(path)?.bounds.ok_or("the scene is empty")?;
    let description = wall.wall()?;
    for (side, name) in (0..).zip(SIDES) {
        let camera = orbit(&description, &bounds, f64::from(side) / 4.0 * TAU);
        // A little nearer than all of it needs.
        let camera = camera.towards_box(description.eye, bounds.min, bounds.max, 0.2);
        wall.store_view(name, Some(camera))?;
    }
    let views = wall.stored_views()?;
    let stops = SIDES.iter().filter_map(|side| views.iter().find(|view| view.name == *side));
    let stops: Vec<_> = stops.map(|view| TourStop::new(view.camera, TRAVEL_S)).collect();
    let length_s = TRAVEL_S * stops.len() as f64;

    wall.pause()?;
    wall.play_tour(Tour { stops, is_loop: false })?;
    for picture in 0..PICTURES {
        let time_s = length_s * f64::from(picture) / f64::from(PICTURES - 1);
        let capture = wall.capture_at(Some(time_s))?;
        let at = wall.presentation()?.camera.position;
        println!("frame {} at {time_s:.2} s from {at:.2}", capture.frame);
        for (channel, reason) in &capture.missing {
            println!("{channel} is not in it: {reason}");
        }
    }
    Ok(())
}
