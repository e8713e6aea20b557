//! Trust: from which page a request comes, and whether who sends it may command the wall.
//!
//! Without keys a request shows the bearer token or a browser's cookie; with keys the connection
//! has shown a client's certificate, and nothing else counts. Names of other machines in `Host` end
//! DNS rebinding, and `Origin` ends requests that other pages send.

use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use hyper::header::{AUTHORIZATION, COOKIE, HOST, HeaderMap, HeaderName, ORIGIN};
use hyper::{Method, StatusCode, Uri};
use polyptych_tls::{Credentials, NodeIdentity};

use super::answer::Refusal;
use super::login::{self, COOKIE_TIME_MAX, CookieSigner, Logins};

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// The checks that each request must pass.
pub(super) struct Gate {
    pub keys: Option<Credentials>,
    /// Without keys.
    secrets: Option<Secrets>,
    /// Names that may stand in `Host`.
    hosts: Vec<String>,
    /// Cookies of other managers on this machine have other names.
    cookie_name: String,
}

struct Secrets {
    token: String,
    bearer: String,
    signer: CookieSigner,
    logins: Mutex<Logins>,
}

impl Gate {
    pub fn new(token: &str, keys: Option<Credentials>, hosts: Vec<String>, port: u16) -> Self {
        let secrets = keys.is_none().then(|| Secrets {
            token: token.to_owned(),
            bearer: login::bearer(token),
            signer: CookieSigner::new(token),
            logins: Mutex::default(),
        });
        Self { keys, secrets, hosts, cookie_name: format!("polyptych-{port}") }
    }

    /// Checks that the request means this manager, and no name that another page was served from.
    ///
    /// # Errors
    /// 421, with what to do.
    pub fn check_host(&self, headers: &HeaderMap, uri: &Uri) -> Result<(), Refusal> {
        let mut hosts = headers.get_all(HOST).iter();
        let host = hosts.next().and_then(|host| host.to_str().ok()).unwrap_or_default();
        let is_one = hosts.next().is_none();
        let is_known = |authority: &str| self.is_known(host_of(authority));
        if is_one && is_known(host) && uri.authority().is_none_or(|of| is_known(of.as_str())) {
            return Ok(());
        }
        let reason = format!(
            "the host {host:?} is not known here; use the address of the manager or localhost, or \
             start the manager with --http-host NAME"
        );
        Err(Refusal::new(StatusCode::MISDIRECTED_REQUEST, reason))
    }

    /// An address is no name that somebody could let point here.
    fn is_known(&self, host: &str) -> bool {
        let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
        bare.parse::<IpAddr>().is_ok()
            || host.eq_ignore_ascii_case("localhost")
            || self.hosts.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// Checks that no other page sends the request: reading is refused where the browser says so,
    /// changing wherever its origin is another one.
    ///
    /// # Errors
    /// 403, with the origin.
    pub fn check_origin(&self, method: &Method, headers: &HeaderMap) -> Result<(), Refusal> {
        let text = |name: &HeaderName| headers.get(name).map(|of| of.to_str().unwrap_or("?"));
        let is_read = matches!(*method, Method::GET | Method::HEAD);
        let host = text(&HOST).unwrap_or_default();
        let origin = text(&ORIGIN).filter(|_| !is_read);
        let is_own = |origin: &str| {
            let scheme = if self.keys.is_some() { "https://" } else { "http://" };
            origin.strip_prefix(scheme).is_some_and(|rest| rest.eq_ignore_ascii_case(host))
        };
        if let Some(origin) = origin.filter(|origin| !is_own(origin)) {
            let reason = format!(
                "a page of {origin:?} may not command this wall; use the manager's own page"
            );
            return Err(Refusal::new(StatusCode::FORBIDDEN, reason));
        }
        match text(&FETCH_SITE) {
            None | Some("same-origin" | "none") => Ok(()),
            Some(site) => {
                let reason = format!(
                    "another page sends this request (Sec-Fetch-Site: {site}); use the manager's \
                     own page"
                );
                Err(Refusal::new(StatusCode::FORBIDDEN, reason))
            }
        }
    }

    /// Checks that the sender may command the wall.
    ///
    /// # Errors
    /// 401 or 403, with what to do.
    pub fn authenticate(
        &self,
        headers: &HeaderMap,
        identity: Option<&NodeIdentity>,
    ) -> Result<(), Refusal> {
        let Some(secrets) = &self.secrets else {
            return match identity {
                Some(NodeIdentity::Client(_)) => Ok(()),
                other => {
                    let shown = other.map_or("none".to_owned(), ToString::to_string);
                    let reason = format!(
                        "a client's certificate is needed, and this one is {shown}; polyptych keys \
                         --client NAME makes one"
                    );
                    Err(Refusal::new(StatusCode::FORBIDDEN, reason))
                }
            };
        };
        let authorization = headers.get(AUTHORIZATION).and_then(|of| of.to_str().ok());
        if let Some(authorization) = authorization {
            let token = authorization
                .split_once(' ')
                .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
            if token.is_some_and(|(_, token)| login::is_same(token.trim(), &secrets.bearer)) {
                return Ok(());
            }
            let reason =
                "the bearer token is not this manager's; polyptych login --token prints it";
            return Err(Refusal::new(StatusCode::UNAUTHORIZED, reason));
        }
        let now = SystemTime::now();
        if self.cookies(headers).any(|cookie| secrets.signer.is_valid(cookie, now)) {
            return Ok(());
        }
        let reason = "not logged in: open the link that polyptych login prints, or send \
                      Authorization: Bearer with what polyptych login --token prints";
        Err(Refusal::new(StatusCode::UNAUTHORIZED, reason))
    }

    fn cookies<'a>(&'a self, headers: &'a HeaderMap) -> impl Iterator<Item = &'a str> {
        let lines = headers.get_all(COOKIE).iter().filter_map(|line| line.to_str().ok());
        let pairs = lines.flat_map(|line| line.split(';')).filter_map(|pair| pair.split_once('='));
        pairs.filter(|(name, _)| name.trim() == self.cookie_name).map(|(_, value)| value.trim())
    }

    /// Begins a login: the manager's random number and proof, for the client's number.
    ///
    /// # Errors
    /// There are keys, or the number is too long.
    pub fn challenge(&self, client: &str) -> Result<(String, String), Refusal> {
        const NONCE_BYTES: std::ops::RangeInclusive<usize> = 16..=128;
        let (secrets, mut logins) = self.logins()?;
        if !NONCE_BYTES.contains(&client.len()) {
            return Err(Refusal::malformed("a nonce has 16 to 128 bytes"));
        }
        logins.challenge(&secrets.token, client).map_err(Refusal::unavailable)
    }

    /// Answers the proof of who logs in with a code.
    ///
    /// # Errors
    /// The proof is wrong.
    pub fn code(&self, manager: &str, shown: &str) -> Result<String, Refusal> {
        let (secrets, mut logins) = self.logins()?;
        let code = logins.code(&secrets.token, manager, shown);
        code.map_err(|reason| Refusal::new(StatusCode::UNAUTHORIZED, reason))
    }

    /// Returns the cookie for a code, as `Set-Cookie` has it.
    ///
    /// # Errors
    /// The code is not good, or not any more.
    pub fn redeem(&self, code: &str) -> Result<String, Refusal> {
        let (secrets, mut logins) = self.logins()?;
        if !logins.redeem(code) {
            let reason = "this link is used up or too old; polyptych login prints another one";
            return Err(Refusal::new(StatusCode::UNAUTHORIZED, reason));
        }
        let value = secrets.signer.sign(SystemTime::now()).map_err(Refusal::unavailable)?;
        let (name, age) = (&self.cookie_name, COOKIE_TIME_MAX.as_secs());
        Ok(format!("{name}={value}; Max-Age={age}; Path=/; HttpOnly; SameSite=Strict"))
    }

    fn logins(&self) -> Result<(&Secrets, MutexGuard<'_, Logins>), Refusal> {
        let none = || {
            let reason = "this manager has keys: a client's certificate stands for a login";
            Refusal::not_found(reason)
        };
        let secrets = self.secrets.as_ref().ok_or_else(none)?;
        Ok((secrets, secrets.logins.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

/// The host of `HOST:PORT`.
fn host_of(authority: &str) -> &str {
    match authority.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => host,
        _ => authority,
    }
}

#[cfg(test)]
mod tests {
    use hyper::header::HeaderValue;

    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    fn gate() -> Gate {
        Gate::new(TOKEN, None, vec!["wall.example".into()], 7880)
    }

    fn headers(list: &[(&'static str, &str)]) -> HeaderMap {
        let pair = |(name, value): &(&'static str, &str)| {
            (HeaderName::from_static(name), HeaderValue::from_str(value).expect("a value"))
        };
        list.iter().map(pair).collect()
    }

    #[test]
    fn hosts_are_addresses_or_known_names() {
        let gate = gate();
        let uri = Uri::from_static("/api/v1/status");
        let check = |host: &str| gate.check_host(&headers(&[("host", host)]), &uri).is_ok();
        for host in ["127.0.0.1:7880", "localhost:9000", "LOCALHOST", "[::1]:7880", "wall.example"]
        {
            assert!(check(host), "{host}");
        }
        for host in ["", "evil.example:7880", "localhost.evil.example", "127.0.0.1.evil.example"] {
            assert!(!check(host), "{host}");
        }
        assert!(gate.check_host(&HeaderMap::new(), &uri).is_err());
        let two = headers(&[("host", "localhost"), ("host", "evil.example")]);
        assert!(gate.check_host(&two, &uri).is_err());
        let absolute = Uri::from_static("http://evil.example/api/v1/status");
        assert!(gate.check_host(&headers(&[("host", "localhost")]), &absolute).is_err());
    }

    #[test]
    fn other_pages_change_nothing() {
        let gate = gate();
        let host = ("host", "localhost:7880");
        let check = |method: Method, more: &[(&'static str, &str)]| {
            let list: Vec<_> = std::iter::once(host).chain(more.iter().copied()).collect();
            gate.check_origin(&method, &headers(&list)).is_ok()
        };
        assert!(check(Method::POST, &[]), "a program");
        assert!(check(Method::POST, &[("origin", "http://localhost:7880")]));
        assert!(check(Method::GET, &[("sec-fetch-site", "none")]));
        for origin in ["http://localhost:9999", "https://localhost:7880", "null", "http://evil"] {
            assert!(!check(Method::POST, &[("origin", origin)]), "{origin}");
            assert!(!check(Method::DELETE, &[("origin", origin)]), "{origin}");
        }
        for site in ["same-site", "cross-site"] {
            assert!(!check(Method::GET, &[("sec-fetch-site", site)]), "{site}");
        }
    }

    #[test]
    fn a_bearer_token_or_a_cookie_is_needed() {
        let gate = gate();
        let good = format!("Bearer {}", login::bearer(TOKEN));
        let check = |name, value: &str| gate.authenticate(&headers(&[(name, value)]), None).is_ok();
        assert!(check("authorization", &good));
        let other = login::bearer("fedcba9876543210");
        for wrong in ["", "Bearer", TOKEN, &format!("Bearer {TOKEN}"), &format!("Bearer {other}")] {
            assert!(!check("authorization", wrong), "{wrong}");
        }
        assert!(gate.authenticate(&HeaderMap::new(), None).is_err());
        let (manager, _) = gate.challenge("0123456789abcdef").expect("a challenge");
        let mine = login::proof(TOKEN, login::ChallengeEnd::Client, &manager, "0123456789abcdef");
        let code = gate.code(&manager, &mine).expect("a code");
        let set = gate.redeem(&code).expect("a cookie");
        assert!(set.contains("HttpOnly") && set.contains("SameSite=Strict"), "{set}");
        let pair = set.split(';').next().expect("a pair");
        assert!(check("cookie", &format!("theme=dark; {pair}")));
        assert!(!check("cookie", &pair.replace("polyptych-7880", "polyptych-7881")));
        assert!(gate.redeem(&code).is_err(), "a link is good once");
    }
}
