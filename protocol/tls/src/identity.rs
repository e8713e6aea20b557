//! The identity of a node in its certificate: its role and its name.
//!
//! A certificate names its node by one DNS name that is looked up nowhere: `manager.polyptych`,
//! `NAME.server.polyptych` or `NAME.client.polyptych`. Addresses stand in no certificate, so that
//! machines may change theirs. DNS knows no upper case and few signs; a name that it cannot hold
//! is written in hexadecimal digits, as `hex-4c656674` for `Left`, so that two names are never one.

use std::fmt;

use polyptych_wall::limits::NAME_BYTES_MAX;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};

/// Last part of all these names; no public top-level domain.
const DOMAIN: &str = "polyptych";

/// The start of a label whose digits stand for bytes.
const HEX: &str = "hex-";

/// Bytes of a name in one label: a label of DNS has at most 63 characters.
const HEX_LABEL_BYTES: usize = 28;

/// A node of the wall.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum NodeIdentity {
    /// The one process that decides.
    Manager,
    /// A render server, by its name in the wall file.
    Server(String),
    /// A client, by the name that `polyptych keys` was given.
    Client(String),
}

impl NodeIdentity {
    /// The DNS name that its certificate has.
    pub fn dns_name(&self) -> String {
        match self {
            Self::Manager => format!("manager.{DOMAIN}"),
            Self::Server(name) => format!("{}.server.{DOMAIN}", labels(name)),
            Self::Client(name) => format!("{}.client.{DOMAIN}", labels(name)),
        }
    }

    /// The node that has this DNS name, if any: exactly what [`NodeIdentity::dns_name`] writes.
    pub fn from_dns_name(text: &str) -> Option<Self> {
        let node = text.strip_suffix(DOMAIN)?.strip_suffix('.')?;
        let identity = match node.rsplit_once('.') {
            None => (node == "manager").then_some(Self::Manager)?,
            Some((labels, "server")) => Self::Server(name(labels)?),
            Some((labels, "client")) => Self::Client(name(labels)?),
            Some(_) => return None,
        };
        // One node, one name: a second spelling of it would be no certificate of ours.
        (identity.dns_name() == text).then_some(identity)
    }

    /// Returns the node that this certificate names. The verifier decides whether the certificate
    /// is valid.
    ///
    /// # Errors
    /// The reason why it names no single node of a wall.
    pub fn from_certificate(certificate: &CertificateDer<'_>) -> Result<Self, String> {
        let parsed = webpki::EndEntityCert::try_from(certificate)
            .map_err(|error| format!("it is no certificate of a node: {error}"))?;
        let names: Vec<&str> = parsed.valid_dns_names().collect();
        let identity = match names[..] {
            [name] => Self::from_dns_name(name),
            _ => None,
        };
        let unfit = || format!("it names no node of a wall, but {names:?}");
        let identity = identity.ok_or_else(unfit)?;
        // The library's own comparison, beside ours, which only takes the name apart.
        let name = ServerName::try_from(identity.dns_name()).map_err(|error| error.to_string())?;
        parsed.verify_is_valid_for_subject_name(&name).map_err(|_| unfit())?;
        Ok(identity)
    }

    /// The folder of its keys, beside those of the other nodes.
    pub fn folder(&self) -> String {
        match self {
            Self::Manager => "manager".into(),
            Self::Server(name) => format!("server-{name}"),
            Self::Client(name) => format!("client-{name}"),
        }
    }
}

impl fmt::Display for NodeIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Manager => f.write_str("the manager"),
            Self::Server(name) => write!(f, "server {name}"),
            Self::Client(name) => write!(f, "client {name}"),
        }
    }
}

/// A name as labels of DNS.
fn labels(name: &str) -> String {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let is_label = (1..=63).contains(&name.len())
        && name.chars().all(fits)
        && !name.starts_with('-')
        && !name.ends_with('-')
        && !name.starts_with(HEX);
    if is_label {
        return name.to_owned();
    }
    let label = |bytes: &[u8]| bytes.iter().fold(HEX.to_owned(), |l, b| format!("{l}{b:02x}"));
    name.as_bytes().chunks(HEX_LABEL_BYTES).map(label).collect::<Vec<_>>().join(".")
}

/// The name that these labels stand for.
fn name(labels: &str) -> Option<String> {
    if !labels.starts_with(HEX) {
        return (!labels.is_empty()).then(|| labels.to_owned());
    }
    let mut bytes = Vec::new();
    for label in labels.split('.') {
        let digits = label.strip_prefix(HEX)?;
        for at in (0..digits.len()).step_by(2) {
            bytes.push(u8::from_str_radix(digits.get(at..at + 2)?, 16).ok()?);
        }
    }
    String::from_utf8(bytes).ok().filter(|name| name.len() <= NAME_BYTES_MAX)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn names_are_written_as_dns_can_hold_them() {
        for (identity, dns_name) in [
            (NodeIdentity::Manager, "manager.polyptych"),
            (NodeIdentity::Server("front-1-1".into()), "front-1-1.server.polyptych"),
            (NodeIdentity::Client("operator".into()), "operator.client.polyptych"),
            (NodeIdentity::Server("Left".into()), "hex-4c656674.server.polyptych"),
            (NodeIdentity::Server("a.b".into()), "hex-612e62.server.polyptych"),
            (NodeIdentity::Client("hex-61".into()), "hex-6865782d3631.client.polyptych"),
            (NodeIdentity::Server("*".into()), "hex-2a.server.polyptych"),
        ] {
            assert_eq!(identity.dns_name(), dns_name);
            assert_eq!(NodeIdentity::from_dns_name(dns_name), Some(identity));
        }
        for dns_name in [
            "polyptych",
            ".polyptych",
            "server.polyptych",
            ".server.polyptych",
            "left.display.polyptych",
            "left.server.polyptych.example",
            "leftserver.polyptych",
            "left.right.server.polyptych",
            "Left.server.polyptych",
            "*.server.polyptych",
            "x.manager.polyptych",
            // `left`, which needs no digits, and `Left` in other digits.
            "hex-6c656674.server.polyptych",
            "hex-4C656674.server.polyptych",
            "hex-4c.hex-656674.server.polyptych",
            "hex-4c65667.server.polyptych",
            "hex-.server.polyptych",
            "hex-+a.server.polyptych",
        ] {
            assert_eq!(NodeIdentity::from_dns_name(dns_name), None, "{dns_name}");
        }
    }

    proptest! {
        #[test]
        fn every_name_comes_back_and_fits_dns(name in ".{1,64}", is_server: bool) {
            prop_assume!(name.len() <= NAME_BYTES_MAX);
            let of_role = if is_server { NodeIdentity::Server } else { NodeIdentity::Client };
            let identity = of_role(name);
            let dns_name = identity.dns_name();
            prop_assert!(ServerName::try_from(dns_name.as_str()).is_ok(), "{}", dns_name);
            prop_assert_eq!(NodeIdentity::from_dns_name(&dns_name), Some(identity));
        }

        #[test]
        fn two_names_are_never_one(a in "[A-Za-z0-9._-]{1,6}", b in "[A-Za-z0-9._-]{1,6}") {
            prop_assume!(a != b);
            let [a, b] = [a, b].map(|name| NodeIdentity::Server(name).dns_name());
            prop_assert!(!a.eq_ignore_ascii_case(&b));
        }
    }
}
