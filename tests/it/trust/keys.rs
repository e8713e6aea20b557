//! `polyptych keys`, and what is said of keys that are of no use.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use rcgen::ExtendedKeyUsagePurpose;

use crate::harness::keys::Forged;
use crate::harness::place::TestDir;

const WALL: &str = r#"[wall]
name = "pair"

[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
pixels = [200, 100]

[[screen.channel]]
name = "a"
server = "Left.1"
origin = [0, 0]
pixels = [100, 100]

[[screen.channel]]
name = "b"
server = "Left.1"
origin = [100, 0]
pixels = [100, 100]
"#;

fn mode(path: &Path) -> u32 {
    fs::metadata(path).expect("facts").permissions().mode() & 0o777
}

#[test]
fn keys_are_made_once_and_only_their_owner_reads_them() {
    let place = TestDir::new();
    place.write("wall.toml", WALL);
    let said = place.run(["keys", "wall.toml", "-o", "out/keys"]).succeeded();
    let nodes = ["manager", "server-Left.1", "client-operator"];
    for part in [
        "made out/keys/authority: stays here",
        "polyptych manager wall.toml --listen 0.0.0.0:7878 --keys manager",
        "polyptych server --manager HOST:7878 --keys server-Left.1 --channel a --channel b",
        "POLYPTYCH_KEYS=client-operator",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let keys = place.path("out/keys");
    let read = |path: &str| fs::read_to_string(keys.join(path)).expect("a file");
    for node in nodes {
        assert_eq!(mode(&keys.join(node)), 0o700, "{node}");
        assert_eq!(mode(&keys.join(node).join("key.pem")), 0o600, "{node}");
        assert_eq!(read(&format!("{node}/authority.pem")), read("authority/cert.pem"));
    }
    assert_eq!(mode(&keys.join("authority/key.pem")), 0o600);

    // Again: what is missing is added, by the same authority, and nothing else is touched.
    let before = nodes.map(|node| read(&format!("{node}/key.pem")));
    fs::remove_dir_all(keys.join("manager")).expect("removed");
    let again = ["keys", "wall.toml", "-o", "out/keys", "--client", "planner"];
    let said = place.run(again).succeeded();
    for part in ["kept out/keys/authority", "made out/keys/manager", "kept out/keys/server-Left.1"]
        .into_iter()
        .chain(["kept out/keys/client-operator", "made out/keys/client-planner"])
    {
        assert!(said.contains(part), "{part}: {said}");
    }
    let after = nodes.map(|node| read(&format!("{node}/key.pem")));
    assert!(before[0] != after[0] && before[1..] == after[1..]);
    assert_eq!(read("manager/authority.pem"), read("authority/cert.pem"));

    let authority = read("authority/cert.pem");
    let said = place.run(["keys", "wall.toml", "-o", "out/keys", "--renew"]).succeeded();
    assert!(said.contains("renewed out/keys/server-Left.1"), "{said}");
    assert!(nodes.iter().zip(&after).all(|(node, old)| read(&format!("{node}/key.pem")) != *old));
    assert_eq!(read("authority/cert.pem"), authority);
    // What is made appears whole, and nothing is left behind.
    let left = fs::read_dir(&keys).expect("a folder").flatten();
    assert_eq!(left.filter(|e| e.file_name().to_string_lossy().starts_with('.')).count(), 0);
}

#[test]
fn what_hinders_the_making_of_keys_is_named() {
    let place = TestDir::new();
    place.write("wall.toml", WALL);
    place.run(["keys", "wall.toml"]).succeeded();
    let keys = place.path("keys");
    // One folder of another wall's.
    place.run(["keys", "wall.toml", "-o", "other"]).succeeded();
    fs::remove_dir_all(keys.join("manager")).expect("removed");
    fs::rename(place.path("other/manager"), keys.join("manager")).expect("moved");
    place.run(["keys", "wall.toml"]).failed(&["manager/authority.pem", "another", "--renew"]);
    place.run(["keys", "--renew", "wall.toml"]).succeeded();
    fs::write(keys.join("server-Left.1/cert.pem"), "no PEM").expect("written");
    place.run(["keys", "wall.toml"]).failed(&["server-Left.1/cert.pem", "--renew"]);
    fs::remove_file(keys.join("authority/key.pem")).expect("removed");
    place.run(["keys", "wall.toml"]).failed(&["keys/authority/key.pem", "bring it back"]);
    place.write("file", "");
    place.run(["keys", "wall.toml", "-o", "file/keys"]).failed(&["file/keys/authority"]);
    place.run(["keys", "gone.toml"]).failed(&["gone.toml", "cannot be read"]);
    let odd = place.run(["keys", "wall.toml", "--client", "../x"]);
    assert_eq!(odd.code(), 2, "{}", odd.output);
}

/// Keys that are of no use are named before anything goes over a network.
#[test]
fn keys_that_are_of_no_use_are_named_with_their_fault() {
    let place = TestDir::new();
    place.write("wall.toml", WALL);
    place.run(["keys", "wall.toml"]).succeeded();
    place.run(["keys", "wall.toml", "-o", "other"]).succeeded();
    let (good, authority) = (place.path("keys/client-operator"), place.path("keys/authority"));
    let copy = |name: &str| {
        let folder = place.path(name);
        fs::create_dir(&folder).expect("made");
        for file in ["cert.pem", "key.pem", "authority.pem"] {
            fs::copy(good.join(file), folder.join(file)).expect("copied");
        }
        folder
    };
    let forge = |name: &str, forged: Forged| forged.write(&authority, &place.path(name));
    let client = || Forged::client("x.client.polyptych");
    forge("expired", Forged { days: [-300, -3], ..client() });
    forge("early", Forged { days: [3, 300], ..client() });
    forge("nobody", Forged { names: vec!["x.display.polyptych".into()], ..client() });
    forge("outside", Forged { names: vec!["wall.example".into()], ..client() });
    let two = ["x.client.polyptych", "y.client.polyptych"].map(String::from).to_vec();
    forge("two", Forged { names: two, ..client() });
    let purpose = ExtendedKeyUsagePurpose::ServerAuth;
    forge("purpose", Forged { purpose, ..client() });
    fs::remove_file(copy("half").join("key.pem")).expect("removed");
    fs::write(copy("text").join("cert.pem"), "no certificate").expect("written");
    let other = place.path("other/client-operator");
    fs::copy(other.join("key.pem"), copy("key").join("key.pem")).expect("copied");
    fs::copy(other.join("authority.pem"), copy("mixed").join("authority.pem")).expect("copied");
    let faults: [(&str, &[&str]); 11] = [
        ("expired", &["expired/cert.pem", "over since 3 days", "polyptych keys", "--renew"]),
        ("early", &["early/cert.pem", "has not begun", "clocks"]),
        ("nobody", &["nobody/cert.pem", "names no node", "x.display.polyptych"]),
        ("outside", &["outside/cert.pem", "names no node"]),
        ("two", &["two/cert.pem", "names no node", "y.client.polyptych"]),
        ("purpose", &["purpose/cert.pem", "made for the other side"]),
        ("half", &["half/key.pem is not there"]),
        ("text", &["text/cert.pem", "certificate"]),
        ("key", &["key/key.pem", "does not fit cert.pem"]),
        ("mixed", &["mixed/cert.pem", "another authority"]),
        ("keys/server-Left.1", &["certificate of server Left.1", "a client is needed"]),
    ];
    // Nobody listens there: whatever fails, fails before.
    let status = |keys: &str| place.run(["status", "--manager", "127.0.0.2:1", "--keys", keys]);
    for (folder, parts) in faults {
        status(folder).failed(parts);
    }
    status("keys/client-operator").failed(&["no manager at 127.0.0.2:1"]);
    // A certificate that ends soon is good, and warned of.
    forge("soon", Forged { days: [-300, 3], ..client() });
    let said = status("soon").output;
    assert!(said.contains("within 60 days") && said.contains("no manager at"), "{said}");

    let manager = |keys: &str| place.run(["manager", "wall.toml", "--keys", keys]);
    manager("keys/client-operator").failed(&["certificate of client operator", "the manager"]);
    manager("keys").failed(&["keys/cert.pem is not there"]);
    let server = ["server", "--headless", "--channel", "a", "--manager", "127.0.0.2:1", "--keys"];
    let server = |keys: &str, name: &str| place.run(server.iter().chain(&[keys, "--name", name]));
    server("keys/server-Left.1", "right").failed(&["of server Left.1", "server right is needed"]);
    server("keys/manager", "right").failed(&["of the manager", "a server is needed"]);
}

#[test]
fn nothing_leaves_this_machine_in_the_clear_unless_told_so() {
    let place = TestDir::new();
    place.write("token", "0123456789abcdef0123456789abcdef");
    // An address for documentation, which is nobody's.
    let far = ["--manager", "192.0.2.1:7878", "--token-file", "token"];
    let parts = ["192.0.2.1:7878", "nothing is encrypted", "polyptych keys", "--insecure"];
    place.run(["status"].iter().chain(&far)).failed(&parts);
    place.run(["server", "--headless", "--channel", "a"].iter().chain(&far)).failed(&parts);
}
