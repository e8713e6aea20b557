//! The scene: opened, closed, saved, changed, and what of it can be chosen.

use hyper::{Response, StatusCode};
use polyptych_protocol::clip::{ClipAction, ClipChange};
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::node_query::NodeQuery;
use polyptych_protocol::request::{Request, Response as WallResponse};
use polyptych_protocol::transaction::Transaction;
use polyptych_scene::NewNode;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::http::answer::{self, Body, Refusal};
use crate::http::connection::Connection;
use crate::http::file_stream::FileStream;
use crate::http::route::{self, Action, Call, Route};

/// The heading from which a scene is seen that was opened, in degrees, as `polyptych open` has it.
const HEADING_DEG: f64 = 30.0;

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/scene",
        summary: "The name and the notes of the open scene, and scenes that are being opened.",
        query: &[],
        body: None,
        action: Action::Read(|status| {
            let (scene, revision) = (&status.scene, status.revision);
            json!({
                "scene": scene,
                "revision": revision,
                "notes": status.notes,
                "opening": status.opening,
                "environment": status.environment,
            })
        }),
    },
    Route {
        method: "GET",
        path: "/scene/files",
        summary: "The scene files in the manager's scene folders, by path; at most 1,024.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListSceneFiles)),
    },
    Route {
        method: "POST",
        path: "/scene/open",
        summary: "Opens a scene by its `path`, as `polyptych open` does: answered once all can \
                  draw it. `scene` chooses one of a file that has several, by its name or its \
                  number as text. The camera is placed so that all of it is seen from \
                  `heading_deg`, unless `keep_camera` is true, and a frame is drawn.",
        query: &[],
        body: Some(|| json!({ "path": "town.glb", "keep_camera": false, "heading_deg": 30.0 })),
        action: Action::OpenScene,
    },
    Route {
        method: "POST",
        path: "/scene/close",
        summary: "Shows no scene.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::CloseScene)),
    },
    Route {
        method: "POST",
        path: "/transaction",
        summary: "Changes the open scene: all of the edits from one frame on, or nothing. Nodes \
                  that it makes are named `new:0`, `new:1` and so on, in the order of their \
                  creations.",
        query: &[],
        body: Some(example_transaction),
        action: Action::Ask(|call| Ok(Request::Edit(call.parse()?))),
    },
    Route {
        method: "POST",
        path: "/scene/nodes",
        summary: "The nodes of the open scene that a question is about.",
        query: &[],
        body: Some(|| json!(NodeQuery::default())),
        action: Action::Ask(|call| Ok(Request::FindNodes(call.parse()?))),
    },
    Route {
        method: "GET",
        path: "/scene/layers",
        summary: "The layers of the open scene.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListLayers)),
    },
    Route {
        method: "GET",
        path: "/scene/variants",
        summary: "The variants of the open scene.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListVariants)),
    },
    Route {
        method: "PUT",
        path: "/scene/variant",
        summary: "Shows a variant by its name, or none.",
        query: &[],
        body: Some(|| json!({ "name": "red" })),
        action: Action::Ask(|call| {
            let VariantBody { name } = call.parse()?;
            let mut transaction = Transaction::default();
            transaction.set_variant(name.as_deref());
            Ok(Request::Edit(transaction))
        }),
    },
    Route {
        method: "GET",
        path: "/scene/animations",
        summary: "The animations of the open scene, and how each is played.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListClips)),
    },
    Route {
        method: "POST",
        path: "/scene/animations",
        summary: "Changes how an animation is played, or all without a `clip`.",
        query: &[],
        body: Some(|| {
            let action = ClipAction::Play { speed: Some(1.0), weight: None, is_looping: None };
            json!(ClipChange { clip: Some("walk".into()), action })
        }),
        action: Action::Ask(|call| Ok(Request::ChangeClips(call.parse()?))),
    },
    Route {
        method: "GET",
        path: "/scene/saved",
        summary: "The scenes that were saved, by name.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListSavedScenes)),
    },
    Route {
        method: "PUT",
        path: "/scene/saved/{name}",
        summary: "Saves the open scene under a name; `saved:NAME` opens it.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::SaveScene { name: call.name() })),
    },
    Route {
        method: "DELETE",
        path: "/scene/saved/{name}",
        summary: "Forgets a saved scene.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::RemoveSavedScene { name: call.name() })),
    },
    Route {
        method: "GET",
        path: "/scene/export.glb",
        summary: "The open scene as it was edited, as binary glTF; or the one of this name that \
                  was `saved`. An answer that breaks off is no file.",
        query: &[("saved", "The name of a saved scene.")],
        body: None,
        action: Action::Export,
    },
    Route {
        method: "PUT",
        path: "/environment",
        summary: "Surrounds scenes by the light of a `file`, of a clear sky with `is_sky`, or of \
                  their own without either.",
        query: &[],
        body: Some(|| json!({ "file": "studio.hdr" })),
        action: Action::Ask(environment),
    },
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OpenBody {
    path: String,
    scene: Option<String>,
    #[serde(default)]
    keep_camera: bool,
    heading_deg: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VariantBody {
    name: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentBody {
    file: Option<String>,
    #[serde(default)]
    is_sky: bool,
}

fn environment(call: &Call) -> Result<Request, Refusal> {
    let source = match call.parse()? {
        EnvironmentBody { file: Some(_), is_sky: true } => {
            return Err(Refusal::malformed("say either file or is_sky, not both"));
        }
        EnvironmentBody { file: Some(path), .. } => EnvironmentSource::File { path },
        EnvironmentBody { is_sky: true, .. } => EnvironmentSource::Sky,
        EnvironmentBody { .. } => EnvironmentSource::None,
    };
    Ok(Request::SetEnvironment(source))
}

/// Sends a scene as a file.
///
/// # Errors
/// The manager's refusal, before the first byte.
pub(in crate::http) async fn export(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let saved = call.query.get("saved").map(str::to_owned);
    let client = connection.new_client(&call.headers).await?;
    let file = FileStream::begin(client, Request::ExportScene { saved }).await?;
    let body = Body::File(Box::new(file));
    Ok(answer::with_body(StatusCode::OK, "model/gltf-binary", body))
}

/// A transaction as JSON, which names the node that it makes by its text.
fn example_transaction() -> Value {
    let mut transaction = json!(Transaction::default());
    let new = NewNode { name: "arm".into(), ..NewNode::default() };
    transaction["edits"] = json!([
        { "Create": { "node": "new:0", "new": new } },
        { "SetParent": { "node": 3, "parent": "new:0" } },
    ]);
    transaction
}

/// Opens a scene.
///
/// # Errors
/// The manager's refusal; then the wall is as it was.
pub(in crate::http) async fn open(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let other = || Refusal::unavailable("the manager sent another answer");
    let OpenBody { path, scene, keep_camera, heading_deg } = call.parse()?;
    let heading_deg = heading_deg.unwrap_or(HEADING_DEG);
    if !heading_deg.is_finite() {
        return Err(Refusal::malformed("heading_deg is a finite number of degrees"));
    }
    let opened = connection.ask(&call.headers, Request::OpenScene { path, scene }).await?;
    let WallResponse::SceneOpened(scene) = opened.response else { return Err(other()) };
    let mut camera = None;
    if let Some(bounds) = scene.bounds.filter(|_| !keep_camera) {
        let described = connection.ask(&call.headers, Request::DescribeWall).await?;
        let WallResponse::Wall(wall) = described.response else { return Err(other()) };
        camera = Some((connection.context.fit_camera)(&wall, &bounds, heading_deg.to_radians()));
    }
    let frame = Request::RenderFrame { camera, time_s: None };
    let shown = connection.ask(&call.headers, frame).await?;
    let WallResponse::Frame(frame) = shown.response else { return Err(other()) };
    let answer = answer::json(StatusCode::OK, &json!({ "scene": scene, "frame": frame }));
    Ok(route::with_warnings(answer, [opened.warnings, shown.warnings].concat()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use polyptych_scene::NodeId;

    use super::*;

    #[test]
    fn nodes_have_texts_where_numbers_are_rounded() {
        let mut made = Transaction::default();
        let arm = made.create(NewNode { name: "arm".into(), ..NewNode::default() });
        made.set_parent(NodeId(3), Some(arm));
        // Programs that send numbers go on.
        for body in [example_transaction(), json!(made)] {
            let read: Transaction = serde_json::from_value(body).expect("a transaction");
            assert_eq!(read, made);
        }
        let node = |text: &str| serde_json::from_str::<NodeId>(text).ok();
        assert_eq!(node("\"new:7\""), Some(NodeId::provisional(7)));
        assert_eq!([node("3"), node("\"3\"")], [Some(NodeId(3)); 2]);
        let wrong = ["-1", "1.5", "\"new:\"", "\"new:-1\"", "\"new:9223372036854775808\"", "\"\""];
        assert_eq!(wrong.map(node), [None; 6]);
        let keyed = BTreeMap::from([(NodeId(3), true)]);
        let text = serde_json::to_string(&keyed).expect("text");
        let read = serde_json::from_str::<BTreeMap<NodeId, bool>>(&text).ok();
        assert_eq!(read, Some(keyed), "keys of objects are texts");
    }
}
