//! An S3 server of this process: its objects are files of a folder, which tests can damage.

use std::convert::Infallible;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread::{Builder, JoinHandle};

use hyper::body::Incoming;
use hyper_util::rt::TokioIo;
use s3s::auth::SimpleAuth;
use s3s::service::{S3Service, S3ServiceBuilder};
use s3s_fs::FileSystem;
use tokio::sync::{oneshot, watch};

/// The only bucket.
pub const BUCKET: &str = "walls";

/// The credentials that may read and write it.
const KEY: &str = "operator";
const SECRET: &str = "a-secret-of-tests";

/// The fate of the second part of an object that is sent in parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// There is no answer.
    Silence,
    /// It is refused, once the first parts of this many objects are there.
    RefusalAfter(usize),
}

/// The troubles of second parts, in the order in which they come, and what has come so far.
#[derive(Debug)]
struct Troubles {
    list: Vec<Trouble>,
    met: AtomicUsize,
    /// First parts that are there.
    first_parts: watch::Sender<usize>,
}

/// The server; it ends with its owner, and at [`S3Server::stop`].
#[derive(Debug)]
pub struct S3Server {
    /// Its address, `http://HOST:PORT`.
    pub endpoint: String,
    folder: PathBuf,
    requests: Arc<AtomicU64>,
    troubles: Arc<Troubles>,
    running: Option<(oneshot::Sender<Infallible>, JoinHandle<()>)>,
}

impl S3Server {
    /// A server over this folder that wants its key and secret.
    pub fn start(folder: &Path) -> Self {
        Self::start_with(folder, true, &[])
    }

    /// A server like [`Self::start`], with trouble for parts of objects.
    pub fn start_troubled(folder: &Path, troubles: &[Trouble]) -> Self {
        Self::start_with(folder, true, troubles)
    }

    /// A server over this folder that answers everybody.
    pub fn start_open(folder: &Path) -> Self {
        Self::start_with(folder, false, &[])
    }

    fn start_with(folder: &Path, is_locked: bool, troubles: &[Trouble]) -> Self {
        std::fs::create_dir_all(folder.join(BUCKET)).expect("made");
        let mut service = S3ServiceBuilder::new(FileSystem::new(folder).expect("a folder"));
        if is_locked {
            service.set_auth(SimpleAuth::from_single(KEY, SECRET));
        }
        let service = service.build();
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let endpoint = format!("http://{}", listener.local_addr().expect("an address"));
        listener.set_nonblocking(true).expect("set");
        let requests = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&requests);
        let (list, met) = (troubles.to_vec(), AtomicUsize::new(0));
        let troubles = Arc::new(Troubles { list, met, first_parts: watch::Sender::new(0) });
        let met = Arc::clone(&troubles);
        let (stop, stopped) = oneshot::channel();
        let serve = move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(async {
                tokio::select! {
                    () = accept(listener, service, counted, met) => {}
                    // The sender is never used but dropped.
                    _ = stopped => {}
                }
            });
        };
        let thread = Builder::new().name("s3".into()).spawn(serve).expect("a thread");
        let folder = folder.to_owned();
        Self { endpoint, folder, requests, troubles, running: Some((stop, thread)) }
    }

    /// The environment of a process that uses it.
    pub fn environment(&self) -> [(&str, &str); 5] {
        [
            ("AWS_ENDPOINT", &self.endpoint),
            ("AWS_ALLOW_HTTP", "true"),
            ("AWS_REGION", "us-east-1"),
            ("AWS_ACCESS_KEY_ID", KEY),
            ("AWS_SECRET_ACCESS_KEY", SECRET),
        ]
    }

    /// The folder with the bucket's objects below this prefix.
    pub fn objects(&self, prefix: &str) -> PathBuf {
        self.folder.join(BUCKET).join(prefix)
    }

    /// Requests so far.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }

    /// Returns whether all troubles have come that this many objects of several parts can meet,
    /// whose first parts are there.
    pub fn is_in_trouble_with(&self, objects: usize) -> bool {
        let met = self.troubles.met.load(Ordering::Relaxed);
        met >= self.troubles.list.len() && *self.troubles.first_parts.borrow() >= objects
    }

    /// The files of uploads in parts that were neither completed nor given up.
    pub fn uploads_left(&self) -> Vec<PathBuf> {
        let files = std::fs::read_dir(&self.folder).expect("a folder");
        let files = files.map(|entry| entry.expect("one").path());
        let is_left = |path: &PathBuf| {
            let name = path.file_name().expect("a name").to_string_lossy();
            name.starts_with(".upload")
        };
        files.filter(is_left).collect()
    }

    /// Ends it, with all connections.
    pub fn stop(&mut self) {
        if let Some((stop, thread)) = self.running.take() {
            drop(stop);
            // It may have panicked, which the test sees by what it does not get.
            let _ = thread.join();
        }
    }
}

impl Drop for S3Server {
    fn drop(&mut self) {
        self.stop();
    }
}

async fn accept(
    listener: TcpListener,
    service: S3Service,
    requests: Arc<AtomicU64>,
    troubles: Arc<Troubles>,
) {
    let listener = tokio::net::TcpListener::from_std(listener).expect("a listener");
    while let Ok((socket, _)) = listener.accept().await {
        let (service, requests) = (service.clone(), Arc::clone(&requests));
        let troubles = Arc::clone(&troubles);
        let counted = hyper::service::service_fn(move |request: hyper::Request<Incoming>| {
            requests.fetch_add(1, Ordering::Relaxed);
            let part = part_of(&request);
            let (service, troubles) = (service.clone(), Arc::clone(&troubles));
            async move {
                match troubles.of_part(part) {
                    None => {}
                    Some(Trouble::Silence) => std::future::pending().await,
                    Some(Trouble::RefusalAfter(objects)) => {
                        let mut there = troubles.first_parts.subscribe();
                        there.wait_for(|parts| *parts >= objects).await.expect("a sender");
                        let refusal = hyper::Response::builder().status(403);
                        return Ok(refusal.body(s3s::Body::empty()).expect("an answer"));
                    }
                }
                let answer = hyper::service::Service::call(&service, request).await;
                if part == Some(1) {
                    troubles.first_parts.send_modify(|parts| *parts += 1);
                }
                answer
            }
        });
        tokio::spawn(async move {
            let connection = hyper::server::conn::http1::Builder::new();
            // A connection that its peer closes is of no interest.
            let _ = connection.serve_connection(TokioIo::new(socket), counted).await;
        });
    }
}

/// The number of the part of an object that a request brings.
fn part_of(request: &hyper::Request<Incoming>) -> Option<u32> {
    let mut words = request.uri().query()?.split('&');
    let number = words.find_map(|word| word.strip_prefix("partNumber="))?;
    (request.method() == hyper::Method::PUT).then_some(number.parse().ok()?)
}

impl Troubles {
    /// Returns the next trouble, if this is a second part.
    fn of_part(&self, part: Option<u32>) -> Option<Trouble> {
        if part != Some(2) {
            return None;
        }
        let met = self.met.fetch_add(1, Ordering::Relaxed);
        self.list.get(met).copied()
    }
}
