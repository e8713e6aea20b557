//! A browser without a window, driven over its debugging pipe.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use super::place::TestDir;
use super::wait;

/// Puts the pipes where the browser looks for them, and nothing in their old place. It asks nothing
/// of the network by itself.
const SCRIPT: &str = r#"exec chromium --headless=new --no-sandbox --disable-gpu \
--no-first-run --disable-background-networking --disable-component-update --disable-sync \
--remote-debugging-pipe --user-data-dir="$1" --window-size=1100,1400 about:blank \
3<&0 4>&1 </dev/null >/dev/null 2>/dev/null"#;

/// A browser with one page; it ends with the test.
#[derive(Debug)]
pub struct Browser {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    last: u64,
    session: Value,
    /// Errors and warnings of the page.
    pub complaints: Vec<String>,
}

impl Browser {
    /// Starts Chromium with an empty page.
    pub fn start(place: &TestDir) -> Self {
        let mut command = Command::new("sh");
        command.arg("-c").arg(SCRIPT).arg("sh").arg(place.path("chromium"));
        command.env("HOME", place.folder()).env("TMPDIR", place.folder());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("sh");
        let to = child.stdin.take().expect("a pipe");
        let from = BufReader::new(child.stdout.take().expect("a pipe"));
        let (complaints, session) = (Vec::new(), Value::Null);
        let mut browser = Self { child, to, from, last: 0, session, complaints };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = browser.call("Target.attachToTarget", &attach);
        browser.session = attached["sessionId"].clone();
        for domain in ["Runtime.enable", "Log.enable", "Page.enable"] {
            browser.call(domain, &json!({}));
        }
        browser
    }

    /// Calls a method of the debugging protocol.
    #[track_caller]
    pub fn call(&mut self, method: &str, params: &Value) -> Value {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": params });
        if !self.session.is_null() {
            message["sessionId"] = self.session.clone();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("sent");
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).expect("read");
            let missing = "chromium answers (on Debian or Ubuntu: apt install chromium)";
            assert!(bytes.pop() == Some(0), "{missing}");
            let mut answer: Value = serde_json::from_slice(&bytes).expect("JSON");
            if answer["id"] == self.last {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].take();
            }
            let is_complaint = match answer["method"].as_str() {
                Some("Runtime.exceptionThrown") => true,
                Some("Log.entryAdded") => answer["params"]["entry"]["level"] == "error",
                _ => false,
            };
            if is_complaint {
                self.complaints.push(answer["params"].to_string());
            }
        }
    }

    /// Opens a page.
    #[track_caller]
    pub fn open(&mut self, url: &str) {
        self.call("Page.navigate", &json!({ "url": url }));
    }

    /// The value of an expression of the page; a promise is awaited.
    #[track_caller]
    pub fn value(&mut self, expression: &str) -> Value {
        let params = json!({
            "expression": expression, "awaitPromise": true, "returnByValue": true,
        });
        let mut evaluated = self.call("Runtime.evaluate", &params);
        assert!(evaluated["exceptionDetails"].is_null(), "{expression}: {evaluated}");
        evaluated["result"]["value"].take()
    }

    /// Waits until an expression of the page is true.
    #[track_caller]
    pub fn await_true(&mut self, expression: &str) {
        let what = format!("{expression} (the page says: {:?})", self.complaints);
        wait::until(&what, || (self.value(expression) == true).then_some(()));
    }

    /// Presses, moves and lets go of the mouse.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        for (kind, at, buttons) in
            [("mousePressed", from, 1), ("mouseMoved", to, 1), ("mouseReleased", to, 0)]
        {
            let event = json!({
                "type": kind, "x": at[0], "y": at[1], "button": "left", "buttons": buttons,
                "clickCount": 1,
            });
            self.call("Input.dispatchMouseEvent", &event);
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
