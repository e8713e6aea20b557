//! Reaching a manager, over TLS where there are keys. No other file knows whether TLS is built in.

use polyptych_protocol::stream::{ConnectError, Stream};

use crate::connect::ConnectOptions;
use crate::error::ClientError;

/// Connects; with keys, whose client's name then is this one's.
#[cfg(feature = "tls")]
pub(crate) async fn dial(options: &mut ConnectOptions) -> Result<Stream, ClientError> {
    let refused = |error: polyptych_tls::CredentialsError| ClientError::Keys(Box::new(error));
    let keys = match &options.keys {
        Some(folder) => {
            let keys = polyptych_tls::Credentials::load(folder).map_err(refused)?;
            keys.client_name().map_err(refused)?.clone_into(&mut options.name);
            for warning in keys.warnings() {
                tracing::warn!("{warning}");
            }
            Some(keys)
        }
        None => None,
    };
    let dialed = polyptych_tls::connect(&options.address, keys.as_ref(), options.insecure).await;
    dialed.map_err(|error| match error {
        polyptych_tls::ConnectError::Stream(error) => in_words(&options.address, error),
        other => not_secured(&options.address, other),
    })
}

/// Connects, without keys.
#[cfg(not(feature = "tls"))]
pub(crate) async fn dial(options: &mut ConnectOptions) -> Result<Stream, ClientError> {
    use polyptych_protocol::stream;
    if let Some(folder) = &options.keys {
        return Err(ClientError::WithoutTls { folder: folder.clone() });
    }
    let address = &options.address;
    let dialed = stream::connect(address, options.insecure).await;
    dialed.map(Stream::Plain).map_err(|error| in_words(address, error))
}

fn in_words(address: &str, error: ConnectError) -> ClientError {
    match error {
        ConnectError::Unresolved(source) => {
            ClientError::Unresolved { address: address.to_owned(), source }
        }
        ConnectError::Unreachable(source) => {
            ClientError::NoManager { address: address.to_owned(), source }
        }
        other @ ConnectError::InTheClear(_) => not_secured(address, other),
    }
}

fn not_secured(
    address: &str,
    source: impl std::error::Error + Send + Sync + 'static,
) -> ClientError {
    ClientError::NotSecured { address: address.to_owned(), source: Box::new(source) }
}
