//! The reasons for which a manager does not run.

use polyptych_tls::CredentialsError;

/// Why a manager could not run.
#[derive(Debug, thiserror::Error)]
pub enum ManagerError {
    /// The system gave no random number for the epoch.
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
    /// Its keys are not to be used.
    #[error(transparent)]
    Keys(#[from] CredentialsError),
    /// A file of its wall was not baked.
    #[error("the wall's file {0} was not baked")]
    WallFile(String),
    /// Its state file cannot be read, is another program's, or must be kept and cannot be copied.
    #[error("{0}")]
    State(String),
    /// Another manager has taken the wall over, or its lease could not be renewed.
    #[error("this manager leads no more: {0}")]
    LeaseLost(String),
    /// The listening socket failed.
    #[error("the listening socket failed: {0}")]
    Listener(std::io::Error),
    /// The system gave no thread.
    #[error("the system gives no thread: {0}")]
    Thread(std::io::Error),
    /// The metrics could not be offered.
    #[error("the metrics cannot be offered: {0}")]
    Metrics(std::io::Error),
    /// The HTTP transport could not begin.
    #[error("HTTP cannot be offered: {0}")]
    Http(std::io::Error),
}
