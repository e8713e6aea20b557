//! Errors between an application and its wall.

use std::error::Error;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use polyptych_protocol::handshake_io::ConnectionError;
use polyptych_protocol::request::Response;
use polyptych_protocol::token::TokenError;

/// The reason why a call failed.
///
/// The outcome of an open request that ends with [`ClientError::TimedOut`],
/// [`ClientError::ConnectionLost`] or [`ClientError::ManagerEnded`] is unknown; it is never sent
/// again.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The address names no machine.
    #[error(
        "{address} cannot be resolved ({source}); write HOST:PORT, such as 127.0.0.1:7878, or HOST"
    )]
    Unresolved {
        /// The address as given.
        address: String,
        /// The resolver's reason.
        source: io::Error,
    },
    /// No program listens there.
    #[error("no manager at {address} ({source}); start one with: polyptych manager WALL.toml")]
    NoManager {
        /// Host and port.
        address: String,
        /// The system's reason.
        source: io::Error,
    },
    /// A program may listen there, but does not introduce itself.
    #[error(
        "{address} did not introduce itself as a manager within {after:?}; \
         is the address right, and does a firewall stand between?"
    )]
    NoIntroduction {
        /// Host and port.
        address: String,
        /// The time that this client waited.
        after: Duration,
    },
    /// The manager's secret cannot be read.
    #[error("no token to show to the manager: {0}")]
    Token(#[from] TokenError),
    /// This client's keys cannot be used.
    #[error("no keys to show to the manager: {0}")]
    Keys(#[source] Box<dyn Error + Send + Sync>),
    /// There are keys, and this program cannot use any.
    #[error(
        "the keys in {folder} need TLS, which this program was built without: build it with \
         polyptych-client's feature \"tls\", or unset POLYPTYCH_KEYS for a manager on this machine"
    )]
    WithoutTls {
        /// The keys' folder.
        folder: PathBuf,
    },
    /// The connection would not be encrypted, or the two ends do not believe each other.
    #[error("no secure connection to the manager at {address}: {source}")]
    NotSecured {
        /// Host and port.
        address: String,
        /// The fault, and the fix.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The manager said no.
    #[error("the manager at {address} refused this client: {reason}")]
    Refused {
        /// Host and port.
        address: String,
        /// The manager's own reason.
        reason: String,
    },
    /// The peer at this address is no manager that this client understands.
    #[error("no manager that this client understands at {address}: {source}")]
    Handshake {
        /// Host and port.
        address: String,
        /// The error of the handshake.
        source: ConnectionError,
    },
    /// The request was not sent, since the connection had ended before.
    #[error("cannot {request}: the connection to the manager at {address} has ended: {reason}")]
    Closed {
        /// The name of the request.
        request: &'static str,
        /// Host and port.
        address: String,
        /// The reason why the connection ended.
        reason: String,
    },
    /// The request was not sent: the connection was lost, and did not come back in time.
    #[error(
        "cannot {request}: no connection to the manager at {address} within {after:?} ({reason}); \
         nothing was sent, and the client goes on trying"
    )]
    NotConnected {
        /// The name of the request.
        request: &'static str,
        /// Host and port.
        address: String,
        /// The time that it waited; [`crate::ReconnectPolicy::wait`] sets it.
        after: Duration,
        /// The reason why there is no connection.
        reason: String,
    },
    /// The connection ended while the request was open.
    #[error(
        "the connection to the manager at {address} was lost ({reason}); \
         whether it did \"{request}\" is unknown"
    )]
    ConnectionLost {
        /// The name of the request.
        request: &'static str,
        /// Host and port.
        address: String,
        /// The reason why the connection ended.
        reason: String,
    },
    /// The manager said goodbye while the request was open.
    #[error("the manager at {address} ended ({reason}); whether it did \"{request}\" is unknown")]
    ManagerEnded {
        /// The name of the request.
        request: &'static str,
        /// Host and port.
        address: String,
        /// The manager's own reason.
        reason: String,
    },
    /// No answer came in time.
    #[error(
        "the manager did not answer \"{request}\" within {after:?}; whether it was done is \
         unknown; polyptych status shows which channels it waits for"
    )]
    TimedOut {
        /// The name of the request.
        request: &'static str,
        /// The time that this client waited; [`crate::Timeouts`] sets it.
        after: Duration,
    },
    /// The manager could not do it; the wall is as it was before.
    #[error("cannot {request}: {reason}")]
    Failed {
        /// The name of the request.
        request: &'static str,
        /// The manager's own reason.
        reason: String,
    },
    /// Too many requests wait for their answers.
    #[error(
        "cannot {request}: {limit} requests are open; wait for answers, or drop what is not needed"
    )]
    TooManyOpen {
        /// The name of the request.
        request: &'static str,
        /// [`crate::OPEN_REQUESTS_MAX`].
        limit: usize,
    },
    /// The request does not fit into a message.
    #[error("cannot {request}: it takes {bytes} bytes, and a message holds at most {limit}")]
    RequestTooLarge {
        /// The name of the request.
        request: &'static str,
        /// Its size.
        bytes: usize,
        /// The protocol's limit.
        limit: usize,
    },
    /// The pictures need more memory than this client gives them.
    #[error(
        "the pictures of the wall take more than {limit} bytes; \
         raise ConnectOptions::capture_bytes_max"
    )]
    CaptureTooLarge {
        /// The limit of [`crate::ConnectOptions::capture_bytes_max`].
        limit: usize,
    },
    /// The pieces of a picture don't make a picture.
    #[error("the manager sent pictures that don't fit their description: {reason}")]
    MalformedPicture {
        /// The picture, the data received, and the data expected.
        reason: String,
    },
    /// The file of an exported scene cannot be written.
    #[error("the exported scene cannot be written: {0}")]
    Write(#[source] io::Error),
    /// The pieces of a file don't make the file.
    #[error("the manager sent {bytes} bytes of a file that has {expected}")]
    IncompleteFile {
        /// Bytes that came.
        bytes: u64,
        /// The size of the file.
        expected: u64,
    },
    /// An answer to some other question.
    #[error("the manager answered \"{request}\" with something else: {answer}")]
    WrongAnswer {
        /// The name of the request.
        request: &'static str,
        /// The kind of answer.
        answer: &'static str,
    },
    /// A [`crate::Pending`] gives its answer once.
    #[error("the answer to \"{request}\" was taken before")]
    AnswerTaken {
        /// The name of the request.
        request: &'static str,
    },
    /// The blocking client has no thread to work on.
    #[error("cannot start the client's thread: {0}")]
    Thread(io::Error),
}

impl ClientError {
    /// Returns whether the request was sent and its outcome is unknown. A program that sets cameras
    /// or draws frames goes on with the next; one that opens a scene looks at the status.
    pub fn is_outcome_unknown(&self) -> bool {
        matches!(
            self,
            Self::TimedOut { .. } | Self::ConnectionLost { .. } | Self::ManagerEnded { .. }
        )
    }
}

/// The error of a reply that belongs to some other request.
pub(crate) fn wrong_answer(request: &'static str, reply: &Response) -> ClientError {
    let answer = match reply {
        Response::Done => "done",
        Response::SceneOpened(_) => "a scene's summary",
        Response::Frame(_) => "a frame's feedback",
        Response::Captured(_) => "pictures",
        Response::Status(_) => "the status",
        Response::Wall(_) => "the wall's description",
        Response::Statistics(_) => "statistics",
        Response::Tuned(_) => "a tuning",
        Response::Edited(_) => "an edited scene",
        Response::Nodes(_) => "nodes",
        Response::Ray(_) => "what a ray meets",
        Response::StoredViews(_) => "stored views",
        Response::Tour(_) => "how a tour stands",
        Response::ServersStopped(_) => "the stopped servers",
        Response::Nearest(_) => "the nearest point",
        Response::SavedScenes(_) => "saved scenes",
        Response::Way(_) => "a way",
        Response::Layers(_) => "layers",
        Response::Clips(_) => "animations",
        Response::SessionOpened(_) => "an opened session",
        Response::SceneFiles(_) => "scene files",
        Response::Sessions(_) => "sessions",
        Response::Variants(_) => "variants",
        Response::Tunings(_) => "tunings",
        Response::Exported(_) => "an exported scene",
    };
    ClientError::WrongAnswer { request, answer }
}
