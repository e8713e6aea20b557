//! The Rust client, for the conformance cases: each step by the method that it names.

use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DVec2, DVec3};
use polyptych_client::{
    Attribute, CalibrationMarker, ClientError, NewNode, NodeId, NodeQuery, RegionQuery, SceneFile,
    Transaction,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::patterns;

/// Returns what is wrong with a step, a sentence each.
pub fn run(client: &Client, step: &Value) -> Vec<String> {
    let (name, given) = (step["call"].as_str().expect("a name"), Arguments(&step["with"]));
    if let Some(facts) = step.get("picture") {
        let capture = client.capture_at(given.of("time_s")).expect("pictures");
        assert_eq!(capture.missing, [], "channels that sent no picture");
        return patterns::picture_differences(facts, &capture.screens[0]);
    }
    match (call(client, name, &given), step.get("error")) {
        (Ok(answer), None) => patterns::differences(&step["answer"], &answer, "answer"),
        (Ok(answer), Some(_)) => vec![format!("it was not refused, but answered {answer}")],
        (Err(ClientError::Failed { reason, .. }), Some(error)) if error["class"] == "Failed" => {
            patterns::differences(&error["reason"], &json!(reason), "reason")
        }
        (Err(error), _) => vec![error.to_string()],
    }
}

/// The arguments of a step, by name.
struct Arguments<'a>(&'a Value);

impl Arguments<'_> {
    fn of<T: DeserializeOwned>(&self, name: &str) -> T {
        value(&self.0[name])
    }
}

fn value<T: DeserializeOwned>(of: &Value) -> T {
    serde_json::from_value(of.clone()).unwrap_or_else(|error| panic!("{error}: {of}"))
}

type Answer = Result<Value, ClientError>;

/// An answer in the form of the wire.
fn answer<T: Serialize>(answer: Result<T, ClientError>) -> Answer {
    answer.map(|answer| match json!(answer) {
        // Of `()`, which stands for what was done.
        Value::Null if size_of::<T>() == 0 => json!({ "done": true }),
        other => other,
    })
}

fn call(client: &Client, name: &str, given: &Arguments<'_>) -> Answer {
    of_scene(client, name, given)
        .or_else(|| of_camera(client, name, given))
        .or_else(|| of_displays(client, name, given))
        .or_else(|| of_questions(client, name, given))
        .unwrap_or_else(|| panic!("no method {name} is known here"))
}

fn of_scene(client: &Client, name: &str, given: &Arguments<'_>) -> Option<Answer> {
    let text = |name| given.of::<String>(name);
    Some(match name {
        "open_scene" => {
            let file = SceneFile::from(text("path"));
            let scene: Option<String> = given.of("scene");
            answer(client.open_scene(match scene {
                Some(scene) => file.scene(scene),
                None => file,
            }))
        }
        "close_scene" => answer(client.close_scene()),
        "commit" => answer(client.commit(transaction(&given.0["edits"]))),
        "layers" => answer(client.layers()),
        "variants" => answer(client.variants()),
        "set_variant" => {
            answer(client.set_variant(given.of::<Option<String>>("variant").as_deref()))
        }
        "clips" => answer(client.clips()),
        "change_clips" => {
            let clip: Option<String> = given.of("clip");
            answer(client.change_clips(clip.as_deref(), given.of("action")))
        }
        "save_scene" => answer(client.save_scene(text("name"))),
        "saved_scenes" => answer(client.saved_scenes()),
        "scene_files" => answer(client.scene_files()),
        "save_session" => answer(client.save_session(text("name"))),
        "open_session" => answer(client.open_session(text("name"))),
        "sessions" => answer(client.sessions()),
        "remove_session" => answer(client.remove_session(text("name"))),
        "remove_saved_scene" => answer(client.remove_saved_scene(text("name"))),
        _ => return None,
    })
}

fn of_camera(client: &Client, name: &str, given: &Arguments<'_>) -> Option<Answer> {
    Some(match name {
        "set_camera" => answer(client.set_camera(given.of("camera"))),
        "look_at" => {
            answer(client.look_at(given.of("position"), given.of("target"), given.of("up")))
        }
        "set_head" => answer(client.set_head(given.of::<DVec3>("position"))),
        "set_views" => answer(client.set_views(given.of("views"))),
        "clear_views" => answer(client.clear_views()),
        "store_view" => answer(client.store_view(given.of::<String>("name"), given.of("camera"))),
        "remove_view" => answer(client.remove_view(given.of::<String>("name"))),
        "stored_views" => answer(client.stored_views()),
        "play_tour" => answer(client.play_tour(given.of("tour"))),
        "follow_node" => answer(client.follow_node(given.of("follow"))),
        "stop_tour" => answer(client.stop_tour()),
        "tour" => answer(client.tour()),
        _ => return None,
    })
}

fn of_displays(client: &Client, name: &str, given: &Arguments<'_>) -> Option<Answer> {
    Some(match name {
        "render_frame" => answer(client.render_frame_at(given.of("camera"), given.of("time_s"))),
        "start_rendering" => answer(client.start_rendering(given.of("pace"))),
        "pause" => answer(client.pause()),
        "set_output_mode" => answer(client.set_output_mode(given.of("mode"))),
        "set_pattern" => answer(client.set_pattern(given.of("pattern"))),
        "mark_point" => answer(client.mark_point(mark(given))),
        "set_rest" => answer(client.set_rest(value(given.0))),
        "set_exposure" => answer(client.set_exposure(given.of("exposure"))),
        "set_automatic_exposure" => answer(client.set_automatic_exposure()),
        "set_environment" => answer(client.set_environment(given.of("environment"))),
        "set_tone" => answer(client.set_tone(given.of("tone"))),
        "set_fog" => answer(client.set_fog(given.of("fog"))),
        "set_glow" => answer(client.set_glow(given.of("glow"))),
        "set_ambient_occlusion" => {
            answer(client.set_ambient_occlusion(given.of("ambient_occlusion")))
        }
        "set_depth_of_field" => answer(client.set_depth_of_field(given.of("depth_of_field"))),
        "set_bounds" => answer(client.set_bounds(given.of("bounds"))),
        "calibrate" => answer(client.calibrate(given.of::<String>("channel"), given.of("changes"))),
        _ => return None,
    })
}

/// The point of a channel that is to be lit, if one is.
fn mark(given: &Arguments<'_>) -> Option<CalibrationMarker> {
    let channel: Option<String> = given.of("channel");
    channel.map(|channel| CalibrationMarker { channel, point: given.of("point") })
}

fn of_questions(client: &Client, name: &str, given: &Arguments<'_>) -> Option<Answer> {
    let query = || given.of::<NodeQuery>("query");
    Some(match name {
        "status" => answer(client.status()),
        "wall" => answer(client.wall()),
        "presentation" => answer(client.presentation()),
        "statistics" => answer(client.statistics(given.of("reset"))),
        "find_nodes" => answer(client.find_nodes(query())),
        "find_all_nodes" => answer(client.find_all_nodes(query())),
        "find_in_region" => {
            let (region, relation) = (given.of("region"), given.of("relation"));
            answer(client.find_in_region(RegionQuery { region, relation, nodes: query() }))
        }
        "find_all_in_region" => {
            let (region, relation) = (given.of("region"), given.of("relation"));
            answer(client.find_all_in_region(region, relation, query()))
        }
        "pick_region" => {
            answer(client.pick_region(&given.of::<String>("screen"), given.of("corners")))
        }
        "first_between" => answer(client.first_between(given.of("from"), given.of("to"))),
        "is_in_sight" => answer(client.is_in_sight(given.of("from"), given.of("to"))),
        "ground_below" => answer(client.ground_below(given.of("point"))),
        "cast_ray" => answer(client.cast_ray(given.of("query"))),
        "pick" => {
            let (screen, pixel) = (given.of::<String>("screen"), given.of::<DVec2>("pixel"));
            answer(client.pick(&screen, pixel))
        }
        "nearest_point" => answer(client.nearest_point(value(given.0))),
        _ => return None,
    })
}

/// A transaction that is made by its methods.
fn transaction(edits: &Value) -> Transaction {
    let mut transaction = Transaction::default();
    for edit in edits.as_array().expect("edits") {
        let node = || value::<NodeId>(&edit[1]);
        match edit[0].as_str().expect("a method") {
            "create" => {
                let new = &edit[1];
                transaction.create(NewNode {
                    name: value(&new["name"]),
                    local: value::<DAffine3>(&new["local"]),
                    mesh: value(&new["mesh"]),
                    ..NewNode::default()
                });
            }
            "remove" => transaction.remove(node()),
            "set_visible" => transaction.set_visible(node(), value(&edit[2])),
            "set_name" => transaction.set_name(node(), value::<String>(&edit[2])),
            "set_transform" => transaction.set_transform(node(), value(&edit[2])),
            "set_attribute" => {
                let attribute = match &edit[3] {
                    Value::Bool(flag) => Attribute::Bool(*flag),
                    Value::Number(number) => Attribute::Number(number.as_f64().expect("finite")),
                    other => Attribute::Text(value(other)),
                };
                transaction.set_attribute(node(), value::<String>(&edit[2]), Some(attribute));
            }
            "set_layer" => {
                let layer: Option<String> = value(&edit[2]);
                transaction.set_layer(node(), layer.as_deref());
            }
            "set_layer_visible" => {
                transaction.set_layer_visible(value::<String>(&edit[1]), value(&edit[2]));
            }
            other => panic!("no method {other} is known here"),
        }
    }
    transaction
}
