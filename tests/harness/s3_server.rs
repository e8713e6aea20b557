//! An S3 server of this process: its objects are files of a folder, which tests can damage.

use std::convert::Infallible;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};

use hyper_util::rt::TokioIo;
use s3s::auth::SimpleAuth;
use s3s::service::{S3Service, S3ServiceBuilder};
use s3s_fs::FileSystem;
use tokio::sync::oneshot;

/// The only bucket.
pub const BUCKET: &str = "walls";

/// The credentials that may read and write it.
const KEY: &str = "operator";
const SECRET: &str = "a-secret-of-tests";

/// The server; it ends with its owner, and at [`S3Server::stop`].
#[derive(Debug)]
pub struct S3Server {
    /// Its address, `http://HOST:PORT`.
    pub endpoint: String,
    folder: PathBuf,
    requests: Arc<AtomicU64>,
    running: Option<(oneshot::Sender<Infallible>, JoinHandle<()>)>,
}

impl S3Server {
    /// A server over this folder that wants its key and secret.
    pub fn start(folder: &Path) -> Self {
        Self::start_with(folder, true)
    }

    /// A server over this folder that answers everybody.
    pub fn start_open(folder: &Path) -> Self {
        Self::start_with(folder, false)
    }

    fn start_with(folder: &Path, is_locked: bool) -> Self {
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
        let (stop, stopped) = oneshot::channel();
        let serve = move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(async {
                tokio::select! {
                    () = accept(listener, service, counted) => {}
                    // The sender is never used but dropped.
                    _ = stopped => {}
                }
            });
        };
        let thread = Builder::new().name("s3".into()).spawn(serve).expect("a thread");
        let folder = folder.to_owned();
        Self { endpoint, folder, requests, running: Some((stop, thread)) }
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

async fn accept(listener: TcpListener, service: S3Service, requests: Arc<AtomicU64>) {
    let listener = tokio::net::TcpListener::from_std(listener).expect("a listener");
    while let Ok((socket, _)) = listener.accept().await {
        let (service, requests) = (service.clone(), Arc::clone(&requests));
        let counted = hyper::service::service_fn(move |request| {
            requests.fetch_add(1, Ordering::Relaxed);
            hyper::service::Service::call(&service, request)
        });
        tokio::spawn(async move {
            let connection = hyper::server::conn::http1::Builder::new();
            // A connection that its peer closes is of no interest.
            let _ = connection.serve_connection(TokioIo::new(socket), counted).await;
        });
    }
}
