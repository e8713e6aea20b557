//! Meshes in the formats of other systems, written here from what is known of them.

use std::fmt::Write as _;

use super::*;

/// Places and where the picture's points go: all formats here say that the picture is squeezed
/// into the left half of the display.
fn assert_squeezed(mesh: &Mesh, what: &str) {
    mesh.check().expect(what);
    let size = [40, 20];
    let samples = mesh.sample(size).expect(what);
    for (at, sample) in samples.iter().enumerate() {
        let place =
            DVec2::new(((at % 40) as f64 + 0.5) / 40.0, 1.0 - ((at / 40) as f64 + 0.5) / 20.0);
        match sample {
            Some((uv, light)) => {
                let due = DVec2::new(place.x * 2.0, place.y);
                assert!(uv.distance(due) < 1e-6, "{what}: {uv} is not {due}");
                assert!((light - 1.0).abs() < 1e-6, "{what}: {light}");
            }
            None => assert!(place.x > 0.5, "{what}: dark at {place}"),
        }
        assert_eq!(sample.is_some(), place.x < 0.5, "{what} at {place}");
    }
}

/// Corners of 5 × 3 nodes in the picture, x right and y down, row by row.
fn nodes() -> impl Iterator<Item = (usize, usize, f64, f64)> {
    (0..3).flat_map(|y| (0..5).map(move |x| (x, y, x as f64 / 4.0, y as f64 / 2.0)))
}

fn frame() -> Frame {
    Frame { position: DVec2::ZERO, size: DVec2::ONE, aspect: 1.6, is_texture: false }
}

#[test]
fn meshes_of_text_put_the_picture_where_they_say() {
    let mut bourke = String::from("2\n5 3\n");
    let mut csv = String::from("x;y;u;v;column;row\n");
    let mut skyskan = String::from(
        "Dome Azimuth=30\nDome Elevation=20\nHorizontal FOV=60\nVertical FOV=40\n5 3\n",
    );
    let (mut obj, mut faces) = (String::from("o warp\n"), String::new());
    let mut scalable = String::from(
        "OPENMESH Version 1.1\nVERTICES 15\nFACES 8\nNATIVEXRES 400\nNATIVEYRES 200\nORTHO_LEFT 0\n\
         PERSPECTIVE_LEFT -30\nPERSPECTIVE_RIGHT 30\nPERSPECTIVE_TOP 20\nPERSPECTIVE_BOTTOM -20\n",
    );
    let mut triangles = String::new();
    for (x, y, u, v) in nodes() {
        let _ = writeln!(bourke, "{} {} {u} {} 1", (u - 1.0) * 1.6, 1.0 - 2.0 * v, 1.0 - v);
        let _ = writeln!(csv, "{};{v};{u};{v};{x};{y}", u / 2.0);
        let _ = writeln!(skyskan, "{} {v} {u} {v}", u / 2.0);
        let _ = writeln!(obj, "v {} {} 0\nvt {u} {}", u - 1.0, 1.0 - 2.0 * v, 1.0 - v);
        let _ = writeln!(scalable, "{} {} 255 {v} {}", u * 200.0, (1.0 - v) * 200.0, 1.0 - u);
        if x < 4 && y < 2 {
            let a = y * 5 + x + 1;
            let _ = writeln!(
                faces,
                "f {a}/{a} {b}/{b} {c}/{c} {d}/{d}",
                b = a + 5,
                c = a + 6,
                d = a + 1
            );
            let _ = writeln!(triangles, "[ {} {} {} ]", a - 1, a + 4, a + 5);
        }
    }
    // The second triangle of each cell.
    let mut second = String::new();
    for line in triangles.lines() {
        let corners: Vec<u32> =
            line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let _ = writeln!(second, "[ {} {} {} ]", corners[0], corners[2], corners[0] + 1);
    }
    let scalable = format!("{}{triangles}{second}", scalable.replace("FACES 8", "FACES 16"));
    assert_squeezed(&lines::bourke(bourke.as_bytes(), 1.6).expect("bourke"), "bourke");
    assert_squeezed(&lines::domeprojection(csv.as_bytes()).expect("csv"), "csv");
    assert_squeezed(&lines::obj(format!("{obj}{faces}").as_bytes(), &frame()).expect("obj"), "obj");
    let mesh = lines::scalable(scalable.as_bytes()).expect("scalable");
    assert_squeezed(&mesh, "scalable");
    let frustum = mesh.frustum.expect("a frustum");
    assert_eq!([frustum.left, frustum.right, frustum.down, frustum.up], [-30.0, 30.0, -20.0, 20.0]);
    let mesh = lines::skyskan(skyskan.as_bytes()).expect("skyskan");
    assert_squeezed(&mesh, "skyskan");
    let ahead = mesh.frustum.expect("a frustum").rotation * DVec3::NEG_Z;
    // 30° to the right and 20° up.
    let due = DVec3::new(0.4698463, 0.3420201, -0.8137977);
    assert!(ahead.distance(due) < 1e-6, "{ahead}");
}

#[test]
fn meshes_of_bytes_put_the_picture_where_they_say() {
    let mut sciss = b"SGC\x01".to_vec();
    sciss.extend(0u32.to_le_bytes());
    let head = [0.0f32, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 20.0, -20.0, -30.0, 30.0];
    sciss.extend(head.iter().flat_map(|number| number.to_le_bytes()));
    sciss.extend([5u32, 3].iter().flat_map(|count| count.to_le_bytes()));
    for (_, _, u, v) in nodes() {
        for number in [u / 2.0, v, 0.0, u, 1.0 - v, 0.0] {
            sciss.extend((number as f32).to_le_bytes());
        }
    }
    // A strip that goes to and fro.
    let mut strip: Vec<u32> = (0..5).flat_map(|x| [x, x + 5]).collect();
    strip.extend((5..10).rev().flat_map(|x| [x, x + 5]));
    sciss.extend((strip.len() as u32).to_le_bytes());
    sciss.extend(strip.iter().flat_map(|index| index.to_le_bytes()));
    let mesh = binary::sciss(&sciss).expect("sciss");
    assert_squeezed(&mesh, "sciss");
    let frustum = mesh.frustum.expect("a frustum");
    assert_eq!((frustum.down, frustum.eye), (-20.0, Some(DVec3::new(0.5, 0.0, 0.0))));
    assert!(binary::sciss(&sciss[..100]).is_err());

    // Both eyes side by side, points of the picture at the middles of 8 × 4 cells.
    let mut pfm = b"PF\n16 4\n-1.0\n".to_vec();
    for (row, column) in (0..4).flat_map(|row| (0..16).map(move |column| (row, column % 8))) {
        let [u, v] = [(column as f64 + 0.5) / 8.0, 1.0 - (row as f64 + 0.5) / 4.0];
        for number in [u / 2.0, v, 0.0] {
            pfm.extend((number as f32).to_le_bytes());
        }
    }
    let mesh = binary::pfm(&pfm, false).expect("pfm");
    let sample = mesh.sample([40, 20]).expect("pfm")[10 * 40 + 10].expect("lit").0;
    assert!(sample.distance(DVec2::new(0.525, 0.475)) < 1e-6, "{sample}");
    assert!(binary::pfm(&pfm[..200], false).is_err());
}

#[test]
fn simcad_moves_nodes_of_a_square_grid() {
    let moves = |of: fn(f64) -> f64| {
        let numbers = (0..9).map(|at| of(f64::from(at % 3) / 2.0).to_string());
        numbers.collect::<Vec<_>>().join(" ")
    };
    let text = format!(
        "<GeometryFile><GeometryDefinition><X-FlatParameters range=\"100\">{}</X-FlatParameters>\
         <Y-FlatParameters range=\"100\">{}</Y-FlatParameters></GeometryDefinition></GeometryFile>",
        moves(|u| -50.0 * u),
        moves(|_| 0.0)
    );
    let read = |text: &str| simcad::read(Path::new("a.simcad"), text.as_bytes());
    assert_squeezed(&read(&text).expect("simcad"), "simcad");
    let error = read(&text.replace("range=\"100\"", "")).expect_err("no range").to_string();
    assert!(error.contains("range: the key is missing"), "{error}");
}

#[test]
fn broken_meshes_are_refused() {
    let says = |result: anyhow::Result<Mesh>, part: &str| {
        let error = result.and_then(|mesh| mesh.check()).expect_err(part).to_string();
        assert!(error.contains(part), "{part}: {error}");
    };
    says(lines::bourke(b"2\n1 5\n", 1.0), "line 2");
    says(lines::bourke(b"2\n2 2\n0 0 0 0 1\n", 1.0), "1 nodes of 2");
    says(lines::bourke(b"2\n2 2\n0 0 0 zero 1\n", 1.0), "line 3: this is no node");
    says(lines::obj(b"v 0 0 0\n", &frame()), "1 v and 0 vt");
    says(lines::obj(b"v 0 0 0\nvt 0 0\nf 1 2 3\n", &frame()), "names vertex 1 of 1");
    says(lines::obj(b"v 0 0 0\nvt 0 0\nf 0 1 1\n", &frame()), "line 3: this is no face");
    says(lines::domeprojection(b"0;0;0;0;0;0\n1;1;1;1;1;1\n"), "2 nodes of 2");
    says(lines::skyskan(b"2 2\n0 0 0 0\n"), "dome azimuth is missing");
    says(lines::scalable(b"OPENMESH Version 1.1\n"), "NATIVEXRES");
    says(binary::sciss(b"SGX\x01"), "does not begin with SGC");
    says(binary::pfm(b"Pf\n2 2\n-1\n", true), "its head is wrong");
    // Triangles over each other without end.
    let mut text = String::from("v -1 -1 0\nvt 0 0\nv 1 -1 0\nvt 1 0\nv 1 1 0\nvt 1 1\n");
    text.push_str(&"f 1 2 3\n".repeat(400));
    let mesh = lines::obj(text.as_bytes(), &frame()).expect("a mesh");
    let error = mesh.sample([100, 100]).expect_err("too many").to_string();
    assert!(error.contains("256 times"), "{error}");
}
