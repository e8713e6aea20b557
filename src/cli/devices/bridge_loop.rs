//! The loop of the bridge: readings in, requests to the manager out.

use std::pin::pin;
use std::time::{Duration, Instant};

use polyptych_client::{
    Client, ClientError, ConnectOptions, Epoch, FeedbackStream, ReconnectPolicy,
};
use polyptych_devices::bridge::Purpose;
use polyptych_devices::{Bridge, Micros};
use polyptych_wall::Wall;
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until};

use super::sources::{self, Reading, ReadingKind};
use super::{ManagerAddress, line};
use crate::cli::say;
use crate::logging;

/// Pause between two attempts to reach a manager that has not been there yet.
const CONNECT_PAUSE: Duration = Duration::from_secs(1);

/// Period of lines with the state of devices.
const SUMMARY_PERIOD: Duration = Duration::from_secs(10);

/// Time for which a request waits for a connection: what it says is old by then.
const REQUEST_WAIT: Duration = Duration::from_millis(500);

type Answers = JoinSet<(Purpose, Result<(), ClientError>)>;

/// The connection with the manager as it was at the last turn.
struct ManagerLink {
    client: Client,
    feedback: FeedbackStream,
    epoch: Epoch,
    is_connected: bool,
}

/// Reads devices and moves head and camera, until the connection with the manager ends for good.
///
/// # Errors
/// A device that cannot be opened, and a client that has ended.
pub async fn run(wall: &Wall, address: &ManagerAddress) -> anyhow::Result<()> {
    let began = Instant::now();
    let clock = || began.elapsed().as_micros() as Micros;
    let mut readings = sources::open(wall).await?;
    let mut bridge = Bridge::new(wall);
    let reconnect = ReconnectPolicy { wait: REQUEST_WAIT, ..ReconnectPolicy::default() };
    let options = address.options(Some(reconnect));
    let mut connecting = pin!(connect(wall, &options));
    // Devices are read from the first: what waits in sockets is old once there is a manager, and
    // a VRPN server may hold up its other clients while one does not read.
    let mut link = loop {
        bridge.advance(clock());
        for event in bridge.take_events() {
            say(event)?;
        }
        let due = began + Duration::from_micros(bridge.poll_timeout(false));
        tokio::select! {
            link = &mut connecting => break link?,
            Some(reading) = readings.recv() => take(&mut bridge, clock(), reading),
            () = sleep_until(due.into()) => {}
        }
    };
    let mut answers = Answers::new();
    let mut summary_due = Instant::now() + SUMMARY_PERIOD;
    loop {
        send_due(&mut bridge, &mut link, &mut answers, clock());
        for event in bridge.take_events() {
            say(event)?;
        }
        let due = began + Duration::from_micros(bridge.poll_timeout(link.is_connected));
        let due = due.min(summary_due);
        tokio::select! {
            Some(reading) = readings.recv() => {
                take(&mut bridge, clock(), reading);
                // The newest of all that have come counts.
                while let Ok(reading) = readings.try_recv() {
                    take(&mut bridge, clock(), reading);
                }
            }
            feedback = link.feedback.next() => match feedback {
                Some(feedback) => bridge.handle_swap(clock(), feedback.frame_us),
                None => link.client.connected().await.map(drop)?,
            },
            Some(Ok((purpose, answer))) = answers.join_next() => match answer {
                Ok(()) => bridge.handle_answer(clock(), purpose, Ok(())),
                Err(ClientError::Failed { reason, .. }) => {
                    bridge.handle_answer(clock(), purpose, Err(reason));
                }
                Err(_) => bridge.handle_no_answer(purpose),
            },
            Ok(_) = link.client.connected(), if !link.is_connected => {}
            () = sleep_until(due.into()) => {}
        }
        if Instant::now() >= summary_due {
            summary_due = Instant::now() + SUMMARY_PERIOD;
            for status in bridge.statuses(clock()) {
                say(line(&status))?;
            }
        }
    }
}

/// Connects as soon as there is a manager that stays.
async fn connect(wall: &Wall, options: &ConnectOptions) -> anyhow::Result<ManagerLink> {
    let mut told = String::new();
    let link = loop {
        match try_connect(options).await {
            Ok(link) => break link,
            Err(error) => {
                let reason = error.to_string();
                if reason != told {
                    logging::say_warning(&format!("{reason}; trying again"));
                    told = reason;
                }
                sleep(CONNECT_PAUSE).await;
            }
        }
    };
    say(format_args!(
        "reading {} of wall {} for the manager at {}",
        polyptych_text::counted(wall.devices.len(), "device"),
        link.client.wall_name(),
        link.client.address()
    ))?;
    Ok(link)
}

/// Connects to the manager that is there now, and subscribes to its feedback.
async fn try_connect(options: &ConnectOptions) -> Result<ManagerLink, ClientError> {
    let client = Client::connect_with(options.clone()).await?;
    let feedback = client.feedback().await?;
    Ok(ManagerLink { epoch: client.epoch(), client, feedback, is_connected: true })
}

/// Sends what is due, if there is a connection.
fn send_due(bridge: &mut Bridge, link: &mut ManagerLink, answers: &mut Answers, now: Micros) {
    let was_connected = link.is_connected;
    link.is_connected = link.client.is_connected();
    let epoch = link.client.epoch();
    if epoch != link.epoch || (link.is_connected && !was_connected) {
        link.epoch = epoch;
        bridge.handle_reconnect();
    }
    bridge.advance(now);
    if !link.is_connected {
        return;
    }
    while let Some((purpose, request)) = bridge.poll_request(now) {
        let client = link.client.clone();
        answers.spawn(async move { (purpose, client.request(request).await.map(drop)) });
    }
}

fn take(bridge: &mut Bridge, now: Micros, Reading { device, what }: Reading) {
    match what {
        ReadingKind::Packet(from, bytes) => bridge.handle_packet(now, device, from, &bytes),
        ReadingKind::Joystick(events) => bridge.handle_joystick(now, device, &events),
        ReadingKind::Pose(pose) => bridge.handle_pose(now, device, &pose),
        ReadingKind::Damaged(reason) => bridge.handle_damage(now, device, &reason),
        ReadingKind::Opened => bridge.handle_life(now, device),
        ReadingKind::Silent(reason) | ReadingKind::Failed(reason) => {
            bridge.handle_failure(now, device, &reason);
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::{SinkExt, StreamExt};
    use polyptych_client::{Request, Response};
    use polyptych_protocol::handshake::{Secret, Welcome};
    use polyptych_protocol::handshake_io::{Introduced, MessageStream, accept, receive_hello};
    use polyptych_protocol::ids::Term;
    use polyptych_protocol::request::{MessageToClient, RequestMessage};
    use tokio::net::{TcpListener, TcpStream};

    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    /// Lets a client in as a manager does, and waits for its first request.
    async fn serve(listener: &TcpListener) -> (MessageStream<TcpStream>, RequestMessage) {
        let (stream, _) = listener.accept().await.expect("a client");
        let introduced = receive_hello(stream, &Secret(TOKEN.into())).await;
        let Introduced { mut frames, proof, .. } = introduced.expect("introduced");
        let wall = "lab".into();
        let welcome =
            Welcome { epoch: Epoch(1), term: Term(1), session: 1, wall, heartbeat_ms: 2000 };
        accept(&mut frames, welcome, proof).await.expect("welcomed");
        let bytes = frames.next().await.expect("a request").expect("whole");
        let message = polyptych_protocol::framing::decode(&bytes).expect("a request");
        (frames, message)
    }

    #[tokio::test]
    async fn a_manager_that_goes_away_at_once_is_tried_again() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let mut options = ConnectOptions::new(address);
        options.token = Some(TOKEN.into());
        let manager = async {
            drop(serve(&listener).await);
            // The first client may yet come to say that it is no longer subscribed.
            let (mut frames, id) = loop {
                let (frames, RequestMessage { id, request, .. }) = serve(&listener).await;
                if request == Request::Subscribe(true) {
                    break (frames, id);
                }
                assert_eq!(request, Request::Subscribe(false));
            };
            let answer = MessageToClient::Reply { id, reply: Ok(Response::Done) };
            frames.send(polyptych_codec::encode(&answer)).await.expect("sent");
            frames
        };
        let wall = Wall::new("lab", Vec::new(), Vec::new());
        let (link, _frames) = tokio::join!(connect(&wall, &options), manager);
        assert_eq!(link.expect("connected").epoch, Epoch(1));
    }
}
