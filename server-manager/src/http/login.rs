//! Logging in: how browsers and programs show that they may command the wall.
//!
//! The wall's token never travels. Programs send a bearer token that is derived from it; a browser
//! has a cookie that is signed with a key derived from it, which it gets for a code that is used
//! once. `polyptych login` asks for the code: manager and command prove to each other that they
//! know the token, over random numbers of both.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::time::Instant;

/// Maximum time between a challenge and its answer.
const CHALLENGE_TIME_MAX: Duration = Duration::from_secs(30);

/// Maximum number of challenges that wait for their answers; the oldest makes room.
const CHALLENGES_MAX: usize = 64;

/// Maximum number of links that were handed out and not opened yet; the oldest makes room.
const CODES_MAX: usize = 16;

/// Maximum time until a link is opened.
pub const CODE_TIME_MAX: Duration = Duration::from_mins(10);

/// Time for which a browser stays logged in.
pub(super) const COOKIE_TIME_MAX: Duration = Duration::from_hours(30 * 24);

/// An end of a challenge.
#[derive(Clone, Copy, Debug)]
pub enum ChallengeEnd {
    /// Shows first that it knows the token.
    Manager,
    /// Gets a code for showing the same.
    Client,
}

/// The bearer token of programs, which lasts as long as the wall's token.
pub fn bearer(token: &str) -> String {
    let key = blake3::derive_key("polyptych 2026-11 http bearer token", token.as_bytes());
    blake3::Hash::from_bytes(key).to_hex().to_string()
}

/// The proof of one end of a challenge that it knows the wall's token.
pub fn proof(token: &str, end: ChallengeEnd, manager_nonce: &str, client_nonce: &str) -> String {
    let key = blake3::derive_key("polyptych 2026-11 http login", token.as_bytes());
    let mut hasher = blake3::Hasher::new_keyed(&key);
    hasher.update(&[end as u8]);
    for nonce in [manager_nonce, client_nonce] {
        hasher.update(&(nonce.len() as u64).to_le_bytes()).update(nonce.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// Returns whether two secrets in hexadecimal digits are the same, in constant time.
pub fn is_same(one: &str, other: &str) -> bool {
    let parsed = |text| blake3::Hash::from_hex(text).ok();
    parsed(one).zip(parsed(other)).is_some_and(|(one, other)| one == other)
}

/// A random number of 128 bits in hexadecimal digits.
///
/// # Errors
/// The system's reason not to give one.
pub fn nonce() -> Result<String, String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|error| format!("no random numbers: {error}"))?;
    Ok(format!("{:032x}", u128::from_be_bytes(bytes)))
}

/// Logins on their way.
#[derive(Debug, Default)]
pub(super) struct Logins {
    /// The start of each challenge, and the numbers of the manager and the client.
    challenges: Vec<(Instant, String, String)>,
    codes: Vec<(Instant, String)>,
}

impl Logins {
    /// Begins a challenge. Returns the manager's number and proof.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn challenge(&mut self, token: &str, client: &str) -> Result<(String, String), String> {
        let manager = nonce()?;
        let proof = proof(token, ChallengeEnd::Manager, &manager, client);
        if self.challenges.len() >= CHALLENGES_MAX {
            self.challenges.remove(0);
        }
        self.challenges.push((Instant::now(), manager.clone(), client.to_owned()));
        Ok((manager, proof))
    }

    /// Gives a code to who has proven to know the token; each challenge is answered once.
    ///
    /// # Errors
    /// The reason why there is none.
    pub fn code(&mut self, token: &str, manager: &str, shown: &str) -> Result<String, String> {
        let found = self.challenges.iter().position(|(_, of, _)| of == manager);
        let challenge = found.map(|index| self.challenges.remove(index));
        let is_fresh = |began: &Instant| began.elapsed() <= CHALLENGE_TIME_MAX;
        let challenge = challenge.filter(|(began, ..)| is_fresh(began));
        let Some((_, manager, client)) = challenge else {
            return Err("there is no such challenge, or it took too long; log in again".into());
        };
        if !is_same(&proof(token, ChallengeEnd::Client, &manager, &client), shown) {
            return Err("the token is not this manager's; use the manager's token file".into());
        }
        let code = nonce()?;
        if self.codes.len() >= CODES_MAX {
            self.codes.remove(0);
        }
        self.codes.push((Instant::now(), code.clone()));
        Ok(code)
    }

    /// Takes a code back; it is good once. Returns whether it was.
    pub fn redeem(&mut self, code: &str) -> bool {
        self.codes.retain(|(since, _)| since.elapsed() <= CODE_TIME_MAX);
        let hash = |text: &str| blake3::hash(text.as_bytes());
        let found = self.codes.iter().position(|(_, of)| hash(of) == hash(code));
        found.map(|index| self.codes.remove(index)).is_some()
    }
}

/// Signs and checks cookies: `EXPIRY.NONCE.SIGNATURE`.
#[derive(Clone)]
pub(super) struct CookieSigner([u8; 32]);

impl CookieSigner {
    pub fn new(token: &str) -> Self {
        Self(blake3::derive_key("polyptych 2026-11 http cookie", token.as_bytes()))
    }

    /// A cookie's value for a browser that was let in now.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn sign(&self, now: SystemTime) -> Result<String, String> {
        let expiry = seconds(now + COOKIE_TIME_MAX);
        let signed = format!("{expiry}.{}", nonce()?);
        Ok(format!("{signed}.{}", self.signature(&signed)))
    }

    /// Returns whether a value was signed here and is still good.
    pub fn is_valid(&self, value: &str, now: SystemTime) -> bool {
        let Some((signed, signature)) = value.rsplit_once('.') else { return false };
        let expiry = signed.split('.').next().and_then(|text| text.parse::<u64>().ok());
        is_same(&self.signature(signed), signature)
            && expiry.is_some_and(|expiry| expiry > seconds(now))
    }

    fn signature(&self, text: &str) -> String {
        blake3::keyed_hash(&self.0, text.as_bytes()).to_hex().to_string()
    }
}

fn seconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    #[test]
    fn a_code_is_given_for_a_proof_and_is_good_once() {
        let mut logins = Logins::default();
        let (manager, shown) = logins.challenge(TOKEN, "mine").expect("random numbers");
        assert!(is_same(&shown, &proof(TOKEN, ChallengeEnd::Manager, &manager, "mine")));
        assert!(logins.code(TOKEN, &manager, &shown).is_err(), "the manager's own proof");
        let mine = proof(TOKEN, ChallengeEnd::Client, &manager, "mine");
        assert!(logins.code(TOKEN, &manager, &mine).is_err(), "each challenge is answered once");
        let (manager, _) = logins.challenge(TOKEN, "mine").expect("random numbers");
        let other = proof("fedcba9876543210", ChallengeEnd::Client, &manager, "mine");
        assert!(logins.code(TOKEN, &manager, &other).is_err_and(|said| said.contains("token")));
        let (manager, _) = logins.challenge(TOKEN, "mine").expect("random numbers");
        let mine = proof(TOKEN, ChallengeEnd::Client, &manager, "mine");
        let code = logins.code(TOKEN, &manager, &mine).expect("a code");
        assert!(!logins.redeem("") && !logins.redeem(&code[1..]));
        assert!(logins.redeem(&code) && !logins.redeem(&code));
    }

    #[test]
    fn tables_of_logins_are_bounded() {
        let mut logins = Logins::default();
        for _ in 0..3 * CHALLENGES_MAX {
            let (manager, _) = logins.challenge(TOKEN, "a").expect("random numbers");
            let mine = proof(TOKEN, ChallengeEnd::Client, &manager, "a");
            logins.code(TOKEN, &manager, &mine).expect("a code");
            logins.challenge(TOKEN, "b").expect("random numbers");
        }
        assert_eq!((logins.challenges.len(), logins.codes.len()), (CHALLENGES_MAX, CODES_MAX));
    }

    #[test]
    fn a_cookie_is_good_until_it_expires_and_for_its_token_only() {
        let signer = CookieSigner::new(TOKEN);
        let now = SystemTime::now();
        let cookie = signer.sign(now).expect("random numbers");
        assert!(signer.is_valid(&cookie, now));
        assert!(!signer.is_valid(&cookie, now + COOKIE_TIME_MAX));
        assert!(!CookieSigner::new("fedcba9876543210").is_valid(&cookie, now));
        let longer = cookie.replacen('1', "9", 1);
        for wrong in ["", ".", "9999999999.a", &longer] {
            assert!(!signer.is_valid(wrong, now), "{wrong}");
        }
        assert_ne!(bearer(TOKEN), bearer("fedcba9876543210"));
    }
}
