//! The secrets by which peers of a measured barrier authenticate: a token, or keys made for it.

use std::path::PathBuf;

use polyptych_protocol::handshake::Secret;
use polyptych_tls::{Credentials, CredentialsError, NodeIdentity};

use crate::certificate_authority::CertificateAuthority;

/// The secret of a manager that lives as long as a measurement.
const TOKEN: &str = "barrierbarrierbarrier";

/// A token, or a folder of keys that goes with it.
#[derive(Debug)]
pub(super) struct Secrets(Option<tempfile::TempDir>);

impl Secrets {
    /// Keys for all these nodes where `is_encrypted`.
    pub fn new(is_encrypted: bool, nodes: &[NodeIdentity]) -> anyhow::Result<Self> {
        if !is_encrypted {
            return Ok(Self(None));
        }
        let folder = tempfile::Builder::new().prefix("polyptych-").tempdir()?;
        let (authority, _) =
            CertificateAuthority::open_or_create(&folder.path().join("authority"))?;
        for node in nodes {
            authority.issue(node, &folder.path().join(node.folder()), false)?;
        }
        Ok(Self(Some(folder)))
    }

    /// The token; empty with keys.
    pub fn token(&self) -> Secret {
        Secret(if self.0.is_some() { String::new() } else { TOKEN.to_owned() })
    }

    /// Returns the folder of a node's keys, if there are keys.
    pub fn folder(&self, node: &NodeIdentity) -> Option<PathBuf> {
        self.0.as_ref().map(|folder| folder.path().join(node.folder()))
    }

    /// A node's keys, if any.
    pub fn keys(&self, node: &NodeIdentity) -> Result<Option<Credentials>, CredentialsError> {
        self.folder(node).map(|folder| Credentials::load(&folder)).transpose()
    }
}
