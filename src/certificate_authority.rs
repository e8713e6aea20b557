//! A wall's own certificate authority: it makes the keys of the wall's nodes, and of nothing else.
//!
//! Each node gets one folder, which appears whole or not at all. The authority's own key signs them
//! and is needed for nothing but that: it stays where it was made.

use std::fs;
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use polyptych_files::output_file;
use polyptych_tls::{AUTHORITY_FILE, CERTIFICATE_FILE, Credentials, KEY_FILE, NodeIdentity};
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose,
    GeneralSubtree, IsCa, Issuer, KeyPair, KeyUsagePurpose, NameConstraints,
};
use time::{Duration, OffsetDateTime};

/// Validity of certificates: longer than the machines of a wall are in use. One that expires
/// darkens a display on a day when nobody expects it, and a short life would protect nothing: if a
/// key is compromised, a new authority is created at once.
const VALID: Duration = Duration::days(3653);

/// Time before now at which their validity begins: clocks of machines without a time server differ.
const CLOCK_SLACK: Duration = Duration::days(1);

/// The authority's name. It is the same for all walls, since a certificate is checked by the
/// authority's key; so the authority can go on from its key alone.
const NAME: &str = "Polyptych wall authority";

/// The authority of one wall, able to sign.
pub(crate) struct CertificateAuthority {
    folder: PathBuf,
    certificate: String,
    issuer: Issuer<'static, KeyPair>,
}

/// The outcome for a node's folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum IssueOutcome {
    Made,
    Kept,
    Renewed,
}

impl CertificateAuthority {
    /// The authority in this folder, which is made where it is not there.
    ///
    /// # Errors
    /// A file can't be read or written.
    pub fn open_or_create(folder: &Path) -> anyhow::Result<(Self, IssueOutcome)> {
        if folder.exists() {
            return Ok((Self::open(folder)?, IssueOutcome::Kept));
        }
        let key = KeyPair::generate()?;
        let mut params = params(NAME);
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        // Should somebody trust it elsewhere, it can speak for walls only.
        let names = vec![GeneralSubtree::DnsName("polyptych".into())];
        params.name_constraints =
            Some(NameConstraints { permitted_subtrees: names, excluded_subtrees: Vec::new() });
        let certificate = params.self_signed(&key)?.pem();
        let files = [(CERTIFICATE_FILE, &certificate), (KEY_FILE, &key.serialize_pem())];
        place(folder, &files, |_| Ok(()))?;
        Ok((
            Self { folder: folder.to_owned(), certificate, issuer: issuer(key) },
            IssueOutcome::Made,
        ))
    }

    fn open(folder: &Path) -> anyhow::Result<Self> {
        let read = |name: &str| {
            let path = folder.join(name);
            fs::read_to_string(&path).with_context(|| {
                let path = path.display();
                format!("{path}: the authority needs it to make keys; bring it back")
            })
        };
        let (certificate, key) = (read(CERTIFICATE_FILE)?, read(KEY_FILE)?);
        let key = KeyPair::from_pem(&key)
            .with_context(|| format!("{}: no private key", folder.join(KEY_FILE).display()))?;
        Ok(Self { folder: folder.to_owned(), certificate, issuer: issuer(key) })
    }

    /// Makes a node's folder where it is not there, or `renew` says so. One that is there is
    /// checked.
    ///
    /// # Errors
    /// A file can't be written, or the keys that are there are not valid for this node.
    pub fn issue(
        &self,
        node: &NodeIdentity,
        folder: &Path,
        renew: bool,
    ) -> anyhow::Result<IssueOutcome> {
        let is_there = folder.exists();
        if is_there && !renew {
            self.check(node, folder).context("or replace it: --renew")?;
            return Ok(IssueOutcome::Kept);
        }
        let mut params = params(&node.to_string());
        params.subject_alt_names = CertificateParams::new([node.dns_name()])?.subject_alt_names;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        // A node's certificate is worth nothing on the manager's side of a connection.
        params.extended_key_usages = vec![match node {
            NodeIdentity::Manager => ExtendedKeyUsagePurpose::ServerAuth,
            NodeIdentity::Server(_) | NodeIdentity::Client(_) => {
                ExtendedKeyUsagePurpose::ClientAuth
            }
        }];
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?.pem();
        let files = [
            (CERTIFICATE_FILE, &certificate),
            (KEY_FILE, &key.serialize_pem()),
            (AUTHORITY_FILE, &self.certificate),
        ];
        place(folder, &files, |made| self.check(node, made))?;
        Ok(if is_there { IssueOutcome::Renewed } else { IssueOutcome::Made })
    }

    /// Checks that a folder holds keys of this node, by this authority.
    fn check(&self, node: &NodeIdentity, folder: &Path) -> anyhow::Result<()> {
        Credentials::load(folder)?.expect_identity(node)?;
        let ours = self.folder.join(CERTIFICATE_FILE);
        let theirs = folder.join(AUTHORITY_FILE);
        ensure!(
            polyptych_tls::certificate(&ours)? == polyptych_tls::certificate(&theirs)?,
            "{}: another authority than {}",
            theirs.display(),
            ours.display()
        );
        Ok(())
    }
}

fn params(name: &str) -> CertificateParams {
    let now = OffsetDateTime::now_utc();
    let mut params = CertificateParams::default();
    params.not_before = now - CLOCK_SLACK;
    params.not_after = now + VALID;
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, name);
    params
}

fn issuer(key: KeyPair) -> Issuer<'static, KeyPair> {
    let mut params = params(NAME);
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    Issuer::new(params, key)
}

/// Puts files into a folder that only its owner enters, and the folder where it belongs, once it
/// has passed the check. What was there before is gone then.
fn place(
    folder: &Path,
    files: &[(&str, &String)],
    check: impl Fn(&Path) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let cannot = || format!("cannot write {}", folder.display());
    let Some(parent) = folder.parent() else { bail!("{}: not a folder's name", folder.display()) };
    check_folder(folder).with_context(cannot)?;
    fs::DirBuilder::new().recursive(true).mode(0o700).create(parent).with_context(cannot)?;
    let mut temporary = tempfile::Builder::new();
    temporary.prefix(".new-").permissions(fs::Permissions::from_mode(0o700));
    let made = temporary.tempdir_in(parent).with_context(cannot)?;
    for (name, text) in files {
        // A temporary file has mode 0600 from its first byte; persisting keeps it.
        let mut file = tempfile::NamedTempFile::new_in(made.path()).with_context(cannot)?;
        file.write_all(text.as_bytes()).with_context(cannot)?;
        file.as_file().sync_all().with_context(cannot)?;
        file.persist(made.path().join(name)).with_context(cannot)?;
    }
    check(made.path())?;
    exchange(made.path(), folder, parent).with_context(cannot)?;
    // It has another name now, so that nothing is to be removed.
    let _ = made.keep();
    Ok(())
}

/// Puts one folder in the place of another, both of this parent; if that fails, the other one is
/// there as before.
fn exchange(made: &Path, folder: &Path, parent: &Path) -> anyhow::Result<()> {
    let old = tempfile::Builder::new().prefix(".old-").tempdir_in(parent)?;
    let was = old.path().join("was");
    let is_there = folder.exists();
    if is_there {
        fs::rename(folder, &was)?;
    }
    let Err(error) = fs::rename(made, folder) else { return Ok(()) };
    if is_there && fs::rename(&was, folder).is_err() {
        let kept = old.keep();
        let context = || format!("what was there before is in {}", kept.display());
        return Err(error).with_context(context);
    }
    Err(error.into())
}

/// Checks that nothing, or a folder, is there to be replaced.
fn check_folder(folder: &Path) -> anyhow::Result<()> {
    match fs::symlink_metadata(folder) {
        Ok(facts) if !facts.is_dir() => {
            let kind = output_file::kind_of(facts.file_type());
            bail!("it is {kind}, not a folder; name another folder with --out")
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_that_cannot_be_replaced_stay() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().join("manager");
        fs::create_dir(&folder).expect("made");
        fs::write(folder.join(KEY_FILE), "old").expect("written");
        let gone = place.path().join(".new-gone");
        assert!(exchange(&gone, &folder, place.path()).is_err());
        assert_eq!(fs::read_to_string(folder.join(KEY_FILE)).expect("a key"), "old");
        assert_eq!(fs::read_dir(place.path()).expect("a folder").count(), 1, "something is left");
    }
}
