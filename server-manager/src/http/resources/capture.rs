//! All pictures of one frame, in an archive.

use std::fmt::Write;

use hyper::header::{CONTENT_DISPOSITION, HeaderValue};
use hyper::{Response, StatusCode};
use polyptych_protocol::request::{CaptureInfo, Request, Response as WallResponse};
use serde_json::json;

use super::pictures::{self, OF_TIME, OF_WIDTH};
use crate::http::JpegEncoder;
use crate::http::answer::{self, Body, Refusal};
use crate::http::archive::{Archive, NAME_BYTES_MAX};
use crate::http::connection::Connection;
use crate::http::picture::{Picture, PictureFormat};
use crate::http::route::{Action, Call, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[Route {
    method: "GET",
    path: "/capture",
    summary: "The pictures of all screens and channels, of one frame that is drawn for them, as a \
              tar archive: `screens/NAME.png`, `channels/NAME.png`, and `capture.json`, which \
              names frame, files, sizes and channels that sent none.",
    query: &[OF_WIDTH, OF_TIME, ("format", "png, jpg or rgba; png where it is not given.")],
    body: None,
    action: Action::Capture,
}];

/// Takes all pictures of a frame.
///
/// # Errors
/// The wall cannot be captured.
pub(in crate::http) async fn answer(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let ending = call.query.get("format").unwrap_or("png").to_owned();
    let Some(format) = PictureFormat::from_ending(&ending) else {
        return Err(Refusal::malformed(format!("format is png, jpg or rgba, not {ending:?}")));
    };
    let width = pictures::width(call)?;
    let time_s = call.query.number("time_s")?;
    let turn = pictures::turn(&connection.context).await?;
    let answered = connection.ask(&call.headers, Request::Capture { time_s }).await?;
    let WallResponse::Captured(info) = answered.response else {
        return Err(Refusal::unavailable("the manager sent another answer"));
    };
    let encode_jpeg = connection.context.encode_jpeg;
    let work = move || archive(&info, answered.pieces, (&ending, format, width), encode_jpeg);
    let bytes = tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Refusal::unavailable(format!("a picture failed: {error}")))?
        .map_err(Refusal::unavailable)?;
    let body = Body::Bytes(bytes.into(), Some(turn));
    let mut answer = answer::with_body(StatusCode::OK, "application/x-tar", body);
    let name = HeaderValue::from_static("attachment; filename=\"capture.tar\"");
    answer.headers_mut().insert(CONTENT_DISPOSITION, name);
    Ok(answer)
}

/// Writes the archive of a capture. Each picture is freed once it is in it.
fn archive(
    info: &CaptureInfo,
    pieces: Vec<Vec<u8>>,
    (ending, format, width): (&str, PictureFormat, u32),
    encode_jpeg: JpegEncoder,
) -> Result<Vec<u8>, String> {
    let (mut archive, mut listed) = (Archive::default(), Vec::new());
    for (number, (of, rgba)) in info.pictures.iter().zip(pieces).enumerate() {
        let folder = if of.is_screen { "screens" } else { "channels" };
        let file = file_name(folder, &of.name, number, ending);
        let picture = Picture { width: of.width, height: of.height, rgba };
        if !picture.is_whole() {
            return Err(format!("the picture of {} is not whole", of.name));
        }
        let encoded = picture.scaled(width).encode(format, encode_jpeg)?;
        archive.add(&file, &encoded.bytes)?;
        listed.push(json!({
            "name": of.name,
            "is_screen": of.is_screen,
            "file": file,
            "width": encoded.width,
            "height": encoded.height,
        }));
    }
    let missing: Vec<_> = info
        .missing
        .iter()
        .map(|(name, reason)| json!({ "name": name, "reason": reason }))
        .collect();
    let about = json!({ "frame": info.frame, "pictures": listed, "missing": missing });
    archive.add("capture.json", about.to_string().as_bytes())?;
    Ok(archive.finish())
}

/// Returns the path of a picture in the archive. Letters, digits, `-`, `_` and inner dots stay;
/// each other byte becomes `%XX`. A name that is too long is replaced by the picture's number.
fn file_name(folder: &str, name: &str, number: usize, ending: &str) -> String {
    let mut file = format!("{folder}/");
    for byte in name.bytes() {
        let is_plain = byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
        let is_inner_dot = byte == b'.' && !file.ends_with(['/', '.']);
        if is_plain || is_inner_dot {
            file.push(char::from(byte));
        } else {
            // Writing into a text does not fail.
            let _ = write!(file, "%{byte:02X}");
        }
    }
    file = format!("{file}.{ending}");
    if file.len() <= NAME_BYTES_MAX { file } else { format!("{folder}/{number}.{ending}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_plain_and_lie_in_their_folder() {
        let file = |name: &str| file_name("channels", name, 7, "png");
        assert_eq!(file("front-1_a.b"), "channels/front-1_a.b.png");
        assert_eq!(file("../../etc"), "channels/%2E.%2F.%2E%2Fetc.png");
        assert_eq!(file("a b/ü"), "channels/a%20b%2F%C3%BC.png");
        assert_eq!(file(&"ü".repeat(32)), "channels/7.png");
    }
}
