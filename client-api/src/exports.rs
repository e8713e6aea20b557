//! Scenes as files.

use std::io::Write;

use polyptych_protocol::exported_scene::ExportedScene;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{Request, Response};
use tokio::sync::{mpsc, watch};

use crate::client::Client;
use crate::connection_handle::Wanted;
use crate::error::{ClientError, wrong_answer};
use crate::image::ChunkSink;

/// Pieces of a file, each of at most a mebibyte, that wait to be written.
const PIECES_MAX: usize = 2;

impl Client {
    /// Writes a scene with all that was changed of it as a binary glTF file (`.glb`): the one of
    /// this name that was saved, or the open one, without what is temporary. Programs that read
    /// glTF show it, and a wall shows it as it is.
    ///
    /// Little of the file is in memory at a time. It is written while this future is polled: to a
    /// slow disk, write from `spawn_blocking`, with [`crate::blocking::Client::export_scene`].
    /// Other answers of this connection wait while the file does.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where there is no such scene,
    /// [`ClientError::Write`] where `to` fails. What was written then is no file.
    pub async fn export_scene(
        &self,
        saved: Option<&str>,
        to: &mut (impl Write + ?Sized),
    ) -> Result<ExportedScene, ClientError> {
        self.export_scene_with(saved, to, |_| {}).await
    }

    /// Does what [`Client::export_scene`] does, and calls `on_progress` whenever the manager says
    /// how far it has come, before the first byte is written.
    ///
    /// # Errors
    /// Those of [`Client::export_scene`].
    pub async fn export_scene_with(
        &self,
        saved: Option<&str>,
        to: &mut (impl Write + ?Sized),
        mut on_progress: impl FnMut(OpenProgress),
    ) -> Result<ExportedScene, ClientError> {
        let (queue, mut pieces) = mpsc::channel(PIECES_MAX);
        let (sender, mut progress) = watch::channel(OpenProgress::NONE);
        let parts = Some(ChunkSink::File(queue));
        let request = Request::ExportScene { saved: saved.map(str::to_owned) };
        let wanted = Wanted { parts, progress: Some(sender), ..Wanted::default() };
        let mut pending = self.link.post(request, wanted)?;
        let mut bytes = 0;
        let mut write = |piece: bytes::Bytes| {
            bytes += piece.len() as u64;
            to.write_all(&piece).map_err(ClientError::Write)
        };
        let reply = loop {
            tokio::select! {
                biased;
                Some(piece) = pieces.recv() => write(piece)?,
                reply = &mut pending => break reply?,
                Ok(()) = progress.changed() => on_progress(*progress.borrow_and_update()),
            }
        };
        // All of them were in the queue before the reply was.
        while let Ok(piece) = pieces.try_recv() {
            write(piece)?;
        }
        match reply {
            Response::Exported(about) if about.bytes == bytes => Ok(about),
            Response::Exported(about) => {
                Err(ClientError::IncompleteFile { bytes, expected: about.bytes })
            }
            other => Err(wrong_answer("export the scene", &other)),
        }
    }
}
