//! Files of others that a wall names: read by the baker, a process of its own, before the wall
//! starts; fetched and decoded by its servers; refused by key and file where they are broken.

use std::path::{Path, PathBuf};

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions, Wall, fit_bounds};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_manager::import::{Baker, bake_wall_files};
use polyptych_wall::color::{linear_from_srgb, srgb_from_linear};
use polyptych_wall::warp::CalibrationMap;
use polyptych_wall::{CalibrationFile, CalibrationFileKind};

use crate::harness::local_wall::{LocalWall, small};
use crate::harness::maps::{self, Png, Region, png};
use crate::harness::pictures::{self, Policy};
use crate::harness::place::TestDir;
use crate::harness::{scenes, wait};
use crate::one_process::{TOKEN, start_manager, start_server};

/// A wall of one channel with a warp map and a mask beside its wall file.
fn wall_with_files(place: &TestDir) -> Wall {
    let mut wall = small(1, 1);
    let value = |x: u32, y: u32| [x as f32 * 0.24 - 0.84, 0.4 - y as f32 * 0.27, -1.304];
    place.write("front.pfm", maps::pfm([8, 4], 3, true, value));
    let texels = [0, 128, 255, 64];
    let mask = Png { size: [2, 2], color: 0, bits: 8, gamma: Some(45_455), texels: &texels };
    place.write("front.png", png(&mask));
    for (path, kind) in
        [("front.pfm", CalibrationFileKind::Warp), ("front.png", CalibrationFileKind::Alpha)]
    {
        wall.files.push(CalibrationFile {
            path: path.to_owned(),
            kind,
            blob: None,
            is_for_one_eye: false,
            front: Vec::new(),
        });
    }
    wall.channels[0].adjustment.warp = Some(0);
    wall.channels[0].adjustment.alpha = Some(1);
    wall
}

fn baker(place: &TestDir) -> Baker {
    let program = PathBuf::from(env!("CARGO_BIN_EXE_polyptych"));
    Baker { program, memory_mib: 4096, memory_remedy: "", store: place.path("store") }
}

#[test]
fn a_wall_with_files_comes_up_and_its_servers_hold_them() {
    let place = TestDir::new();
    let mut wall = wall_with_files(&place);
    bake_wall_files(&mut wall, place.folder(), &baker(&place)).expect("baked");
    let blobs: Vec<BlobHash> = wall.blobs().collect();
    assert_eq!(blobs.len(), 2);

    let (address, end_manager, manager) = start_manager(wall.clone(), &place);
    let (end, server) = start_server(&address, &wall.channels[0].name, &place);
    let mut connect = ConnectOptions::new(address);
    connect.token = Some(TOKEN.into());
    let client = Client::connect_with(connect).expect("connected");
    wait::until("the channel is ready", || {
        let status = client.status().expect("a status");
        status.channels.iter().all(|channel| channel.state == ChannelState::Ready).then_some(())
    });
    let capture = client.capture().expect("captured");
    assert!(capture.missing.is_empty(), "{:?}", capture.missing);
    // They came over the bulk connection: the server knows no other folder.
    let cache = BlobStore::new(place.path("blobs"));
    for blob in blobs {
        let bytes = cache.read(blob).expect("read").expect("the server fetched it");
        CalibrationMap::decode(&bytes).expect("a map");
    }
    end.notify_one();
    server.join().expect("no panic").expect("ended in order");
    end_manager.notify_one();
    manager.join().expect("no panic");
}

/// A server checks the files that it gets again: their kind, and whether they are available at all.
#[test]
fn a_server_refuses_a_file_that_is_none_by_its_key() {
    let place = TestDir::new();
    let mut wall = wall_with_files(&place);
    bake_wall_files(&mut wall, place.folder(), &baker(&place)).expect("baked");
    wall.files[0].blob = wall.files[1].blob;
    let key = format!("channel.{}.warp", wall.channels[0].name);
    let (address, end_manager, manager) = start_manager(wall.clone(), &place);
    let (end, server) = start_server(&address, &wall.channels[0].name, &place);
    let mut connect = ConnectOptions::new(address);
    connect.token = Some(TOKEN.into());
    let client = Client::connect_with(connect).expect("connected");
    let reason = wait::until("the channel says why it is not ready", || {
        let status = client.status().expect("a status");
        status.channels[0].reason.clone().filter(|reason| reason.contains(&key))
    });
    assert!(reason.contains("it is a mask"), "{reason}");
    end.notify_one();
    server.join().expect("no panic").expect("ended in order");
    end_manager.notify_one();
    manager.join().expect("no panic");
}

/// The baker child's reason, behind the key and the file; and a file that has changed is another.
#[test]
fn files_of_a_wall_are_refused_before_it_starts() {
    let place = TestDir::new();
    let mut wall = wall_with_files(&place);
    let baker = baker(&place);
    bake_wall_files(&mut wall, place.folder(), &baker).expect("baked");
    let before = wall.files[0].blob;
    place.write("front.pfm", maps::pfm([8, 4], 3, true, |x, y| [x as f32, y as f32, -2.0]));
    bake_wall_files(&mut wall, place.folder(), &baker).expect("baked again");
    assert_ne!(wall.files[0].blob, before, "it has changed");

    let name = wall.channels[0].name.clone();
    let mut refused = |bytes: &[u8]| {
        place.write("front.pfm", bytes);
        let line = bake_wall_files(&mut wall, place.folder(), &baker).expect_err("refused");
        let begins = format!("channel.{name}.warp: ");
        assert!(line.starts_with(&begins) && line.contains("front.pfm"), "{line}");
        line
    };
    let line = refused(b"PF\n8 4\n-1.0\n");
    assert!(line.contains("truncated") && line.contains("384 would be right"), "{line}");
    let line = refused(b"GIF89a");
    assert!(line.contains("no kind of warp map"), "{line}");
    std::fs::remove_file(place.path("front.pfm")).expect("removed");
    let line = bake_wall_files(&mut wall, place.folder(), &baker).expect_err("refused");
    assert!(line.contains("front.pfm") && line.contains("No such file"), "{line}");
}

/// The command makes a folder with a wall file and all that it names, and refuses by entry.
#[test]
fn an_mpcdi_archive_becomes_a_wall_file() {
    let place = TestDir::new();
    let texels: Vec<u16> = (0..5000).map(|i| i % 256).collect();
    let size = [100, 50];
    let mask = png(&Png { size, color: 0, bits: 8, gamma: None, texels: &texels });
    let warp = |x: u32, y: u32| [(x as f32 + 0.5) / 100.0, 1.0 - (y as f32 + 0.5) / 50.0, 0.0];
    let region = |id: &str, x: f64| Region {
        id: id.to_owned(),
        size,
        part: [x, 0.0, 0.5, 1.0],
        frustum: None,
        warp: maps::pfm(size, 3, true, warp),
        unit: None,
        origin: None,
        alpha: Some((mask.clone(), 2.2)),
        beta: Some((mask.clone(), 1.8)),
    };
    let mut regions = [region("Left", 0.0), region("Right", 0.5)];
    let archive = |regions: &[Region]| {
        place.write("hall.mpcdi", maps::zip(&maps::mpcdi_entries("2d", [200, 50], regions)))
    };
    let file = archive(&regions).display().to_string();
    let out = place.path("hall").display().to_string();
    let printed = place.run(["wall", "import", &file, "-o", &out]).succeeded();
    assert!(printed.contains("2 channels of a buffer of 200 × 50 pixels"), "{printed}");
    let text = std::fs::read_to_string(place.path("hall/wall.toml")).expect("a wall file");
    for part in [
        "name = \"hall\"",
        "pixels = [200, 50]",
        "origin = [100, 0]",
        "[channel.\"left\"]\nwarp = \"left.pfm\"\nalpha = \"left-alpha.png\"\n\
         beta = \"left-beta.png\"",
    ] {
        assert!(text.contains(part), "no {part} in\n{text}");
    }
    let is_there = |name: &str| place.path("hall").join(name).is_file();
    assert!(
        ["left.pfm", "right.pfm", "right-alpha.png", "right-beta.png"].into_iter().all(is_there)
    );
    let line = place.run(["wall", "import", &file, "-o", &out]).failed(&["--force"]);
    assert!(line.contains("wall.toml is there already"), "{line}");
    std::fs::remove_file(place.path("hall/wall.toml")).expect("removed");
    place.write("hall/left.pfm", "measured");
    place.run(["wall", "import", &file, "-o", &out]).failed(&["left.pfm is there already"]);
    assert_eq!(std::fs::read(place.path("hall/left.pfm")).expect("kept"), b"measured");
    place.run(["wall", "import", &file, "-o", &out, "--force"]).succeeded();
    regions[1].warp.truncate(999);
    archive(&regions);
    let words = ["hall.mpcdi", "entry 'Right/warp.pfm'", "truncated"];
    place.run(["wall", "import", &file, "-o", &out, "--force"]).failed(&words);
    // Nothing is left of a try that failed half-way, so that the next one needs no force.
    let again = place.path("again").display().to_string();
    place.run(["wall", "import", &file, "-o", &again]).failed(&words);
    assert!(!place.path("again").exists(), "maps of a wall that was not made");
}

/// Every kind of file by the command, which says what it is.
#[test]
fn the_baker_says_what_a_file_of_a_wall_is() {
    let place = TestDir::new();
    let obj = maps::obj([3, 2], |u, v| ([u, v, -1.0], [u, v]));
    let node = |x: u32, y: u32| [f64::from(x) - 1.0, f64::from(y) - 0.5, 0.5, 0.5, 1.0];
    let bourke = maps::bourke([3, 2], node);
    let pfm = maps::pfm([5, 4], 3, false, |x, y| [x as f32, y as f32, -2.0]);
    let files: [(&str, &[u8], &str, &str); 4] = [
        ("a.obj", obj.as_bytes(), "screen-mesh", "warp mesh of 12 triangles in display space"),
        ("a.obj", obj.as_bytes(), "warp", "warp mesh of 12 triangles in display space"),
        ("a.data", bourke.as_bytes(), "warp", "warp mesh of 4 triangles on the canvas"),
        ("a.pfm", &pfm, "warp", "warp grid of 5 × 4 points in display space"),
    ];
    let store = place.path("store").display().to_string();
    for (name, bytes, used_as, what) in files {
        let file = place.write(name, bytes).display().to_string();
        let arguments = ["bake", &file, "-o", &store, "--as", used_as, "--aspect", "2"];
        let printed = place.run(arguments).succeeded();
        assert!(printed.starts_with(what) && printed.contains("blob "), "{printed}");
    }
    let file = place.path("a.data").display().to_string();
    let arguments = ["bake", &file, "-o", &store, "--as", "mask"];
    place.run(arguments).failed(&["a.data", "PNG", "can't be decoded"]);
}

/// The policy for pictures that were resampled alike, at points that a file gives in f32: the rest
/// is rounding at edges. A map that is off by a tenth of a pixel fails by far.
const RESAMPLED: Policy =
    Policy { identical_share_min: 0.97, within_1_share_min: 0.995, above_8_ppm_max: 500.0 };

/// Here the source's own pixels lie otherwise: more of the screen is drawn than the tile shows.
const SAMPLED_OTHERWISE: Policy =
    Policy { identical_share_min: 0.95, within_1_share_min: 0.99, above_8_ppm_max: 2500.0 };

/// A wall of two channels on one plane; pins that move nothing that can be seen send its picture
/// the way of warped ones.
const BY_GEOMETRY: &str = r#"
[wall]
name = "geometry"
[[screen]]
name = "screen"
size = [4.0, 2.0]
center = [0.0, 0.0, -4.0]
pixels = [200, 100]
[[screen.channel]]
name = "left"
origin = [0, 0]
pixels = [100, 100]
[[screen.channel]]
name = "right"
origin = [100, 0]
pixels = [100, 100]
[channel.left]
pin = [[0.000001, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
[channel.right]
pin = [[0.000001, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
"#;

/// The wall of [`BY_GEOMETRY`] as an archive: by places of the buffer, or by points in millimetres.
fn archive_of_geometry(profile: &str) -> Vec<u8> {
    let region = |id: &str, side: f64| {
        let place = |x: u32, y: u32| [(f64::from(x) + 0.5) / 100.0, (f64::from(y) + 0.5) / 100.0];
        let value = |x: u32, y: u32| {
            let [u, v] = place(x, y);
            let in_room = [(u * 2.0 + (side - 1.0) * 2.0) * 1e3, (1.0 - v * 2.0) * 1e3, -4e3];
            let on_canvas = [u, 1.0 - v, 0.0];
            (if profile == "3d" { in_room } else { on_canvas }).map(|number| number as f32)
        };
        let across = (0.5f64).atan().to_degrees();
        let up = (0.25f64).atan().to_degrees();
        let [left, right] = if side == 0.0 { [-across, 0.0] } else { [0.0, across] };
        Region {
            id: id.to_owned(),
            size: [100, 100],
            part: [side * 0.5, 0.0, 0.5, 1.0],
            frustum: (profile == "3d").then_some([0.0, 0.0, 0.0, right, left, up, -up]),
            warp: maps::pfm([100, 100], 3, true, value),
            unit: (profile == "3d").then(|| "mm".to_owned()),
            origin: (profile == "3d").then(|| "idealEyePoint".to_owned()),
            alpha: None,
            beta: None,
        }
    };
    let regions = [region("left", 0.0), region("right", 1.0)];
    maps::zip(&maps::mpcdi_entries(profile, [200, 100], &regions))
}

/// The pictures of a wall that shows the town.
struct Shown {
    /// The pictures of the channels `left` and `right`.
    channels: [RgbaImage; 2],
    /// The picture of all channels together, on the first screen.
    screen: RgbaImage,
}

/// Returns the pictures of the town on a wall file's wall, by real processes: from one place,
/// whatever the screens are.
fn show(path: &Path) -> Shown {
    let mut wall = polyptych_wall_file::load(path).unwrap_or_else(|error| panic!("{error}"));
    let folder = path.parent().expect("a folder");
    for file in &mut wall.files {
        file.path = folder.join(&file.path).display().to_string();
    }
    let local = LocalWall::start(&wall, &[scenes::town().parent().expect("a folder")]);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("a town");
    let geometry =
        polyptych_wall_file::parse(BY_GEOMETRY, "geometry.toml".as_ref()).expect("a wall");
    client.set_camera(fit_bounds(&geometry, &bounds, 0.52)).expect("set");
    let capture = client.capture().expect("captured");
    assert_eq!(capture.missing, []);
    let channels = ["left", "right"].map(|name| {
        let picture = capture.channels.iter().find(|picture| picture.name == name);
        pictures::image_of(picture.expect("a picture"))
    });
    Shown { channels, screen: pictures::image_of(&capture.screens[0]) }
}

/// A screen that stands in a file as a mesh shows what a plane in the same place does.
#[test]
fn a_screen_of_a_mesh_shows_what_its_points_say() {
    let place = TestDir::new();
    let mut obj = String::new();
    for i in 0..=24 {
        let (u, v) = (f64::from(i % 5) / 4.0, f64::from(i / 5) / 4.0);
        obj += &["v ", &(u * 4.0 - 2.0).to_string(), " ", &(v * 2.0 - 1.0).to_string()].concat();
        obj += &[" -4\nvt ", &u.to_string(), " ", &v.to_string(), "\n"].concat();
    }
    for cell in 0..16 {
        let at = cell / 4 * 5 + cell % 4 + 1;
        let [a, b, c, d] = [at, at + 1, at + 6, at + 5].map(|i| format!("{i}/{i}"));
        obj += &["f ", &a, " ", &b, " ", &c, " ", &d, "\n"].concat();
    }
    place.write("screen.obj", obj);
    let by_mesh = BY_GEOMETRY
        .replace("size = [4.0, 2.0]\ncenter = [0.0, 0.0, -4.0]\n", "mesh = \"screen.obj\"\n")
        .replace("0.000001", "0.0");
    let [due, shown] = [("geometry.toml", BY_GEOMETRY.to_owned()), ("mesh.toml", by_mesh)]
        .map(|(name, text)| show(&place.write(name, text)));
    assert!(pictures::color_count(&due.channels[0]) > 100, "no town");
    for (shown, due) in shown.channels.iter().zip(&due.channels) {
        println!("mesh: {}", pictures::check("mesh-screen", shown, due, &SAMPLED_OTHERWISE));
    }
}

/// Two projectors that stand side by side before the screen and overlap by half.
fn projectors(text: &str) -> String {
    let of = |name: &str, x: f64| {
        format!(
            "[[screen.channel]]\nname = \"{name}\"\npixels = [120, 100]\n\
             [screen.channel.projector]\nposition = [{x}, 0.1, 0.0]\n\
             look_at = [{x}, 0.0, -4.0]\ndegrees = [36.0, 24.0]\n"
        )
    };
    let head = text.split("[[screen.channel]]").next().expect("a head");
    [head, &of("left", -0.6), &of("right", 0.6)].concat()
}

/// A plane of the screen's size as a mesh of cells.
fn board() -> String {
    maps::obj([4, 4], |u, v| ([u * 4.0 - 2.0, 1.0 - v * 2.0, -4.0], [u, 1.0 - v]))
}

/// Projectors whose light falls on a mesh, and the same ones as maps that somebody measured: they
/// show, share and add up to what they do on a plane.
#[test]
fn projectors_on_a_mesh_and_their_maps_show_what_they_do_on_a_plane() {
    let place = TestDir::new();
    place.write("screen.obj", board());
    let by_plane = projectors(BY_GEOMETRY);
    let plane = "size = [4.0, 2.0]\ncenter = [0.0, 0.0, -4.0]\n";
    let by_mesh = by_plane.replace(plane, "mesh = \"screen.obj\"\n");
    let wall = polyptych_wall_file::parse(&by_plane, "plane.toml".as_ref()).expect("a wall");
    for (id, name) in wall.channel_ids().zip(["left", "right"]) {
        let map = wall.channel_mapping(id).expect("a picture");
        let point = |x: u32, y: u32| {
            let pixel = glam::DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            map.display_from_pixel(pixel).expect("lit").as_vec3().to_array()
        };
        place.write(&format!("{name}.pfm"), maps::pfm([120, 100], 3, true, point));
    }
    let head = by_plane.split("[[screen.channel]]").next().expect("a head");
    let channel =
        |name: &str| format!("[[screen.channel]]\nname = \"{name}\"\npixels = [120, 100]\n");
    let warp = |name: &str| format!("[channel.{name}]\nwarp = \"{name}.pfm\"\n");
    let by_maps =
        [head, &channel("left"), &channel("right"), &warp("left"), &warp("right")].concat();
    let [due, mesh, maps] = [("plane", by_plane), ("mesh", by_mesh), ("maps", by_maps)]
        .map(|(name, text)| show(&place.write(&format!("{name}.toml"), text)));
    assert!(pictures::color_count(&due.screen) > 100, "no town");
    for (name, shown) in [("mesh", mesh), ("maps", maps)] {
        for (shown, due) in shown.channels.iter().zip(&due.channels) {
            let name = format!("projector-{name}");
            println!("{name}: {}", pictures::check(&name, shown, due, &SAMPLED_OTHERWISE));
        }
        let name = format!("projectors-screen-{name}");
        let (shown, due) = (&shown.screen, &due.screen);
        println!("{name}: {}", pictures::check(&name, shown, due, &SAMPLED_OTHERWISE));
    }
}

/// A Bourke mesh dims its picture where it says so: codes are those of as much light.
#[test]
fn the_light_of_a_mesh_is_drawn() {
    let place = TestDir::new();
    let mesh = |light: [f64; 3]| {
        maps::bourke([3, 2], move |x, y| {
            let (x, y) = (x as usize, f64::from(y));
            [x as f64 - 1.0, y * 2.0 - 1.0, x as f64 / 4.0, y, light[x]]
        })
    };
    let wall = |name: &str| {
        let warp = format!("[channel.left]\nwarp = \"{name}.data\"\n[channel.right]");
        BY_GEOMETRY.replace(
            "[channel.left]\npin = [[0.000001, 0.0], [0.0, 0.0], [0.0, 0.0], \
                             [0.0, 0.0]]\n[channel.right]",
            &warp,
        )
    };
    place.write("light.data", mesh([1.0, 1.0, 1.0]));
    place.write("dim.data", mesh([1.0, 0.5, 1.0]));
    let [due, dim] =
        ["light", "dim"].map(|name| show(&place.write(&format!("{name}.toml"), wall(name))));
    let mut worst = 0.0_f64;
    for (x, y, code) in dim.channels[0].enumerate_pixels() {
        // Linear in the picture between corners, of stored colours of gamma 2.2.
        let middle = 1.0 - ((f64::from(x) + 0.5) / 50.0 - 1.0).abs();
        let factor = 1.0 + (0.5_f64.powf(2.2) - 1.0) * middle;
        let light = linear_from_srgb(f64::from(due.channels[0].get_pixel(x, y)[1]) / 255.0);
        let expected = srgb_from_linear(light * factor) * 255.0;
        worst = worst.max((f64::from(code[1]) - expected).abs());
    }
    println!("dimmed by a mesh: at most {worst:.2} levels off");
    assert!(pictures::color_count(&dim.channels[0]) > 100, "no town");
    assert!(worst <= 1.1, "{worst}: half a level of both, the brighter one dimmed");
}

/// Archives of both profiles, imported and shown by real processes, against the same wall by its
/// geometry.
#[test]
fn an_imported_wall_shows_what_its_geometry_would() {
    let place = TestDir::new();
    let town = scenes::town().display().to_string();
    let due = show(&place.write("geometry.toml", BY_GEOMETRY));
    assert!(pictures::color_count(&due.channels[0]) > 100, "no town");
    for profile in ["2d", "3d"] {
        let file = place.write("hall.mpcdi", archive_of_geometry(profile)).display().to_string();
        let folder = place.path(&format!("hall-{profile}"));
        let out = folder.display().to_string();
        place.run(["wall", "import", &file, "-o", &out]).succeeded();
        let shown = show(&folder.join("wall.toml"));
        for (shown, due) in shown.channels.iter().zip(&due.channels) {
            let difference = pictures::check(&format!("mpcdi-{profile}"), shown, due, &RESAMPLED);
            println!("{profile}: {difference}");
        }
        if profile == "2d" {
            let (shown, due) = (&shown.screen, &due.screen);
            println!("{}", pictures::check("mpcdi-screen", shown, due, &SAMPLED_OTHERWISE));
        }
    }
    std::fs::write(place.path("hall-2d/left.pfm"), b"PF\n100 100\n-1.0\n").expect("written");
    let wall = place.path("hall-2d/wall.toml").display().to_string();
    let parts = ["wall.toml: channel.left.warp: ", "left.pfm: pixels: it is truncated"];
    place.run(["simulate", &wall, &town]).failed(&parts);
    place.run(["check", &wall]).failed(&parts);
    place.run(["manager", &wall, "--listen", "127.0.0.1:0", "--afresh"]).failed(&parts);
}
