//! `polyptych status --watch`, in a terminal and elsewhere.

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::wait;

fn manager() -> LocalWall {
    LocalWall::manager(TestDir::new(), &small(2, 1), &[], ANY_PORT)
}

#[test]
fn without_a_terminal_it_writes_lines_and_finds_a_manager_again() {
    let mut local = manager();
    let address = local.address.clone();
    let watch = ["status", "--watch", "--manager", &address];
    let mut watching = local.place.start("watch", watch);
    watching.await_line(&["wall small", "2 lost", "no server has claimed it yet"]);
    local.manager.kill();
    watching.await_line(&["no answer from", &address, "since", "UTC"]);
    let again = LocalWall::manager(local.place, &small(2, 1), &[], &address);
    let mut objects = again.place.start("watch", watch.iter().chain(&["--json"]));
    objects.await_line(&["{\"wall\":\"small\"", "\"channels\":[{"]);
    wait::until("a line of the new manager", || {
        let output = watching.output();
        let (_, after) = output.split_once("no answer from")?;
        after.contains("wall small").then_some(())
    });
    watching.signal(Signal::TERM);
    assert_eq!(watching.finish(wait::SOON).code(), 0);
}

/// The command in a terminal of its own, and all that it has drawn.
struct Terminal {
    child: Child,
    keys: File,
    /// The terminal from the program's side, to see how it was left.
    inner: File,
    drawn: Arc<Mutex<Vec<u8>>>,
}

impl Terminal {
    fn start(local: &LocalWall) -> Self {
        let outer = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
        grantpt(&outer).expect("granted");
        unlockpt(&outer).expect("unlocked");
        let name = ptsname(&outer, Vec::new()).expect("a name").into_string().expect("UTF-8");
        let inner = File::options().read(true).write(true).open(name).expect("opened");
        let size = Winsize { ws_row: 20, ws_col: 90, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&inner, size).expect("a size");
        let handle = || Stdio::from(inner.try_clone().expect("a handle"));
        let mut command = local.place.command(["status", "--watch", "--manager", &local.address]);
        command.env_remove("NO_COLOR").env("TERM", "xterm-256color");
        command.stdin(handle()).stdout(handle()).stderr(handle());
        let child = command.spawn().expect("started");
        let keys = File::from(outer);
        let mut screen = keys.try_clone().expect("a handle");
        let drawn = Arc::<Mutex<Vec<u8>>>::default();
        let kept = Arc::clone(&drawn);
        let keep = move || {
            let mut bytes = [0; 4096];
            // It fails when the last program has let go of the terminal.
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                kept.extend(&bytes[..count]);
            }
        };
        std::thread::Builder::new().name("screen".into()).spawn(keep).expect("a thread");
        Self { child, keys, inner, drawn }
    }

    fn drawn(&self) -> String {
        let drawn = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&drawn).into_owned()
    }

    #[track_caller]
    fn await_drawn(&self, part: &str) {
        let is_drawn = || self.drawn().contains(part).then_some(());
        let seen = wait::look_for(wait::LIMIT, is_drawn);
        assert!(seen.is_some(), "{part:?} was not drawn: {:?}", self.drawn());
    }

    fn is_raw(&self) -> bool {
        let modes = tcgetattr(&self.inner).expect("modes").local_modes;
        !modes.contains(LocalModes::ICANON | LocalModes::ECHO)
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_terminal_is_drawn_and_left_as_it_was_however_it_ends() {
    let mut local = manager();
    for (how, end) in [("q", Some(&b"q"[..])), ("Ctrl-C", Some(b"\x03")), ("SIGTERM", None)] {
        let mut terminal = Terminal::start(&local);
        terminal.await_drawn("\x1b[?1049h");
        terminal.await_drawn("front-2-1");
        // The word, in red.
        terminal.await_drawn("\x1b[38;5;9m\x1b[1mlost");
        assert!(terminal.is_raw(), "{how}: keys come one by one");
        if how == "q" {
            local.manager.kill();
            terminal.await_drawn("no answer from");
            local = LocalWall::manager(local.place, &small(2, 1), &[], &local.address);
        }
        match end {
            Some(keys) => terminal.keys.write_all(keys).expect("typed"),
            None => crate::harness::signals::send(terminal.child.id(), Signal::TERM),
        }
        let ended = wait::look_for(wait::SOON, || terminal.child.try_wait().expect("asked"));
        assert_eq!(ended.and_then(|status| status.code()), Some(0), "{how}");
        terminal.await_drawn("\x1b[?1049l");
        terminal.await_drawn("\x1b[?25h");
        assert!(!terminal.is_raw(), "{how}: the terminal is left raw");
    }
}
