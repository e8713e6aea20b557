//! Light from all around, from a file to all displays; and tone mappers.

use std::path::Path;

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ChannelState, EnvironmentSource, ToneMapper};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

const VIEW: Camera = Camera { position: DVec3::new(0.3, 0.3, 1.5), ..Camera::IDENTITY };

/// A polished triangle, and the sun that it stands in.
fn triangle() -> Vec<u8> {
    let gltf = Gltf::triangle().with(|gltf| {
        gltf.json["materials"] = json!([{
            "doubleSided": true,
            "pbrMetallicRoughness": { "roughnessFactor": 0.2, "metallicFactor": 1.0 },
        }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    });
    gltf.glb()
}

/// Two matt triangles that meet at a right angle, one on the ground.
fn corner() -> Vec<u8> {
    let gltf = Gltf::triangle().with(|gltf| {
        gltf.json["materials"] = json!([{
            "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0.0 },
        }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        gltf.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "rotation": [half, 0, 0, half] }]);
        gltf.json["scenes"][0]["nodes"] = json!([0, 1]);
    });
    gltf.glb()
}

/// A Radiance file: dim, with a bright half around +X, and blue above.
fn hdr() -> Vec<u8> {
    let (width, height) = (64, 32);
    let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n");
    let mut bytes = head.into_bytes();
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let bright: u8 = if (16..48).contains(&x) { 200 } else { 60 };
        let blue: u8 = if y < height / 2 { 220 } else { 30 };
        bytes.extend([bright, 90, blue, 127]);
    }
    bytes
}

/// The triangle, amid faces of a cube that shine brighter than 1; their images are files beside it.
fn lit_triangle(place: &TestDir) {
    let name = "EXT_lights_image_based";
    let images = [250, 20, 90, 90, 60, 100].map(|red| {
        let picture = RgbaImage::from_pixel(4, 4, image::Rgba([red, 120, 60, 85]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, image::ImageFormat::Png).expect("encoded");
        place.write(&format!("face{red}.png"), bytes.get_ref());
        json!({ "uri": format!("face{red}.png") })
    });
    let gltf = Gltf::triangle().with(|gltf| {
        gltf.json["images"] = json!(images);
        gltf.json["extensionsUsed"] = json!([name]);
        gltf.json["extensions"] =
            json!({ name: { "lights": [{ "specularImages": [[0, 1, 2, 3, 4, 5]] }] } });
        gltf.json["scenes"][0]["extensions"] = json!({ name: { "light": 0 } });
        gltf.json["materials"] =
            json!([{ "doubleSided": true, "pbrMetallicRoughness": { "roughnessFactor": 0.0 } }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    });
    place.write("lit.glb", gltf.glb());
}

fn wall() -> LocalWall {
    let place = TestDir::new();
    place.write("studio.hdr", hdr());
    place.write("cut.hdr", &hdr()[..500]);
    place.write("words.hdr", "not a picture at all");
    let scene = place.write("triangle.glb", triangle());
    let folder = scene.parent().expect("a folder").to_owned();
    LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT)
}

fn picture(client: &Client) -> RgbaImage {
    screen_of(&shot(client, VIEW))
}

fn file(name: &str) -> EnvironmentSource {
    EnvironmentSource::File { path: name.into() }
}

fn name(client: &Client) -> Option<String> {
    client.status().expect("status").environment
}

#[test]
fn surroundings_come_to_all_displays_and_outlive_servers_and_managers() {
    let mut local = wall();
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    let before = picture(&client);

    client.set_environment(file("studio.hdr")).expect("set");
    assert_eq!(name(&client).as_deref(), Some("studio.hdr"));
    let surrounded = picture(&client);
    assert_ne!(surrounded, before);
    // The camera looks along −Z, a quarter of the picture left of +X: above is blue, and the
    // right half of what is below is brighter than the left one.
    let (width, height) = surrounded.dimensions();
    let [above, left, right] = [(width / 2, 2), (2, height - 3), (width - 3, height - 3)]
        .map(|(x, y)| surrounded.get_pixel(x, y).0);
    assert!(above[2] > above[0].max(above[1]), "{above:?}");
    assert!(right[0] > left[0] + 40, "{left:?} and {right:?}");
    // Both displays agree where they meet: no step of a pixel is larger than elsewhere.
    let row = |x: u32| i32::from(surrounded.get_pixel(x, 2).0[2]);
    assert!((row(width / 2 - 1) - row(width / 2)).abs() <= 2, "a seam in the sky");

    // What cannot be read changes nothing, and says which file and why.
    for (wrong, part) in [
        ("cut.hdr", "cannot be read as Radiance"),
        ("words.hdr", "not a Radiance .hdr"),
        ("triangle.glb", "not a Radiance .hdr"),
        ("none.hdr", "not found"),
        ("../../etc/passwd", "scene folders"),
    ] {
        let reason = client.set_environment(file(wrong)).expect_err(wrong).to_string();
        let asked = Path::new(wrong).file_name().and_then(|name| name.to_str()).unwrap_or(wrong);
        assert!(reason.contains(part) && reason.contains(asked), "{wrong}: {reason}");
    }
    check("as it was", &picture(&client), &surrounded, &IDENTICAL);

    // A server that comes later has it, and so has a manager.
    let server = local.servers.keys().next().expect("a server").clone();
    local.servers.remove(&server).expect("a server").kill();
    local.await_lost(&client, &server);
    local.start_server(&server);
    await_states(&client, &[ChannelState::Live]);
    check("joined", &picture(&client), &surrounded, &IDENTICAL);
    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    assert_eq!(name(&client).as_deref(), Some("studio.hdr"));
    check("restarted", &picture(&client), &surrounded, &IDENTICAL);

    // Another scene stands in the same surroundings, until they are taken away.
    client.close_scene().expect("closed");
    let empty = picture(&client);
    assert_eq!(empty.get_pixel(0, 0), surrounded.get_pixel(0, 0));
    client.open_scene("triangle.glb").expect("opened");
    check("again", &picture(&client), &surrounded, &IDENTICAL);
    client.set_environment(EnvironmentSource::None).expect("set");
    assert_eq!(name(&client), None);
    check("without", &picture(&client), &before, &IDENTICAL);
}

#[test]
fn surroundings_of_a_scene_are_shown_where_the_wall_has_none() {
    let mut local = wall();
    lit_triangle(&local.place);
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    let other = picture(&client);
    client.open_scene("lit.glb").expect("opened");
    assert_eq!(name(&client), None, "the wall has none of its own");
    let own = picture(&client);
    // Behind the triangle: ahead is −Z, and the borders of the picture are nearer to it than to +X.
    let corner = own.get_pixel(0, 0).0;
    assert!(corner[1] > corner[0] && corner[0] > corner[2], "{corner:?}");
    // A file of the scene has them too, but for what 8 bits cannot say.
    let exported = local.place.path("again.glb").display().to_string();
    local.run(&["scene", "export", &exported]).succeeded();
    client.open_scene("again.glb").expect("opened");
    let again = picture(&client);
    let parts = || again.as_raw().iter().zip(own.as_raw());
    let most = parts().map(|(again, own)| again.abs_diff(*own)).max();
    assert!(most <= Some(3), "exported: {most:?} codes off");
    client.open_scene("lit.glb").expect("opened");
    client.set_environment(file("studio.hdr")).expect("set");
    let studio = picture(&client);
    assert_ne!(studio.get_pixel(0, 0), own.get_pixel(0, 0));
    client.set_environment(EnvironmentSource::None).expect("set");
    check("its own again", &picture(&client), &own, &IDENTICAL);
    let server = local.servers.keys().next().expect("a server").clone();
    local.servers.remove(&server).expect("a server").kill();
    local.await_lost(&client, &server);
    local.start_server(&server);
    await_states(&client, &[ChannelState::Live]);
    check("joined", &picture(&client), &own, &IDENTICAL);
    client.open_scene("triangle.glb").expect("opened");
    check("they went with their scene", &picture(&client), &other, &IDENTICAL);
}

#[test]
fn a_computed_sky_is_brighter_above_than_below_and_tone_mappers_differ() {
    let local = wall();
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    let neutral = picture(&client);
    client.set_environment(EnvironmentSource::Sky).expect("set");
    assert_eq!(name(&client).as_deref(), Some("sky"));
    let sky = picture(&client);
    let (width, height) = sky.dimensions();
    let [above, below] = [2, height - 3].map(|y| sky.get_pixel(width / 2, y).0);
    assert!(above[2] > above[0], "blue: {above:?}");
    assert!(above[2] > below[2] + 20, "{above:?} above {below:?}");

    client.set_environment(EnvironmentSource::None).expect("set");
    let mut seen = vec![neutral];
    for tone in [ToneMapper::Aces, ToneMapper::None] {
        client.set_tone(tone).expect("set");
        assert_eq!(client.presentation().expect("status").tone, tone);
        let shown = picture(&client);
        assert!(!seen.contains(&shown), "{tone:?} looks as another one");
        seen.push(shown);
    }
    client.set_tone(ToneMapper::Neutral).expect("set");
    check("neutral", &picture(&client), &seen[0], &IDENTICAL);
}

#[test]
fn fog_hides_what_is_far_on_all_displays_until_it_is_taken_away() {
    let local = wall();
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    let clear = picture(&client);
    assert_eq!(local.run(&["fog"]).succeeded(), "fog none");
    let said = local.run(&["fog", "40", "--height", "-1", "--half", "2"]).succeeded();
    assert!(said.contains("visibility of 40") && said.contains("half of it with each 2"), "{said}");
    let layer = picture(&client);
    assert_ne!(layer, clear);
    // So dense that nothing is seen but the fog: all displays have one colour.
    local.run(&["fog", "0.001"]).succeeded();
    let dense = picture(&client);
    assert!(dense.pixels().all(|pixel| pixel == dense.get_pixel(0, 0)));
    for words in [["fog", "0"], ["fog", "NaN"], ["fog", "soon"]] {
        let refused = local.run(&words);
        assert_eq!(refused.code(), 2, "{}", refused.output);
        assert!(refused.output.contains("or none"), "{}", refused.output);
    }
    local.run(&["fog", "9", "--color", "2,0,0"]).failed(&["0 to 1 of each colour"]);
    assert!(picture(&client) == dense, "what is refused changes nothing");
    local.run(&["fog", "none"]).succeeded();
    check("without", &picture(&client), &clear, &IDENTICAL);
}

#[test]
fn glow_spreads_light_on_all_displays_until_it_is_taken_away() {
    let local = wall();
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    client.set_exposure(8.0).expect("set");
    let plain = picture(&client);
    assert_eq!(local.run(&["glow"]).succeeded(), "glow none");
    let said = local.run(&["glow", "0.5", "--width", "7"]).succeeded();
    assert_eq!(said, "glow with a strength of 0.5, 7° wide");
    let glowing = picture(&client);
    assert_ne!(glowing, plain);
    for words in [["glow", "0"], ["glow", "NaN"], ["glow", "much"]] {
        let refused = local.run(&words);
        assert_eq!(refused.code(), 2, "{}", refused.output);
        assert!(refused.output.contains("or none"), "{}", refused.output);
    }
    local.run(&["glow", "0.5", "--width", "90"]).failed(&["0.1 to 7 degrees wide, not 90"]);
    assert!(picture(&client) == glowing, "what is refused changes nothing");
    local.run(&["glow", "none"]).succeeded();
    check("without", &picture(&client), &plain, &IDENTICAL);
}

#[test]
fn ambient_occlusion_darkens_corners_on_all_displays_until_it_is_taken_away() {
    let local = wall();
    local.place.write("corner.glb", corner());
    let client = local.client();
    client.open_scene("corner.glb").expect("opened");
    let plain = picture(&client);
    assert_eq!(local.run(&["ambient-occlusion"]).succeeded(), "ambient occlusion none");
    let said = local.run(&["ambient-occlusion", "0.5"]).succeeded();
    assert_eq!(said, "ambient occlusion with a radius of 0.5");
    let dark = picture(&client);
    let pixels = || plain.pixels().zip(dark.pixels());
    let darker = pixels().filter(|(plain, dark)| dark[1].saturating_add(4) < plain[1]).count();
    let brighter = pixels().filter(|(plain, dark)| dark[1] > plain[1].saturating_add(1)).count();
    assert!(darker > 500 && brighter == 0, "{darker} darker, {brighter} brighter");
    for words in [["ambient-occlusion", "0"], ["ambient-occlusion", "NaN"]] {
        let refused = local.run(&words);
        assert_eq!(refused.code(), 2, "{}", refused.output);
        assert!(refused.output.contains("or none"), "{}", refused.output);
    }
    assert!(picture(&client) == dark, "what is refused changes nothing");
    local.run(&["ambient-occlusion", "none"]).succeeded();
    check("without", &picture(&client), &plain, &IDENTICAL);
}

#[test]
fn depth_of_field_blurs_what_is_far_on_all_displays_until_it_is_taken_away() {
    let local = wall();
    let client = local.client();
    client.open_scene("triangle.glb").expect("opened");
    let plain = picture(&client);
    assert_eq!(local.run(&["depth-of-field"]).succeeded(), "depth of field none");
    let said = local.run(&["depth-of-field", "0.2,0.02"]).succeeded();
    assert_eq!(said, "depth of field with a focus at 0.2, an aperture of 0.02");
    let blurred = picture(&client);
    // Edges are ramps: more colours than a sharp triangle has.
    let colors = |of: &RgbaImage| of.pixels().collect::<std::collections::HashSet<_>>().len();
    let [few, many] = [&plain, &blurred].map(colors);
    assert!(many > few + 8, "{few} colours became {many}");
    for words in [["depth-of-field", "0"], ["depth-of-field", "5,0"], ["depth-of-field", "near"]] {
        let refused = local.run(&words);
        assert_eq!(refused.code(), 2, "{}", refused.output);
        assert!(refused.output.contains("or none"), "{}", refused.output);
    }
    assert!(picture(&client) == blurred, "what is refused changes nothing");
    local.run(&["depth-of-field", "none"]).succeeded();
    check("without", &picture(&client), &plain, &IDENTICAL);
}

#[test]
fn a_simulation_has_the_surroundings_that_it_is_given() {
    let run = |arguments: &[&str]| {
        let place = TestDir::new();
        let scene = place.write("scene/triangle.glb", triangle());
        let studio = place.write("light/studio.hdr", hdr()).display().to_string();
        let picture = place.path("wall.jpg").display().to_string();
        let given = |argument: &&str| match *argument {
            "STUDIO" => studio.clone(),
            "PICTURE" => picture.clone(),
            other => other.to_owned(),
        };
        let arguments: Vec<String> = arguments.iter().map(given).collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let arguments = [&["--frames", "1"], &arguments[..]].concat();
        let mut simulation = Simulation::start(place, &small(1, 1), &scene, &arguments);
        simulation.process.finish(wait::LIMIT).succeeded();
        (read(&simulation.place.path("out/wall.png")), simulation)
    };
    let mut pictures = Vec::new();
    for arguments in [
        &["--picture", "PICTURE"][..],
        &["--environment", "sky"],
        // In a folder that is not the scene's.
        &["--environment", "STUDIO"],
        &["--fog", "1"],
        &["--exposure", "auto"],
    ] {
        let (picture, simulation) = run(arguments);
        assert!(!pictures.contains(&picture), "{arguments:?} changes nothing");
        if let ["--picture", _] = arguments {
            let jpeg = image::open(simulation.place.path("wall.jpg")).expect("a picture");
            let jpeg = jpeg.into_rgba8();
            assert_eq!(jpeg.dimensions(), picture.dimensions());
            let parts = || jpeg.as_raw().iter().zip(picture.as_raw());
            let sum: u64 = parts().map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            assert!(sum / (parts().count() as u64) < 4, "the same picture");
        }
        pictures.push(picture);
    }
    let place = TestDir::new();
    let scene = place.write("triangle.glb", triangle()).display().to_string();
    let wall = place.write("wall.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    let wall = wall.display().to_string();
    let refused = |arguments: [&str; 2]| {
        place.run([&["simulate", &wall, &scene], &arguments[..]].concat()).output
    };
    let said = refused(["--environment", "gone.hdr"]);
    assert!(said.contains("gone.hdr") && said.contains("neither sky nor a file"), "{said}");
    let said = refused(["--picture", "wall.gif"]);
    assert!(said.contains("wall.gif") && said.contains(".png or .jpg"), "{said}");
}
