//! The page for browsers: files in the program, which load nothing from elsewhere, and the login.

use bytes::Bytes;
use hyper::header::{CONTENT_SECURITY_POLICY, HeaderValue, LOCATION, SET_COOKIE};
use hyper::{Method, Response, StatusCode};

use super::answer::{self, Body, Refusal};
use super::body::Query;
use super::trust::Gate;

/// Nothing but the manager's own files, and pictures that the page makes of its answers.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src 'self' blob:; connect-src 'self'; form-action 'none'; \
                      base-uri 'none'; frame-ancestors 'none'";

/// The type of the page's modules.
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Path, type and text of the page's files.
const FILES: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("console/index.html")),
    ("/console.css", "text/css; charset=utf-8", include_str!("console/console.css")),
    ("/icon.svg", "image/svg+xml", include_str!("console/icon.svg")),
    ("/alignment.js", SCRIPT, include_str!("console/alignment.js")),
    ("/camera.js", SCRIPT, include_str!("console/camera.js")),
    ("/console.js", SCRIPT, include_str!("console/console.js")),
    ("/displays.js", SCRIPT, include_str!("console/displays.js")),
    ("/handles.js", SCRIPT, include_str!("console/handles.js")),
    ("/hanging.js", SCRIPT, include_str!("console/hanging.js")),
    ("/health.js", SCRIPT, include_str!("console/health.js")),
    ("/light.js", SCRIPT, include_str!("console/light.js")),
    ("/picture.js", SCRIPT, include_str!("console/picture.js")),
    ("/plots.js", SCRIPT, include_str!("console/plots.js")),
    ("/quaternion.js", SCRIPT, include_str!("console/quaternion.js")),
    ("/requests.js", SCRIPT, include_str!("console/requests.js")),
    ("/scenes.js", SCRIPT, include_str!("console/scenes.js")),
    ("/state.js", SCRIPT, include_str!("console/state.js")),
    ("/views.js", SCRIPT, include_str!("console/views.js")),
];

/// The answer to a request for a file of the page, if it is one. There is no secret in them, so
/// that whoever has not logged in learns how to.
pub(super) fn answer(method: &Method, path: &str) -> Option<Response<Body>> {
    let (_, content_type, text) = FILES.iter().find(|(of, ..)| *of == path)?;
    if !matches!(*method, Method::GET | Method::HEAD) {
        let refusal = Refusal::new(StatusCode::METHOD_NOT_ALLOWED, "the page is for GET");
        return Some(Refusal { allow: Some("GET".into()), ..refusal }.into_answer());
    }
    let bytes = Bytes::from_static(text.as_bytes());
    let mut answer = answer::with_type(StatusCode::OK, content_type, bytes);
    answer.headers_mut().insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    Some(answer)
}

/// Answers who opens the link of a login: with a cookie, and the way to the page, whose address
/// has no secret.
///
/// # Errors
/// The code is not good.
pub(super) fn log_in(
    gate: &Gate,
    method: &Method,
    query: Option<&str>,
) -> Result<Response<Body>, Refusal> {
    if *method != Method::GET {
        let refusal = Refusal::new(StatusCode::METHOD_NOT_ALLOWED, "a link is opened with GET");
        return Err(Refusal { allow: Some("GET".into()), ..refusal });
    }
    let query = Query::parse(query.unwrap_or_default(), &["code"])?;
    let cookie = gate.redeem(query.get("code").unwrap_or_default())?;
    let cookie = HeaderValue::try_from(cookie).map_err(|_| Refusal::unavailable("no cookie"))?;
    let mut answer =
        answer::with_type(StatusCode::SEE_OTHER, "text/plain; charset=utf-8", Bytes::new());
    answer.headers_mut().insert(SET_COOKIE, cookie);
    answer.headers_mut().insert(LOCATION, HeaderValue::from_static("/"));
    Ok(answer)
}
