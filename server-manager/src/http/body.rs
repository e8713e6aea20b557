//! Bodies and queries of requests, with their limits.

use std::borrow::Cow;
use std::future::poll_fn;
use std::pin::Pin;
use std::str::FromStr;
use std::time::Duration;

use hyper::StatusCode;
use hyper::body::{Body, Incoming};
use hyper::header::{CONTENT_LENGTH, CONTENT_TYPE, HeaderMap};
use polyptych_protocol::limits::CALL_BYTES_MAX;
use serde::de::DeserializeOwned;

use super::answer::Refusal;

/// Maximum size of a body: JSON takes about twice the bytes of the same request on TCP, for which
/// [`CALL_BYTES_MAX`] holds here, too.
pub(super) const BODY_BYTES_MAX: usize = 2 * CALL_BYTES_MAX;

/// Maximum size of a body of who has not logged in yet.
pub(super) const STRANGERS_BODY_BYTES_MAX: usize = 4 << 10;

/// Maximum time in which a body must have come.
const BODY_TIME_MAX: Duration = Duration::from_secs(30);

/// Reads a body that is JSON or empty, of at most `bytes_max`.
///
/// # Errors
/// It is too large, of another type, or does not come.
pub(super) async fn read(
    headers: &HeaderMap,
    body: Incoming,
    bytes_max: usize,
) -> Result<Vec<u8>, Refusal> {
    let too_large = || {
        let reason = format!("a body has at most {bytes_max} bytes here; send less at a time");
        Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, reason)
    };
    let length = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok());
    let length = length.and_then(|length| length.parse::<u64>().ok());
    if length.is_some_and(|length| length > bytes_max as u64) {
        return Err(too_large());
    }
    let mut body = body;
    let mut bytes = Vec::new();
    let read = async {
        while let Some(frame) = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await {
            let frame = frame
                .map_err(|error| Refusal::malformed(format!("the body broke off: {error}")))?;
            let Ok(data) = frame.into_data() else { continue };
            if bytes.len() + data.len() > bytes_max {
                return Err(too_large());
            }
            bytes.extend_from_slice(&data);
        }
        Ok(())
    };
    let late = || {
        let reason = format!("the body did not come within {} s", BODY_TIME_MAX.as_secs());
        Refusal::new(StatusCode::REQUEST_TIMEOUT, reason)
    };
    tokio::time::timeout(BODY_TIME_MAX, read).await.map_err(|_| late())??;
    if !bytes.is_empty() && !is_json(headers) {
        // Forms of other pages cannot send this type without asking first.
        let reason = "a body is JSON: say Content-Type: application/json";
        return Err(Refusal::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, reason));
    }
    Ok(bytes)
}

fn is_json(headers: &HeaderMap) -> bool {
    let content_type = headers.get(CONTENT_TYPE).and_then(|of| of.to_str().ok());
    let essence = content_type.and_then(|of| of.split(';').next());
    essence.is_some_and(|essence| essence.trim().eq_ignore_ascii_case("application/json"))
}

/// Parses a body. An empty one is an object without members.
///
/// # Errors
/// It is no JSON, or JSON of another type; with the place.
pub(super) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Refusal> {
    let bytes = if bytes.is_empty() { b"{}" } else { bytes };
    serde_json::from_slice(bytes)
        .map_err(|error| Refusal::malformed(format!("the body is not what is asked for: {error}")))
}

/// The parameters of a URL, behind its `?`.
#[derive(Debug, Default)]
pub(super) struct Query(Vec<(String, String)>);

impl Query {
    /// # Errors
    /// It is no UTF-8, or has a parameter that is not among `known`.
    pub fn parse(text: &str, known: &[&str]) -> Result<Self, Refusal> {
        let mut all = Vec::new();
        for pair in text.split('&').filter(|pair| !pair.is_empty()) {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            let name = decoded_in_query(name)?;
            if !known.contains(&&*name) {
                let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
                return Err(Refusal::malformed(format!(
                    "there is no parameter {name:?} here; there are: {known}"
                )));
            }
            all.push((name.into_owned(), decoded_in_query(value)?.into_owned()));
        }
        Ok(Self(all))
    }

    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(of, _)| of == name).map(|(_, value)| value.as_str())
    }

    /// A number, if it is given.
    ///
    /// # Errors
    /// It is no number.
    pub fn number(&self, name: &str) -> Result<Option<f64>, Refusal> {
        self.parsed(name, "a number")
    }

    /// A whole number, if it is given.
    ///
    /// # Errors
    /// It is no number of this type.
    pub fn whole_number<T: FromStr>(&self, name: &str) -> Result<Option<T>, Refusal> {
        self.parsed(name, "a whole number")
    }

    fn parsed<T: FromStr>(&self, name: &str, kind: &str) -> Result<Option<T>, Refusal> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let wrong = || Refusal::malformed(format!("{name} is {kind}, not {text:?}"));
        text.parse().map(Some).map_err(|_| wrong())
    }
}

/// A part of a query, in which `+` is a space; see [`decoded`].
pub(super) fn decoded_in_query(text: &str) -> Result<Cow<'_, str>, Refusal> {
    if !text.contains('+') {
        return decoded(text);
    }
    decoded(&text.replace('+', "%20")).map(|text| Cow::Owned(text.into_owned()))
}

/// A part of a URL with its `%XX` as characters.
///
/// # Errors
/// It is no UTF-8, or a `%` stands alone.
pub(super) fn decoded(text: &str) -> Result<Cow<'_, str>, Refusal> {
    if !text.contains('%') {
        return Ok(Cow::Borrowed(text));
    }
    let wrong = || Refusal::malformed(format!("{text:?} is no part of a URL in UTF-8"));
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let digits = rest.next().zip(rest.next());
                let digit = |byte: u8| (byte as char).to_digit(16);
                let (high, low) =
                    digits.and_then(|(high, low)| digit(high).zip(digit(low))).ok_or_else(wrong)?;
                (high * 16 + low) as u8
            }
            other => other,
        });
    }
    String::from_utf8(bytes).map(Cow::Owned).map_err(|_| wrong())
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::request::Request;

    use super::*;

    #[test]
    fn parts_of_urls_are_decoded_or_refused() {
        for (text, meant) in
            [("plain", "plain"), ("a%20b+c", "a b+c"), ("%c3%A4", "ä"), ("..%2F..", "../..")]
        {
            assert_eq!(decoded(text).ok().as_deref(), Some(meant), "{text}");
        }
        assert_eq!(decoded_in_query("a%20b+c%2B").ok().as_deref(), Some("a b c+"));
        for text in ["%", "%2", "%zz", "%ff", "a%c3"] {
            assert!(decoded(text).is_err(), "{text}");
        }
    }

    /// The request that lays a view over the wall, with more members of that view.
    fn views_with(members: &str) -> String {
        let camera = r#"{"position": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": 1}"#;
        let view = format!(r#""camera": {camera}, "area": "Wall", "projection": "Wall""#);
        format!(r#"{{"SetViews": [{{{view}{members}}}]}}"#)
    }

    #[test]
    fn unknown_members_of_requests_are_refused() {
        let views = views_with(r#", "layer": ["signs"]"#);
        for (text, unknown) in [
            (r#"{"SetRest": {"idle": 1800}}"#, "idle"),
            (r#"{"SetRest": {"hours": {"from_min": 1, "until_min": 2, "to": 3}}}"#, "to"),
            (r#"{"SetBounds": {"error_px": 1, "rate": 30}}"#, "rate"),
            (r#"{"Edit": {"bas": 3, "edits": [], "is_temporary": false}}"#, "bas"),
            (r#"{"OpenScene": {"path": "x.glb", "scen": "night"}}"#, "scen"),
            (r#"{"ChangeClips": {"clp": "walk", "action": "Pause"}}"#, "clp"),
            (r#"{"ChangeClips": {"action": {"Play": {"sped": 2}}}}"#, "sped"),
            (r#"{"FindNodes": {"nam": "arm", "skip": 0, "count": 1}}"#, "nam"),
            (r#"{"NearestPoint": {"point": [0, 0, 0], "with": 1}}"#, "with"),
            (r#"{"SetHead": {"position": [0, 0, 0], "turn": null}}"#, "turn"),
            (r#"{"SetFog": {"visibility": 9, "height": 0, "half_hight": 3}}"#, "half_hight"),
            (r#"{"FollowNode": {"node": 3, "cam": null}}"#, "cam"),
            (views.as_str(), "layer"),
        ] {
            let refused = parse::<Request>(text.as_bytes()).expect_err(text).reason;
            assert!(refused.contains(&format!("unknown field `{unknown}`")), "{text}: {refused}");
        }
    }

    #[test]
    fn optional_members_of_requests_may_be_missing() {
        let views = views_with("");
        for text in [r#"{"ChangeClips": {"action": "Pause"}}"#, views.as_str()] {
            parse::<Request>(text.as_bytes()).expect(text);
        }
    }

    #[test]
    fn unknown_parameters_are_named() {
        let text = "width=64&max_age_ms=1.5";
        let query = Query::parse(text, &["width", "max_age_ms"]).expect("known");
        assert_eq!(query.whole_number::<u32>("width").expect("a number"), Some(64));
        let refused = query.whole_number::<u64>("max_age_ms").expect_err("no whole number");
        assert_eq!(refused.reason, "max_age_ms is a whole number, not \"1.5\"");
        let refused = Query::parse("with=64", &["width"]).expect_err("not known");
        assert!(refused.reason.contains("\"with\"") && refused.reason.contains("width"));
    }
}
