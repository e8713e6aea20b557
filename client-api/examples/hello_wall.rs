//! Shows a scene on a wall of one channel or thirty: `hello_wall SCENE.glb [HOST:PORT]`.
use polyptych_client::{blocking::Client, overview};

fn show() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: hello_wall SCENE.glb [HOST:PORT]")?;
    let address = arguments.next().unwrap_or_else(|| "127.0.0.1:7878".into());

    let wall = Client::connect(&address)?;
    let scene = wall.open_scene(path)?;
    if let Some(bounds) = scene.bounds {
        wall.set_camera(overview(&wall.wall()?, &bounds, 0.6))?;
    }
    let drawn = wall.render_frame()?;
    let (us, channels) = (drawn.frame_us, drawn.channels.len());
    println!("{}: frame {} on {channels} channels in {us} us", scene.name, drawn.frame);
    Ok(())
}

fn main() {
    show().unwrap_or_else(|error| {
        eprintln!("{error}");
        std::process::exit(1);
    });
}
