//! The reason why a store gave or took no blob, in words for an operator.

use std::error::Error;

use object_store::Error as StoreError;
use polyptych_files::blob::{StoreScheme, StoreUrl};

/// Longest part of a store's own words that is repeated, in characters.
const WORDS_MAX: usize = 200;

/// The meaning of a fault for the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The store cannot be reached, refuses, or does not answer: the next blob would not come
    /// either.
    Unusable,
    /// This blob's object is damaged; others may be whole.
    DamagedBlob,
    /// This blob's object is larger than the caller takes.
    TooLarge,
}

/// A request to a store that failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{url}: {reason}; {fix}")]
pub struct StoreFault {
    /// The store.
    pub url: StoreUrl,
    /// The event.
    pub reason: String,
    /// The remedy.
    pub fix: String,
    /// Its meaning for the store.
    pub kind: FaultKind,
}

impl StoreFault {
    pub(crate) fn unusable(
        url: &StoreUrl,
        reason: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        let (reason, fix) = (reason.into(), fix.into());
        Self { url: url.clone(), reason, fix, kind: FaultKind::Unusable }
    }

    pub(crate) fn damaged(url: &StoreUrl, key: &str, reason: &str) -> Self {
        Self {
            url: url.clone(),
            reason: format!("object {key} {reason}"),
            fix: "remove the object, and upload it anew with `polyptych bake … --upload`".into(),
            kind: FaultKind::DamagedBlob,
        }
    }

    pub(crate) fn too_large(url: &StoreUrl, key: &str, bytes_max: u64) -> Self {
        let fault = Self::damaged(url, key, &format!("has more than {bytes_max} bytes"));
        Self { kind: FaultKind::TooLarge, ..fault }
    }

    pub(crate) fn silent(url: &StoreUrl, seconds: u64) -> Self {
        Self::unusable(
            url,
            format!("the answer was not there within {seconds} s"),
            reach(url.scheme()),
        )
    }

    /// Less than `rate` bytes a second came of an answer that has begun.
    pub(crate) fn slow(url: &StoreUrl, rate: u64, seconds: u64) -> Self {
        let reason = format!("less than {} KiB/s came within {seconds} s", rate >> 10);
        Self::unusable(url, reason, reach(url.scheme()))
    }

    pub(crate) fn of_store(url: &StoreUrl, error: &StoreError) -> Self {
        let fix = match error {
            _ if words(error).contains("RequestTimeTooSkewed") => {
                "set this machine's clock, such as by NTP".to_owned()
            }
            StoreError::PermissionDenied { .. } | StoreError::Unauthenticated { .. } => {
                allow(url.scheme())
            }
            StoreError::NotFound { .. } => "make the bucket, or correct its name".to_owned(),
            _ => reach(url.scheme()),
        };
        Self::unusable(url, words(error), fix)
    }
}

/// The settings that let a process in.
fn allow(scheme: StoreScheme) -> String {
    match scheme.credentials() {
        "" => "let this machine read the folder without a password".to_owned(),
        names => format!(
            "set {names} in this process's environment, of an account that may read and list the \
             bucket"
        ),
    }
}

/// The settings that let a process reach the store.
fn reach(scheme: StoreScheme) -> String {
    let more = match scheme {
        StoreScheme::S3 => {
            ", AWS_ENDPOINT, AWS_REGION and, without TLS, AWS_ALLOW_HTTP=true, and that this \
             process's environment has AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or \
             AWS_SKIP_SIGNATURE=true: without them keys are asked for at the address of Amazon's \
             machines"
        }
        StoreScheme::Az => ", AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
        StoreScheme::Gs => " and GOOGLE_SERVICE_ACCOUNT",
        StoreScheme::Http | StoreScheme::Https => "",
    };
    format!("check that the store runs and can be reached from here, its address{more}")
}

/// The innermost cause, which names what happened without a URL for every layer; for an answer of
/// the store its status and the code in its XML.
fn words(error: &StoreError) -> String {
    let mut cause: &(dyn Error + 'static) = error;
    while let Some(next) = cause.source() {
        cause = next;
    }
    let text = cause.to_string();
    let code = text.split_once("<Code>").and_then(|(_, rest)| rest.split_once("</Code>"));
    let text = match code {
        Some((code, _)) => format!("the store answered {code}"),
        None => text,
    };
    let text: String = text.chars().filter(|c| !c.is_control()).take(WORDS_MAX).collect();
    text.trim().trim_end_matches([':', '.']).to_owned()
}
