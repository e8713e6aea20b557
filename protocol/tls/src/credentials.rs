//! A node's keys: the folder that `polyptych keys` made for it, and TLS as set up with it.
//!
//! A folder holds `cert.pem`, `key.pem` and `authority.pem`. Both sides of a connection show a
//! certificate that the wall's authority made; TLS 1.3 is the only version, and nothing is resumed,
//! so that every connection is checked anew.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use std::{fmt, fs};

use polyptych_files::private_file;
use tokio_rustls::rustls::client::{Resumption, WebPkiServerVerifier};
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use tokio_rustls::rustls::version::TLS13;
use tokio_rustls::rustls::{ClientConfig, Error, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, TlsConnector};

use crate::describe;
use crate::identity::NodeIdentity;

/// The node's certificate, in its folder.
pub const CERTIFICATE_FILE: &str = "cert.pem";

/// The node's private key, in its folder.
pub const KEY_FILE: &str = "key.pem";

/// The certificate of the wall's authority, in every node's folder.
pub const AUTHORITY_FILE: &str = "authority.pem";

/// Largest file of keys that is read: ours have about 600 bytes.
const FILE_BYTES_MAX: u64 = 64 << 10;

/// The time before a certificate's end from which on a warning is given: enough to renew it on
/// site.
const WARN_TIME: Duration = Duration::from_hours(60 * 24);

/// Why keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CredentialsError {
    /// A file is missing.
    #[error(
        "{path} is not there; --keys takes a node's folder, as polyptych keys WALL.toml makes it"
    )]
    NotThere {
        /// The file.
        path: PathBuf,
    },
    /// The file system says so.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Other users can read the private key, or own it.
    #[error("{0}")]
    Open(String),
    /// The file does not hold what it must.
    #[error("{path}: {what}")]
    Unfit {
        /// The file.
        path: PathBuf,
        /// The fault, and the fix.
        what: String,
    },
    /// The keys are good, but by this machine's clock their time has not begun.
    #[error(
        "{path}: its time has not begun by this machine's clock; set the clocks of both machines"
    )]
    NotYetValid {
        /// The certificate.
        path: PathBuf,
        /// The certificate's node.
        identity: NodeIdentity,
    },
    /// The keys are good, but another node's.
    #[error("{path} is the certificate of {found}, and that of {wanted} is needed")]
    AnotherNode {
        /// The certificate.
        path: PathBuf,
        /// The certificate's node.
        found: NodeIdentity,
        /// The node whose certificate is needed.
        wanted: String,
    },
}

/// A node's keys, checked.
#[derive(Clone)]
pub struct Credentials {
    certificate: PathBuf,
    identity: NodeIdentity,
    warnings: Vec<String>,
    side: TlsSide,
}

/// A manager accepts, all others connect.
#[derive(Clone)]
enum TlsSide {
    Manager(TlsAcceptor),
    Node(TlsConnector, ServerName<'static>),
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { certificate, identity, .. } = self;
        f.debug_struct("Keys")
            .field("certificate", certificate)
            .field("identity", identity)
            .finish_non_exhaustive()
    }
}

impl Credentials {
    /// Reads and checks a node's folder.
    ///
    /// # Errors
    /// [`CredentialsError`], which names the file: missing, malformed, of another authority, not
    /// valid now, open to other users, or a key that does not fit its certificate.
    pub fn load(folder: &Path) -> Result<Self, CredentialsError> {
        let path = |name: &str| folder.join(name);
        let certificate = certificate(&path(CERTIFICATE_FILE))?;
        let authority = certificate_of(&path(AUTHORITY_FILE), "a certificate authority's")?;
        let key_bytes = read(&path(KEY_FILE))?;
        let key = PrivateKeyDer::from_pem_slice(&key_bytes)
            .map_err(|error| unfit(&path(KEY_FILE), format!("it holds no private key: {error}")))?;
        let unfit_certificate = |what| unfit(&path(CERTIFICATE_FILE), what);
        let identity = NodeIdentity::from_certificate(&certificate).map_err(unfit_certificate)?;

        let mut roots = RootCertStore::empty();
        roots.add(authority).map_err(|error| {
            unfit(&path(AUTHORITY_FILE), format!("it is no authority's certificate: {error}"))
        })?;
        let judge =
            PeerVerifier { provider: Arc::new(ring::default_provider()), roots: Arc::new(roots) };
        let now = UnixTime::now();
        let verdict = |at| judge.verify(&identity, &certificate, at);
        match verdict(now) {
            Ok(()) => {}
            Err(Error::InvalidCertificate(fault)) if describe::is_not_yet_valid(&fault) => {
                return Err(CredentialsError::NotYetValid {
                    path: path(CERTIFICATE_FILE),
                    identity,
                });
            }
            Err(error) => return Err(unfit_certificate(own_fault(&error))),
        }
        let mut warnings = Vec::new();
        let soon = UnixTime::since_unix_epoch(Duration::from_secs(now.as_secs()) + WARN_TIME);
        if verdict(soon).is_err() {
            let (cert, days) = (path(CERTIFICATE_FILE), WARN_TIME.as_secs() / 86_400);
            warnings.push(format!(
                "{}: its time is over within {days} days; make new ones: polyptych keys WALL.toml \
                 -o DIR --renew",
                cert.display()
            ));
        }
        let facts = fs::metadata(path(KEY_FILE))
            .map_err(|source| CredentialsError::Io { path: path(KEY_FILE), source })?;
        if let Some(fault) = private_file::fault(&path(KEY_FILE), &facts) {
            return Err(CredentialsError::Open(fault));
        }
        let side = judge.side(&identity, certificate, key);
        let side = side.map_err(|error| {
            unfit(&path(KEY_FILE), format!("it does not fit {CERTIFICATE_FILE}: {error}"))
        })?;
        Ok(Self { certificate: path(CERTIFICATE_FILE), identity, warnings, side })
    }

    /// Returns the node that the credentials belong to.
    pub fn identity(&self) -> &NodeIdentity {
        &self.identity
    }

    /// Returns warnings for the operator, one line each, such as a certificate that ends soon.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Checks that the credentials belong to this node.
    ///
    /// # Errors
    /// [`CredentialsError::AnotherNode`].
    pub fn expect_identity(&self, wanted: &NodeIdentity) -> Result<(), CredentialsError> {
        if self.identity == *wanted { Ok(()) } else { Err(self.of_another(wanted.to_string())) }
    }

    /// The name of the render server whose they are.
    ///
    /// # Errors
    /// [`CredentialsError::AnotherNode`].
    pub fn server_name(&self) -> Result<&str, CredentialsError> {
        match &self.identity {
            NodeIdentity::Server(name) => Ok(name),
            _ => Err(self.of_another("a server".into())),
        }
    }

    /// The name of the client whose they are.
    ///
    /// # Errors
    /// [`CredentialsError::AnotherNode`].
    pub fn client_name(&self) -> Result<&str, CredentialsError> {
        match &self.identity {
            NodeIdentity::Client(name) => Ok(name),
            _ => Err(self.of_another("a client".into())),
        }
    }

    fn of_another(&self, wanted: String) -> CredentialsError {
        let (path, found) = (self.certificate.clone(), self.identity.clone());
        CredentialsError::AnotherNode { path, found, wanted }
    }

    /// The manager's side of TLS; `None` for the keys of other nodes.
    pub(crate) fn acceptor(&self) -> Option<&TlsAcceptor> {
        if let TlsSide::Manager(acceptor) = &self.side { Some(acceptor) } else { None }
    }

    /// The side of all other nodes, and the name of the peer to expect; `None` for a manager's
    /// keys.
    pub(crate) fn connector(&self) -> Option<(&TlsConnector, &ServerName<'static>)> {
        if let TlsSide::Node(connector, name) = &self.side { Some((connector, name)) } else { None }
    }
}

/// Checks certificates against one authority.
struct PeerVerifier {
    provider: Arc<CryptoProvider>,
    roots: Arc<RootCertStore>,
}

impl PeerVerifier {
    /// Checks that the other side would accept this certificate at that time.
    fn verify(
        &self,
        identity: &NodeIdentity,
        certificate: &CertificateDer<'_>,
        at: UnixTime,
    ) -> Result<(), Error> {
        use tokio_rustls::rustls::client::danger::ServerCertVerifier as _;
        let (roots, provider) = (self.roots.clone(), self.provider.clone());
        let no_verifier = |error: tokio_rustls::rustls::server::VerifierBuilderError| {
            Error::General(error.to_string())
        };
        match identity {
            NodeIdentity::Manager => {
                let verifier = WebPkiServerVerifier::builder_with_provider(roots, provider);
                let verifier = verifier.build().map_err(no_verifier)?;
                let name = manager_name()?;
                verifier.verify_server_cert(certificate, &[], &name, &[], at).map(drop)
            }
            NodeIdentity::Server(_) | NodeIdentity::Client(_) => {
                let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider);
                let verifier = verifier.build().map_err(no_verifier)?;
                verifier.verify_client_cert(certificate, &[], at).map(drop)
            }
        }
    }

    fn side(
        self,
        identity: &NodeIdentity,
        certificate: CertificateDer<'static>,
        key: PrivateKeyDer<'static>,
    ) -> Result<TlsSide, Error> {
        let Self { provider, roots } = self;
        let chain = vec![certificate];
        if *identity == NodeIdentity::Manager {
            let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider.clone())
                .build()
                .map_err(|error| Error::General(error.to_string()))?;
            let config = ServerConfig::builder_with_provider(provider);
            let config = config.with_protocol_versions(&[&TLS13])?;
            let config = config.with_client_cert_verifier(verifier);
            let mut config = config.with_single_cert(chain, key)?;
            config.session_storage = Arc::new(NoServerSessionStorage {});
            config.send_tls13_tickets = 0;
            Ok(TlsSide::Manager(Arc::new(config).into()))
        } else {
            let config = ClientConfig::builder_with_provider(provider);
            let config = config.with_protocol_versions(&[&TLS13])?;
            let config = config.with_root_certificates(roots);
            let mut config = config.with_client_auth_cert(chain, key)?;
            config.resumption = Resumption::disabled();
            Ok(TlsSide::Node(Arc::new(config).into(), manager_name()?))
        }
    }
}

/// The name that every manager's certificate has.
fn manager_name() -> Result<ServerName<'static>, Error> {
    let name = ServerName::try_from(NodeIdentity::Manager.dns_name());
    name.map_err(|error| Error::General(error.to_string()))
}

/// The one certificate in a file.
///
/// # Errors
/// [`CredentialsError`] where there is none.
pub fn certificate(path: &Path) -> Result<CertificateDer<'static>, CredentialsError> {
    certificate_of(path, "a node's")
}

fn certificate_of(path: &Path, whose: &str) -> Result<CertificateDer<'static>, CredentialsError> {
    CertificateDer::from_pem_slice(&read(path)?)
        .map_err(|error| unfit(path, format!("it is not {whose} certificate: {error}")))
}

fn unfit(path: &Path, what: String) -> CredentialsError {
    CredentialsError::Unfit { path: path.to_owned(), what }
}

/// Describes the fault of this end's own certificate.
fn own_fault(error: &Error) -> String {
    match error {
        Error::InvalidCertificate(fault) => describe::describe_certificate_error(fault),
        other => other.to_string(),
    }
}

/// A small plain file, whole.
fn read(path: &Path) -> Result<Vec<u8>, CredentialsError> {
    let io_error = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => CredentialsError::NotThere { path: path.to_owned() },
        _ => CredentialsError::Io { path: path.to_owned(), source },
    };
    let facts = fs::metadata(path).map_err(io_error)?;
    // A device has no length and no end either.
    if !facts.is_file() || facts.len() > FILE_BYTES_MAX {
        return Err(unfit(path, "it is no file of keys, but something larger or else".into()));
    }
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(io_error)?;
    file.take(FILE_BYTES_MAX).read_to_end(&mut bytes).map_err(io_error)?;
    Ok(bytes)
}
