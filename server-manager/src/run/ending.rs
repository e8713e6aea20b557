//! How a manager ends: everyone is told why.

use polyptych_protocol::codec;
use polyptych_protocol::command::Command;
use polyptych_protocol::request::Answer;

use super::Hub;
use crate::session::DRAIN_TIME_MAX;

impl Hub {
    /// Tells everyone why, and gives them a moment to hear it.
    pub(super) async fn say_goodbye(self, reason: &str) {
        tracing::info!(reason, "the manager ends");
        let to_servers = codec::encode(&Command::Goodbye { reason: reason.to_owned() });
        let to_servers = codec::framed(&to_servers);
        let to_clients = codec::encode(&Answer::Goodbye { reason: reason.to_owned() });
        for link in self.servers.values() {
            link.send(&to_servers);
            link.close.cancel();
        }
        for link in self.clients.values() {
            let _ = link.outbox.try_send(to_clients.clone());
            link.close.cancel();
        }
        let all_closed = async {
            for link in self.servers.values() {
                link.closed().await;
            }
            for link in self.clients.values() {
                link.outbox.closed().await;
            }
        };
        let _ = tokio::time::timeout(DRAIN_TIME_MAX, all_closed).await;
    }
}
