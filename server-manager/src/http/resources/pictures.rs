//! Pictures of the wall, of a screen or of a channel.

use std::sync::Arc;
use std::time::Duration;

use hyper::header::{HeaderName, HeaderValue};
use hyper::{Response, StatusCode};
use polyptych_protocol::request::{CaptureInfo, Request, Response as WallResponse};
use polyptych_text::printable;
use polyptych_wall::Wall;
use polyptych_wall::light_composite::StereoEye;
use tokio::sync::OwnedSemaphorePermit;

use crate::http::HttpContext;
use crate::http::answer::{self, Body, Refusal};
use crate::http::connection::Connection;
use crate::http::picture::{self, EncodedPicture, Picture, PictureFormat};
use crate::http::route::{Action, Call, Route};

/// Maximum number of captures on their way over HTTP, until their pictures are read.
pub(in crate::http) const CAPTURES_MAX: usize = 4;

/// Maximum time that a capture waits for others.
const TURN_TIME_MAX: Duration = Duration::from_secs(10);

/// Maximum age of a shared preview that can be asked for, in milliseconds.
const AGE_MS_MAX: u64 = 60_000;

const WIDTH: HeaderName = HeaderName::from_static("polyptych-width");
const HEIGHT: HeaderName = HeaderName::from_static("polyptych-height");
const FRAME: HeaderName = HeaderName::from_static("polyptych-frame");
const MISSING: HeaderName = HeaderName::from_static("polyptych-missing");

pub(super) const OF_WIDTH: (&str, &str) =
    ("width", "Pixels across, where the picture has more; each is the mean of its light.");
pub(super) const OF_TIME: (&str, &str) =
    ("time_s", "Scene time in seconds; where it is not given, the wall's own clock goes on.");

/// The subject of a picture.
#[derive(Clone, Copy, Debug)]
pub(in crate::http) enum PictureOf {
    Wall,
    Screen,
    Channel,
}

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/wall.{format}",
        summary: "A picture of the whole wall, screens side by side, as png, jpg or rgba (sRGB, \
                  8 bits, rows from the top). It is of a frame drawn for it; with `max_age_ms` \
                  of the last frame, shared by all who ask, at most 1,920 pixels wide.",
        query: &[
            OF_WIDTH,
            OF_TIME,
            ("max_age_ms", "The age that a shared picture may have, in milliseconds."),
        ],
        body: None,
        action: Action::Picture(PictureOf::Wall),
    },
    Route {
        method: "GET",
        path: "/screens/{name}.{format}",
        summary: "A picture of a screen, as it hangs.",
        query: &[OF_WIDTH, OF_TIME],
        body: None,
        action: Action::Picture(PictureOf::Screen),
    },
    Route {
        method: "GET",
        path: "/channels/{name}.{format}",
        summary: "A picture of a channel, as its display has it. With `width` and without \
                  `time_s` it is a preview: it moves no clock, its server sends only about so \
                  many pixels, and it waits for no channel longer than other frames do.",
        query: &[OF_WIDTH, OF_TIME],
        body: None,
        action: Action::Picture(PictureOf::Channel),
    },
    Route {
        method: "GET",
        path: "/scene/previews",
        summary: "The names of scenes that have a preview: those that the wall showed while \
                  somebody watched, since the manager started, at most 64.",
        query: &[],
        body: None,
        action: Action::SceneNames,
    },
    Route {
        method: "GET",
        path: "/scene/previews/{name}.{format}",
        summary: "A small picture of a scene, as the wall last showed it.",
        query: &[],
        body: None,
        action: Action::ScenePicture,
    },
];

/// Takes a picture.
///
/// # Errors
/// There is no such screen or channel, or it cannot be captured.
pub(in crate::http) async fn answer(
    connection: &Connection,
    call: &Call,
    of: PictureOf,
) -> Result<Response<Body>, Refusal> {
    let context = &connection.context;
    let ending = call.names.last().map_or("", String::as_str);
    let format = PictureFormat::from_ending(ending);
    let format = format.ok_or_else(|| Refusal::not_found("pictures are png, jpg or rgba"))?;
    let width = width(call)?;
    let time_s = call.query.number("time_s")?;
    let age_ms: u64 = call.query.whole_number("max_age_ms")?.unwrap_or(0).min(AGE_MS_MAX);
    if age_ms > 0 {
        if time_s.is_some() {
            return Err(Refusal::malformed("a shared picture is of no time of one's own"));
        }
        let age = Duration::from_millis(age_ms);
        let encoded = context.live.preview(age, (format, width), context.encode_jpeg).await?;
        return Ok(with_size(format, encoded, None));
    }
    let turn = turn(context).await?;
    let is_small = call.query.get("width").is_some() && time_s.is_none();
    let request = match of {
        PictureOf::Channel if is_small => small_preview(connection, call, width).await?,
        _ => Request::Capture { time_s },
    };
    let answered = connection.ask(&call.headers, request).await?;
    let WallResponse::Captured(info) = answered.response else {
        return Err(Refusal::unavailable("the manager sent another answer"));
    };
    let (name, encode_jpeg) = (call.name(), context.encode_jpeg);
    let work = move || {
        let picture = choose(&info, answered.pieces, of, &name)?;
        let encoded = picture.scaled(width).encode(format, encode_jpeg);
        Ok::<_, Refusal>((encoded.map_err(Refusal::unavailable)?, info))
    };
    let (encoded, info) = tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Refusal::unavailable(format!("a picture failed: {error}")))??;
    let mut answer = with_size(format, encoded, Some(turn));
    let headers = answer.headers_mut();
    headers.insert(FRAME, HeaderValue::from(info.frame.0));
    let missing: Vec<&str> = info.missing.iter().map(|(name, _)| name.as_str()).collect();
    if let Ok(names) = HeaderValue::from_bytes(printable(&missing.join(", ")).as_bytes())
        && !missing.is_empty()
    {
        headers.insert(MISSING, names);
    }
    Ok(answer)
}

/// Asks for the smallest preview that has enough pixels for a channel's picture of a width: all
/// pixels of a large wall are more than one capture may have, and load the network for nothing.
async fn small_preview(
    connection: &Connection,
    call: &Call,
    width: u32,
) -> Result<Request, Refusal> {
    let answered = connection.ask(&call.headers, Request::DescribeWall).await?;
    let WallResponse::Wall(wall) = answered.response else {
        return Err(Refusal::unavailable("the manager sent another answer"));
    };
    Ok(Request::Preview { width: width_of_all(&wall, &call.name(), width) })
}

/// The pixels across all screens of a preview in which a channel has this many or more, if it has
/// so many. Of a channel that is none it is 1: the preview says which there are.
fn width_of_all(wall: &Wall, channel: &str, width: u32) -> u32 {
    let Some(channel) = wall.channels.iter().find(|of| of.name == channel) else { return 1 };
    let own = u64::from(channel.display_size().x).max(1);
    let all = StereoEye::pixels_across(wall).saturating_mul(u64::from(width)).div_ceil(own);
    u32::try_from(all).unwrap_or(u32::MAX)
}

/// The width that is asked for, at least 1.
pub(super) fn width(call: &Call) -> Result<u32, Refusal> {
    match call.query.whole_number("width")?.unwrap_or(u32::MAX) {
        0 => Err(Refusal::malformed("width is 1 or more")),
        width => Ok(width),
    }
}

/// Waits for a place among the captures.
pub(super) async fn turn(context: &HttpContext) -> Result<OwnedSemaphorePermit, Refusal> {
    let turn = Arc::clone(&context.captures).acquire_owned();
    let turn = tokio::time::timeout(TURN_TIME_MAX, turn).await.ok().and_then(Result::ok);
    turn.ok_or_else(|| {
        let reason = format!("{CAPTURES_MAX} captures are on their way; ask again later");
        Refusal::unavailable(reason)
    })
}

/// Sends the small picture of a scene.
///
/// # Errors
/// There is none.
pub(in crate::http) async fn of_scene(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let (context, name) = (&connection.context, call.name());
    let format = call.names.last().and_then(|ending| PictureFormat::from_ending(ending));
    let format = format.ok_or_else(|| Refusal::not_found("pictures are png, jpg or rgba"))?;
    let found = context.live.scenes().find(&name);
    let picture = found.ok_or_else(|| {
        let names = context.live.scenes().names().join(", ");
        Refusal::not_found(format!("scene {name:?} has no preview; these have: {names}"))
    })?;
    let encode_jpeg = context.encode_jpeg;
    let work = move || picture.encode(format, encode_jpeg);
    let encoded = tokio::task::spawn_blocking(work).await;
    let encoded = encoded.map_err(|error| Refusal::unavailable(error.to_string()))?;
    Ok(with_size(format, encoded.map_err(Refusal::unavailable)?, None))
}

fn choose(
    info: &CaptureInfo,
    mut pieces: Vec<Vec<u8>>,
    of: PictureOf,
    name: &str,
) -> Result<Picture, Refusal> {
    let (is_screen, kind) = match of {
        PictureOf::Wall => {
            let wall = picture::side_by_side(info, pieces);
            return wall.ok_or_else(|| Refusal::unavailable("a picture is not whole"));
        }
        PictureOf::Screen => (true, "screen"),
        PictureOf::Channel => (false, "channel"),
    };
    picture::named(info, &mut pieces, is_screen, name).ok_or_else(|| {
        let all = info.pictures.iter().filter(|of| of.is_screen == is_screen);
        let names: Vec<&str> = all.map(|of| of.name.as_str()).collect();
        let missing = info.missing.iter().find(|(of, _)| !is_screen && of == name);
        if let Some((_, reason)) = missing {
            return Refusal::unavailable(format!("{kind} {name}: {reason}"));
        }
        let names = names.join(", ");
        Refusal::not_found(format!("there is no {kind} {name:?}; there are: {names}"))
    })
}

fn with_size(
    format: PictureFormat,
    encoded: EncodedPicture,
    turn: Option<OwnedSemaphorePermit>,
) -> Response<Body> {
    let EncodedPicture { bytes, width, height } = encoded;
    let body = Body::Bytes(bytes, turn);
    let mut answer = answer::with_body(StatusCode::OK, format.content_type(), body);
    answer.headers_mut().insert(WIDTH, HeaderValue::from(width));
    answer.headers_mut().insert(HEIGHT, HeaderValue::from(height));
    answer
}
