//! The clients and pages that may command a wall over HTTP.

use polyptych_tls::Credentials;
use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::page::{Page, exchange};
use crate::harness::keys;
use crate::harness::local_wall::{ANY_PORT, small};
use crate::harness::place::TestDir;

/// A wall's manager alone: nothing here needs a picture.
fn manager(extra: &[&str]) -> Page {
    Page::manager(TestDir::new(), &small(1, 1), &[], extra)
}

/// A request with these lines of its head, and no other.
fn ask(page: &Page, method: &str, path: &str, lines: &[&str]) -> super::page::Answer {
    let lines: String = lines.iter().flat_map(|line| [*line, "\r\n"]).collect();
    let text = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n{lines}\r\n");
    exchange(&page.address, text.as_bytes())
}

#[test]
fn a_token_is_needed_and_the_walls_own_does_not_do() {
    let page = manager(&[]);
    let host = format!("Host: {}", page.address);
    let status = |line: &str| ask(&page, "GET", "/api/v1/status", &[&host, line]);
    let good = format!("Authorization: Bearer {}", page.bearer);
    assert_eq!(status(&good).code, 200);
    let none = status("X: y");
    none.refused(401, "polyptych login");
    assert_eq!(none.header("www-authenticate"), Some("Bearer"));
    let token = std::fs::read_to_string(page.local.place.token_file()).expect("a token");
    assert_ne!(token, page.bearer);
    status(&format!("Authorization: Bearer {token}")).refused(401, "not this manager's");
    status(&format!("Authorization: Basic {}", page.bearer)).refused(401, "not this manager's");
    status("Cookie: polyptych-1=a.b.c").refused(401, "not logged in");
    // The page itself says how to log in.
    for (path, kind) in [("/", "text/html"), ("/console.js", "text/javascript")] {
        let answer = ask(&page, "GET", path, &[&host]);
        assert_eq!(answer.code, 200, "{path}");
        assert!(answer.header("content-type").is_some_and(|of| of.starts_with(kind)));
        let policy = answer.header("content-security-policy").expect("a policy");
        assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    }
}

#[test]
fn a_link_logs_a_browser_in_once() {
    let page = manager(&[]);
    let host = format!("Host: {}", page.address);
    let place = &page.local.place;
    let link = place.run(["login", "--http", &page.address]).succeeded();
    let path = link.trim().strip_prefix(&format!("http://{}", page.address)).expect("a link");
    assert!(path.starts_with("/login?code="), "{path}");
    let opened = ask(&page, "GET", path, &[&host]);
    assert_eq!((opened.code, opened.header("location")), (303, Some("/")), "{opened}");
    let cookie = opened.header("set-cookie").expect("a cookie");
    for part in ["HttpOnly", "SameSite=Strict", "Path=/"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    let pair = cookie.split(';').next().expect("a pair");
    let cookie = format!("Cookie: other=1; {pair}");
    assert_eq!(ask(&page, "GET", "/api/v1/status", &[&host, &cookie]).code, 200);
    ask(&page, "GET", path, &[&host]).refused(401, "used up");
    ask(&page, "GET", "/login?code=", &[&host]).refused(401, "used up");
    ask(&page, "POST", path, &[&host]).refused(405, "GET");
    // A command that knows another token is told so, and sends nothing that could be used.
    let other = TestDir::new();
    other.write("state/token", "ffffffffffffffffffffffffffffffff");
    let failed = other.run(["login", "--http", &page.address]);
    failed.failed(&["does not know the token"]);
    let metrics = TestDir::new();
    metrics.write("state/token", "ffffffffffffffffffffffffffffffff");
    metrics.run(["login", "--http", "127.0.0.1:1"]).failed(&["no manager serves HTTP"]);
}

#[test]
fn other_names_and_other_pages_are_refused() {
    let page = manager(&["--http-host", "wall.example"]);
    let good = format!("Authorization: Bearer {}", page.bearer);
    let port = page.address.rsplit(':').next().expect("a port");
    for host in [&page.address, "localhost", &format!("localhost:{port}"), "wall.example:80"] {
        let host = format!("Host: {host}");
        assert_eq!(ask(&page, "GET", "/api/v1/status", &[&host, &good]).code, 200, "{host}");
    }
    for host in ["Host: evil.example", "Host: localhost.evil.example", "Host: ", "X: y"] {
        ask(&page, "GET", "/api/v1/status", &[host, &good]).refused(421, "--http-host");
        ask(&page, "GET", "/", &[host]).refused(421, "--http-host");
    }
    let host = format!("Host: {}", page.address);
    let store = |origin: &str| ask(&page, "PUT", "/api/v1/views/quay", &[&host, &good, origin]);
    assert_eq!(store(&format!("Origin: http://{}", page.address)).code, 200);
    for origin in ["http://evil.example", "null", "http://localhost:1", "https://127.0.0.1"] {
        store(&format!("Origin: {origin}")).refused(403, "may not command");
    }
    store("Sec-Fetch-Site: cross-site").refused(403, "another page");
    let picture = ["Sec-Fetch-Site: same-site", &host, &good];
    ask(&page, "GET", "/api/v1/wall.png", &picture).refused(403, "another page");
    // A form of another page can send text, but no JSON.
    let form = format!("{}Content-Type: text/plain\r\nContent-Length: 2\r\n\r\n{{}}", {
        page.head("PUT", "/api/v1/views/bay")
    });
    exchange(&page.address, form.as_bytes()).refused(415, "application/json");
    let views = page.ask("GET", "/views", None).value();
    assert_eq!(views.as_array().map(Vec::len), Some(1), "nothing else was stored: {views}");
}

#[test]
fn http_leaves_this_machine_only_where_that_was_said() {
    let place = TestDir::new();
    let wall = place.write("wall.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    let wall = wall.to_str().expect("text");
    let open = ["manager", "--listen", ANY_PORT, "--http", "0.0.0.0:0", wall];
    place.run(open).failed(&["--http 0.0.0.0:0", "--keys FOLDER", "--insecure"]);
    let names = ["manager", "--listen", ANY_PORT, "--http", "no.such.invalid:1", wall];
    place.run(names).failed(&["--http no.such.invalid:1"]);
    let page = manager(&["--insecure", "--http-host", "a"]);
    assert_eq!(page.ask("POST", "/frame", Some(&json!({}))).code, 200);
}

#[test]
fn with_keys_a_clients_certificate_is_needed_and_enough() {
    let wall = small(1, 1);
    let place = TestDir::new();
    keys::make(&place, &wall);
    let page = Page::manager(place, &wall, &[], &[]);
    let status = |node: &str| {
        let folder = keys::of(&page.local.place, node).expect("keys");
        let credentials = Credentials::load(&folder).expect("keys");
        let text = page.head("GET", "/api/v1/status").replace("Bearer", "None") + "\r\n";
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        runtime.expect("a runtime").block_on(async {
            let stream = polyptych_tls::connect(&page.address, Some(&credentials), false).await;
            let mut stream = stream.expect("connected");
            stream.write_all(text.as_bytes()).await.expect("sent");
            let mut bytes = Vec::new();
            let _ = stream.read_to_end(&mut bytes).await;
            String::from_utf8_lossy(&bytes).into_owned()
        })
    };
    let answer = status("client-operator");
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("http operator"), "{answer}");
    let server = format!("server-{}", wall.channels[0].server);
    let answer = status(&server);
    assert!(answer.starts_with("HTTP/1.1 403") && answer.contains("client's certificate"));
    // In the clear nobody is heard, whatever is said.
    let plain = exchange(&page.address, (page.head("GET", "/") + "\r\n").as_bytes());
    assert_eq!(plain.code, 0, "{plain}");
}
