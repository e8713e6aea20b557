//! `scene tree`, `node` and `transaction`, as a person types them.

use polyptych_client::NodeQuery;
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

/// A wall that shows a house with two doors, of which one is a tower's.
fn wall() -> LocalWall {
    let place = TestDir::new();
    let house = Gltf::triangle().with(|gltf| {
        gltf.json["scenes"][0]["nodes"] = serde_json::json!([0, 2]);
        gltf.json["nodes"] = serde_json::json!([
            { "name": "house", "children": [1] },
            { "name": "door", "mesh": 0 },
            { "name": "tower/old", "children": [3] },
            { "name": "door", "mesh": 0, "translation": [1.0, 0.0, 0.0] },
        ]);
    });
    let folder = place.write("house.glb", house.glb()).parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT);
    local.run(&["scene", "tree"]).failed(&["no scene is open; open one first"]);
    local.run(&["open", "house.glb"]).succeeded();
    local
}

#[test]
fn nodes_are_listed_changed_and_found_by_their_paths() {
    let local = wall();
    let tree = || local.run(&["scene", "tree"]).succeeded();
    let before = "0 house\n  1 door  mesh 0\n2 tower/old\n  3 door  mesh 0";
    assert_eq!(tree(), before);
    local.run(&["node", "set", "door", "visible=false"]).failed(&["several nodes", "1, 3"]);
    local.run(&["node", "set", "/door", "visible=false"]).failed(&["no such node"]);
    local.run(&["node", "set", "house/door", "visible=false", "attribute.note=broken"]).succeeded();
    local.run(&["node", "set", "/tower/old/door", "position=1,-2,3", "scale=2"]).succeeded();
    let added = ["node", "add", "name=sign", "mesh=0", "--parent", "old/door", "--json"];
    let added = local.run(&added).json();
    assert_eq!((&added["created"][0], &added["is_complete"]), (&4.into(), &true.into()));
    local.run(&["node", "move", "sign", "/"]).succeeded();
    let now = "0 house\n  1 door  mesh 0, hidden, note=broken\n2 tower/old\n  3 door  mesh 0\n\
               4 sign  mesh 0";
    assert_eq!(tree(), now);
    let below = local.run(&["scene", "tree", "--below", "tower/old", "--json"]).json();
    assert_eq!(below.as_array().map(Vec::len), Some(2));
    assert_eq!(below[1]["position"], serde_json::json!([1.0, -2.0, 3.0]));
    assert_eq!(below[1]["scale"], serde_json::json!([2.0, 2.0, 2.0]));
    local.run(&["node", "remove", "sign"]).succeeded();
    local.run(&["node", "remove", "sign"]).failed(&["sign: the open scene has no such node"]);
    local.run(&["node", "move", "0", "1"]).failed(&["node 0 cannot hang from node 1"]);
    local.run(&["node", "set", "0", "width=1"]).failed(&["width=1: there is no key width"]);
    local.run(&["scene", "close"]).succeeded();
}

#[test]
fn a_file_of_operations_is_done_whole_or_not_at_all() {
    let local = wall();
    let path =
        |name: &str, text: &str| local.place.write(name, text.as_bytes()).display().to_string();
    let good = path(
        "good.json",
        r#"[
            { "op": "add", "as": "arm", "name": "arm", "rotation": [90, 0, 0] },
            { "op": "add", "name": "hand", "parent": "$arm", "mesh": 0, "attributes": { "n": 5 } },
            { "op": "move", "node": "house/door", "parent": "$arm" },
            { "op": "set", "node": "$arm", "position": [0, 1, 0] },
            { "op": "remove", "node": 2 }
        ]"#,
    );
    let done = local.run(&["transaction", &good, "--json"]).json();
    assert_eq!(done["created"], serde_json::json!([4, 5]));
    // A turned arm that was raised stays turned.
    let nodes = local.client().find_all_nodes(NodeQuery::default()).expect("found");
    let arm = nodes.iter().find(|node| node.name == "arm").expect("an arm").local;
    assert_eq!(arm.translation.to_array(), [0.0, 1.0, 0.0]);
    assert!((arm.matrix3.x_axis.z + 1.0).abs() < 1e-12, "{arm}");
    let expected = "0 house\n4 arm\n  1 door  mesh 0\n  5 hand  mesh 0, n=5";
    let tree = || local.run(&["scene", "tree"]).succeeded();
    assert_eq!(tree(), expected);
    for (text, parts) in [
        ("[{ \"op\": \"remove\", \"node\": 4 }, { \"op\": \"remove\", \"node\": 99 }]", "node 99"),
        ("[{ \"op\": \"fly\" }]", "operation 0: \"op\" is"),
        ("[{ \"op\": \"set\", \"node\": \"$leg\" }]", "$leg: no operation before this adds it"),
        ("[{ \"op\": \"set\", \"node\": 4, \"colour\": 1 }]", "there is no key colour"),
        ("[{ \"op\": \"move\", \"node\": 4, \"parent\": 1, \"name\": \"b\" }]", "not \"name\""),
        ("[{ \"op\": \"set\", \"node\": 4, \"parent\": 1 }]", "takes node, not \"parent\""),
        ("{}", "not a JSON list of operations"),
        ("[]", "nothing would change"),
    ] {
        let bad = path("bad.json", text);
        local.run(&["transaction", &bad]).failed(&[parts]);
        assert_eq!(tree(), expected, "nothing half done");
    }
    local.run(&["transaction", "missing.json"]).failed(&["missing.json", "No such file"]);
}

#[test]
fn a_pixel_of_the_wall_says_whose_it_is() {
    let local = wall();
    local.run(&["camera", "look-at", "0.25,0.25,3", "0.25,0.25,0"]).succeeded();
    let wall = local.client().wall().expect("a wall");
    let screen = &wall.screens[0];
    let middle = format!("{},{}", screen.canvas.x / 2, screen.canvas.y / 2);
    let said = local.run(&["pick", &screen.name, &middle]).succeeded();
    assert!(said.starts_with("node 1 door at 0.25") && said.contains(", 3.00"), "{said}");
    let hit = local.run(&["pick", &screen.name, &middle, "--json"]).json();
    assert_eq!((&hit["node"], &hit["normal"]), (&1.into(), &serde_json::json!([0.0, 0.0, 1.0])));
    assert_eq!(local.run(&["pick", &screen.name, "0,0"]).succeeded(), "nothing");
    local.run(&["node", "set", "house/door", "visible=false"]).succeeded();
    assert_eq!(local.run(&["pick", &screen.name, &middle]).succeeded(), "nothing");
    let said = local.run(&["query", "ray", "1.2,0.2,5", "0,0,-2"]).succeeded();
    assert_eq!(said, "node 3 door at 1.200000,0.200000,0.000000, 5.000000 away");
    let near = local.run(&["query", "ray", "1.2,0.2,5", "0,0,-2", "--max", "4"]).succeeded();
    assert_eq!(near, "nothing");
    local.run(&["pick", "roof", "0,0"]).failed(&["no screen \"roof\"; it has "]);
    local.run(&["pick", &screen.name, "99999,0"]).failed(&["is not on screen"]);
    local.run(&["query", "ray", "0,0,0", "0,0,0"]).failed(&["a finite direction that is not 0"]);
}

#[test]
fn regions_and_points_of_the_open_scene_are_asked_about() {
    let local = wall();
    let query = |parts: &[&str]| {
        let words: Vec<&str> = ["query"].iter().chain(parts).copied().collect();
        local.run(&words).succeeded()
    };
    // Triangles from (0, 0, 0) and (1, 0, 0), with legs of 1.
    let (left, both) = ("node 1 door", "node 1 door\nnode 3 door");
    let plank = ["box", "-1,0.2,-1", "2,0.3,1"];
    assert_eq!(query(&plank), both);
    assert_eq!(query(&["box", "-1,-1,-1", "1,1,0", "--relation", "inside"]), left);
    assert_eq!(query(&["box", "-1,-1,-1", "0.9,1,0", "--relation", "inside"]), "nothing");
    assert_eq!(query(&["box", "0.2,0.2,0", "0.3,0.3,0", "--relation", "contains"]), left);
    assert_eq!(query(&["sphere", "2.5,0,0", "1", "--relation", "disjoint"]), left);
    assert_eq!(query(&["sphere", "-1,0,0", "1"]), left, "its border belongs to it");
    assert_eq!(query(&["prism", "-1,2", "-0.5,-0.5 0.5,-0.5 0,0.5"]), left);
    assert_eq!(query(&["prism", "2,3", "-0.5,-0.5 0.5,-0.5 0,0.5"]), "nothing");
    assert_eq!(query(&["box", "-1,0.2,-1", "2,0.3,1", "--below", "house"]), left);
    local.run(&["node", "set", "house/door", "position=0,0,-4"]).succeeded();
    assert_eq!(query(&plank), "node 3 door", "as it was edited");
    local.run(&["camera", "look-at", "1.25,0.25,3", "1.25,0.25,0"]).succeeded();
    let wall = local.client().wall().expect("a wall");
    let (screen, size) = (&wall.screens[0].name, wall.screens[0].canvas);
    let whole = format!("{},{}", size.x, size.y);
    assert_eq!(query(&["frustum", screen, "0,0", &whole]), both);
    let lower = format!("{},{}", size.x / 2, size.y / 2);
    assert_eq!(query(&["frustum", screen, "0,0", &lower, "--relation", "inside"]), "nothing");
    let json = query(&["frustum", screen, "0,0", &whole, "--name", "door", "--json"]);
    let nodes: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&nodes[0]["id"], &nodes[1]["position"][0]), (&1.into(), &1.0.into()));

    let near = query(&["nearest", "1.25,0.25,3"]);
    assert_eq!(near, "node 3 door at 1.250000,0.250000,0.000000, 3.000000 away");
    assert_eq!(query(&["nearest", "1.25,0.25,3", "--within", "2.9"]), "nothing");
    let json = query(&["nearest", "0,0,-5", "--json"]);
    let nearest: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&nearest["node"], &nearest["distance"]), (&1.into(), &1.0.into()));
    let seen = query(&["segment", "1.2,0.2,5", "1.2,0.2,-1"]);
    assert_eq!(seen, "node 3 door at 1.200000,0.200000,0.000000, 5.000000 away");
    assert_eq!(query(&["segment", "1.2,0.2,5", "1.2,0.2,0"]), "nothing", "it ends there");
    assert_eq!(query(&["segment", "1.2,0.2,0", "1.2,0.2,-3"]), "nothing", "it begins there");
    local.run(&["node", "set", "3", "rotation=0,90,0"]).succeeded();
    let below = query(&["ground", "1.2,7,0.2"]);
    let is_met = below.starts_with("node 3 door at 1.2") && below.contains(", 7.000000 away");
    assert!(is_met, "{below}");
    let refused = |parts: &[&str], said: &str| {
        let words: Vec<&str> = ["query"].iter().chain(parts).copied().collect();
        local.run(&words).failed(&[said]);
    };
    refused(&["box", "0,1,0", "1,0,1"], "its y ends at 0 and begins at 1; swap the two");
    refused(&["sphere", "0,0,0", "-1"], "its radius is -1; give 0 or more");
    refused(&["prism", "0,1", "0,0 1,1 1,0 0,1"], "edges 0 and 2");
    refused(&["frustum", screen, "9,9", "3,3"], "is empty; give its upper left");
    refused(&["frustum", "roof", "0,0", "3,3"], "no screen \"roof\"");
}
