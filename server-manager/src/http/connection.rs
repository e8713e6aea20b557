//! One connection: who it is from, and the client of the event loop that it becomes.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};

use hyper::body::Incoming;
use hyper::header::{HeaderMap, USER_AGENT};
use hyper::{Request, Response, StatusCode};
use polyptych_protocol::request::Request as WallRequest;
use polyptych_text::printable;
use polyptych_tls::NodeIdentity;
use polyptych_wall::limits::NAME_BYTES_MAX;
use tokio::sync::OwnedSemaphorePermit;

use super::answer::{Body, Refusal};
use super::client::{Answered, HttpClient};
use super::{HttpContext, console, route};
use crate::strangers::Guest;

/// A connection.
pub(super) struct Connection {
    pub context: Arc<HttpContext>,
    address: SocketAddr,
    identity: Option<NodeIdentity>,
    standing: Mutex<Standing>,
    /// From the first request on that needs it.
    client: tokio::sync::Mutex<Option<HttpClient>>,
}

/// The standing of a connection.
enum Standing {
    /// It has not shown who it is.
    Stranger(Guest),
    /// It has, and takes one of the places.
    Known(#[expect(dead_code, reason = "counted until it is dropped")] OwnedSemaphorePermit),
    /// There was no place for it.
    Full,
}

impl Connection {
    pub fn new(
        context: Arc<HttpContext>,
        address: SocketAddr,
        identity: Option<NodeIdentity>,
        guest: Guest,
    ) -> Self {
        let standing = Mutex::new(Standing::Stranger(guest));
        Self { context, address, identity, standing, client: tokio::sync::Mutex::default() }
    }

    /// Answers a request, whatever it is.
    pub async fn answer(&self, request: Request<Incoming>) -> Response<Body> {
        let is_head = request.method() == hyper::Method::HEAD;
        let mut answer = match self.try_answer(request).await {
            Ok(answer) => answer,
            Err(refusal) => refusal.into_answer(),
        };
        if is_head {
            *answer.body_mut() = Body::Bytes(bytes::Bytes::new(), None);
        }
        answer
    }

    async fn try_answer(&self, request: Request<Incoming>) -> Result<Response<Body>, Refusal> {
        if let Standing::Stranger(guest) = &*self.standing() {
            guest.has_spoken();
        }
        let gate = &self.context.gate;
        gate.check_host(request.headers(), request.uri())?;
        if let Some(answer) = console::answer(request.method(), request.uri().path()) {
            return Ok(answer);
        }
        if request.uri().path() == "/login" {
            return console::log_in(gate, request.method(), request.uri().query());
        }
        gate.check_origin(request.method(), request.headers())?;
        let found = route::find(request.method(), request.uri().path())?;
        if !found.route.is_open() {
            gate.authenticate(request.headers(), self.identity.as_ref())?;
            self.take_place()?;
        }
        route::answer(self, found, request).await
    }

    fn standing(&self) -> std::sync::MutexGuard<'_, Standing> {
        self.standing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// It has shown who it is: it makes no room for strangers any more, and takes a place.
    fn take_place(&self) -> Result<(), Refusal> {
        let mut standing = self.standing();
        let place = || Arc::clone(&self.context.admitted).try_acquire_owned();
        match &*standing {
            Standing::Known(_) => return Ok(()),
            Standing::Stranger(guest) => guest.is_let_in(),
            Standing::Full => {}
        }
        *standing = place().map_or(Standing::Full, Standing::Known);
        if matches!(*standing, Standing::Full) {
            let reason = format!(
                "{} connections are open, and no more may be; end one of them",
                super::CONNECTIONS_MAX
            );
            return Err(Refusal::unavailable(reason));
        }
        Ok(())
    }

    /// Asks the wall, as a client that lasts as long as the connection.
    ///
    /// # Errors
    /// The manager's refusal.
    pub async fn ask(
        &self,
        headers: &HeaderMap,
        request: WallRequest,
    ) -> Result<Answered, Refusal> {
        let mut seat = self.client.lock().await;
        // One that was idle may have made room for another.
        let kept = seat.take().filter(|client| !client.is_over());
        let mut client = match kept {
            Some(client) => client,
            None => self.new_client(headers).await?,
        };
        let answered = client.ask(request).await;
        let is_over = matches!(
            &answered,
            Err(refusal) if refusal.status == StatusCode::SERVICE_UNAVAILABLE
                || refusal.status == StatusCode::GATEWAY_TIMEOUT
        );
        *seat = Some(client).filter(|_| !is_over);
        answered
    }

    /// A client of its own, for what takes long: the connection's asks one thing at a time.
    ///
    /// # Errors
    /// 503, where there is no place.
    pub async fn new_client(&self, headers: &HeaderMap) -> Result<HttpClient, Refusal> {
        let (events, queues) = (&self.context.events, &self.context.queues);
        HttpClient::join(events, queues, self.name(headers), Some(self.address)).await
    }

    /// The client's name in status and log: of its certificate, or what it calls itself.
    fn name(&self, headers: &HeaderMap) -> String {
        let agent = headers.get(USER_AGENT).and_then(|agent| agent.to_str().ok());
        let agent = agent.and_then(|agent| agent.split([' ', '/']).next()).unwrap_or("client");
        let name = match &self.identity {
            Some(NodeIdentity::Client(name)) => format!("http {name}"),
            _ => format!("http {agent}"),
        };
        let name = printable(&name).into_owned();
        name[..name.floor_char_boundary(NAME_BYTES_MAX)].to_owned()
    }
}
