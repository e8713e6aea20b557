//! The measuring stick: the same bytes over the same sockets, and nothing else.

use std::time::Instant;

use anyhow::Context;
use polyptych_client::Quantiles;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::stub::Sizes;
use super::{Measured, width_us};

/// Bytes that a frame's length takes on the wire.
const LENGTH_BYTES: usize = 4;

/// Measures a barrier of bare sockets, with one thread for the middle and one for each other end.
pub(super) fn measure(servers: u16, frames: u64, sizes: Sizes) -> anyhow::Result<Measured> {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").context("no port is free")?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let start_one = |index: u16| {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let work = move || runtime.block_on(answer(address, frames, sizes));
        std::thread::Builder::new().name(format!("raw-{index}")).spawn(work)
    };
    let others = (0..servers).map(start_one).collect::<std::io::Result<Vec<_>>>()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let barriers = runtime.block_on(async {
        let listener = TcpListener::from_std(listener)?;
        let mut streams = Vec::new();
        for _ in 0..servers {
            let (stream, _) = listener.accept().await?;
            stream.set_nodelay(true)?;
            streams.push(stream);
        }
        turn(&mut streams, frames, sizes).await
    })?;
    let mut received = Vec::new();
    for other in others {
        received.push(other.join().map_err(|_| anyhow::anyhow!("a raw peer panicked"))??);
    }
    let frames = 0..usize::try_from(frames)?;
    let skews = frames.filter_map(|frame| {
        let instants: Vec<Instant> =
            received.iter().filter_map(|of| of.get(frame).copied()).collect();
        width_us(&instants)
    });
    Ok(Measured {
        barrier_us: Quantiles::from_samples(barriers),
        skew_us: Quantiles::from_samples(skews),
    })
}

/// The middle: sends to all, hears from all, sends to all. Gives microseconds for each frame.
async fn turn(streams: &mut [TcpStream], frames: u64, sizes: Sizes) -> std::io::Result<Vec<f64>> {
    let frame = vec![0; sizes.frame + LENGTH_BYTES];
    let swap = vec![0; sizes.swap + LENGTH_BYTES];
    let mut barriers = Vec::new();
    for n in 0..frames {
        let began = Instant::now();
        for stream in &mut *streams {
            stream.write_all(&frame).await?;
        }
        // The report of the frame before has come meanwhile, as ours does.
        let late = if n == 0 { 0 } else { sizes.shown + LENGTH_BYTES };
        let mut reports = vec![0; late + sizes.drawn + LENGTH_BYTES];
        for stream in &mut *streams {
            stream.read_exact(&mut reports).await?;
        }
        barriers.push(began.elapsed().as_secs_f64() * 1e6);
        for stream in &mut *streams {
            stream.write_all(&swap).await?;
        }
    }
    Ok(barriers)
}

/// One of the others. Gives the instants at which it was released.
async fn answer(
    address: std::net::SocketAddr,
    frames: u64,
    sizes: Sizes,
) -> std::io::Result<Vec<Instant>> {
    let mut stream = TcpStream::connect(address).await?;
    stream.set_nodelay(true)?;
    let mut frame = vec![0; sizes.frame + LENGTH_BYTES];
    let mut swap = vec![0; sizes.swap + LENGTH_BYTES];
    let drawn = vec![0; sizes.drawn + LENGTH_BYTES];
    let shown = vec![0; sizes.shown + LENGTH_BYTES];
    let mut released = Vec::new();
    for _ in 0..frames {
        stream.read_exact(&mut frame).await?;
        stream.write_all(&drawn).await?;
        stream.read_exact(&mut swap).await?;
        released.push(Instant::now());
        stream.write_all(&shown).await?;
    }
    Ok(released)
}
