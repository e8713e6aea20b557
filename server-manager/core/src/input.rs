//! The inputs of the core: every `handle_*` call as a value that can be stored and replayed.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::handshake::ServerHello;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::Request;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_scene::{FilePlace, NodeId};
use serde::{Deserialize, Serialize};

use super::{ClientRequest, Cluster, ImportedScene, ImportedSession, Micros, SessionId};

/// One call of a `handle_*` function of [`Cluster`], without its `now`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Input {
    /// [`Cluster::handle_timeout`].
    Timeout,
    /// [`Cluster::handle_server`].
    Server {
        /// Its control connection.
        session: SessionId,
        /// Its introduction.
        hello: ServerHello,
        /// The address that it connects from.
        address: String,
    },
    /// [`Cluster::handle_status`].
    Status {
        /// The server's connection.
        from: SessionId,
        /// The message that it sent.
        status: ServerMessage,
    },
    /// [`Cluster::handle_life`].
    Heard {
        /// The server's connection.
        from: SessionId,
        /// The time at which its last message came.
        at: Micros,
    },
    /// [`Cluster::handle_server_gone`].
    ServerGone {
        /// Its connection.
        session: SessionId,
        /// Why it ended.
        reason: String,
    },
    /// [`Cluster::handle_client`].
    Client {
        /// Its connection.
        session: SessionId,
        /// The name by which it introduces itself.
        name: String,
    },
    /// [`Cluster::handle_client_gone`].
    ClientGone {
        /// Its connection.
        session: SessionId,
    },
    /// [`Cluster::handle_request`].
    Request {
        /// The client's connection.
        client: SessionId,
        /// The client's number.
        id: RequestId,
        /// The request.
        request: Request,
    },
    /// [`Cluster::handle_import`].
    Import {
        /// Who asked.
        job: ClientRequest,
        /// The baked scene, or the reason why there is none.
        imported: Result<ImportedScene, String>,
    },
    /// [`Cluster::handle_progress`].
    Progress {
        /// Who asked.
        job: ClientRequest,
        /// The progress of the baker.
        progress: OpenProgress,
    },
    /// [`Cluster::handle_places`], to [`Cluster::unplaced_nodes`].
    Places {
        /// The manifest of the open scene.
        scene: BlobHash,
        /// The places of these nodes in its file.
        places: Result<Vec<(NodeId, FilePlace)>, String>,
    },
    /// [`Cluster::handle_minute`].
    Minute {
        /// The minute of the day by the manager's clock, from 0 at midnight.
        of_day: u16,
    },
    /// [`Cluster::handle_session`].
    Session {
        /// The request that opens it.
        job: ClientRequest,
        /// The session as it was read, or why it could not be.
        session: Result<Box<ImportedSession>, String>,
    },
}

impl Cluster {
    /// Tells the core something; the `handle_*` function that the input names does the rest.
    ///
    /// # Errors
    /// Those of [`Cluster::handle_server`]: why a server may not have its channels.
    pub fn handle(&mut self, now: Micros, input: Input) -> Result<(), String> {
        match input {
            Input::Timeout => self.handle_timeout(now),
            Input::Server { session, hello, address } => {
                return self.handle_server(now, session, hello, address);
            }
            Input::Status { from, status } => self.handle_status(now, from, status),
            Input::Heard { from, at } => self.handle_life(from, at),
            Input::ServerGone { session, reason } => {
                self.handle_server_gone(now, session, &reason);
            }
            Input::Client { session, name } => self.handle_client(session, name),
            Input::ClientGone { session } => self.handle_client_gone(now, session),
            Input::Request { client, id, request } => {
                self.handle_request(now, client, id, request);
            }
            Input::Progress { job, progress } => self.handle_progress(job, progress),
            Input::Places { scene, places } => self.handle_places(scene, places),
            Input::Minute { of_day } => self.handle_minute(now, of_day),
            Input::Session { job, session } => self.handle_session(now, job, session),
            Input::Import { job, imported } => self.handle_import(now, job, imported),
        }
        Ok(())
    }
}
