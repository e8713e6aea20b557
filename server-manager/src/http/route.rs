//! The routes: one table, from which requests are found and the description is written.

use hyper::body::Incoming;
use hyper::header::{HeaderMap, HeaderName, HeaderValue};
use hyper::{Method, Request, Response, StatusCode};
use polyptych_protocol::feedback::WallStatus;
use polyptych_protocol::request::{Request as WallRequest, Response as WallResponse};
use polyptych_text::printable;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::answer::{self, Body, Refusal};
use super::body::{self, Query};
use super::client::Answered;
use super::connection::Connection;
use super::picture::PictureFormat;
use super::resources;

/// The path before all routes.
pub(super) const BASE: &str = "/api/v1";

/// The header with a warning of the manager, such as that a change is not kept over a restart.
const WARNING: HeaderName = HeaderName::from_static("polyptych-warning");

/// A route.
pub(super) struct Route {
    pub method: &'static str,
    /// Behind [`BASE`]. `{name}` stands for a name, `.{format}` for the ending of a picture.
    pub path: &'static str,
    /// A sentence for the description.
    pub summary: &'static str,
    /// Parameters of the URL: name and meaning.
    pub query: &'static [(&'static str, &'static str)],
    /// An example of the body, where there is one.
    pub body: Option<fn() -> Value>,
    pub action: Action,
}

/// The action of a route.
#[derive(Clone, Copy)]
pub(super) enum Action {
    /// Asks the wall, and answers with what it says.
    Ask(fn(&Call) -> Result<WallRequest, Refusal>),
    /// Answers with a part of the status.
    Read(fn(&WallStatus) -> Value),
    /// Opens a scene, places the camera, and draws a frame.
    OpenScene,
    /// Moves the camera to a stored view.
    ShowView,
    /// Any request, in the form of its type.
    Request,
    /// Takes a picture.
    Picture(resources::pictures::PictureOf),
    /// Sends the picture of a scene, or the names of scenes that have one.
    ScenePicture,
    SceneNames,
    /// Takes all pictures of a frame.
    Capture,
    /// Finds what a pixel shows.
    Pick,
    /// Sends a scene as a file.
    Export,
    Events,
    /// Turns the connection into a WebSocket.
    Live,
    Description,
    /// Begins a login.
    Challenge,
    /// Ends a login.
    Code,
}

/// A request for a route.
pub(super) struct Call {
    pub headers: HeaderMap,
    /// The names in the path, in order.
    pub names: Vec<String>,
    pub query: Query,
    pub body: Vec<u8>,
}

impl Call {
    /// The body as a value.
    ///
    /// # Errors
    /// It is another one.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, Refusal> {
        body::parse(&self.body)
    }

    /// A name in the path.
    pub fn name(&self) -> String {
        self.names.first().cloned().unwrap_or_default()
    }
}

impl Route {
    /// Returns whether it is for who has not logged in yet.
    pub fn is_open(&self) -> bool {
        matches!(self.action, Action::Challenge | Action::Code)
    }
}

/// All routes, in the order of the description.
pub(super) fn all() -> impl Iterator<Item = &'static Route> {
    let tables = [
        resources::wall::ROUTES,
        resources::pictures::ROUTES,
        resources::capture::ROUTES,
        resources::pick::ROUTES,
        resources::scene::ROUTES,
        resources::saved_sessions::ROUTES,
        resources::camera::ROUTES,
        resources::presentation::ROUTES,
        resources::live::ROUTES,
        resources::session::ROUTES,
    ];
    tables.into_iter().flatten()
}

/// A route and what its path names.
pub(super) struct Found {
    pub route: &'static Route,
    names: Vec<String>,
}

/// Finds the route of a request.
///
/// # Errors
/// 404, or 405 with the methods that there are.
pub(super) fn find(method: &Method, path: &str) -> Result<Found, Refusal> {
    let method = if *method == Method::HEAD { "GET" } else { method.as_str() };
    let mut allowed = Vec::new();
    for route in all() {
        let Some(names) = path.strip_prefix(BASE).and_then(|rest| names(route.path, rest)) else {
            continue;
        };
        if route.method == method {
            return Ok(Found { route, names: names? });
        }
        allowed.push(route.method);
    }
    let path = printable(path);
    if allowed.is_empty() {
        let reason = format!("there is no {path} here; {BASE}/openapi.json lists what there is");
        return Err(Refusal::not_found(reason));
    }
    let allowed = allowed.join(", ");
    let reason = format!("{path} is not for {}; it is for {allowed}", printable(method));
    Err(Refusal { allow: Some(allowed), ..Refusal::new(StatusCode::METHOD_NOT_ALLOWED, reason) })
}

/// The names in a path, if it has this form.
fn names(pattern: &str, path: &str) -> Option<Result<Vec<String>, Refusal>> {
    let mut names = Vec::new();
    let (mut wanted, mut given) = (pattern.split('/'), path.split('/'));
    loop {
        match (wanted.next(), given.next()) {
            (None, None) => break,
            (Some(wanted), Some(given)) if fits(wanted, given, &mut names) => {}
            _ => return None,
        }
    }
    Some(names.into_iter().map(|name| body::decoded(name).map(Into::into)).collect())
}

fn fits<'a>(pattern: &str, part: &'a str, names: &mut Vec<&'a str>) -> bool {
    if let Some(stem) = pattern.strip_suffix(".{format}") {
        let Some((left, ending)) = part.rsplit_once('.') else { return false };
        if PictureFormat::from_ending(ending).is_none() || !fits(stem, left, names) {
            return false;
        }
        names.push(ending);
        return true;
    }
    if pattern.starts_with('{') {
        names.push(part);
        return !part.is_empty();
    }
    pattern == part
}

/// Answers a request for a route.
///
/// # Errors
/// The refusal, with its reason.
pub(super) async fn answer(
    connection: &Connection,
    found: Found,
    request: Request<Incoming>,
) -> Result<Response<Body>, Refusal> {
    let Found { route, names } = found;
    if matches!(route.action, Action::Live) {
        return resources::live::begin(connection, request).await;
    }
    let (parts, incoming) = request.into_parts();
    let known: Vec<&str> = route.query.iter().map(|(name, _)| *name).collect();
    let query = Query::parse(parts.uri.query().unwrap_or_default(), &known)?;
    let headers = parts.headers;
    let bytes_max =
        if route.is_open() { body::STRANGERS_BODY_BYTES_MAX } else { body::BODY_BYTES_MAX };
    let body = body::read(&headers, incoming, bytes_max).await?;
    if route.body.is_none() && !body.is_empty() {
        return Err(Refusal::malformed(format!("{BASE}{} takes no body", route.path)));
    }
    let call = Call { headers, names, query, body };
    match route.action {
        Action::Ask(request) => {
            let answered = connection.ask(&call.headers, request(&call)?).await?;
            Ok(answer_of(answered))
        }
        Action::Read(read) => {
            let answered = connection.ask(&call.headers, WallRequest::Status).await?;
            let WallResponse::Status(status) = answered.response else {
                return Err(Refusal::unavailable("the manager sent another answer"));
            };
            Ok(answer::json(StatusCode::OK, &read(&status)))
        }
        Action::OpenScene => resources::scene::open(connection, &call).await,
        Action::ShowView => resources::camera::show_view(connection, &call).await,
        Action::Request => resources::session::request(connection, &call).await,
        Action::Picture(of) => resources::pictures::answer(connection, &call, of).await,
        Action::ScenePicture => resources::pictures::of_scene(connection, &call).await,
        Action::SceneNames => {
            let names = connection.context.live.scenes().names();
            Ok(answer::json(StatusCode::OK, &names))
        }
        Action::Capture => resources::capture::answer(connection, &call).await,
        Action::Pick => resources::pick::answer(connection, &call).await,
        Action::Export => resources::scene::export(connection, &call).await,
        // Begun above, before its body would be read.
        Action::Live => Err(Refusal::malformed("this is a WebSocket")),
        Action::Events => Ok(resources::session::events(connection, &call)),
        Action::Description => Ok(answer::json(StatusCode::OK, &super::openapi::description())),
        Action::Challenge => resources::session::challenge(connection, &call),
        Action::Code => resources::session::code(connection, &call),
    }
}

/// The wall's response as JSON, without the name of its type.
pub(super) fn answer_of(answered: Answered) -> Response<Body> {
    let value = match serde_json::to_value(&answered.response) {
        Ok(Value::Object(object)) => object.into_iter().next().map(|(_, inner)| inner),
        _ => None,
    };
    let value = value.unwrap_or_else(|| json!({ "done": true }));
    with_warnings(answer::json(StatusCode::OK, &value), answered.warnings)
}

/// An answer with the manager's warnings in its headers. Several requests of one call may each
/// bring the same warning; it is sent once.
pub(super) fn with_warnings(
    mut answer: Response<Body>,
    mut warnings: Vec<String>,
) -> Response<Body> {
    warnings.dedup();
    for warning in warnings {
        if let Ok(value) = HeaderValue::from_bytes(printable(&warning).as_bytes()) {
            answer.headers_mut().append(WARNING, value);
        }
    }
    answer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_found_as_they_stand() {
        let found = |method: Method, path: &str| {
            let found = find(&method, path).map_err(|refusal| refusal.status.as_u16());
            found.map(|found| (found.route.path, found.names))
        };
        let is = |path: &'static str, names: &[&str]| {
            Ok((path, names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>()))
        };
        assert_eq!(found(Method::GET, "/api/v1/status"), is("/status", &[]));
        assert_eq!(found(Method::HEAD, "/api/v1/status"), is("/status", &[]));
        assert_eq!(found(Method::GET, "/api/v1/wall"), is("/wall", &[]));
        assert_eq!(found(Method::GET, "/api/v1/wall.jpg"), is("/wall.{format}", &["jpg"]));
        let channel = "/channels/{name}.{format}";
        assert_eq!(found(Method::GET, "/api/v1/channels/a.b.png"), is(channel, &["a.b", "png"]));
        assert_eq!(found(Method::DELETE, "/api/v1/views/a%2Fb"), is("/views/{name}", &["a/b"]));
        for path in [
            "/api/v1/../v1/status",
            "/api/v1/status/",
            "/api/v1//status",
            "/api/v1/./status",
            "/api/v1/%2e%2e/status",
            "/api/v1/wall.exe",
            "/api/v1/views/",
            "/api/v1",
            "/etc/passwd",
            "",
        ] {
            assert_eq!(found(Method::GET, path), Err(404), "{path}");
        }
        assert_eq!(found(Method::DELETE, "/api/v1/views/%ff"), Err(400));
        assert_eq!(found(Method::POST, "/api/v1/status"), Err(405));
        let refused = find(&Method::POST, "/api/v1/camera").err().expect("no such method");
        assert_eq!(refused.allow.as_deref(), Some("GET, PUT"));
    }

    #[test]
    fn every_warning_has_a_header() {
        let warnings = ["not kept", "not kept", "größe"].map(str::to_owned).to_vec();
        let answer = with_warnings(answer::json(StatusCode::OK, &json!({})), warnings);
        let sent = answer.headers().get_all(WARNING).iter().map(HeaderValue::as_bytes);
        let sent: Vec<&[u8]> = sent.collect();
        assert_eq!(sent, ["not kept".as_bytes(), "größe".as_bytes()]);
    }

    #[test]
    fn no_two_routes_are_the_same() {
        let mut seen = std::collections::BTreeSet::new();
        for route in all() {
            assert!(seen.insert((route.method, route.path)), "{} {}", route.method, route.path);
            assert!(route.summary.ends_with('.'), "{}", route.summary);
        }
    }
}
