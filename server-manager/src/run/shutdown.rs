//! The end of a manager: all peers are told why.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use polyptych_core::{ClientRequest, SessionId};
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::request::{MessageToClient, Response, StoppedServers};
use polyptych_protocol::server_message::ServerMessage;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout_at};

use super::EventLoop;
use crate::session::{DRAIN_TIME_MAX, Event};

/// Maximum wait for the goodbyes of servers that were told to end: their network threads answer
/// within milliseconds, whatever they draw.
const STOP_TIME_MAX: Duration = Duration::from_secs(5);

impl EventLoop {
    /// Tells all servers to end, waits until each has said goodbye, and answers the client.
    pub(super) async fn stop_servers(
        &mut self,
        job: ClientRequest,
        inbox: &mut mpsc::Receiver<Event>,
    ) {
        let goodbye = polyptych_codec::encode(&Command::Goodbye(Goodbye::StoppedWithServers));
        let goodbye = polyptych_codec::framed(&goodbye);
        let mut waiting: BTreeMap<SessionId, String> = BTreeMap::new();
        for (session, link) in &self.servers {
            // One that reads nothing is waited for as the others are, and says nothing.
            link.send(&goodbye);
            waiting.insert(*session, link.server().to_owned());
        }
        let mut stopped = StoppedServers { absent: self.absent(&waiting), ..Default::default() };
        let until = Instant::now() + STOP_TIME_MAX;
        while !waiting.is_empty() {
            // The client that waits for the answer hears that this manager works.
            let next = until.min(self.beat());
            let event = match timeout_at(next, inbox.recv()).await {
                Ok(Some(event)) => event,
                Err(_) if next < until => continue,
                Ok(None) | Err(_) => break,
            };
            match event {
                Event::ServerSays { from, status: ServerMessage::Goodbye { .. }, .. } => {
                    stopped.ended.extend(waiting.remove(&from));
                }
                Event::Gone { session, reason } => {
                    let silent = waiting.remove(&session).map(|name| (name, reason));
                    stopped.silent.extend(silent);
                }
                // What else comes is answered with the goodbye of the manager.
                _ => {}
            }
        }
        let seconds = STOP_TIME_MAX.as_secs();
        let reason = format!("it did not say goodbye within {seconds} s");
        stopped.silent.extend(waiting.into_values().map(|name| (name, reason.clone())));
        stopped.ended.sort_unstable();
        tracing::info!(ended = stopped.ended.len(), silent = ?stopped.silent, "servers stopped");
        let answer =
            MessageToClient::Reply { id: job.id, reply: Ok(Response::ServersStopped(stopped)) };
        self.answer(job.client, answer);
    }

    /// The servers of the wall file that are not connected.
    fn absent(&self, connected: &BTreeMap<SessionId, String>) -> Vec<String> {
        let connected: BTreeSet<&String> = connected.values().collect();
        let servers = self.options.wall.channels.iter().map(|channel| &channel.server);
        let absent: BTreeSet<&String> = servers.filter(|name| !connected.contains(name)).collect();
        absent.into_iter().cloned().collect()
    }

    /// Tells everyone why, and gives them a moment to hear it.
    pub(super) async fn shut_down(self, goodbye: &Goodbye) {
        tracing::info!(reason = %goodbye, "the manager ends");
        let to_servers = polyptych_codec::encode(&Command::Goodbye(goodbye.clone()));
        let to_servers = polyptych_codec::framed(&to_servers);
        let to_clients = polyptych_codec::encode(&MessageToClient::Goodbye(goodbye.clone()));
        for link in self.servers.values() {
            link.send(&to_servers);
            link.close.cancel();
        }
        for seat in self.clients.values() {
            let _ = seat.link.outbox.try_send(to_clients.clone());
            seat.link.close.cancel();
        }
        let all_closed = async {
            for link in self.servers.values() {
                link.closed().await;
            }
            for seat in self.clients.values() {
                seat.link.outbox.closed().await;
            }
        };
        let _ = tokio::time::timeout(DRAIN_TIME_MAX, all_closed).await;
    }
}
