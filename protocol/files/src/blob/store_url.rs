//! The address of a folder of blobs in an object store: which service, which bucket, which prefix.

use std::fmt;

use super::BlobHash;

/// The service that an object store speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreScheme {
    /// Amazon S3, or a server that speaks its protocol.
    S3,
    /// Google Cloud Storage.
    Gs,
    /// Azure Blob Storage.
    Az,
    /// A web server over plain HTTP; uploads need WebDAV's PUT.
    Http,
    /// A web server over TLS.
    Https,
}

/// All schemes with their names, and what their users keep in the environment.
const SCHEMES: [(StoreScheme, &str, &str); 5] = [
    (StoreScheme::S3, "s3", "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"),
    (StoreScheme::Gs, "gs", "GOOGLE_SERVICE_ACCOUNT"),
    (StoreScheme::Az, "az", "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY"),
    (StoreScheme::Http, "http", ""),
    (StoreScheme::Https, "https", ""),
];

impl StoreScheme {
    fn row(self) -> (Self, &'static str, &'static str) {
        SCHEMES[self as usize]
    }

    /// Returns the variables of the environment that hold credentials, as words; empty for web
    /// servers, which are read without.
    pub fn credentials(self) -> &'static str {
        self.row().2
    }

    fn is_web(self) -> bool {
        matches!(self, Self::Http | Self::Https)
    }
}

/// A checked URL of an object store, without credentials.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreUrl {
    scheme: StoreScheme,
    /// The bucket, or the host of a web server with its port.
    bucket: String,
    /// The folder in the bucket, without "/" at either end; may be empty.
    prefix: String,
}

/// The reason why a text is no address of an object store.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{problem}; {fix}")]
pub struct StoreUrlError {
    /// The fault, without the URL if it may hold a secret.
    pub problem: String,
    /// The form that would be right.
    pub fix: String,
}

fn wrong(problem: impl Into<String>, fix: impl Into<String>) -> StoreUrlError {
    StoreUrlError { problem: problem.into(), fix: fix.into() }
}

/// The remedy that every refusal of a form names.
const FORMS: &str = "write s3://BUCKET/PREFIX, gs://BUCKET/PREFIX, az://CONTAINER/PREFIX or \
                     https://HOST/PREFIX, or the path of a folder";

impl StoreUrl {
    /// Returns the address that `text` names, or `None` if it is the path of a folder: a text
    /// without "://" that does not begin with the name of a service and ":".
    ///
    /// # Errors
    /// [`StoreUrlError`] if the service is unknown, the bucket is missing, or the text holds
    /// credentials.
    pub fn from_text(text: &str) -> Result<Option<Self>, StoreUrlError> {
        let Some((name, rest)) = text.split_once(':') else { return Ok(None) };
        let known = SCHEMES.iter().find(|(_, known, _)| known.eq_ignore_ascii_case(name));
        let Some(rest) = rest.strip_prefix("//") else {
            return match known {
                None => Ok(None),
                Some((_, known, _)) => {
                    Err(wrong(format!("no \"//\" follows \"{known}:\" of a store's URL"), FORMS))
                }
            };
        };
        let Some(&(scheme, ..)) = known else {
            let name: String = name.chars().take(40).collect();
            return Err(wrong(format!("{name:?} is not the scheme of an object store"), FORMS));
        };
        Self::from_rest(scheme, rest).map(Some)
    }

    fn from_rest(scheme: StoreScheme, rest: &str) -> Result<Self, StoreUrlError> {
        let name = scheme.row().1;
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        // The rest may hold a secret, so that the messages show nothing of it.
        if bucket.contains('@') {
            return Err(wrong(
                format!("the {name} URL has a user name or a password before \"@\""),
                without_credentials(scheme),
            ));
        }
        if let Some(mark) = rest.chars().find(|c| matches!(c, '?' | '#')) {
            return Err(wrong(
                format!("the {name} URL has a part after {mark:?}, which may hold a key"),
                without_credentials(scheme),
            ));
        }
        if !is_bucket(scheme, bucket) {
            let noun = if scheme.is_web() { "host" } else { "bucket" };
            let problem = if bucket.is_empty() {
                format!("the {name} URL names no {noun}")
            } else {
                let bucket: String = bucket.chars().take(80).collect();
                format!("{bucket:?} is no name of a {noun}")
            };
            return Err(wrong(problem, format!("write {name}://{}/PREFIX", noun.to_uppercase())));
        }
        let prefix = prefix.strip_suffix('/').unwrap_or(prefix);
        let is_name = |name: &str| {
            !matches!(name, "" | "." | "..")
                && name.bytes().all(|byte| is_plain(byte) || byte > 127)
        };
        if !prefix.is_empty() && !prefix.split('/').all(is_name) {
            let prefix: String = prefix.chars().take(80).collect();
            return Err(wrong(
                format!("{prefix:?} is no prefix of a store's objects"),
                "write names of letters, digits, \"-\", \"_\", \".\" and \"~\" with \"/\" between",
            ));
        }
        Ok(Self { scheme, bucket: bucket.to_owned(), prefix: prefix.to_owned() })
    }

    /// The service.
    pub fn scheme(&self) -> StoreScheme {
        self.scheme
    }

    /// The URL without the prefix.
    pub fn root(&self) -> String {
        format!("{}://{}", self.scheme.row().1, self.bucket)
    }

    /// The name of a blob's object in the bucket: the same as the file of a
    /// [`BlobStore`](super::BlobStore), below the prefix.
    pub fn key_of(&self, hash: BlobHash) -> String {
        let name = hash.to_string();
        let key = format!("{}/{name}", &name[..2]);
        if self.prefix.is_empty() { key } else { format!("{}/{key}", self.prefix) }
    }
}

impl fmt::Display for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.root())?;
        if self.prefix.is_empty() { Ok(()) } else { write!(f, "/{}", self.prefix) }
    }
}

fn without_credentials(scheme: StoreScheme) -> String {
    match scheme.credentials() {
        "" => {
            "serve it without a password on the wall's own network, and leave that part out".into()
        }
        names => format!("leave that part out, and set {names} in the environment of the servers"),
    }
}

fn is_plain(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.' | b'~')
}

fn is_bucket(scheme: StoreScheme, bucket: &str) -> bool {
    if !scheme.is_web() {
        return !matches!(bucket, "" | "." | "..") && bucket.bytes().all(is_plain);
    }
    let (host, port) = match bucket.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((address, port)) if address.parse::<std::net::Ipv6Addr>().is_ok() => {
            (address, port.strip_prefix(':').or(port.is_empty().then_some("")))
        }
        Some(_) => return false,
        None => match bucket.split_once(':') {
            Some((host, port)) if host.bytes().all(is_plain) => (host, Some(port)),
            None if bucket.bytes().all(is_plain) => (bucket, Some("")),
            _ => return false,
        },
    };
    let is_port = |port: &str| {
        port.bytes().all(|byte| byte.is_ascii_digit())
            && port.parse::<u16>().is_ok_and(|port| port > 0)
    };
    let has_port_sign = bucket.ends_with(':');
    !host.is_empty() && !has_port_sign && port.is_some_and(|port| port.is_empty() || is_port(port))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn url(text: &str) -> StoreUrl {
        StoreUrl::from_text(text).expect("right").expect("a URL")
    }

    #[test]
    fn objects_have_the_names_of_files_in_a_folder_of_blobs() {
        let hash = BlobHash([0x3f; 32]);
        let file = crate::blob::BlobStore::new("/prefix/of").path_of(hash);
        for (text, root, shown, folder) in [
            ("s3://walls/prefix/of", "s3://walls", "s3://walls/prefix/of", "/"),
            ("S3://walls/prefix/of/", "s3://walls", "s3://walls/prefix/of", "/"),
            ("gs://walls", "gs://walls", "gs://walls", "/prefix/of/"),
            ("az://walls/", "az://walls", "az://walls", "/prefix/of/"),
            (
                "http://h.example:8080/",
                "http://h.example:8080",
                "http://h.example:8080",
                "/prefix/of/",
            ),
            ("https://[::1]:8/prefix/of", "https://[::1]:8", "https://[::1]:8/prefix/of", "/"),
        ] {
            let url = url(text);
            assert_eq!((url.root().as_str(), url.to_string().as_str()), (root, shown));
            assert_eq!(format!("{folder}{}", url.key_of(hash)), file.to_string_lossy(), "{text}");
            assert_eq!(StoreUrl::from_text(&url.to_string()), Ok(Some(url)));
        }
    }

    #[test]
    fn paths_of_folders_are_no_urls() {
        for path in ["/srv/blobs", "blobs", "a:b", "C:\\blobs", "../s3", "s3", ""] {
            assert_eq!(StoreUrl::from_text(path), Ok(None), "{path}");
        }
    }

    #[test]
    fn what_names_no_store_is_refused_with_a_fix() {
        for (text, problem, fix) in [
            ("ftp://host/a", "\"ftp\" is not the scheme", "s3://BUCKET/PREFIX"),
            ("file:///srv/blobs", "\"file\"", "path of a folder"),
            ("s3:/walls", "no \"//\" follows \"s3:\"", "s3://BUCKET"),
            ("s3://", "names no bucket", "s3://BUCKET/PREFIX"),
            ("s3:///blobs", "names no bucket", "s3://BUCKET/PREFIX"),
            ("https:///blobs", "names no host", "https://HOST/PREFIX"),
            ("http://host:0/a", "\"host:0\" is no name of a host", "http://HOST/PREFIX"),
            ("http://host:/a", "no name of a host", "http://HOST/PREFIX"),
            ("http://host:99999", "no name of a host", "http://HOST/PREFIX"),
            ("http://[::1/a", "no name of a host", "http://HOST/PREFIX"),
            ("s3://walls:80/a", "\"walls:80\" is no name of a bucket", "s3://BUCKET/PREFIX"),
            ("s3://walls/a//b", "\"a//b\" is no prefix", "letters, digits"),
            ("s3://walls/../b", "no prefix", "letters, digits"),
            ("s3://walls/a b", "no prefix", "letters, digits"),
        ] {
            let error = StoreUrl::from_text(text).expect_err(text);
            assert!(error.problem.contains(problem), "{text}: {error}");
            assert!(error.fix.contains(fix), "{text}: {error}");
        }
    }

    #[test]
    fn a_secret_in_a_url_is_refused_and_not_repeated() {
        for (text, fix) in [
            ("s3://key:hidden@walls/blobs", "AWS_SECRET_ACCESS_KEY"),
            ("gs://hidden@walls/blobs", "GOOGLE_SERVICE_ACCOUNT"),
            ("az://walls/blobs?sig=hidden", "AZURE_STORAGE_ACCOUNT_KEY"),
            ("https://me:hidden@host/blobs", "without a password"),
            ("https://host/blobs#hidden", "without a password"),
        ] {
            let error = StoreUrl::from_text(text).expect_err(text);
            assert!(error.fix.contains(fix), "{text}: {error}");
            assert!(!error.to_string().contains("hidden"), "{error}");
        }
    }
}
