//! A limit on what an unauthenticated peer may send.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use polyptych_protocol::limits::HANDSHAKE_BYTES_MAX;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// A TCP stream with a read limit that is lifted after authentication.
#[derive(Debug)]
pub(crate) struct LimitedStream {
    tcp: TcpStream,
    /// Bytes that may still come; any number once the meter is lifted.
    left: Option<usize>,
}

impl LimitedStream {
    pub fn new(tcp: TcpStream) -> Self {
        Self { tcp, left: Some(HANDSHAKE_BYTES_MAX) }
    }

    /// Lets any number of bytes come from now on.
    pub fn lift(&mut self) {
        self.left = None;
    }

    pub fn into_inner(self) -> TcpStream {
        self.tcp
    }
}

impl AsyncRead for LimitedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let Some(left) = self.left else {
            return Pin::new(&mut self.tcp).poll_read(context, buffer);
        };
        if left == 0 {
            let what = format!("more than {HANDSHAKE_BYTES_MAX} bytes, and still a stranger");
            return Poll::Ready(Err(io::Error::new(io::ErrorKind::FileTooLarge, what)));
        }
        // No more than that is read: a peer's hello may come together with the last of its
        // handshake, and is none of a stranger's bytes.
        let room = left.min(buffer.remaining());
        let mut part = ReadBuf::new(buffer.initialize_unfilled_to(room));
        ready!(Pin::new(&mut self.tcp).poll_read(context, &mut part))?;
        let came = part.filled().len();
        buffer.advance(came);
        self.left = Some(left - came);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for LimitedStream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.tcp).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.tcp).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.tcp).poll_shutdown(context)
    }
}
