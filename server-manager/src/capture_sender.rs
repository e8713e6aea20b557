//! Takes the pictures of a capture to the client that asked for them.

use polyptych_files::blob::CHUNK_BYTES_MAX;
use polyptych_protocol::request::{
    CaptureInfo, MessageToClient, ReplyChunk, RequestError, Response,
};

use crate::capture::CaptureJob;
use crate::session::ClientHandle;

/// Stitches off the core's thread, and waits for the client where it reads slowly: few pieces
/// are copied for it at a time, and its other answers overtake them.
pub(crate) async fn send_capture(collection: CaptureJob, link: ClientHandle) {
    let (id, frame) = (collection.job.id, collection.frame);
    let stitched = tokio::task::spawn_blocking(move || collection.stitch()).await;
    let reply = match stitched {
        Err(error) => {
            Err(RequestError::new(format!("the pictures could not be stitched: {error}")))
        }
        Ok((pictures, missing, _room)) => {
            let infos = pictures.iter().map(|picture| picture.info.clone()).collect();
            for (index, picture) in pictures.into_iter().enumerate() {
                let rgba = bytes::Bytes::from(picture.rgba);
                for start in (0..rgba.len()).step_by(CHUNK_BYTES_MAX) {
                    let bytes = rgba.slice(start..rgba.len().min(start + CHUNK_BYTES_MAX));
                    let part = ReplyChunk { id, index: index as u32, bytes };
                    if link
                        .pieces
                        .send(polyptych_codec::encode(&MessageToClient::Chunk(part)))
                        .await
                        .is_err()
                    {
                        return;
                    }
                }
            }
            Ok(Response::Captured(CaptureInfo { frame, pictures: infos, missing }))
        }
    };
    // Behind its pictures, which it must not overtake.
    let _ = link.pieces.send(polyptych_codec::encode(&MessageToClient::Reply { id, reply })).await;
}
