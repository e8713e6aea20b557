//! Keys of a test's own wall, made by the command; and forged ones, as no command makes them.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use polyptych_wall::Wall;
use rcgen::{
    CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair,
    KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

use super::place::TestDir;

/// Makes keys for a wall; whatever is started in this place then uses them.
pub fn make(place: &TestDir, wall: &Wall) {
    place.write("wall.toml", polyptych_wall_file::to_toml(wall));
    place.run(["keys", "wall.toml"]).succeeded();
}

/// A node's folder, where this place has keys.
pub fn of(place: &TestDir, node: &str) -> Option<PathBuf> {
    let folder = place.path("keys").join(node);
    folder.exists().then_some(folder)
}

/// The contents of a forged certificate.
#[derive(Clone, Debug)]
pub struct Forged {
    pub names: Vec<String>,
    /// Begins and ends so many days from now.
    pub days: [i64; 2],
    pub purpose: ExtendedKeyUsagePurpose,
}

impl Forged {
    /// A client's certificate of this DNS name, without a fault.
    pub fn client(name: &str) -> Self {
        let purpose = ExtendedKeyUsagePurpose::ClientAuth;
        Self { names: vec![name.to_owned()], days: [-1, 365], purpose }
    }

    /// Puts it into a folder of keys, signed by the authority in `authority`.
    pub fn write(&self, authority: &Path, folder: &Path) {
        let read = |name: &str| fs::read_to_string(authority.join(name)).expect("an authority");
        let mut issuer = CertificateParams::default();
        issuer.distinguished_name = DistinguishedName::new();
        issuer.distinguished_name.push(DnType::CommonName, "Polyptych wall authority");
        let issuer = Issuer::new(issuer, KeyPair::from_pem(&read("key.pem")).expect("a key"));
        let mut params = CertificateParams::new(self.names.clone()).expect("names");
        let [from, to] = self.days.map(|days| OffsetDateTime::now_utc() + Duration::days(days));
        (params.not_before, params.not_after) = (from, to);
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![self.purpose.clone()];
        let key = KeyPair::generate().expect("a key");
        let certificate = params.signed_by(&key, &issuer).expect("signed");
        fs::create_dir_all(folder).expect("made");
        let files = [
            ("cert.pem", certificate.pem()),
            ("key.pem", key.serialize_pem()),
            ("authority.pem", read("cert.pem")),
        ];
        for (name, text) in files {
            let path = folder.join(name);
            fs::write(&path, text).expect("written");
            fs::set_permissions(&path, Permissions::from_mode(0o600)).expect("its owner's alone");
        }
    }
}
