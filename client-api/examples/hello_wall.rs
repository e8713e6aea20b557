//! Shows a scene on a wall of one channel or thirty: `hello_wall SCENE.glb [HOST:PORT]`.
use std::process::ExitCode;

use polyptych_client::{blocking::Client, fit_bounds};

/// Returns whether every display shows the scene.
fn show() -> Result<bool, Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: hello_wall SCENE.glb [HOST:PORT]")?;
    let address = arguments.next().unwrap_or_else(|| "127.0.0.1:7878".into());

    let wall = Client::connect(&address)?;
    let scene = wall.open_scene(path)?;
    if let Some(bounds) = scene.bounds {
        wall.set_camera(fit_bounds(&wall.wall()?, &bounds, 0.6))?;
    }
    let drawn = wall.render_frame()?;
    let (shown, all) = (drawn.shown_channels().count(), drawn.channels.len());
    let (name, frame, us) = (scene.name, drawn.frame, drawn.frame_us);
    println!("{name}: frame {frame} on {shown} of {all} channels in {us} us");
    for channel in drawn.missing_channels() {
        let reason = channel.reason.as_deref().unwrap_or("nobody knows why");
        eprintln!("channel {} does not show it: it is {}: {reason}", channel.name, channel.state);
    }
    Ok(drawn.is_complete())
}

fn main() -> ExitCode {
    match show() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(3),
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
