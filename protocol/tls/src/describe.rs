//! Descriptions of TLS errors for an operator: which side is wrong, and what would be right.

use std::io;

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error, InvalidMessage};

/// The fix for a certificate whose time is over.
const RENEW: &str = "make new ones: polyptych keys WALL.toml -o DIR --renew";

/// The error of a stream, with what it means where TLS found it.
pub fn describe(error: &io::Error) -> String {
    let tls = error.get_ref().and_then(|inner| inner.downcast_ref::<Error>());
    match tls {
        Some(tls) => fault(tls),
        None if error.kind() == io::ErrorKind::UnexpectedEof => {
            "the peer closed the connection while TLS began; it may not believe this certificate"
                .into()
        }
        None => error.to_string(),
    }
}

/// Describes an error that this end found, or an alert of the other end.
fn fault(error: &Error) -> String {
    match error {
        Error::InvalidCertificate(fault) => {
            format!("the peer's certificate is refused: {}", describe_certificate_error(fault))
        }
        Error::NoCertificatesPresented => {
            "the peer shows no certificate; give it its folder of keys with --keys".into()
        }
        Error::AlertReceived(alert) => {
            format!("the peer refuses this end: {}", alert_meaning(*alert))
        }
        Error::InvalidMessage(InvalidMessage::InvalidContentType) => {
            "the peer does not speak TLS; is it a manager with --keys?".into()
        }
        Error::PeerIncompatible(why) => format!("the peer speaks no TLS 1.3 as we do: {why:?}"),
        other => format!("TLS failed: {other}"),
    }
}

/// Returns whether the time of a certificate begins later.
pub(crate) fn is_not_yet_valid(fault: &CertificateError) -> bool {
    matches!(fault, CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. })
}

/// Describes the fault of a certificate of either side.
pub(crate) fn describe_certificate_error(fault: &CertificateError) -> String {
    use CertificateError as Fault;
    match fault {
        Fault::Expired => format!("its time is over; {RENEW}"),
        Fault::ExpiredContext { time, not_after } => {
            let days = time.as_secs().saturating_sub(not_after.as_secs()) / 86_400;
            format!("its time is over since {days} days; {RENEW}")
        }
        Fault::NotValidYet | Fault::NotValidYetContext { .. } => {
            "its time has not begun; set the clocks of both machines".into()
        }
        Fault::UnknownIssuer | Fault::BadSignature => {
            "another authority made it; all nodes of a wall need folders that one run of \
             polyptych keys wrote, or a later one beside the same authority"
                .into()
        }
        Fault::NotValidForName | Fault::NotValidForNameContext { .. } => {
            "it is not the manager's; is the address right?".into()
        }
        Fault::InvalidPurpose | Fault::InvalidPurposeContext { .. } => {
            "it was made for the other side of a connection: nodes do not pose as the manager, \
             nor the manager as a node"
                .into()
        }
        other => format!("{other}"),
    }
}

/// Describes the alert of the other end.
fn alert_meaning(alert: AlertDescription) -> String {
    use AlertDescription as Alert;
    match alert {
        Alert::CertificateExpired => {
            format!(
                "by its clock this certificate's time is over, or has not begun; set the clocks, \
                 or {RENEW}"
            )
        }
        Alert::UnknownCA | Alert::DecryptError | Alert::BadCertificate => {
            "this end's certificate was made by another authority than its own".into()
        }
        Alert::CertificateRequired => "it wants a certificate; say --keys FOLDER".into(),
        Alert::UnexpectedMessage => {
            "it does not speak TLS; start the manager with --keys, or this end without".into()
        }
        Alert::ProtocolVersion => "it does not speak TLS 1.3".into(),
        other => format!("{other:?}"),
    }
}
