//! This machine's address, for the line that a display without a frame shows.

use std::net::SocketAddr;

use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use tokio::net::UdpSocket;

/// This machine's address on the way to the manager, with port 0: the system's table of routes is
/// asked by a socket that sends nothing. `None` where there is no way, or no such name.
pub(crate) async fn own_address(manager: &str) -> Option<SocketAddr> {
    let ask = async {
        for any in ["0.0.0.0:0", "[::]:0"] {
            let Ok(socket) = UdpSocket::bind(any).await else { continue };
            if socket.connect(manager).await.is_ok() {
                let address = socket.local_addr().ok()?;
                return Some(SocketAddr::new(address.ip(), 0));
            }
        }
        None
    };
    tokio::time::timeout(HANDSHAKE_TIME_MAX, ask).await.ok().flatten()
}
